"""Table 1, rebuilt by analysis: what is guaranteed of each scheme, under which assumptions, with the case's own constants.

The paper's table compares the standard MRAC with L1-AC; its contents are missing from the text at hand. Each statement here
stands in docs/table-1.md with its source. A scheme joins by one file in ``schemes/``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from barbalat.certificates.cells import PROPERTIES, Column, nothing
from barbalat.certificates.certificate import Certificate, reason
from barbalat.certificates.schemes import scheme_file, unregistered
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Named


def column_of(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> Column:
    """A controller's column; where its computation fails, each cell says so."""
    file = scheme_file(controller) or unregistered
    try:
        scheme, cells = file.column(problem, controller, certificate)
        limited = not all(path.is_linear for path in problem.plant.paths)
        return Column(controller.name, scheme, Named.of("cell", cells), limited)
    except Exception as error:  # noqa: BLE001 (one column; the others stand)
        return Column(controller.name, type(controller).__name__, {key: nothing(key, reason(error)) for key in PROPERTIES})


@dataclass(frozen=True)
class Table1:
    """Table 1 of a case. Each cell was checked on the case: one whose assumptions it breaks says so in its place."""

    columns: tuple[Column, ...]

    def as_json(self) -> dict[str, Any]:
        """The block ``table_1`` of the documents that ``certify --json`` prints."""
        return {"properties": PROPERTIES, "columns": [column.as_json() for column in self.columns]}


def table_1(problem: TrackingProblem, controllers: Sequence[Controller], certificates: dict[str, Certificate]) -> Table1:
    """One column for each controller."""
    return Table1(tuple(column_of(problem, controller, certificates[controller.name]) for controller in controllers))
