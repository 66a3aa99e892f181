"""A variable-step run: the steps, made by successive calls of the kernel, and the nodes at which the run is observed."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import inf

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import comes_from_outside, structure
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.problem.measurement import Noise
from barbalat.protocols import Signal
from barbalat.run.kernel.attempt import ALL, CHOICE, DIVERGED, PIECE, SMOOTH, STALLED, Attempts, dense_at, dense_output
from barbalat.run.kernel.observed import NODES_EACH_STEP, WITHIN
from barbalat.run.kernel.past import SAME_INSTANT, with_room
from barbalat.run.kernel.pieces import Pieces
from barbalat.run.kernel.portable import run_times
from barbalat.run.kernel.step import CompiledLoop, traced_once
from barbalat.run.kernel.template import Columns, Member
from barbalat.run.kernel.time_signals import TimeSignals
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

FIRST_STEP = 1e-6
"""Length of the first attempt as a fraction of the horizon; each success multiplies it by 6."""
MOST_ATTEMPTS, FEWEST_ATTEMPTS = 512, 8
"""Number of attempts per call of the kernel; the output of so many attempts stays in the cache."""
LOOKED_AT_EVERY, LEAST_PROGRESS = 20_000, 1e-7
"""Number of attempts in which a motion must advance by this fraction of its horizon; a slower one would take 2e11 attempts, that
is, a day."""
LEAST_PROGRESS_AMONG_OTHERS = 1e-4
"""The same fraction for one of many members, and for a motion in which most steps end at a jump of the equations. A slower motion
would take 2e8 attempts, that is, a minute. Oscillations of a million radians per run are faster."""
SLIDES = 0.5
"""Fraction of the steps that end at a jump of the equations, above which a motion counts as sliding along it. A motion that
crosses a jump twice per period makes several steps in between."""
RESOLVED = 1e-9
"""A tolerance above the rounding errors of Section V's runs at a gain of 1e4, which reach 1e-10 of the estimates."""


@lru_cache(maxsize=64)
def compiled_attempts(program: Program, begin: Program, shape: LoopShape) -> CompiledLoop:
    """The code of attempts. It is optimised once there were enough attempts, because their number is not known beforehand; this
    does not change the results."""

    def make(quickly: bool) -> Kernel:
        return Kernel(program, shape, (0.0,) * shape.accumulators, 1, begin, quickly=quickly)

    return CompiledLoop(make)


@dataclass(frozen=True, eq=False)
class Delay:
    """The delay of a member's input [s], and its history (m,): the values that leave the delay first."""

    time: float
    history: Array


def _traced_by(attempts: Attempts) -> Hashable | None:
    """Everything on which the programs depend: the loop with all its numbers, and the formulas of signals."""
    if comes_from_outside(attempts.loop):  # a user-defined function may depend on anything
        return None
    member = Member(attempts.loop, None)
    return "motion", *structure(member), Columns(member).first_numbers().tobytes(), attempts.fused, attempts.signals.formulas


class StalledError(InputError):
    """No step is short enough for a motion, or steps no longer advance it."""


