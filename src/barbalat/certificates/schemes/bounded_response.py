"""The bound on e for a linear controller on the actual plant with actuator, sensor lag and disturbances and, if it is sampled, a
delay.

``linear_loops/sampled_response`` and ``linear_loops/continuous_response`` have the theorems. The linear loop has no input limits;
the bound on |u| shows whether limits are ever reached.
"""

from __future__ import annotations

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import THE_CASE_S, bounded_command
from barbalat.certificates.cells import statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry, NotApplicable
from barbalat.certificates.linear_loops import continuous_response
from barbalat.certificates.linear_loops.margin_values import in_the_loop
from barbalat.certificates.linear_loops.sampled_response import (
    Sizes,
    bounds_of,
    disturbances,
    missed,
    noise_deviation,
    response,
)
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.requested_keys import is_left_out, is_needed
from barbalat.certificates.rows import up
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.sampled_norms import UNSTABLE
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal, Controller
from barbalat.validate import InputError

KEYS = ("error_bound", "error_bound_held", "state_bound", "control_bound")
OF_CONTINUOUS_LOOPS = ("error_bound", "state_bound", "control_bound")
OF_NOISE = ("error_noise_rms", "control_noise_rms")
OF_RESPONSES = {
    "error_bound_held": Quantity(
        "bound on every component of x - x_m at all times, where x_m is the model's state under the sampled command"
    ),
    "state_bound": Quantity("bound on every component of |x|, at all times"),
    "control_bound": Quantity("bound on every entry of |u|, at all times"),
    "error_noise_rms": Quantity("bound on the standard deviation that measurement noise adds to x - x_m, component by component"),
    "control_noise_rms": Quantity("bound on the standard deviation that measurement noise adds to u, input by input"),
    "error_rms_bound": Quantity("bound on the root mean square of every component of x - x_m over all realisations of the noise"),
}
UP_TO_THE_END = Assumption("only the jumps of r up to t_end are considered")
INDEPENDENT = Assumption("the noise of different samples is independent and has zero mean")
RMS = "error_rms_bound"
OF_THE_LOOP = "in sampled-data form with the case's theta"
SAME_INSTANT = 1e-9
"""Relative difference up to which two sample times count as equal."""


def add(draft: Draft, problem: TrackingProblem, controller: Controller, t_end: float) -> None:
    """Add the bounds on e, x and u for every command and disturbance no larger than those of the case; add nothing if phi(x) is
    not x."""
    if not isinstance(problem, Problem) or not problem.plant.is_linear or not is_needed(*KEYS, *OF_NOISE, RMS):
        return
    if problem.plant.states < problem.plant.n:
        why = "no bound is known with a dynamic baseline, whose states are also sampled"
        draft.all_missing(KEYS, why, theorem=theorems.SAMPLED_BASELINE)
        return
    try:
        found = response(problem, controller, Sizes.of(problem))
    except InputError as error:
        theorem = theorems.LINEAR_UNSTABLE if str(error) == UNSTABLE else theorems.OUTPUT_LOOP
        draft.all_missing(KEYS, str(error), theorem=theorem)
        return
    _note_gain(draft, problem)
    linear = *_linear(problem, found.u), _bounded_noise(problem)
    draft.guarantee("error_bound_held", found.held, *linear)
    draft.guarantee("state_bound", found.x, *linear)
    draft.guarantee("control_bound", found.u, *linear)
    beside = _missed(problem, controller, t_end)
    if isinstance(beside, NotApplicable):
        draft.missing("error_bound", beside.why, *linear, theorem=theorems.BOUNDED_COMMAND)
    else:
        draft.guarantee("error_bound", (found.held + beside) * OUTWARD_FACTOR, *linear, UP_TO_THE_END)
    if problem.noise is not None:
        quiet = found if problem.noise.bound is None else response(problem, controller, Sizes.of(problem, noisy=False))
        _add_noise(draft, problem, controller, linear[:-1], None if isinstance(beside, NotApplicable) else quiet.held + beside)


