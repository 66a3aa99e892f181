"""A compiled function from elsewhere that takes a hand in a sampled part: software in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ExternalFunction:
    """``void function(double *numbers, int64_t step)`` at an address of this process, called at every sample.

    given  rows of the state as the list makes them at this sample: they stand first in ``numbers``
    kept   rows whose old values follow there, and whose new values the function leaves in their places
    """

    address: int
    given: tuple[int, ...]
    kept: tuple[int, ...]

    @property
    def room(self) -> str:
        """On the loop's stack, which is reserved once."""
        return f"  %outside = alloca [{len(self.given) + len(self.kept)} x double], align 8"

    def call(self, sampled: Sequence[str]) -> tuple[list[str], list[str]]:
        """Lines of LLVM IR, and the names of the state's values afterwards: ``sampled``, but for those that are kept."""
        numbers = [*(sampled[row] for row in self.given), *(f"%x{row}.held" for row in self.kept)]
        lines, after = [], list(sampled)
        for i, value in enumerate(numbers):
            lines.append(f"  %outside.{i} = getelementptr double, ptr %outside, i64 {i}")
            lines.append(f"  store double {value}, ptr %outside.{i}, align 8")
        lines.append(f"  call void inttoptr (i64 {self.address} to ptr)(ptr %outside, i64 %now)")
        for i, row in enumerate(self.kept, start=len(self.given)):
            lines.append(f"  %outside.new{i} = load double, ptr %outside.{i}, align 8")
            after[row] = f"%outside.new{i}"
        return lines, after
