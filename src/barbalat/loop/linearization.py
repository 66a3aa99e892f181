"""Exact Jacobians of a closed loop."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi as ca

    Traced: TypeAlias = tuple[ca.SX, ca.SX, ca.SX]
    """The symbols of a flat state and of its signals, and the expression computed from them."""

LOOPS_KEPT = 8
"""Number of loops whose functions are cached. An analysis requests them several times, and tracing takes far longer than
evaluation."""


def signals_at_rest(loop: ClosedLoop, r: float) -> Array:
    """The signals of a loop at rest: a constant command, without disturbance and noise."""
    return np.array([r] + [0.0] * (loop.signal_count - 1))


def continuous_twin(loop: ClosedLoop) -> ClosedLoop:
    """The loop with the continuous equations behind a sampled controller; any other loop is returned unchanged.

    Its flat state is that of the sampled loop without the held part, which comes last. There is no such continuous loop for a
    sampled form with additional states, an observer, or a baseline with states.
    """
    if loop.baseline is not None or loop.observer is not None:
        return loop
    twin = replace(loop, equations=loop.continuous)
    same = len(flatten(twin.equations.initial())) == len(flatten(loop.equations.initial()))
    return twin if same else loop


@lru_cache(maxsize=LOOPS_KEPT)
def jacobian_function(loop: ClosedLoop) -> ca.Function:
    """The exact Jacobian of the loop's right-hand side, (size, size), as a CasADi function of (state, signals)."""
    return _jacobian(*_rates(loop))


@lru_cache(maxsize=LOOPS_KEPT)
def sampled_jacobian_function(loop: ClosedLoop, *, frozen: bool = False) -> ca.Function:
    """Return the Jacobian of a sampled controller's action on a state; ``frozen`` holds estimates and memory."""
    return _jacobian(*_sample(loop, frozen))


def linear_maps(loop: ClosedLoop, kept: Array, start: Array) -> Array | None:
    """The constant Jacobian of the rates of the ``kept`` states, of u and of what reaches the plant, with respect to these states
    and the signals; the other states are those of ``start``. None if the Jacobian is not constant."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    rates, reaches = loop.derivative(state, signals), loop.undelayed_input(state, signals)
    _, u = loop.derivative_given_input(state, signals, reaches)
    moving = ca.vertcat(*(state_column[int(i)] for i in kept), signal_column)
    slopes = ca.jacobian(ca.vertcat(column(rates)[kept.tolist()], column(u), column(reaches)), moving)
    if ca.depends_on(slopes, moving):
        return None
    return np.array(ca.Function("slopes", [state_column], [slopes])(start))


def right_hand_side(loop: ClosedLoop) -> ca.Function:
    """The loop's derivative as a CasADi function of (state, signals), in the form in which the equations are written."""
    import casadi as ca

    state, signals, rates = _rates(loop)
    return ca.Function("rates", [state, signals], [rates])


def sampled_function(loop: ClosedLoop, *, frozen: bool = False) -> ca.Function:
    """A sampled controller's action on a state, as a CasADi function of (state, signals); ``frozen`` holds estimates and
    memory."""
    import casadi as ca

    state, signals, made = _sample(loop, frozen)
    return ca.Function("sample", [state, signals], [made])


@lru_cache(maxsize=LOOPS_KEPT)
def _rates(loop: ClosedLoop) -> Traced:
    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    return state_column, signal_column, column(loop.derivative(state, signals))


@lru_cache(maxsize=LOOPS_KEPT)
def _sample(loop: ClosedLoop, frozen: bool) -> Traced:
    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    return state_column, signal_column, column(loop.sample(state, signals, 1.0 if frozen else None))


def _jacobian(state: ca.SX, signals: ca.SX, value: ca.SX) -> ca.Function:
    import casadi as ca

    # sparse, without a search for common subexpressions: it would take 40 s for 900 states and would not speed up evaluation
    return ca.Function("jacobian", [state, signals], [ca.jacobian(value, state)])
