"""What a measured statement is: of a figure (Check), of the paper's text (Claim)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from barbalat.result import Result

Verdict = Literal["confirmed", "confirmed with conditions", "not confirmed", "erratum", "pending"]
"""The contract's words, and "pending" for a statement about a scheme that is not in yet."""


def verdict(*, holds: bool, conditional: bool = False) -> Verdict:
    """The verdict on a statement that was measured to hold, to hold under a condition that the paper does not name, or not."""
    if not holds:
        return "not confirmed"
    return "confirmed with conditions" if conditional else "confirmed"


@dataclass(frozen=True)
class Check:
    """One thing that a figure's description says, and the number that decides it."""

    statement: str
    holds: bool
    measured: str


@dataclass(frozen=True)
class Claim:
    """A statement of the paper in our words, with a verdict, the number behind it and how it was obtained."""

    id: str
    where: str
    statement: str
    verdict: Verdict
    measured: str
    how: str

    def as_json(self) -> dict[str, str]:
        """The JSON contract's block for a claim."""
        return asdict(self)


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperFigure:
    """A figure of the paper: the run it shows, the variants its description speaks of, and the checks.

    key      "2" ... "5", or "added"
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
        return results if self.key == "added" else results[:1]

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
