"""What goes wrong between the plant and a sampled controller: lost, late, wrong and repeated measurements, drawn or at times.

A fault is a function of time, so that every controller of a case meets the same ones, and a finer step too. What is drawn is a
hash of the seed, of the fault's place in its list and of the time on a grid of nanoseconds: SplitMix64's output function
(Steele, Lea and Flood, 2014). It has the same bits everywhere and needs no order of evaluation.
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
"""[s] on which times are told apart: far below any sample time, far above the rounding of a time of hours."""
LARGEST_SEED = 2**64 - 1
COMMAND = "command"
"""The channel of the command, for dropouts."""


@dataclass(frozen=True, kw_only=True)
class Fault(Settings):
    """When a fault is there: by a share of the time, or at given times.

    share   of the samples, drawn independently; with ``burst`` of the time, drawn in bursts
    burst   how long a burst lasts [s]
    times   intervals [start, end) [s], instead of a share
    seed    fixes what is drawn, together with the fault's place among the case's
    """

    share: float | None = None
    burst: float | None = None
    times: tuple[tuple[float, float], ...] = ()
    seed: int = 0

    kind: ClassVar[str] = ""
    always: ClassVar[bool] = False
    """Whether it is there all the time unless something else is said."""

    __repr__ = one_line

    def __post_init__(self) -> None:
        if self.share is not None:
            share = validate.positive("share", self.share)
            if share > 1:
                raise InputError.of("share", f"must be at most 1, got {share:g}")
            freeze(self, share=share)
        if self.burst is not None:
            if self.share is None:
                raise InputError.of("burst", "goes with share, which is missing")
            burst = validate.positive("burst", self.burst)
            if burst < GRID:
                raise InputError.of("burst", f"must be at least {GRID:g} s, got {burst:g} s")
            freeze(self, burst=burst)
        freeze(self, times=_intervals(self.times), seed=validate.whole("seed", self.seed, least=0, most=LARGEST_SEED))
        if self.share is not None and self.times:
            raise InputError("give either share or times, got both")
        if self.share is None and not self.times and not self.always:
            raise InputError(f"a {self.kind} needs share or times, which say when it is there")

    def there(self, t: Array, place: int) -> Array:
        """Whether the fault, the ``place``-th of its case, is there at times t [s]."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        if self.share is not None:
            slots = ticks if self.burst is None else ticks // max(1, round(self.burst / GRID))
            return np.asarray(uniform(self.seed, place, slots) < self.share)
        if not self.times:
            return np.ones(ticks.shape, dtype=bool)
        edges = [(round(start / GRID), round(end / GRID)) for start, end in self.times]
        return np.any([(ticks >= start) & (ticks < end) for start, end in edges], axis=0)

    def value(self, t: Array, place: int) -> Array:
        """What the loop is handed of the fault at times t [s]: 1 where it is there, else 0."""
        return np.where(self.there(t, place), 1.0, 0.0)

    @property
    def channels(self) -> str:
        """The channel that it is on; empty for all that are measured."""
        return str(getattr(self, "channel", ""))

    @abstractmethod
    def require(self, names: tuple[str, ...]) -> None:
        """InputError for a channel that there is not; ``names`` are those that are measured."""


class OnChannel:
    """A fault on one measured channel, or on all of them."""

    channel: str

    def require(self, names: tuple[str, ...]) -> None:
        """InputError for a channel that there is not; ``names`` are those that are measured."""
        if self.channel not in ("", *names):
            raise InputError.of("channel", f"must be one of {', '.join(names)}, got {validate.show(self.channel)}")


@dataclass(frozen=True, kw_only=True)
class Dropout(OnChannel, Fault):
    """A measurement, or a command, that does not come.

    channel  a measured one, "command", or by default all that are measured. Where one entry does not come the whole
             measurement is lost
    """

    channel: str = ""
    kind: ClassVar[str] = "dropout"

    def require(self, names: tuple[str, ...]) -> None:
        """InputError for a channel that there is not; ``names`` are those that are measured."""
        if self.channel not in ("", COMMAND, *names):
            known = ", ".join((*names, COMMAND))
            raise InputError.of("channel", f"must be one of {known}, got {validate.show(self.channel)}")


