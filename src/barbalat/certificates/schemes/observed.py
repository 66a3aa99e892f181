"""The certificate of any controller with an observer: margins and steps of its loop including the observer.

The proofs of a scheme assume a measured state, from which x_hat differs, so no entry of the usual certificate of the scheme
applies. The loop is linearised by the exact Jacobians of all equations, including those of the observer. A controller that is
linear from sample to sample has the bounds of that loop; no bound is known for adaptive controllers.
"""

from __future__ import annotations

from barbalat.certificates import theorems
from barbalat.certificates.cells import advice, estimate, limits_text, margins_cell, nothing
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.schemes import bounded_response, sampled_margins
from barbalat.certificates.schemes.sampled_loop import OF_SAMPLED_LOOPS, add_loop, linear_because
from barbalat.certificates.schemes.unregistered import add_linearised
from barbalat.controllers import KnownParameters, Sampled
from barbalat.controllers.l1_piecewise import L1PiecewiseConstant
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

NO_THEOREM = "no theorem covers adaptation with an observer"
NOT_LINEAR = "with an observer a bound is computed only for linear controllers"
NO_MORE = "with an observer nothing is proven beyond the bounds on x and e of the linear loop"


def certificate(problem: Problem, controller: Controller, simulation: Simulation) -> Certificate:
    """Margins of the loop including the observer, and the largest step for its modes."""
    draft, linear = Draft(own=OF_SAMPLED_LOOPS | bounded_response.OF_RESPONSES), _linear_when(problem, controller)
    if not _has_linear_loop(problem, controller):
        why = _why(problem, controller)
        draft.note(f"{why}: margins are those of linear loops that include the observer, and no error is bounded")
        draft.missing("error_bound", why, theorem=theorems.OBSERVER)
    loop = ClosedLoop.of(problem, controller)
    if problem.delay and not loop.sampled and loop.observer is not None and loop.observer.B.any():
        draft.note(
            "the observer of a continuous controller does not include the input delay, but that of a sampled controller does: "
            "give the controller a sample_time"
        )
    if linear is not None:
        bounded_response.add(draft, problem, controller, simulation.t_end)
        found = linearised(problem, controller)
        if add_loop(draft, problem, found, linear) and problem.plant.inputs == 1:
            over_known_set.add_sampled(draft, problem, found)
    elif isinstance(controller, Sampled):
        draft.note(f"the controller runs sampled every {controller.sample_time:g} s ({controller.discretization})")
        sampled_margins.add(draft, problem, controller, simulation.t_end)
    else:
        if _has_linear_loop(problem, controller):
            bounded_response.add_continuous(draft, problem, controller)
        add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def _why(problem: Problem, controller: Controller) -> str:
    if _has_linear_loop(problem, controller):
        return NO_MORE
    return NO_THEOREM if ClosedLoop.of(problem, controller).parameters else NOT_LINEAR


def _has_linear_loop(problem: Problem, controller: Controller) -> bool:
    """Whether the loop is linear, sampled or not."""
    known = isinstance(_inner(controller), KnownParameters) and problem.plant.is_linear
    return known or linear_because(problem, controller) is not None


def _inner(controller: Controller) -> Controller:
    return controller.controller if isinstance(controller, Sampled) else controller


def _linear_when(problem: Problem, controller: Controller) -> str | None:
    """The reason why a sampled controller is linear; None if it is not linear or not sampled."""
    return linear_because(problem, controller) if isinstance(controller, (L1PiecewiseConstant, Sampled)) else None


def column(problem: Problem, controller: Controller, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The class's name, and cells that state only computed values."""
    bound = certificate.entry("error_bound")
    why = _why(problem, controller) if bound is None or bound.applies else bound.why
    cells = {key: nothing(key, why) for key in ("stability", "tracking", "transient", "estimates", "modelling_error")}
    if not ClosedLoop.of(problem, controller).parameters:
        cells["estimates"] = advice("estimates", "it estimates nothing")
    cells |= {"tuning": estimate("tuning", limits_text(certificate)), "margins": margins_cell(certificate)}
    cells |= bounded_response.cells(certificate)
    return f"{type(_inner(controller)).__name__} with an observer", cells
