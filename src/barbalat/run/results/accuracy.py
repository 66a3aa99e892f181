"""What the tolerance of a run came to: its error from t = 0 on, as a second run at a finer tolerance measures it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.validate import Array


@dataclass(frozen=True)
class Accuracy:
    """Of a run by tolerance.

    tolerance  what each step may err by
    finer      the tolerance of the second run
    error      by the state's name, "x" and "theta_hat", the largest difference of the two runs at the recorded instants, as a
               part of the largest magnitude that its component takes; None where a run does not reach the end
    steps      accepted; ``rejected`` were tried in vain, ``choices`` ended where the equations jump or bend
    """

    tolerance: float
    finer: float
    error: dict[str, float | None]
    steps: int
    rejected: int
    choices: int

    @classmethod
    def of(
        cls, tolerance: float, finer: float, states: Array, others: Array, rows: Mapping[str, Array], steps: int, rejected: int,
        choices: int,
    ) -> Accuracy:  # fmt: skip
        """From the states (K, S) of both runs; ``rows`` are those of each name."""
        with np.errstate(invalid="ignore"):
            largest = np.maximum(np.abs(others).max(axis=0), np.finfo(float).tiny)
            differs = np.abs(states - others).max(axis=0) / largest
        found = {name: float(differs[which].max()) for name, which in rows.items() if len(which)}
        return cls(tolerance, finer, {name: v if np.isfinite(v) else None for name, v in found.items()}, steps, rejected, choices)

    @property
    def in_brief(self) -> str:
        """The measured error alone."""
        told = [f"{value:.2g} in {name}" for name, value in self.error.items() if value is not None]
        if not told:
            return f"error not measured, since a run at {self.finer:g} does not reach the end"
        return f"measured error {' and '.join(told)}"

    @property
    def sentence(self) -> str:
        """In one line."""
        ended = f", {self.choices} of them ending at a corner or a jump of the equations" if self.choices else ""
        how = "" if all(value is None for value in self.error.values()) else f", by a second run at {self.finer:g}"
        return f"tolerance {self.tolerance:g}: {self.in_brief}{how}; {self.steps} steps of DOP853{ended}"

    def as_json(self) -> dict[str, Any]:
        return vars(self) | {"sentence": self.sentence}
