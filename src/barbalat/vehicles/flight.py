"""A flight: its record at each sample, the reason for a loss of control, and its metrics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from barbalat.judge.verdict import Verdict
from barbalat.run.kernel.sampled_controller import Agreement
from barbalat.validate import Array, Named
from barbalat.vehicles.verdicts import Followed, verdict_of

NO_NUMBER = "its controller gave a command that is not a number"
"""The reason for a loss of control if the controller overflowed and the simulator did not."""


class Failing(Protocol):
    """A failure in flight: a frozen dataclass with a name and a meaning in words. The failure called "none" has no effect."""

    @property
    def name(self) -> str: ...

    @property
    def meaning(self) -> str: ...


@dataclass(frozen=True, kw_only=True)
class Timing:
    """The duration of a flight and the time of its failure [s]."""

    duration: float
    fails_at: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight(ABC):
    """A flight of some vehicle.

    record     (K, columns), a row for each sample up to a loss of control; the first column is the time [s]
    lost       the reason why control was lost; empty if it was not lost
    agreement  how the exported C that flew agrees with the simulation; None if no C flew
    """

    controller: str
    failure: Failing
    record: Array
    lost: str
    timing: Timing
    agreement: Agreement | None = None

    @property
    @abstractmethod
    def columns(self) -> dict[str, str]:
        """The columns of the record in this order, with units."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """The metrics with their units. They include "rms_e" and "max_abs_e"."""

    @property
    @abstractmethod
    def error(self) -> Array:
        """The error that should be small, at the samples (K,)."""

    @abstractmethod
    def measured(self, after: Array) -> tuple[float, ...]:
        """Return the metrics in the order of ``units``, computed from the samples (K,) for which ``after`` is true."""

    @property
    @abstractmethod
    def path(self) -> Array:
        """The position forward, left and up (K, 3), in the length unit of the vehicle."""

    @property
    @abstractmethod
    def attitude(self) -> Array:
        """The attitude (K, 3, 3). Its columns are the body's axes."""

    @property
    def target(self) -> Array | None:
        """The commanded position (K, 3); None if no position is commanded."""
        return None

    @property
    def followed_by_judge(self) -> Followed | None:
        """The signals for the judge; None if the class provides none."""
        return None

    @cached_property
    def verdict(self) -> Verdict | None:
        """The judge's verdict on the flight, including the vehicle's own criteria for a loss; None without signals."""
        seen = self.followed_by_judge
        return None if seen is None else verdict_of(seen, self.record[:, 0], self.timing.duration, self.lost)

    @property
    def since(self) -> float:
        """The time at which the failure began [s]."""
        return self.timing.fails_at

    def column(self, name: str) -> Array:
        """Return one of ``columns`` over the samples. Raises KeyError for an unknown name."""
        places = {one: place for place, one in enumerate(self.columns)}
        return np.asarray(self.record[:, Named.of("column", places)[name]])

    @property
    def duration(self) -> float:
        """The time of the last sample [s]."""
        return float(self.record[-1, 0])

    @property
    def lost_at(self) -> float | None:
        """The time at which control was lost [s], or None."""
        return self.duration if self.lost else None

    @property
    def rms_error(self) -> float:
        """The root mean square of the error after the failure."""
        return float(np.sqrt(np.mean(self.error[self._after] ** 2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """The metrics after the failure, by their names in the JSON. The metrics are null if control was lost."""
        after, names = self._after, self.units
        if self.lost or not after.any():
            return Named.of("figure", {"lost_at": self.lost_at, **dict.fromkeys(names)})
        return Named.of("figure", {"lost_at": None, **dict(zip(names, map(float, self.measured(after)), strict=True))})

    @property
    def _after(self) -> Array:
        return np.asarray(self.record[:, 0] >= self.since)
