"""Exact Jacobians of a closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols
from barbalat.protocols import Value
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi as ca


def signals_at_rest(loop: ClosedLoop, r: float) -> Array:
    """A constant command, no disturbance, no noise."""
    return np.array([r] + [0.0] * (loop.signal_count - 1))


def continuous_twin(loop: ClosedLoop) -> ClosedLoop:
    """The loop with the equations that a sampled controller stands for; any other loop as it is.

    Its flat state is the sampled loop's without what is held, which stands last. A sampled form with states of its own has
    no such twin, nor has one beside a baseline with states.
    """
    if loop.baseline is not None:
        return loop
    twin = replace(loop, equations=loop.continuous)
    same = len(flatten(twin.equations.initial())) == len(flatten(loop.equations.initial()))
    return twin if same else loop


def jacobian_function(loop: ClosedLoop) -> ca.Function:
    """The exact Jacobian of the loop's right-hand side, (size, size), as a CasADi function of (state, signals)."""
    return _jacobian(loop, loop.derivative)


def sampled_jacobian_function(loop: ClosedLoop, *, frozen: bool = False) -> ca.Function:
    """Return the Jacobian of what a sampled controller makes of a state; ``frozen`` estimates and memory keep their values."""
    return _jacobian(loop, partial(loop.sample, freeze=1.0) if frozen else loop.sample)


def right_hand_side(loop: ClosedLoop) -> ca.Function:
    """The loop's derivative as a CasADi function of (state, signals), as its equations write it."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    return ca.Function("rates", [state_column, signal_column], [column(loop.derivative(state, signals))])


def sampled_function(loop: ClosedLoop, *, frozen: bool = False) -> ca.Function:
    """What a sampled controller makes of a state, as a CasADi function of (state, signals); ``frozen`` as above."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    made = loop.sample(state, signals, 1.0 if frozen else None)
    return ca.Function("sample", [state_column, signal_column], [column(made)])


def _jacobian(loop: ClosedLoop, of: Callable[[Value, Value], Value]) -> ca.Function:
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    # sparse, and common parts not sought: for 900 states that takes 40 s, and saves nothing where it is evaluated
    return ca.Function("jacobian", [state_column, signal_column], [ca.jacobian(column(of(state, signals)), state_column)])