@dataclass(frozen=True, kw_only=True)
class Spike(OnChannel, Fault):
    """A measurement with an error of a given size, whose sign is drawn for each sample.

    channel  the measured one; all by default
    size     [the channel's unit]
    """

    size: float
    channel: str = ""
    kind: ClassVar[str] = "spike"

    def __post_init__(self) -> None:
        freeze(self, size=validate.positive("size", self.size))
        super().__post_init__()

    def value(self, t: Array, place: int) -> Array:
        """What is added to the measurement at times t [s]."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        up = uniform(self.seed, place + SIGNS, ticks) < 0.5
        return np.where(self.there(t, place), np.where(up, self.size, -self.size), 0.0)


@dataclass(frozen=True, kw_only=True)
class Stuck(OnChannel, Fault):
    """A sensor that repeats its last value.

    channel  the measured one; all by default
    """

    channel: str = ""
    kind: ClassVar[str] = "stuck"


@dataclass(frozen=True, kw_only=True)
class Bias(OnChannel, Fault):
    """A measurement with a constant error while the fault is there.

    channel  the measured one; all by default
    size     [the channel's unit], of either sign
    """

    size: float
    channel: str = ""
    kind: ClassVar[str] = "bias"

    def __post_init__(self) -> None:
        freeze(self, size=validate.number("size", self.size))
        super().__post_init__()

    def value(self, t: Array, place: int) -> Array:
        """What is added to the measurement at times t [s]."""
        return np.where(self.there(t, place), self.size, 0.0)


@dataclass(frozen=True, kw_only=True)
class Latency(OnChannel, Fault):
    """A measurement that comes late: at each sample the controller gets what was measured some samples before.

    channel  the measured one; all by default
    time     [s], a whole number of sample times. All the time unless share or times say otherwise
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
    """A timer that calls early or late, uniformly distributed: measurement and control move with the call.

    time  by how much at most [s]: at least one solver step, and at most a quarter of the sample time, of all jitters of a case
          together. All the time unless share or times say otherwise
    """

    time: float
    kind: ClassVar[str] = "jitter"
    always: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, time=validate.positive("time", self.time))
        super().__post_init__()

    def require(self, names: tuple[str, ...]) -> None:
        """It is on no channel."""

    def value(self, t: Array, place: int) -> Array:
        """How late the next call is, as a part of ``time``, from -1 to 1."""
        ticks = np.round(np.asarray(t) / GRID).astype(np.int64)
        return np.where(self.there(t, place), 2 * uniform(self.seed, place + SIGNS, ticks) - 1, 0.0)


FAULTS = {kind.kind: kind for kind in (Dropout, Spike, Stuck, Bias, Jitter, Latency)}
"""The faults of the package by the names that case files use."""
SIGNS = 1 << 32
"""Added to a fault's place for a second number that is drawn of it: no case has so many faults."""


@dataclass(frozen=True)
class FaultSignal:
    """A fault as one of the functions of time that drive a loop, which looks at it at samples alone."""

    fault: Fault
    place: int

    def __call__(self, t: Array) -> Array:
        """The fault's value at times t [s]."""
        return self.fault.value(t, self.place)

    def before(self, t: Array) -> Array:
        """The same: nobody looks at it between samples."""
        return self(t)


def uniform(seed: int, place: int, slots: Array) -> Array:
    """Numbers from 0 to 1 of 53 bits for each slot, by SplitMix64's output function, applied twice."""
    with np.errstate(over="ignore"):
        key = _mixed(np.array([seed], dtype=np.uint64) + np.uint64(place + 1) * GOLDEN_GAMMA)
        found = _mixed(_mixed(slots.astype(np.uint64) * GOLDEN_GAMMA + key))
    return (found >> np.uint64(11)) * 2.0**-53


GOLDEN_GAMMA = np.uint64(0x9E3779B97F4A7C15)


def _mixed(z: Array) -> Array:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


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
