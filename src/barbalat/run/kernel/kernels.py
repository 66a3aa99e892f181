"""The kernels that are kept: each made quickly at first, and optimised once its runs are long enough in all for it to pay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from barbalat.lowering.llvm.external_function import ExternalFunction
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import LoopShape

STEPS_WORTH_OPTIMISING = 250_000
"""Of one kernel in all its runs. Optimised code of Section V's loops takes 6 ms longer to make and 24 ns less for a step; of an
operation of loops with 16,000 and 34,000 of them 0.15 ms and 0.45 ns: the same number of steps within a third for any loop."""


@dataclass(eq=False)
class CompiledLoop:
    """A loop's code as it is made at first, and optimised once its runs have been long enough in all."""

    make: Callable[[bool], Kernel]
    steps: float = 0.0
    kernel: Kernel | None = None
    optimised: bool = False

    def for_steps(self, steps: float) -> Kernel:
        self.steps += steps
        worth = self.steps >= STEPS_WORTH_OPTIMISING
        if self.kernel is None or (worth and not self.optimised):
            self.kernel, self.optimised = self.make(not worth), worth
        return self.kernel


@lru_cache(maxsize=64)
def compiled(
    program: Program,
    shape: LoopShape,
    resets: tuple[float, ...],
    lanes: int,
    sample: Program | None,
    watch: Program | None,
    outside: ExternalFunction | None,
) -> CompiledLoop:
    """What is kept of a loop's code, the same for the same lists; of what was used least lately nothing."""

    def make(quickly: bool) -> Kernel:
        return Kernel(program, shape, resets, lanes, sample, watch, outside=outside, quickly=quickly)

    return CompiledLoop(make)
