"""The margins of linear loops over the known set, and mu with respect to the set, under the keys of the certificate.

A sampled loop is analysed at the extreme points and at the theta of the case, and also checked for stability at seeded points; an
input gain of the known set is varied with theta. A delay margin of a sampled loop takes as long as a hundred other margins, so it
is computed only where the ratio of phase margin to frequency is smallest. A set that follows from ranges of physical parameters
is not searched (see ``over_ranges``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.linear_loops import over_ranges
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation, fast_adaptation_on, known_parameters
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS
from barbalat.certificates.linear_loops.over_ranges import MARGINS_KEY, PlantAt
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
"""Seeded points at which only stability is checked, and points at which the delay margin is computed."""
SEARCHED = (
    "the smallest found for the sampled-data loop, not a guarantee. The search tries the set's {extremes} extreme "
    "points{varied}, the case's theta and, for stability only, {inside} seeded points inside; the delay margin is computed at "
    "the {delays} points with the smallest ratio of phase margin to frequency"
)


def sampled_worst_case(
    loop_at: Callable[[Array], SampledLoop],
    delay: float,
    known_set: KnownSet,
    theta: Array,
    gain: float = 1.0,
    gains: tuple[float, float] | None = None,
) -> WorstCase:
    """The smallest margins of the loop at one input, in addition to ``delay``; ``loop_at`` gives the loop for a theta.

    With ``gains``, the input gain, which is ``gain`` in these loops, varies over that interval and is the last entry of each
    point.
    """
    rng, p = np.random.default_rng(0), known_set.size
    extremes = known_set.extreme_points(rng, EXACT_VERTICES)
    own = np.reshape([theta] if known_set.contains(theta) else [], (-1, p))
    inside = points_inside(known_set, rng, np.mean(known_set.extent, axis=0), 1.0, POINTS_INSIDE)
    count, varied = len(extremes), ""
    if gains is not None:
        omegas = np.unique([gains[0], sum(gains) / 2, gains[1]])
        extremes = np.column_stack([np.repeat(extremes, len(omegas), axis=0), np.tile(omegas, count)])
        own = np.insert(own, p, gain, axis=1) if gains[0] <= gain <= gains[1] else np.zeros((0, p + 1))
        inside = np.column_stack([inside, rng.uniform(*gains, len(inside))])
        varied = f" with omega = {', '.join(f'{one:.4g}' for one in omegas)}"

    def loop_of(point: Array) -> SampledLoop:
        loop = loop_at(point[:p])
        return loop if gains is None else replace(loop, E=point[p] / gain * loop.E)

    looked_at = np.concatenate([extremes, own])
    searched = SEARCHED.format(extremes=count, varied=varied, inside=POINTS_INSIDE, delays=min(DELAYS, len(looked_at)))
    points = np.concatenate([looked_at, inside])
    radii = np.array([loop_of(point).radius(delay) for point in points])
    if radii.max() >= 1:
        return WorstCase({}, points[int(radii.argmax())], searched)
    found = [margins(loop_of(point).as_continuous(delay)) for point in looked_at]
    least = {name: _least(name, found, looked_at) for name in MARGIN_NAMES if name != "delay"}
    order = np.argsort([one.delay for one in found], kind="stable")[:DELAYS]
    delays = [(value, looked_at[k]) for k in order if (value := _delay(loop_of(looked_at[k]), delay)) is not None]
    if delays:
        least["delay"] = min(delays, key=lambda one: one[0])
    return WorstCase(least, None, searched)


def _least(name: str, found: list[Margins], points: Array) -> tuple[float, Array]:
    """The smallest value of a margin and where it occurs; for a factor below 1, the largest value."""
    values = np.array([getattr(one, name) for one in found])
    k = int(values.argmax() if name == "gain_down" else values.argmin())
    return float(values[k]), points[k]


def _delay(loop: SampledLoop, delay: float) -> float | None:
    """The delay margin; None if there is none up to the longest delay tried."""
    try:
        return delay_margin(loop, delay)
    except InputError:
        return None


LOOP_AT_REST = "with the estimates fixed at theta"
LOOP_OF_FAST_ADAPTATION = "in the limit of fast adaptation"


def _is_searched(problem: Problem) -> bool:
    """Whether the margins over the known set are needed, and the set is not derived from ranges of physical parameters."""
    derived = problem.derived
    return problem.uncertainty is not None and is_needed(MARGINS_KEY) and not (derived is not None and derived.used)


def add_at_rest(draft: Draft, problem: Problem, *, gain_estimated: bool = False) -> None:
    """Add the margins, over the known set, of the loop to which every scheme with C = 1 reduces; add nothing without a known
    set. A true estimate of the input gain divides u, so that the loop is the same for every gain."""
    known_set = problem.uncertainty
    if known_set is not None and _is_searched(problem):
        if gain_estimated:
            problem = problem.with_inputs(lambda path: replace(path, gain=1.0))
        with draft.part(MARGINS_KEY):
            _add(draft, problem, [(LOOP_AT_REST, _worst_at_rest(problem.plant, known_set, problem.sensor_lag))])


def add_filtered(draft: Draft, problem: Problem, C: StateSpace) -> None:
    """Add the margins over the known set for the two interpretations of L1-AC: the limit of fast adaptation, and constant
    estimates."""
    known_set = problem.uncertainty
    if known_set is not None and _is_searched(problem):
        with draft.part(MARGINS_KEY):
            _add(draft, problem, _worst_filtered(problem.plant, known_set, C, problem.sensor_lag))
    if over_ranges.is_over_ranges(problem) and is_needed(MARGINS_KEY):
        known = problem.known

        def loop_at(plant: PlantAt) -> StateSpace:
            return plant.around(fast_adaptation_on(plant.A, plant.b.reshape(-1), C, known.A_m, known.b, known.P))

        over_ranges.entry_of(draft, LOOP_OF_FAST_ADAPTATION, problem, loop_at)


def add_fixed(draft: Draft, problem: Problem, around: Callable[[Plant], StateSpace]) -> None:
    """Add the margins of a linear controller's loop over the known set and over the interval of an unknown input gain."""
    known_set = problem.uncertainty
    if known_set is not None and _is_searched(problem):
        family = LoopsOverTheta(problem.plant, around, problem.sensor_lag, problem.known.gains)
        with draft.part(MARGINS_KEY):
            _add(draft, problem, [("with a fixed controller", worst_case(family, known_set))])


