"""CasADi functions and the lists of elementary functions as machine code that Python calls for single points or whole arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from barbalat.lowering.functions import function
from barbalat.lowering.llvm.machine import Kernel, vector_width
from barbalat.lowering.operations import Operation, Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape

if TYPE_CHECKING:
    import casadi


def evaluate(name: str, *x: np.ndarray) -> np.ndarray:
    """The function applied to arrays that broadcast together; it agrees bit for bit with a kernel's operation of this name."""
    arguments = np.broadcast_arrays(*(np.asarray(part, dtype=np.float64) for part in x))
    kernel, shape, count = _elementary_kernel(name), arguments[0].shape, arguments[0].size
    rows = -(-count // kernel.lanes)
    if not rows:
        return np.empty(shape)
    table = np.zeros((len(arguments), rows * kernel.lanes))  # results after the last entry are discarded
    table[:, :count] = [part.ravel() for part in arguments]
    given = np.ascontiguousarray(table.reshape(len(arguments), rows, kernel.lanes).transpose(1, 0, 2))
    nothing, out = np.empty(0), np.empty((rows, 1, kernel.lanes))
    kernel(rows, 1, nothing, nothing, nothing, out, None, given)
    return out.reshape(-1)[:count].reshape(shape)


@cache
def _elementary_kernel(name: str) -> Kernel:
    """A loop without a state: its members receive a number at every step and return the function's value."""
    arguments = function(name).arguments
    operations = [Operation("input", source=(5, i)) for i in range(arguments)] + [Operation(name, tuple(range(arguments)))]
    program = Program(tuple(operations), ((), (arguments,), ()))
    return Kernel(program, LoopShape(0, 1, 0, 0, noise=arguments), (0.0,), 2 * vector_width())


class Compiled:
    """``f(x, s)`` of an SX function of a column x (n,) and a column s (k,) with one dense result; not thread-safe.

    A call takes about 2 us, whereas CasADi's call takes about 50 us. It is one step of the time loop, which leaves the state
    unchanged and returns the results as its accumulators.
    """

    def __init__(self, function: casadi.Function) -> None:
        import casadi as ca

        x, s = (ca.SX.sym(name, function.size1_in(i)) for i, name in enumerate(("x", "s")))
        result = function(x, s)
        if not result.is_dense():
            raise ValueError(f"a function with a dense result is needed, got {result.nnz()} of {result.numel()} entries")
        self.shape: tuple[int, int] = result.shape
        nothing, n, m = ca.SX(0, 1), x.numel(), result.numel()
        step = ca.Function("step", [x, nothing, nothing, s, nothing, nothing], [x, ca.vec(result), nothing], {"cse": True})
        kernel = Kernel(optimize(read(step)), LoopShape(n, m, 0, s.numel()), (0.0,) * m, lanes=1)
        self._x, self._s, out = np.empty(n), np.empty(s.numel()), np.empty(n + m)
        self._run = kernel.bound(1, 1, self._x, np.empty(0), self._s, out)
        self._result = out[n:]

    def __call__(self, x: np.ndarray, s: np.ndarray | float) -> np.ndarray:
        """The result as a new array: (rows,), or (rows, columns) for a matrix."""
        self._x[:], self._s[:] = x, s
        self._run()
        values = self._result.copy()
        return values if self.shape[1] == 1 else values.reshape(self.shape, order="F")


Tabulator = Callable[..., list[np.ndarray]]
"""The results (rows, K) from columns (n, K), one array for each argument of the function."""


def tabulator(function: casadi.Function) -> Tabulator:
    """An SX function that is applied to K columns at once, by its operation list, without fused multiply-adds.

    CasADi's evaluation uses functions of the C library, whose last bits differ between systems.
    """
    import casadi as ca

    sizes = [function.size1_in(i) for i in range(function.n_in())]
    together, ends = ca.SX.sym("together", sum(sizes)), np.cumsum(sizes).tolist()
    results = function.call([together[end - size : end] for end, size in zip(ends, sizes, strict=True)])
    flat, nothing = ca.densify(ca.vertcat(*results)), ca.SX(0, 1)
    step = ca.Function("step", [nothing, nothing, nothing, together], [nothing, flat, nothing], {"cse": True})
    rows, places = flat.numel(), np.cumsum([result.numel() for result in results])[:-1]
    kernel = Kernel(optimize(read(step), fused=False), LoopShape(0, rows, 0, together.numel()), (0.0,) * rows, lanes=1)

    def tabulated(*columns: np.ndarray) -> list[np.ndarray]:
        count = columns[0].shape[1]
        out = np.empty((count, rows))
        if count:
            kernel(count, 1, np.empty(0), np.empty(0), np.ascontiguousarray(np.vstack(columns).T), out)
        return np.split(out.T, places)

    return tabulated
