"""How far a long piece of work is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Called with the fraction done, in [0, 1]."""


def part_of(progress: Progress | None, start: float, width: float) -> Progress | None:
    """What tells ``progress`` of a part of the work, from ``start`` to ``start + width``."""
    return None if progress is None else lambda fraction: progress(start + width * fraction)
