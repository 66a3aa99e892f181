"""The project's own schemes on an axis, sampled, with the numbers that one rule found for each on the linearised aircraft."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.controllers import (
    Adrc,
    KnownParameters,
    L1Adaptive,
    L1PiecewiseConstant,
    LinearFeedback,
    Mrac,
    RobustMrac,
    Sampled,
)
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.controllers.windup import ModifiedError
from barbalat.design import hinf_feedback, pi_feedback
from barbalat.linear.systems import StateSpace, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Axis
from barbalat.vehicles.offered import ROBUST, designable, require_offered


class Flying(NamedTuple):
    """A controller and what it reads."""

    problem: Problem
    controller: Controller


Numbers = Mapping[str, float]
"""Of a scheme, by the names of its knobs."""


@dataclass(frozen=True)
class Contestant:
    """A scheme in the comparison.

    make    from an axis and the scheme's numbers to what flies
    knobs   the numbers that are tuned, each with the range in which it is sought
    adapts  whether it adapts at all
    """

    make: Callable[[Axis, Numbers], Flying]
    knobs: Mapping[str, tuple[float, float]]
    adapts: bool = True


def _lqr(axis: Axis, _: Numbers) -> Flying:
    problem = axis.linear_problem
    return Flying(problem, Sampled(KnownParameters(theta=axis.gain, name="LQR"), SAMPLE_TIME, discretization="euler"))


def _sampled(axis: Axis, linear: LinearFeedback) -> Flying:
    """With its integral protected against windup: what a missing control weighs is K's own gain at the crossover."""
    K = StateSpace.accept("controller", linear.controller)
    gain = float(abs(K.response(np.array([axis.followed.crossover]))[0]))
    return Flying(axis.linear_problem, Sampled(replace(linear, anti_windup=gain), SAMPLE_TIME))


def _linear(axis: Axis, numbers: Numbers) -> Flying:
    """SIMC's PI on the model-following error, with a crossover of ``bandwidth``."""
    delay = 1 / (2 * numbers["bandwidth"])
    return _sampled(axis, pi_feedback(axis.linear_problem.known, unmodelled_delay=delay, nominal=axis.gain, name="LQR with PI"))


def _hinf(axis: Axis, numbers: Numbers) -> Flying:
    delay = 1 / (2 * numbers["bandwidth"])
    return _sampled(axis, hinf_feedback(axis.linear_problem.known, unmodelled_delay=delay, nominal=axis.gain, name="H-infinity"))


def _adrc(axis: Axis, numbers: Numbers) -> Flying:
    adrc = Adrc(bandwidth=numbers["bandwidth"], nominal=axis.gain, saturated_predictor=True)
    return Flying(axis.linear_problem, Sampled(adrc, SAMPLE_TIME))


def _gain(axis: Axis, frequency: float) -> Array:
    """Gamma, (1 + n,), with which each estimate swings so fast against a regressor of the size met: Gamma_i phi_i^2 b'Pb."""
    known = axis.adaptive_problem.known
    return np.asarray(frequency**2 / (known.b @ known.P @ known.b * np.array(axis.followed.met) ** 2))


def _mrac(axis: Axis, numbers: Numbers) -> Flying:
    mrac = Mrac(gamma=_gain(axis, numbers["adaptation"]), theta_hat0=axis.nominal, modified_error=ModifiedError())
    return Flying(axis.adaptive_problem, Sampled(mrac, SAMPLE_TIME))


def _robust(axis: Axis, numbers: Numbers) -> Flying:
    robust = RobustMrac(
        tau=1 / numbers["bandwidth"],
        law=LeastSquares(covariance0=numbers["covariance"]),
        theta_hat0=axis.nominal,
        saturated_predictor=True,
    )
    return Flying(axis.adaptive_problem, Sampled(robust, SAMPLE_TIME))


