"""The shell around a sampled controller, and the faults: the samples that the controller receives, and the control that is put
out.

Exported code has the same shell in C: ``export/templates/controller.c``. The operations here are the same, in the same order, and
tests compare the two bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from barbalat.loop.packing import Held
from barbalat.problem.baseline import FixedController
from barbalat.problem.faults import COMMAND, Dropout, Fault, Jitter, Latency, Stuck
from barbalat.problem.shell import Shell
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Value
from barbalat.protocols import kept as choose
from barbalat.validate import Array, InputError

MOST_COUNTED = 10**9
"""The largest count of consecutive misses, at which the counter stays. The count plus any increment fits into the long of
every C compiler."""
LOST = 2.0
"""The value of the freeze switch at a sample without a measurement, which corrects no observer; the value 1 freezes only what
is learnt."""
ROUNDINGS = 4 * float(np.finfo(float).eps)
"""Relative rounding of a time between two calls: by so much it may be beyond the edge of the band, which belongs to it."""
MOST_LATE = 1000
"""The largest latency in samples, each of which is stored."""


class Kept(NamedTuple):
    """The values stored from sample to sample; parts that a case does not need are empty."""

    outage: Value  # () consecutive misses
    fade_left: Value  # () remaining samples of the fade after a fallback
    bump: Value  # (m,) the step that fades out
    repeats: Value  # (k,) consecutive good samples equal to the previous one, for the channels that may be stuck
    offered: Value  # (y,) the sensor's last output, right or wrong
    lost: Value  # (2,) 1 if the last measurement, or the last command, was lost
    late: Value  # (d y,) earlier measurements, the newest first
    timer: Value  # (4,) steps to the next call, lateness of the last one, steps since it, time between the last two; or (0,).
    # Without fixed steps, when only calls are evaluated: 0, the next one's lateness, the time until it, time between the last two


class Taken(NamedTuple):
    """A sample as the controller's list receives it, and the decisions about it."""

    y: Value
    r: Value
    freeze: Value  # LOST on a miss, else 0
    begun: Value  # 1 if there is a controller that continues, now or before
    due: Value  # 1 if the timer calls
    wrong_time: Value  # 1 if it calls at a time that the shell does not accept
    offered: Value
    lost: Value
    late: Value
    timer: Value


