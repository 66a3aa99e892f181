"""The margins of linear loops over the known set, under the certificate's keys."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS
from barbalat.certificates.linear_loops.sampled_over_known_set import sampled_worst_case
from barbalat.certificates.linear_loops.worst_case import LoopsOverTheta, WorstCase, worst_case
from barbalat.certificates.needed import is_needed
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import KnownSet
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem

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
    known_set, plant = problem.uncertainty, problem.plant
    if known_set is None or not is_needed(MARGINS_KEY):
        return
    with draft.part(MARGINS_KEY):
        worst = sampled_worst_case(
            lambda theta: found.beside(plant.b, theta - plant.theta), problem.delay, known_set, plant.theta
        )
        _add(draft, [("from sample to sample with a fixed controller", worst)])


@lru_cache(maxsize=16)
def _worst_at_rest(plant: Plant, known_set: KnownSet, lag: StateSpace | None) -> WorstCase:
    """Several schemes of one case share it."""
    return worst_case(LoopsOverTheta(plant, lambda plant: known_parameters(plant, plant.theta), lag), known_set)


@lru_cache(maxsize=16)
def _worst_filtered(plant: Plant, known_set: KnownSet, C: StateSpace, lag: StateSpace | None) -> list[tuple[str, WorstCase]]:
    """L1-ACs of one case that differ in the gain alone share it."""
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
