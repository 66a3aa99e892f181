"""The shell around a sampled controller, and the faults: which samples the controller receives, and the control that is put out.

Exported code has the same shell in C: ``export/templates/controller.c``. The operations here are the same, in the same order;
tests compare the two bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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
"""The largest count of consecutive misses; the counter stops there. The count plus any increment fits into the long of every C
compiler."""
LOST = 2.0
"""The value of the freeze switch at a sample without a measurement, where an observer is not corrected; the value 1 freezes
only the estimates and the law's memory."""
ROUNDINGS = 4 * float(np.finfo(float).eps)
"""Allowed relative rounding of a time between two calls at the edge of the band, because the edge belongs to the band."""
MOST_LATE = 1000
"""The largest latency in samples, each of which is stored."""


class Kept(NamedTuple):
    """The values stored from sample to sample; parts that a case does not need are empty."""

    outage: Value  # () consecutive misses, if limited
    fade_left: Value  # () remaining samples of the fade after a fallback
    bump: Value  # (m,) the step that fades out
    repeats: Value  # (k,) consecutive good samples equal to the previous one, for the channels that may be stuck
    offered: Value  # (y,) the sensor's last output, good or bad
    lost: Value  # (2,) 1 if the last measurement, or the last command, was lost
    late: Value  # (d y,) earlier measurements, the newest first
    age: Value  # () samples since the last good measurement, if a rate is limited; MOST_COUNTED before the first
    command_outage: Value  # () consecutive samples without a good command, if a command's rate is limited; MOST_COUNTED at first
    # () number of misses that calls at wrong times added to the outage, if times are checked (so are the next two)
    advanced: Value
    fade: Value  # () length of the fade that fade_left belongs to, in samples
    paused: Value  # () fade_left when the baseline began to act as the fallback
    commanded: Value  # (q,) the last command that arrived, good or bad, if commands are checked
    timer: Value  # (4,) steps to the next call, lateness of the last call, steps since it, time between the last two; or (0,).
    # Without fixed steps, if only calls are evaluated: 0, the next call's lateness, the time until it, time between the last two


class Taken(NamedTuple):
    """A sample in the form that the controller's list receives, and the shell's decisions about it."""

    y: Value
    r: Value
    freeze: Value  # LOST on a miss, otherwise 0
    begun: Value  # 1 once a controller continues from an earlier state
    fresh: Value  # 1 if y is a good measurement, even at a wrong time
    elapsed: Value  # samples since the last call, possibly not a whole number
    due: Value  # 1 if the timer calls
    wrong_time: Value  # 1 if it calls at a time that the shell does not accept
    offered: Value
    lost: Value
    late: Value
    command_outage: Value
    commanded: Value
    timer: Value


