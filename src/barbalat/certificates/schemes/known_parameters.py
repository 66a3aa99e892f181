"""The certificate of the controller that knows the parameters: if these are the true ones, the closed loop is the reference
model."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import of_linear_loop
from barbalat.certificates.cells import advice, estimate, margins_cell, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.state_feedback import commands_and_gains, of_the_case
from barbalat.certificates.schemes.unregistered import add_linearised
from barbalat.controllers import KnownParameters
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def certificate(problem: Problem, controller: KnownParameters, simulation: Simulation) -> Certificate:
    """The bound of the linear loop; margins and the step limit, by exact linearisation."""
    draft = Draft(own=bounded_response.OF_RESPONSES)
    if not problem.plant.is_linear:
        draft.guarantee("error_bound", 0.0, *_rests_on(problem, controller))
    bounded_response.add_continuous(draft, problem, controller)
    add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def grounds(_: Problem, controller: KnownParameters, __: Simulation) -> dict[str, Any]:
    """The parameters."""
    return {"scheme": "known-parameters", "theta": controller.theta.tolist()}


def column(problem: Problem, controller: KnownParameters, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    rests_on = _rests_on(problem, controller)
    cells = {} if not any(one.broken for one in rests_on) else bounded_response.cells(certificate)
    return "known parameters, u = k_0 r - theta'phi(x)", {
        "stability": statement("stability", f"for {commands_and_gains(problem)[0]}", *rests_on),
        "tracking": statement("tracking", "x is x_m", *rests_on),
        "transient": statement("transient", "e is zero at all times", *rests_on),
        "estimates": advice("estimates", "it estimates nothing"),
        "modelling_error": estimate("modelling_error", "see the margins"),
        "tuning": advice("tuning", "no adaptive gain"),
        "margins": margins_cell(certificate),
    } | cells


def _rests_on(problem: Problem, controller: KnownParameters) -> tuple[Assumption, ...]:
    """The assumptions under which the closed loop is the model."""
    given = "" if np.array_equal(controller.theta, problem.parameters) else "parameters other than the plant's"
    own = Assumption("the parameters are the plant's", given, theorems.OTHER_PARAMETERS)
    return of_linear_loop(*of_the_case(problem, None, 0.0), own)
