"""One value of a certificate or one cell of Table 1: its kind, unit, meaning and assumptions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from barbalat.certificates.quantities import Quantity
from barbalat.certificates.theorems import joined

Kind = Literal["guaranteed", "guaranteed for the design", "exact", "estimate", "advice", "does not apply"]
"""How far a value can be trusted.

guaranteed                a bound or a statement that holds for this case; every assumption was checked
guaranteed for the design  the same for the plant, the declared sets and the loop in which every sample arrives and is used, but
                          not for the simulated plant ([truth]), faults or a shell that rejects samples; with a user's own set,
                          it does not cover all of the parameters' ranges
exact                     exact for the linear loop that ``of`` names, and for no other loop
estimate                  computed, without a guarantee
advice                    a fact for orientation, without a claim about the loop
does not apply            nothing is claimed for this case; ``why`` gives the reason
"""
OF_THE_DESIGN: Kind = "guaranteed for the design"
GUARANTEED: tuple[Kind, Kind] = ("guaranteed", OF_THE_DESIGN)
"""The kinds of bounds. Bounds are rounded outward."""


@dataclass(frozen=True)
class Assumption:
    """An assumption of a value; ``broken`` says in a few words how this case contradicts it, and is empty if it does not.

    theorem  for a broken assumption, the theorem that would not need it
    """

    sentence: str
    broken: str = ""
    theorem: str = ""


NUMBERS_ALONE = Assumption("the value follows from the numbers of the case alone")


@dataclass(frozen=True)
class NotApplicable:
    """A placeholder for a result that does not exist for this case, with the reason as part of a sentence."""

    why: str


MOST_SHOWN = 4
"""Largest number of estimates listed in a sentence; for longer lists, the norm is given."""


class RestingEstimates(NamedTuple):
    """Estimates at an equilibrium.

    name    name in results, such as "theta_hat"
    of      symbol of the estimated quantity, such as "theta"
    true    whether they have their true values
    """

    name: str
    of: str
    values: tuple[float, ...]
    true: bool

    @property
    def text(self) -> str:
        """The estimates as an equation."""
        if self.true:
            return f"{self.of}_hat = {self.of}"
        if len(self.values) > MOST_SHOWN:
            return f"|{self.of}_hat| = {math.hypot(*self.values):.4g}"
        return f"{self.of}_hat = [{', '.join(f'{value:.4g}' for value in self.values)}]"


@dataclass(frozen=True)
class PlaceOfRest:
    """The equilibrium at which a margin was computed, given by the constant commands and the estimates."""

    command: tuple[float, ...]
    estimates: tuple[RestingEstimates, ...] = ()

    @property
    def where(self) -> str:
        """The estimates at the equilibrium, as equations. Empty for a controller without estimates."""
        return ", ".join(one.text for one in self.estimates)

    @property
    def text(self) -> str:
        """The commands and the estimates, on one line."""
        of_command = f"r = {', '.join(f'{value:.4g}' for value in self.command)}"
        return ", ".join(filter(None, [of_command, self.where]))

    def as_json(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        found = [one._asdict() | {"values": list(one.values)} for one in self.estimates]
        return {"command": list(self.command), "estimates": found}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A value with its key; ``value`` is ready for JSON, and None if there is no value.

    assumptions  the assumptions as sentences; ``rests_on`` contains those of a guarantee, which were checked for the case
    rest         the equilibrium of the loop; None if the value does not belong to an equilibrium
    theorem      if there is no bound on e, the missing theorem
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
        """Whether anything is claimed for this case."""
        return self.kind != "does not apply"

    @property
    def text(self) -> str:
        """The statement of a cell, or the reason why there is none."""
        return str(self.value) if self.applies else self.why

    def as_json(self) -> dict[str, Any]:
        """All fields in JSON; ``of`` if a linear loop is named, ``rest`` if it is linearised at an equilibrium."""
        document = {"key": self.key, "value": self.value, "kind": self.kind, "unit": self.unit, "meaning": self.meaning}
        document |= {"assumptions": list(self.assumptions)} | ({"of": self.of} if self.of else {})
        document |= {"rest": self.rest.as_json()} if self.rest is not None else {}
        return document | {"why": self.why} | ({"theorem": self.theorem} if self.theorem else {})


def speaks_of_the_motion(entry: Entry) -> bool:
    """Whether an entry is a guarantee about the motion. Norms and conditions are not: they follow from the numbers of the case,
    and runs cannot contradict them."""
    return entry.kind == "guaranteed" and entry.value is not None and entry.rests_on != (NUMBERS_ALONE,)


def of_the_design(entry: Entry, *unmet: Assumption) -> Entry:
    """The entry of a guarantee that does not cover the simulated plant, or whose further assumptions do not hold."""
    sentences = tuple(one.sentence for one in unmet)
    return replace(entry, kind=OF_THE_DESIGN, assumptions=(*entry.assumptions, *sentences), rests_on=(*entry.rests_on, *unmet))


def of_finite_numbers(entry: Entry) -> Entry:
    """The entry, marked as not applicable if its value contains an infinity or a NaN; the result is strict JSON."""
    if _finite(entry.value):
        return entry
    return replace(
        entry, value=None, kind="does not apply", why="with the numbers of this case it exceeds the range of double precision"
    )


def _finite(part: Any) -> bool:
    if isinstance(part, dict):
        return all(map(_finite, part.values()))
    if isinstance(part, (list, tuple)):
        return all(map(_finite, part))
    return not isinstance(part, float) or math.isfinite(part)


def missing(key: str, why: str, assumptions: tuple[Assumption, ...], quantity: Quantity, theorem: str = "") -> Entry:
    """An entry without a value for a specific reason; the assumptions that the case breaks are listed too."""
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
    """A guaranteed value or, if this case violates an assumption, an entry that does not apply, with the reasons."""
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
    """The theorems that would not need the broken assumptions."""
    return joined(assumption.theorem for assumption in assumptions if assumption.broken)
