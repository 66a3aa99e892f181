"""The certificate of linear output feedback, and its column of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.cells import Cell, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.schemes.output_feedback import FROM_REST, LINEAR_LOOP, bounds, of_linear_loop
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation


def column(problem: OutputProblem, __: LinearOutput, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    return "linear output feedback", {
        **of_linear_loop(problem, values, "", "no bound in this case: see the certificate's findings"),
        "estimates": Cell("estimate", "it estimates nothing"),
        "modelling_error": Cell("estimate", "see the margins"),
        "tuning": Cell("estimate", "no adaptive gain"),
        "margins": margins_cell(values),
    }


def certificate(problem: OutputProblem, controller: LinearOutput, simulation: Simulation) -> Certificate:
    """The bounds of y and e, and the margins of the loop."""
    findings: list[str] = []
    values, guaranteed = bounds(problem, controller, simulation, findings)
    values |= margins_of(problem, (controller.loop * problem.plant.transfer_function).realise(), "itself", findings)
    return Certificate(values, frozenset(guaranteed), (*FROM_REST, LINEAR_LOOP), tuple(findings))
