"""What the project's schemes add to a geometric controller, axis by axis: sampled, with numbers that one rule found for each."""

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
from barbalat.design import hinf_feedback
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array
from barbalat.vehicles.offered import ROBUST, designable, require_offered
from barbalat.vehicles.quadrotor.axes import CROSSOVER, Axis


class OnAxis(NamedTuple):
    """A controller and what it reads."""

    problem: Problem
    controller: Controller


Numbers = Mapping[str, float]
"""Of a scheme on an axis, by the names of its knobs; in units of the axis, so that one range is that of all axes."""


@dataclass(frozen=True)
class Contestant:
    """A scheme in the comparison.

    make   from an axis and the scheme's numbers to what flies
    knobs  the numbers that are tuned, each with the range in which it is sought
    """

    make: Callable[[Axis, Numbers], OnAxis]
    knobs: Mapping[str, tuple[float, float]]


def _low_pass(axis: Axis, numbers: Numbers) -> TransferFunction:
    return input_filter(kappa=axis.lag / numbers["bandwidth"])


def _gain(axis: Axis, numbers: Numbers) -> Array:
    """Gamma, (3,), with which each component swings so fast against errors of the axis' size: Gamma_i phi_i^2 b'Pb."""
    known, frequency = axis.adaptive_problem.known, numbers["adaptation"] * axis.frequency
    sizes = np.array([1.0, axis.size, axis.size * axis.frequency])
    return np.asarray(frequency**2 / (known.b @ known.P @ known.b * sizes**2))


def _geometric(axis: Axis, _: Numbers) -> OnAxis:
    return OnAxis(
        axis.linear_problem,
        Sampled(KnownParameters(theta=np.zeros(2), name="Geometric"), axis.sample_time, discretization="euler"),
    )


def _integral(axis: Axis, numbers: Numbers) -> OnAxis:
    """Goodarzi, Lee, Leok, Geometric nonlinear PID control of a quadrotor UAV on SE(3), ECC 2013."""
    integral = TransferFunction([numbers["corner"] * axis.frequency * axis.gain[1]], [1.0, 0.0])
    linear = LinearFeedback(integral, output=axis.gain / axis.gain[1], name="Geometric, integral")
    return OnAxis(axis.linear_problem, Sampled(linear, axis.sample_time))


def _hinf(axis: Axis, numbers: Numbers) -> OnAxis:
    """On the integral's output, as the F-16's is on its PI's, and protected against windup alike."""
    linear = hinf_feedback(
        axis.linear_problem.known,
        unmodelled_delay=axis.lag / (2 * numbers["bandwidth"]),
        output=axis.gain / axis.gain[1],
        nominal=np.zeros(2),
        name="H-infinity",
    )
    K = StateSpace.accept("controller", linear.controller)
    gain = float(abs(K.response(np.array([CROSSOVER * axis.frequency]))[0]))
    return OnAxis(axis.linear_problem, Sampled(replace(linear, anti_windup=gain), axis.sample_time))


def _adrc(axis: Axis, numbers: Numbers) -> OnAxis:
    adrc = Adrc(bandwidth=numbers["bandwidth"] / axis.lag, saturated_predictor=True)
    return OnAxis(axis.linear_problem, Sampled(adrc, axis.sample_time))


def _mrac(axis: Axis, numbers: Numbers) -> OnAxis:
    return OnAxis(axis.adaptive_problem, Sampled(Mrac(gamma=_gain(axis, numbers)), axis.sample_time))


def _robust(axis: Axis, numbers: Numbers) -> OnAxis:
    law = LeastSquares(covariance0=numbers["covariance"])
    robust = RobustMrac(tau=axis.lag / numbers["bandwidth"], law=law, saturated_predictor=True)
    return OnAxis(axis.adaptive_problem, Sampled(robust, axis.sample_time))


def _l1(axis: Axis, numbers: Numbers) -> OnAxis:
    l1 = L1Adaptive(gamma=_gain(axis, numbers), filter=_low_pass(axis, numbers), saturated_predictor=True, name="L1")
    return OnAxis(axis.adaptive_problem, Sampled(l1, axis.sample_time))


