"""What the project's schemes add to a geometric controller, axis by axis: sampled, with settings by one rule each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from barbalat.flight.quadrotor.axes import Axis
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError, show


class OnAxis(NamedTuple):
    """A controller and what it reads."""

    problem: Problem
    controller: Controller


LAG_SHARE = 0.5
"""Bandwidth of C(s) times the axis' lag: a loop of one integrator with this crossover keeps 60 deg of phase."""
INTEGRAL_SHARE = 0.2
"""Of the natural frequency, for the corner of the integral: it takes 7 deg of the phase at the crossover."""
MRAC_SHARE = 0.5
"""Of the natural frequency, for the estimate of a constant disturbance: the model stays the faster one."""
SAMPLE_ANGLE = 0.3
"""[rad] by which L1's fast estimate swings in a sample."""


def _low_pass(axis: Axis) -> TransferFunction:
    return input_filter(kappa=axis.lag / LAG_SHARE)


def _gain(axis: Axis, frequency: float) -> Array:
    """Gamma, (3,), with which each component swings so fast against errors of the axis' size: Gamma_i phi_i^2 b'Pb."""
    known = axis.adaptive_problem.known
    sizes = np.array([1.0, axis.size, axis.size * axis.frequency])
    return np.asarray(frequency**2 / (known.b @ known.P @ known.b * sizes**2))


def _geometric(axis: Axis) -> OnAxis:
    return OnAxis(
        axis.linear_problem,
        Sampled(KnownParameters(theta=np.zeros(2), name="Geometric"), axis.sample_time, discretization="euler"),
    )


def _integral(axis: Axis) -> OnAxis:
    """Goodarzi, Lee, Leok, Geometric nonlinear PID control of a quadrotor UAV on SE(3), ECC 2013."""
    zero = axis.gain[0] / axis.gain[1]
    integral = TransferFunction([INTEGRAL_SHARE * axis.frequency * axis.gain[1]], [1.0, 0.0])
    linear = LinearFeedback(integral, output=[zero, 1.0], name="Geometric, integral")
    return OnAxis(axis.linear_problem, Sampled(linear, axis.sample_time))


def _adrc(axis: Axis) -> OnAxis:
    adrc = Adrc(bandwidth=LAG_SHARE / axis.lag, saturated_predictor=True)
    return OnAxis(axis.linear_problem, Sampled(adrc, axis.sample_time))


def _mrac(axis: Axis) -> OnAxis:
    mrac = Mrac(gamma=_gain(axis, MRAC_SHARE * axis.frequency))
    return OnAxis(axis.adaptive_problem, Sampled(mrac, axis.sample_time))


def _robust(axis: Axis) -> OnAxis:
    law = LeastSquares(covariance0=1.0)
    robust = RobustMrac(tau=axis.lag / LAG_SHARE, law=law, saturated_predictor=True)
    return OnAxis(axis.adaptive_problem, Sampled(robust, axis.sample_time))


def _l1(axis: Axis) -> OnAxis:
    gamma = _gain(axis, SAMPLE_ANGLE / axis.sample_time)
    l1 = L1Adaptive(gamma=gamma, filter=_low_pass(axis), saturated_predictor=True, name="L1")
    return OnAxis(axis.adaptive_problem, Sampled(l1, axis.sample_time))


def _piecewise(axis: Axis) -> OnAxis:
    exact = L1PiecewiseConstant(
        sample_time=axis.sample_time, filter=_low_pass(axis), saturated_predictor=True, name="L1 piecewise"
    )
    return OnAxis(axis.linear_problem, exact)


def _as_flown(axis: Axis) -> OnAxis:
    flown = L1PiecewiseConstant(
        sample_time=axis.sample_time,
        filter=_low_pass(axis),
        as_flown=AsFlown(),
        saturated_predictor=True,
        name="L1 piecewise, as flown",
    )
    return OnAxis(axis.linear_problem, flown)


SCHEMES: dict[str, Callable[[Axis], OnAxis]] = {
    "geometric": _geometric,
    "geometric-integral": _integral,
    "adrc": _adrc,
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
        raise InputError(f"--schemes must be of {', '.join(SCHEMES)}, got {show(unknown[0])}")