@dataclass(eq=False)
class Motion:
    """The integration of one member.

    start       (S,) the loop's state at t = 0; parameters (p,) are the values of the symbols of ``attempts``
    rows        rows of its pieces, the last of which is its end (see ``Pieces.rows``)
    delay       delay at the input; None without a delay
    records     the content of the delay, and free entries (see ``past``)
    steps, rejected, choices  counts so far; ``choices`` is the number of steps that ended at a jump or a corner of the equations
    longest     longest step so far [s]
    """

    attempts: Attempts
    code: CompiledLoop
    start: Array
    parameters: Array
    state: Array
    tolerance: float
    pieces: Pieces
    rows: Array
    delay: Delay | None = None
    records: Array | None = None
    at_once: int = 16  # attempts of the last call; attempts after the arrival are unused
    steps: int = 0
    rejected: int = 0
    choices: int = 0
    longest: float = 0.0
    looked: tuple[int, float, int, int] = (
        0,
        0.0,
        0,
        0,
    )  # attempts, time [s], steps and choices at the last check of its progress

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        signals: tuple[Signal, ...],
        simulation: Simulation,
        tolerance: float,
        noise: Noise | None = None,
        delay: Delay | None = None,
        number: int = 0,
    ) -> Motion:
        """Raise InputError for signals or equations that can't be used with a tolerance."""
        attempts = Attempts(loop, TimeSignals.of(signals), fused=simulation.fused)
        vars(attempts).update(traced_once(_traced_by(attempts), (loop, signals), lambda: attempts.traced))
        code = compiled_attempts(*attempts.lists, attempts.shape)
        return cls.begun(Pieces(attempts, noise, number), code, loop.initial(), np.zeros(0), simulation, tolerance, delay)

    @classmethod
    def begun(
        cls,
        pieces: Pieces,
        code: CompiledLoop,
        start: Array,
        parameters: Array,
        simulation: Simulation,
        tolerance: float,
        delay: Delay | None = None,
    ) -> Motion:
        """The motion at t = 0, from compiled programs."""
        attempts, tail = pieces.attempts, float(simulation.time(simulation.tail_start))
        kept = np.unique(np.concatenate([[0.0, tail, simulation.t_end], attempts.signals.breaks(simulation.t_end)]))
        state, pieces = attempts.initial(start, FIRST_STEP * simulation.t_end), replace(pieces, until=simulation.t_end)
        return cls(attempts, code, start, parameters, state, tolerance, pieces, pieces.rows(kept), delay)._before_its_start()

    def again(self, tolerance: float, t_end: float, most: float = inf) -> Motion:
        """This motion from t = 0 with a different tolerance, in steps of at most ``most`` [s]."""
        state = self.attempts.initial(self.start, FIRST_STEP * t_end, most)
        again = replace(
            self, state=state, tolerance=tolerance, at_once=16, steps=0, rejected=0, choices=0, longest=0.0, looked=(0, 0.0, 0, 0)
        )
        return again._before_its_start()

    def _before_its_start(self) -> Motion:
        """The motion at t = 0, when the delay line contains only its initial history."""
        past = self.attempts.past
        assert (past is None) == (self.delay is None)
        return self if past is None or self.delay is None else replace(self, records=past.beginning(self.delay.history))

    def sparse(self) -> Motion:
        """This motion without dense output, so only the end of each piece is known, and each attempt needs three evaluations
        fewer."""
        attempts = self.attempts
        return replace(self, code=compiled_attempts(attempts.program(dense=False), attempts.begin(), attempts.shape))

    def copied(self) -> Motion:
        """A copy that continues independently."""
        return replace(self, state=self.state.copy(), records=None if self.records is None else self.records.copy())

    def ended(self) -> Motion:
        """The motion at its end, without the earlier pieces."""
        found = self.copied()
        found.state[found._at("piece")] = 0.0
        found.rows = self.rows[-1:].copy()
        return found

    def held(self, values: Array, stop: float) -> Motion:
        """The motion from the present time up to ``stop`` [s], with signals held at these values and without noise."""
        pieces = replace(self.pieces, noise=None)
        rows = pieces.rows(np.array([self.t, stop]), values, sampled_already=True)
        return replace(self.along(rows), pieces=pieces)

    def along(self, rows: Array) -> Motion:
        """The motion from the present time along further pieces."""
        found = replace(self.copied(), rows=rows)
        found.state[found._at("piece")], found.state[found._at("renew")] = 0.0, ALL
        return found

    def _at(self, name: str) -> int:
        return int(self.attempts.carried.places[name].start)

    @property
    def t(self) -> float:
        """The present time [s]."""
        return float(self.state[self._at("t")])

    @property
    def x(self) -> Array:
        """The loop's present state."""
        return self.state[: self.attempts.loop.size]

    @property
    def diverged(self) -> bool:
        return bool(self.state[self._at("status")] == DIVERGED)

    @property
    def stalled(self) -> bool:
        """Whether the motion can't be continued because no step is short enough."""
        return bool(self.state[self._at("status")] == STALLED)

    def stop(self) -> None:
        """Mark the motion as stalled."""
        self.state[self._at("status")] = STALLED

    @property
    def over(self) -> bool:
        """Whether the motion has diverged or reached its end, where a controller may sample once more."""
        return self.diverged or (self.state[self._at("piece")] == len(self.rows) - 1 and self.state[self._at("renew")] == 0)

    def further(self) -> Array:
        """Advance by a number of steps and return the rows that ``Written`` describes."""
        carried, t_stop = self.attempts.carried, float(self.rows[-1, 0])
        needed = 1.1 * (t_stop - self.t) / self.state[self._at("h")] + len(self.rows) - self.state[self._at("piece")]
        blocks = self.at_once = int(min(max(needed, FEWEST_ATTEMPTS), 2 * self.at_once, MOST_ATTEMPTS))
        kernel = self.code.for_steps(blocks)
        out = np.empty((blocks, carried.size + kernel.shape.accumulators))
        before = out[:, self._at("t")]
        given = [*self.parameters, self.tolerance]
        if self.records is not None and self.delay is not None:
            self._make_room(self.records, blocks)
            given.append(self.delay.time)
        kernel(blocks, 1, self.state, np.array(given), self.rows, out, records=self.records, sample_every=1)
        written = out[:, carried.size :]
        good, tried = written[:, 0] > 0, before < t_stop
        self.steps += int(good.sum())
        self.choices += int((written[:, 0] == CHOICE).sum())
        self.rejected += int((tried & ~good).sum())
        self.longest = max(self.longest, float(written[good, 2].max(initial=0.0)))
        if self.state[self._at("status")] == STALLED:
            self.require_step()
        self.require_progress()
        return written[good]

    def _make_room(self, records: Array, steps: int) -> None:
        """Make room for the records of further steps, in place of those that have left the delay."""
        rows = [self._at("leaving"), self._at("records")]
        first, last = self.state[rows].astype(int)[:, None]
        (self.records,), left = with_room(records[None], first, last, steps)
        self.state[rows] -= left

    def take(self, records: Array | None) -> None:
        """Copy the contents of the delay from records that end at the current time; None without a delay."""
        if records is None:
            return
        rows = [self._at("leaving"), self._at("records")]
        first, last = self.state[rows].astype(int)
        self.records = records[first:last].copy()
        self.state[rows] -= first

    def require_progress(self, least: float = LEAST_PROGRESS) -> None:
        """Raise StalledError for a motion that rounding moves back and forth across a jump of its equations, or that slides along
        the jump, if it advances by less than this fraction of its horizon."""
        (before, t, steps, choices), attempts, t_end = self.looked, self.steps + self.rejected, float(self.rows[-1, 0])
        if attempts - before < LOOKED_AT_EVERY:
            return
        slides = self.choices - choices > SLIDES * (self.steps - steps)
        if slides and self.t - t < LEAST_PROGRESS_AMONG_OTHERS * t_end and not self.over and not self._escapes():
            raise StalledError.of(
                "simulation.tolerance",
                f"= {self.tolerance:g} can't be used from t = {self.t:.6g} s on, because the solution slides along a "
                f"discontinuity of the equations: {attempts - before} attempted steps advanced it by {self.t - t:.2g} s. Use a "
                "larger one, or give simulation.dt",
            )
        if not self.over and self.t - t < least * t_end and not self._escapes():
            larger = max(10 * self.tolerance, RESOLVED)
            instead = f"use a larger one, such as {larger:g}, or " if self.tolerance < RESOLVED else ""
            raise StalledError.of(
                "simulation.tolerance",
                f"= {self.tolerance:g} is finer than 64-bit arithmetic can resolve at t = {min(self.t, t_end):.6g} s: "
                f"{attempts - before} attempted steps advanced it by {self.t - t:.2g} s, because only rounding decides on which "
                f"side of a jump of the equations the solution is. To continue, {instead}give simulation.dt",
            )
        self.looked = attempts, self.t, self.steps, self.choices

    def require_step(self) -> None:
        """Raise StalledError for a stalled motion that no tolerance can resolve; a finite escape is a divergence."""
        if self._escapes():
            return
        raise StalledError.of(
            "simulation.tolerance",
            f"= {self.tolerance:g} leaves no admissible step at t = {self.t:.6g} s"
            ": the solution slides along a discontinuity of the equations, or exceeds the resolution of 64-bit numbers; give "
            "simulation.dt",
        )

    def _escapes(self) -> bool:
        """Return whether a stalled motion counts as diverged because its state is so large; if so, mark it as diverged."""
        escapes = bool(np.abs(self.x).max() > ESCAPING * max(np.abs(self.start).max(), 1.0))
        if escapes:
            self.state[self._at("status")] = DIVERGED
        return escapes


