"""What fills rows of the ledger: the function that measures them, how long it takes, and the names by which they are found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from barbalat.papers.claim import Claim

LAST = float("inf")
"""The place of rows that declare none: behind all others of their paper, in the order of their files."""


@dataclass(frozen=True)
class Measurement:
    """Some of the ledger's rows. A claim's file lists its own as ``ROWS``, where its paper finds them.

    measure          measures the rows; it is given the paper's shared runs if it ``judges_runs``, and nothing otherwise
    seconds          about how long that takes in a process of its own: the longest is begun first, and the time left is forecast
    names            the rows' names, and what each is about in a few words: a row can be found before it is measured
    place            where the rows stand in the ledger, among those of their paper
    quick            whether ``reproduce --quick`` measures them
    shares           a name in common with others that use the same runs: one process measures them all
    sharper          measures the same rows further than the plain command has time for, which is ``reproduce --full``; no verdict
                     waits for it
    sharper_seconds  about how long that takes
    """

    measure: Callable[..., Claim | list[Claim]]
    seconds: float
    names: Mapping[str, str]
    place: float = LAST
    quick: bool = False
    judges_runs: bool = False
    sharper: Callable[..., Claim | list[Claim]] | None = None
    sharper_seconds: float = 0.0
    shares: str = ""

    def rows(self, *runs: Any, full: bool = False) -> list[Claim]:
        """The rows that this measurement fills, measured now."""
        measure = self.sharper if full and self.sharper else self.measure
        found = measure(*runs)
        return [found] if isinstance(found, Claim) else found

    def duration(self, *, full: bool = False) -> float:
        """About how many seconds the rows take."""
        return self.sharper_seconds if full and self.sharper else self.seconds

    def as_json(self) -> list[dict[str, Any]]:
        """A block for each row, without a verdict: that is measured."""
        return [{"id": name, "about": about, "seconds": self.seconds, "quick": self.quick} for name, about in self.names.items()]
