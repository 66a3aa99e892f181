"""A run that grows beyond all proportion and ends before it counts as diverged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array

OUT_OF_PROPORTION = 1e3
"""|e| over the size of the model's motion: 60 dB above all that was commanded. Transients of high gains stay far below."""
STILL_GROWING = 1.2
"""|e| in the last quarter over that in the one before: growth like t gives 4/3, an exponential that came this far above 5."""


@dataclass(frozen=True)
class Runaway:
    """An error that is out of proportion and grows to the end: ``reaches`` is the largest |e|, ``ratio`` that over the motion."""

    reaches: float
    ratio: float

    @property
    def sentence(self) -> str:
        """The same for people."""
        return (
            f"|e| reaches {self.reaches:.3g}, {self.ratio:.2g} times the model's motion, and still grows at the end: "
            "the run runs away, though it has not diverged"
        )

    def as_json(self) -> dict[str, float]:
        """For ``run --json``."""
        return {"max_abs_e": self.reaches, "over_model": self.ratio}


def runaway(e_min: Array, e_max: Array, motion: Array) -> Runaway | None:
    """From the extrema of e over K intervals, (K, n), and the model's motion (..., n); None of a run that stays in proportion.

    Where the model stands still, the error at the start is what there is to compare with. Components may differ in their units:
    each is held against the largest of all.
    """
    reached = np.maximum(-e_min, e_max).max(axis=1, initial=0.0)
    size = float(np.abs(motion).max(initial=0.0)) or float(reached[:1].max(initial=0.0))
    quarter = len(reached) // 4
    if quarter == 0 or size == 0:
        return None
    last, before = float(reached[-quarter:].max()), float(reached[-2 * quarter : -quarter].max())
    grows = last > OUT_OF_PROPORTION * size and last > STILL_GROWING * before
    return Runaway(last, last / size) if grows else None
