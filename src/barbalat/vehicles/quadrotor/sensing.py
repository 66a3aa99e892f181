"""What is measured of a quadrotor's motion: with noise, drawn by a seed, the same for every controller, and with lag."""

from __future__ import annotations

import numpy as np

from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, Electronics
from barbalat.vehicles.quadrotor.simulator import Motion

SEED = 2010
"""Of sensors' noise and of gusts."""


class Sensing:
    """From motions to measurements, sample by sample; a copy goes its own way."""

    def __init__(self, electronics: Electronics, samples: int, number: int) -> None:
        from scipy.spatial.transform import Rotation

        position, turn, velocity, rates = np.random.default_rng(SEED + 2 * number).standard_normal((4, samples, 3))
        self._turns = Rotation.from_rotvec(electronics.attitude_noise * turn).as_matrix()
        self._position, self._velocity = electronics.position_noise * position, electronics.velocity_noise * velocity
        self._rates = electronics.rate_noise * rates
        lag = electronics.rate_lag
        self._share = -float(np.expm1(-ATTITUDE_SAMPLE / lag)) if lag > 0 else None
        self._lagging = np.zeros(3)

    def __call__(self, motion: Motion, k: int) -> Motion:
        rates = motion.rates + self._rates[k]
        if self._share is not None:
            self._lagging = rates = self._lagging + self._share * (rates - self._lagging)
        position, velocity = motion.position + self._position[k], motion.velocity + self._velocity[k]
        return Motion(position, motion.attitude @ self._turns[k], velocity, rates)
