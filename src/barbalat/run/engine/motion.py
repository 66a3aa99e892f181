"""A run whose steps follow from a tolerance: its steps, call after call of the kernel, and the nodes that are observed of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.problem.measurement import Noise
from barbalat.protocols import Signal
from barbalat.run.kernel.attempt import ALL, CHOICE, DIVERGED, SMOOTH, STALLED, Attempts, dense_output
from barbalat.run.kernel.breaks import ON_GRID_ROUNDINGS
from barbalat.run.kernel.pieces import Pieces
from barbalat.run.kernel.portable import run_times
from barbalat.run.kernel.step import CompiledLoop
from barbalat.run.kernel.time_signals import TimeSignals
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

FIRST_STEP = 1e-6
"""Part of the horizon: the first attempt, which a few successes multiply by 6 each."""
MOST_ATTEMPTS, FEWEST_ATTEMPTS = 512, 8
"""Of a call of the kernel: what it writes stays in the cache."""
NODES_EACH_STEP = 8
"""At least, an even number: a step of the integration turns the fastest oscillation by some 1.5 rad."""
WITHIN = 0.9
"""Of the distance of two recorded instants, the largest between nodes."""


@lru_cache(maxsize=64)
def _compiled(program: Program, begin: Program, shape: LoopShape) -> CompiledLoop:
    """Its code, optimised once enough attempts were made: how many a run takes is not known before, and no bit depends on it."""

    def make(quickly: bool) -> Kernel:
        return Kernel(program, shape, (0.0,) * shape.accumulators, 1, begin, quickly=quickly)

    return CompiledLoop(make)


@dataclass(eq=False)
class Motion:
    """The integration of one member.

    rows  of its pieces, the last of which is its end: see ``Pieces.rows``
    steps, rejected, choices  how many so far; choices are steps that ended where the equations jump or bend
    """

    attempts: Attempts
    code: CompiledLoop
    state: Array
    tolerance: float
    pieces: Pieces
    rows: Array
    at_once: int = 16  # attempts of the last call; those of one that has arrived are in vain
    steps: int = 0
    rejected: int = 0
    choices: int = 0

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        signals: tuple[Signal, ...],
        simulation: Simulation,
        tolerance: float,
        noise: Noise | None = None,
    ) -> Motion:
        """InputError for signals or equations that no tolerance goes with."""
        driven = TimeSignals.of(signals)
        attempts = Attempts(loop, driven, fused=simulation.fused)
        tail = float(simulation.time(simulation.tail_start))
        kept = np.unique(np.concatenate([[0.0, tail, simulation.t_end], driven.breaks(simulation.t_end)]))
        code = _compiled(attempts.program(), attempts.begin(), attempts.shape)
        state = attempts.carried.initial(loop.initial(), FIRST_STEP * simulation.t_end)
        pieces = Pieces(attempts, noise)
        return cls(attempts, code, state, tolerance, pieces, pieces.rows(kept))

    def again(self, tolerance: float, t_end: float) -> Motion:
        """The same from t = 0 at another tolerance."""
        state = self.attempts.carried.initial(self.attempts.loop.initial(), FIRST_STEP * t_end)
        return replace(self, state=state, tolerance=tolerance, at_once=16, steps=0, rejected=0, choices=0)

    def sparse(self) -> Motion:
        """The same without dense output, of which the end of each piece alone is known: three evaluations less an attempt."""
        attempts = self.attempts
        return replace(self, code=_compiled(attempts.program(dense=False), attempts.begin(), attempts.shape))

    def copied(self) -> Motion:
        """It, to be taken further by itself."""
        return replace(self, state=self.state.copy())

    def held(self, values: Array, stop: float) -> Motion:
        """From where it is, with the signals held at these values and without noise, as far as ``stop`` [s]."""
        pieces = replace(self.pieces, noise=None)
        rows = pieces.rows(np.array([self.t, stop]), values, sampled_already=True)
        return replace(self.along(rows), pieces=pieces)

    def along(self, rows: Array) -> Motion:
        """From where it is along further pieces."""
        state = self.state.copy()
        state[self._at("piece")], state[self._at("renew")] = 0.0, ALL
        return replace(self, state=state, rows=rows)

    def _at(self, name: str) -> int:
        return int(self.attempts.carried.places[name].start)

    @property
    def t(self) -> float:
        """How far it has come [s]."""
        return float(self.state[self._at("t")])

    @property
    def x(self) -> Array:
        """The loop's state there."""
        return self.state[: self.attempts.loop.size]

    @property
    def diverged(self) -> bool:
        return bool(self.state[self._at("status")] == DIVERGED)

    @property
    def over(self) -> bool:
        """Whether it has reached its end, where a controller may sample once more, or diverged."""
        return self.diverged or (self.state[self._at("piece")] == len(self.rows) - 1 and self.state[self._at("renew")] == 0)

    def further(self) -> Array:
        """A number of steps more, as rows of what ``Written`` describes."""
        carried, t_stop = self.attempts.carried, float(self.rows[-1, 0])
        needed = 1.1 * (t_stop - self.t) / self.state[self._at("h")] + len(self.rows) - self.state[self._at("piece")]
        blocks = self.at_once = int(min(max(needed, FEWEST_ATTEMPTS), 2 * self.at_once, MOST_ATTEMPTS))
        kernel = self.code.for_steps(blocks)
        out = np.empty((blocks, carried.size + kernel.shape.accumulators))
        before = out[:, self._at("t")]
        kernel(blocks, 1, self.state, np.array([self.tolerance]), self.rows, out, sample_every=1)
        written = out[:, carried.size :]
        good, tried = written[:, 0] > 0, before < t_stop
        self.steps += int(good.sum())
        self.choices += int((written[:, 0] == CHOICE).sum())
        self.rejected += int((tried & ~good).sum())
        if self.state[self._at("status")] == STALLED:
            self._stalled()
        return written[good]

    def _stalled(self) -> None:
        """A finite escape is a divergence; anything else is a motion that no tolerance follows."""
        if np.abs(self.x).max() > ESCAPING * max(np.abs(self.attempts.loop.initial()).max(), 1.0):
            self.state[self._at("status")] = DIVERGED
            return
        raise InputError.of(
            "simulation.tolerance",
            f"= {self.tolerance:g} leaves no step at t = {self.t:.6g} s: the motion slides along a jump of its equations, or "
            "no number resolves it; give simulation.dt",
        )


