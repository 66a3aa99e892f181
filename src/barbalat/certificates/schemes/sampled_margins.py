"""Margins of a sampled controller that is not linear, from its sampled-data loop linearised at the equilibrium.

The margins are computed with the estimates frozen at their true values, and with the law. For phi(x) = x the frozen loop is
linear for every command.
"""

from __future__ import annotations

from dataclasses import replace

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import UNSTABLE_WITH_LAW, finite, in_the_loop
from barbalat.certificates.linear_loops.sampled_rest import ON_A_FACE, SampledRest, adapting_of, sampled_rest
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.sampled_loop import add_loop
from barbalat.controllers import Sampled
from barbalat.linear.largest import largest, largest_from
from barbalat.linear.sampled_loop import MOST_SAMPLES_OF_DELAY, delay_margin
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import InputError

FROZEN = "in sampled-data form with its estimates frozen"
WITH_ITS_LAW = "in sampled-data form with its law"
LONGER_SAMPLE, SHORTER_SAMPLE = 1.4, 2.0
"""Ratio of successive sample times, up and down from the actual sample time; the first loss of stability counts."""
LONGEST_SAMPLE = 100.0
"""Range of the search as a multiple of the actual sample time, up and down; it also ends when the delay exceeds
``MOST_SAMPLES_OF_DELAY``."""
SAMPLE_TIME_WITHIN = 2e-3
NOT_SETTLING = 1e-10
"""Distance of a spectral radius from 1 within which a mode neither grows nor decays, for example the mode of a vanished
covariance.
"""


def add(draft: Draft, problem: TrackingProblem, controller: Sampled, t_end: float) -> None:
    """Add the margins with frozen estimates and with the law, and the longest sample time, or the reason why they do not
    exist."""
    adapting = adapting_of(problem, controller.controller)
    still = sampled_rest(problem, controller, adapting, frozen=True)
    if isinstance(still, NotApplicable):
        draft.missing("delay_margin", still.why)
    else:
        with draft.part("delay_margin"):
            _add_frozen(draft, problem, still)
    if adapting:
        with draft.part("delay_margin_adapting"):
            _add_adapting(draft, problem, controller, adapting)
    else:
        bounded_response.add(draft, problem, controller, t_end)


def _add_frozen(draft: Draft, problem: TrackingProblem, still: SampledRest) -> None:
    where = f", where {still.found.where}" if still.found.estimates else ""
    name = f"{FROZEN}{where}, broken at the plant input{in_the_loop(problem)}"
    stable = add_loop(draft, problem, still.with_estimates_frozen(), LINEAR_LOOP_ONLY, name, still.found)
    if not (stable and still.ideal and isinstance(problem, Problem) and problem.input_gain is None):
        return
    if problem.plant.inputs == 1 and problem.plant.is_linear:
        over_known_set.add_sampled_at(draft, problem, still.at, FROZEN)


def _add_adapting(draft: Draft, problem: TrackingProblem, controller: Sampled, adapting: frozenset[str]) -> None:
    moving = sampled_rest(problem, controller, adapting, frozen=False)
    why = moving.why if isinstance(moving, NotApplicable) else ON_A_FACE if moving.has_a_corner else ""
    if isinstance(moving, NotApplicable) or why:
        draft.missing("delay_margin_adapting", why)
        return
    loop, rest = moving.with_its_law(), moving.found
    name = f"{WITH_ITS_LAW}, where {rest.where}{in_the_loop(problem)}"
    radius = loop.radius(problem.delay)
    if abs(radius - 1) < NOT_SETTLING:
        draft.missing("delay_margin_adapting", "at the equilibrium the law has a mode that neither grows nor decays")
        return
    draft.exact({"spectral_radius_adapting": radius}, name, LINEAR_LOOP_ONLY, rest=rest)
    if is_needed("sample_time_max"):
        longest = _longest(problem, controller, adapting, stable=radius < 1)
        draft.exact({"sample_time_max": longest}, name, LINEAR_LOOP_ONLY, rest=rest)
    if radius >= 1:
        draft.missing("delay_margin_adapting", f"{UNSTABLE_WITH_LAW}: its spectral radius is {radius:.6g}")
    elif is_needed("delay_margin_adapting") and loop.inputs == 1:
        try:
            draft.exact({"delay_margin_adapting": finite(delay_margin(loop, problem.delay))}, name, LINEAR_LOOP_ONLY, rest=rest)
        except InputError as error:
            draft.missing("delay_margin_adapting", str(error))


def _longest(problem: TrackingProblem, controller: Sampled, adapting: frozenset[str], *, stable: bool) -> float | NotApplicable:
    """The sample time up to which the loop with its law is stable: at the first loss above or below the actual sample time."""

    def tolerates(T: float) -> bool:
        rest = sampled_rest(problem, replace(controller, sample_time=T), adapting, frozen=False)
        return isinstance(rest, SampledRest) and rest.with_its_law().radius(problem.delay) < 1

    T = controller.sample_time
    if not stable:
        least = max(T / LONGEST_SAMPLE, problem.delay / MOST_SAMPLES_OF_DELAY)
        found = largest_from(tolerates, T, factor=SHORTER_SAMPLE, within=SAMPLE_TIME_WITHIN, least=least)
        return found or NotApplicable(f"no sample time down to {least:.3g} s was found to be stable")
    low = T
    while tolerates(low * LONGER_SAMPLE):
        low *= LONGER_SAMPLE
        if low > LONGEST_SAMPLE * T:
            return NotApplicable(f"stable at every sample time tried, up to {low:.3g} s")
    return largest(tolerates, low, low * LONGER_SAMPLE, within=SAMPLE_TIME_WITHIN)
