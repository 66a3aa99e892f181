"""The margins of linear loops over the known set, and mu against it, under the certificate's keys.

A sampled loop is looked at in the extreme points and the case's theta, for stability in seeded points too. One delay margin
from sample to sample takes as long as a hundred of the others: it is computed where the phase margin over its frequency is
least.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS
from barbalat.certificates.linear_loops.worst_case import (
    EXACT_VERTICES,
    MARGIN_NAMES,
    LoopsOverTheta,
    WorstCase,
    points_inside,
    worst_case,
)
from barbalat.certificates.requested_keys import is_needed
from barbalat.linear.margins import Margins, margins
from barbalat.linear.robust_stability import MatchedFamily, RobustStability, robust_stability
from barbalat.linear.sampled_loop import SampledLoop, delay_margin
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.known_set import KnownSet
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array, InputError

POINTS_INSIDE, DELAYS = 100, 3
"""Seeded points at which stability alone is asked for, and points at which the delay margin is computed."""
SEARCHED = (
    "from sample to sample: the set's {extremes} extreme points, the case's theta, {inside} seeded points inside for stability "
    "alone; the delay margin at the {delays} where the phase margin over its frequency is least: the least found, no guarantee"
)


def sampled_worst_case(loop_at: Callable[[Array], SampledLoop], delay: float, known_set: KnownSet, theta: Array) -> WorstCase:
    """The least margins beside ``delay`` of one input's loop; ``loop_at`` gives it for a theta."""
    rng = np.random.default_rng(0)
    extremes = known_set.extreme_points(rng, EXACT_VERTICES)
    own = np.reshape([theta] if known_set.contains(theta) else [], (-1, known_set.size))
    inside = points_inside(known_set, rng, np.mean(known_set.extent, axis=0), 1.0, POINTS_INSIDE)
    looked_at = np.concatenate([extremes, own])
    searched = SEARCHED.format(extremes=len(extremes), inside=POINTS_INSIDE, delays=min(DELAYS, len(looked_at)))
    points = np.concatenate([looked_at, inside])
    radii = np.array([loop_at(point).radius(delay) for point in points])
    if radii.max() >= 1:
        return WorstCase({}, points[int(radii.argmax())], searched)
    found = [margins(loop_at(point).as_continuous(delay)) for point in looked_at]
    least = {name: _least(name, found, looked_at) for name in MARGIN_NAMES if name != "delay"}
    order = np.argsort([one.delay for one in found], kind="stable")[:DELAYS]
    delays = [(value, looked_at[k]) for k in order if (value := _delay(loop_at(looked_at[k]), delay)) is not None]
    if delays:
        least["delay"] = min(delays, key=lambda one: one[0])
    return WorstCase(least, None, searched)


def _least(name: str, found: list[Margins], points: Array) -> tuple[float, Array]:
    """The least of a margin and where; of a factor below 1 the largest."""
    values = np.array([getattr(one, name) for one in found])
    k = int(values.argmax() if name == "gain_down" else values.argmin())
    return float(values[k]), points[k]


def _delay(loop: SampledLoop, delay: float) -> float | None:
    """The delay margin; None where none is found up to the longest delay that is tried."""
    try:
        return delay_margin(loop, delay)
    except InputError:
        return None


MARGINS_KEY = "margins_over_known_set"
LOOP_AT_REST = "with the estimates at rest on theta"
LOOP_OF_FAST_ADAPTATION = "in the limit of fast adaptation"


def add_at_rest(draft: Draft, problem: Problem) -> None:
    """Add the margins over the known set of the loop that every scheme with C = 1 becomes; nothing without a known set."""
    known_set = problem.uncertainty
    if known_set is not None and is_needed(MARGINS_KEY):
        with draft.part(MARGINS_KEY):
            _add(draft, [(LOOP_AT_REST, _worst_at_rest(problem.plant, known_set, problem.sensor_lag))])


def add_filtered(draft: Draft, problem: Problem, C: StateSpace) -> None:
    """Add the margins over the known set for L1-AC's two readings: the limit of fast adaptation, and the estimates at rest."""
    known_set = problem.uncertainty
    if known_set is not None and is_needed(MARGINS_KEY):
        with draft.part(MARGINS_KEY):
            _add(draft, _worst_filtered(problem.plant, known_set, C, problem.sensor_lag))


def add_fixed(draft: Draft, problem: Problem, family: LoopsOverTheta) -> None:
    """Add the margins over the known set of a linear controller's loop."""
    known_set = problem.uncertainty
    if known_set is not None and is_needed(MARGINS_KEY):
        with draft.part(MARGINS_KEY):
            _add(draft, [("with a fixed controller", worst_case(family, known_set))])


