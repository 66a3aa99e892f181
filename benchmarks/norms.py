"""Certified L1 norms beside quadratures of the impulse response that reach the same accuracy."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import IntegrationWarning, quad

from barbalat.certificates.bounds import theorem_1
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.l1_norms.norm import enclosed
from barbalat.linear.systems import input_filter
from benchmarks.loops import PROBLEM
from benchmarks.race import WrongNumbersError
from benchmarks.table import Row

WIDTH = 1e-9
"""Relative width required of the enclosure, and the error that a quadrature must reach."""
DECAYED = 30.0
"""Number of the slowest time constants after which a quadrature stops: e^-30 is 1e-13."""
MOST_POINTS, MOST_QUICKLY = 2**24, 2**20
"""Largest number of points of a trapezoidal rule, with 128 MB for each array, and the number in a quick run."""
ROUGHLY = 1e-4
"""Relative error that a quadrature must reach in any case. With a larger error it would not be the same integral."""


class System(NamedTuple):
    name: str
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray

    @property
    def end(self) -> float:
        return float(DECAYED / -np.linalg.eigvals(self.A).real.max())

    def impulse(self) -> Callable[[np.ndarray], np.ndarray]:
        """C e^(At) B at many instants, computed by the eigenvectors, which is the fastest way for a quadrature."""
        values, vectors = np.linalg.eig(self.A)
        residues = (self.C @ vectors)[0] * np.linalg.solve(vectors, self.B.astype(complex))[:, 0]

        def h(t: np.ndarray) -> np.ndarray:
            total = np.zeros(np.shape(t))
            for value, residue in zip(values, residues, strict=True):
                if value.imag >= 0:  # a conjugate pair counts twice
                    total += (2 if value.imag > 0 else 1) * (residue * np.exp(value * t)).real
            return total

        return h


def systems() -> list[System]:
    """Section V's condition, two random systems, a lightly damped one and one with poles far apart."""
    A, B, C, _ = theorem_1.filtered_model(PROBLEM.known, input_filter(0.02).realise())
    found = [System("W_b(1 - C) of Section V, order 3", A, B, C[1:])]
    for n in (4, 8):
        rng = np.random.default_rng(n)
        blocks = [[[-a, w], [-w, -a]] for a, w in rng.uniform(0.3, 3, (n // 2, 2))]
        A = np.zeros((n, n))
        for i, block in enumerate(blocks):
            A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
        T = np.linalg.qr(rng.normal(size=(n, n)))[0]
        found.append(System(f"random, order {n}", T @ A @ T.T, rng.normal(size=(n, 1)), rng.normal(size=(1, n))))
    damped = np.array([[0.0, 1.0], [-1.0, -0.02]])
    found.append(System("second order, damping 0.01", damped, np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])))
    apart = np.diag([-0.1, -100.0])
    found.append(System("poles 0.1 and 100", apart, np.ones((2, 1)), np.array([[0.1, -30.0]])))
    return found


def section(*, quick: bool) -> tuple[list[Row], list[str]]:
    most = MOST_QUICKLY if quick else MOST_POINTS
    rows = [row for system in systems() for row in _compare(system, 1 if quick else 3, most)]
    notes = [
        f"Enclosures of relative width {WIDTH:g}, guaranteed; a quadrature's error is known only because of them.",
        "Where the error is the enclosure's width, the quadrature's value lies inside.",
        f"Trapezoids: the least power of two of points, up to 2^{most.bit_length() - 1}, with an error up to {WIDTH:g}, "
        f"found beforehand; quad is asked for {WIDTH:g}.",
        f"Both stop at {DECAYED:g} slowest time constants and evaluate by eigenvectors. Best of interleaved repeats.",
    ]
    return rows, notes


def _afresh(system: System) -> float:
    """Compute an enclosure without the cache that is normally used."""
    enclosed.cache_clear()
    return l1_norm(system.A, system.B, system.C, np.zeros((1, 1)), relative_width=WIDTH).midpoint


def _compare(system: System, repeats: int, most: int) -> list[Row]:
    found = l1_norm(system.A, system.B, system.C, np.zeros((1, 1)), relative_width=WIDTH)
    points = _points_needed(system, found, most)
    contestants = {
        "enclosure": lambda: _afresh(system),
        f"trapezoids, 2^{points.bit_length() - 1} points": lambda: trapezoids(system, points),
        "scipy quad": lambda: adaptive(system),
    }
    samples: dict[str, list[float]] = {name: [] for name in contestants}
    values = {}
    for _ in range(repeats):
        for name, run in contestants.items():
            start = time.perf_counter()
            values[name] = run()
            samples[name].append(time.perf_counter() - start)
    ours, *peers = contestants
    rows = []
    for name in peers:
        error = _error(values[name], found)
        if error > ROUGHLY:
            raise WrongNumbersError(
                f"{name} gives {values[name]:.6g} for {system.name}, the enclosure is around {found.midpoint:.6g}"
            )
        mine = f"{1e3 * min(samples[ours]):.3g} ms, width {found.relative_width:.1g}"
        theirs = f"{name}: {1e3 * min(samples[name]):.3g} ms, error {error:.1g}"
        rows.append(Row(system.name, mine, theirs, min(samples[name]) / min(samples[ours])))
    return rows


def _error(value: float, found: Enclosure) -> float:
    """Relative error from the nearer end. Inside the enclosure it is at most the enclosure's width."""
    return max(value - found.upper, found.lower - value, 0.0) / found.lower or found.relative_width


def _points_needed(system: System, found: Enclosure, most: int) -> int:
    points = 2**8
    while points < most and _error(trapezoids(system, points), found) > WIDTH:
        points *= 2
    return points


def trapezoids(system: System, points: int) -> float:
    t = np.linspace(0, system.end, points + 1)
    return float(np.trapezoid(np.abs(system.impulse()(t)), dx=t[1]))


def adaptive(system: System) -> float:
    """Integrate in pieces of one slowest time constant, because quad limits its subdivisions for each piece."""
    h, ends = system.impulse(), np.linspace(0, system.end, int(DECAYED) + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntegrationWarning)  # if this is not enough, the error shows it
        return sum(quad(lambda t: abs(float(h(t))), a, b, limit=2000, epsabs=1e-12, epsrel=WIDTH)[0] for a, b in pairwise(ends))
