"""One flight of a quadrotor as it was flown: what is recorded of it, and its figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.run.stepwise import Agreement
from barbalat.validate import Array, Named
from barbalat.vehicles.quadrotor.failures import Failure
from barbalat.vehicles.quadrotor.simulator import ROTORS
from barbalat.vehicles.scene import attitudes
from barbalat.vehicles.timing import Timing

TIMING = Timing(duration=20.0, fails_at=10.0)
COLUMNS = {
    "t": "s",
    **dict.fromkeys(("x_d", "y_d", "z_d", "x", "y", "z"), "m"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "deg"),
    **dict.fromkeys(("p", "q", "r"), "deg/s"),
    **{f"thrust_{i + 1}": "N" for i in range(ROTORS)},
    "limited": "%",
}
"""What is recorded at each sample of position, in this order, with its unit; as it is, not as it is measured."""
FIGURES = {
    "rms_e": "m",
    "max_abs_e": "m",
    "sinks": "m",
    "tilt_max": "deg",
    "rotor_travel": "N/s",
    "rotor_max": "N",
    "limited": "%",
}
"""Of a flight, with units; e is the distance from where it should be, sinks how far it came below that, travel what the four
thrusts change by in a second on average, limited the share of the time in which some rotor is at an end of its range."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadrotorFlight:
    """What was flown.

    record     (K, 18), one row for each sample of position, see ``COLUMNS``; up to where the vehicle was lost
    lost       why it was lost, empty where it was not
    agreement  of the exported C of all axes with the simulated lists; None where those flew
    """

    controller: str
    failure: Failure
    record: Array
    lost: str
    timing: Timing = TIMING
    agreement: Agreement | None = None

    def column(self, name: str) -> Array:
        """One of ``COLUMNS`` over the samples; KeyError for another name."""
        places = {one: place for place, one in enumerate(COLUMNS)}
        return np.asarray(self.record[:, Named.of("column", places)[name]])

    @property
    def duration(self) -> float:
        """The last sample's time [s]."""
        return float(self.record[-1, 0])

    @property
    def lost_at(self) -> float | None:
        """When the quadrotor was lost [s]; None where it was not."""
        return self.duration if self.lost else None

    @property
    def error(self) -> Array:
        """Distance from where it should be, at the samples [m]."""
        return np.asarray(np.linalg.norm(self.record[:, 4:7] - self.record[:, 1:4], axis=1))

    @property
    def attitude(self) -> Array:
        """(K, 3, 3), its columns the body's axes."""
        return attitudes(self.column("roll"), self.column("pitch"), self.column("yaw"))

    @property
    def tilt(self) -> Array:
        """Angle of its axis from the vertical, at the samples [deg]."""
        roll, pitch = np.deg2rad(self.column("roll")), np.deg2rad(self.column("pitch"))
        return np.rad2deg(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1)))

    @property
    def rms_error(self) -> float:
        """From the failure on [m]."""
        return float(np.sqrt(np.mean(self.error[self._after] ** 2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From the failure on, by the names of the JSON; null where the vehicle was lost."""
        after = self._after
        if self.lost or not after.any():
            return Named.of("figure", {"lost_at": self.lost_at, **dict.fromkeys(FIGURES)})
        thrusts = self.record[after, 13 : 13 + ROTORS]
        travel = np.abs(np.diff(thrusts, axis=0)).sum() / (ROTORS * np.ptp(self.column("t")[after]))
        sinks = (self.column("z_d") - self.column("z"))[after].max()
        values = (
            self.rms_error,
            self.error[after].max(),
            max(sinks, 0.0),
            self.tilt[after].max(),
            travel,
            thrusts.max(),
            self.column("limited")[after].mean(),
        )
        return Named.of("figure", {"lost_at": None, **dict(zip(FIGURES, map(float, values), strict=True))})

    @property
    def since(self) -> float:
        """When it began to fail [s]."""
        return self.failure.since(self.timing)

    @property
    def _after(self) -> Array:
        return np.asarray(self.column("t") >= self.since)