def add_sampled(draft: Draft, problem: Problem, found: Linearised) -> None:
    """Add the margins over the known set of a linear controller's loop from sample to sample, for one input and phi(x) = x."""
    plant = problem.plant
    add_sampled_at(
        draft, problem, lambda theta: found.beside(plant.b, theta - plant.theta), "from sample to sample with a fixed controller"
    )


def add_sampled_at(draft: Draft, problem: Problem, loop_at: Callable[[Array], SampledLoop], which: str) -> None:
    """The same of the loop that is given for each theta, which ``which`` names."""
    known_set, plant = problem.uncertainty, problem.plant
    if known_set is None or not is_needed(MARGINS_KEY):
        return
    with draft.part(MARGINS_KEY):
        _add(draft, [(which, sampled_worst_case(loop_at, problem.delay, known_set, plant.theta))])


@lru_cache(maxsize=16)
def _worst_at_rest(plant: Plant, known_set: KnownSet, lag: StateSpace | None) -> WorstCase:
    """The worst case of the loop at rest, which several schemes of one case share."""
    return worst_case(LoopsOverTheta(plant, lambda plant: known_parameters(plant, plant.theta), lag), known_set)


@lru_cache(maxsize=16)
def _worst_filtered(plant: Plant, known_set: KnownSet, C: StateSpace, lag: StateSpace | None) -> list[tuple[str, WorstCase]]:
    """The worst cases of L1-AC's two readings, which L1-ACs of one case that differ in the gain alone share."""
    families = {
        LOOP_OF_FAST_ADAPTATION: LoopsOverTheta(plant, lambda plant: fast_adaptation(plant, C), lag),
        LOOP_AT_REST: LoopsOverTheta(plant, lambda plant: known_parameters(plant, plant.theta, C), lag),
    }
    return [(which, worst_case(family, known_set)) for which, family in families.items()]


def _add(draft: Draft, found: list[tuple[str, WorstCase]]) -> None:
    draft.estimate({MARGINS_KEY: [_of_one_loop(draft, which, worst) for which, worst in found]}, LINEAR_LOOP_ONLY)


def _of_one_loop(draft: Draft, which: str, worst: WorstCase) -> dict[str, Any]:
    """JSON for one loop: each finite margin with its theta, beside the delay that the plant has."""
    entry: dict[str, Any] = {"loop": which, "searched": worst.searched, "unlimited": []}
    unstable_at = worst.unstable_at
    if unstable_at is not None:
        draft.note(f"linear loop {which}: unstable at theta = [{', '.join(f'{v:.4g}' for v in unstable_at)}] of the known set")
        return entry | {"unstable_at": unstable_at.tolist()}
    for name, (value, theta) in worst.least.items():
        if np.isfinite(value):
            entry[KEYS_OF_MARGINS[name]] = {"value": value, "theta": theta.tolist()}
        else:
            entry["unlimited"].append(KEYS_OF_MARGINS[name])
    return entry


MU_KEYS = ("mu_parameters", "parameter_scale", "theta_destabilising", "mu_dynamics", "mu", "mu_frequency")


def robustness(
    loop: StateSpace, known_set: KnownSet | None, weight: TransferFunction | None, findings: list[str]
) -> dict[str, Any]:
    """mu against the known set, against the unmodelled dynamics of size ``weight``, and against both, by the certificate's keys.

    ``loop`` stands at the set's centre, or where there is none, at the true theta.
    """
    values: dict[str, Any] = {}
    if not is_needed(*MU_KEYS):
        return values

    def measure(width: Array, weight: TransferFunction | None) -> RobustStability:
        return robust_stability(MatchedFamily(loop=loop, width=width, weight=weight))

    width = np.zeros(1) if known_set is None else known_set.extent[1] - known_set.middle
    try:
        if known_set is not None:
            found = measure(width, None)
            values |= {"mu_parameters": found.peak, "parameter_scale": found.scale if found.peak > 0 else None}
            if found.delta is not None:
                values["theta_destabilising"] = (known_set.middle + width * found.delta).tolist()
            if not known_set.fills_its_extent:
                findings.append("mu is that of the box around the known set: more than the set's own")
        if weight is not None:
            values["mu_dynamics"] = measure(0 * width, weight).peak
            if known_set is not None:
                both = measure(width, weight)
                values |= {"mu": both.peak, "mu_frequency": both.frequency}
    except InputError as error:
        findings.append(str(error))
    return values
