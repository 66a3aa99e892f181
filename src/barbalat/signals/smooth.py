"""Signals without jumps. Frequencies are rad/s, phases rad."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.settings import Settings
from barbalat.validate import Array, InputError


def outward(bound: float, operations: int = 3) -> float:
    """A bound on magnitudes that also covers the rounding errors of this number of operations in the value itself."""
    return bound * (1 + 2 * operations * float(np.finfo(float).eps))


def store_numbers(signal: object, *names: str) -> None:
    """Check that fields are finite numbers and keep them as floats."""
    for name in names:
        object.__setattr__(signal, name, validate.number(name, getattr(signal, name)))


class Continuous(ABC):
    """A signal without jumps: its limit from the left is its value."""

    @abstractmethod
    def __call__(self, t: Array) -> Array:
        """The value at t [s]."""

    def before(self, t: Array) -> Array:
        return self(t)


class Swinging:
    """A signal that swings by its amplitude around its constant."""

    amplitude: float
    constant: float

    @property
    def bound(self) -> float:
        return outward(abs(self.constant) + abs(self.amplitude))


class Resting:
    """A piecewise-constant signal."""

    @property
    def slope(self) -> float:
        return 0.0

    @property
    def settles(self) -> bool:
        return True


@dataclass(frozen=True)
class Clock(Continuous):
    """The time t, for equations that contain it. It has no bound."""

    def __call__(self, t: Array) -> Array:
        return np.asarray(t, dtype=float)


@dataclass(frozen=True)
class Constant(Resting, Continuous, Settings):
    """amplitude, at all times."""

    amplitude: float = 0.0

    def __post_init__(self) -> None:
        store_numbers(self, "amplitude")

    def __call__(self, t: Array) -> Array:
        return self.amplitude + 0.0 * t

    @property
    def bound(self) -> float:
        return abs(float(self.amplitude))


@dataclass(frozen=True)
class Sine(Swinging, Continuous, Settings):
    """constant + amplitude sin(frequency t + phase).

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
        return self.constant + self.amplitude * np.sin(self.frequency * t + self.phase)

    @property
    def slope(self) -> float:
        return outward(abs(self.amplitude) * self.frequency)

    @property
    def settles(self) -> bool:
        return self.amplitude == 0


@dataclass(frozen=True)
class Sines(Continuous, Settings):
    """constant + sum of amplitudes[i] sin(frequencies[i] t + phases[i]).

    amplitudes   amplitudes of the swings
    frequencies  [rad/s], > 0, one for each amplitude
    phases       [rad], one for each amplitude; zeros by default
    constant     the mean value
    """

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    phases: tuple[float, ...] | None = None
    constant: float = 0.0

    def __post_init__(self) -> None:
        amplitudes = validate.vector("amplitudes", self.amplitudes)
        count = len(amplitudes)
        frequencies = validate.vector("frequencies", self.frequencies, count)
        phases = validate.vector("phases", [0.0] * count if self.phases is None else self.phases, count)
        store_numbers(self, "constant")
        if (frequencies <= 0).any():
            raise InputError(f"frequencies must be positive, got {validate.show(frequencies)}")
        for name, values in (("amplitudes", amplitudes), ("frequencies", frequencies), ("phases", phases)):
            object.__setattr__(self, name, tuple(values.tolist()))

    def __call__(self, t: Array) -> Array:
        result = self.constant + 0.0 * t
        for amplitude, frequency, phase in zip(self.amplitudes, self.frequencies, self.phases or (), strict=True):
            result = result + amplitude * np.sin(frequency * t + phase)
        return result

    @property
    def bound(self) -> float:
        return outward(abs(self.constant) + sum(abs(amplitude) for amplitude in self.amplitudes), 2 + len(self.amplitudes))

    @property
    def slope(self) -> float:
        each = (abs(amplitude) * w for amplitude, w in zip(self.amplitudes, self.frequencies, strict=True))
        return outward(sum(each), 2 + len(self.amplitudes))

    @property
    def settles(self) -> bool:
        return not any(self.amplitudes)


@dataclass(frozen=True)
class Chirp(Swinging, Continuous, Settings):
    """A sine whose frequency changes linearly from ``frequency_start`` to ``frequency_end`` in ``duration`` and then stays
    constant.

    amplitude        amplitude of the swing
    frequency_start  [rad/s], >= 0
    frequency_end    [rad/s], >= 0
    duration         of the sweep [s], > 0
    constant         the mean value
    """

    amplitude: float
    frequency_start: float
    frequency_end: float
    duration: float
    constant: float = 0.0

    def __post_init__(self) -> None:
        store_numbers(self, "amplitude", "frequency_start", "frequency_end", "duration", "constant")
        for name in ("frequency_start", "frequency_end"):
            validate.not_negative(name, getattr(self, name))
        validate.positive("duration", self.duration)

    def __call__(self, t: Array) -> Array:
        rate = (self.frequency_end - self.frequency_start) / self.duration
        swept = np.minimum(t, self.duration)
        phase = self.frequency_start * swept + rate * swept**2 / 2 + self.frequency_end * (t - swept)
        return self.constant + self.amplitude * np.sin(phase)

    @property
    def slope(self) -> float:
        return outward(abs(self.amplitude) * max(self.frequency_start, self.frequency_end))

    @property
    def settles(self) -> bool:
        return self.amplitude == 0 or self.frequency_end == 0

    def breaks(self, start: float, stop: float) -> Array:
        bends = start < self.duration < stop and self.frequency_start != self.frequency_end
        return np.array([self.duration] if bends else [])