def add_continuous(draft: Draft, problem: TrackingProblem, controller: Controller) -> None:
    """Add the same bounds for a continuous controller; a bound on e that applies, for the whole known set, is kept."""
    if not isinstance(problem, Problem) or is_left_out("state_bound") or not is_needed(*OF_CONTINUOUS_LOOPS):
        return
    known = draft.entries.get("error_bound")
    keys = [key for key in OF_CONTINUOUS_LOOPS if key != "error_bound" or known is None or not known.applies]
    if not problem.plant.is_linear or not is_needed(*keys):
        return
    if problem.delay:
        why = f"the input has a delay of {problem.delay:g} s, with which only controllers with a sample_time have a bound"
        draft.all_missing(keys, why, theorem=theorems.LINEAR_DELAY)
        return
    try:
        found = continuous_response.response(problem, controller, bounds_of(problem.commands), bounds_of(disturbances(problem)))
    except InputError as error:
        unstable = str(error) == continuous_response.UNSTABLE
        draft.all_missing(keys, str(error), theorem=theorems.LINEAR_UNSTABLE if unstable else theorems.OUTPUT_LOOP)
        return
    if "error_bound" in keys:
        _note_gain(draft, problem)
    rests_on = *_linear(problem, found.u, sampled=False), _quiet(problem), _smooth(problem)
    for key, value in zip(OF_CONTINUOUS_LOOPS, found, strict=True):
        if key in keys:
            draft.guarantee(key, value, *rests_on)


def _note_gain(draft: Draft, problem: Problem) -> None:
    if problem.input_gain is not None:
        draft.note("bounds on e, x and u hold for the case's input gain, not for all of uncertainty.input_gain")


def is_for_the_case(entry: Entry | None) -> bool:
    """Whether a bound holds for the case's theta alone, and not for the whole known set."""
    return entry is not None and THE_CASE_S in entry.rests_on


def _add_noise(
    draft: Draft, problem: Problem, controller: Controller, linear: tuple[Assumption, ...], error: float | None
) -> None:
    """Add the contribution of the noise and, together with the bound on e without noise, the root mean square of both."""
    assert problem.noise is not None
    T = float(controller.sample_time)  # type: ignore[attr-defined]  # of every sampled controller
    if problem.noise.sample_time > T * (1 + SAME_INSTANT):
        why = f"the noise is held for {problem.noise.sample_time:g} s, longer than a sample, so the samples are not independent"
        draft.all_missing((*OF_NOISE, RMS), why)
        return
    try:
        found = noise_deviation(problem, controller)
    except InputError as failed:
        draft.all_missing((*OF_NOISE, RMS), str(failed))
        return
    unlimited = _never_limited(problem)
    values = {"error_noise_rms": found.x.tolist(), "control_noise_rms": found.u.tolist()}
    own = (*linear, unlimited, _smooth(problem))
    if any(one.broken for one in own):
        draft.estimate(values, INDEPENDENT.sentence, of=OF_THE_LOOP + in_the_loop(problem))
    else:
        for key, value in values.items():
            draft.guarantee(key, value, *own, INDEPENDENT)
    if error is not None:
        rms = (error + float(found.x.max())) * OUTWARD_FACTOR
        draft.guarantee(RMS, rms, *linear, unlimited, INDEPENDENT, UP_TO_THE_END)


def _missed(problem: Problem, controller: Controller, t_end: float) -> float | NotApplicable:
    """The contribution of all commands between the model's samples."""
    A_m, b_r, _ = problem.model.matrices
    T, total = float(controller.sample_time), 0.0  # type: ignore[attr-defined]  # of every sampled controller
    for j, command in enumerate(problem.commands):
        found = missed(A_m, b_r[:, [j]], np.eye(len(A_m)), command, T, t_end)
        if isinstance(found, NotApplicable):
            return found
        total += found
    return total


