"""What a tuning found: the chosen point with its certificate, its front, and how it fares on plants that it never saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.certificates.certificate import Certificate
from barbalat.open_numbers.path import FieldPath
from barbalat.pictures.plotted import Plotted
from barbalat.tuning.aim import Aim
from barbalat.tuning.quantity import Constraint
from barbalat.tuning.space import Space
from barbalat.tuning.step_check import StepCheck
from barbalat.validate import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Point:
    """A tuning, what it reaches, and the value of each constraint's quantity; None where it has none."""

    tuning: Mapping[FieldPath, float]
    value: float | None
    found: Mapping[Constraint, float | None]
    meets: bool

    def as_json(self) -> dict[str, Any]:
        return {
            "tuning": {str(path): value for path, value in self.tuning.items()},
            "value": _finite(self.value),
            "constraints": {str(one.requirement): _finite(value) for one, value in self.found.items()},
            "meets": self.meets,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class UnseenPlants:
    """The chosen tuning on plants that the search did not see.

    quantity  of which the values are: the aim's, or that of the first constraint that runs tell
    thetas    (P, p); values (P,) of the quantity and, of each constraint that runs tell, ``broken`` (P,); infinite: it diverged
    """

    quantity: str
    thetas: Array
    values: Array
    broken: Mapping[Constraint, Array]
    worst: int

    def as_json(self) -> dict[str, Any]:
        return {
            "plants": len(self.thetas),
            "quantity": self.quantity,
            "diverged_or_lost": int((~np.isfinite(self.values)).sum()),
            "median": _finite(float(np.median(self.values))),
            "worst": {"theta": self.thetas[self.worst].tolist(), "value": _finite(float(self.values[self.worst]))},
            "broken": {str(one.requirement): int(values.sum()) for one, values in self.broken.items()},
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Tuned:
    """One controller.

    chosen   the best that meets every constraint; None where none of the tunings does, then ``nearest`` is the least wrong
    start    the case's own tuning
    front    the tried ones that no other beats both in the quantity and in the first constraint's quantity
    trials, runs  tunings that were tried, simulations that were made
    step     what a finer step says of the chosen tuning; of the nearest one where that is all that keeps it from being chosen
    refused  the same of better ones, which meet every constraint at the step of the case alone
    """

    controller: str
    space: Space
    start: Point
    chosen: Point | None
    nearest: Point
    front: tuple[Point, ...]
    held_out: UnseenPlants | None
    certificate: Certificate | None
    trials: int
    runs: int
    step: StepCheck | None
    refused: tuple[StepCheck, ...]

    def as_json(self) -> dict[str, Any]:
        return {
            "varied": {str(path): str(one) for path, one in self.space.ranges.items()},
            "meets": self.chosen is not None,
            **{key: None if point is None else point.as_json() for key, point in self._points.items()},
            "front": [point.as_json() for point in self.front],
            "held_out": None if self.held_out is None else self.held_out.as_json(),
            "certificate": None if self.certificate is None else self.certificate.as_json(),
            "trials": self.trials,
            "runs": self.runs,
            "finer_step": None if self.step is None else self.step.as_json(),
            "refused_at_finer_step": [one.as_json() for one in self.refused],
        }

    @property
    def _points(self) -> dict[str, Point | None]:
        return {"start": self.start, "chosen": self.chosen, "nearest": None if self.chosen else self.nearest}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Tuning(Plotted):
    """All controllers that were tuned; ``case`` has the chosen numbers, and ``text`` is its file where there was one."""

    aim: Aim
    case: Case
    text: str | None
    thetas: Array
    controllers: Mapping[str, Tuned]
    notes: tuple[str, ...]
    seconds: float

    def __repr__(self) -> str:
        found = (f"{name} {self._said(one)}" for name, one in self.controllers.items())
        return f"<Tuning of {self.case.name!r} for {self.aim.quantity.name}: {'; '.join(found)}>"

    def _said(self, one: Tuned) -> str:
        return "none found" if one.chosen is None or one.chosen.value is None else f"{one.chosen.value:.4g}"

    def as_json(self) -> dict[str, Any]:
        """The document of ``tune --json``."""
        return {
            "case": self.case.name,
            "for": self.aim.quantity.name,
            "maximize": self.aim.maximize,
            "subject_to": [str(one.requirement) for one in self.aim.constraints],
            "plants": len(self.thetas) or 1,
            "thetas": self.thetas.tolist(),
            "quantile": self.aim.quantile,
            "seed": self.aim.seed,
            "controllers": {name: one.as_json() for name, one in self.controllers.items()},
            "notes": list(self.notes),
            "case_file": self.text,
            "seconds": self.seconds,
        }

    def plot(self, *, shown: bool = True) -> Figure:
        """The front of each controller, as a Matplotlib figure; InputError where there was no constraint.

        shown  to a person at once, by pyplot where that is in use
        """
        from barbalat.tuning.picture import draw

        return draw(self, shown=shown)


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None
