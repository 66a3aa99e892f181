"""Finds out whether a run stayed inside the stability region of its solver, and the step at which it left the region.

During a run, the kernel keeps, for each of about two thousand windows, the state at which ``coupling_function`` was largest. The
exact spectrum is computed for this state. A window that shows an exit is simulated again in ever shorter windows, down to the
step. The windows depend only on the run's steps, so the result does not depend on the record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from barbalat.lowering.llvm.machine import Watch
from barbalat.lowering.shape import WATCH_EVERY
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.engine.engine import Batch, Group
from barbalat.run.kernel.grid import CHUNK_STEPS, signal_table, window_of
from barbalat.run.kernel.portable import at_instants, instants, standard_normal_at
from barbalat.run.kernel.step import sampled_states
from barbalat.run.results.spectrum import Looks, Spectrum, Stiffness
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

MOST_WINDOWS = 2000
"""Largest number of windows of a run; their lengths are multiples of WATCH_EVERY."""
MOST_LOOKS = 200
"""Number of windows for which the spectrum is computed. Half of them are the stiffest; the others are spread evenly. Before an
exit, all windows are used."""
QUICK_SPECTRUM = 100
"""Number of states for which a spectrum takes about 10 ms; a run computes at most MOST_LOOKS spectra."""
FEWEST_LOOKS = 2
"""Number of spectra for a loop with very many states."""
WINDOW_PIECES = 64
"""Number of parts into which a window with an exit is repeatedly divided."""


class Instants(NamedTuple):
    """Steps (K,) and the states there (K, size), after a sampled controller has acted."""

    steps: Array
    states: Array

    def chosen(self, which: Array) -> Instants:
        return Instants(self.steps[which], self.states[which])


Look = Callable[[Instants], Looks]


def stiffness_along(run: Run) -> Stiffness:
    """The stiffness of a recorded run, up to its divergence."""
    spectrum = Spectrum.of(run.batch.loop, run.simulation)

    def look(at: Instants) -> Looks:
        return spectrum.at(at.states, run.signals(at.steps).T)

    watch = run.batch.watch
    if watch is None:
        return _of_a_large_loop(run, spectrum, look)
    stiffest, coupling = _kept(watch, run.stop, run.batch.loop.size)
    order = np.argsort(-coupling, kind="stable")
    rest = np.sort(order[MOST_LOOKS // 2 :])
    spread = rest[np.linspace(0, len(rest) - 1, min(len(rest), MOST_LOOKS // 2)).astype(int)]
    chosen = np.sort(np.concatenate([order[: MOST_LOOKS // 2], spread]))
    found = look(stiffest.chosen(chosen))
    step = None
    if found.outside.any():
        until = np.arange(int(chosen[found.outside.argmax()]) + 1)
        step = run.first_outside(_first(stiffest.chosen(until), look), watch.window, look)
    return found.stiffness(None if step is None else float(run.simulation.time(step)))


def _of_a_large_loop(run: Run, spectrum: Spectrum, look: Look) -> Stiffness:
    """The stiffness of a large loop, for which no window is monitored or simulated again. Only the recorded instants with the
    largest tr J^2, of a few, are examined."""
    size = run.batch.loop.size
    looks = max(FEWEST_LOOKS, int(MOST_LOOKS * (QUICK_SPECTRUM / size) ** 3))  # each spectrum takes size^3 operations
    recorded = np.unique(np.linspace(0, len(run.starts) - 1, 4 * looks).astype(int))
    steps = run.starts[recorded]
    at = Instants(steps, run.acted(steps, run.states[recorded]))
    order = np.argsort(-spectrum.coupling(at.states, run.signals(steps).T), kind="stable")
    at = at.chosen(np.sort(order[:looks]))
    found = look(at)
    return found.stiffness(float(run.simulation.time(at.steps[found.outside.argmax()])) if found.outside.any() else None)


def _kept(watch: Watch, stop: float, size: int) -> tuple[Instants, Array]:
    """The instant of the largest monitored quantity in each window before the step ``stop``, and its value.

    ``size`` is the number of states of the loop, after which the judge's memory may follow.
    """
    rows = watch.rows[(watch.rows[:, 0] > -np.inf) & (watch.rows[:, -1] < stop)]
    return Instants(rows[:, -1].astype(int), rows[:, 1 : 1 + size]), rows[:, 0]


def _first(at: Instants, look: Look) -> int:
    """The first step outside the region; the last step is known to be outside."""
    for begin in range(0, len(at.steps), MOST_LOOKS):
        piece = at.chosen(np.arange(begin, min(begin + MOST_LOOKS, len(at.steps))))
        outside = look(piece).outside
        if outside.any():
            return int(piece.steps[outside.argmax()])
    return int(at.steps[-1])


@dataclass(frozen=True, eq=False)
class Run:
    """A recorded run of one member. Parts of it can be simulated again, bit for bit.

    A loop with a delay is restarted at t = 0, because the record does not contain the contents of the delay; other loops are
    restarted at a recorded step.

    starts  (B,) recorded steps, states (B, size) from which the kernel continued
    stop    the step of the divergence; beyond the last step if the run did not diverge
    """

    problem: TrackingProblem
    simulation: Simulation
    batch: Batch
    starts: Array
    states: Array
    stop: float

    def first_outside(self, step: int, window: int, look: Look) -> int:
        """The first step outside the region in the window with this stiffest step. It is exact if eight successive steps are
        outside."""
        begin = step // window * window
        known = self._known(max(begin - WATCH_EVERY + 1, 0))
        while window > WATCH_EVERY:
            window = window_of(window, WINDOW_PIECES)
            pieces = Watch(self.batch.program.shape.states, begin, step + 1, window)
            self._advance(self._advance(known, begin), step + 1, pieces)
            step = _first(_kept(pieces, self.stop, self.batch.loop.size)[0], look)
            begin += (step - begin) // window * window
        return _first(self._every(known, max(step - WATCH_EVERY + 1, 0), step + 1), look)

    def _known(self, step: int) -> Place:
        """The state at a step, from the record."""
        k = 0 if self.batch.loop.delayed else int(np.searchsorted(self.starts, step, side="right")) - 1
        return self._advance(Place(int(self.starts[k]), self.batch.resumed(self.states[k])), step)

    def _every(self, known: Place, begin: int, stop: int) -> Instants:
        """The states at all steps from ``begin`` to ``stop`` - 1."""
        place = self._advance(known, begin)
        states = []
        for step in range(begin, stop):
            states.append(place.group.state[: self.batch.loop.size, 0].copy())
            place = self._advance(place, step + 1)
        steps = np.arange(begin, stop)
        return Instants(steps, self.acted(steps, np.array(states)))

    def _advance(self, place: Place, stop: int, watch: Watch | None = None) -> Place:
        """The run continued to a later step."""
        begin, in_pieces = place.step, self.batch.program.shape.in_pieces
        watch = watch or Watch(self.batch.program.shape.states, begin, max(stop, begin + 1), CHUNK_STEPS)
        group = replace(place.group.independent_copy(), watch=watch)
        while begin < stop:
            steps = min(CHUNK_STEPS, stop - begin)
            table = signal_table(self.problem.signals, self.simulation, begin, steps, in_pieces=in_pieces)
            group.call(begin, 1, steps, group.state, table)
            begin += steps
        return Place(begin, group)

    def acted(self, steps: Array, states: Array) -> Array:
        """The states at steps (K,) after the action of a sampled controller that is due; unchanged for a continuous one."""
        loop = self.batch.loop
        if not loop.sampled:
            return states
        due = steps % self.batch.rhythm.sample_every == 0
        after = states.copy()
        (acted,) = at_instants(sampled_states(loop), self.simulation, states[due].T, self.signals(steps[due]))
        after[due] = acted.T
        return after

    def signals(self, steps: Array) -> Array:
        """The signals (signal_count, K). The delayed input is left at zero, because no output and no frozen Jacobian depends on
        it."""
        problem, loop = self.problem, self.batch.loop
        signals = np.zeros((loop.signal_count, len(steps)))
        for i, signal in enumerate(problem.signals):
            signals[i] = signal(instants(self.simulation, steps))
        if problem.noise is not None and len(steps):
            rows = steps // self.batch.rhythm.noise_hold
            number = 0 if self.batch.numbers is None else int(self.batch.numbers[0])
            drawn = standard_normal_at(problem.noise.seed, number, rows, loop.signals.noise)
            signals[loop.signals.timed : loop.signals.timed + loop.signals.noise] = drawn.T
        return signals


class Place(NamedTuple):
    """A run at one of its steps, ready to continue."""

    step: int
    group: Group
