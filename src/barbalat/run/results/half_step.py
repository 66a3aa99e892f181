"""The part of a run's error that is due to the solver, found from the tail's largest error at half the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.judge.verdict import Class

TOLD_SHARE = 0.1
"""Fraction of the judge's band above which the solver's effect on an error is reported."""


@dataclass(frozen=True)
class HalfStep:
    """The tail's largest |error| of the component named in the verdict, at the step of the run and at half of it.

    order  order of the method in the step, reduced by jumps and corners inside steps
    band   the judge's band
    kinds  the judge's classes at the case's step and at half of it, both without a search for limit cycles
    """

    component: str
    coarse: float
    fine: float
    order: int
    band: float
    kinds: tuple[Class, Class]

    @property
    def of_the_solver(self) -> float:
        """The solver's contribution to the error, by Richardson's extrapolation. It is negative if it reduces the error, and NaN
        if the run diverged.

        This is an estimate, which assumes that the error decreases with the order of the step.
        """
        return (self.coarse - self.fine) / (1.0 - 0.5**self.order)

    @property
    def decides(self) -> bool:
        """Whether the judge's class changes at half the step."""
        return self.kinds[0] is not self.kinds[1]

    @property
    def sentence(self) -> str | None:
        """The finding as a sentence; None if the solver's contribution is below a tenth of the band and the class is the same."""
        if not np.isfinite(self.fine):
            return "the run diverges at half the step, so its result is due to the solver"
        size = abs(self.of_the_solver)
        if size <= TOLD_SHARE * self.band and not self.decides:
            return None
        part = f"about {100 * size / self.coarse:.2g} %"
        error, values = (
            f"the error of {self.component} in the tail",
            f"{self.coarse:.4g} at this step, {self.fine:.4g} at half of it",
        )
        if self.of_the_solver > 0:
            owed = f"{part} of {error} is due to the solver"
        elif size < self.coarse:
            owed = f"the solver hides {part} of {error}"
        else:
            owed = f"{error} is about {1 + size / self.coarse:.2g} times as large without the solver's error"
        return f"{owed}: {values}" + (f", where the verdict is *{self.kinds[1]}*" if self.decides else "")

    def as_json(self) -> dict[str, Any]:
        known = bool(np.isfinite(self.fine))
        return {
            "component": self.component,
            "tail_max_abs_e": self.fine if known else None,
            "of_the_solver": self.of_the_solver if known else None,
            "class": str(self.kinds[1]),
            "class_at_step": str(self.kinds[0]),
        }
