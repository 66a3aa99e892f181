"""A certificate: entries, and what was found besides; ``Draft`` is how a scheme's file writes one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from barbalat.certificates.entry import Assumption, Entry, Kind, NotApplicable, checked, of_finite_numbers
from barbalat.certificates.quantities import QUANTITIES, Quantity
from barbalat.validate import InputError


@dataclass(frozen=True)
class Certificate:
    """One controller's certificate.

    entries  every value with its kind, what it means and what it rests on; a key that has no meaning for the scheme is absent
    notes    what else was found, as sentences
    """

    entries: tuple[Entry, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", tuple(map(of_finite_numbers, self.entries)))

    def entry(self, key: str) -> Entry | None:
        """The entry of a key; None where the scheme has none."""
        return next((entry for entry in self.entries if entry.key == key), None)

    @property
    def values(self) -> dict[str, Any]:
        """The values that are claimed on this case, by the contract's keys."""
        return {entry.key: entry.value for entry in self.entries if entry.applies}

    @property
    def guaranteed(self) -> frozenset[str]:
        """The keys whose value is a bound that holds on this case; all others are not."""
        return frozenset(entry.key for entry in self.entries if entry.kind == "guaranteed" and entry.value is not None)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What the values that apply rest on, as sentences."""
        return tuple(dict.fromkeys(s for entry in self.entries if entry.applies for s in entry.assumptions))

    @property
    def findings(self) -> tuple[str, ...]:
        """What does not apply and why, then the notes, as sentences."""
        keys: dict[str, list[str]] = {}
        for entry in self.entries:
            if not entry.applies:
                keys.setdefault(entry.why, []).append(entry.key)
        return (*(f"{', '.join(of)}: does not apply ({why})" for why, of in keys.items()), *self.notes)

    def as_json(self) -> dict[str, Any]:
        """The JSON contract's block for a controller: flat keys for what applies, and all entries."""
        document = {key: value for key, value in self.values.items() if value is not None}
        document["guaranteed"] = sorted(self.guaranteed)
        document["assumptions"] = list(self.assumptions)
        if self.findings:
            document["findings"] = list(self.findings)
        document["entries"] = [entry.as_json() for entry in self.entries]
        return document

    def with_entries(self, entries: tuple[Entry, ...], *notes: str) -> Certificate:
        """The same with other entries and further notes."""
        return replace(self, entries=entries, notes=(*self.notes, *notes))


NUMBERS_ALONE = Assumption("it follows from the case's numbers alone")
NO_VALUE: dict[Kind, str] = {"exact": "unlimited: nothing exhausts it", "estimate": "none is known", "advice": "none"}
"""Why there is no value, by kind."""


def reason(error: Exception) -> str:
    """Why something could not be computed, as part of a sentence."""
    if isinstance(error, InputError):
        return str(error)
    said = str(error.args[-1]) if error.args else ""
    return f"its computation fails on the numbers of this case ({': '.join(filter(None, (type(error).__name__, said)))})"


@dataclass(eq=False)
class Draft:
    """A certificate that is being written: entries in the order in which they come, and notes.

    own  what the keys mean that are this scheme's alone
    """

    entries: dict[str, Entry] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    own: Mapping[str, Quantity] = field(default_factory=dict)

    def __getitem__(self, key: str) -> Any:
        """The value that stands under a key, whether it applies on this case or not."""
        return self.entries[key].value

    def get(self, key: str) -> Any:
        """The same, or None where nothing stands there."""
        return self[key] if key in self.entries else None

    def note(self, sentence: str) -> None:
        """Something found, as a sentence; said once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def guarantee(self, key: str, value: Any, *assumptions: Assumption) -> None:
        """A bound; it becomes one that does not apply where this case breaks an assumption."""
        self.entries[key] = checked(key, value, assumptions or (NUMBERS_ALONE,), self._quantity(key))

    def exact(self, values: dict[str, Any], of: str, *assumptions: str) -> None:
        """Values that are exact for the linear loop named."""
        self._add(values, "exact", assumptions, of)

    def estimate(self, values: dict[str, Any], *assumptions: str) -> None:
        """Values without a guarantee."""
        self._add(values, "estimate", assumptions)

    def advise(self, values: dict[str, Any], *assumptions: str) -> None:
        """Facts for orientation."""
        self._add(values, "advice", assumptions)

    def missing(self, key: str, why: str) -> None:
        """A value that the scheme would have, and that this case has not."""
        self.entries[key] = Entry(key=key, value=None, kind="does not apply", quantity=self._quantity(key), why=why)

    def finish(self) -> Certificate:
        """The certificate."""
        return Certificate(tuple(self.entries.values()), tuple(self.notes))

    def _add(self, values: dict[str, Any], kind: Kind, assumptions: tuple[str, ...], of: str = "") -> None:
        for key, value in values.items():
            if value is None and key == "unlimited":
                continue
            if isinstance(value, NotApplicable):
                self.missing(key, value.why)
                continue
            why = NO_VALUE[kind] if value is None else ""
            self.entries[key] = Entry(
                key=key, value=value, kind=kind, quantity=self._quantity(key), assumptions=assumptions, of=of, why=why
            )

    def _quantity(self, key: str) -> Quantity:
        return self.own[key] if key in self.own else QUANTITIES[key]