@dataclass(frozen=True, eq=False)
class OnLoop:
    """The effect of a fault while it is present; signals say when it is.

    where    (y,) the channels that it affects
    command  whether it affects the command instead
    time     [s] of a jitter; ``samples`` of a latency
    """

    kind: str
    where: Array
    command: bool = False
    time: float = 0.0
    samples: int = 0

    @classmethod
    def of(cls, fault: Fault, names: tuple[str, ...], T: float, measured: int) -> OnLoop:
        """InputError for a time that does not fit the sample time; a fault of all channels affects one of those measured."""
        on = np.array([fault.channels == name or (not fault.channels and i < measured) for i, name in enumerate(names)])
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

    low, high  accepted range; infinite for a channel without one
    rate       the fastest accepted change between samples; infinite for a channel without a limit
    repeats    accepted number of equal samples in a row, by the channels' indices
    baseline   the fixed controller that acts as the fallback; None if another fallback acts
    gains      the nonzero entries (input, entry) of the gains of the command and of what is fed back, with its own states after
               the measurements
    ranged, rated  indices of the channels with a range or a rate limit, also if their numbers are symbols
    T          [s] between two calls, with the tolerance ``band`` [s]; None if a wrong time is only reported
    longest    consecutive misses before the fallback acts, a whole number; None for no limit
    fade       samples of the fallback's fade, and of the return, a whole number; ``fades`` says whether there are any
    """

    low: Array
    high: Array
    rate: Array
    T: float
    band: float | None
    longest: float | None
    fade: float
    fallback: str
    faults: tuple[OnLoop, ...]
    repeats: tuple[tuple[int, int], ...] = ()
    fades: bool = False
    ranged: tuple[int, ...] = ()
    rated: tuple[int, ...] = ()
    baseline: FixedController | None = None
    gains: tuple[tuple[tuple[int, int], ...], tuple[tuple[int, int], ...]] = ((), ())

    @classmethod
    def of(cls, problem: TrackingProblem, T: float) -> Around | None:
        """The shell and the faults; None without both; InputError for times that do not fit the sample time T [s]."""
        shell = problem.shell
        if shell is None and not problem.faults:
            return None
        names = problem.handed_names
        ranges = [(-inf, inf) if shell is None else shell.range.get(name, (-inf, inf)) for name in names]
        low, high = np.array(ranges, dtype=float).T
        rate = np.array([inf if shell is None else shell.rate.get(name, inf) for name in names]) * T
        ends = shell is not None and shell.longest_outage is not None
        longest, fade = map(float, shell.samples(T)) if shell is not None and ends else (None, 0.0)
        faults = tuple(OnLoop.of(fault, names, T, len(problem.measured_names)) for fault in problem.faults)
        baseline = problem.fixed if shell is not None and shell.fallback == "baseline" else None
        if (late := sum(one.time for one in faults)) > T / 4 * (1 + 1e-9):  # otherwise two calls could coincide
            limit = f"a quarter of the sample time of {T:g} s, also for several jitters together"
            raise InputError(f"a jitter's time must be at most {limit}, got {late:g} s")
        return cls(
            low=low,
            high=high,
            rate=rate,
            T=T,
            band=None if shell is None or shell.jitter is None else shell.jitter * T,
            longest=longest,
            fade=fade,
            fades=fade > 0,
            fallback="hold" if shell is None else shell.fallback,
            faults=faults,
            repeats=() if shell is None else _repeats(shell, names, T),
            ranged=tuple(np.flatnonzero(np.isfinite(low)).tolist()),
            rated=tuple(np.flatnonzero(np.isfinite(rate)).tolist()),
            baseline=baseline,
            gains=((), ()) if baseline is None else (_places(baseline.k_r), _places(baseline.K)),
        )

    @classmethod
    def of_shell(cls, problem: TrackingProblem, T: float | None) -> Around | None:
        """The shell alone, for export."""
        return None if problem.shell is None or T is None else cls.of(replace(problem, faults=()), T)  # type: ignore[type-var]

    def require_taken(self, measured: Array, names: tuple[str, ...]) -> None:
        """InputError if a sample of a run without faults, of which (K, y) was measured, is not accepted."""
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

    def calls(self, faults: Sequence[Callable[[Array], Array]], end: float) -> Array:
        """The exact instants [s] of the timer's calls from t = 0 up to the first one beyond ``end``.

        faults  the signals of the case's faults; the jitter at each call determines when the next one comes
        """
        jitters = [(fault, one.time) for fault, one in zip(faults, self.faults, strict=True) if one.kind == Jitter.kind]
        found = [0.0]
        while found[-1] <= end:
            now = np.array(found[-1:])
            found.append(len(found) * self.T + sum(float(fault(now)[0]) * time for fault, time in jitters))
        return np.array(found)

    def require_steps(self, dt: float) -> None:
        """InputError for a jitter below the solver's step dt [s], which would have no effect."""
        for one in self.faults:
            if one.kind == Jitter.kind and one.time < dt * (1 - 1e-9):
                raise InputError(f"a jitter's time must be at least simulation.dt = {dt:g} s, got {one.time:g} s")

    @property
    def counts(self) -> bool:
        """Whether anything depends on the number of missed samples."""
        return self.longest is not None or bool(self.rated)

    def initial(self, y: Array, inputs: int) -> Kept:
        """The stored values before the first sample; ``y`` has the shape of the measurement."""
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
        """The sample that the controller receives, from the sensor's output, the command, and the faults' values.

        dt  [s] of a solver step, in which a timer with jitter counts; None if only its calls are evaluated, each when it is due
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
            freeze=LOST * (1.0 - good),
            begun=begun,
            due=due,
            wrong_time=wrong,
            offered=offered,
            lost=np.concatenate([lost_y.reshape(1), lost_r.reshape(1)]),
            late=late,
            timer=timer,
        )

    def _spoilt(self, one: OnLoop, value: Value, offered: Value, kept: Kept) -> Value:
        """The sensor's output with one more fault."""
        if one.kind == Latency.kind:
            size = offered.size
            wrong = np.where(value > 0, kept.late[(one.samples - 1) * size : one.samples * size], offered)
        elif one.kind == Stuck.kind:
            wrong = np.where(value > 0, kept.offered, offered)
        else:
            wrong = offered + value
        return np.where(one.where, wrong, offered)

    def _plausible(self, offered: Value, held: Held) -> Value:
        """1 if every channel is in its range, and has changed no faster than accepted since the last good sample."""
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
        """The updated counts of samples equal to the previous one."""
        if not self.repeats:
            return old.repeats
        now, last = taken.y.reshape(-1), before.measured.reshape(-1)
        counted = []
        for place, (i, _) in enumerate(self.repeats):
            more = np.where(before.started > 0, np.where(now[i] == last[i], old.repeats[place] + 1.0, 0.0), 0.0)
            counted.append(np.where(taken.freeze > 0, old.repeats[place], more).reshape(1))
        return np.concatenate(counted)

    def _timer(self, timer: Value, next_late: Value, dt: Value) -> tuple[Value, Value, Value]:
        """Whether the timer calls at this step, whether at a time that is not accepted, and its updated values."""
        if not self.jitters:
            return np.ones(()), np.zeros(()), timer
        left, was_late, since, _ = timer[0], timer[1], timer[2], timer[3]
        due, first = np.where(left <= 0, 1.0, 0.0), np.where(since <= 0, 1.0, 0.0)
        between = np.where(first > 0, self.T, since if dt is None else since * dt)
        wrong = np.zeros(())
        if self.band is not None:
            off, band = between - self.T, self.band + ROUNDINGS * between
            wrong = np.where(off <= band, np.where(-off <= band, 0.0, 1.0), 1.0)
        if dt is None:
            seconds = (0 * left, next_late, self.T + next_late - was_late, between)
            return due, wrong, np.concatenate([one.reshape(1) for one in seconds])
        every, steps_late = np.floor(self.T / dt + 0.5), np.floor(next_late / dt + 0.5)
        called = [every + steps_late - was_late - 1.0, steps_late, 1.0 + 0 * left, between]
        idle = [left - 1.0, was_late, since + 1.0, timer[3]]
        new = [np.where(due > 0, a, b).reshape(1) for a, b in zip(called, idle, strict=True)]
        return due, wrong, np.concatenate(new)

    def put_out(self, taken: Taken, before: Any, after: Any) -> Any:
        """The controller's whole state, an ``Acting``, after a sample with its shell; ``after`` is the result of its list."""
        old: Kept = before.held.around
        miss = taken.freeze
        u, kept = np.where(miss > 0, before.held.u, after.held.u), old
        if self.counts:
            counted: Value = old.outage
            if self.longest is not None:
                counted = np.where(taken.wrong_time > 0, np.fmax(old.outage, self.longest), old.outage)
            outage = np.where(miss > 0, np.fmin(counted + 1.0, float(MOST_COUNTED)), 0.0)
            kept = kept._replace(outage=outage)
        if self.longest is not None:
            u, kept = self._with_fallback(u, miss, before.held, after.held, kept)
        kept = kept._replace(repeats=self._repeated(taken, before.held, old))
        held = after.held._replace(u=u, around=kept)
        if self.baseline is not None:  # whose states are held while it acts on a held measurement
            acts = kept.outage[0] > self.longest
            held = held._replace(baseline=np.where(acts, before.held.baseline, held.baseline))
        going = choose(taken.begun > 0, after._replace(held=held), before)
        seen = going.held.around._replace(offered=taken.offered, lost=taken.lost, late=taken.late)
        whole = going._replace(held=going.held._replace(around=seen))
        whole = choose(taken.due > 0, whole, before) if self.jitters else whole
        around = whole.held.around._replace(timer=taken.timer)
        return whole._replace(held=whole.held._replace(around=around))

    def _with_fallback(self, u: Value, miss: Value, before: Held, after: Held, kept: Kept) -> tuple[Value, Kept]:
        """The control and the stored values if an outage has a limit: the fallback, and the bumpless return."""
        assert self.longest is not None
        old: Kept = before.around
        longest, fade = self.longest, self.fade
        own, last = u.reshape(-1), before.u.reshape(-1)
        acts = kept.outage[0] > longest
        returns = np.where(miss > 0, 0.0, np.where(old.outage[0] > longest, 1.0, 0.0))
        bump = np.where(returns > 0, last - own, old.bump)
        left = np.where(returns > 0, fade, old.fade_left[0])
        fallen, nothing = last, np.abs(0 * last)  # no negative zero
        if self.baseline is not None:
            alone = self._baseline(before, after)
            begins = np.where(acts, np.where(old.outage[0] > longest, 0.0, 1.0), 0.0)
            bump, left = np.where(begins > 0, last - alone, bump), np.where(begins > 0, fade, left)
            fallen = np.where(left > 0, alone + bump * (left / fade), alone) if self.fades else alone
        faded = np.where(left > 0, own + bump * (left / fade), own) if self.fades else own
        if self.fallback == "zero":
            fallen = nothing
        elif self.fallback == "fade":
            to_come = fade + longest + 1.0 - kept.outage[0]
            fallen = np.where(to_come > 0, last * ((to_come - 1.0) / to_come), nothing)
        found = np.where(miss > 0, np.where(acts, fallen, last), faded)
        still = np.where(left > 0, left - 1.0, left)  # a fade waits while the control is held
        still = np.where(miss > 0, np.where(acts, still, left) if self.baseline is not None else left, still).reshape(1)
        return found.reshape(u.shape), kept._replace(fade_left=still, bump=bump)

    def _baseline(self, before: Held, after: Held) -> Value:
        """k_r r - K z, product by product as in C, with the last good measurement and the baseline's previous states."""
        assert self.baseline is not None
        r, z = after.r.reshape(-1), np.concatenate([after.measured.reshape(-1), before.baseline])
        return np.concatenate([self._one_of(j, r, z).reshape(1) for j in range(len(self.baseline.K))])

    def _one_of(self, j: int, r: Value, z: Value) -> Value:
        assert self.baseline is not None
        of_r, of_z = ([i for row, i in places if row == j] for places in self.gains)
        found: Value = None
        for i in of_r:
            product = self.baseline.k_r[j, i] * r[i]
            found = product if found is None else found + product
        for i in of_z:
            product = self.baseline.K[j, i] * z[i]
            found = -product if found is None else found - product
        return np.abs(0 * z[0]) if found is None else found


def _places(gains: Array) -> tuple[tuple[int, int], ...]:
    """The positions of a matrix's nonzero entries."""
    return tuple((int(row), int(column)) for row, column in np.argwhere(gains))


def _repeats(shell: Shell, names: tuple[str, ...], T: float) -> tuple[tuple[int, int], ...]:
    """The indices of channels that may be stuck, and the accepted number of equal samples in a row for each."""
    found = [(i, shell.repeats(name, T)) for i, name in enumerate(names)]
    return tuple((i, most) for i, most in found if most is not None)
