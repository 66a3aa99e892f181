"""The plants on which tunings are tried: the plant of the case, and others from its known set or from the ranges of its
parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.problem.known_set import KnownSet, ParameterBox
from barbalat.problem.physical import PhysicalPlant
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.problem.truth import Truth, names_simulated
from barbalat.run.kernel import delay
from barbalat.solvers.simulation import Simulation
from barbalat.sweeps.known_set_draws import spread_of
from barbalat.validate import Array, InputError


def plants_of(problem: Problem, known_set: KnownSet, plants: int, seed: int) -> list[Problem]:
    """Return the case's plant, and others drawn from its known set and, if the input gain is unknown, from its interval.

    For a plant with physical parameters, the others are drawn from the parameter ranges. Raises InputError if several plants are
    requested but the truth is a single plant (see ``one_plant_because``).
    """
    if plants > 1 and (why := one_plant_because(problem)) is not None:
        raise InputError.of("plants", f"must be 1, because {why}; got {plants}")
    random = np.random.default_rng(seed)
    if problem.plant.physical is not None:
        return _of_the_ranges(problem, problem.plant.physical, plants, random)
    thetas = known_set.drawn(random, plants - 1)
    found = [problem.plant, *(replace(problem.plant, theta=theta) for theta in thetas)]
    if problem.known.gains is not None:  # the gain of the case is written out too, so that all plants have one structure
        gains = [[path.gain for path in problem.plant.paths], *problem.known.gains.drawn(random, plants - 1)]
        found = [_with_gains(plant, gain) for plant, gain in zip(found, gains, strict=True)]
    return [replace(problem, plant=plant) for plant in found]


def one_plant_because(problem: Problem) -> str | None:
    """Return a clause that says why there are no other plants to simulate; None if there are.

    The truth may have a separate matrix A, whose variation is described by no known set, or may contain no parameter with a
    range.
    """
    physical, truth = problem.plant.physical, problem.truth or Truth()
    if physical is None:
        return None if truth.A is None else "truth.A is a single plant without variation"
    ranges = [one.name for one in physical.parameters if not one.is_exact]
    if not ranges:
        return "no parameter has a range"
    used = names_simulated(vars(physical), vars(truth))
    return None if used.intersection(ranges) else f"no formula of the simulated plant contains {' or '.join(ranges)}"


def _of_the_ranges(problem: Problem, physical: PhysicalPlant, plants: int, random: np.random.Generator) -> list[Problem]:
    """Return the problem, and problems whose truth has parameters drawn from their ranges."""
    uncertain = [one for one in physical.parameters if not one.is_exact]
    drawn = {one.name: spread_of(one).at(random.random(plants - 1)) for one in uncertain}
    values = [{name: float(values[i]) for name, values in drawn.items()} for i in range(plants - 1)]
    return [problem, *_with_values(problem, values)]


def _with_values(problem: Problem, values: Sequence[Mapping[str, float]]) -> list[Problem]:
    """Return the problem with changed parameters of the truth."""
    truth = problem.truth or Truth()
    return [replace(problem, truth=replace(truth, parameters={**truth.parameters, **one})) for one in values]


MOST_EXTREMES = 256
"""Number of corners of the known set, or of the parameters' ranges, among which extreme plants are chosen."""


def extreme_plants(problem: Problem, known_set: KnownSet, count: int, seed: int) -> list[Problem]:
    """Return at most ``count`` plants at corners of the parameters' ranges, or else of the known set and the gain interval.

    The first plant differs most from the plant of the case, and each further plant differs most from the previous ones. The
    difference includes matrices, input gains and delays, each entry relative to its largest value.
    """
    random = np.random.default_rng(seed)
    corners = [problem, *_corners(problem, known_set, random)]
    rows = np.array([_entries(one) for one in corners])
    largest = np.abs(rows).max(axis=0)
    rows = rows / np.where(largest > 0, largest, 1.0)
    found: list[Problem] = []
    away = np.linalg.norm(rows - rows[0], axis=1)
    while len(found) < count and away.max() > SAME_PLANT:
        chosen = int(away.argmax())
        found.append(corners[chosen])
        away = np.minimum(away, np.linalg.norm(rows - rows[chosen], axis=1))
    return found


