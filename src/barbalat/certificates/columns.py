"""One controller's column of Table 1, by its scheme's file."""

from __future__ import annotations

from barbalat.certificates.cells import PROPERTIES, Column, nothing
from barbalat.certificates.certificate import Certificate, reason
from barbalat.certificates.schemes import scheme_file, stranger
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Named


def column_of(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> Column:
    """A controller's column; where its computation fails, each cell says so."""
    file = scheme_file(controller) or stranger
    try:
        scheme, cells = file.column(problem, controller, certificate)
        limited = not all(path.is_linear for path in problem.plant.paths)
        return Column(controller.name, scheme, Named.of("cell", cells), limited)
    except Exception as error:  # noqa: BLE001 (one column; the others stand)
        return Column(controller.name, type(controller).__name__, {key: nothing(key, reason(error)) for key in PROPERTIES})
