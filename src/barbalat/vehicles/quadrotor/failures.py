"""Failures of a quadrotor, sudden and permanent."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.vehicles.flight import Timing
from barbalat.vehicles.quadrotor.body import SLOPE, SlungMass
from barbalat.vehicles.quadrotor.trajectory import TAKES_OFF


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A failure that acts from the instant in a flight's ``Timing``, except that ``stale`` applies from the start.

    slung          the attached mass
    effectiveness  factor of the front left rotor's thrust and torque
    wind           mean of a wind from the left [m/s]
    motor_lag      motor lag that replaces that of the vehicle [s]
    delay          delay added between the commands and the motors [s]
    stale          whether the reset of the laws is omitted at take-over, although they were already running on the sloping ground
    """

    name: str
    meaning: str
    slung: SlungMass | None = None
    effectiveness: float = 1.0
    wind: float = 0.0
    motor_lag: float | None = None
    delay: float = 0.0
    stale: bool = False

    def since(self, timing: Timing) -> float:
        """Return the time at which the failure begins [s]."""
        return TAKES_OFF if self.stale else timing.fails_at


FAILURES = {
    one.name: one
    for one in (
        Failure(name="none", meaning="nothing fails"),
        Failure(
            name="slung-mass",
            meaning="a mass of 250 g, a quarter of the vehicle's, hangs on 50 cm of cable, attached 4 cm off the centre",
            slung=SlungMass(),
        ),
        Failure(name="half-propeller", meaning="one rotor gives half its thrust", effectiveness=0.5),
        Failure(name="wind", meaning="wind of 8 m/s from the left, with gusts", wind=8.0),
        Failure(name="motor-lag", meaning="all motors have a lag of 70 ms instead of 35 ms", motor_lag=0.07),
        Failure(name="delay-20", meaning="commands arrive 20 ms later", delay=0.02),
        Failure(
            name="no-reset",
            meaning=f"the laws, which ran for {TAKES_OFF:g} s on ground that slopes by {SLOPE:g} deg, are not reset at the start",
            stale=True,
        ),
    )
}
"""The failures by their names on the command line."""
