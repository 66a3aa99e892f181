"""A measured sentence with its finding (Claim), a quantity over two settings (Map), and a quantity over one (Chart)."""

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
    """An axis of a map. ``values`` are the centres of its cells, in ascending order. On a ``logarithmic`` axis the centres are
    geometric."""

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
    """A line across a map, such as a predicted boundary, or only marks at the points x (k,), y (k,)."""

    label: str
    x: Array
    y: Array
    marks: bool = False

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            object.__setattr__(self, name, validate.vector(f"{name} of curve {self.label!r}", getattr(self, name)))
        if len(self.x) != len(self.y):
            raise InputError(
                f"curve {self.label!r} has {len(self.x)} values of x and {len(self.y)} of y; they must have the same length"
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class Map:
    """A quantity over the plane of two settings. Texts are plain Unicode, for the picture and the page.

    key          the name of the map and of its files: small letters, digits and hyphens
    values       (len(y), len(x)); NaN if the run is lost
    quantity     the name of the values, with their unit; the colour scale is logarithmic if ``logarithmic``
    lost         the meaning of NaN, for the legend
    curves       lines drawn over the map
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
            raise InputError(f"map {self.key!r} has a logarithmic scale, but its smallest value is {np.nanmin(values):g}")
        object.__setattr__(self, "values", values)

    @property
    def description(self) -> str:
        """A description in words, for readers who cannot see the picture."""
        return f"{self.title}: {self.quantity} over {self.x.label} and {self.y.label}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """A quantity over one setting, both on logarithmic scales, with one curve for each compared item.

    key     the name, with the same form as a map's
    curves  values above zero; a mark shows where a curve ends early because its run was lost
    levels  lines for orientation
    lost    the meaning of the mark, for the legend
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
        """A description in words, for readers who cannot see the picture."""
        return f"{self.title}: {self.quantity} over {self.x.label}, for {', '.join(curve.label for curve in self.curves)}"


def _require_key(kind: str, key: str) -> None:
    if not key or not set(key) <= set("abcdefghijklmnopqrstuvwxyz0123456789-"):
        raise InputError(f"a {kind}'s key must consist of small letters, digits and hyphens, got {key!r}")


@dataclass(frozen=True)
class Listing:
    """A table that compares items. Each item has a row with the texts to be shown."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(f"a row of {self.caption!r} has {len(row)} entries for {len(self.columns)} columns: {row}")


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A sentence with the evidence that a referee requires; its finding follows from the readings by the rules of ``finding``.

    sentence      the sentence, its source, and its literal readings
    readings      the measured readings: first the literal ones in the sentence's order, then weaker ones from the widest to the
        narrowest, then supplementary ones
    shows         the observation, with the deciding number: a full sentence of at most two lines of 80 columns that is true
        for every finding
    measured      all measurements, in a sentence
    how           the plant, the solver, the step, and what was compared
    would_change  what would have to be measured, shown or assumed for a different finding
    sharpened     what ``reproduce --full`` measures beyond a run without it; empty if it measures nothing more
    code          the file and the function that measure it, which the measurement fills in
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
                f"row {self.id!r} must contain each literal reading of its sentence once, in order: {self.sentence.literal}"
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
        """The condition of the finding *holds if*; empty for other findings."""
        return condition_of(self.readings)

    @property
    def headline(self) -> str:
        """The observation, after the condition if there is one."""
        return f"Holds if {self.condition}. {self.shows}" if self.condition else self.shows

    @property
    def ours(self) -> bool:
        return self.sentence.source.side == "ours"

    def as_json(self) -> dict[str, Any]:
        """Return the block for a claim in the form of the JSON contract, with additional keys."""
        own = ("id", "where", "statement", "verdict", "finding", "headline", "condition", "measured", "how", "would_change")
        return {name: getattr(self, name) for name in (*own, "sharpened", "code")} | {
            "source": self.sentence.source.key,
            "quote": self.sentence.quote,
            "equation": self.sentence.equation,
            "changed": [asdict(one) for one in self.sentence.changed],
            "readings": [
                {"says": one.says, "literal": one.literal, "decides": one.decides, "finding": one.finding, "role": one.role, "measured": one.measured}
                for one in self.readings
            ],
            "listings": [asdict(one) for one in self.listings],
        }  # fmt: skip


LAST = float("inf")
"""The place of rows without a declared place. They follow all other rows of their paper, in the order of their files."""


@dataclass(frozen=True)
class Measurement:
    """A measurement of some of the ledger's rows. A claim's file lists its rows as ``ROWS``, and its paper finds them there.

    measure          the function that measures the rows; its argument is the paper's shared runs if it ``judges_runs``, and
        otherwise it has none
    seconds          estimated duration in a separate process, used to start the longest measurement first and to forecast the
        remaining time
    names            the rows' names and the subject of each in a few words, so that a row can be found before it is measured
    place            the position of the rows among the rows of their paper
    quick            whether ``reproduce --quick`` measures them
    shares           a name shared by the measurements that use the same runs; one process performs them all
    sharper          a function that measures the same rows more precisely than there is time for without ``--full``, used by
        ``reproduce --full``; no finding depends on it
    sharper_seconds  its estimated duration
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
        """Measure the rows."""
        measure = self.sharper if full and self.sharper else self.measure
        found = measure(*runs)
        return [replace(one, code=self.code) for one in ([found] if isinstance(found, Claim) else found)]

    @property
    def code(self) -> str:
        """The file and the function in the sources that measure the rows."""
        measure = self.measure.func if isinstance(self.measure, partial) else self.measure
        return f"{measure.__module__.replace('.', '/')}.py: {measure.__qualname__}"

    def duration(self, *, full: bool = False) -> float:
        """Return the estimated seconds for the rows."""
        return self.sharper_seconds if full and self.sharper else self.seconds

    def as_json(self) -> list[dict[str, Any]]:
        """Return a block for each row. It contains no finding, because that would have to be measured."""
        return [{"id": name, "about": about, "seconds": self.seconds, "quick": self.quick} for name, about in self.names.items()]


def short(value: float) -> str:
    """Format a value with three digits, and from a ten-thousandth to a million without an exponent."""
    return f"{float(f'{value:.3g}'):g}"


def numbers(values: Sequence[float] | Array) -> str:
    """Format two numbers or a few settings for a sentence. Measurements at three or more settings belong in a ``table``."""
    *others, last = (short(value) for value in np.atleast_1d(values))
    return f"{', '.join(others)} and {last}" if others else last


def span(values: Sequence[float] | Array) -> str:
    """Format the range from the smallest to the largest value, for a sentence that summarises a ``table``."""
    low, high = short(np.min(values)), short(np.max(values))
    return low if low == high else f"{low} to {high}"


def table(caption: str, columns: Mapping[str, Sequence[str] | Sequence[float] | Array]) -> Listing:
    """Return a listing from columns by their headings. Numbers have three digits, texts are unchanged, and NaN is a dash."""
    entries = ([_entry(value) for value in column] for column in columns.values())
    return Listing(caption, tuple(columns), tuple(zip(*entries, strict=True)))


def _entry(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return "-" if np.isnan(value) else short(value)
