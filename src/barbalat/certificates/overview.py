"""What the reports show of certificates: of the case that was run, and of the paper's schemes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certify import certify_where_possible
from barbalat.certificates.table_1 import Table1, table_1
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation


class Certified(NamedTuple):
    """Certificates by the names under which they are shown, and Table 1 of the schemes."""

    certificates: dict[str, Certificate]
    table: Table1

    def as_document(self, case: str) -> dict[str, Any]:
        """The contract's document of ``certify --json``."""
        controllers = {name: certificate.as_json() for name, certificate in self.certificates.items()}
        return {"case": case, "controllers": controllers, "table_1": self.table.as_json()}

    def as_json(self) -> dict[str, Any]:
        return {"certificates": {n: c.as_json() for n, c in self.certificates.items()}, "table_1": self.table.as_json()}


def certified_case(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    progress: Callable[[float], None] = lambda _: None,
) -> Certified:
    """Certificates of all controllers; what can't be certified has the reason as its finding."""
    certificates = certify_where_possible(problem, controllers, simulation, progress)
    return Certified(certificates, table_1(problem, controllers, certificates))