ESCAPING = 1e4
"""If no step is short enough for a state that is this many times larger than at the start, it counts as escaping to infinity."""


@lru_cache(maxsize=64)
def node_kernel(states: int) -> Kernel:
    """The states at the first NODES_EACH_STEP nodes, without the start, of a row written by a motion, as accumulators."""
    import casadi as ca

    row, found = ca.SX.sym("row", 3 + 8 * states), []
    x = row[3 : 3 + states]
    for node in range(1, NODES_EACH_STEP):
        found.append(dense_at(x, row[3 + states :], node / NODES_EACH_STEP))
    nothing = ca.SX(0, 1)
    inputs = [nothing, nothing, nothing, row, nothing, nothing]
    traced = ca.Function("nodes", inputs, [nothing, ca.vertcat(*found), nothing], {"cse": True})
    count = (NODES_EACH_STEP - 1) * states
    return Kernel(optimize(read(traced), fused=False), LoopShape(0, count, 0, row.numel()), (0.0,) * count, 1)


def _first_nodes(written: Array, states: int) -> Array:
    """The states at NODES_EACH_STEP nodes of each of these steps, without those at their starts."""
    found = np.empty((len(written), NODES_EACH_STEP, states))
    kernel, out = node_kernel(states), np.empty((len(written), (NODES_EACH_STEP - 1) * states))
    kernel(len(written), 1, np.empty(0), np.empty(0), np.ascontiguousarray(written), out)
    found[:, 1:] = out.reshape(len(written), NODES_EACH_STEP - 1, states)
    return found.reshape(-1, states)