SAME_INSTANT = ON_GRID_ROUNDINGS * float(np.finfo(float).eps)
"""Of a time: two that are no farther apart are the same instant."""
ESCAPING = 1e4
"""A state so many times larger than at the start is on its way to infinity when no step is small enough for it."""


@lru_cache(maxsize=64)
def _node_kernel(states: int) -> Kernel:
    """Of a row that a motion wrote, the states at the first NODES_EACH_STEP nodes but the one at its start, as accumulators."""
    import casadi as ca

    row, found = ca.SX.sym("row", 3 + 8 * states), []
    x, parts = row[3 : 3 + states], [row[3 + states * (i + 1) : 3 + states * (i + 2)] for i in range(7)]
    for node in range(1, NODES_EACH_STEP):
        s, value = node / NODES_EACH_STEP, ca.SX.zeros(states)
        for i in range(7):
            value = (value + parts[6 - i]) * (s if i % 2 == 0 else 1 - s)
        found.append(value + x)
    nothing = ca.SX(0, 1)
    inputs = [nothing, nothing, nothing, row, nothing, nothing]
    traced = ca.Function("nodes", inputs, [nothing, ca.vertcat(*found), nothing], {"cse": True})
    count = (NODES_EACH_STEP - 1) * states
    return Kernel(optimize(read(traced), fused=False), LoopShape(0, count, 0, row.numel()), (0.0,) * count, 1)


def _first_nodes(written: Array, states: int) -> Array:
    """The states at NODES_EACH_STEP nodes of each of these steps, but for those at their starts."""
    found = np.empty((len(written), NODES_EACH_STEP, states))
    kernel, out = _node_kernel(states), np.empty((len(written), (NODES_EACH_STEP - 1) * states))
    kernel(len(written), 1, np.empty(0), np.empty(0), np.ascontiguousarray(written), out)
    found[:, 1:] = out.reshape(len(written), NODES_EACH_STEP - 1, states)
    return found.reshape(-1, states)


