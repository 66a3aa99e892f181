"""The shell around a sampled controller, and the faults that reach it: what it is handed of a sample, and what it puts out.

What is exported has the same shell as C: ``export/templates/controller.c``. The operations here are those, in that order, and
tests hold the two against each other in every bit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from barbalat.loop.packing import Held
from barbalat.problem.faults import COMMAND, Dropout, Fault, Jitter, Latency, Stuck
from barbalat.problem.shell import Shell
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Value
from barbalat.protocols import kept as choose
from barbalat.validate import Array, InputError

MOST_COUNTED = 10**9
"""Misses in a row: where the counter stays. It and what is added to it fit into every C compiler's long."""
MOST_LATE = 1000
"""Samples of a latency, each of which is kept."""


class Kept(NamedTuple):
    """What is kept from sample to sample; of what a case has no use for there are no entries."""

    outage: Value  # () misses in a row
    fade_left: Value  # () samples of a return's fade that are still to come
    bump: Value  # (m,) what fades out
    repeats: Value  # (k,) good samples in a row like the one before, of the channels that may be stuck
    offered: Value  # (y,) what the sensor handed over last, right or wrong
    lost: Value  # (2,) 1 where the last measurement, or the last command, did not come
    late: Value  # (d y,) earlier measurements, the newest first
    timer: Value  # (4,) steps to the next call, how late the last was, steps since it; the time between the last two; or (0,)


class Taken(NamedTuple):
    """A sample as the controller's list is handed it, and what is decided about it."""

    y: Value
    r: Value
    freeze: Value  # 1 on a miss
    begun: Value  # 1 where there is a controller that goes on, now or before
    due: Value  # 1 where the timer calls
    wrong_time: Value  # 1 where it does so at another time than a shell takes
    offered: Value
    lost: Value
    late: Value
    timer: Value


@dataclass(frozen=True, eq=False)
class OnLoop:
    """What a fault does, whenever it is there: signals say when.

    where    (y,) the channels that it is on
    command  whether it is on the command instead
    time     [s] of a jitter; ``samples`` of a latency
    """

    kind: str
    where: Array
    command: bool = False
    time: float = 0.0
    samples: int = 0

    @classmethod
    def of(cls, fault: Fault, names: tuple[str, ...], T: float) -> OnLoop:
        """InputError for a time that does not go with the sample time."""
        on = np.array([fault.channels in ("", name) for name in names])
        samples = 0
        if isinstance(fault, Latency):
            samples = round(fault.time / T)
            if samples < 1 or abs(samples * T - fault.time) > 1e-9 * fault.time:
                raise InputError(f"a latency's time must be a whole number of sample times of {T:g} s, got {fault.time:g} s")
            if samples > MOST_LATE:
                raise InputError(f"a latency's time must be at most {MOST_LATE} sample times of {T:g} s, got {fault.time:g} s")
        time = fault.time if isinstance(fault, Jitter) else 0.0
        return cls(fault.kind, on, fault.channels == COMMAND and COMMAND not in names, time, samples)