def add_sampled(draft: Draft, problem: Problem, found: Linearised) -> None:
    """Add the margins of a linear controller's sampled-data loop over the known set, for one input and phi(x) = x."""
    plant = problem.plant
    add_sampled_at(
        draft,
        problem,
        lambda theta: found.for_change(plant.b, theta - plant.theta),
        "in sampled-data form with a fixed controller",
    )


def add_sampled_at(draft: Draft, problem: Problem, loop_at: Callable[[Array], SampledLoop], which: str) -> None:
    """Add these margins for a loop that is given for each theta; ``which`` names the loop."""
    known_set, plant = problem.uncertainty, problem.plant
    if known_set is None or not _is_searched(problem):
        return
    gains = None
    if problem.input_gain is not None:
        low, high = np.ravel(problem.input_gain).tolist()
        gains = (low, high)
    with draft.part(MARGINS_KEY):
        worst = sampled_worst_case(loop_at, problem.delay, known_set, plant.theta, float(plant.paths[0].gain), gains)
        _add(draft, problem, [(which, worst)])


@lru_cache(maxsize=16)
def _worst_at_rest(plant: Plant, known_set: KnownSet, lag: StateSpace | None) -> WorstCase:
    """The worst case of the loop with constant estimates, which several schemes of one case share."""
    return worst_case(LoopsOverTheta(plant, lambda plant: known_parameters(plant, plant.theta), lag), known_set)


@lru_cache(maxsize=16)
def _worst_filtered(plant: Plant, known_set: KnownSet, C: StateSpace, lag: StateSpace | None) -> list[tuple[str, WorstCase]]:
    """The worst cases of the two interpretations of L1-AC, shared by all L1-AC controllers of a case that differ only in the
    gain."""
    families = {
        LOOP_OF_FAST_ADAPTATION: LoopsOverTheta(plant, lambda plant: fast_adaptation(plant, C), lag),
        LOOP_AT_REST: LoopsOverTheta(plant, lambda plant: known_parameters(plant, plant.theta, C), lag),
    }
    return [(which, worst_case(family, known_set)) for which, family in families.items()]


def _add(draft: Draft, problem: Problem, found: list[tuple[str, WorstCase]]) -> None:
    value = [_of_one_loop(draft, which, worst, problem.plant.n) for which, worst in found]
    draft.estimate({MARGINS_KEY: value}, LINEAR_LOOP_ONLY)


def _of_one_loop(draft: Draft, which: str, worst: WorstCase, n: int) -> dict[str, Any]:
    """The JSON object for a loop: each finite margin, in addition to the plant's delay, with its theta and, if that varies, the
    input gain."""
    entry: dict[str, Any] = {"loop": which, "searched": worst.searched, "unlimited": []}
    if worst.unstable_at is not None:
        theta, omega = worst.unstable_at[:n].tolist(), worst.unstable_at[n:].tolist()
        gain = f" and omega = {omega[0]:.4g}" if omega else ""
        draft.note(f"linear loop {which}: unstable at theta = [{', '.join(f'{v:.4g}' for v in theta)}]{gain} of the known set")
        return entry | {"unstable_at": theta} | ({"unstable_at_gain": omega[0]} if omega else {})
    for name, (value, point) in worst.least.items():
        if np.isfinite(value):
            gains = {"input_gain": float(point[n])} if len(point) > n else {}
            entry[KEYS_OF_MARGINS[name]] = {"value": value, "theta": point[:n].tolist()} | gains
        else:
            entry["unlimited"].append(KEYS_OF_MARGINS[name])
    return entry


MU_KEYS = ("mu_parameters", "parameter_scale", "theta_destabilising", "mu_dynamics", "mu", "mu_frequency")


def robustness(
    loop: StateSpace, known_set: KnownSet | None, weight: TransferFunction | None, findings: list[str]
) -> dict[str, Any]:
    """mu with respect to the known set, to the unmodelled dynamics of size ``weight``, and to both, keyed as in the certificate.

    ``loop`` is the loop at the centre of the set or, without a set, at the true theta.
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
                findings.append("mu is computed for the box around the known set, so it may exceed the mu of the set")
        if weight is not None:
            values["mu_dynamics"] = measure(0 * width, weight).peak
            if known_set is not None:
                both = measure(width, weight)
                values |= {"mu": both.peak, "mu_frequency": both.frequency}
    except InputError as error:
        findings.append(str(error))
    return values
