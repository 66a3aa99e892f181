"""Figures as text."""

from __future__ import annotations


def number_text(value: float | list[float] | None, separator: str = ", ") -> str:
    """A figure for people: four digits, components with a separator between."""
    if isinstance(value, list):
        return separator.join(number_text(v) for v in value) or "-"
    return "-" if value is None else f"{value:.4g}"
