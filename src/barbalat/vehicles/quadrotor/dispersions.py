"""Random variations of the quadrotor for which controllers are designed: body, rotors, sensors, delay, start and air."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from barbalat.sweeps.spread import Uniform
from barbalat.validate import Array
from barbalat.vehicles.quadrotor.axes import Electronics
from barbalat.vehicles.quadrotor.body import Quadrotor
from barbalat.vehicles.quadrotor.simulator import ROTORS, Simulator


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """The differences of a vehicle, its start and its air from the nominal ones, during the whole flight.

    mass, roll_inertia, pitch_inertia  factors; the inertia about the vertical axis follows from the other two, as for a flat body
    centre_forward, centre_left        position of the centre of gravity [m]
    reach, drag_torque, motor_lag      factors of the vehicle's values
    thrust, rotor_1, ..., rotor_4      factors of the thrust of all rotors, and of each rotor
    noise                              factor of the noise of all sensors
    rate_lag                           lag of the first-order rate sensors [s]
    delay                              delay added between the commands and the motors [s], in whole samples of the attitude
        controllers
    wind, wind_from                    mean of a constant wind with gusts [m/s]; its direction, from ahead to the left [deg]
    start_forward, start_left          position at the start [m]
    heading                            heading at the start [deg]
    number                             number of the draw, which is the seed of noise and gusts
    """

    mass: float = 1.0
    roll_inertia: float = 1.0
    pitch_inertia: float = 1.0
    centre_forward: float = 0.0
    centre_left: float = 0.0
    reach: float = 1.0
    drag_torque: float = 1.0
    motor_lag: float = 1.0
    thrust: float = 1.0
    rotor_1: float = 1.0
    rotor_2: float = 1.0
    rotor_3: float = 1.0
    rotor_4: float = 1.0
    noise: float = 1.0
    rate_lag: float = 0.0
    delay: float = 0.0
    wind: float = 0.0
    wind_from: float = 0.0
    start_forward: float = 0.0
    start_left: float = 0.0
    heading: float = 0.0
    number: int = 0

    def vehicle(self, nominal: Quadrotor) -> Quadrotor:
        """Return the drawn vehicle."""
        x, y, z = nominal.inertia
        roll, pitch = self.roll_inertia * x, self.pitch_inertia * y
        return replace(
            nominal,
            mass=self.mass * nominal.mass,
            inertia=(roll, pitch, z * ((roll + pitch) / (x + y))),
            centre=(nominal.centre[0] + self.centre_forward, nominal.centre[1] + self.centre_left),
            reach=self.reach * nominal.reach,
            torque=self.drag_torque * nominal.torque,
            motor_lag=self.motor_lag * nominal.motor_lag,
        )

    @property
    def effectiveness(self) -> Array:
        """The effectiveness of the rotors (4,)."""
        return self.thrust * np.array([self.rotor_1, self.rotor_2, self.rotor_3, self.rotor_4])

    def simulator(self, nominal: Quadrotor) -> Simulator:
        """Return the simulator of the drawn vehicle, on the ground at its start."""
        found = Simulator(self.vehicle(nominal))
        for rotor, share in zip(range(ROTORS), self.effectiveness, strict=True):
            found.weaken(rotor, share)
        if (self.start_forward, self.start_left, self.heading) != (0.0, 0.0, 0.0):
            found.stand(self.start_forward, self.start_left, self.heading)
        return found

    def electronics(self, nominal: Electronics) -> Electronics:
        """Return the drawn sensors and delay, which vary around the nominal values."""
        return replace(
            nominal,
            delay=nominal.delay + self.delay,
            rate_lag=nominal.rate_lag + self.rate_lag,
            attitude_noise=self.noise * nominal.attitude_noise,
            rate_noise=self.noise * nominal.rate_noise,
            position_noise=self.noise * nominal.position_noise,
            velocity_noise=self.noise * nominal.velocity_noise,
        )


NOMINAL = Dispersion()
DRAWN = {
    "mass": Uniform(0.9, 1.15),  # another battery, a camera
    "roll_inertia": Uniform(0.8, 1.2),  # identified by a swing test or from a drawing
    "pitch_inertia": Uniform(0.8, 1.2),
    "centre_forward": Uniform(-0.005, 0.005),  # a battery with a third of the mass, mounted 1.5 cm off its nominal place
    "centre_left": Uniform(-0.005, 0.005),
    "reach": Uniform(0.98, 1.02),  # arms that fold
    "drag_torque": Uniform(0.7, 1.3),  # the propeller parameter that is known least accurately
    "motor_lag": Uniform(0.7, 1.5),  # 25 to 52 ms; identified values are between 20 and 70 ms
    "thrust": Uniform(0.85, 1.05),  # a battery from full to almost empty, air from sea level to 1000 m
    "rotor_1": Uniform(0.95, 1.05),  # propellers of one make, chipped or not
    "rotor_2": Uniform(0.95, 1.05),
    "rotor_3": Uniform(0.95, 1.05),
    "rotor_4": Uniform(0.95, 1.05),
    "noise": Uniform(0.5, 2.0),  # frames shake differently
    "rate_lag": Uniform(0.0, 0.004),  # a low-pass filter of at least 40 Hz
    "delay": Uniform(0.0, 0.005),  # up to two samples on a busy computer
    "wind": Uniform(0.0, 4.0),  # from calm to a gentle breeze, Beaufort 3
    "wind_from": Uniform(0.0, 360.0),
    "start_forward": Uniform(-0.2, 0.2),  # the vehicle is put down by hand
    "start_left": Uniform(-0.2, 0.2),
    "heading": Uniform(-10.0, 10.0),
}
"""The distribution of each number, with its reason."""
UNITS = {
    **dict.fromkeys(("centre_forward", "centre_left", "start_forward", "start_left"), "m"),
    **dict.fromkeys(("rate_lag", "delay"), "s"),
    "wind": "m/s",
    **dict.fromkeys(("wind_from", "heading"), "deg"),
}
"""Units of these numbers. The other numbers are factors of nominal values."""
