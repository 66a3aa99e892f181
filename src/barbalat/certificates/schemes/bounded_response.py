"""The bound of e of a sampled linear controller on the plant as it is: with its delay, actuator, sensor lag and disturbances.

``linear_loops/sampled_response`` has the theorem. Limits of the input are no part of the linear loop: the bound of |u| says
whether they are ever met.
"""

from __future__ import annotations

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import bounded_command
from barbalat.certificates.cells import statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry, NotApplicable
from barbalat.certificates.linear_loops.sampled_response import Response, bounds_of, missed, response
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.rows import up
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal, Controller
from barbalat.validate import InputError

KEYS = ("error_bound", "error_bound_held", "state_bound", "control_bound")
OF_RESPONSES = {
    "error_bound_held": Quantity(
        "of every component of x - x_m at all times, x_m of the model under the command as it is sampled"
    ),
    "state_bound": Quantity("of every component of |x|, at all times"),
    "control_bound": Quantity("of every entry of |u|, at all times"),
}
UP_TO_THE_END = Assumption("jumps of r are those up to t_end")
THE_CASE_S = Assumption("theta is the case's")
"""Holds by construction: the loop is made of it."""


def add(draft: Draft, problem: TrackingProblem, controller: Controller, t_end: float) -> None:
    """Add the bounds of e, x and u for every command and disturbance of the case's sizes; nothing where phi(x) is not x."""
    if not isinstance(problem, Problem) or not problem.plant.is_linear or not is_needed(*KEYS):
        return
    if problem.plant.states < problem.plant.n:
        why = "no bound is known beside a baseline with states of its own, which are sampled too"
        draft.all_missing(KEYS, why, theorem=theorems.SAMPLED_BASELINE)
        return
    acting = (*(() if problem.disturbance is None else (problem.disturbance,)), *(one.signal for one in problem.unmatched))
    try:  # in the order in which the loop has its signals
        found = response(problem, controller, bounds_of(problem.commands), bounds_of(acting))
    except InputError as error:
        draft.all_missing(KEYS, str(error), theorem=theorems.OUTPUT_LOOP)
        return
    rests_on = _rests_on(problem, found)
    draft.guarantee("error_bound_held", found.held, *rests_on)
    draft.guarantee("state_bound", found.x, *rests_on)
    draft.guarantee("control_bound", found.u, *rests_on)
    beside = _missed(problem, controller, t_end)
    if isinstance(beside, NotApplicable):
        draft.missing("error_bound", beside.why, *rests_on, theorem=theorems.BOUNDED_COMMAND)
    else:
        draft.guarantee("error_bound", (found.held + beside) * OUTWARD_FACTOR, *rests_on, UP_TO_THE_END)


def _missed(problem: Problem, controller: Controller, t_end: float) -> float | NotApplicable:
    """What the model makes of all commands between their samples."""
    A_m, b_r, _ = problem.model.matrices
    T, total = float(controller.sample_time), 0.0  # type: ignore[attr-defined]  # of every sampled controller
    for j, command in enumerate(problem.commands):
        found = missed(A_m, b_r[:, [j]], np.eye(len(A_m)), command, T, t_end)
        if isinstance(found, NotApplicable):
            return found
        total += found
    return total


def _rests_on(problem: Problem, found: Response) -> tuple[Assumption, ...]:
    paths, sensor = problem.plant.paths, problem.sensor
    unknown = "" if problem.derived is None else problem.derived.unmatched
    on_the_way = [
        ("a converter", any(path.quantization is not None for path in paths)),
        ("a rate limit", any(path.rate_limit is not None for path in paths)),
        ("a history of the input", any(path.history != 0 for path in paths)),
    ]
    acting = [problem.disturbance, *(one.signal for one in problem.unmatched)]
    unbounded = any(one is not None and not isinstance(one, BoundedSignal) for one in acting)
    noise = sensor is not None and sensor.noise is not None
    limits = [tuple(map(float, path.saturation)) for path in paths if path.saturation is not None]
    beyond = any(found.u > min(-low, high) for low, high in limits)
    reached = f"u may reach {found.u:.4g}, beyond its limits" if beyond else ""
    noisy = "Gaussian measurement noise has no bound" if noise else ""
    return (
        Assumption("the plant is linear, with its delay and its dynamics before it", unknown, theorems.UNMATCHED_RESTS),
        Assumption("nothing but a delay, an actuator and limits stands before the plant", _listed(on_the_way), theorems.LIMITS),
        Assumption("u stays within its limits", reached, theorems.LIMITS),
        Assumption("disturbances are bounded", "a disturbance without a bound" if unbounded else "", theorems.OUTPUT_LOOP),
        Assumption("what is measured has no noise", noisy, theorems.MEASUREMENT),
        bounded_command(problem),
        THE_CASE_S,
    )


def _listed(words: list[tuple[str, bool]]) -> str:
    return ", ".join(word for word, there in words if there)


def cells(certificate: Certificate) -> dict[str, Entry]:
    """The cells of Table 1 that follow where the bounds are guaranteed; none where they are not."""
    state, error = certificate.entry("state_bound"), certificate.entry("error_bound")
    found = {}
    if state is not None and state.kind == "guaranteed":
        text = f"for every r and d of the case's sizes: |x| <= {up(state.value)}"
        found["stability"] = statement("stability", text, *state.rests_on)
    if state is not None and error is not None and error.kind == "guaranteed":
        text = f"|e| <= {up(error.value)} at all times, for every r and d of the case's sizes"
        found["transient"] = statement("transient", text, *error.rests_on)
    return found
