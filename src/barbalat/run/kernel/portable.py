"""Signals, outputs and noise of a run, computed outside its kernel, bit for bit the same on every computer.

They use the operation lists of the kernels: the last bits of NumPy's sine, like those of the C library's sine, depend on the
library and on the processor's instructions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from barbalat.lowering.compiled import evaluate, tabulator
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi

LIST_NAMES: dict[np.ufunc, str] = {
    np.sin: "sin", np.cos: "cos", np.tan: "tan", np.exp: "exp", np.log: "log", np.tanh: "tanh", np.arctan: "atan",
    np.power: "pow", np.float_power: "pow",
}  # fmt: skip
"""NumPy's other functions are used directly: signals that use them may differ in the last bits between computers."""


def instants(simulation: Simulation, step: Array | float) -> Array:
    """The times [s] of steps, or of fractions between two steps, in the form that signals receive."""
    return run_times(simulation, simulation.time(step))


def run_times(simulation: Simulation, t: Array) -> Array:
    """Times [s] in the form that a run's signals receive."""
    return t if simulation.fused else t.view(Portable)


def at_instants(function: casadi.Function, simulation: Simulation, *columns: Array) -> list[Array]:
    """The results (rows, K) of a function of columns at K instants of a run."""
    if simulation.fused:
        return [np.asarray(value) for value in function.call(list(columns))]
    return tabulator(function)(*columns)


class Portable(np.ndarray):
    """An array that passes NumPy's elementary functions to ``LIST_NAMES``; arrays computed from it are of the same class."""

    def __array_ufunc__(
        self,
        ufunc: np.ufunc,
        method: Literal["__call__", "reduce", "reduceat", "accumulate", "outer", "at"],
        *inputs: Any,
        out: tuple[Array, ...] = (),
        **options: Any,
    ) -> Any:
        plain = [_plain(value) for value in inputs]
        if ufunc in LIST_NAMES and method == "__call__" and not options and all(value.dtype.kind in "biuf" for value in plain):
            found = evaluate(LIST_NAMES[ufunc], *plain)
        else:
            found = super().__array_ufunc__(ufunc, method, *plain, **options)
        if not out:
            return _portable(found)
        out[0][...] = found
        return out[0]

    def __array_function__(self, *call: Any) -> Any:
        return _portable(super().__array_function__(*call))


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, Portable) else np.asarray(value)


def _portable(found: Any) -> Any:
    return found.view(Portable) if isinstance(found, np.ndarray) else found


NUMBERS_PER_BLOCK = 4
"""Number of random numbers per count of a Philox counter."""


def standard_normal(seed: int, member: int, first: int, rows: int, channels: int) -> Array:
    """Rows ``first`` to ``first + rows - 1`` of a member's standard Gaussian numbers, (rows, channels).

    They are computed by the operation list that pages also use. It does not call a library's logarithm, so its bits are the same
    on every computer.
    """
    return _drawn(seed, member, [(first, rows)], channels)


def standard_normal_at(seed: int, member: int, rows: Array, channels: int) -> Array:
    """A member's standard Gaussian numbers for these rows, in any order, (K, channels)."""
    needed, place = np.unique(rows, return_inverse=True)
    runs = np.split(needed, np.flatnonzero(np.diff(needed) > 1) + 1)
    return _drawn(seed, member, [(int(run[0]), len(run)) for run in runs], channels)[place]


def _drawn(seed: int, member: int, parts: Sequence[tuple[int, int]], channels: int) -> Array:
    """Join the rows of these parts, each given as (first row, rows), in rising order."""
    counts = -(-channels // NUMBERS_PER_BLOCK)  # every row starts at a new count
    generator = np.random.Philox(key=np.array([seed, member], dtype=np.uint64))
    raw, passed = [], 0
    for first, rows in parts:
        generator.advance((first - passed) * counts)
        raw.append(generator.random_raw(rows * counts * NUMBERS_PER_BLOCK).reshape(rows, -1)[:, :channels])
        passed = first + rows
    uniform = ((np.concatenate(raw) >> np.uint64(11)) + 0.5) * 2.0**-53
    return evaluate("ndtri", uniform)
