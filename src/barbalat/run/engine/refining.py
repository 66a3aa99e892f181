"""Finds the step at which the method neither damps nor excites oscillations that it does not resolve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.loop.packing import flatten
from barbalat.run.engine.engine import Batch
from barbalat.solvers import Tableau
from barbalat.solvers.order_eight import order_eight
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

NEGLIGIBLE = 0.3
"""Largest admissible change of the logarithm of an oscillation's amplitude due to the method, for a run that is as stiff
throughout as at its stiffest instant. None of 696 runs of Section V that met this limit at steps from 1 to 1/64 ms oscillated
differently than at 10 us or had a different class. Ten of 955 runs that meet a limit of 10 oscillated differently
(docs/judge.md)."""
FACTORS = (2, 4, 8, 16, 32, 64, 128)
"""Divisors that are tried if the numerical damping or growth of the method is not negligible."""
ORDER_EIGHT_FACTORS = (1, 2, 4, 8, 16, 32, 64)
"""The divisors for a method of order eight, for which the given step may be sufficient."""
ROOM = 0.9
"""The run at the coarser step may reach at most this fraction of the tr J^2 that is admissible at a finer step, because tr J^2
may be larger at the finer step."""


class Refining(NamedTuple):
    """A method that resolves more than the run's method, and the ratios by which its steps may be smaller."""

    solver: Tableau
    factors: tuple[int, ...]

    @classmethod
    def of(cls, solver: Tableau, *, delayed: bool) -> Refining:
        """The method of order eight, which damps far less per evaluation; the method of the run if a delay is interpolated."""
        return cls(solver, FACTORS) if delayed or solver.order >= 8 else cls(order_eight(), ORDER_EIGHT_FACTORS)

    def work(self, factor: Array, solver: Tableau) -> Array:
        """Number of evaluations of the equations, relative to a run with ``solver``."""
        return factor * (len(self.solver.b) / len(solver.b))


def finer_by(batch: Batch, simulation: Simulation) -> Array:
    """(M,) the refinement that each member of a sweep needs, at which the method neither damps nor excites oscillations that it
    does not resolve.

    0 if the given step is sufficient, otherwise the factor by which the steps of ``Refining`` must be smaller. The factor is
    infinite if none is sufficient, and NaN if nothing was monitored.

    The kernel kept the largest tr J^2 of every eighth step, which is 2 omega^2 for an oscillation that the equations may leave
    undamped. No spectrum is computed, and the whole run is treated as being as stiff as at its stiffest instant. A sampled law
    does not depend on the solver.
    """
    coupling = np.full((1, batch.states.shape[1]), np.nan)
    if batch.loop.sampled:
        return np.zeros(coupling.shape[1])
    for group in batch.groups:
        if group.watch is not None:
            rows = group.watch.rows[:, :1] if group.watch.lanes == 1 else group.watch.rows
            coupling[0, group.columns] = rows.max(axis=0)[: group.columns.stop - group.columns.start]
    solver, factors = Refining.of(simulation.solver, delayed=batch.loop.delayed)
    own = _needed(coupling, simulation.steps, simulation, simulation.solver, (1,))
    finer = _needed(coupling / ROOM, simulation.steps, simulation, solver, factors)
    return np.where(own == 1, 0.0, finer)


def needed_by_modes(loop: ClosedLoop, simulation: Simulation) -> float:
    """The result of ``finer_by`` for a member, from the modes of its loop at the start, because constant modes are not
    monitored."""
    if simulation.tolerance is not None:  # which resolves them
        return 0.0
    modes = _modes(loop, simulation, flatten(loop.initial())[None], np.zeros((1, loop.signal_count)))
    if np.isnan(modes).any() or _smallest(modes, simulation, simulation.solver, (1,)) == 1:
        return 0.0
    return _smallest(modes, simulation, *Refining.of(simulation.solver, delayed=loop.delayed))


def finer_by_along(batch: Batch, simulation: Simulation, states: Array, signals: Array) -> float:
    """The refinement that one recorded member needs with its method; NaN if nothing was monitored.

    Each window of a continuous loop counts with its duration. For a sampled loop, the modes of the plant between samples count,
    at recorded instants with these ``states`` (K, size) and ``signals`` (K, signal_count).
    """
    factors = (1, *FACTORS)
    if batch.loop.sampled:
        at = np.unique(np.linspace(0, len(states) - 1, MOST_INSTANTS).astype(int))
        modes = _modes(batch.loop, simulation, states[at], signals[at])
        return np.nan if np.isnan(modes).any() else _smallest(modes, simulation, simulation.solver, factors)
    if batch.watch is None:
        return np.nan
    return float(_needed(batch.watch.rows[:, :1], batch.watch.window, simulation, simulation.solver, factors)[0])


MOST_INSTANTS = 32
"""Instants of a record at which the modes between samples are computed; a linear plant has constant modes."""


def _modes(loop: ClosedLoop, simulation: Simulation, states: Array, signals: Array) -> Array:
    """All eigenvalues of the right-hand side's Jacobian at K instants, (K size,); NaN if an entry is not finite."""
    jacobian = jacobian_function(loop.following_within(simulation.dt))
    found = [np.array(jacobian(*at).full()) for at in zip(states, signals, strict=True)]
    if not np.isfinite(found).all():
        return np.array([np.nan])
    return np.concatenate([np.linalg.eigvals(one) for one in found])


def _smallest(modes: Array, simulation: Simulation, solver: Tableau, factors: Sequence[int]) -> float:
    """The smallest of the factors with which the method resolves these modes [1/s]; infinite if no factor is sufficient.

    A decaying mode must also decay with the method, and an oscillating one must keep its damping.
    """
    for factor in factors:
        z = modes * simulation.dt / factor
        growth = 0.5 * np.log1p(np.maximum(solver.growth(z), -1 + 1e-300))
        lasts = np.minimum(simulation.steps * factor, 1 / np.maximum(np.abs(z.real), 1e-300))
        oscillates = np.abs(z.imag) > np.abs(z.real)
        damped = np.abs(growth - z.real) * lasts <= NEGLIGIBLE
        if ((z.real >= 0) | (growth < 0)).all() and (damped | ~oscillates).all():
            return float(factor)
    return np.inf


def _needed(coupling: Array, steps: int, simulation: Simulation, solver: Tableau, factors: Sequence[int]) -> Array:
    """(M,) the smallest sufficient factor, for this number of steps in each of K windows with these tr J^2, (K, M).

    The result is minus infinity if nothing varies, and NaN if nothing was monitored.
    """
    omega = np.sqrt(np.maximum(coupling, 0.0) / 2)
    found = np.full(coupling.shape[1], np.inf)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for factor in reversed(factors):
            growth = solver.growth(1j * simulation.dt / factor * omega)  # |R|^2 - 1
            changed = (0.5 * np.abs(np.log1p(np.maximum(growth, -1.0)))).sum(axis=0) * steps * factor
            found = np.where(changed <= NEGLIGIBLE, factor, found)
    return np.where(np.isnan(coupling).any(axis=0), np.nan, found)
