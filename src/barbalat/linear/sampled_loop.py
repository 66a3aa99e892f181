"""A linear loop with a sampled controller, zero-order hold and a delay of any length: exact from sample to sample.

Between samples X' = A X + E v, at a sample X becomes J X and the controller's output u = C X, which is held and reaches the plant
as v(t) = u(t - d). With d = (l + f) T, 0 <= f < 1, v changes within a sample, at f T:

    X[k+1] = J (e^(A T) X[k] + e^(A (1-f) T) Gamma(f T) u[k-l-1] + Gamma((1-f) T) u[k-l]),  Gamma(t) = integral_0^t e^(A s) ds E.

With R = C (zI - J e^(A T))^-1 J, L(z) from v to -u is -R (e^(A (1-f) T) Gamma(f T)/z + Gamma((1-f) T))/z^l. Gain and phase
margins and peaks of one input are those of L(z) on the unit circle, the other inputs closed; by z = (1 + s T/2)/(1 - s T/2) they
are those of a continuous system. What is no function of one such L(z) stands in ``sampled_margins``.

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., sections 2.3 (delays that are no whole samples), 8.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from barbalat.linear.systems import StateSpace
from barbalat.validate import Array


class Effects(NamedTuple):
    """What u[k-l] and u[k-l-1] make of X by the next sample, for a delay of l samples and a share f of one; a column per
    input."""

    whole: Array
    part: Array
    late: Array
    early: Array


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """A (s, s), E (s, m), J (s, s), C (m, s) and the sample time T [s]; u = C X acts with the sign that it has in the loop."""

    A: Array
    E: Array
    J: Array
    C: Array
    T: float

    def over(self, t: float) -> tuple[Array, Array]:
        """e^(A t) and Gamma(t)."""
        from scipy.linalg import expm

        s, m = self.E.shape
        whole = expm(t * np.block([[self.A, self.E], [np.zeros((m, s + m))]]))
        return whole[:s, :s], whole[:s, s:]

    @property
    def inputs(self) -> int:
        return int(self.E.shape[1])

    def broken(self, delay: float | Array) -> tuple[Array, Array, Array]:
        """(M, N, C) of s[k+1] = M s[k] + N v[k], u[k] = C s[k]: open where u leaves, with one delay [s] or one of each input."""
        found = self.effects(delay)
        s, m = self.E.shape
        of_earlier: dict[tuple[int, int], int] = {}  # where u_i of so many samples ago stands while it is under way
        depths = found.whole + (found.part > 0)
        for age in range(1, int(depths.max()) + 1):
            of_earlier |= {(age, i): s + len(of_earlier) + k for k, i in enumerate(np.flatnonzero(depths >= age).tolist())}
        size = s + len(of_earlier)
        M, N = np.zeros((size, size)), np.zeros((size, m))
        M[:s, :s] = self.between
        for (age, i), row in of_earlier.items():
            if age == 1:
                N[row, i] = 1.0
            else:
                M[row, of_earlier[age - 1, i]] = 1.0
        for i, whole in enumerate(found.whole):
            for age, effect in ((whole, found.late[:, i]), (whole + 1, found.early[:, i])):
                if age == 0:
                    N[:s, i] += self.J @ effect
                elif (age, i) in of_earlier:
                    M[:s, of_earlier[age, i]] += self.J @ effect
        return M, N, np.hstack([self.C, np.zeros((m, len(of_earlier)))])

    def broken_at(self, i: int, delay: float | Array) -> tuple[Array, Array, Array]:
        """The same, open at the input i alone: the others are closed."""
        M, N, C = self.broken(delay)
        others = np.arange(self.inputs) != i
        return M + N[:, others] @ C[others], N[:, [i]], C[[i]]

    def effects(self, delay: float | Array) -> Effects:
        delays = np.broadcast_to(delay, self.inputs)
        splits = [_split(float(one), self.T) for one in delays]
        late, early = np.empty_like(self.E), np.empty_like(self.E)
        for part in {part for _, part in splits}:
            (after, of_late), (_, of_early) = self.over((1 - part) * self.T), self.over(part * self.T)
            with_it = [i for i, (_, one) in enumerate(splits) if one == part]
            late[:, with_it], early[:, with_it] = of_late[:, with_it], (after @ of_early)[:, with_it]
        return Effects(np.array([whole for whole, _ in splits]), np.array([part for _, part in splits]), late, early)

    @cached_property
    def between(self) -> Array:
        """The map J e^(A T) from one sample to the next."""
        return np.asarray(self.J @ self.over(self.T)[0])

    def closed(self, delay: float | Array, factor: float = 1.0) -> Array:
        """From sample to sample; ``factor`` multiplies all inputs."""
        M, N, C = self.broken(delay)
        return np.asarray(M + factor * N @ C)

    def radius(self, delay: float | Array, factor: float = 1.0) -> float:
        """The closed loop's spectral radius: below 1 where it is stable."""
        return float(np.abs(np.linalg.eigvals(self.closed(delay, factor))).max())

    def as_continuous(self, delay: float, at: int = 0) -> StateSpace:
        """L broken at one input, at s = (2/T)(z - 1)/(z + 1): its frequencies are (2/T) tan(w T/2)."""
        M, N, C = self.broken_at(at, delay)
        past = np.linalg.inv(M + np.eye(len(M)))
        scale = 2 / self.T
        A, B = scale * past @ (M - np.eye(len(M))), scale * past @ N[:, 0]
        return StateSpace(A, B, -2 * C[0] @ past, float(C[0] @ past @ N[:, 0]))

    def resolvent(self, w: Array) -> Array:
        """R at frequencies (K,) [rad/s], (K, m, s)."""
        z = np.exp(1j * w * self.T)
        M = self.between
        turned = np.linalg.solve((z[:, None, None] * np.eye(len(M)) - M).transpose(0, 2, 1), self.C.T[None].astype(complex))
        return np.asarray(turned.transpose(0, 2, 1) @ self.J)

    def response(self, w: Array, R: Array, effects: Effects) -> Array:
        """-R (late + early/z)/z^l at frequencies (K,), from inputs with these effects: L, where R is the resolvent."""
        z = np.exp(1j * w * self.T)[:, None, None]
        return np.asarray(-(R @ effects.late + R @ effects.early / z) / z**effects.whole)


def _split(delay: float, T: float) -> tuple[int, float]:
    """Whole samples and the rest, a share of one; a rest within rounding of a sample is none."""
    whole = int(np.floor(delay / T + 1e-12))
    return whole, max(delay / T - whole, 0.0)