@dataclass(frozen=True, eq=False)
class Around:
    """A shell in numbers, and the faults; arrays are (y,) for the measured channels.

    low, high  what is taken; infinite where a channel has no range
    rate       the fastest change from one sample to the next; infinite where a channel has none
    repeats    samples in a row that may be like the one before, by places of channels
    ranged, rated  places of the channels that have a range, a rate: also where their numbers are symbols
    T          [s] between two calls, of which ``band`` [s] may be off; None where another time is told and nothing else
    longest    misses in a row before the fallback acts; None for no end
    fade       samples of the fallback's fade, and of a return's
    """

    low: Array
    high: Array
    rate: Array
    T: float
    band: float | None
    longest: int | None
    fade: int
    fallback: str
    faults: tuple[OnLoop, ...]
    repeats: tuple[tuple[int, int], ...] = ()
    ranged: tuple[int, ...] = ()
    rated: tuple[int, ...] = ()

    @classmethod
    def of(cls, problem: TrackingProblem, T: float) -> Around | None:
        """None where there is neither a shell nor a fault; InputError for times that do not go with the sample time T [s]."""
        shell, names = problem.shell, problem.measured_names
        if shell is None and not problem.faults:
            return None
        ranges = [(-inf, inf) if shell is None else shell.range.get(name, (-inf, inf)) for name in names]
        low, high = np.array(ranges, dtype=float).T
        rate = np.array([inf if shell is None else shell.rate.get(name, inf) for name in names]) * T
        ends = shell is not None and shell.longest_outage is not None
        longest, fade = shell.samples(T) if shell is not None and ends else (None, 0)
        faults = tuple(OnLoop.of(fault, names, T) for fault in problem.faults)
        if (late := sum(one.time for one in faults)) > T / 4 * (1 + 1e-9):  # else two calls could come at once
            limit = f"a quarter of the sample time of {T:g} s, also that of several together"
            raise InputError(f"a jitter's time must be at most {limit}, got {late:g} s")
        return cls(
            low=low,
            high=high,
            rate=rate,
            T=T,
            band=None if shell is None or shell.jitter is None else shell.jitter * T,
            longest=longest,
            fade=fade,
            fallback="hold" if shell is None else shell.fallback,
            faults=faults,
            repeats=() if shell is None else _repeats(shell, names, T),
            ranged=tuple(np.flatnonzero(np.isfinite(low)).tolist()),
            rated=tuple(np.flatnonzero(np.isfinite(rate)).tolist()),
        )

    @classmethod
    def of_shell(cls, problem: TrackingProblem, T: float | None) -> Around | None:
        """The shell alone, for what is exported."""
        return None if problem.shell is None or T is None else cls.of(replace(problem, faults=()), T)  # type: ignore[type-var]

    def require_taken(self, measured: Array, names: tuple[str, ...]) -> None:
        """InputError where a run without faults, of which (K, y) was measured, has a sample that is not taken."""
        for name, key, wrong in (
            ("range", "leaves", (measured < self.low) | (measured > self.high)),
            ("rate", "changes faster than", np.abs(np.diff(measured, axis=0, prepend=measured[:1])) > self.rate),
        ):
            if wrong.any():
                k, i = np.argwhere(wrong)[0].tolist()
                raise InputError.of(
                    f"shell.{name}.{names[i]}",
                    f"refuses the case's own run: {names[i]} {key} it at sample {k}, t = {k * self.T:g} s, without any fault",
                )
        for i, most in self.repeats:
            run = 0
            for k in range(1, len(measured)):
                run = run + 1 if measured[k, i] == measured[k - 1, i] else 0
                if run > most:
                    raise InputError.of(
                        f"shell.stuck.{names[i]}",
                        f"refuses the case's own run: {names[i]} repeats itself up to t = {k * self.T:g} s, without any fault",
                    )

    @property
    def jitters(self) -> bool:
        """Whether calls come at other instants than whole multiples of the sample time."""
        return any(one.kind == Jitter.kind for one in self.faults)

    def require_steps(self, dt: float) -> None:
        """InputError for a jitter below the solver's step dt [s], of which nothing would be seen."""
        for one in self.faults:
            if one.kind == Jitter.kind and one.time < dt * (1 - 1e-9):
                raise InputError(f"a jitter's time must be at least simulation.dt = {dt:g} s, got {one.time:g} s")

    @property
    def counts(self) -> bool:
        """Whether something depends on how many samples were missed."""
        return self.longest is not None or bool(self.rated)

    def initial(self, y: Array, inputs: int) -> Kept:
        """Before the first sample; ``y`` has the shape of what is measured."""
        flat, late = y.reshape(-1), max((one.samples for one in self.faults), default=0)
        some, ends = (np.zeros(1 if there else 0) for there in (self.counts, self.longest is not None))
        return Kept(
            outage=some,
            fade_left=ends,
            bump=np.zeros(inputs if self.longest is not None else 0),
            repeats=np.zeros(len(self.repeats)),
            offered=flat,
            lost=np.zeros(2),
            late=np.concatenate([flat] * late) if late else np.zeros(0),
            timer=np.zeros(4 if self.jitters else 0),
        )

    def take(self, held: Held, y: Value, r: Value, faults: Value, dt: Value = None) -> Taken:
        """What the controller is handed of a sample, of what the sensor measures, the command, and the faults' values.

        dt  [s] of a solver step, on which a timer with jitter counts
        """
        kept: Kept = held.around
        flat, lost_y, lost_r = y.reshape(-1), 0 * faults[0] if self.faults else np.zeros(()), np.zeros(())
        late = np.concatenate([flat, kept.late[: -flat.size]]) if kept.late.size else kept.late
        offered, next_late = flat, 0 * held.started
        for i, one in enumerate(self.faults):
            value = faults[i]
            if one.kind == Dropout.kind:
                if one.command:
                    lost_r = np.where(value > 0, 1.0, lost_r)
                else:
                    lost_y = np.where(value > 0, 1.0, lost_y)
            elif one.kind == Jitter.kind:
                next_late = next_late + value * one.time
            else:
                offered = self._spoilt(one, value, offered, kept)
        due, wrong, timer = self._timer(kept.timer, next_late, dt)
        good = np.where(lost_y > 0, 0.0, np.where(wrong > 0, 0.0, self._plausible(offered, held)))
        begun = np.where(held.started > 0, 1.0, np.where(lost_r > 0, 0.0, good))
        return Taken(
            y=np.where(good > 0, offered, held.measured.reshape(-1)).reshape(y.shape),
            r=np.where(lost_r > 0, held.r, r),
            freeze=1.0 - good,
            begun=begun,
            due=due,
            wrong_time=wrong,
            offered=offered,
            lost=np.concatenate([lost_y.reshape(1), lost_r.reshape(1)]),
            late=late,
            timer=timer,
        )

    def _spoilt(self, one: OnLoop, value: Value, offered: Value, kept: Kept) -> Value:
        """What the sensor hands over with one more fault."""
        if one.kind == Latency.kind:
            size = offered.size
            wrong = np.where(value > 0, kept.late[(one.samples - 1) * size : one.samples * size], offered)
        elif one.kind == Stuck.kind:
            wrong = np.where(value > 0, kept.offered, offered)
        else:
            wrong = offered + value
        return np.where(one.where, wrong, offered)

    def _plausible(self, offered: Value, held: Held) -> Value:
        """1 where every channel is in its range, and has changed no faster than it can since the last good sample."""
        good, last = 1.0 + 0 * held.started, held.measured.reshape(-1)
        for i in self.ranged:
            good = np.where(offered[i] >= self.low[i], np.where(offered[i] <= self.high[i], good, 0.0), 0.0)
        for i in self.rated:
            moved, most = offered[i] - last[i], self.rate[i] * (held.around.outage[0] + 1.0)
            slow = np.where(moved <= most, np.where(-moved <= most, 1.0, 0.0), 0.0)
            good = np.where(held.started > 0, np.where(slow > 0, good, 0.0), good)
        for place, (i, most) in enumerate(self.repeats):
            stuck = np.where(offered[i] == last[i], np.where(held.around.repeats[place] >= float(most), 1.0, 0.0), 0.0)
            good = np.where(held.started > 0, np.where(stuck > 0, 0.0, good), good)
        return good

    def _repeated(self, taken: Taken, before: Held, old: Kept) -> Value:
        """What is counted of samples that are like the one before."""
        if not self.repeats:
            return old.repeats
        now, last = taken.y.reshape(-1), before.measured.reshape(-1)
        counted = []
        for place, (i, _) in enumerate(self.repeats):
            more = np.where(before.started > 0, np.where(now[i] == last[i], old.repeats[place] + 1.0, 0.0), 0.0)
            counted.append(np.where(taken.freeze > 0, old.repeats[place], more).reshape(1))
        return np.concatenate(counted)

    def _timer(self, timer: Value, next_late: Value, dt: Value) -> tuple[Value, Value, Value]:
        """Whether the timer calls at this step, at a time that is not taken, and what it keeps."""
        if not self.jitters:
            return np.ones(()), np.zeros(()), timer
        left, was_late, since, _ = timer[0], timer[1], timer[2], timer[3]
        due, first = np.where(left <= 0, 1.0, 0.0), np.where(since <= 0, 1.0, 0.0)
        if dt is None:  # what comes next is not asked
            dt = self.T
        every, steps_late = np.floor(self.T / dt + 0.5), np.floor(next_late / dt + 0.5)
        between = np.where(first > 0, self.T, since * dt)
        wrong = np.zeros(())
        if self.band is not None:
            off = between - self.T
            wrong = np.where(off <= self.band, np.where(-off <= self.band, 0.0, 1.0), 1.0)
        called = [every + steps_late - was_late - 1.0, steps_late, 1.0 + 0 * left, between]
        idle = [left - 1.0, was_late, since + 1.0, timer[3]]
        new = [np.where(due > 0, a, b).reshape(1) for a, b in zip(called, idle, strict=True)]
        return due, wrong, np.concatenate(new)

    def put_out(self, taken: Taken, before: Any, after: Any) -> Any:
        """The controller's whole state, an ``Acting``, after a sample, of which its list made ``after``, with its shell."""
        old: Kept = before.held.around
        miss = taken.freeze
        u, kept = np.where(miss > 0, before.held.u, after.held.u), old
        if self.counts:
            counted: Value = old.outage
            if self.longest is not None:
                counted = np.where(taken.wrong_time > 0, np.fmax(old.outage, float(self.longest)), old.outage)
            outage = np.where(miss > 0, np.fmin(counted + 1.0, float(MOST_COUNTED)), 0.0)
            kept = kept._replace(outage=outage)
        if self.longest is not None:
            u, kept = self._with_fallback(u, miss, before.held.u, old, kept)
        kept = kept._replace(repeats=self._repeated(taken, before.held, old))
        held = after.held._replace(u=u, around=kept)
        going = choose(taken.begun > 0, after._replace(held=held), before)
        seen = going.held.around._replace(offered=taken.offered, lost=taken.lost, late=taken.late)
        whole = going._replace(held=going.held._replace(around=seen))
        whole = choose(taken.due > 0, whole, before) if self.jitters else whole
        around = whole.held.around._replace(timer=taken.timer)
        return whole._replace(held=whole.held._replace(around=around))

    def _with_fallback(self, u: Value, miss: Value, last_u: Value, old: Kept, kept: Kept) -> tuple[Value, Kept]:
        """The control and what is kept where an outage has an end: what acts then, and a return without a bump."""
        assert self.longest is not None
        longest, fade = float(self.longest), float(self.fade)
        own, last = u.reshape(-1), last_u.reshape(-1)
        acts = kept.outage[0] > longest
        returns = np.where(miss > 0, 0.0, np.where(old.outage[0] > longest, 1.0, 0.0))
        bump = np.where(returns > 0, last - own, old.bump)
        left = np.where(returns > 0, fade, old.fade_left[0])
        faded = np.where(left > 0, own + bump * (left / fade), own) if self.fade else own
        fallen, nothing = last, np.abs(0 * last)  # no negative zero
        if self.fallback == "zero":
            fallen = nothing
        elif self.fallback == "fade":
            to_come = fade + longest + 1.0 - kept.outage[0]
            fallen = np.where(to_come > 0, last * ((to_come - 1.0) / to_come), nothing)
        found = np.where(miss > 0, np.where(acts, fallen, last), faded)
        still = np.where(left > 0, left - 1.0, left).reshape(1)
        return found.reshape(u.shape), kept._replace(fade_left=still, bump=bump)


def _repeats(shell: Shell, names: tuple[str, ...], T: float) -> tuple[tuple[int, int], ...]:
    """The places of channels that may be stuck, and how many samples in a row each may be like the one before."""
    found = [(i, shell.repeats(name, T)) for i, name in enumerate(names)]
    return tuple((i, most) for i, most in found if most is not None)