@dataclass(eq=False)
class Nodes:
    """What is observed of a motion: its nodes as rows for the observer's kernel, and its states at the instants of a grid.

    grid      the run as if it had a step from each recorded instant to the next
    first     the step of the grid at which the motion begins, and last the one at which it ends
    held      the values (k,) at which the signals are held; None where they go on
    recorded  (last - first + 1, S) the states at the grid's instants, NaN beyond where the motion has come
    """

    motion: Motion
    grid: Simulation
    signals: tuple[Signal, ...]
    first: int
    last: int
    held: Array | None = None
    recorded: Array = field(init=False)
    _kept: list[Array] = field(init=False)  # of the nodes that were not handed out: times, states, weights, smooth
    _end_weight: float = field(init=False, default=0.0)
    _joins: bool = field(init=False, default=False)
    _closed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        states = self.motion.attempts.loop.size
        self.recorded = np.full((self.last - self.first + 1, states), np.nan)
        self.recorded[0] = self.motion.x
        self._kept = [np.zeros(0), np.zeros((0, states)), np.zeros(0), np.zeros(0)]

    @cached_property
    def _instants(self) -> Array:
        return np.asarray(self.grid.time(np.arange(self.first, self.last + 1)))

    def rows(self, start: int, stop: int, most: int) -> tuple[Array, int]:
        """The table of whole steps of the grid from ``start`` on, up to ``stop`` or about ``most`` rows, and how many steps."""
        while not self._closed:
            times = self._kept[0]
            reached = self._steps(times[-1:]).max(initial=start)
            if reached >= stop or (len(times) >= most and reached > start):
                break
            self._more()
        times, states, weights, smooth = self._kept
        step = self._steps(times)
        lost = self.motion.diverged and self._closed
        end = stop if lost else min(stop, int(step[-1]))
        count = len(times) if lost else int(np.searchsorted(step, end))
        following = np.vstack([states[1 : count + 1], np.full((1, states.shape[1]), np.nan)])[:count]
        after, next_times = np.append(step, end)[1 : count + 1], np.append(times, times[-1:])[1 : count + 1]
        table = np.column_stack(
            [
                self._driving(times[:count]), following, weights[:count], smooth[:count],
                times[:count] == self.grid.time(self.grid.tail_start), (next_times - times[:count]) / self.grid.dt,
                np.ones(count), after > step[:count],
            ]
        )  # fmt: skip
        self._kept = [part[count:] for part in self._kept]
        if lost and int(table[:, -1].sum()) < end - start:
            missing = np.repeat(table[-1:], end - start - int(table[:, -1].sum()), axis=0)
            missing[:, -1] = 1.0
            table = np.vstack([table, missing])
        return np.ascontiguousarray(table, dtype=float), end - start

    def through(self) -> None:
        """Take the motion to its end for its states at the grid's instants alone."""
        while not self.motion.over:
            written = self.motion.further()
            if len(written):
                self._record(written, self.motion.attempts.loop.size)
        self._close()

    def final(self) -> Array:
        """The row at the motion's end, of no length."""
        t, x = np.array([self.motion.t]), self.motion.x
        return np.concatenate([self._driving(t)[0], x, [self._end_weight, 0.0, 0.0, 0.0, 1.0, 1.0]])[None]

    def _steps(self, times: Array) -> Array:
        """The steps of the grid in which these instants [s] lie."""
        return self.first + np.searchsorted(self._instants, times, side="right") - 1

    def _driving(self, times: Array) -> Array:
        """What drives the loop there, (K, signal_count)."""
        noise = self.motion.pieces.noise_at(times)
        if self.held is not None:
            values = np.tile(self.held, (len(times), 1))
            return np.column_stack([np.where(np.isnan(values), times[:, None], values), noise])
        t = run_times(self.grid, times)
        return np.column_stack([*(np.asarray(validate.signal_values(signal, t)) for signal in self.signals), noise])

    def _more(self) -> None:
        """Take up further steps of the motion."""
        written, states = self.motion.further(), self.motion.attempts.loop.size
        if len(written):
            self._record(written, states)
            self._append(*self._observed(written, states))
        if self.motion.over and not self._closed:
            self._close()
            x = self.motion.x[None]
            self._append(np.array([self.motion.t]), x, np.array([self._end_weight]), np.zeros(1))

    def _append(self, *parts: Array) -> None:
        self._kept = [np.concatenate([old, new]) for old, new in zip(self._kept, parts, strict=True)]

    def _record(self, written: Array, states: int) -> None:
        """Where a step begins at an instant, its beginning counts, which a sample has changed."""
        t, h = written[:, 1], written[:, 2]
        begins = t * (1 - SAME_INSTANT)
        wanted = np.arange(*np.searchsorted(self._instants, [begins[0], self.motion.t * (1 - SAME_INSTANT)]))
        at = self._instants[wanted]
        which = np.searchsorted(begins, at, side="right") - 1
        self.recorded[wanted] = dense_output(written[which], states, ((at - t[which]) / h[which]).clip(0.0, 1.0))

    def _close(self) -> None:
        self._closed = True
        if not self.motion.diverged:
            self.recorded[-1] = self.motion.x

    def _observed(self, written: Array, states: int) -> tuple[Array, Array, Array, Array]:
        """Times, states, weights and smoothness of the nodes of these steps, each with its start and without its end."""
        code, t, h, x = written[:, 0], written[:, 1], written[:, 2], written[:, 3 : 3 + states]
        joins = np.append(self._joins, code[:-1] == SMOOTH)
        self._joins = bool(code[-1] == SMOOTH)
        unit = self.grid.steps + 1
        few = bool((h <= WITHIN * NODES_EACH_STEP * self.grid.dt).all())
        each = np.full(len(h), NODES_EACH_STEP)
        if not few:
            each = np.maximum(each, 2 * np.ceil(h / (2 * WITHIN * self.grid.dt)).astype(int))
        which = np.repeat(np.arange(len(h)), each)
        place = np.arange(len(which)) - np.repeat(np.cumsum(each) - each, each)
        starts = place == 0
        found = _first_nodes(written, states) if few else dense_output(written[which], states, place / each[which])
        found[starts] = x
        own = h / each / 3 * unit / self.grid.t_end
        weights = own[which] * np.where(place % 2 == 1, 4.0, 2.0)
        weights[starts] = own + np.append(self._end_weight, own[:-1])
        self._end_weight = float(own[-1])
        times = t[which] + h[which] * (place / each[which])
        return times, found, weights, np.where(starts, np.repeat(joins, each), True).astype(float)
