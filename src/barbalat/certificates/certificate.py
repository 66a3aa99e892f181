"""A certificate: entries and further findings. The file of a scheme writes it with ``Draft``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any

from barbalat.certificates.entry import (
    OF_THE_DESIGN,
    Assumption,
    Entry,
    Kind,
    NotApplicable,
    PlaceOfRest,
    checked,
    missing,
    of_finite_numbers,
)
from barbalat.certificates.picture import TITLE, MarginLoop, figure_of
from barbalat.certificates.quantities import QUANTITIES, Quantity
from barbalat.certificates.rows import CertificateRow, down, rows_of, up
from barbalat.validate import InputError, Named

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Simulated:
    """The simulation that accompanies a certificate, and its result.

    run      the run and the judge's verdict on it, as a sentence
    verdict  the verdict in the form of ``run --json``
    margins  the margins that the run tolerates, in words
    """

    run: str
    verdict: Mapping[str, Any]
    margins: str

    def as_json(self) -> dict[str, Any]:
        return {"run": self.run, "verdict": dict(self.verdict), "margins": self.margins}


@dataclass(frozen=True, repr=False)
class Certificate:
    """One controller's certificate.

    entries  every value with its kind, its meaning and its assumptions; a key without a meaning for the scheme is absent
    notes    further findings, as sentences
    loops    the linear loops to which margins among the entries belong
    failure  why there is no certificate, if its computation fails
    simulated  the simulation made on request; None without one
    """

    entries: tuple[Entry, ...] = ()
    notes: tuple[str, ...] = ()
    loops: tuple[MarginLoop, ...] = field(default=(), compare=False)
    failure: str = ""
    simulated: Simulated | None = None

    @classmethod
    def failed(cls, why: str) -> Certificate:
        """Return the certificate of a controller that can't be certified, with the reason as its finding."""
        return cls(notes=(f"no certificate: {why}",), failure=why)

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", tuple(map(of_finite_numbers, self.entries)))

    def __repr__(self) -> str:
        return f"<Certificate: {len(self.guaranteed)} of {len(self.entries)} values guaranteed, {self.in_brief}>"

    @property
    def in_brief(self) -> str:
        """Whether the condition holds, and the first values, in a few words on one line."""
        condition = self.values.get("condition") or {}
        holds = [f"condition {'holds' if condition['holds'] else 'does not hold'}"] if "holds" in condition else []
        bound = self.entry("error_bound")
        shown = {
            "error_bound": (f"{'' if bound is None else bound.kind} |e| <= {{}}", up),
            "delay_margin": ("delay margin {} s", down),
            "gamma_max": ("gamma up to {}", down),
        }
        numbers = {key: self.values.get(key) for key in shown}
        said = [shown[key][0].format(shown[key][1](value)) for key, value in numbers.items() if isinstance(value, float)]
        return (
            ", ".join([*holds, *said])
            or (self.failure and "no certificate")
            or "no condition, bound, margin or gain limit to show"
        )

    def _repr_html_(self) -> str:
        """For notebooks: every value with its kind and its meaning, and the picture."""
        from barbalat.pictures.plotted import image_of

        rows = "".join(
            f'<tr><th scope="row">{escape(name)}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in cells)}</tr>'
            for name, *cells in self.rows
        )
        head = "".join(f'<th scope="col">{text}</th>' for text in ("quantity", "value", "meaning", "kind"))
        table = f"<table><tr>{head}</tr>{rows}</table><small>{'<br>'.join(map(escape, self.findings))}</small>"
        return table + (image_of(figure_of(self.loops, TITLE, shown=False), TITLE) if self.loops else "")

    def plot(self, *, narrow: bool = False) -> Figure:
        """Bode, Nyquist and sensitivity plots of the loops whose margins are given, as a Matplotlib figure."""
        if not self.loops:
            why = f": {self.notes[0]}" if self.notes else "; its findings give the reason"
            raise InputError(f"this certificate has no linear loop with margins to plot{why}")
        return figure_of(self.loops, TITLE, narrow=narrow)

    def entry(self, key: str) -> Entry | None:
        """The entry of a key; None if the scheme has no such entry."""
        return next((entry for entry in self.entries if entry.key == key), None)

    @property
    def values(self) -> dict[str, Any]:
        """The values that are claimed for this case, by the keys of the JSON contract."""
        absent = {entry.key: f"does not apply to this case: {entry.why}" for entry in self.entries if not entry.applies}
        return Named.of("value", {entry.key: entry.value for entry in self.entries if entry.applies}, absent)

    @property
    def rows(self) -> list[CertificateRow]:
        """All entries in order, as text."""
        return [row for entry in self.entries for row in rows_of(entry)]

    @property
    def guaranteed(self) -> frozenset[str]:
        """The keys whose value is a bound that holds for this case."""
        return frozenset(entry.key for entry in self.entries if entry.kind == "guaranteed" and entry.value is not None)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """The assumptions of the values that apply, as sentences."""
        return tuple(dict.fromkeys(s for entry in self.entries if entry.applies for s in entry.assumptions))

    @property
    def findings(self) -> tuple[str, ...]:
        """The values that don't apply with the reasons, then the notes, as sentences."""
        keys: dict[str, list[str]] = {}
        for entry in self.entries:
            if not entry.applies:
                keys.setdefault(entry.why, []).append(entry.key)
        return (*(f"{', '.join(of)}: does not apply ({why})" for why, of in keys.items()), *self.notes)

    def as_json(self) -> dict[str, Any]:
        """The JSON contract's block for a controller: flat keys for values that apply and do not hold for the design only, and
        all entries."""
        of_design = {entry.key for entry in self.entries if entry.kind == OF_THE_DESIGN}
        document = {key: value for key, value in self.values.items() if value is not None and key not in of_design}
        document["guaranteed"] = sorted(self.guaranteed)
        document["assumptions"] = list(self.assumptions)
        if self.findings:
            document["findings"] = list(self.findings)
        document["entries"] = [entry.as_json() for entry in self.entries]
        return document if self.simulated is None else document | {"simulated": self.simulated.as_json()}

    def with_simulated(self, simulated: Simulated) -> Certificate:
        """Return a copy that includes the results of simulations."""
        return replace(self, simulated=simulated)

    def with_entries(self, entries: tuple[Entry, ...], *notes: str) -> Certificate:
        """Return a copy with different entries and further notes."""
        return replace(self, entries=entries, notes=(*self.notes, *notes))


