"""How measured numbers are said: in a sentence, and in a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from barbalat.papers.claim import Listing
from barbalat.validate import Array


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