SAME_PLANT = 1e-9
"""Relative distance within which two plants count as the same."""


def _corners(problem: Problem, known_set: KnownSet, random: np.random.Generator) -> list[Problem]:
    if one_plant_because(problem) is not None:
        return []
    physical = problem.plant.physical
    if physical is not None:
        uncertain = [one for one in physical.parameters if not one.is_exact]
        lower, upper = np.array([one.range for one in uncertain]).T
        points = ParameterBox(lower=lower, upper=upper).extreme_points(random, MOST_EXTREMES)
        return _with_values(problem, [dict(zip((one.name for one in uncertain), map(float, row), strict=True)) for row in points])
    gains = problem.known.gains
    points = (known_set if gains is None else known_set.with_gains(gains)).extreme_points(random, MOST_EXTREMES)
    p = known_set.size
    plants = [replace(problem.plant, theta=row[:p]) for row in points]
    if gains is not None:
        plants = [_with_gains(plant, row[p:]) for plant, row in zip(plants, points, strict=True)]
    return [replace(problem, plant=plant) for plant in plants]


def _entries(problem: Problem) -> Array:
    """Return the numbers in which plants of one case differ."""
    simulated, paths = problem.simulated, problem.surroundings.paths
    physical = problem.plant.physical
    used = set() if physical is None else names_simulated(vars(physical), vars(problem.truth or Truth()))
    values = () if simulated is None else [value for name, value in simulated.values.items() if name in used]
    matrices = (problem.plant.theta,) if simulated is None else (simulated.A, simulated.b, *values)
    around = [number for path in paths for number in (path.gain, path.delay)]
    return np.concatenate([np.ravel(one) for one in (*matrices, around)])


def require_delays(problems: Sequence[TrackingProblem], simulation: Simulation) -> None:
    """Raise InputError, before any simulation, if one of the drawn plants has a delay that the step cannot represent."""
    if simulation.tolerance is not None:
        return
    for one in (each for each in problems if each.delay > 0):
        try:
            delay.lag(one.delay, simulation.dt)
        except InputError:
            raise InputError(
                f"the parameter ranges include plants with an input delay of {one.delay:.3g} s, but a delay must be 0 or at "
                f"least one solver step ({simulation.dt:g} s): raise the lower end of the range, or reduce simulation.dt"
            ) from None


def parameters_of(problem: TrackingProblem) -> Any:
    """Return the values with which estimates are compared, or the values of the design plant if the truth has no such values."""
    true = problem.true_parameters
    return problem.parameters if true is None else true


def drawn_values(problems: Sequence[TrackingProblem]) -> tuple[dict[str, float], ...] | None:
    """Return, for each plant, the simulated values of the parameters with ranges; None if plants are drawn from the known set."""
    found = []
    for problem in problems:
        physical = problem.plant.physical if isinstance(problem, Problem) else None
        if physical is None or not isinstance(problem, Problem) or problem.simulated is None:
            return None
        ranges = [one.name for one in physical.parameters if not one.is_exact]
        found.append({name: problem.simulated.values[name] for name in ranges})
    return tuple(found)


def drawn_from(problem: TrackingProblem) -> str:
    """Return the set from which plants are drawn, in words."""
    return "the known set" if drawn_values([problem]) is None else "the parameters' ranges"


def _with_gains(plant: Plant, gains: Sequence[float] | Array) -> Plant:
    paths = tuple(replace(path, gain=float(gain)) for path, gain in zip(plant.paths, gains, strict=True))
    return replace(plant, input=paths if len(paths) > 1 else paths[0])
