"""Faults between the plant and a sampled controller: lost, late, wrong and repeated measurements, at random or at given times.

A fault is a function of time, so every controller of a case, and every finer step, has the same faults. Only the instants of a
jittered timer are rounded to the solver's steps. Random faults are a hash of the seed, of the fault's position in its list and of
the time on a grid of nanoseconds, by SplitMix64's output function (Steele, Lea and Flood, 2014). The result is the same, bit for
bit, on every machine and in every order of evaluation.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, freeze

GRID = 1e-9
"""Resolution of times [s], which is far below any sample time and far above the rounding of a time of hours."""
LARGEST_SEED = 2**64 - 1
COMMAND = "command"
"""The channel name of the command, for dropouts."""


@dataclass(frozen=True, kw_only=True)
class Fault(Settings):
    """When a fault is present: for a fraction of the time, or at given times.

    share   fraction of the samples, drawn independently; with ``burst``, fraction of the time, drawn in bursts
    burst   the length of a burst [s]
    times   intervals [start, end) [s], instead of a fraction
    seed    determines the random numbers, together with the fault's position in the case
    """

    share: float | None = None
    burst: float | None = None
    times: tuple[tuple[float, float], ...] = ()
    seed: int = 0

    kind: ClassVar[str] = ""
    always: ClassVar[bool] = False
    """Whether the fault is always present by default."""

    __repr__ = one_line

    def __post_init__(self) -> None:
        if self.share is not None:
            share = validate.positive("share", self.share)
            if share > 1:
                raise InputError.of("share", f"must be at most 1, got {share:g}")
            freeze(self, share=share)
        if self.burst is not None:
            if self.share is None:
                raise InputError.of("burst", "needs share, which is missing")
            burst = validate.positive("burst", self.burst)
            if burst < GRID:
                raise InputError.of("burst", f"must be at least {GRID:g} s, got {burst:g} s")
            freeze(self, burst=burst)
        freeze(self, times=_intervals(self.times), seed=validate.whole("seed", self.seed, least=0, most=LARGEST_SEED))
        if self.share is not None and self.times:
            raise InputError("give either share or times, got both")
        if self.share is None and not self.times and not self.always:
            raise InputError(f"a {self.kind} needs share or times, which determine when it acts")

    def there(self, t: Array, place: int) -> Array:
        """Return whether the fault at position ``place`` of its case is present at times t [s]."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        if self.share is not None:
            slots = ticks if self.burst is None else ticks // max(1, round(self.burst / GRID))
            return np.asarray(uniform(self.seed, place, slots) < self.share)
        if not self.times:
            return np.ones(ticks.shape, dtype=bool)
        edges = [(round(start / GRID), round(end / GRID)) for start, end in self.times]
        return np.any([(ticks >= start) & (ticks < end) for start, end in edges], axis=0)

    def value(self, t: Array, place: int) -> Array:
        """Return the fault signal that the loop receives at times t [s], which is 1 while the fault is present, else 0."""
        return np.where(self.there(t, place), 1.0, 0.0)

    @property
    def channels(self) -> str:
        """The channel that the fault affects; an empty name means all measured channels."""
        return str(getattr(self, "channel", ""))

    @abstractmethod
    def require(self, names: tuple[str, ...]) -> None:
        """Raise InputError for an unknown channel. ``names`` are the measured channels."""


class OnChannel:
    """A fault of one measured channel, or of all of them."""

    channel: str

    def require(self, names: tuple[str, ...]) -> None:
        """Raise InputError for an unknown channel. ``names`` are the measured channels."""
        if self.channel not in ("", *names):
            raise InputError.of("channel", f"must be one of {', '.join(names)}, got {validate.show(self.channel)}")


@dataclass(frozen=True, kw_only=True)
class Dropout(OnChannel, Fault):
    """A measurement, or a command, that is lost.

    channel  a measured channel, "command", or by default all measured channels. If one entry is lost, the whole measurement is
             lost
    """

    channel: str = ""
    kind: ClassVar[str] = "dropout"

    def require(self, names: tuple[str, ...]) -> None:
        """Raise InputError for an unknown channel. ``names`` are the measured channels."""
        if self.channel not in names and self.channel.startswith(f"{COMMAND}_"):
            raise InputError.of(
                "channel",
                f"must be {COMMAND}, got {validate.show(self.channel)}: if one command is lost, the last good values of all "
                "commands are held",
            )
        if self.channel not in ("", COMMAND, *names):
            known = ", ".join((*names, COMMAND))
            raise InputError.of("channel", f"must be one of {known}, got {validate.show(self.channel)}")


