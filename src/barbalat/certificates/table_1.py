"""Table 1, rebuilt by analysis: what is guaranteed of each scheme, under which assumptions, with the case's own constants.

The paper's table compares the standard MRAC with L1-AC; its contents are missing from the text at hand. Each statement here
stands in docs/table-1.md with its source. A scheme joins by one file in ``schemes/``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from barbalat.certificates.assumptions import OUTSIDE, departures
from barbalat.certificates.cells import Column
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.schemes import SCHEMES, sampled
from barbalat.controllers import Sampled
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller

PROPERTIES = {
    "stability": "Signals bounded",
    "tracking": "Tracking error",
    "transient": "Transient",
    "estimates": "Estimates",
    "modelling_error": "With modelling error (11)",
    "tuning": "Gain, filter, step",
    "margins": "Linear loop",
}
"""The rows; the first four are of the plant without modelling error."""


@dataclass(frozen=True)
class Table:
    """Table 1 of a case; ``violated`` says why the statements on the exact plant do not apply to it."""

    columns: tuple[Column, ...]
    violated: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        return {"properties": PROPERTIES, "columns": [c.as_json() for c in self.columns], "violated": list(self.violated)}


def table_1(problem: TrackingProblem, controllers: Sequence[Controller], certificates: dict[str, Certificate]) -> Table:
    """One column for each controller for which an analysis is known."""
    columns = [_column(problem, controller, certificates[controller.name]) for controller in controllers]
    return Table(tuple(column for column in columns if column is not None), _violated(problem))


def _column(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> Column | None:
    scheme = controller.controller if isinstance(controller, Sampled) else controller
    analysis = SCHEMES.get(type(scheme))
    if analysis is None:
        return None
    name, cells = analysis.column(problem, scheme, certificate.values)
    column = Column(controller.name, name, cells, certificate.assumptions)
    return sampled.column(column, controller) if isinstance(controller, Sampled) else column


def _violated(problem: TrackingProblem) -> tuple[str, ...]:
    if not isinstance(problem, Problem):
        return tuple(f"{departure}; only bounds of |y| and |y - y_m| cover what acts" for departure in departures(problem))
    known_set = problem.known.box
    outside = known_set is not None and not known_set.contains(problem.parameters)
    return (*departures(problem), *([OUTSIDE] if outside else []))
