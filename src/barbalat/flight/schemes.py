"""The project's own schemes on the pitch axis, sampled, with settings by one rule each from the linearised aircraft."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.controllers import (
    KnownParameters,
    L1Adaptive,
    L1PiecewiseConstant,
    Mrac,
    RobustMrac,
    Sampled,
)
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.design import pi_feedback
from barbalat.flight.pitch import COMMANDED, SAMPLE_TIME, PitchAxis
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError, show


class Flying(NamedTuple):
    """A controller and what it reads."""

    problem: Problem
    controller: Controller


LAG_SHARE = 0.5
"""Bandwidth of C(s) times the equipment's lag: a loop of one integrator with this crossover keeps 60 deg of phase."""


def _low_pass(axis: PitchAxis) -> TransferFunction:
    return input_filter(kappa=axis.equipment.lag / LAG_SHARE)


def _lqr(axis: PitchAxis) -> Flying:
    problem = axis.linear_problem
    return Flying(problem, Sampled(KnownParameters(theta=axis.gain, name="LQR"), SAMPLE_TIME, discretization="euler"))


def _linear(axis: PitchAxis) -> Flying:
    problem = axis.linear_problem
    linear = pi_feedback(problem.known, unmodelled_delay=axis.equipment.lag, nominal=axis.gain, name="LQR with PI")
    return Flying(problem, Sampled(linear, SAMPLE_TIME))


MRAC_FREQUENCY = 1.5
"""[rad/s] at which the estimate of the trim swings with the error: half of CROSSOVER, so that the model stays the faster one."""
L1_FREQUENCY = 30.0
"""[rad/s], the same of L1, whose theory asks for fast adaptation: a third of a radian in a sample."""


def _gain(axis: PitchAxis, frequency: float) -> Array:
    """Gamma, (3,), with which each component swings so fast against a regressor of the command's size: Gamma_i phi_i^2 b'Pb."""
    known = axis.adaptive_problem.known
    sizes = np.array([1.0, COMMANDED, COMMANDED])
    return np.asarray(frequency**2 / (known.b @ known.P @ known.b * sizes**2))


def _mrac(axis: PitchAxis) -> Flying:
    mrac = Mrac(gamma=_gain(axis, MRAC_FREQUENCY), theta_hat0=axis.nominal)
    return Flying(axis.adaptive_problem, Sampled(mrac, SAMPLE_TIME))


def _robust(axis: PitchAxis) -> Flying:
    law = LeastSquares(covariance0=1.0)
    robust = RobustMrac(tau=axis.equipment.lag / LAG_SHARE, law=law, theta_hat0=axis.nominal, saturated_predictor=True)
    return Flying(axis.adaptive_problem, Sampled(robust, SAMPLE_TIME))


def _l1(axis: PitchAxis) -> Flying:
    l1 = L1Adaptive(
        gamma=_gain(axis, L1_FREQUENCY), filter=_low_pass(axis), theta_hat0=axis.nominal, saturated_predictor=True, name="L1"
    )
    return Flying(axis.adaptive_problem, Sampled(l1, SAMPLE_TIME))


def _piecewise(axis: PitchAxis) -> Flying:
    return Flying(
        axis.linear_problem,
        L1PiecewiseConstant(sample_time=SAMPLE_TIME, filter=_low_pass(axis), saturated_predictor=True, name="L1 piecewise"),
    )


def _as_flown(axis: PitchAxis) -> Flying:
    flown = L1PiecewiseConstant(
        sample_time=SAMPLE_TIME,
        filter=_low_pass(axis),
        as_flown=AsFlown(nominal=axis.gain),
        saturated_predictor=True,
        name="L1 piecewise, as flown",
    )
    return Flying(axis.linear_problem, flown)


SCHEMES: dict[str, Callable[[PitchAxis], Flying]] = {
    "lqr": _lqr,
    "linear": _linear,
    "mrac": _mrac,
    "robust-mrac": _robust,
    "l1": _l1,
    "l1-piecewise": _piecewise,
    "l1-piecewise-flown": _as_flown,
}
"""The registry, by the names of the command line."""


def require_known(names: Sequence[str]) -> None:
    """InputError for a scheme that is none of these."""
    unknown = [name for name in names if name not in SCHEMES]
    if unknown:
        fits = " (it does not fit this axis, or is none)" if unknown[0] else ""
        raise InputError(f"--schemes must be of {', '.join(SCHEMES)}, got {show(unknown[0])}{fits}")


def flying(axis: PitchAxis, names: Sequence[str]) -> list[Flying]:
    """The schemes of these names, each once."""
    return [SCHEMES[name](axis) for name in dict.fromkeys(names)]
