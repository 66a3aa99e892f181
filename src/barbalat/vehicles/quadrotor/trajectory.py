"""The commanded path, a climb from the ground and then a figure of eight. Differentiating its formulas gives velocity and
acceleration."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.quadrotor.body import GRAVITY, STANDING
from barbalat.vehicles.quadrotor.geometry import commanded_attitude

TAKES_OFF = 2.0
"""Time of the take-off [s], when the motors start. Until then the vehicle stands on the ground."""
CLIMBS = 2.5
"""Duration of the climb to ``HEIGHT`` [s]."""
HEIGHT = 2.0
"""Height above the ground [m]."""
TURNS_AT, SPEED_UP_SECONDS = 5.0, 3.0
"""Time at which the figure of eight begins, and time that it takes to reach its speed [s]."""
PERIOD = 8.0
"""Period of a figure of eight [s]."""
HALF_LENGTH, HALF_WIDTH, RISE = 2.0, 1.0, 0.3
"""Half the length and half the width of the figure of eight, and the distance by which it rises and sinks [m]. The vehicle moves
with up to 2.2 m/s and 3 m/s^2."""


class Path(NamedTuple):
    """The path at the samples, each (K, 3), and the rates of the commanded attitude and their derivatives, which follow from the
    path."""

    position: Array  # [m]
    velocity: Array  # [m/s]
    acceleration: Array  # [m/s^2]
    rates: Array  # [rad/s]
    rate_changes: Array  # [rad/s^2]


@cache
def path(T: float, samples: int) -> Path:
    """Return the path at t = 0, T, ... [s]. It is the same for all flights."""
    import casadi as ca

    t = ca.SX.sym("t")
    position = _position(t, ca)
    velocity = ca.jacobian(position, t)
    acceleration = ca.jacobian(velocity, t)
    function = ca.Function("path", [t], [position, velocity, acceleration])
    p, v, a = (np.asarray(one.full()).T for one in function.map(samples + 2)(T * np.arange(samples + 2)))
    rates = _turning(a, T)
    changes = np.diff(rates, axis=0) / T
    return Path(p[:samples], v[:samples], a[:samples], rates[:samples], changes[:samples])


def _position(t: Any, ca: Any) -> Any:
    turned = 2 * np.pi / PERIOD * _run_up(t - TURNS_AT, ca)
    height = STANDING + (HEIGHT - STANDING) * _smooth((t - TAKES_OFF) / CLIMBS, ca)
    return ca.vertcat(HALF_LENGTH * ca.sin(turned), HALF_WIDTH * ca.sin(2 * turned), height + RISE * (1 - ca.cos(turned)))


def _smooth(s: Any, ca: Any) -> Any:
    """Return a function of s that rises from 0 to 1 without a jump in its first three derivatives."""
    s = ca.fmin(ca.fmax(s, 0), 1)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def _run_up(t: Any, ca: Any) -> Any:
    """Return the integral of ``_smooth(t / SPEED_UP_SECONDS)``, a clock that gradually reaches its full speed."""
    s = ca.fmin(ca.fmax(t / SPEED_UP_SECONDS, 0), 1)
    return SPEED_UP_SECONDS * s**5 * (7 - 14 * s + 10 * s**2 - 2.5 * s**3) + ca.fmax(t - SPEED_UP_SECONDS, 0)


def _turning(acceleration: Array, T: float) -> Array:
    """Return the body rates (K - 1, 3), from sample to sample, of the attitude whose thrust follows the path."""
    from scipy.spatial.transform import Rotation

    wanted = acceleration + np.array([0, 0, GRAVITY])
    attitudes = Rotation.from_matrix(np.array([commanded_attitude(one) for one in wanted]))
    return np.asarray((attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / T)
