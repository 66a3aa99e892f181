"""The plants on which tunings are tried: the case's own, and others from its known set or from its parameters' ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.problem.known_set import KnownSet
from barbalat.problem.physical import PhysicalPlant
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.problem.truth import Truth
from barbalat.sweeps.known_set_draws import spread_of
from barbalat.validate import Array, InputError


def plants_of(problem: Problem, known_set: KnownSet, plants: int, seed: int) -> list[Problem]:
    """The case's plant, and others, drawn from its known set and, if the input's gain is unknown, from its interval.

    For a plant with physical parameters the others are drawn from their ranges. InputError if a truth has its own matrix A: no
    known set then describes similar plants.
    """
    random = np.random.default_rng(seed)
    if problem.plant.physical is not None:
        return _of_the_ranges(problem, problem.plant.physical, plants, random)
    if problem.truth is not None and problem.truth.A is not None and plants > 1:
        raise InputError.of("plants", f"must be 1 with truth.A, which is a single plant without variation; got {plants}")
    thetas = known_set.drawn(random, plants - 1)
    found = [problem.plant, *(replace(problem.plant, theta=theta) for theta in thetas)]
    if problem.known.gains is not None:  # the case's own gain is written out too, so that all plants have one structure
        gains = [[path.gain for path in problem.plant.paths], *problem.known.gains.drawn(random, plants - 1)]
        found = [_with_gains(plant, gain) for plant, gain in zip(found, gains, strict=True)]
    return [replace(problem, plant=plant) for plant in found]


def _of_the_ranges(problem: Problem, physical: PhysicalPlant, plants: int, random: np.random.Generator) -> list[Problem]:
    """The problem, and others whose truth has parameters drawn from their ranges."""
    uncertain = [one for one in physical.parameters if not one.is_exact]
    drawn = {one.name: spread_of(one).at(random.random(plants - 1)) for one in uncertain}
    truth = problem.truth or Truth()
    values = [{name: float(values[i]) for name, values in drawn.items()} for i in range(plants - 1)]
    return [problem, *(replace(problem, truth=replace(truth, parameters={**truth.parameters, **one})) for one in values)]


def parameters_of(problem: TrackingProblem) -> Any:
    """The values with which estimates are compared, or those of the design plant if the truth has none."""
    true = problem.true_parameters
    return problem.parameters if true is None else true


def _with_gains(plant: Plant, gains: Sequence[float] | Array) -> Plant:
    paths = tuple(replace(path, gain=float(gain)) for path, gain in zip(plant.paths, gains, strict=True))
    return replace(plant, input=paths if len(paths) > 1 else paths[0])
