"""Explicit Runge-Kutta methods as tableaux, and their regions of stability.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.1, and II, section IV.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from barbalat.protocols import Value


@dataclass(frozen=True)
class Tableau:
    """Coefficients of an explicit method: a is strictly lower triangular, row by row; order is the convergence order."""

    name: str
    order: int
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<Tableau {self.name!r} of order {self.order}>"

    @property
    def nodes(self) -> tuple[float, ...]:
        """The distinct fractions of a step at which signals are needed, in increasing order."""
        return tuple(sorted(set(self.c)))

    def advance(
        self,
        derivative: Callable[[Value, Value], Value],
        limit: Callable[[Value], Value],
        state: Value,
        signals: dict[float, Value],
        h: float,
    ) -> Value:
        """Take one step. ``limit`` acts on every stage value and on the result, so a limited integrator is part of the method."""
        slopes = [derivative(state, signals[self.c[0]])]
        for row, node in zip(self.a[1:], self.c[1:], strict=True):
            slopes.append(derivative(limit(_combine(state, h, row, slopes)), signals[node]))
        return limit(_combine(state, h, self.b, slopes))

    @property
    def stability_polynomial(self) -> np.ndarray:
        """R(z) = 1 + z b'(I - z a)^-1 1, lowest power first: the growth in one step of x' = lambda x, z = h lambda."""
        stages = len(self.b)
        a = np.array([[*row, *[0.0] * (stages - len(row))] for row in self.a])
        coefficients, power = [1.0], np.ones(stages)
        for _ in range(stages):
            coefficients.append(float(np.array(self.b) @ power))
            power = a @ power
        return np.array(coefficients)

    def amplification(self, z: np.ndarray) -> np.ndarray:
        """R(z), for complex z of any shape."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(z, dtype=complex), self.stability_polynomial))

    def growth(self, z: np.ndarray) -> np.ndarray:
        """|R(z)|^2 - 1 without cancellation, so its sign distinguishes slow decay from slow growth."""
        z = np.asarray(z, dtype=complex)
        rest = z * np.polynomial.polynomial.polyval(z, self.stability_polynomial[1:])  # R - 1
        return np.asarray(2 * rest.real + np.abs(rest) ** 2)

    @property
    def reach(self) -> float:
        """The |z| above which |R(z)| <= 1 never holds: Cauchy's bound on the roots of R - c, |c| <= 1."""
        smaller, leading = self.stability_polynomial[:-1].copy(), self.stability_polynomial[-1]
        smaller[0] += 1
        return 1 + float(np.abs(smaller).max() / abs(leading))

    @property
    def imaginary_limit(self) -> float:
        """The largest beta with |R(i y)| <= 1 on 0 <= y <= beta: an undamped oscillation of frequency w requires h w <= beta."""
        return self._limit(1j)

    @property
    def real_limit(self) -> float:
        """The largest s with |R(-y)| <= 1 on 0 <= y <= s: a decay of rate a requires h a <= s."""
        return self._limit(-1.0)

    def _limit(self, direction: complex) -> float:
        along = self.stability_polynomial * direction ** np.arange(len(self.b) + 1)
        excess = np.polynomial.polynomial.polymul(along, along.conj()).real
        excess[0] -= 1
        excess[np.abs(excess) < 1e-14] = 0.0  # |R|^2 - 1; terms that cancel in exact arithmetic leave a rounding error
        roots = np.polynomial.polynomial.polyroots(excess)
        real = np.sort(roots[(np.abs(roots.imag) < 1e-7 * np.abs(roots)) & (roots.real > 1e-7)].real)
        edges = np.concatenate([[0.0], real, [real[-1] + 1 if len(real) else 1.0]])
        for left, right in pairwise(edges):
            if np.polynomial.polynomial.polyval((left + right) / 2, excess) > 0:
                return float(left)
        raise ValueError(f"the method {self.name} does not grow anywhere along {direction}, so it can't be explicit")


def _combine(state: Value, h: float, weights: tuple[float, ...], slopes: list[Value]) -> Value:
    for weight, slope in zip(weights, slopes, strict=True):
        if weight:
            state = state + (h * weight) * slope
    return state


EULER = Tableau("euler", 1, ((),), (1.0,), (0.0,))
HEUN = Tableau("heun", 2, ((), (1.0,)), (1 / 2, 1 / 2), (0.0, 1.0))
RK4 = Tableau("rk4", 4, ((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.0, 1 / 2, 1 / 2, 1.0))
AUTO = Tableau("auto", 8, ((),), (1.0,), (0.0,))
"""A placeholder for DOP853, the method of variable-step runs, whose coefficients are in ``order_eight``. It has no fixed
steps."""
