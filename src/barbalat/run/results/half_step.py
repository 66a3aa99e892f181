"""How much of a run's error is the solver's: what half the step says of the tail's largest error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.judge.verdict import Class

TOLD_SHARE = 0.1
"""Of the judge's band: what the solver adds to an error, or takes from it, is told where it is more than that."""


@dataclass(frozen=True)
class HalfStep:
    """The tail's largest |error| of the component that the verdict names, at a run's own step and at half of it.

    order  of the method in the step, less what jumps and corners inside of steps cost it
    band   of the judge
    kinds  the judge's classes at the case's step and at half of it, where neither is looked at for limit cycles
    """

    component: str
    coarse: float
    fine: float
    order: int
    band: float
    kinds: tuple[Class, Class]

    @property
    def of_the_solver(self) -> float:
        """What the solver adds to the error, by Richardson's extrapolation; below 0 where it hides some of it; NaN if diverged.

        An estimate: the error of the step is taken to fall as its order says.
        """
        return (self.coarse - self.fine) / (1.0 - 0.5**self.order)

    @property
    def decides(self) -> bool:
        """Whether the judge's class is another one at half the step."""
        return self.kinds[0] is not self.kinds[1]

    @property
    def sentence(self) -> str | None:
        """The finding as a sentence; None where the solver's part is below a tenth of the band, and the class the same."""
        if not np.isfinite(self.fine):
            return "the run diverges at half the step: what it shows is the solver's"
        size = abs(self.of_the_solver)
        if size <= TOLD_SHARE * self.band and not self.decides:
            return None
        part = f"{100 * size / self.coarse:.2g} %" if size < self.coarse else f"{size:.2g}"
        error, values = (
            f"the error of {self.component} in the tail",
            f"{self.coarse:.4g} at this step, {self.fine:.4g} at half of it",
        )
        owed = (
            f"about {part} of {error} is the solver's" if self.of_the_solver > 0 else f"the solver hides about {part} of {error}"
        )
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
