"""The air around a quadrotor: a mean wind with gusts along it, drawn by a seed, the same for every controller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE
from barbalat.vehicles.quadrotor.dispersions import Dispersion
from barbalat.vehicles.quadrotor.failures import Failure
from barbalat.vehicles.quadrotor.sensing import SEED

GUSTS_SHARE = 0.1
"""Standard deviation of gusts along the wind over its mean: what MIL-F-8785C (3.7.3) has for vertical ones near the ground.
Its ones along the wind are 1.9 times as large 10 m above it."""
GUST_LENGTH = 68.0
"""[m]: the scale of gusts along the wind 10 m above the ground, from the same section."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Air:
    """How it moves.

    velocity  (K, 3) [m/s] at the samples of the attitude
    moves     whether it does at all
    """

    velocity: Array
    moves: bool

    @classmethod
    def drawn(cls, dispersion: Dispersion, samples: int) -> Air:
        """What blows all the time."""
        away = np.deg2rad(dispersion.wind_from)
        towards = -np.array([np.cos(away), np.sin(away), 0.0])
        speed = _speed(dispersion.wind, samples, SEED + 2 * dispersion.number + 1)
        return cls(velocity=np.outer(speed, towards), moves=dispersion.wind > 0)

    def failing(self, failure: Failure, dispersion: Dispersion, samples: int) -> Air:
        """With the wind of a failure, from the left."""
        speed = _speed(failure.wind, samples, SEED + 2 * dispersion.number)
        added = np.outer(speed, np.array([0.0, -1.0, 0.0]))
        return Air(velocity=self.velocity + added, moves=self.moves or failure.wind > 0)


def _speed(mean: float, samples: int, seed: int) -> Array:
    """[m/s] at the samples: Dryden's longitudinal gusts, a first-order process, around a mean; exact and stationary."""
    if not mean:
        return np.zeros(samples)
    random = np.random.default_rng(seed)
    deviation, decay = GUSTS_SHARE * mean, np.exp(-ATTITUDE_SAMPLE * mean / GUST_LENGTH)
    gusts, gust = np.empty(samples), deviation * random.standard_normal()
    for k, drawn in enumerate(random.standard_normal(samples)):
        gusts[k] = gust
        gust = decay * gust + deviation * np.sqrt(1 - decay**2) * drawn
    return mean + gusts