NO_VALUE: dict[Kind, str] = {
    "exact": "unlimited: no value destabilises the loop; for a gain, no factor up to 1e6",
    "estimate": "none is known",
    "advice": "none",
}
"""The reason why there is no value, which follows from the type of the error."""


def reason(error: Exception) -> str:
    """Why something could not be computed, as part of a sentence."""
    if isinstance(error, InputError):
        return str(error)
    said = str(error.args[-1]) if error.args else ""
    return f"its computation fails with the numbers of this case ({': '.join(filter(None, (type(error).__name__, said)))})"


@dataclass(eq=False)
class Draft:
    """A certificate that is being written: entries in their final order, and notes.

    own  meanings of the keys that only this scheme has
    """

    entries: dict[str, Entry] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    loops: list[MarginLoop] = field(default_factory=list)
    own: Mapping[str, Quantity] = field(default_factory=dict)

    def __getitem__(self, key: str) -> Any:
        """The value of a key, whether or not it applies to this case."""
        return self.entries[key].value

    def get(self, key: str) -> Any:
        """The value of a key, or None if there is none."""
        return self[key] if key in self.entries else None

    def note(self, sentence: str) -> None:
        """Add a finding as a sentence; repeated sentences are dropped."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def guarantee(self, key: str, value: Any, *assumptions: Assumption) -> None:
        """Add a bound, which does not apply if this case violates an assumption; ``NUMBERS_ALONE`` is an assumption too."""
        if not assumptions:
            raise TypeError(f"{key} is guaranteed without assumptions: name those on which it depends")
        self.entries[key] = checked(key, value, assumptions, self._quantity(key))

    def exact(self, values: dict[str, Any], of: str, *assumptions: str, rest: PlaceOfRest | None = None) -> None:
        """Add values that are exact for the named linear loop; ``rest`` is the equilibrium of the linearisation, if any."""
        self._add(values, "exact", assumptions, of, rest)

    def estimate(self, values: dict[str, Any], *assumptions: str, of: str = "", rest: PlaceOfRest | None = None) -> None:
        """Add values without a guarantee; ``of`` names their linear loop."""
        self._add(values, "estimate", assumptions, of, rest)

    def advise(self, values: dict[str, Any], *assumptions: str) -> None:
        """Add facts for orientation without a guarantee."""
        self._add(values, "advice", assumptions)

    def missing(self, key: str, why: str, *assumptions: Assumption, theorem: str = "") -> None:
        """Add the reason why this case lacks a value of the scheme; the value would need the ``assumptions``.

        ``theorem`` names the theorem that would give the value.
        """
        self.entries[key] = missing(key, why, assumptions, self._quantity(key), theorem)

    def all_missing(self, keys: Iterable[str], why: str, *, theorem: str = "") -> None:
        """Add several values that are missing for the same reason."""
        for key in keys:
            self.missing(key, why, theorem=theorem)

    @contextmanager
    def part(self, key: str) -> Iterator[None]:
        """A part on which no other part depends. If its computation fails for this case, only ``key`` is missing."""
        try:
            yield
        except InputError:
            raise
        except (ArithmeticError, ValueError) as error:
            self.missing(key, reason(error))
            self.note(f"{key}: {reason(error)}")

    def finish(self) -> Certificate:
        """The certificate with everything that was added so far."""
        return Certificate(tuple(self.entries.values()), tuple(self.notes), tuple(self.loops))

    def _add(
        self, values: dict[str, Any], kind: Kind, assumptions: tuple[str, ...], of: str = "", rest: PlaceOfRest | None = None
    ) -> None:
        for key, value in values.items():
            if value is None and key == "unlimited":
                continue
            if isinstance(value, NotApplicable):
                self.missing(key, value.why)
                continue
            why = NO_VALUE[kind] if value is None else ""
            self.entries[key] = Entry(
                key=key, value=value, kind=kind, quantity=self._quantity(key), assumptions=assumptions, of=of, rest=rest, why=why
            )

    def _quantity(self, key: str) -> Quantity:
        return self.own[key] if key in self.own else QUANTITIES[key]