def _piecewise(axis: Axis, numbers: Numbers, *, flown: bool = False) -> OnAxis:
    controller = L1PiecewiseConstant(
        sample_time=axis.sample_time,
        filter=_low_pass(axis, numbers),
        as_flown=AsFlown() if flown else None,
        saturated_predictor=True,
        name="L1 piecewise, as flown" if flown else "L1 piecewise",
    )
    return OnAxis(axis.linear_problem, controller)


def _as_flown(axis: Axis, numbers: Numbers) -> OnAxis:
    return _piecewise(axis, numbers, flown=True)


BANDWIDTH = {"bandwidth": (0.02, 4.0)}
"""Times the axis' lag: from what a flight hardly shows to four times what a loop of one integrator with that lag can bear."""
DESIGN_BANDWIDTH = {"bandwidth": (0.025, 4.0)}
"""The same for H-infinity, from the slowest of which it finds a design for every axis: for a longer delay no controller meets the
weights around the feedback's loop."""
CORNER = {"corner": (0.01, 2.0)}
"""Over the axis' natural frequency."""
ADAPTATION = {"adaptation": (0.03, 30.0)}
"""Frequency with which estimates swing over the axis' natural one: up to half a radian in a sample and more."""
SCHEMES: dict[str, Contestant] = {
    "geometric": Contestant(_geometric, {}),
    "geometric-integral": Contestant(_integral, CORNER),
    ROBUST: Contestant(_hinf, DESIGN_BANDWIDTH),
    "adrc": Contestant(_adrc, BANDWIDTH),
    "mrac": Contestant(_mrac, ADAPTATION),
    "robust-mrac": Contestant(_robust, {**BANDWIDTH, "covariance": (1e-3, 1e2)}),
    "l1": Contestant(_l1, {**BANDWIDTH, **ADAPTATION}),
    "l1-piecewise": Contestant(_piecewise, BANDWIDTH),
    "l1-piecewise-flown": Contestant(_as_flown, BANDWIDTH),
}
"""The registry, by the names of the command line."""
TUNED: dict[str, dict[str, Numbers]] = {
    "roll": {
        "geometric": {},
        "geometric-integral": {"corner": 0.11},
        ROBUST: {"bandwidth": 0.11},
        "adrc": {"bandwidth": 0.316},
        "mrac": {"adaptation": 0.806},
        "robust-mrac": {"bandwidth": 0.316, "covariance": 0.00369},
        "l1": {"bandwidth": 0.327, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 0.331},
        "l1-piecewise-flown": {"bandwidth": 0.332},
    },
    "yaw": {
        "geometric": {},
        "geometric-integral": {"corner": 0.444},
        ROBUST: {"bandwidth": 0.0913},
        "adrc": {"bandwidth": 0.13},
        "mrac": {"adaptation": 1.24},
        "robust-mrac": {"bandwidth": 0.13, "covariance": 100.0},
        "l1": {"bandwidth": 0.13, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 2.1},
        "l1-piecewise-flown": {"bandwidth": 3.03},
    },
    "forward": {
        "geometric": {},
        "geometric-integral": {"corner": 0.164},
        ROBUST: {"bandwidth": 0.0306},
        "adrc": {"bandwidth": 0.0853},
        "mrac": {"adaptation": 0.405},
        "robust-mrac": {"bandwidth": 0.129, "covariance": 1.27},
        "l1": {"bandwidth": 0.0752, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 0.0855},
        "l1-piecewise-flown": {"bandwidth": 0.0861},
    },
}
"""By ``Axis.like`` and schemes, to three digits: what ``benchmarks/flight_tuning.py`` finds on the vehicle at hover."""


def available() -> list[str]:
    """All schemes but those whose design lacks its packages here."""
    return designable(SCHEMES)


def on_axis(name: str, axis: Axis) -> OnAxis:
    """The scheme with the numbers found for the axis."""
    return SCHEMES[name].make(axis, TUNED[axis.like][name])


def require_known(names: Sequence[str]) -> None:
    """InputError for a scheme that is none of these."""
    require_offered(names, SCHEMES)
