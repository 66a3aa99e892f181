"""What fails in flight, at once and for good."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.flight.f16 import BALLAST_LB

FAILS_AT = 10.0
"""[s]; until then the flight is the nominal one."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """From ``FAILS_AT`` on.

    effectiveness  of the elevator: the deflection that the aerodynamic tables see is so many times the surface's, trim included
    ballast_aft    [in], how far aft ``f16.BALLAST_LB`` move
    delay          [s], added to the commands' way to the actuator
    runs_away      [s], for so long the elevator moves nose up as fast as it can; then it follows again
    gusts          [ft/s], the standard deviation of vertical ones
    """

    name: str
    meaning: str
    effectiveness: float = 1.0
    ballast_aft: float = 0.0
    delay: float = 0.0
    runs_away: float = 0.0
    gusts: float = 0.0


FAILURES = {
    one.name: one
    for one in (
        Failure(name="none", meaning="nothing fails"),
        Failure(name="elevator-50", meaning="half of the elevator's effectiveness is lost", effectiveness=0.5),
        Failure(
            name="aft-cg",
            meaning=f"{BALLAST_LB:g} lb move aft by 70 in, the centre of gravity by 5 % of the chord; the airframe is unstable",
            ballast_aft=70.0,
        ),
        Failure(name="delay-100", meaning="commands arrive 100 ms later", delay=0.1),
        Failure(name="hard-over", meaning="the elevator runs away nose up for 0.5 s, and follows again", runs_away=0.5),
        Failure(name="gusts", meaning="vertical gusts with a standard deviation of 10 ft/s, Dryden's spectrum", gusts=10.0),
        Failure(name="reversed", meaning="the elevator acts with the opposite sign", effectiveness=-1.0),
    )
}
"""The registry, by the names of the command line."""