@dataclass(frozen=True, kw_only=True)
class Spike(OnChannel, Fault):
    """A measurement with an error of a given size and a random sign at each sample.

    channel  the measured channel; all by default
    size     [the channel's unit]
    """

    size: float
    channel: str = ""
    kind: ClassVar[str] = "spike"

    def __post_init__(self) -> None:
        freeze(self, size=validate.positive("size", self.size))
        super().__post_init__()

    def value(self, t: Array, place: int) -> Array:
        """Return the error that is added to the measurement at times t [s]."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        up = uniform(self.seed, place + SIGNS, ticks) < 0.5
        return np.where(self.there(t, place), np.where(up, self.size, -self.size), 0.0)


@dataclass(frozen=True, kw_only=True)
class Stuck(OnChannel, Fault):
    """A sensor that repeats its last value.

    channel  the measured channel; all by default
    """

    channel: str = ""
    kind: ClassVar[str] = "stuck"


@dataclass(frozen=True, kw_only=True)
class Bias(OnChannel, Fault):
    """A measurement with a constant error while the fault is present.

    channel  the measured channel; all by default
    size     [the channel's unit], of either sign
    """

    size: float
    channel: str = ""
    kind: ClassVar[str] = "bias"

    def __post_init__(self) -> None:
        freeze(self, size=validate.number("size", self.size))
        super().__post_init__()

    def value(self, t: Array, place: int) -> Array:
        """Return the error that is added to the measurement at times t [s]."""
        return np.where(self.there(t, place), self.size, 0.0)


@dataclass(frozen=True, kw_only=True)
class Latency(OnChannel, Fault):
    """A late measurement: at each sample the controller receives the measurement of some samples earlier.

    channel  the measured channel; all by default
    time     [s], a whole number of sample times. The fault is always present unless share or times are given
    """

    time: float
    channel: str = ""
    kind: ClassVar[str] = "latency"
    always: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, time=validate.positive("time", self.time))
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class Jitter(Fault):
    """A timer that calls early or late, uniformly distributed: measurement and control are taken at the time of the call.

    time  the largest deviation [s] of a call: at least one solver step if steps are fixed, and at most a quarter of the sample
          time for all jitters of a case together. The time between two calls deviates by up to twice as much, which
          `shell.jitter` bounds. The fault is always present unless share or times are given
    """

    time: float
    kind: ClassVar[str] = "jitter"
    always: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, time=validate.positive("time", self.time))
        super().__post_init__()

    def require(self, names: tuple[str, ...]) -> None:
        """Check nothing, because jitter affects no channel."""

    def value(self, t: Array, place: int) -> Array:
        """Return the deviation of the next call as a fraction of ``time``, from -1 (early) to 1 (late)."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        return np.where(self.there(t, place), 2 * uniform(self.seed, place + SIGNS, ticks) - 1, 0.0)


FAULTS = {kind.kind: kind for kind in (Dropout, Spike, Stuck, Bias, Jitter, Latency)}
"""The package's faults by their names in case files."""
SIGNS = 1 << 32
"""Number that is added to a fault's position for its second random number. No case has that many faults."""


@dataclass(frozen=True)
class FaultSignal:
    """A fault as a function of time that drives the loop. The loop evaluates it only at samples."""

    fault: Fault
    place: int

    def __call__(self, t: Array) -> Array:
        """Return the fault's value at times t [s]."""
        return self.fault.value(t, self.place)

    def before(self, t: Array) -> Array:
        """Return the fault's value at times t [s]. It is evaluated only at samples, so the limit from the left is not needed."""
        return self(t)


def uniform(seed: int, place: int, slots: Array) -> Array:
    """Return a uniform number from 0 to 1 with 53 bits for each slot, by SplitMix64's output function, applied twice."""
    with np.errstate(over="ignore"):
        key = _mixed(np.array([seed], dtype=np.uint64) + np.uint64(place + 1) * GOLDEN_GAMMA)
        found = _mixed(_mixed(slots.astype(np.uint64) * GOLDEN_GAMMA + key))
    return (found >> np.uint64(UNUSED_BITS)) * 2.0**-53


GOLDEN_GAMMA = np.uint64(0x9E3779B97F4A7C15)
SHIFTS = 30, 27, 31
FACTORS = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB
UNUSED_BITS = 11
"""Number of unused bits among the 64. The other 53 are a double's integer precision."""


def _mixed(z: Array) -> Array:
    for shift, factor in zip(SHIFTS, FACTORS, strict=False):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray(z ^ (z >> np.uint64(SHIFTS[-1])))


def _intervals(given: object) -> tuple[tuple[float, float], ...]:
    if not isinstance(given, (list, tuple)):
        raise InputError.of("times", f"must be a list of [start, end], got {validate.show(given)}")
    found = []
    for one in given:
        start, end = validate.vector("times", one, 2).tolist()
        if not 0 <= start < end:
            raise InputError.of("times", f"must be intervals [start, end] with 0 <= start < end, got {validate.show(one)}")
        found.append((start, end))
    return tuple(found)
