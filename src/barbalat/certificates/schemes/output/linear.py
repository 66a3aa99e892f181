"""The certificate of linear output feedback, and its column of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.cells import advice, estimate, margins_cell
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.schemes.output_feedback import (
    LINEAR_LOOP,
    OF_LINEAR_LOOPS,
    add_bounds,
    add_linear_loop,
    cells_of_linear_loop,
    grounds_of_loop,
)
from barbalat.certificates.schemes.unregistered import add_step_of_modes
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation


def certificate(problem: OutputProblem, controller: LinearOutput, simulation: Simulation) -> Certificate:
    """The bounds on y and e, the margins of the loop, the largest step for its modes."""
    draft = Draft(own=OF_LINEAR_LOOPS)
    found = add_linear_loop(draft, problem, controller, simulation)
    if found is not None:
        add_bounds(draft, problem, found)
    loop = (controller.loop * problem.plant.transfer_function).realise()
    add_margins(draft, problem, loop, "itself", LINEAR_LOOP)
    add_step_of_modes(draft, problem, controller, simulation)
    return draft.finish()


def grounds(problem: OutputProblem, controller: LinearOutput, simulation: Simulation) -> dict[str, Any]:
    """The numbers of the small-gain bounds."""
    return grounds_of_loop(problem, controller, simulation)


def linear_when(_problem: OutputProblem, _controller: LinearOutput) -> str | None:
    """The controller is always linear; its margins ignore f(t, y), as in continuous time."""
    return LINEAR_LOOP


def column(problem: OutputProblem, _: LinearOutput, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    return "linear output feedback", {
        **cells_of_linear_loop(problem, certificate),
        "estimates": advice("estimates", "it estimates nothing"),
        "modelling_error": estimate("modelling_error", "see the margins"),
        "tuning": advice("tuning", "no adaptive gain"),
        "margins": margins_cell(certificate),
    }
