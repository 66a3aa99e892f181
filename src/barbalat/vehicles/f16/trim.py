"""Finds level flight at a condition by Newton's method on the rates of the flight model, and linearises the model by
differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array, InputError
from barbalat.vehicles.f16 import model as f16
from barbalat.vehicles.f16.airframe import Airframe, FlightCondition, Motion, Surfaces

ELEVATOR_LIMIT = np.deg2rad(25.0)
"""The limit of the elevator and of its tables [rad]."""
LARGEST_RESIDUAL = 1e-7
"""Largest residual [ft/s^2, rad/s^2]. After Newton's steps it is a thousand times smaller, but far larger at a jump of the
tables."""
CRUISE_GUESS = (np.deg2rad(3.0), np.deg2rad(-2.0), 0.3)
"""The initial guess: alpha, elevator [rad] and throttle of an aircraft at cruise."""
DIFFERENCE_STEP = 1e-4
"""The step of the differences in angles and rates [rad, rad/s], and in the speed, relative to the speed. The tables are linear
between points that are degrees apart, so a smaller step gives the same derivative. Rounding errors leave nine digits."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trim:
    """Level, unaccelerated flight and its linear model.

    speed               the airspeed [ft/s]
    alpha, elevator     angle of attack and elevator [rad]; a positive elevator pitches down, as in the tables
    throttle            the throttle, from 0 to 1
    A                   (8, 8) matrix for the deviations of ``Motion``, in its order and units
    B                   (8, 3) matrix for elevator, aileron and rudder [rad]
    """

    condition: FlightCondition
    speed: float
    alpha: float
    elevator: float
    throttle: float
    A: Array
    B: Array

    @property
    def motion(self) -> Motion:
        return Motion(speed=self.speed, alpha=self.alpha, theta=self.alpha, q=0.0)

    @property
    def surfaces(self) -> Surfaces:
        return Surfaces(self.elevator)

    def modes(self) -> dict[str, list[complex]]:
        """Return the eigenvalues [1/s] of the longitudinal and the lateral 4 x 4 blocks, by the names of the modes."""
        pitching = _by_size(np.linalg.eigvals(self.A[:4, :4]))
        rolling = np.linalg.eigvals(self.A[4:, 4:])
        swinging = _by_size(rolling[rolling.imag != 0])
        others = _by_size(rolling[rolling.imag == 0])
        return {
            "short period": pitching[:2],
            "phugoid": pitching[2:],
            "Dutch roll": swinging,
            "roll": others[:1],
            "spiral": others[1:],
        }


def trimmed(condition: FlightCondition) -> Trim:
    """Return level flight at the condition. Raises InputError if it is impossible within the ranges of the surfaces, the engine
    and the tables."""
    from scipy.optimize import root

    airframe = Airframe(condition)

    def rates(unknown: Array) -> Array:
        alpha, elevator, throttle = map(float, unknown)
        airframe.put(Motion(airframe.speed, alpha, alpha, 0.0), Surfaces(elevator), throttle)
        return np.asarray(airframe.rates[[0, 1, 3]] * (1.0, airframe.speed, 1.0))

    found = root(rates, CRUISE_GUESS, tol=1e-12)
    alpha, elevator, throttle = map(float, found.x)
    residual = float(np.abs(rates(found.x)).max())
    _require_flyable(condition, residual, alpha, elevator, throttle)
    motion = Motion(airframe.speed, alpha, alpha, 0.0)
    A, B = _linearised(airframe, motion, Surfaces(elevator), throttle)
    return Trim(condition=condition, speed=airframe.speed, alpha=alpha, elevator=elevator, throttle=throttle, A=A, B=B)


def _require_flyable(condition: FlightCondition, residual: float, alpha: float, elevator: float, throttle: float) -> None:
    low, high = np.deg2rad(f16.REACHED_ALPHA)
    ranges = {
        f"an angle of attack of {np.rad2deg(alpha):.3g} deg, but the tables end at {f16.REACHED_ALPHA[1]:g} deg": low
        < alpha
        < high,
        f"an elevator of {np.rad2deg(elevator):.3g} deg, but it moves only by 25 deg": abs(elevator) < ELEVATOR_LIMIT,
        f"a throttle of {throttle:.3g}, but its range is 0 to 1": 0 < throttle < 1,
    }
    asked = [text for text, holds in ranges.items() if not holds]
    why = f"it would take {asked[0]}" if asked else f"Newton's method leaves a residual of {residual:.2g} ft/s^2 or rad/s^2"
    if asked or not residual < LARGEST_RESIDUAL:
        raise InputError(f"the F-16 can't be trimmed in level flight at {condition}: {why}; 10000 ft and Mach 0.5 are possible")


def _linearised(airframe: Airframe, motion: Motion, surfaces: Surfaces, throttle: float) -> tuple[Array, Array]:
    """Return A and B, computed by central differences of the rates."""

    def column(change: Array, turned: Array, size: float) -> Array:
        ends = []
        for sign in (1, -1):
            airframe.put(Motion(*(motion + sign * change)), Surfaces(*(surfaces + sign * turned)), throttle)
            ends.append(airframe.rates)
        return np.asarray((ends[0] - ends[1]) / (2 * size))

    def moved(count: int, i: int, size: float) -> Array:
        return size * np.eye(count)[i]

    sizes = [DIFFERENCE_STEP * airframe.speed] + [DIFFERENCE_STEP] * 7
    A = [column(moved(8, i, size), np.zeros(3), size) for i, size in enumerate(sizes)]
    B = [column(np.zeros(8), moved(3, i, DIFFERENCE_STEP), DIFFERENCE_STEP) for i in range(3)]
    return np.column_stack(A), np.column_stack(B)


def _by_size(values: Array) -> list[complex]:
    return sorted((complex(value) for value in values), key=lambda value: (-abs(value), -value.imag))
