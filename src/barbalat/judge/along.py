"""The judge for signals that were recorded elsewhere, in flight or on a test bench, and not by a loop of this package."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from barbalat.judge.memory import Begins, Memory, Sample
from barbalat.loop.packing import column, symbols
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.validate import Array


def along(memory: Memory, samples: Sample, ranges: Array, *, start: Array | None = None, renewed: bool = False) -> Array:
    """Return the memory (rows,) after K samples, each entry of which is (K, size).

    start    the memory before these samples; by default its initial value
    renewed  whether the parts for the tail begin again with these samples
    """
    sizes = tuple(np.asarray(part).reshape(len(samples.y), -1).shape[1] for part in samples)
    kernel = _kernel(memory, sizes, tuple(np.asarray(ranges, dtype=float).tolist()))
    begins = np.array(memory.begins)
    state = begins.copy() if start is None else start.copy()
    if renewed:
        anew = memory.renewed(Begins.TAIL)
        state[anew] = begins[anew]
    rows = np.ascontiguousarray(np.column_stack([np.asarray(part).reshape(len(samples.y), -1) for part in samples]), dtype=float)
    kernel(1, len(rows), state, np.empty(0), rows, np.empty(len(begins)))
    return state


@lru_cache(maxsize=16)  # all flights of a vehicle share the kernel
def _kernel(memory: Memory, sizes: tuple[int, ...], ranges: tuple[float, ...]) -> Kernel:
    """Return the judge's operations as machine code, for rows that contain the parts of a sample with these sizes."""
    import casadi as ca

    row_column, row = symbols("row", sum(sizes))
    memory_column, old = symbols("memory", len(memory.begins))
    ends = np.cumsum(sizes).tolist()
    parts = [row[end - size : end] for end, size in zip(ends, sizes, strict=True)]
    sample = Sample(*parts)._replace(steps=parts[-1][0])
    nothing = ca.SX(0, 1)
    new = column(memory.update(old, sample, np.array(ranges)))
    step = ca.Function("judge", [memory_column, nothing, nothing, row_column], [new, nothing, nothing], {"cse": True})
    return Kernel(optimize(read(step), fused=False), LoopShape(len(memory.begins), 0, 0, sum(sizes)), (), lanes=1)
