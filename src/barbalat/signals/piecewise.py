"""Signals with jumps. The value at a jump is the value just after it, and ``before`` gives the value just before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.settings import Settings
from barbalat.signals.smooth import Resting, Swinging, outward, store_numbers
from barbalat.validate import Array, InputError

MOST_BREAKS = 10_000_000
"""The largest number of breaks returned for an interval; further ones are omitted, because all breaks of a signal with a million
breaks in each step would fill the memory."""


def between(start: float, stop: float, instants: Array) -> Array:
    """Return the instants that lie in (start, stop)."""
    return instants[(instants > start) & (instants < stop)]


def rounding_of(t: Array) -> Array:
    """A tolerance of a few rounding errors at time t. A jump this close to a grid time counts as being at that time."""
    return 4 * np.finfo(float).eps * np.abs(np.asarray(t, dtype=float))


@dataclass(frozen=True)
class Step(Resting, Settings):
    """constant for t < start, constant + amplitude from then on.

    amplitude  height of the step
    start      [s]
    constant   the value before the step
    """

    amplitude: float
    start: float = 0.0
    constant: float = 0.0

    def __post_init__(self) -> None:
        store_numbers(self, "amplitude", "start", "constant")

    def __call__(self, t: Array) -> Array:
        return self.constant + self.amplitude * (np.asarray(t) >= self.start - rounding_of(t))

    def before(self, t: Array) -> Array:
        return self.constant + self.amplitude * (np.asarray(t) > self.start + rounding_of(t))

    def breaks(self, start: float, stop: float) -> Array:
        return between(start, stop, np.array([self.start]))

    @property
    def bound(self) -> float:
        return outward(max(abs(self.constant), abs(self.constant + self.amplitude)))


@dataclass(frozen=True)
class Steps(Resting, Settings):
    """values[i] from times[i] on, ``initial`` before times[0].

    times    [s], increasing
    values   values, as many as times
    initial  the value before the first time
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    initial: float = 0.0

    def __post_init__(self) -> None:
        times = validate.vector("times", self.times)
        values = validate.vector("values", self.values, len(times))
        store_numbers(self, "initial")
        if (np.diff(times) <= 0).any():
            raise InputError(f"times must be increasing, got {validate.show(times)}")
        object.__setattr__(self, "times", tuple(times.tolist()))
        object.__setattr__(self, "values", tuple(values.tolist()))

    def __call__(self, t: Array) -> Array:
        return self._levels[np.searchsorted(self.times, np.asarray(t) + rounding_of(t), side="right")]

    def before(self, t: Array) -> Array:
        return self._levels[np.searchsorted(self.times, np.asarray(t) - rounding_of(t), side="left")]

    def breaks(self, start: float, stop: float) -> Array:
        return between(start, stop, np.array(self.times)[np.diff(self._levels) != 0])

    @property
    def bound(self) -> float:
        return float(np.abs(self._levels).max())

    @property
    def _levels(self) -> Array:
        return np.array([self.initial, *self.values])


@dataclass(frozen=True)
class Square(Swinging, Settings):
    """constant + amplitude for the first half of each period 2 pi / frequency, constant - amplitude for the second.

    amplitude  amplitude of the swing
    frequency  [rad/s], > 0
    phase      [rad]
    constant   the mean value
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    constant: float = 0.0

    def __post_init__(self) -> None:
        store_numbers(self, "amplitude", "frequency", "phase", "constant")
        validate.positive("frequency", self.frequency)

    def __call__(self, t: Array) -> Array:
        halves = self._half_periods(t)
        return self._level(np.floor(halves))

    def before(self, t: Array) -> Array:
        halves = self._half_periods(t)
        return self._level(np.ceil(halves) - 1)

    def breaks(self, start: float, stop: float) -> Array:
        first, last = ((self.frequency * t + self.phase) / np.pi for t in (start, stop))
        if not np.isfinite(last):
            return np.zeros(0)  # not a number either; the check of the value reports it
        halves = np.floor(first) + np.arange(min(last - first + 3, MOST_BREAKS))
        return between(start, stop, (halves * np.pi - self.phase) / self.frequency)

    @property
    def slope(self) -> float:
        return 0.0

    @property
    def settles(self) -> bool:
        return self.amplitude == 0

    def _half_periods(self, t: Array) -> Array:
        """Half periods since phase zero; a jump within rounding of t is taken to be at t."""
        halves = (self.frequency * np.asarray(t) + self.phase) / np.pi
        nearest = np.round(halves)
        rounding = 4 * np.finfo(float).eps * (np.maximum(1.0, np.abs(halves)) + abs(self.phase) / np.pi)
        return np.where(np.abs(halves - nearest) <= rounding, nearest, halves)

    def _level(self, half: Array) -> Array:
        return self.constant + self.amplitude * np.where(half % 2 == 0, 1.0, -1.0)
