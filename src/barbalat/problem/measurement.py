"""The path from the plant to the controller: sensor lag, noise and resolution. No controller knows it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, Vector

LARGEST_SEED = 2**64 - 1
"""The largest seed. The key of a Philox counter has 64 bits for the seed."""


def nearest_multiple(value: Value, step: Value) -> Value:
    """Return a quantised value, which is the nearest multiple of ``step``; a tie is rounded up."""
    return step * np.floor(value / step + 0.5)


@dataclass(frozen=True, eq=False)
class Noise(Settings):
    """Gaussian measurement noise: a new value for each measured quantity every ``sample_time``, held in between.

    std          standard deviation, one for all measured quantities or one for each [their units]
    sample_time  [s]; a whole number of solver steps if these are fixed. It is fixed, so the noise stays the same when the step is
                 refined
    bound        largest |noise|, to which values beyond it are limited, one for all measured quantities or one for each
                 [their units]; none by default. It is needed for guaranteed bounds of a sampled linear loop
    seed         determines every value, together with the member's number (``simulate_ensemble``), independently of threads and
                 lanes

    Source of the random numbers: Philox counters (Salmon et al., 2011), made Gaussian by the inverse distribution function.
    """

    std: float | Vector
    sample_time: float
    _: KW_ONLY
    bound: float | Vector | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        validate.freeze(
            self,
            std=_sizes("sensor.noise.std", self.std),
            bound=None if self.bound is None else _sizes("sensor.noise.bound", self.bound),
            sample_time=validate.positive("sensor.noise.sample_time", self.sample_time),
            seed=validate.whole("sensor.noise.seed", self.seed, least=0, most=LARGEST_SEED),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor(Settings):
    """The sensor: each measured quantity passes through 1/(lag s + 1), then noise is added, then it is quantised.

    lag           [s], 0 for none; the sensor starts settled on the initial value
    noise         see Noise; no noise by default
    quantization  resolution, as of an encoder: measured values are rounded to the nearest multiple. One number for all measured
                  quantities, or one for each, with 0 for quantities that are not quantised [their units]. Only for sampled
                  controllers: a continuous controller would have to switch infinitely fast
    """

    lag: float = 0.0
    noise: Noise | None = None
    quantization: float | Vector | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, lag=validate.not_negative("sensor.lag", self.lag))
        if self.noise is not None:
            validate.instance("sensor.noise", self.noise, Noise)
        if self.quantization is not None:
            validate.freeze(self, quantization=_resolution(self.quantization))

    def require(self, measured: int) -> None:
        """Raise InputError unless the settings fit the number of measured quantities."""
        given = {"quantization": self.quantization}
        if self.noise is not None:
            given |= {"noise.std": self.noise.std, "noise.bound": self.noise.bound}
        for name, each in given.items():
            if each is not None and np.size(each) > 1:
                validate.vector(f"sensor.{name}", each, measured)

    def resolutions(self, measured: int) -> tuple[float | None, ...] | None:
        """Return the resolution of each measured quantity, with None for one that is not quantised; None if none is quantised."""
        if self.quantization is None or not np.any(self.quantization):
            return None
        each = np.asarray(self.quantization) * np.ones(measured)
        return tuple(float(one) if one > 0 else None for one in each)

    def largest_error(self, measured: int) -> Array | None:
        """(p,) the largest |error| of each measured quantity due to noise and resolution; None if noise has no bound."""
        rounded = np.zeros(measured) if self.quantization is None else np.asarray(self.quantization) / 2 * np.ones(measured)
        if self.noise is None:
            return rounded
        return None if self.noise.bound is None else rounded + self.noise.bound

    def derivative(self, state: Value, y: Value) -> Value:
        """Return the rate of the lagged measurement for the true y. Both are (n,)."""
        return (y - state) / self.lag


def _sizes(field: str, given: float | Vector) -> Array:
    sizes = validate.vector(field, given if np.ndim(given) else [validate.number(field, given)])
    if (sizes < 0).any():
        raise InputError.of(field, f"must not be negative, got {validate.show(sizes)}")
    return sizes


def _resolution(given: float | Vector) -> float | Array:
    if np.ndim(given) == 0:
        return validate.positive("sensor.quantization", given)
    each = validate.vector("sensor.quantization", given)
    if (each < 0).any():
        raise InputError.of("sensor.quantization", f"must not be negative, got {validate.show(each)}")
    return each
