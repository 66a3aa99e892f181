"""What of a run is not the kernel's, the same on every computer: signals and outputs by the lists that kernels have.

NumPy's own sine, like the C library's, depends in its last bits on the library and on the processor's instructions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from barbalat.lowering.compiled import tabulator
from barbalat.lowering.llvm.elementwise import evaluate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi

LIST_NAMES: dict[np.ufunc, str] = {
    np.sin: "sin", np.cos: "cos", np.tan: "tan", np.exp: "exp", np.log: "log", np.tanh: "tanh", np.arctan: "atan",
    np.power: "pow", np.float_power: "pow",
}  # fmt: skip
"""NumPy's other functions stay its own: signals that use them may differ in the last bits from one computer to another."""


def instants(simulation: Simulation, step: Array | float) -> Array:
    """The times [s] of steps, or of fractions between two, as signals are given them."""
    return run_times(simulation, simulation.time(step))


def run_times(simulation: Simulation, t: Array) -> Array:
    """Times [s] as a run's signals are given them."""
    return t if simulation.fused else t.view(Portable)


def at_instants(function: casadi.Function, simulation: Simulation, *columns: Array) -> list[Array]:
    """The results (rows, K) of a function of columns, at K instants of a run."""
    if simulation.fused:
        return [np.asarray(value) for value in function.call(list(columns))]
    return tabulator(function)(*columns)


class Portable(np.ndarray):
    """An array that hands NumPy's elementary functions to ``LIST_NAMES``; arrays that follow from it are such arrays too."""

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
