"""The certificate of each controller of a problem, put together from conditions, bounds, limits and margins."""

from __future__ import annotations

from collections.abc import Sequence

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.schemes import sampled, scheme_file, stranger
from barbalat.certificates.schemes.state_feedback import beyond_the_paper
from barbalat.controllers import Sampled
from barbalat.loop.binding import require_controllers
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError


def certify(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> dict[str, Certificate]:
    """Certificates by the controllers' names; nothing is simulated, the solver and its step are what is judged.

    Of a class from outside the package what needs no proof is given; the rest is said to be unknown. Raises InputError for a
    controller that does not fit the problem.
    """
    require_controllers(controllers)
    return {controller.name: _certificate(problem, controller, simulation) for controller in controllers}


def certify_where_possible(
    problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation
) -> dict[str, Certificate]:
    """The same for a report: what can't be certified has the reason as its finding."""
    found = {}
    for controller in controllers:
        try:
            found[controller.name] = _certificate(problem, controller, simulation)
        except InputError as error:
            found[controller.name] = Certificate(notes=(f"no certificate: {error}",))
    return found


def _certificate(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    if isinstance(controller, Sampled):
        controller.bind(problem.known)  # refuses what has no sampled form
        judged = sampled.judged_at(controller, simulation)
        return sampled.certificate(problem, _certificate(problem, controller.controller, judged), controller, judged)
    scheme = scheme_file(controller)
    if scheme is None:
        return stranger.certificate(problem, controller, simulation)
    if isinstance(problem, Problem) and (
        problem.plant.inputs > 1 or not problem.plant.is_linear or problem.input_gain is not None
    ):
        return beyond_the_paper(problem, controller, simulation)
    return scheme.certificate(problem, controller, simulation)