@dataclass(eq=False)
class Nodes:
    """The observation of a motion: its nodes as rows for the observer's kernel, and its states at the instants of a grid.

    grid      the run as if it had one step between successive recorded instants
    first     the grid step at which the motion begins; ``last`` is the grid step at which it ends
    held      the values (k,) at which the signals are held; None if they continue
    instants  (last - first + 1,) [s] recorded instants from the beginning of the motion to its end, in place of the grid
    recorded  (last - first + 1, S) the states at the grid's instants, NaN for times that the motion has not reached
    """

    motion: Motion
    grid: Simulation
    signals: tuple[Signal, ...]
    first: int
    last: int
    held: Array | None = None
    instants: Array | None = None
    recorded: Array = field(init=False)
    _kept: list[Array] = field(init=False)  # nodes not yet returned: times, states, weights, smooth, whether one ends a piece
    _end_weight: float = field(init=False, default=0.0)
    _joins: bool = field(init=False, default=False)
    _before_end: Array = field(init=False)  # the state before the events at the end
    _closed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        states = self.motion.attempts.loop.size
        self.recorded = np.full((self.last - self.first + 1, states), np.nan)
        self.recorded[0] = self.motion.x
        self._kept = [np.zeros(0), np.zeros((0, states)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)]
        self._before_end = self.motion.x.copy()

    @cached_property
    def _instants(self) -> Array:
        return np.asarray(self.grid.time(np.arange(self.first, self.last + 1))) if self.instants is None else self.instants

    def rows(self, start: int, stop: int, most: int) -> tuple[Array, int]:
        """The table of the grid's whole steps from ``start`` to ``stop``, but of about ``most`` rows, and the number of steps."""
        while not self._closed:
            times = self._kept[0]
            reached = self._steps(times[-1:]).max(initial=start)
            if reached >= stop or (len(times) >= most and reached > start):
                break
            self._more()
        times, states, weights, smooth, ends = self._kept
        step = self._steps(times)
        lost = self.motion.diverged and self._closed and int(step[-1]) < stop
        end = stop if lost else min(stop, int(step[-1]))
        count = len(times) if lost else int(np.searchsorted(step, end))
        following = np.vstack([states[1 : count + 1], np.full((1, states.shape[1]), np.nan)])[:count]
        after, next_times = np.append(step, end)[1 : count + 1], np.append(times, times[-1:])[1 : count + 1]
        table = np.column_stack(
            [
                self._driving(times[:count], ends[:count]), following, weights[:count], smooth[:count],
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

    def through(self, most: float = inf) -> None:
        """Advance the motion to its end and keep only the recorded states. Raise InputError after ``most`` attempts."""
        while not self.motion.over:
            if self.motion.steps + self.motion.rejected > most:
                raise InputError(f"a run with a tolerance of {self.motion.tolerance:g} takes more than {most:g} steps")
            written = self.motion.further()
            if len(written):
                self._record(written, self.motion.attempts.loop.size)
        self._close()

    def final(self, end_weight: float | None = None) -> Array:
        """The row at the end of the motion, with zero length and, if the caller knows it, the weight of its squares."""
        weight = self._end_weight if end_weight is None else end_weight
        t, x = np.array([self.motion.t]), self.motion.x
        return np.concatenate([self._driving(t, np.zeros(1, dtype=bool))[0], x, [weight, 0.0, 0.0, 0.0, 1.0, 1.0]])[None]

    def _steps(self, times: Array) -> Array:
        """The grid steps that contain these instants [s]; an instant that equals the beginning of a step up to rounding belongs
        to that step."""
        return self.first + np.searchsorted(self._instants * (1 - SAME_INSTANT), times, side="right") - 1

    def _driving(self, times: Array, ends: Array) -> Array:
        """The signals of the loop at these nodes, (K, signal_count), before their jumps if a piece ``ends`` there (K,).

        The output of a delay is left at zero, since no output depends on it.
        """
        delayed = np.zeros((len(times), self.motion.attempts.loop.signals.delayed))
        noise = np.column_stack([self.motion.pieces.noise_at(times, ends), delayed])
        if self.held is not None:
            values = np.tile(self.held, (len(times), 1))
            return np.column_stack([np.where(np.isnan(values), times[:, None], values), noise])
        t = run_times(self.grid, times)
        timed = [
            np.where(ends, np.asarray(signal.before(t), float), np.asarray(validate.signal_values(signal, t)))
            for signal in self.signals
        ]
        return np.column_stack([*timed, noise])

    def _more(self) -> None:
        """Add further steps of the motion."""
        written, states = self.motion.further(), self.motion.attempts.loop.size
        if len(written):
            self._record(written, states)
            self._append(*self._observed(written, states))
        if self.motion.over and not self._closed:
            self._close()
            known = np.array([self.motion.t]), self._before_end[None], np.array([self._end_weight])
            self._append(*known, np.zeros(1), np.zeros(1, dtype=bool))

    def _append(self, *parts: Array) -> None:
        self._kept = [np.concatenate([old, new]) for old, new in zip(self._kept, parts, strict=True)]

    def _record(self, written: Array, states: int) -> None:
        """Record states at instants; if a step begins at an instant, record its initial state, which a sample may have
        changed."""
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

    def _observed(self, written: Array, states: int) -> tuple[Array, ...]:
        """The nodes of these steps in stored form: the start of each step, and also its end if the step is the last of a piece.

        At the end of a piece a signal or the state may jump, so the end is a node just before the beginning of the next piece.
        """
        code, t, h, x = written[:, 0], written[:, 1], written[:, 2], written[:, 3 : 3 + states]
        ended = code == PIECE
        joins = np.append(self._joins, code[:-1] == SMOOTH)
        self._joins = bool(code[-1] == SMOOTH)
        few = bool((h <= WITHIN * NODES_EACH_STEP * self.grid.dt).all())
        each = np.full(len(h), NODES_EACH_STEP)
        if not few:
            each = np.maximum(each, 2 * np.ceil(h / (2 * WITHIN * self.grid.dt)).astype(int))
        counts = each + ended
        which = np.repeat(np.arange(len(h)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        starts, ends = place == 0, place == each[which]
        found = np.empty((len(which), states))
        inside = _first_nodes(written, states) if few else dense_output(written[which], states, place / each[which])[~ends]
        found[~ends], found[starts] = inside, x
        found[ends] = (x + written[:, 3 + states : 3 + 2 * states])[ended]
        own = h / each / 3 * (self.grid.steps + 1) / self.grid.t_end
        weights = own[which] * np.where(place % 2 == 1, 4.0, 2.0)
        weights[starts] = own + np.append(self._end_weight, np.where(ended, 0.0, own)[:-1])
        weights[ends] = own[ended]
        self._end_weight = 0.0 if ended[-1] else float(own[-1])
        self._before_end = found[-1] if ended[-1] else self.motion.x.copy()
        times = t[which] + h[which] * (place / each[which])
        times[ends] = np.append(t[1:], self.motion.t)[ended] * (1 - 2 * SAME_INSTANT)
        smooth = np.where(ends, -1.0, np.where(starts, np.repeat(joins, counts), 1.0))
        return times, found, weights, smooth, ends
