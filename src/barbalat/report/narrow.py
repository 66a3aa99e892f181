"""Which tables fit a phone as tables; the others' rows are stacked there, each entry beside its column's head."""

from __future__ import annotations

from collections.abc import Sequence

PHONE = 326
"""Pixels of 390 that are left inside a card."""
CHARACTER, PADDING = 9.2, 11.2
"""Pixels: of a digit of DejaVu Sans at a table's 14.4, and of a cell to both sides."""


def fits_a_phone(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Whether the columns stand beside one another when their texts are broken between words."""
    longest = (max(len(word) for text in column for word in text.split() or [""]) for column in zip(columns, *rows, strict=True))
    return sum(count * CHARACTER + PADDING for count in longest) <= PHONE
