"""The path from the plant to the controller: sensor lag and measurement noise. It is unknown to every controller."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import InputError, Vector

LARGEST_SEED = 2**64 - 1
"""The largest seed, since the key of a Philox counter has 64 bits for it."""


@dataclass(frozen=True, eq=False)
class Noise(Settings):
    """Gaussian measurement noise: a new value for each measured quantity every ``sample_time``, held in between.

    std          standard deviation, one for all measured quantities or one for each [their units]
    sample_time  [s]; at fixed steps a whole number of them. It is fixed, so that the noise stays the same when the step is
                 refined
    seed         determines every value, together with the member's number (``simulate_ensemble``), independently of threads and
                 lanes

    Source of the numbers: Philox counters (Salmon et al., 2011), made Gaussian by the inverse distribution function.
    """

    std: float | Vector
    sample_time: float
    _: KW_ONLY
    seed: int = 0

    def __post_init__(self) -> None:
        std = validate.vector(
            "sensor.noise.std", self.std if np.ndim(self.std) else [validate.number("sensor.noise.std", self.std)]
        )
        if (std < 0).any():
            raise InputError.of("sensor.noise.std", f"must not be negative, got {validate.show(std)}")
        validate.freeze(
            self,
            std=std,
            sample_time=validate.positive("sensor.noise.sample_time", self.sample_time),
            seed=validate.whole("sensor.noise.seed", self.seed, least=0, most=LARGEST_SEED),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor(Settings):
    """The sensor: each measured quantity passes through 1/(lag s + 1), then noise is added.

    lag    [s], 0 for none; the sensor starts settled on the initial value
    noise  see Noise; no noise by default
    """

    lag: float = 0.0
    noise: Noise | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, lag=validate.not_negative("sensor.lag", self.lag))
        if self.noise is not None:
            validate.instance("sensor.noise", self.noise, Noise)

    def derivative(self, state: Value, y: Value) -> Value:
        """Return the rate of the lagged measurement for the true y; both are (n,)."""
        return (y - state) / self.lag
