"""A figure of the paper: the runs that show it, and what its description says of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from barbalat.run.results.result import Result

ADDED_FIGURE = "added"
"""The key of the comparison that is none of the paper's figures."""


@dataclass(frozen=True)
class Check:
    """One thing that a figure's description says, and the number that decides it."""

    statement: str
    holds: bool
    measured: str


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperFigure:
    """A figure of the paper: the run it shows, the variants its description speaks of, and the checks.

    key      "2" ... "5", or ``ADDED_FIGURE``
    results  the shown run first; all by name
    """

    key: str
    title: str
    caption: str
    results: dict[str, Result]
    checks: tuple[Check, ...]

    @property
    def shown(self) -> tuple[Result, ...]:
        """The runs that are drawn: the first one; all of them in the added comparison."""
        results = tuple(self.results.values())
        return results if self.key == ADDED_FIGURE else results[:1]

    @property
    def reproduced(self) -> bool:
        return all(check.holds for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """The JSON contract's block for a figure; the checks and the solver's step stand beside the contract's keys."""
        return {
            "reproduced": self.reproduced,
            "metrics": {name: result.figures for name, result in self.results.items()},
            "checks": [asdict(check) for check in self.checks],
            "numerics": {name: result.numerics for name, result in self.results.items()},
        }
