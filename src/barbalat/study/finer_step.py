"""Is a verdict the solver's? Some of many runs once more at a finer step, judged by the same rule."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat import validate
from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import Member
from barbalat.validate import Array

FINER_BY = 4
"""The step is this many times smaller: of RK4 the error then falls to 1/256."""
MOST_AUDITED = 32
"""Runs that are made again: where 10 % of all verdicts are the solver's, 97 of 100 audits of so many find one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rejudged:
    """Numbers (K,) of the runs that were made again, and (K,) whether the rule counts them as they were and at the finer step."""

    chosen: Array
    before: Array
    after: Array

    @property
    def changed(self) -> int:
        """How many have another verdict at the finer step."""
        return int((self.before != self.after).sum())

    @property
    def sentence(self) -> str:
        """The same for people."""
        return said(len(self.chosen), self.changed)


def said(count: int, changed: int, which: str = "") -> str:
    """What an audit of so many runs found; ``which`` verdicts changed."""
    again = f"of {validate.counted(count, 'member')} run again with a step {FINER_BY} times smaller"
    if not changed:
        return f"{again}, none changed a verdict"
    named = f" ({which})" if which else ""
    return (
        f"{again}, {changed} changed a verdict{named}: the shares are partly artefacts of the solver, and a smaller "
        "simulation.dt is needed"
    )


def rejudged(
    members: Sequence[Member],
    simulation: Simulation,
    counted: Array,
    judge: Callable[[Array, Metrics], Array],
    *,
    numbers: Array | None = None,
    count: int = MOST_AUDITED,
    seed: int = 0,
    threads: int | None = None,
) -> Rejudged:
    """Of members of one structure, some that a rule counts and as many that it does not, at a finer step.

    counted  (M,) truth values, the verdicts at ``simulation``'s own step
    judge    takes (K,) the places of members and their figures, and says which the rule counts
    numbers  (M,) of the members' noise, see ``simulate_ensemble``

    InputError where the finer runs need more memory than there is.
    """
    chosen = drawn(counted, min(count, len(members)), seed)
    finer = replace(simulation, dt=simulation.dt / FINER_BY)
    streams = None if numbers is None else numbers[chosen]
    metrics = simulate_ensemble([members[i] for i in chosen], finer, numbers=streams, threads=threads).metrics
    return Rejudged(chosen=chosen, before=np.asarray(counted, dtype=bool)[chosen], after=judge(chosen, metrics))


def drawn(counted: Array, count: int, seed: int, first: Sequence[int] = ()) -> Array:
    """(count,) places in their order: ``first``, then as many that are counted as are not, as far as there are."""
    failed = np.array(counted, dtype=bool)
    sound = ~failed
    failed[list(first)] = sound[list(first)] = False
    left, generator = count - len(first), np.random.default_rng([seed, FINER_BY])
    of_failed = min(max((left + 1) // 2, left - int(sound.sum())), int(failed.sum()))
    parts = [
        generator.choice(np.flatnonzero(which), size, replace=False)
        for which, size in ((failed, of_failed), (sound, left - of_failed))
    ]
    return np.sort(np.concatenate([np.array(first, dtype=int), *parts]))