def _l1(axis: Axis, numbers: Numbers) -> Flying:
    l1 = L1Adaptive(
        gamma=_gain(axis, numbers["adaptation"]),
        filter=input_filter(kappa=1 / numbers["bandwidth"]),
        theta_hat0=axis.nominal,
        saturated_predictor=True,
        name="L1",
    )
    return Flying(axis.adaptive_problem, Sampled(l1, SAMPLE_TIME))


def _piecewise(axis: Axis, numbers: Numbers, *, flown: bool = False) -> Flying:
    controller = L1PiecewiseConstant(
        sample_time=SAMPLE_TIME,
        filter=input_filter(kappa=1 / numbers["bandwidth"]),
        as_flown=AsFlown(nominal=axis.gain) if flown else None,
        saturated_predictor=True,
        name="L1 piecewise, as flown" if flown else "L1 piecewise",
    )
    return Flying(axis.linear_problem, controller)


def _as_flown(axis: Axis, numbers: Numbers) -> Flying:
    return _piecewise(axis, numbers, flown=True)


BANDWIDTH_RANGE = {"bandwidth": (0.5, 50.0)}
"""[rad/s], from what a flight of 15 s hardly shows to half a radian in a sample."""
ADAPTATION_RANGE = {"adaptation": (0.3, 100.0)}
"""[rad/s] at which estimates swing, up to a radian in a sample."""
SCHEMES: dict[str, Contestant] = {
    "lqr": Contestant(_lqr, {}, adapts=False),
    "linear": Contestant(_linear, BANDWIDTH_RANGE, adapts=False),
    ROBUST: Contestant(_hinf, BANDWIDTH_RANGE, adapts=False),
    "adrc": Contestant(_adrc, BANDWIDTH_RANGE, adapts=False),
    "mrac": Contestant(_mrac, ADAPTATION_RANGE),
    "robust-mrac": Contestant(_robust, {**BANDWIDTH_RANGE, "covariance": (1e-3, 1e2)}),
    "l1": Contestant(_l1, {**BANDWIDTH_RANGE, **ADAPTATION_RANGE}),
    "l1-piecewise": Contestant(_piecewise, BANDWIDTH_RANGE),
    "l1-piecewise-flown": Contestant(_as_flown, BANDWIDTH_RANGE),
}
"""The registry, by the names of the command line."""
TUNED: dict[str, dict[str, Numbers]] = {
    "f16-pitch": {
        "lqr": {},
        "linear": {"bandwidth": 6.11},
        "hinf": {"bandwidth": 2.04},
        "adrc": {"bandwidth": 4.9},
        "mrac": {"adaptation": 2.96},
        "robust-mrac": {"bandwidth": 4.76, "covariance": 0.31},
        "l1": {"bandwidth": 7.02, "adaptation": 75.3},
        "l1-piecewise": {"bandwidth": 7.3},
        "l1-piecewise-flown": {"bandwidth": 5.37},
    },
    "f16-roll": {
        "lqr": {},
        "linear": {"bandwidth": 6.19},
        "hinf": {"bandwidth": 2.18},
        "adrc": {"bandwidth": 6.74},
        "mrac": {"adaptation": 2.8},
        "robust-mrac": {"bandwidth": 6.75, "covariance": 0.001},
        "l1": {"bandwidth": 50.0, "adaptation": 2.83},
        "l1-piecewise": {"bandwidth": 8.42},
        "l1-piecewise-flown": {"bandwidth": 7.46},
    },
}
"""By flights and schemes, to three digits: what ``benchmarks/flight_tuning.py`` finds at 10,013 ft and Mach 0.525."""


def available() -> list[str]:
    """All schemes but those whose design lacks its packages here."""
    return designable(SCHEMES)


def require_known(names: Sequence[str]) -> None:
    """InputError for a scheme that is none of these."""
    require_offered(names, SCHEMES)


def flying(axis: Axis, names: Sequence[str]) -> list[Flying]:
    """The schemes of these names, each once, with the numbers found for the axis."""
    return [SCHEMES[name].make(axis, TUNED[axis.followed.name][name]) for name in dict.fromkeys(names)]
