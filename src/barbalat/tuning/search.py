"""The search for the best tuning: SciPy's differential evolution, a generation at a time, each of which is an ensemble."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat import validate
from barbalat.run.progress import Progress
from barbalat.validate import Array, InputError

POPULATION = 32
"""Tunings of a generation, for up to three numbers; with more of them twice as many."""
SETTLED = 5e-3
"""Relative spread of a generation at which the search ends: the best of it is closer still to what can be reached."""

Judged = Callable[[Array, float], Array]
"""Scores (K,) of points (K, d) of the unit cube, the smaller the better; one above the number needs no exact score."""


def search(judged: Judged, dimensions: int, *, trials: int, seed: int, start: Array | None, progress: Progress | None) -> None:
    """Spend ``trials`` on the unit cube; who judges keeps what was found. ``start`` is among the first."""
    from scipy.optimize import Bounds, OptimizeResult, differential_evolution
    from scipy.stats import qmc

    size = POPULATION if dimensions <= 3 else 2 * POPULATION
    validate.whole("trials", trials, least=2 * size)
    population = np.asarray(qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random(size))
    if start is not None:
        population[0] = start
    generations = trials // size - 1
    to_beat, done = np.inf, 0

    def score(points: Array) -> Array:
        nonlocal done
        try:
            found = judged(points.T, to_beat)
        except InputError as error:  # a ValueError, of which SciPy would say that the function is malformed
            raise _RefusedError(error) from None
        done += 1
        if progress is not None:
            progress(done / (generations + 1))
        return found

    def told(intermediate_result: OptimizeResult) -> None:
        nonlocal to_beat
        to_beat = float(np.max(intermediate_result.population_energies))

    cube = Bounds(np.zeros(dimensions), np.ones(dimensions))
    try:
        differential_evolution(
            score, cube, init=population, maxiter=generations, vectorized=True, updating="deferred",
            polish=False, tol=SETTLED, rng=np.random.default_rng(seed), callback=told,
        )  # fmt: skip
    except _RefusedError as stopped:
        raise stopped.reason from None


class _RefusedError(Exception):
    """What can't be judged, on its way through SciPy."""

    def __init__(self, reason: InputError) -> None:
        super().__init__()
        self.reason = reason
