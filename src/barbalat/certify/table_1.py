"""Table 1, rebuilt by analysis: what is guaranteed of each scheme, under which assumptions, with the case's own constants.

The paper's table compares the standard MRAC with L1-AC; its contents are missing from the text at hand. Each statement here
stands in docs/table-1.md with its source. A scheme joins by one function in ``analyses.ANALYSES``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from barbalat.adaptation.switching_sigma import SwitchingSigma
from barbalat.certify.analyses import ANALYSES, Cell
from barbalat.certify.analyses_output import OUTPUT_ANALYSES
from barbalat.certify.certificate import Certificate
from barbalat.certify.common import OUTSIDE, departures
from barbalat.controllers import LinearFeedback, Sampled
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem import Problem
from barbalat.protocols import Controller
from barbalat.tracking_problem import TrackingProblem

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
class Column:
    """One controller: its statements by the keys of PROPERTIES, and what they assume."""

    name: str
    scheme: str
    cells: dict[str, Cell]
    assumptions: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        cells = {key: cell._asdict() for key, cell in self.cells.items()}
        return {"name": self.name, "scheme": self.scheme, "assumptions": list(self.assumptions), **cells}


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
    analysis = (ANALYSES | OUTPUT_ANALYSES).get(type(scheme))
    if analysis is None:
        return None
    name, cells = analysis(problem, scheme, certificate.values)
    column = Column(controller.name, name, cells, certificate.assumptions)
    return _sampled(column, controller) if isinstance(controller, Sampled) else column


def _violated(problem: TrackingProblem) -> tuple[str, ...]:
    if not isinstance(problem, Problem):
        return tuple(f"{departure}; only bounds of |y| and |y - y_m| cover what acts" for departure in departures(problem))
    known_set = problem.known.box
    outside = known_set is not None and not known_set.contains(problem.parameters)
    return (*departures(problem), *([OUTSIDE] if outside else []))


def _sampled(column: Column, controller: Sampled) -> Column:
    """What holds in continuous time holds for a sampled controller as far as its samples resolve it."""
    cells = {
        key: Cell("not proven" if c.kind == "proven" else c.kind, f"in continuous time: {c.text}")
        for key, c in column.cells.items()
    }
    scheme: Any = controller.controller
    if controller.discretization == "midpoint" and not isinstance(scheme, (LinearFeedback, LinearOutput)):
        leakage = getattr(getattr(scheme, "law", scheme), "leakage", None)
        held = leakage is None or isinstance(leakage, SwitchingSigma)
        growth = "does not grow" if held else "grows by no more than T w |theta|^2/2, w the leakage,"
        cells["estimates"] = Cell("proven", f"V of the law {growth} from sample to sample, for every gain and sample time")
    return replace(column, scheme=f"{column.scheme}, sampled ({controller.discretization})", cells=cells)
