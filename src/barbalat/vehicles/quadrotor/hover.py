"""Finds hover by Newton's method on the accelerations of the flight model, and linearises the model by differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from barbalat.validate import Array, InputError
from barbalat.vehicles.quadrotor.body import Quadrotor
from barbalat.vehicles.quadrotor.simulator import ROTORS, Motion, Simulator

HOVER_HEIGHT = 2.0
"""Height of the hover [m], clear of the ground. Nothing else depends on it."""
DIFFERENCE_STEP = 1e-4
"""The step of every variable [m, rad, m/s, rad/s, N]. The second-order term is drag, 1e-8 N, and rounding errors leave nine
digits."""
LARGEST_RESIDUAL = 1e-9
"""Largest remaining acceleration at hover [m/s^2, rad/s^2]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hover:
    """Hover and its linear model.

    thrusts  (4,) the rotors' thrusts [N]
    A        (12, 12) matrix for the deviations of position, rotation vector, velocity and body rates [m, rad, s]
    B        (12, 4) matrix for the rotor thrusts [N]
    """

    vehicle: Quadrotor
    thrusts: Array
    A: Array
    B: Array

    @property
    def effect(self) -> Array:
        """The effect (4, 4) of the thrusts on the upward acceleration [m/s^2] and on the three angular accelerations
        [rad/s^2]."""
        return np.asarray(self.B[8:12])

    @property
    def mixer(self) -> Array:
        """The matrix (4, 4) from these four accelerations to thrusts in addition to the hover thrusts [N]."""
        return np.linalg.inv(self.effect)


def hovering(vehicle: Quadrotor) -> Hover:
    """Return the hover of a vehicle. Raises InputError if the rotors cannot hold the vehicle."""
    simulator = Simulator(vehicle)

    def accelerations(change: Array, thrusts: Array) -> Array:
        """Return the accelerations for deviations (12,) from hover."""
        simulator.put(_turned(change), thrusts)
        return simulator.accelerations

    thrusts = np.zeros(ROTORS)
    for _ in range(2):  # the accelerations are linear in the thrusts, so one step converges and the next confirms it
        B = _differences(partial(_of_thrusts, accelerations, thrusts), ROTORS)
        thrusts = thrusts - np.linalg.pinv(B) @ accelerations(np.zeros(12), thrusts)
    left = float(np.abs(accelerations(np.zeros(12), thrusts)).max())
    if left > LARGEST_RESIDUAL or not ((thrusts > 0) & (thrusts < vehicle.thrust)).all():
        raise InputError(
            f"the quadrotor can't hover: it would take thrusts of {thrusts} N, and an acceleration of {left:.2g} m/s^2 or "
            f"rad/s^2 would remain"
        )
    A, whole_B = np.zeros((12, 12)), np.zeros((12, ROTORS))
    A[:6, 6:] = np.eye(6)  # near zero rotation the rotation vector's rate is the body rate
    A[6:] = _differences(lambda change: accelerations(change, thrusts), 12)
    whole_B[6:] = B
    return Hover(vehicle=vehicle, thrusts=thrusts, A=A, B=whole_B)


def _turned(change: Array) -> Motion:
    from scipy.spatial.transform import Rotation

    position, turn, velocity, rates = np.split(change, 4)
    return Motion(np.array([0, 0, HOVER_HEIGHT]) + position, Rotation.from_rotvec(turn).as_matrix(), velocity, rates)


def _of_thrusts(accelerations: Callable[[Array, Array], Array], at: Array, change: Array) -> Array:
    return accelerations(np.zeros(12), at + change)


def _differences(function: Callable[[Array], Array], count: int) -> Array:
    """Return central differences, with a column for each variable."""
    moves = DIFFERENCE_STEP * np.eye(count)
    return np.column_stack([(function(move) - function(-move)) / (2 * DIFFERENCE_STEP) for move in moves])
