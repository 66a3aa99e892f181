"""The search for the best tuning: points spread over the whole space, then SciPy's differential evolution over the whole space
and around the best point, and finally coordinate searches ("stars")."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barbalat.budget import Progress
from barbalat.validate import Array, InputError

POPULATION = 32
"""Number of tunings in a generation for up to three parameters. For more parameters it is twice as large. A generation is an
ensemble."""
SPREAD_GENERATIONS = 4
"""Number of generations of points spread over all ranges, so that some meet the constraints even if few tunings do."""
OVERSHOOT_SHARE = 0.15
"""A point that is beyond an end by up to this fraction of the range counts as the end itself, because many best tunings are at an
end."""
REFINED_SHARES = (0.1, 0.02)
"""Fraction of a range, to either side of the best tuning so far, in which the search continues. Active constraints leave no more
room."""
STAR_GENERATIONS = 3
"""Number of generations at the end, if enough trials remain. They step from the best tuning along each parameter in both
directions, each time half as far as before. An active constraint leaves only one side of the best tuning. Evolution comes within
1 % of it, and each star halves the remaining distance."""
SETTLED_SPREAD = 5e-3
"""Relative spread at which the generations stop evolving. The best tuning is even closer to the optimum."""
BROKEN_CONSTRAINT_SCORE = 1e100
"""Smallest score of a tuning that violates a constraint. The score grows with the violation, and is larger the earlier the
violation was found."""

Judged = Callable[[Array, float], Array]
"""A function that returns scores (K,) for points (K, d) of the unit cube. Smaller is better, and a score above the given number
need not be exact."""


def least_trials(dimensions: int) -> int:
    """Return the smallest number of trials: the initial spread, one generation over the whole cube, and two around each best
    point."""
    return (SPREAD_GENERATIONS + 1 + 2 * len(REFINED_SHARES)) * _size(dimensions)


def search(judged: Judged, dimensions: int, *, trials: int, seed: int, start: Array | None, progress: Progress | None) -> None:
    """Use ``trials`` on the unit cube. The judging function keeps the results. ``start`` is among the first points."""
    from scipy.stats import qmc

    size, random = _size(dimensions), np.random.default_rng(seed)
    spent = _Spent(judged, trials, progress)
    low, high = np.full(dimensions, -OVERSHOOT_SHARE), np.full(dimensions, 1 + OVERSHOOT_SHARE)
    spread = qmc.scale(qmc.Sobol(dimensions, rng=random).random(SPREAD_GENERATIONS * size), low, high)
    if start is not None:
        spread[0] = start
    scores = spent.score(spread, np.inf)
    best = np.argsort(scores, kind="stable")[:size]
    evolved, phases = trials // size - SPREAD_GENERATIONS - len(REFINED_SHARES), 1 + len(REFINED_SHARES)
    generations = max((evolved - STAR_GENERATIONS) // phases, 1)
    spent.evolve(spread[best], scores[best], low, high, generations, random)
    for share in REFINED_SHARES:
        lower, upper = np.maximum(low, spent.best - share), np.minimum(high, spent.best + share)
        near = qmc.scale(qmc.Sobol(dimensions, rng=random).random(size), lower, upper)
        near[0] = spent.best
        spent.evolve(near, spent.score(near, np.inf), lower, upper, generations, random)
    for _ in range(evolved - phases * generations):
        spent.score(_star(spent.best, size), spent.least)


def _star(best: Array, size: int) -> Array:
    """Return points (size, d) around the best one."""
    steps = REFINED_SHARES[-1] / 2.0 ** np.arange(-(-size // (2 * len(best))))
    along = np.concatenate([sign * step * np.eye(len(best)) for step in steps for sign in (1, -1)])
    return np.asarray(best + along[:size])


@dataclass(eq=False)
class _Spent:
    """The judging function, which also keeps the best point so far."""

    judged: Judged
    trials: int
    progress: Progress | None
    done: int = 0
    least: float = np.inf

    def score(self, points: Array, to_beat: float) -> Array:
        found = self.judged(np.clip(points, 0.0, 1.0), to_beat)
        self.done += len(points)
        if self.progress is not None:
            self.progress(min(self.done / self.trials, 1.0))
        if found.min() < self.least or self.done == len(points):
            self.least, self.best = float(found.min()), np.array(points[np.argmin(found)])
        return found

    def evolve(
        self, points: Array, scores: Array, low: Array, high: Array, generations: int, random: np.random.Generator
    ) -> None:
        """Evolve several generations from points with known scores."""
        from scipy.optimize import Bounds, OptimizeResult, differential_evolution

        to_beat, known = float(scores.max()), [scores]

        def score(columns: Array) -> Array:
            if known:  # the first generation
                return known.pop()
            try:
                return self.score(columns.T, to_beat)
            except InputError as error:  # it is a ValueError, which SciPy would report as a malformed function
                raise _RefusedError(error) from None

        def told(intermediate_result: OptimizeResult) -> None:
            nonlocal to_beat
            energies = intermediate_result.population_energies
            to_beat = float(np.max(energies))
            if to_beat < BROKEN_CONSTRAINT_SCORE and float(np.ptp(energies)) <= SETTLED_SPREAD * abs(float(np.mean(energies))):
                raise StopIteration

        try:
            differential_evolution(
                score, Bounds(low, high), init=points, maxiter=generations, vectorized=True, updating="deferred",
                polish=False, tol=0.0, rng=random, callback=told,
            )  # fmt: skip
        except _RefusedError as stopped:
            raise stopped.reason from None


def _size(dimensions: int) -> int:
    return POPULATION if dimensions <= 3 else 2 * POPULATION


class _RefusedError(Exception):
    """An error of the judging function that is passed through SciPy."""

    def __init__(self, reason: InputError) -> None:
        super().__init__()
        self.reason = reason
