"""The geometric part of the controller of Lee, Leok and McClamroch. The schemes provide the gains and the adaptation.

Source: T. Lee, M. Leok, N. H. McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010. Here the upward axis
and the thrust have the same sense, and forces and moments are accelerations, that is, divided by mass and inertia.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.quadrotor.body import GRAVITY

UP = np.array([0.0, 0.0, 1.0])
LEAST_THRUST = 0.2 * GRAVITY
"""Smallest upward thrust demand [m/s^2], because a vanishing thrust has no direction."""


class AttitudeCommand(NamedTuple):
    """The commanded R_d, and Omega_d and its derivative about the commanded axes."""

    attitude: Array  # (3, 3)
    rates: Array  # (3,) [rad/s]
    accelerations: Array  # (3,) [rad/s^2]


def cross(a: Array, b: Array) -> Array:
    """Return the vector product a x b, (3,). NumPy's function takes ten times as long."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def attitude_errors(attitude: Array, rates: Array, command: AttitudeCommand) -> Array:
    """Return e_R [rad, if small] and e_Omega [rad/s] (3, 2), with a row for each of the body's axes."""
    turn = command.attitude.T @ attitude  # R_d'R
    e_R = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])  # (10)
    e_Omega = rates - turn.T @ command.rates  # (11)
    return np.column_stack([e_R, e_Omega])


def carried(attitude: Array, rates: Array, command: AttitudeCommand) -> Array:
    """Return the term (3,) [rad/s^2] of (16) with which e_Omega' equals the remaining demand while the command moves and
    turns."""
    turn = attitude.T @ command.attitude  # R'R_d
    return turn @ command.accelerations - cross(rates, turn @ command.rates)


def turned(attitude: Array, angles: Array) -> Array:
    """Return R exp(angles^) by Rodrigues' formula to the fifth order. The angles in one sample are a few hundredths."""
    x, y, z = angles.tolist()
    square = x * x + y * y + z * z
    sine, cosine = 1 - square / 6, 0.5 - square / 24
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(attitude + attitude @ (sine * hat + cosine * (hat @ hat)))


def commanded_attitude(wanted: Array) -> Array:
    """Return R_d (3, 3), whose third axis is the direction of the wanted thrust (3,) [m/s^2] and whose first axis points as far
    forward as possible."""
    up = wanted / np.sqrt(wanted @ wanted)
    left = np.array([0.0, up[2], -up[1]])  # up x forward
    left /= np.sqrt(left @ left)
    return np.column_stack([cross(left, up), left, up])


def wanted_thrust(acceleration: Array) -> Array:
    """Return the thrust (3,) [m/s^2] that gives this acceleration under gravity."""
    wanted = acceleration + GRAVITY * UP
    wanted[2] = max(wanted[2], LEAST_THRUST)
    return wanted


def allocated(mixer: Array, hover: Array, most: float, up: float, turning: Array) -> Array:
    """Return the thrusts (4,) [N] for a thrust along the upward axis and three angular accelerations [m/s^2, rad/s^2].

    Moments have priority. If a rotor reaches its limit, the thrust is reduced so that the moments are as demanded.
    """
    thrusts = hover + mixer[:, 0] * (up - GRAVITY) + mixer[:, 1:] @ turning
    low, high = float(thrusts.min()), float(thrusts.max())
    shift = -low if low < 0 else min(most - high, 0.0)
    return np.asarray(np.clip(thrusts + shift, 0.0, most))
