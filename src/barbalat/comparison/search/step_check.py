"""What a finer step says of a tuning that is reported: whether it still meets what was asked, and what it changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.study.finer_step import FINER_BY, PlainRun


@dataclass(frozen=True, kw_only=True)
class StepCheck:
    """One tuning at a step FINER_BY times smaller.

    dt       the finer step [s]
    value    the aim's figure there; None where no run tells it
    broken   sentences: constraints that it does not meet there
    changed  sentences: figures that are other ones there
    plain    the tuning's run without a modelling error at the step of the case
    """

    dt: float
    value: float | None
    broken: tuple[str, ...]
    changed: tuple[str, ...]
    plain: PlainRun

    @property
    def holds(self) -> bool:
        """Whether every constraint is met at the finer step too."""
        return not self.broken

    @property
    def sentences(self) -> list[str]:
        """What the result is not; first of all, where nothing has changed, that."""
        said = [*self.broken, *self.changed]
        if not said and self.plain.settles:
            said = [f"a step {FINER_BY} times smaller confirms it"]
        return [*said, *self.plain.sentences]

    def as_json(self) -> dict[str, Any]:
        return {
            "dt": self.dt,
            "value": self.value if self.value is not None and np.isfinite(self.value) else None,
            "holds": self.holds,
            "sentences": self.sentences,
            **self.plain.as_json(),
        }
