"""A flight: its record at each sample, and its metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Followed
from barbalat.vehicles.f16.failures import FAILS_AT
from barbalat.vehicles.flight import Flight, Timing
from barbalat.vehicles.scene import attitudes
from barbalat.vehicles.verdicts import Followed as Judged

TIMING = Timing(duration=30.0, fails_at=FAILS_AT)


def columns_of(followed: Followed) -> dict[str, str]:
    """Return the recorded quantities at each sample, in this order, with units."""
    rate, surface = followed.rate, followed.surface
    rates, angles = (f"{rate}_c", f"{rate}_m", rate), ("alpha", "beta")
    surfaces, attitude = (f"{surface}_command", surface), ("pitch", "bank")
    return {
        "t": "s", **dict.fromkeys(rates, "deg/s"), **dict.fromkeys(angles, "deg"), "n_z": "g",
        **dict.fromkeys((*surfaces, *attitude), "deg"), "altitude": "ft", "speed": "ft/s", "heading": "deg",
        **dict.fromkeys(("north", "east"), "ft"),
    }  # fmt: skip


T, COMMANDED, MODEL, RATE, ALPHA, BETA, N_Z, COMMAND, SURFACE, PITCH, BANK, ALTITUDE, SPEED, HEADING, NORTH, EAST = range(16)
"""Indices of these columns."""


def figures_of(followed: Followed) -> dict[str, str]:
    """Return a flight's metrics with units. e is the controlled rate minus the model's rate; travel is the distance that the
    surface moves per second."""
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
class AxisFlight(Flight):
    """A flight of one axis of the F-16. Its record (K, 16) has a row for each sample (see ``columns_of``)."""

    followed: Followed
    timing: Timing = TIMING

    @property
    def columns(self) -> dict[str, str]:
        return columns_of(self.followed)

    @property
    def units(self) -> dict[str, str]:
        return figures_of(self.followed)

    @property
    def error(self) -> Array:
        """The controlled rate minus the model's rate, at the samples [deg/s]."""
        return np.asarray(self.record[:, RATE] - self.record[:, MODEL])

    @property
    def followed_by_judge(self) -> Judged:
        """The rate and the surface that controls it, in the form that the judge needs."""
        followed, record, limit = self.followed, self.record, self.followed.equipment.limit
        rate, model, command, surface, asked = (record[:, [place]] for place in (RATE, MODEL, COMMAND, SURFACE, COMMANDED))
        return Judged(
            names=(followed.rate,), units=("[deg/s]",), y=rate, y_m=model, u=command, limited=surface,
            limits=np.array([[-limit], [limit]]), commands=asked, input_unit="deg",
        )  # fmt: skip

    def measured(self, after: Array) -> tuple[float, ...]:
        rows, error = self.record[after], self.error[after]
        load, alpha, surface = (rows[:, place] for place in (N_Z, ALPHA, SURFACE))
        return (
            self.rms_error, np.abs(error).max(), load.min(), load.max(), alpha.min(), alpha.max(),
            np.abs(np.diff(surface)).sum() / (len(rows) * SAMPLE_TIME), np.abs(surface).max(),
        )  # fmt: skip

    @property
    def path(self) -> Array:
        """The position north, west and up [ft]. In pitch the aircraft stays in one plane, except for the earth's rotation."""
        aside = -self.column("east") if self.followed.attitude == "phi" else np.zeros(len(self.record))
        return np.column_stack([self.column("north"), aside, self.column("altitude")])

    @property
    def attitude(self) -> Array:
        """The attitude (K, 3, 3). The pitch and yaw of the aircraft are about the axes right and down, opposite to the axes used
        here."""
        pitch = self.column("pitch")
        if self.followed.attitude == "theta":
            return attitudes(np.zeros(len(pitch)), -pitch, np.zeros(len(pitch)))
        return attitudes(self.column("bank"), -pitch, -self.column("heading"))
