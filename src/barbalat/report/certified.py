"""What the reports show of certificates: of the case that was run, and of the paper's schemes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from barbalat.certify.certificate import Certificate
from barbalat.certify.table import certify_where_possible
from barbalat.certify.table_1 import Table, table_1
from barbalat.claims.section_v import Runs
from barbalat.grid import Simulation
from barbalat.protocols import Controller
from barbalat.tracking_problem import TrackingProblem


class Certified(NamedTuple):
    """Certificates by the names under which they are shown, and Table 1 of the schemes."""

    certificates: dict[str, Certificate]
    table: Table

    def as_json(self) -> dict[str, Any]:
        return {"certificates": {n: c.as_json() for n, c in self.certificates.items()}, "table_1": self.table.as_json()}


def certified_case(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> Certified:
    """Certificates of all controllers; what can't be certified has the reason as its finding."""
    certificates = certify_where_possible(problem, controllers, simulation)
    return Certified(certificates, table_1(problem, controllers, certificates))


def certified_paper(runs: Runs) -> Certified:
    """The schemes as in the figures: one column of Table 1 for each, and L1-AC at the finer step besides."""
    shown = [runs.coarse[name] for name in ("MRAC", "Robust MRAC, no auxiliary input", "L1", "Robust MRAC")]
    problem, simulation = shown[0].problem, shown[0].simulation
    coarse = certified_case(problem, [result.controller for result in shown], simulation)
    certificates = {f"{name}, h = {simulation.dt:g} s": found for name, found in coarse.certificates.items()}
    for name in ("L1, gamma 1e4", "L1, gamma 1e6"):
        fine = runs.fine[name]
        (found,) = certify_where_possible(problem, [fine.controller], fine.simulation).values()
        certificates[f"{name}, h = {fine.simulation.dt:g} s"] = found
    return Certified(certificates, coarse.table)
