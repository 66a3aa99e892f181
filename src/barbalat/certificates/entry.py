"""One value of a certificate or one cell of Table 1: data with its kind, its unit, its meaning and what it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from barbalat.certificates.quantities import Quantity
from barbalat.certificates.theorems import joined

Kind = Literal["guaranteed", "guaranteed of the design", "exact", "estimate", "advice", "does not apply"]
"""What a reader may do with a value.

guaranteed                a bound, or a statement, that holds on this case; every assumption was checked on it
guaranteed of the design  the same of the plant and the declared sets alone: it says nothing of the truth, which is simulated
exact                     exact for the linear loop that ``of`` names, and for nothing else
estimate                  computed, without a guarantee
advice                    a fact for orientation that claims nothing of the loop
does not apply            nothing is claimed on this case, and ``why`` says why
"""
OF_THE_DESIGN: Kind = "guaranteed of the design"
GUARANTEED: tuple[Kind, Kind] = ("guaranteed", OF_THE_DESIGN)
"""The kinds of bounds, which are rounded outward."""


@dataclass(frozen=True)
class Assumption:
    """What a value rests on; ``broken`` says in a few words what of this case contradicts it, and is empty where nothing does.

    theorem  where it is broken, the theorem that would do without it
    """

    sentence: str
    broken: str = ""
    theorem: str = ""


NUMBERS_ALONE = Assumption("it follows from the case's numbers alone")


@dataclass(frozen=True)
class NotApplicable:
    """What a function gives in the place of a result that this case does not have, and why, as part of a sentence."""

    why: str


MOST_SHOWN = 4
"""Estimates in a sentence; of more their size is said."""


class RestingEstimates(NamedTuple):
    """Estimates where a loop rests.

    name    in results: "theta_hat"
    of      the symbol of what is estimated: "theta"
    true    whether they are at their true values
    """

    name: str
    of: str
    values: tuple[float, ...]
    true: bool

    @property
    def text(self) -> str:
        """The place of the estimates as an equation."""
        if self.true:
            return f"{self.of}_hat = {self.of}"
        if len(self.values) > MOST_SHOWN:
            return f"|{self.of}_hat| = {math.hypot(*self.values):.4g}"
        return f"{self.of}_hat = [{', '.join(f'{value:.4g}' for value in self.values)}]"


@dataclass(frozen=True)
class PlaceOfRest:
    """Where the loop rests that a margin is of: under which constant commands, and with which estimates."""

    command: tuple[float, ...]
    estimates: tuple[RestingEstimates, ...] = ()

    @property
    def where(self) -> str:
        """The estimates there, as equations; empty of a controller without any."""
        return ", ".join(one.text for one in self.estimates)

    @property
    def text(self) -> str:
        """The commands and the estimates, for a line."""
        of_command = f"r = {', '.join(f'{value:.4g}' for value in self.command)}"
        return ", ".join(filter(None, [of_command, self.where]))

    def as_json(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        found = [one._asdict() | {"values": list(one.values)} for one in self.estimates]
        return {"command": list(self.command), "estimates": found}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A value by its key; ``value`` is ready for JSON, and None where there is none.

    assumptions  what it rests on, as sentences; ``rests_on`` are those of a guarantee, which were checked on the case
    rest         where the loop rests that it is of; None of what belongs to no such place
    theorem      where there is no bound of e, the theorem that is missing
    """

    key: str
    value: Any
    kind: Kind
    quantity: Quantity = field(default=Quantity(""), repr=False)
    assumptions: tuple[str, ...] = ()
    rests_on: tuple[Assumption, ...] = field(default=(), repr=False)
    of: str = ""
    rest: PlaceOfRest | None = None
    why: str = ""
    theorem: str = ""

    @property
    def unit(self) -> str:
        return self.quantity.unit

    @property
    def meaning(self) -> str:
        return self.quantity.meaning

    @property
    def applies(self) -> bool:
        """Whether anything is claimed on this case."""
        return self.kind != "does not apply"

    @property
    def text(self) -> str:
        """A cell's statement, or why there is none."""
        return str(self.value) if self.applies else self.why

    def as_json(self) -> dict[str, Any]:
        """All that is said of it; ``of`` where a linear loop is named, ``rest`` where that is one at a place of rest."""
        document = {"key": self.key, "value": self.value, "kind": self.kind, "unit": self.unit, "meaning": self.meaning}
        document |= {"assumptions": list(self.assumptions)} | ({"of": self.of} if self.of else {})
        document |= {"rest": self.rest.as_json()} if self.rest is not None else {}
        return document | {"why": self.why} | ({"theorem": self.theorem} if self.theorem else {})


def of_the_design(entry: Entry) -> Entry:
    """The entry of a guarantee that says nothing of the truth."""
    return replace(entry, kind=OF_THE_DESIGN)


def of_finite_numbers(entry: Entry) -> Entry:
    """The entry; one whose value holds an infinity or no number at all claims nothing, and is strict JSON."""
    if _finite(entry.value):
        return entry
    return replace(entry, value=None, kind="does not apply", why="with the numbers of this case it is beyond what a double holds")


def _finite(part: Any) -> bool:
    if isinstance(part, dict):
        return all(map(_finite, part.values()))
    if isinstance(part, (list, tuple)):
        return all(map(_finite, part))
    return not isinstance(part, float) or math.isfinite(part)


def missing(key: str, why: str, assumptions: tuple[Assumption, ...], quantity: Quantity, theorem: str = "") -> Entry:
    """A value that there is none of, for a reason of its own; what of its assumptions the case breaks is known all the same."""
    return Entry(
        key=key,
        value=None,
        kind="does not apply",
        quantity=quantity,
        assumptions=tuple(assumption.sentence for assumption in assumptions),
        rests_on=assumptions,
        why=why,
        theorem=joined([theorem, _without(assumptions)]),
    )


def checked(key: str, value: Any, assumptions: tuple[Assumption, ...], quantity: Quantity) -> Entry:
    """A guaranteed value; one that does not apply, with the reasons, where this case breaks an assumption."""
    sentences = tuple(assumption.sentence for assumption in assumptions)
    why = ", ".join(dict.fromkeys(assumption.broken for assumption in assumptions if assumption.broken))
    kind: Kind = "does not apply" if why else "guaranteed"
    return Entry(
        key=key,
        value=value,
        kind=kind,
        quantity=quantity,
        assumptions=sentences,
        rests_on=assumptions,
        why=why,
        theorem=_without(assumptions),
    )


def _without(assumptions: tuple[Assumption, ...]) -> str:
    """The theorems that would do without those that are broken."""
    return joined(assumption.theorem for assumption in assumptions if assumption.broken)
