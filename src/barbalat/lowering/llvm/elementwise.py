"""An elementary function's list at every entry of an array, as machine code of its own."""

from __future__ import annotations

from functools import cache

import numpy as np

from barbalat.lowering.functions import function
from barbalat.lowering.llvm.machine import Kernel, vector_width
from barbalat.lowering.operations import Operation, Program
from barbalat.lowering.shape import LoopShape


def evaluate(name: str, *x: np.ndarray) -> np.ndarray:
    """The function of arrays that broadcast together, with the bits that a kernel's operation of this name has."""
    arguments = np.broadcast_arrays(*(np.asarray(part, dtype=np.float64) for part in x))
    kernel, shape, count = _kernel(name), arguments[0].shape, arguments[0].size
    rows = -(-count // kernel.lanes)
    if not rows:
        return np.empty(shape)
    table = np.zeros((len(arguments), rows * kernel.lanes))  # what is behind the last entry is computed in vain
    table[:, :count] = [part.ravel() for part in arguments]
    given = np.ascontiguousarray(table.reshape(len(arguments), rows, kernel.lanes).transpose(1, 0, 2))
    nothing, out = np.empty(0), np.empty((rows, 1, kernel.lanes))
    kernel(rows, 1, nothing, nothing, nothing, out, None, given)
    return out.reshape(-1)[:count].reshape(shape)


@cache
def _kernel(name: str) -> Kernel:
    """A loop without a state, whose members get a number of their own at every step and hand the function's value out."""
    arguments = function(name).arguments
    operations = [Operation("input", source=(5, i)) for i in range(arguments)] + [Operation(name, tuple(range(arguments)))]
    program = Program(tuple(operations), ((), (arguments,), ()))
    return Kernel(program, LoopShape(0, 1, 0, 0, noise=arguments), (0.0,), 2 * vector_width())
