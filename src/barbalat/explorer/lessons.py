"""Lessons of a page. A lesson has an initial setting, a goal that the page checks, and the claims that it illustrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from barbalat.papers.claim import Claim
from barbalat.papers.finding import Sentence
from barbalat.papers.ledger import part_with


@dataclass(frozen=True, kw_only=True)
class FigureGoal:
    """A goal for the largest entry of a controller's metric over every step, which is compared with a bound or with a fraction of
    a different metric.

    share_of  None for a bound, "start" for the same metric of the lesson's first run, or the name of a different controller
    """

    controller: str
    figure: str
    relation: Literal["<", ">"]
    value: float
    share_of: str | None = None

    def as_data(self, names: Sequence[str]) -> dict[str, Any]:
        share = self.share_of if self.share_of in (None, "start") else names.index(str(self.share_of))
        index = names.index(self.controller)
        return {"controller": index, "figure": self.figure, "relation": self.relation, "value": self.value, "share": share}


@dataclass(frozen=True, kw_only=True)
class BoundedGoal:
    """The goal that the run of a controller does not diverge."""

    controller: str

    def as_data(self, names: Sequence[str]) -> dict[str, Any]:
        return {"bounded": names.index(self.controller)}


@dataclass(frozen=True, kw_only=True)
class SettingGoal:
    """A goal for a number of the case, which is named by its path."""

    path: str
    relation: Literal["<=", ">="]
    value: float

    def as_data(self, names: Sequence[str]) -> dict[str, Any]:
        return {"path": self.path, "relation": self.relation, "value": self.value}


@dataclass(frozen=True, kw_only=True)
class UnprojectedGoal:
    """The goal that the projection of a controller stays switched off."""

    controller: str

    def as_data(self, names: Sequence[str]) -> dict[str, Any]:
        return {"unprojected": names.index(self.controller)}


class Goal(Protocol):
    """A condition that a page checks."""

    def as_data(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the data for a page of controllers with these names."""
        ...


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """The setup, the text and the checks of a lesson.

    shown       the names of the controllers that are simulated
    numbers     changed numbers, by path
    projection  projection by controller, where it differs from the case
    goal        the goal in words
    checks      the conditions of the goal
    example     numbers that reach the goal from the start; a page shows them on request
    claims      rows of the ledger
    """

    key: str
    title: str
    text: str
    shown: tuple[str, ...]
    goal: str
    checks: tuple[Goal, ...]
    example: Mapping[str, float]
    claims: tuple[str, ...]
    numbers: Mapping[str, float] = field(default_factory=dict)
    projection: Mapping[str, bool] = field(default_factory=dict)

    def as_data(self, names: Sequence[str], claims: Sequence[Claim]) -> dict[str, Any]:
        """Return the data for a page of controllers with these names. ``claims`` are the measured claims, if any."""
        return {
            "key": self.key, "title": self.title, "text": self.text, "goal": self.goal,
            "numbers": dict(self.numbers), "example": dict(self.example),
            "shown": [name in self.shown for name in names],
            "projection": {str(names.index(name)): "on" if on else "off" for name, on in self.projection.items()},
            "checks": [one.as_data(names) for one in self.checks],
            "claims": [_claim(name, claims) for name in self.claims],
        }  # fmt: skip


def _claim(name: str, claims: Sequence[Claim]) -> dict[str, Any]:
    """Return a row of the ledger: its sentence, and its finding if it was measured in the same run."""
    found = [claim for claim in claims if claim.id == name]
    if not found:
        return {"id": name, "statement": _statement(name)}
    (claim,) = found
    return {
        "id": name, "statement": claim.statement, "finding": claim.finding, "headline": claim.headline,
        "place": f"claims.html#claim-{name}",
    }  # fmt: skip


def _statement(name: str) -> str:
    """Return what a row states, or its subject if it tests no sentence of the paper."""
    paper, part = part_with(name)
    said = (one.statement for one in paper.coverage if isinstance(one, Sentence) and one.row == name)
    return next(said, part.names[name])
