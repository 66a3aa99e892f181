"""Campaigns of flights that are stored: documents of ``barbalat fly NAME --dispersions N --json``, asked questions.

``flown-NAME.json`` is such a document, its blanks left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from itertools import combinations, product
from typing import Any

from barbalat.sweeps.evidence import Share, beyond_chance

LINEAR_SCHEMES = ("LQR", "LQR with PI", "H-infinity", "Geometric", "Geometric, integral", "ADRC")
ADAPTIVE_SCHEMES = ("MRAC", "Robust MRAC", "L1", "L1 piecewise", "L1 piecewise, as flown")
"""As their authors call them; L1 with the piecewise-constant law is a linear controller by the row ``l1-piecewise-is-lti``."""


PREFIX, SUFFIX = "flown-", ".json"
"""Of a document's name."""
ERROR, LOSS = "less_error_than", "kept_where_lost"
"""Paired shares of the document: on how many draws the error was smaller, and on how many of those that one of both lost the
other was lost."""


@dataclass(frozen=True)
class Flights:
    """A stored document, asked questions."""

    document: dict[str, Any]

    @classmethod
    def stored(cls, name: str) -> Flights:
        """Return what is stored of a campaign of flights."""
        text = resources.files(__package__).joinpath(f"{PREFIX}{name}{SUFFIX}").read_text(encoding="utf-8")
        return cls(json.loads(text))

    @property
    def name(self) -> str:
        return str(self.document["flight"])

    @cached_property
    def linear(self) -> tuple[str, ...]:
        return tuple(one for one in LINEAR_SCHEMES if one in self.document["lost"])

    @cached_property
    def adaptive(self) -> tuple[str, ...]:
        return tuple(one for one in ADAPTIVE_SCHEMES if one in self.document["lost"])

    @property
    def unit(self) -> str:
        """The unit of the tracking error."""
        return str(self.document["units"]["rms_e"])

    @cached_property
    def members(self) -> int:
        return int(self.document["members"])

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """The failures that some controller survives."""
        every = self.document["failures"]
        return tuple(
            one for one, found in every.items() if any(flown["lost"]["count"] < self.members for flown in found.values())
        )

    def lost(self, controller: str, failure: str) -> int:
        return int(self.document["failures"][failure][controller]["lost"]["count"])

    def error(self, controller: str, failure: str) -> float | None:
        value = self.document["failures"][failure][controller]["rms_e"]["median"]
        return None if value is None else float(value)

    @cached_property
    def shares(self) -> dict[tuple[str, str, str, str], Share]:
        """The shares of every two controllers through every failure by every criterion, where some draw decides."""
        found = {}
        for failure, by_controller in self.document["failures"].items():
            for (one, other), by in product(combinations(by_controller, 2), (ERROR, LOSS)):
                share = by_controller[one][by][other]
                if share is not None:
                    found[failure, one, other, by] = Share(count=share["count"], judged=share["judged"])
        return found

    @cached_property
    def signs(self) -> dict[tuple[str, str, str, str], int]:
        """The comparisons beyond chance, all of them judged together."""
        return beyond_chance(self.shares)

    def compared(self, one: str, other: str, failure: str, by: str = ERROR) -> int:
        """1 where ``one`` is better than ``other`` beyond chance on the same draws, -1 where it is worse."""
        return self.signs.get((failure, one, other, by), 0) - self.signs.get((failure, other, one, by), 0)

    def over_all(self, one: str, others: Sequence[str], by: str) -> Iterator[str]:
        """The failures through which it is better than each of these, beyond chance, a lost flight having the largest error."""
        for failure in self.failures:
            if all(self.compared(one, other, failure, by) == 1 for other in others if other != one):
                yield failure


def stored() -> tuple[str, ...]:
    """Names of the flights whose campaigns are stored."""
    files = (one.name for one in resources.files(__package__).iterdir())
    return tuple(sorted(name[len(PREFIX) : -len(SUFFIX)] for name in files if name.startswith(PREFIX) and name.endswith(SUFFIX)))
