"""Modelling errors Delta_m at the plant's input, eq. (11), as families with one size, and the sizes that linear loops
tolerate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from barbalat import validate
from barbalat.linear.crossings import frequency_grid
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, TransferFunction, complementary_sensitivity, series
from barbalat.problem.actuation import PlantInput
from barbalat.validate import Array, InputError


class ModellingError(Protocol):
    """A family of modelling errors Delta_m, each given by its size > 0. A size of 0 means no error."""

    def added(self, path: PlantInput, size: float) -> PlantInput:
        """Return the plant's input with the error added. Raises InputError if both cannot be combined."""
        ...

    def allowed(self, w: Array, gain: Array) -> Array:
        """Return, for each frequency (K,), the size below which |Delta_m(j w)| gain < 1; the inequality holds for every smaller
        size."""
        ...

    def limit(self, loop: StateSpace) -> float:
        """Return the size at which a loop, broken at the plant's input, exactly loses stability; infinite if it never does."""
        ...


@dataclass(frozen=True)
class DelayError:
    """Delta_m = e^(-s d) - 1, where the size is d [s]. |Delta_m| = 2 |sin(w d/2)|, which is at most 2."""

    def added(self, path: PlantInput, size: float) -> PlantInput:
        return replace(path, delay=path.delay + size)

    def allowed(self, w: Array, gain: Array) -> Array:
        with np.errstate(divide="ignore"):
            half = 1 / (2 * gain)
        return np.where(half <= 1, 2 / w * np.arcsin(np.minimum(half, 1.0)), np.inf)

    def limit(self, loop: StateSpace) -> float:
        return margins(loop).delay


@dataclass(frozen=True)
class GainError:
    """Delta_m that multiplies the input's effectiveness by 1 + size, or, if ``downwards``, divides it by 1 + size."""

    downwards: bool = False

    def factor(self, size: float) -> float:
        """Return the factor by which the input's effectiveness is multiplied."""
        return 1 / (1 + size) if self.downwards else 1 + size

    def added(self, path: PlantInput, size: float) -> PlantInput:
        gain = path.gain / (1 + size) if self.downwards else path.gain * (1 + size)
        # an effectiveness of exactly one is omitted from the path's equations; the run could then not be computed together with
        # the others
        return replace(path, gain=gain if gain != 1 else float(np.nextafter(1.0, 2.0)))

    def allowed(self, w: Array, gain: Array) -> Array:
        with np.errstate(divide="ignore"):
            return np.where(gain <= 1, np.inf, 1 / np.maximum(gain - 1, 0.0)) if self.downwards else np.asarray(1 / gain)

    def limit(self, loop: StateSpace) -> float:
        found = margins(loop)
        return (1 / found.gain_down if found.gain_down > 0 else np.inf) - 1 if self.downwards else found.gain_up - 1


@dataclass(frozen=True, eq=False)
class ScaledError:
    """Delta_m = size times shape(s), which is proper and stable, such as -s/(T s + 1)."""

    shape: TransferFunction

    def __post_init__(self) -> None:
        shape = TransferFunction.accept("shape", self.shape)
        if shape.relative_degree < 0 or not shape.is_stable or not shape.num.any():
            raise InputError(
                f"shape must be proper, stable and not zero, got num = {validate.show(shape.num)}, "
                f"den = {validate.show(shape.den)}"
            )
        validate.freeze(self, shape=shape)

    def added(self, path: PlantInput, size: float) -> PlantInput:
        if path.multiplicative is not None:
            raise InputError.of("plant.input.multiplicative", "cannot be combined with a modelling error at the same place")
        return replace(path, multiplicative=TransferFunction(size * self.shape.num, self.shape.den))

    def allowed(self, w: Array, gain: Array) -> Array:
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (np.abs(self.shape.at(1j * w)) * gain))

    def limit(self, loop: StateSpace) -> float:
        """Return the gain margin of the loop that Delta_m closes around shape T, relative to a size well below the margin."""
        T = complementary_sensitivity(loop)
        w = frequency_grid(T)
        small = 0.5 * float(self.allowed(w, np.abs(T.response(w))).min())  # otherwise ``margins`` rejects an unstable loop
        around = series(T, self.shape.realise())
        return small * margins(replace(around, C=small * around.C, D=small * around.D)).gain_up