@dataclass(frozen=True, eq=False)
class OnLoop:
    """The effect of a fault while it is present; signals determine when it is.

    where    (y,) the channels that it affects
    command  whether it affects the command instead
    time     jitter time [s], or ``samples`` of latency
    """

    kind: str
    where: Array
    command: bool = False
    time: float = 0.0
    samples: int = 0

    @classmethod
    def of(cls, fault: Fault, names: tuple[str, ...], T: float, measured: int) -> OnLoop:
        """Raise InputError for a time that does not fit the sample time. ``where`` selects the measured channels; without a
        channel a fault affects all of them."""
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
    """The numbers of a shell, and the faults; arrays are (y,) for measured channels and (q,) for commands.

    low, high  accepted range; infinite for a channel without a range
    rate       the fastest accepted change between samples; infinite for a channel without a limit
    repeats    accepted number of equal samples in a row, by the channels' indices
    baseline   the fixed controller that acts as the fallback; None if another fallback acts
    gains      the nonzero entries (input, entry) of the gains of the command and of the feedback, where the states of the
               baseline follow the measurements
    ranged, rated  indices of the channels with a range or a rate limit, even if the numbers are symbols
    command_*  the same for the commands
    u_low, u_high  (m,) the actuator limits, within which a fade begins; ``limited`` are the inputs with limits
    T          time [s] between two calls, with the tolerance ``band`` [s]; None if a wrong time is only reported
    longest    number of consecutive misses before the fallback acts; None for no limit
    fade       number of samples of the fades of fallback and return; ``fades`` tells whether there is a fade
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
    command_low: Array = field(default_factory=lambda: np.zeros(0))
    command_high: Array = field(default_factory=lambda: np.zeros(0))
    command_rate: Array = field(default_factory=lambda: np.zeros(0))
    command_ranged: tuple[int, ...] = ()
    command_rated: tuple[int, ...] = ()
    u_low: Array = field(default_factory=lambda: np.zeros(0))
    u_high: Array = field(default_factory=lambda: np.zeros(0))
    limited: tuple[int, ...] = ()
    baseline: FixedController | None = None
    gains: tuple[tuple[tuple[int, int], ...], tuple[tuple[int, int], ...]] = ((), ())

    @classmethod
    def of(cls, problem: TrackingProblem, T: float) -> Around | None:
        """The shell and the faults; None if the case has neither. Raises InputError for times that do not fit the sample time T
        [s]."""
        shell = problem.shell
        if shell is None and not problem.faults:
            return None
        names = problem.handed_names
        commands = tuple("" if name in names else name for name in problem.command_names)
        (low, high, rate), (command_low, command_high, command_rate) = (_limits(shell, each, T) for each in (names, commands))
        ends = shell is not None and shell.longest_outage is not None
        longest, fade = map(float, shell.samples(T)) if shell is not None and ends else (None, 0.0)
        faults = tuple(OnLoop.of(fault, names, T, len(problem.measured_names)) for fault in problem.faults)
        u_low, u_high = np.array([(-inf, inf) if path.saturation is None else path.saturation for path in problem.plant.paths]).T
        baseline = problem.fixed if shell is not None and shell.fallback == "baseline" else None
        if (late := sum(one.time for one in faults)) > T / 4 * (1 + 1e-9):  # otherwise two calls could coincide
            limit = f"a quarter of the sample time of {T:g} s, even for several jitters together"
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
            command_low=command_low,
            command_high=command_high,
            command_rate=command_rate,
            command_ranged=tuple(np.flatnonzero(np.isfinite(command_low)).tolist()),
            command_rated=tuple(np.flatnonzero(np.isfinite(command_rate)).tolist()),
            u_low=u_low,
            u_high=u_high,
            limited=tuple(np.flatnonzero(np.isfinite(u_low)).tolist()),
            baseline=baseline,
            gains=((), ()) if baseline is None else (_places(baseline.k_r), _places(baseline.K)),
        )

    @classmethod
    def of_shell(cls, problem: TrackingProblem, T: float | None) -> Around | None:
        """The shell alone, for export."""
        return None if problem.shell is None or T is None else cls.of(replace(problem, faults=()), T)  # type: ignore[type-var]

    def require_taken(self, measured: Array, commands: Array, problem: TrackingProblem) -> None:
        """Raise InputError if the shell would reject a sample of a fault-free run, with measurements (K, y) and ``commands``
        (K, q)."""
        names = problem.handed_names
        of_commands = self.command_low, self.command_high, self.command_rate
        for given, each, (low, high, rate) in (
            (measured, names, (self.low, self.high, self.rate)),
            (commands, problem.command_names, of_commands),
        ):
            for name, key, wrong in (
                ("range", "leaves the range", (given < low) | (given > high)),
                ("rate", "exceeds the rate", np.abs(np.diff(given, axis=0, prepend=given[:1])) > rate),
            ):
                if wrong.any():
                    k, i = np.argwhere(wrong)[0].tolist()
                    raise InputError.of(
                        f"shell.{name}.{each[i]}",
                        f"rejects the case's fault-free run: {each[i]} {key} at sample {k}, t = {k * self.T:g} s",
                    )
        for i, most in self.repeats:
            run = 0
            for k in range(1, len(measured)):
                run = run + 1 if measured[k, i] == measured[k - 1, i] else 0
                if run > most:
                    raise InputError.of(
                        f"shell.stuck.{names[i]}",
                        f"rejects the case's fault-free run: {names[i]} repeats its value up to t = {k * self.T:g} s",
                    )

    @property
    def jitters(self) -> bool:
        """Whether calls may come at instants other than whole multiples of the sample time."""
        return any(one.kind == Jitter.kind for one in self.faults)

    def calls(self, faults: Sequence[Callable[[Array], Array]], end: float) -> Array:
        """The exact instants [s] of the timer's calls, from t = 0 to the first call after ``end``.

        faults  the signals of the case's faults; the jitter at each call determines the instant of the next one
        """
        jitters = [(fault, one.time) for fault, one in zip(faults, self.faults, strict=True) if one.kind == Jitter.kind]
        found = [0.0]
        while found[-1] <= end:
            now = np.array(found[-1:])
            found.append(len(found) * self.T + sum(float(fault(now)[0]) * time for fault, time in jitters))
        return np.array(found)

    def require_steps(self, dt: float) -> None:
        """Raise InputError for a jitter below the solver's step dt [s], which would have no effect."""
        for one in self.faults:
            if one.kind == Jitter.kind and one.time < dt * (1 - 1e-9):
                raise InputError(f"a jitter's time must be at least simulation.dt = {dt:g} s, got {one.time:g} s")

    @property
    def checks_commands(self) -> bool:
        """Whether a command may be rejected."""
        return bool(self.command_ranged or self.command_rated)

    def initial(self, y: Array, inputs: int) -> Kept:
        """The stored values before the first sample; ``y`` has the shape of the measurement."""
        flat, late = y.reshape(-1), max((one.samples for one in self.faults), default=0)
        ends, timed = np.zeros(0 if self.longest is None else 1), np.zeros(0 if self.band is None else 1)
        return Kept(
            outage=ends,
            fade_left=ends,
            bump=np.zeros(inputs if self.longest is not None else 0),
            repeats=np.zeros(len(self.repeats)),
            offered=flat,
            lost=np.zeros(2),
            late=np.concatenate([flat] * late) if late else np.zeros(0),
            age=np.full(1 if self.rated else 0, float(MOST_COUNTED)),
            command_outage=np.full(1 if self.command_rated else 0, float(MOST_COUNTED)),
            advanced=timed,
            fade=timed,
            paused=timed if self.baseline is not None else np.zeros(0),
            commanded=np.zeros(len(self.command_low) if self.checks_commands else 0),
            timer=np.zeros(4 if self.jitters else 0),
        )

    def take(self, held: Held, y: Value, r: Value, faults: Value, dt: Value = None) -> Taken:
        """The sample that the controller receives, from the sensor's output, the command, and the faults' values.

        dt  length of a solver step [s], the unit in which a timer with jitter counts; None if only its calls are evaluated, each
        when it is due
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
        elapsed = np.where(wrong > 0, np.floor(timer[3] / self.T) + 1.0, 1.0) if self.jitters else np.ones(())
        fresh = np.where(lost_y > 0, 0.0, self.plausible(offered, held.measured.reshape(-1), held, elapsed))
        good = np.where(wrong > 0, 0.0, fresh)
        command: Value = np.where(lost_r > 0, held.r, r)
        good_r = np.where(lost_r > 0, 0.0, self.plausible_command(command.reshape(-1), held.r.reshape(-1), held, elapsed))
        begun = np.where(held.started > 0, 1.0, good)
        more = np.fmin(kept.command_outage + elapsed, float(MOST_COUNTED))
        return Taken(
            y=np.where(fresh > 0, offered, held.measured.reshape(-1)).reshape(y.shape),
            r=np.where(good_r > 0, command, held.r),
            freeze=LOST * (1.0 - good),
            begun=begun,
            fresh=fresh,
            elapsed=elapsed,
            due=due,
            wrong_time=wrong,
            offered=offered,
            lost=np.concatenate([lost_y.reshape(1), lost_r.reshape(1)]),
            late=late,
            command_outage=np.where(good_r > 0, 0 * more, more),
            commanded=command.reshape(-1)[: kept.commanded.size],
            timer=timer,
        )

    def _spoilt(self, one: OnLoop, value: Value, offered: Value, kept: Kept) -> Value:
        """The sensor's output with one further fault."""
        if one.kind == Latency.kind:
            size = offered.size
            wrong = np.where(value > 0, kept.late[(one.samples - 1) * size : one.samples * size], offered)
        elif one.kind == Stuck.kind:
            wrong = np.where(value > 0, kept.offered, offered)
        else:
            wrong = offered + value
        return np.where(one.where, wrong, offered)

    def plausible(self, offered: Value, last: Value, held: Held, elapsed: Value) -> Value:
        """1 if every channel is in its range, and has changed no faster than accepted since the last good sample, if there is
        one. Many samples can be given at once, as columns of every array.

        elapsed  samples since the last call
        """
        good = 1.0 + 0 * held.started
        for i in self.ranged:
            good = np.where(offered[i] >= self.low[i], np.where(offered[i] <= self.high[i], good, 0.0), 0.0)
        for i in self.rated:
            slow = _slow(offered[i] - last[i], self.rate[i] * (held.around.age[0] + elapsed))
            good = np.where(held.around.age[0] >= MOST_COUNTED, good, np.where(slow > 0, good, 0.0))
        for place, (i, most) in enumerate(self.repeats):
            stuck = np.where(offered[i] == last[i], np.where(held.around.repeats[place] >= float(most), 1.0, 0.0), 0.0)
            good = np.where(stuck > 0, 0.0, good)
        return good

    def plausible_command(self, r: Value, last: Value, held: Held, elapsed: Value) -> Value:
        """1 if every command is in its range, and has changed no faster than accepted since the last good command, if there is
        one; ``elapsed`` as for ``plausible``."""
        good = 1.0 + 0 * held.started
        for i in self.command_ranged:
            good = np.where(r[i] >= self.command_low[i], np.where(r[i] <= self.command_high[i], good, 0.0), 0.0)
        for i in self.command_rated:
            slow = _slow(r[i] - last[i], self.command_rate[i] * (held.around.command_outage[0] + elapsed))
            good = np.where(held.around.command_outage[0] >= MOST_COUNTED, good, np.where(slow > 0, good, 0.0))
        return good

    def _repeated(self, taken: Taken, before: Held, old: Kept) -> Value:
        """The updated counts of samples equal to the previous one."""
        if not self.repeats:
            return old.repeats
        now, last = taken.y.reshape(-1), before.measured.reshape(-1)
        counted = []
        for place, (i, _) in enumerate(self.repeats):
            more = np.where(before.started > 0, np.where(now[i] == last[i], old.repeats[place] + 1.0, 0.0), 0.0)
            counted.append(np.where(taken.fresh > 0, more, old.repeats[place]).reshape(1))
        return np.concatenate(counted)

    def _timer(self, timer: Value, next_late: Value, dt: Value) -> tuple[Value, Value, Value]:
        """Whether the timer calls at this step, whether the time is not accepted, and the timer's updated values."""
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
        """The whole state of the controller, an ``Acting``, after a sample with its shell; ``after`` is the result of its
        list."""
        old: Kept = before.held.around
        miss = taken.freeze
        u, kept = np.where(miss > 0, before.held.u, after.held.u), old
        if self.longest is not None:
            counted: Value = np.where(taken.wrong_time > 0, np.fmax(old.outage, self.longest), old.outage)
            if self.band is not None:
                missed = np.where(taken.wrong_time > 0, np.fmax(taken.elapsed - 2.0, 0.0), 0.0)
                advanced = np.fmax(old.advanced + (counted - old.outage) - missed, 0.0)
                kept = kept._replace(advanced=np.where(miss > 0, advanced, 0.0))
            kept = kept._replace(outage=np.where(miss > 0, np.fmin(counted + 1.0, float(MOST_COUNTED)), 0.0))
            u, kept = self._with_fallback(u, taken, before.held, kept)
        age = np.where(taken.fresh > 0, 0.0, np.fmin(old.age + taken.elapsed, float(MOST_COUNTED))) if self.rated else old.age
        kept = kept._replace(repeats=self._repeated(taken, before.held, old), age=age)
        held = after.held._replace(u=u, around=kept)
        if self.baseline is not None:  # the baseline's states are held while it acts on a held measurement
            acts = kept.outage[0] > self.longest
            held = held._replace(baseline=np.where(acts, before.held.baseline, held.baseline))
        waiting = before.held._replace(u=u, measured=taken.y, r=taken.r, around=kept)  # for the first good sample
        going = choose(taken.begun > 0, after._replace(held=held), before._replace(held=waiting))
        arrived = {name: getattr(taken, name) for name in ("offered", "lost", "late", "command_outage", "commanded")}
        seen = going.held.around._replace(**arrived)
        whole = going._replace(held=going.held._replace(around=seen))
        whole = choose(taken.due > 0, whole, before) if self.jitters else whole
        around = whole.held.around._replace(timer=taken.timer)
        return whole._replace(held=whole.held._replace(around=around))

    def _with_fallback(self, u: Value, taken: Taken, before: Held, kept: Kept) -> tuple[Value, Kept]:
        """The control and the stored values if an outage has a limit: the fallback and the bumpless return, both of which begin
        from the control limited to the actuator range."""
        assert self.longest is not None
        miss = taken.freeze
        old: Kept = before.around
        longest, fade = self.longest, self.fade
        own, last = u.reshape(-1), before.u.reshape(-1)
        acts = kept.outage[0] > longest
        returns = np.where(miss > 0, 0.0, np.where(old.outage[0] > longest, 1.0, 0.0))
        begins = np.where(acts, np.where(old.outage[0] > longest, 0.0, 1.0), 0.0)
        within = self._limited(last)
        bump = np.where(returns > 0, within - own, old.bump)
        left, paused = np.where(returns > 0, fade, old.fade_left[0]), old.paused
        whole: Value = fade
        if self.band is not None:
            left, whole = self._after_wrong_times(returns, old)
        fallen, nothing = last, np.abs(0 * last)  # no negative zero
        if self.baseline is not None:
            alone = self._baseline(before, taken)
            bump, left = np.where(begins > 0, within - alone, bump), np.where(begins > 0, fade, left)
            if self.band is not None:
                whole, paused = np.where(begins > 0, fade, whole), np.where(begins > 0, old.fade_left, paused)
        share = left / (fade if self.band is None else np.fmax(whole, 1.0)) if self.fades else left
        if self.baseline is not None:
            fallen = np.where(left > 0, alone + bump * share, alone) if self.fades else alone
        faded = np.where(left > 0, own + bump * share, own) if self.fades else own
        if self.fallback == "zero":
            fallen = nothing
        elif self.fallback == "fade":
            to_come = fade + longest + 1.0 - kept.outage[0]
            fallen = np.where(to_come > 0, np.where(begins > 0, within, last) * (1.0 - 1.0 / to_come), nothing)
        found = np.where(miss > 0, np.where(acts, fallen, last), faded)
        still = np.where(left > 0, left - 1.0, left)  # a fade pauses while the control is held
        still = np.where(miss > 0, np.where(acts, still, left) if self.baseline is not None else left, still).reshape(1)
        kept = kept._replace(fade_left=still, bump=bump, paused=paused)
        return found.reshape(u.shape), kept._replace(fade=whole.reshape(1)) if self.band is not None else kept

    def _after_wrong_times(self, returns: Value, old: Kept) -> tuple[Value, Value]:
        """The remaining samples of a fade, and its whole number of samples, if wrong times may have triggered the fallback.

        If no more samples were missed than the longest outage allows, the return takes at most as many samples as were missed,
        and the rest of an earlier fade continues. Otherwise repeated wrong calls would hold the control forever.
        """
        earlier = old.fade_left[0] if self.baseline is None else old.paused[0]
        missed = old.outage[0] - old.advanced[0]
        short = np.where(missed <= self.longest, returns, 0.0)
        rest = np.fmax(earlier + 1.0, np.fmin(missed, self.fade))
        left = np.where(returns > 0, np.where(short > 0, rest - 1.0, self.fade), old.fade_left[0])
        return left, np.where(returns > 0, np.where(short > 0, rest, self.fade), old.fade[0])

    def _limited(self, u: Value) -> Value:
        """(m,) limited to the actuator range."""
        each = [u[i] for i in range(len(self.u_low))]
        for i in self.limited:
            each[i] = np.where(each[i] < self.u_low[i], self.u_low[i], each[i])
            each[i] = np.where(each[i] > self.u_high[i], self.u_high[i], each[i])
        return np.concatenate([one.reshape(1) for one in each])

    def _baseline(self, before: Held, taken: Taken) -> Value:
        """k_r r - K z from the last good measurement and the baseline's previous states, with the products in the order of the C
        code."""
        assert self.baseline is not None
        r, z = taken.r.reshape(-1), np.concatenate([taken.y.reshape(-1), before.baseline])
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


def _limits(shell: Shell | None, names: tuple[str, ...], T: float) -> tuple[Array, Array, Array]:
    """The lowest and highest value of each channel, and its largest change between two samples."""
    ranges = [(-inf, inf) if shell is None else shell.range.get(name, (-inf, inf)) for name in names]
    low, high = np.array(ranges, dtype=float).T
    return low, high, np.array([inf if shell is None else shell.rate.get(name, inf) for name in names]) * T


def _slow(moved: Value, most: Value) -> Value:
    return np.where(moved <= most, np.where(-moved <= most, 1.0, 0.0), 0.0)


def _places(gains: Array) -> tuple[tuple[int, int], ...]:
    """The positions of a matrix's nonzero entries."""
    return tuple((int(row), int(column)) for row, column in np.argwhere(gains))


def _repeats(shell: Shell, names: tuple[str, ...], T: float) -> tuple[tuple[int, int], ...]:
    """The indices of channels that may be stuck, and the accepted number of equal samples in a row for each."""
    found = [(i, shell.repeats(name, T)) for i, name in enumerate(names)]
    return tuple((i, most) for i, most in found if most is not None)
