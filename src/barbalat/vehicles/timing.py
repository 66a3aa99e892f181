"""How long a flight is, and when what fails does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Of one flight [s]."""

    duration: float
    fails_at: float
