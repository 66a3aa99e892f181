"""The named parts of a loop's state, of its driving signals and of its outputs; nested named tuples <-> flat vectors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat.protocols import Value

if TYPE_CHECKING:
    import casadi


class Held(NamedTuple):
    """The values that a sampled controller keeps from one sample to the next."""

    u: Value  # the control
    measured: Value  # the sampled measurement: the state, or y
    x_m: Value  # the state of its reference model at the samples
    r: Value  # the sampled command
    started: Value  # 0 before the first sample, then 1
    theta_hat: Value  # the estimates before this step's sample, if there is one
    baseline: Value = np.zeros(0)  # (l,) the states of the baseline
    observer: Value = np.zeros(0)  # (l,) the observer's state
    around: Any = ()  # the shell's stored values, an ``around.Kept``, if there is one


class LoopState(NamedTuple):
    """The loop's state; a part that the loop lacks is an empty tuple or array."""

    x: Value  # (n,) plant
    x_m: Value  # (n,) reference model
    input: Any  # an InputState for each input with limits or unmodelled dynamics
    sensor: Value  # (n,) lagged measurement
    baseline: Value  # (l,) states of a baseline; for a sampled controller they are in ``Held``
    observer: Value  # (l,) state of the observer; for a sampled controller it is in ``Held``
    controller: Any  # the NamedTuple of the scheme
    held: Any  # Held


class Outputs(NamedTuple):
    """The outputs computed and recorded at every solver step."""

    e: Value  # (n,) tracking error x - x_m, or y - y_m with output feedback
    u: Value  # (m,) control
    theta_hat: Value  # (n,) estimates
    x: Value  # (n,)
    x_m: Value  # (n,)
    y: Value  # (1,) measured output, (0,) if the state is measured


class Signals(NamedTuple):
    """The signals that drive the loop at one instant."""

    r: Value  # command, or (q,) commands
    matched: Value  # (0,) or (1,) matched disturbance
    unmatched: Value  # (k,) other disturbances
    at_output: Value  # (0,) or (1,): added to the output
    clock: Value  # (0,) or (1,): t, for a plant that depends on it
    faults: Value  # (f,): faults of the samples
    noise: Value  # (n,) or (0,): standard Gaussian numbers of the measurement
    delayed: Value  # (0,) or (m,): output of the delay at the plant's input


@dataclass(frozen=True)
class SignalSizes:
    """The number of entries of each part of ``Signals`` in a flat vector, in that order.

    commands  None for a single scalar command
    """

    commands: int | None
    matched: int
    unmatched: int
    at_output: int
    clock: int
    noise: int
    delayed: int
    faults: int = 0

    @property
    def timed(self) -> int:
        """Entries that are functions of time: r, the disturbances, t itself, faults."""
        return (self.commands or 1) + self.matched + self.unmatched + self.at_output + self.clock + self.faults

    @property
    def total(self) -> int:
        return self.timed + self.noise + self.delayed

    def named(self, flat: Value) -> Signals:
        """The parts of a flat vector."""
        timed = self.commands or 1, self.matched, self.unmatched, self.at_output, self.clock, self.faults
        sizes = (*timed, self.noise, self.delayed)
        r, *others = (flat[start:end] for start, end in pairwise(accumulate(sizes, initial=0)))
        return Signals(flat[0] if self.commands is None else r, *others)


def flatten(state: Any) -> Value:
    """All arrays of a nested NamedTuple, one after another, row by row."""
    return np.concatenate([leaf if leaf.ndim == 1 else leaf.reshape(-1) for leaf in _leaves(state)])


def map_arrays(function: Any, state: Any) -> Any:
    """A nested NamedTuple with the function applied to every array."""
    if isinstance(state, tuple):
        parts = [map_arrays(function, part) for part in state]
        return _like(state, parts)
    return function(state)


def _like(template: Any, parts: list[Any]) -> Any:
    """A tuple of the template's type, plain or named."""
    return tuple(parts) if type(template) is tuple else type(template)(*parts)


def _leaves(state: Any) -> list[Value]:
    found: list[Value] = []
    for part in state if isinstance(state, tuple) else (state,):
        if isinstance(part, tuple):
            found += _leaves(part)
        else:
            found.append(as_array(part))
    return found


def as_array(value: Value) -> Value:
    """A plain number as an array; arrays of numbers or expressions as they are."""
    return np.asarray(value) if isinstance(value, (int, float)) else value


def together(values: list[Value]) -> Value:
    """Numbers, or expressions, as one array."""
    return np.concatenate([np.reshape(as_array(value), (1,)) for value in values])


def unflatten(template: Any, flat: Value, start: int) -> tuple[Any, int]:
    """The inverse of ``flatten`` for the shapes of ``template``; also return where the next part starts."""
    if isinstance(template, tuple):
        parts = []
        for part in template:
            value, start = unflatten(part, flat, start)
            parts.append(value)
        return _like(template, parts), start
    shape = template.shape
    size = math.prod(shape)
    part = flat[start : start + size]
    return part if len(shape) == 1 else part.reshape(shape), start + size


def symbols(name: str, size: int) -> tuple[casadi.SX, Value]:
    """A column of symbols, as CasADi's matrix and as the array (size,) that equations compute with."""
    import casadi as ca

    matrix = ca.SX.sym(name, size)
    return matrix, ca.array(matrix).reshape(-1)


def column(value: Value) -> casadi.SX:
    """An array of expressions as a CasADi column."""
    import casadi as ca

    return ca.SX(value.reshape(-1))
