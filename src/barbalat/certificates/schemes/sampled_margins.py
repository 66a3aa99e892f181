"""Margins of a sampled controller that is no linear one: of its loop linearised from sample to sample where it rests.

With the estimates frozen at their true values, and with its law. For phi(x) = x the frozen loop is linear, whatever the command.
"""

from __future__ import annotations

from dataclasses import replace

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import finite, in_the_loop
from barbalat.certificates.linear_loops.sampled_rest import ON_A_FACE, SampledRest, adapting_of, sampled_rest
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.sampled_loop import add_loop, unstable
from barbalat.controllers import Sampled
from barbalat.linear.largest import largest, largest_from
from barbalat.linear.sampled_loop import MOST_SAMPLES_OF_DELAY, delay_margin
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import InputError

FROZEN = "from sample to sample with its estimates frozen"
WITH_ITS_LAW = "from sample to sample with its law"
LONGER_SAMPLE, SHORTER_SAMPLE = 1.4, 2.0
"""Between two sample times that are tried, up and down from the present one: the first loss of stability counts."""
LONGEST_SAMPLE = 100.0
"""Of the present one, up and down: beyond it no limit is looked for, nor where a delay takes ``MOST_SAMPLES_OF_DELAY``."""
SAMPLE_TIME_WITHIN = 2e-3
NOT_SETTLING = 1e-10
"""Of a spectral radius to 1: a covariance that has died out, and what else a law does not return from."""


def add(draft: Draft, problem: TrackingProblem, controller: Sampled, t_end: float) -> None:
    """Add the margins with the estimates frozen and with the law, and the longest sample time; or why there are none."""
    still = sampled_rest(problem, controller, controller.controller, frozen=True)
    if isinstance(still, NotApplicable):
        draft.missing("delay_margin", still.why)
    else:
        with draft.part("delay_margin"):
            _add_frozen(draft, problem, still)
    if still_adapts(problem, controller):
        with draft.part("delay_margin_adapting"):
            _add_adapting(draft, problem, controller)
    else:
        bounded_response.add(draft, problem, controller, t_end)


def still_adapts(problem: TrackingProblem, controller: Sampled) -> bool:
    """Whether anything is estimated."""
    return bool(adapting_of(problem, controller.controller))


def _add_frozen(draft: Draft, problem: TrackingProblem, still: SampledRest) -> None:
    where = f", where {still.found.where}" if still.found.estimates else ""
    name = f"{FROZEN}{where}, broken at the plant input{in_the_loop(problem)}"
    stable = add_loop(draft, problem, still.with_estimates_frozen(), LINEAR_LOOP_ONLY, name, still.found)
    if not (stable and still.ideal and isinstance(problem, Problem) and problem.input_gain is None):
        return
    if problem.plant.inputs == 1 and problem.plant.is_linear:
        over_known_set.add_sampled_at(draft, problem, still.at, FROZEN)


def _add_adapting(draft: Draft, problem: TrackingProblem, controller: Sampled) -> None:
    moving = sampled_rest(problem, controller, controller.controller, frozen=False)
    why = moving.why if isinstance(moving, NotApplicable) else ON_A_FACE if moving.has_a_corner else ""
    if isinstance(moving, NotApplicable) or why:
        draft.missing("delay_margin_adapting", why)
        return
    loop, rest = moving.with_its_law(), moving.found
    name = f"{WITH_ITS_LAW}, where {rest.where}{in_the_loop(problem)}"
    radius = loop.radius(problem.delay)
    if abs(radius - 1) < NOT_SETTLING:
        draft.missing("delay_margin_adapting", "where it rests the law has a part that neither grows nor dies out")
        return
    draft.exact({"spectral_radius_adapting": radius}, name, LINEAR_LOOP_ONLY, rest=rest)
    if is_needed("sample_time_max"):
        longest = _longest(problem, controller, radius < 1)
        draft.exact({"sample_time_max": longest}, name, LINEAR_LOOP_ONLY, rest=rest)
    if radius >= 1:
        draft.missing("delay_margin_adapting", unstable(radius))
    elif is_needed("delay_margin_adapting") and loop.inputs == 1:
        try:
            draft.exact({"delay_margin_adapting": finite(delay_margin(loop, problem.delay))}, name, LINEAR_LOOP_ONLY, rest=rest)
        except InputError as error:
            draft.missing("delay_margin_adapting", str(error))


def _longest(problem: TrackingProblem, controller: Sampled, stable: bool) -> float | NotApplicable:
    """The sample time up to which the loop with its law is stable: of the first loss above the present one, or of one below."""

    def bears(T: float) -> bool:
        rest = sampled_rest(problem, replace(controller, sample_time=T), controller.controller, frozen=False)
        return isinstance(rest, SampledRest) and rest.with_its_law().radius(problem.delay) < 1

    T = controller.sample_time
    if not stable:
        least = max(T / LONGEST_SAMPLE, problem.delay / MOST_SAMPLES_OF_DELAY)
        found = largest_from(bears, T, factor=SHORTER_SAMPLE, within=SAMPLE_TIME_WITHIN, least=least)
        return found or NotApplicable(f"no sample time down to {least:.3g} s was found stable")
    low = T
    while bears(low * LONGER_SAMPLE):
        low *= LONGER_SAMPLE
        if low > LONGEST_SAMPLE * T:
            return NotApplicable(f"stable at every sample time that was tried, up to {low:.3g} s")
    return largest(bears, low, low * LONGER_SAMPLE, within=SAMPLE_TIME_WITHIN)
