"""Translates an operation list to a WebAssembly module with the kernel's time loop, from the kernel's IR for one member."""

from __future__ import annotations

from barbalat.lowering.llvm import ir
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import ENTRY, TAPS_PER_CHANNEL, LoopShape
from barbalat.lowering.wasm.module import module

ALIGNMENTS = 256
"""Bytes that the stack frames of two functions may lose by alignment to 64."""


def loop(
    step: Program, shape: LoopShape, resets: tuple[float, ...], sample: Program | None = None, watch: Program | None = None
) -> bytes:
    """A module whose function ``barbalat_loop`` has the arguments that ``llvm.ir.loop`` describes, in that order.

    Addresses in the module's memory have 32 bits, counts 64 bits. Raises ValueError for a list with fused multiply-adds, which
    WebAssembly lacks.
    """
    given = [program for program in (step, sample, watch) if program is not None]
    if any(op.name in ("fma", "fnma") for program in given for op in program.operations):
        raise ValueError("WebAssembly has no fused multiply-add: optimize(program, fused=False) makes a list without them")
    inputs = shape.states + shape.accumulators + shape.parameters + shape.signals + shape.delayed * TAPS_PER_CHANNEL + shape.noise
    stack_bytes = 8 * inputs + ALIGNMENTS  # a long monitored quantity becomes a function of the values that it reads
    return module(ir.loop(step, shape, resets, 1, sample, watch), ENTRY, stack_bytes=stack_bytes)
