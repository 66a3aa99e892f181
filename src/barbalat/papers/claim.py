"""What a measured sentence is: with its finding (Claim), over a plane of settings (Map), over one of them (Chart)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.papers.finding import VERDICTS, Finding, Reading, Sentence, Verdict, condition_of, finding_of
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class ChartAxis:
    """An axis of a map: its cells are centred at ``values``, which ascend; geometrically centred if ``logarithmic``."""

    label: str
    values: Array
    logarithmic: bool = False

    def __post_init__(self) -> None:
        values = validate.vector(f"the values of axis {self.label!r}", self.values)
        if len(values) < 2 or not (np.diff(values) > 0).all() or (self.logarithmic and values[0] <= 0):
            raise InputError(
                f"axis {self.label!r} needs two or more ascending values{', all above zero' if self.logarithmic else ''}, "
                f"got {validate.show(self.values)}"
            )
        object.__setattr__(self, "values", values)


@dataclass(frozen=True, eq=False)
class Curve:
    """A line across a map, such as a predicted boundary, or marks at its points alone: x (k,), y (k,)."""

    label: str
    x: Array
    y: Array
    marks: bool = False

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            object.__setattr__(self, name, validate.vector(f"{name} of curve {self.label!r}", getattr(self, name)))
        if len(self.x) != len(self.y):
            raise InputError(f"curve {self.label!r} has {len(self.x)} values of x and {len(self.y)} of y; they must be as many")


@dataclass(frozen=True, eq=False, kw_only=True)
class Map:
    """A quantity over the plane of two settings. Texts are plain Unicode: they stand in the picture and on the page.

    key          the name of the map and of its files, of small letters, digits and hyphens
    values       (len(y), len(x)); NaN where the run is lost
    quantity     what the values are, with its unit; on a logarithmic scale of colours if ``logarithmic``
    lost         what NaN means here, for the legend
    curves       lines drawn over it
    """

    key: str
    title: str
    caption: str
    x: ChartAxis
    y: ChartAxis
    values: Array
    quantity: str
    logarithmic: bool = False
    lost: str = "diverged"
    curves: tuple[Curve, ...] = ()

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        values.flags.writeable = False
        shape = (len(self.y.values), len(self.x.values))
        if values.shape != shape:
            raise InputError(f"map {self.key!r} needs values of the shape (y, x) = {shape}, got {values.shape}")
        _require_key("map", self.key)
        if self.logarithmic and (values <= 0).any():
            raise InputError(f"map {self.key!r} has a logarithmic scale, but its least value is {np.nanmin(values):g}")
        object.__setattr__(self, "values", values)

    @property
    def description(self) -> str:
        """In words, for those who cannot see it."""
        return f"{self.title}: {self.quantity} over {self.x.label} and {self.y.label}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """A quantity over one setting, both on logarithmic scales, one curve for each thing compared.

    key     as of a map
    curves  values above zero; a curve that ends before the axis does was lost there, which is marked
    levels  lines for orientation
    lost    what being lost means, for the legend
    """

    key: str
    title: str
    caption: str
    x: ChartAxis
    quantity: str
    curves: tuple[Curve, ...]
    levels: tuple[Curve, ...] = ()
    lost: str = "diverged beyond"

    def __post_init__(self) -> None:
        _require_key("chart", self.key)
        for curve in (*self.curves, *self.levels):
            if len(curve.y) and curve.y.min() <= 0:
                raise InputError(f"chart {self.key!r} has a logarithmic scale, but {curve.label!r} falls to {curve.y.min():g}")

    @property
    def description(self) -> str:
        """In words, for those who cannot see it."""
        return f"{self.title}: {self.quantity} over {self.x.label}, for {', '.join(curve.label for curve in self.curves)}"


def _require_key(kind: str, key: str) -> None:
    if not key or not set(key) <= set("abcdefghijklmnopqrstuvwxyz0123456789-"):
        raise InputError(f"a {kind}'s key must consist of small letters, digits and hyphens, got {key!r}")


@dataclass(frozen=True)
class Listing:
    """A table of things compared: one row for each, texts as they are to be shown."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(f"a row of {self.caption!r} has {len(row)} entries for {len(self.columns)} columns: {row}")


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A sentence with all that a referee asks of it; its finding follows from the readings, by the rules of ``finding``.

    sentence      what is said, by whom, and its literal readings
    readings      what was measured: each literal reading, in the sentence's order, then weaker ones from the widest to the narrowest,
                  and what stands beside the sentence
    shows         what is seen, with the number that decides it: a full sentence, two lines of 80 columns at most, true whatever the finding is
    measured      all that was measured, in a sentence
    how           the plant, the solver, the step, what was compared
    would_change  what would have to be measured, shown or assumed for another finding
    sharpened     what ``reproduce --full`` measures beyond the plain command; empty where that is nothing
    code          the file and the function that measure it; the measurement fills it in
    """

    sentence: Sentence
    readings: tuple[Reading, ...]
    shows: str
    measured: str
    how: str
    would_change: str
    maps: tuple[Map | Chart, ...] = ()
    listings: tuple[Listing, ...] = ()
    sharpened: str = ""
    code: str = ""

    def __post_init__(self) -> None:
        literal = tuple(reading.says for reading in self.readings if reading.literal)
        if literal != self.sentence.literal:
            raise ValueError(
                f"row {self.id!r} has to read each literal reading of its sentence once, in order: {self.sentence.literal}"
            )

    @property
    def id(self) -> str:
        return self.sentence.row

    @property
    def where(self) -> str:
        return self.sentence.where

    @property
    def statement(self) -> str:
        return self.sentence.statement

    @property
    def finding(self) -> Finding:
        return finding_of(self.readings)

    @property
    def verdict(self) -> Verdict:
        """The finding in the JSON contract's words."""
        return VERDICTS[self.finding]

    @property
    def condition(self) -> str:
        """Under which it holds, where the finding is *holds if*; empty for other findings."""
        return condition_of(self.readings)

    @property
    def headline(self) -> str:
        """What is seen, behind the condition where there is one."""
        return f"Holds if {self.condition}. {self.shows}" if self.condition else self.shows

    @property
    def ours(self) -> bool:
        return self.sentence.source.side == "ours"

    def as_json(self) -> dict[str, Any]:
        """The JSON contract's block for a claim; what goes beyond it stands beside the contract's keys."""
        own = ("id", "where", "statement", "verdict", "finding", "headline", "condition", "measured", "how", "would_change")
        return {name: getattr(self, name) for name in (*own, "sharpened", "code")} | {
            "source": self.sentence.source.key,
            "quote": self.sentence.quote,
            "readings": [
                {"says": one.says, "literal": one.literal, "decides": one.decides, "finding": one.finding, "role": one.role, "measured": one.measured}
                for one in self.readings
            ],
            "listings": [asdict(one) for one in self.listings],
        }  # fmt: skip


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
    sharper          measures the same rows further than the plain command has time for, which is ``reproduce --full``; no finding
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
        return [replace(one, code=self.code) for one in ([found] if isinstance(found, Claim) else found)]

    @property
    def code(self) -> str:
        """The file and the function that measure the rows, as a place in the sources."""
        measure = self.measure.func if isinstance(self.measure, partial) else self.measure
        return f"{measure.__module__.replace('.', '/')}.py: {measure.__qualname__}"

    def duration(self, *, full: bool = False) -> float:
        """About how many seconds the rows take."""
        return self.sharper_seconds if full and self.sharper else self.seconds

    def as_json(self) -> list[dict[str, Any]]:
        """A block for each row, without a finding: that is measured."""
        return [{"id": name, "about": about, "seconds": self.seconds, "quick": self.quick} for name, about in self.names.items()]


def short(value: float) -> str:
    """Three digits, without an exponent from a ten-thousandth to a million."""
    return f"{float(f'{value:.3g}'):g}"


def numbers(values: Sequence[float] | Array) -> str:
    """Two numbers, or a few settings, for a sentence; what is measured at three settings and more is a ``table``."""
    *others, last = (short(value) for value in np.atleast_1d(values))
    return f"{', '.join(others)} and {last}" if others else last


def span(values: Sequence[float] | Array) -> str:
    """From the least to the largest, for a sentence; what a ``table`` lists."""
    low, high = short(np.min(values)), short(np.max(values))
    return low if low == high else f"{low} to {high}"


def table(caption: str, columns: Mapping[str, Sequence[str] | Sequence[float] | Array]) -> Listing:
    """A listing from columns by their heads: numbers with three digits, texts as they are, a dash for NaN."""
    entries = ([_entry(value) for value in column] for column in columns.values())
    return Listing(caption, tuple(columns), tuple(zip(*entries, strict=True)))


def _entry(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return "-" if np.isnan(value) else short(value)
