"""One flight as it was flown: what is recorded of it at each sample, and its figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.run.stepwise import Agreement
from barbalat.validate import Array, Named
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Followed
from barbalat.vehicles.f16.failures import FAILS_AT, Failure
from barbalat.vehicles.timing import Timing

TIMING = Timing(duration=30.0, fails_at=FAILS_AT)


def columns_of(followed: Followed) -> dict[str, str]:
    """What is recorded at each sample, in this order, with its unit."""
    rate, surface = followed.rate, followed.surface
    rates, angles = (f"{rate}_c", f"{rate}_m", rate), ("alpha", "beta")
    surfaces, attitude = (f"{surface}_command", surface), ("pitch", "bank")
    return {
        "t": "s", **dict.fromkeys(rates, "deg/s"), **dict.fromkeys(angles, "deg"), "n_z": "g",
        **dict.fromkeys((*surfaces, *attitude), "deg"), "altitude": "ft", "speed": "ft/s", "heading": "deg",
        **dict.fromkeys(("north", "east"), "ft"),
    }  # fmt: skip


T, COMMANDED, MODEL, RATE, ALPHA, BETA, N_Z, COMMAND, SURFACE, PITCH, BANK, ALTITUDE, SPEED, HEADING, NORTH, EAST = range(16)
"""Places of these columns."""


def figures_of(followed: Followed) -> dict[str, str]:
    """Of a flight, with their units; e is the followed rate less the model's, travel how far the surface moves in a second."""
    surface = followed.surface
    return {
        "rms_e": "deg/s",
        "max_abs_e": "deg/s",
        "n_z_min": "g",
        "n_z_max": "g",
        "alpha_min": "deg",
        "alpha_max": "deg",
        f"{surface}_travel": "deg/s",
        f"{surface}_max_abs": "deg",
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """What was flown.

    record     (K, 16), one row for each sample, see ``columns_of``; up to where control was lost
    lost       why control was lost, empty where it was not
    agreement  of the exported C that flew with the simulated list; None where that list flew
    """

    controller: str
    failure: Failure
    followed: Followed
    record: Array
    lost: str
    timing: Timing = TIMING
    agreement: Agreement | None = None

    def column(self, name: str) -> Array:
        """One of ``columns_of`` over the samples; KeyError for another name."""
        places = {one: place for place, one in enumerate(columns_of(self.followed))}
        return np.asarray(self.record[:, Named.of("column", places)[name]])

    @property
    def duration(self) -> float:
        """The last sample's time [s]."""
        return float(self.record[-1, T])

    @property
    def lost_at(self) -> float | None:
        """When the aircraft was lost [s]; None where it was not."""
        return self.duration if self.lost else None

    @property
    def rms_error(self) -> float:
        """Of the followed rate against the model's, from the failure on [deg/s]."""
        return float(np.sqrt(np.mean(self._error**2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From the failure on, by the names of the JSON; null where control was lost."""
        after, names = self._after, figures_of(self.followed)
        if self.lost or not len(after):
            return Named.of("figure", {"lost_at": self.lost_at, **dict.fromkeys(names)})
        load, alpha, surface = (after[:, place] for place in (N_Z, ALPHA, SURFACE))
        values = (
            self.rms_error, np.abs(self._error).max(), load.min(), load.max(), alpha.min(), alpha.max(),
            np.abs(np.diff(surface)).sum() / (len(after) * SAMPLE_TIME), np.abs(surface).max(),
        )  # fmt: skip
        return Named.of("figure", {"lost_at": None, **dict(zip(names, map(float, values), strict=True))})

    @property
    def _after(self) -> Array:
        return self.record[self.record[:, T] >= self.timing.fails_at]

    @property
    def _error(self) -> Array:
        return np.asarray(self._after[:, RATE] - self._after[:, MODEL])
