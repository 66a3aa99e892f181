"""A flight of a quadrotor: its record and its metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.judge.appended import ARRIVED
from barbalat.validate import Array
from barbalat.vehicles.flight import Flight, Timing
from barbalat.vehicles.quadrotor.body import Quadrotor
from barbalat.vehicles.quadrotor.failures import Failure
from barbalat.vehicles.quadrotor.simulator import ROTORS
from barbalat.vehicles.scene import attitudes
from barbalat.vehicles.verdicts import Followed

TIMING = Timing(duration=20.0, fails_at=10.0)
COLUMNS = {
    "t": "s",
    **dict.fromkeys(("x_d", "y_d", "z_d", "x", "y", "z"), "m"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "deg"),
    **dict.fromkeys(("p", "q", "r"), "deg/s"),
    **{f"thrust_{i + 1}": "N" for i in range(ROTORS)},
    "limited": "%",
}
"""The recorded quantities at each position sample, in this order, with units. They are true values, not measurements."""
FIGURES = {
    "rms_e": "m",
    "max_abs_e": "m",
    "sinks": "m",
    "tilt_max": "deg",
    "rotor_travel": "N/s",
    "rotor_max": "N",
    "limited": "%",
}
"""The metrics of a flight with units. The error e is the distance from the commanded position, ``sinks`` the largest distance
below it, ``travel`` the average change of the four thrusts per second, and ``limited`` the fraction of the time for which any
rotor is at an end of its range."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadrotorFlight(Flight):
    """The flight of a quadrotor. Its record (K, 18) has a row for each position sample (see ``COLUMNS``).

    agreement  how the exported C of all axes agrees with the simulation; None if no C flew
    """

    failure: Failure
    timing: Timing = TIMING

    @property
    def columns(self) -> dict[str, str]:
        return COLUMNS

    @property
    def units(self) -> dict[str, str]:
        return FIGURES

    @property
    def error(self) -> Array:
        """The distance from the commanded position at the samples [m]."""
        return np.asarray(np.linalg.norm(self.path - self.target, axis=1))

    @property
    def followed_by_judge(self) -> Followed:
        """The position, and the rotor thrusts of the vehicle for which the controllers are designed, as the judge needs them."""
        thrusts = self.record[:, 13 : 13 + ROTORS]
        most = Quadrotor().thrust
        near = ARRIVED * most  # with its lag, a motor only approaches the ends of its range
        return Followed(
            names=("x", "y", "z"), units=("[m]",) * 3, y=self.path, y_m=self.target, limited=thrusts,
            u=np.where(thrusts >= most - near, most, np.where(thrusts <= near, 0.0, thrusts)),
            limits=np.array([[0.0] * ROTORS, [most] * ROTORS]), commands=self.target, input_unit="N",
        )  # fmt: skip

    def measured(self, after: Array) -> tuple[float, ...]:
        thrusts = self.record[after, 13 : 13 + ROTORS]
        travel = np.abs(np.diff(thrusts, axis=0)).sum() / (ROTORS * np.ptp(self.column("t")[after]))
        sinks = (self.column("z_d") - self.column("z"))[after].max()
        return (
            self.rms_error,
            self.error[after].max(),
            max(sinks, 0.0),
            self.tilt[after].max(),
            travel,
            thrusts.max(),
            self.column("limited")[after].mean(),
        )

    @property
    def path(self) -> Array:
        """The position forward, left and up [m]."""
        return self.record[:, 4:7]

    @property
    def target(self) -> Array:
        """The commanded position [m]."""
        return self.record[:, 1:4]

    @property
    def attitude(self) -> Array:
        return attitudes(self.column("roll"), self.column("pitch"), self.column("yaw"))

    @property
    def tilt(self) -> Array:
        """The angle of the vehicle's axis from the vertical at the samples [deg]."""
        roll, pitch = np.deg2rad(self.column("roll")), np.deg2rad(self.column("pitch"))
        return np.rad2deg(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1)))

    @property
    def since(self) -> float:
        return self.failure.since(self.timing)
