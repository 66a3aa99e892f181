"""Random variations around the aircraft for which controllers are designed: mass, balance, derivatives, start, air and delay."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.sweeps.spread import Uniform
from barbalat.vehicles.f16.model import SCALED


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """The deviations of an aircraft, its start and its air from nominal, during the whole flight.

    load             additional weight at the position of the ballast [lb]
    ballast_aft      distance of ``f16.BALLAST_LB`` aft of its nominal position [in]
    effectiveness    factor of the effectiveness of the axis's surface
    lift, pitching_moment, pitch_damping, dihedral, roll_damping, weathercock  factors of the coefficients ``f16.SCALED``
    speed            speed at the start, relative to the trim speed
    attitude         error of angle of attack and pitch at the start [deg]
    gusts            standard deviation of gusts [ft/s], vertical if a pitch rate is followed, lateral for a roll rate
    delay            delay added between the commands and the actuator [s]
    number           number of the draw, which is the seed of the gusts
    """

    load: float = 0.0
    ballast_aft: float = 0.0
    effectiveness: float = 1.0
    lift: float = 1.0
    pitching_moment: float = 1.0
    pitch_damping: float = 1.0
    dihedral: float = 1.0
    roll_damping: float = 1.0
    weathercock: float = 1.0
    speed: float = 1.0
    attitude: float = 0.0
    gusts: float = 0.0
    delay: float = 0.0
    number: int = 0

    @property
    def scales(self) -> dict[str, float]:
        """The factors of the coefficients, by the names of ``f16.SCALED``."""
        return {name: value for name, value in vars(self).items() if name in SCALED}


NOMINAL = Dispersion()
DRAWN = {
    "load": Uniform(-1500.0, 3000.0),  # between burnt fuel and carried stores; the aircraft weighs 20,000 lb
    "ballast_aft": Uniform(-28.0, 28.0),  # moves the centre of gravity by 2 % of the chord
    "effectiveness": Uniform(0.8, 1.2),
    "lift": Uniform(0.9, 1.1),
    "pitching_moment": Uniform(0.8, 1.2),
    "pitch_damping": Uniform(0.7, 1.3),
    "dihedral": Uniform(0.7, 1.3),
    "roll_damping": Uniform(0.7, 1.3),
    "weathercock": Uniform(0.8, 1.2),
    "speed": Uniform(0.95, 1.05),
    "attitude": Uniform(-0.5, 0.5),
    "gusts": Uniform(0.0, 5.0),  # calm to light turbulence, MIL-F-8785C
    "delay": Uniform(0.0, 0.02),  # two samples of a busy bus
}
"""The distribution of each number. Coefficients have the usual uncertainty of wind-tunnel data, a tenth to a third."""
UNITS = {"load": "lb", "ballast_aft": "in", "attitude": "deg", "gusts": "ft/s", "delay": "s"}
"""Units of these numbers. The other numbers are factors of nominal values."""
