"""The package's schemes on the loops of vehicles: how each is made from a loop and its parameters, and which schemes a vehicle
offers.

This file contains what is common to all vehicles. The parts specific to a vehicle, above all its linear designs, are in its
folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib.util import find_spec
from typing import Any, NamedTuple, Protocol

import numpy as np

from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.controllers import Adrc, L1Adaptive, L1PiecewiseConstant, LinearFeedback, RobustMrac, Sampled
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError, show

ROBUST = "hinf"
"""The name, for every vehicle, of the scheme whose synthesis requires ``barbalat[robust]``."""
Numbers = Mapping[str, float]
"""The parameters of a scheme, by the names of its knobs, in units of the loop."""


class Loop(Protocol):
    """A loop of a vehicle in the form that schemes expect, x' = A_m x + b (theta'phi(x) + u).

    like              the loop on whose linear model the parameters of the schemes were found
    linear_problem    the problem with phi(x) = x
    adaptive_problem  the problem with phi(x) = (1, x)
    time_unit         a time [s]; bandwidths are multiples of its inverse
    frequency_unit    a frequency [rad/s]; adaptation frequencies are multiples of it
    met               (1 + n,) typical magnitudes of (1, x) in flight, by which adaptive gains are scaled
    known_gain        (n,) feedback gains that a predictor knows; None if A_m already contains them
    theta_hat0        (1 + n,) initial estimates of adaptive schemes; None for zero
    """

    @property
    def like(self) -> str: ...

    @property
    def sample_time(self) -> float: ...

    @property
    def linear_problem(self) -> Problem: ...

    @property
    def adaptive_problem(self) -> Problem: ...

    @property
    def time_unit(self) -> float: ...

    @property
    def frequency_unit(self) -> float: ...

    @property
    def met(self) -> Array: ...

    @property
    def known_gain(self) -> Array | None: ...

    @property
    def theta_hat0(self) -> Array | None: ...


class OnLoop(NamedTuple):
    """A controller and its problem."""

    problem: Problem
    controller: Controller


@dataclass(frozen=True)
class Scheme:
    """A scheme that a vehicle offers.

    make         a function from a loop and the parameters of the scheme to the flown controller
    knobs        the tuned parameters, each with its search range
    counterpart  the name of the corresponding scheme on other vehicles, if it differs
    """

    make: Callable[[Any, Numbers], OnLoop]
    knobs: Mapping[str, tuple[float, float]]
    counterpart: str = ""


def adaptive_gain(loop: Loop, numbers: Numbers) -> Array:
    """Return Gamma (1 + n,), with which each estimate oscillates at the frequency ``adaptation``, by Gamma_i phi_i^2 b'Pb, if its
    regressor has the typical magnitude."""
    known, frequency = loop.adaptive_problem.known, numbers["adaptation"] * loop.frequency_unit
    return np.asarray(frequency**2 / (known.b @ known.P @ known.b * loop.met**2))


def _low_pass(loop: Loop, numbers: Numbers) -> TransferFunction:
    return input_filter(kappa=loop.time_unit / numbers["bandwidth"])


def adrc(loop: Loop, numbers: Numbers) -> OnLoop:
    """Make active disturbance rejection control."""
    controller = Adrc(bandwidth=numbers["bandwidth"] / loop.time_unit, nominal=loop.known_gain, saturated_predictor=True)
    return OnLoop(loop.linear_problem, Sampled(controller, loop.sample_time))


def robust_mrac(loop: Loop, numbers: Numbers) -> OnLoop:
    """Make the robust MRAC with least squares."""
    controller = RobustMrac(
        tau=loop.time_unit / numbers["bandwidth"],
        law=LeastSquares(covariance0=numbers["covariance"]),
        theta_hat0=loop.theta_hat0,
        saturated_predictor=True,
    )
    return OnLoop(loop.adaptive_problem, Sampled(controller, loop.sample_time))


def l1(loop: Loop, numbers: Numbers) -> OnLoop:
    """Make L1 adaptive control with the gradient law."""
    controller = L1Adaptive(
        gamma=adaptive_gain(loop, numbers),
        filter=_low_pass(loop, numbers),
        theta_hat0=loop.theta_hat0,
        saturated_predictor=True,
        name="L1",
    )
    return OnLoop(loop.adaptive_problem, Sampled(controller, loop.sample_time))


def l1_piecewise(loop: Loop, numbers: Numbers) -> OnLoop:
    """Make L1 adaptive control with the piecewise-constant law."""
    return _piecewise(loop, numbers, "L1 piecewise", None)


def l1_piecewise_flown(loop: Loop, numbers: Numbers) -> OnLoop:
    """Make L1 adaptive control with the piecewise-constant law and the predictor that was flown."""
    return _piecewise(loop, numbers, "L1 piecewise, as flown", AsFlown(nominal=loop.known_gain))


def _piecewise(loop: Loop, numbers: Numbers, name: str, as_flown: AsFlown | None) -> OnLoop:
    controller = L1PiecewiseConstant(
        sample_time=loop.sample_time, filter=_low_pass(loop, numbers), as_flown=as_flown, saturated_predictor=True, name=name
    )
    return OnLoop(loop.linear_problem, controller)


def protected(loop: Loop, linear: LinearFeedback, crossover: float) -> OnLoop:
    """Make a sampled linear controller whose integral is protected against windup. The weight of a missing control is the gain of
    the controller at the crossover [rad/s]."""
    K = StateSpace.accept("controller", linear.controller)
    gain = float(abs(K.response(np.array([crossover]))[0]))
    return OnLoop(loop.linear_problem, Sampled(replace(linear, anti_windup=gain), loop.sample_time))


Range = Mapping[str, tuple[float, float]]


def on_every_vehicle(mrac: Callable[[Any, Numbers], OnLoop], *, bandwidth: Range, adaptation: Range) -> dict[str, Scheme]:
    """Return the schemes that all vehicles offer: the MRAC of the vehicle, and the schemes that are made from any loop in the
    same way."""
    return {
        "adrc": Scheme(adrc, bandwidth),
        "mrac": Scheme(mrac, adaptation),
        "robust-mrac": Scheme(robust_mrac, {**bandwidth, "covariance": (1e-3, 1e2)}),
        "l1": Scheme(l1, {**bandwidth, **adaptation}),
        "l1-piecewise": Scheme(l1_piecewise, bandwidth),
        "l1-piecewise-flown": Scheme(l1_piecewise_flown, bandwidth),
    }


def available(offered: Iterable[str]) -> list[str]:
    """Return the schemes whose packages are installed."""
    return [name for name in offered if name != ROBUST or find_spec("slycot") is not None]


def require_offered(names: Sequence[str], offered: Mapping[str, Scheme]) -> None:
    """Raise InputError for a scheme that is not offered. The message suggests a similar one."""
    unknown = [name for name in names if name not in offered]
    if unknown:
        name = unknown[0]
        here = [own for own, scheme in offered.items() if scheme.counterpart == name]
        near = here or get_close_matches(name, offered, n=1)
        meant = f"; here it is {near[0]}" if here else f"; did you mean {near[0]}?" if near else ""
        raise InputError(f"--schemes must be one of {', '.join(offered)}, got {show(name)}{meant}")