def _linear(problem: Problem, u: float, *, sampled: bool = True) -> tuple[Assumption, ...]:
    """The assumptions of the bounds for the linear loop, apart from the noise. A ``sampled`` one may have converters."""
    paths = problem.plant.paths
    unknown = "" if problem.derived is None else problem.derived.unmatched
    on_the_way = [
        ("a converter", not sampled and any(path.quantization is not None for path in paths)),
        ("a rate limit", any(path.rate_limit is not None for path in paths)),
        ("a history of the input", any(path.history != 0 for path in paths)),
    ]
    acting = [problem.disturbance, *(one.signal for one in problem.unmatched)]
    unbounded = any(one is not None and not isinstance(one, BoundedSignal) for one in acting)
    limits = [tuple(map(float, path.saturation)) for path in paths if path.saturation is not None]
    beyond = any(u > min(-low, high) for low, high in limits)
    reached = f"u may reach {u:.4g}, beyond its limits" if beyond else ""
    return (
        Assumption("the plant is linear, including its delay and its input dynamics", unknown, theorems.UNMATCHED_RESTS),
        Assumption(
            f"the plant has no input dynamics other than a delay, an actuator{', a converter' if sampled else ''} and limits",
            _listed(on_the_way),
            theorems.LIMITS,
        ),
        Assumption("u stays within its limits", reached, theorems.LINEAR_LIMITS),
        Assumption("disturbances are bounded", "a disturbance without a bound" if unbounded else "", theorems.OUTPUT_LOOP),
        bounded_command(problem),
        THE_CASE_S,
    )


def _bounded_noise(problem: Problem) -> Assumption:
    unbounded = problem.noise is not None and problem.noise.bound is None
    return Assumption("measurement noise has a bound", "Gaussian measurement noise" if unbounded else "", theorems.GAUSSIAN)


def _quiet(problem: Problem) -> Assumption:
    if problem.noise is None or problem.noise.bound is None:
        noisy = "" if problem.noise is None else "Gaussian measurement noise"
        return Assumption("the measurement has no noise", noisy, theorems.GAUSSIAN)
    why = "measurement noise, with which only controllers with a sample_time have a bound"
    return Assumption("the measurement has no noise", why, theorems.LINEAR_ADDITIONS)


def _smooth(problem: Problem) -> Assumption:
    """Nothing in the loop is rounded, so its response is linear."""
    rounding = [
        ("a quantised measurement", problem.sensor is not None and problem.sensor.quantization is not None),
        ("a converter", any(path.quantization is not None for path in problem.plant.paths)),
    ]
    return Assumption("nothing in the loop is quantised", _listed(rounding), theorems.MEASUREMENT)


def _never_limited(problem: Problem) -> Assumption:
    gaussian = problem.noise is not None and problem.noise.bound is None
    limited = gaussian and any(path.saturation is not None for path in problem.plant.paths)
    return Assumption(
        "noise never drives u to its limits", "Gaussian noise may drive u beyond its limits" if limited else "", theorems.LIMITS
    )


def _listed(words: list[tuple[str, bool]]) -> str:
    return ", ".join(word for word, there in words if there)


def cells(certificate: Certificate) -> dict[str, Entry]:
    """The cells of Table 1 that follow if the bounds are guaranteed; otherwise no cells."""
    state, error = certificate.entry("state_bound"), certificate.entry("error_bound")
    found, within = {}, "for every r and d within the case's bounds, with the case's theta and input gain only"
    if state is not None and state.kind == "guaranteed":
        text = f"{within}: |x| <= {up(state.value)}"
        found["stability"] = statement("stability", text, *state.rests_on)
    if state is not None and error is not None and error.kind == "guaranteed":
        text = f"|e| <= {up(error.value)} at all times, {within}"
        found["transient"] = statement("transient", text, *error.rests_on)
    return found
