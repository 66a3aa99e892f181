"""One flight as it was flown: what is recorded of it at each sample, why it was lost, and its figures."""

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

NO_NUMBER = "its controller gave a command that is no number"
"""Why control was lost, where a flight's controller overflowed and its simulator did not."""


class Failing(Protocol):
    """What fails in a flight: a frozen dataclass with a name and a meaning in words. The one called "none" fails nothing."""

    @property
    def name(self) -> str: ...

    @property
    def meaning(self) -> str: ...


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long a flight is, and when what fails does so [s]."""

    duration: float
    fails_at: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight(ABC):
    """A flight of some vehicle.

    record     (K, columns), a row for each sample, its time [s] first; up to where control was lost
    lost       why control was lost, empty where it was not
    agreement  of the exported C that flew with the simulated list; None where that list flew
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
        """What the record holds, in this order, with units."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """The names of its figures with their units, "rms_e" and "max_abs_e" among them."""

    @property
    @abstractmethod
    def error(self) -> Array:
        """(K,) what is to be small, at the samples."""

    @abstractmethod
    def measured(self, after: Array) -> tuple[float, ...]:
        """Its figures in the order of ``units``, of the samples (K,) for which ``after`` is true."""

    @property
    @abstractmethod
    def path(self) -> Array:
        """(K, 3): where it was, forward, left and up, in the unit of its vehicle's lengths."""

    @property
    @abstractmethod
    def attitude(self) -> Array:
        """(K, 3, 3), its columns the body's axes."""

    @property
    def target(self) -> Array | None:
        """(K, 3): where it should have been; None where no place is commanded."""
        return None

    @property
    def followed_by_judge(self) -> Followed | None:
        """What the judge sees of it; None where its class says nothing."""
        return None

    @cached_property
    def verdict(self) -> Verdict | None:
        """What the judge says of it, the vehicle's own reasons for being lost included; None where it sees nothing."""
        seen = self.followed_by_judge
        return None if seen is None else verdict_of(seen, self.record[:, 0], self.timing.duration, self.lost)

    @property
    def since(self) -> float:
        """When it began to fail [s]."""
        return self.timing.fails_at

    def column(self, name: str) -> Array:
        """One of ``columns`` over the samples; KeyError for another name."""
        places = {one: place for place, one in enumerate(self.columns)}
        return np.asarray(self.record[:, Named.of("column", places)[name]])

    @property
    def duration(self) -> float:
        """The last sample's time [s]."""
        return float(self.record[-1, 0])

    @property
    def lost_at(self) -> float | None:
        """When control was lost [s]; None where it was not."""
        return self.duration if self.lost else None

    @property
    def rms_error(self) -> float:
        """The root mean square of the error from the failure on."""
        return float(np.sqrt(np.mean(self.error[self._after] ** 2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From the failure on, by the names of the JSON; null where control was lost."""
        after, names = self._after, self.units
        if self.lost or not after.any():
            return Named.of("figure", {"lost_at": self.lost_at, **dict.fromkeys(names)})
        return Named.of("figure", {"lost_at": None, **dict(zip(names, map(float, self.measured(after)), strict=True))})

    @property
    def _after(self) -> Array:
        return np.asarray(self.record[:, 0] >= self.since)
