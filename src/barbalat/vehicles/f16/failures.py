"""Failures in flight, sudden and permanent."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.vehicles.f16.model import BALLAST_LB

FAILS_AT = 10.0
"""Time of the failure [s]. Until then the flight is nominal."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A failure that acts from ``FAILS_AT`` on.

    effectiveness  factor of the surface deflection, including trim, that the aerodynamic tables read
    ballast_aft    distance by which ``f16.BALLAST_LB`` moves aft [in]
    ballast_right  distance by which it moves to the right [in]
    delay          delay added between the commands and the actuator [s]
    runs_away      time for which the surface moves to its negative end as fast as possible before it obeys commands again [s]
    gusts          standard deviation of gusts [ft/s], vertical if a pitch rate is followed, lateral for a roll rate
    """

    name: str
    meaning: str
    effectiveness: float = 1.0
    ballast_aft: float = 0.0
    ballast_right: float = 0.0
    delay: float = 0.0
    runs_away: float = 0.0
    gusts: float = 0.0


NONE = Failure(name="none", meaning="nothing fails")
LATE = Failure(name="delay-100", meaning="commands arrive 100 ms later", delay=0.1)
OF_PITCH = (
    NONE,
    Failure(name="elevator-50", meaning="half of the elevator's effectiveness is lost", effectiveness=0.5),
    Failure(
        name="aft-cg",
        meaning=f"{BALLAST_LB:g} lb move aft by 70 in, and the centre of gravity by 5 % of the chord; the airframe is unstable",
        ballast_aft=70.0,
    ),
    LATE,
    Failure(name="hard-over", meaning="the elevator runs away nose up for 0.5 s, then follows again", runs_away=0.5),
    Failure(name="gusts", meaning="vertical gusts with a standard deviation of 10 ft/s, Dryden's spectrum", gusts=10.0),
    Failure(name="reversed", meaning="the elevator acts with the opposite sign", effectiveness=-1.0),
)
OF_ROLL = (
    NONE,
    Failure(name="aileron-50", meaning="half of the ailerons' effectiveness is lost", effectiveness=0.5),
    Failure(
        name="side-cg",
        meaning=f"{BALLAST_LB:g} lb move to the right by 60 in, about half a wing's span",
        ballast_right=60.0,
    ),
    LATE,
    Failure(name="hard-over", meaning="the ailerons run away to the left for 0.3 s, then follow again", runs_away=0.3),
    Failure(name="gusts", meaning="lateral gusts with a standard deviation of 10 ft/s, Dryden's spectrum", gusts=10.0),
    Failure(name="reversed", meaning="the ailerons act with the opposite sign", effectiveness=-1.0),
)
FAILURES = {"f16-pitch": OF_PITCH, "f16-roll": OF_ROLL}
"""The registry, by the names of the flights on the command line."""
