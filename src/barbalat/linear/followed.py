"""The response of a linear system to a known signal, enclosed for all times up to an end by Taylor polynomials on short steps.

A signal that is a sum of sines, or linear between instants, is the output of a linear system that restarts at each bend. With the
states of that system included, the response is c e^(At) z, computed in ball arithmetic. In each step, the Bernstein coefficients
and the remainder of the Taylor polynomial bound the outputs (docs/proofs.md, "Along the command").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx

from barbalat.linear.enclosure import float_above
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, bernstein_matrix
from barbalat.validate import Array, InputError

FIRST_BITS, MOST_BITS = 192, 3072
MOST_STEPS = 2000
"""Largest number of steps; so many take several seconds for ten states."""
MISSED = 2.0**-60
"""Admissible remainder of the Taylor polynomial of a step, relative to the outputs, far below the printed digits of a
certificate."""
SHORTEST_STEP = 2.0**-40
"""Shortest step [s]. If a shorter step is needed, the cause is the radii of the balls, and the precision is increased."""
GROWTH_ROOM = 0.5
"""Addition to the growth rate of the matrix of magnitudes [1/s], which keeps the weights of the components within a moderate
range."""
SPREAD = 2.0**-30
"""Admissible radius of the balls of the state, relative to the state; beyond it the precision is increased."""


@dataclass(frozen=True)
class Generator:
    """A signal r = c w with w' = S w, where each piece (duration, w) restarts w; the pieces end at the requested time."""

    S: Array
    c: Array
    pieces: list[tuple[arb, list[arb]]]


@dataclass(frozen=True)
class Motion:
    """A system z' = A z with outputs C z, where the first states belong to the signal's generator and ``start`` contains the
    initial values of the others."""

    A: arb_mat
    C: arb_mat
    signal: Generator
    start: list[arb]


class Followed(NamedTuple):
    """The response up to the end of the last piece of the signal, and the numbers needed to recompute it.

    bounds   for each step an array (outputs, 25), in which the largest entry of each row bounds an output. The entries are
             Bernstein coefficients, so sums of magnitudes of outputs can also be bounded entry by entry
    steps    the durations [s] of the steps of each piece, except the last step, which ends with the piece
    weights  v > 0 of ``growth``
    bits     the precision
    """

    bounds: list[Array]
    steps: list[list[float]]
    weights: list[float]
    bits: int


def followed(motion: Motion) -> Followed:
    """Compute the response; raises InputError if it takes too many steps."""
    bits = FIRST_BITS
    while bits <= MOST_BITS:
        with ctx.workprec(bits):
            attempt = _Steps(motion)
            bounds = attempt.all()
        if bounds is not None:
            return Followed(bounds, attempt.steps, [float(one) for one in attempt.weights], bits)
        bits *= 2
    raise InputError("the response to the case's command could not be enclosed at any precision that was tried")


class _Steps:
    """One attempt at the current precision."""

    def __init__(self, motion: Motion) -> None:
        self.motion, A = motion, motion.A
        rows, powers = motion.C, list[list[arb]]()
        for k in range(POLYNOMIAL_DEGREE + 1):
            powers += rows.tolist()
            rows = rows * A * (arb(1) / (k + 1))
        self.powers = arb_mat(powers)  # C A^k/k!, stacked
        self.beyond = A ** (POLYNOMIAL_DEGREE + 1) * (arb(1) / math.factorial(POLYNOMIAL_DEGREE + 1))
        self.weights, self.growth = growth(A)
        self.gains = [sum((abs(one) * v for one, v in zip(row, self.weights, strict=True)), arb(0)) for row in motion.C.tolist()]
        self.gain = float(max(one.upper() for one in self.gains))
        self.known, self.powers_of = dict[float, arb_mat](), dict[float, list[arb]]()
        self.largest, self.first, self.step = 0.0, 0.0, 1.0
        self.steps = list[list[float]]()

    def all(self) -> list[Array] | None:
        """All steps; None if the precision is insufficient."""
        bounds, rest, pieces = list[Array](), self.motion.start, self.motion.signal.pieces
        for place, (length, w) in enumerate(pieces, start=1):
            z, left = arb_mat([[one] for one in (*w, *rest)]), length
            self.first = max(self.first, self.gain * self._size(z))
            self.steps.append([])
            while True:
                beyond = self._size(self.beyond * z)
                step = self._longest(beyond)
                if step is None or _spread(z) > SPREAD:
                    return None
                last = not left > step
                d = left if last else arb(step)
                bounds.append(self._bounds(z, beyond, self._powers(d, None if last else step)))
                self.largest = max(self.largest, float(bounds[-1].max(initial=0.0)))
                if len(bounds) > MOST_STEPS:
                    raise InputError(f"the response to the case's command takes more than {MOST_STEPS} steps")
                if last and place == len(pieces):
                    return bounds
                z = self._transition(d, None if last else step) * z
                if last:
                    break
                self.steps[-1].append(step)
                left = left - step
            rest = z.entries()[len(w) :]
        return bounds

    def _size(self, z: arb_mat) -> float:
        return float_above(max((abs(one) / v).upper() for one, v in zip(z.entries(), self.weights, strict=True)))

    def _longest(self, beyond: float) -> float | None:
        """The longest power of two with a small remainder, at most twice the last step; None if rounding errors prevent it."""
        step, size = 2 * self.step, float(self.growth)
        scale = max(self.largest, self.first)
        room = math.log(MISSED * scale / self.gain) if self.gain * scale > 0 else math.inf
        while beyond > 0 and (POLYNOMIAL_DEGREE + 1) * math.log(step) + size * step + math.log(beyond) > room:
            step /= 2
            if step < SHORTEST_STEP:
                return None
        self.step = step
        return step

    def _transition(self, d: arb, name: float | None) -> arb_mat:
        if name is None:
            return (self.motion.A * d).exp()
        if name not in self.known:
            self.known[name] = (self.motion.A * d).exp()
        return self.known[name]

    def _powers(self, d: arb, name: float | None) -> list[arb]:
        """1, d ... d^25, and e^(growth d); kept by the step's name."""
        if name is None or name not in self.powers_of:
            found = [*(d**k for k in range(POLYNOMIAL_DEGREE + 2)), (self.growth * d).exp()]
            if name is None:
                return found
            self.powers_of[name] = found
        return self.powers_of[name]

    def _bounds(self, z: arb_mat, beyond: float, powers: list[arb]) -> Array:
        """(outputs, 25): magnitudes of the Bernstein coefficients, plus the remainder on the step."""
        p, (*scales, last, grown) = self.motion.C.nrows(), powers
        taylor = (self.powers * z).entries()
        local = arb_mat(len(scales), p, [one * scales[k // p] for k, one in enumerate(taylor)])
        controls = (bernstein_matrix(ctx.prec) * local).entries()
        missed = arb(beyond) * last * grown
        sizes = np.array([float(abs(one).upper()) for one in controls]).reshape(len(scales), p).T
        return (sizes + np.array([[float_above(missed * gain)] for gain in self.gains])) * (1 + 1e-15)  # three roundings


def growth(A: arb_mat) -> tuple[list[arb], arb]:
    """v > 0 and mu >= 0 with M v <= mu v, where M is A with the magnitudes of its off-diagonal entries.

    |e^(As) z| <= e^(mu s) max_i(|z_i|/v_i) v then holds in every component: the right side grows faster than any |z_i|. Any v > 0
    is valid. Its entries are powers of two, so that the last digits of LAPACK, which differ between processors, do not affect the
    bound.
    """
    M = np.array([[float(one) for one in row] for row in A.tolist()])
    M = np.where(np.eye(len(M), dtype=bool), M, np.abs(M))
    abscissa = float(np.linalg.eigvals(M).real.max())
    shifted = max(0.0, abscissa) + GROWTH_ROOM
    solved = np.linalg.solve(shifted * np.eye(len(M)) - M, np.ones(len(M)))
    v = [arb(float(one)) for one in np.exp2(np.round(np.log2(solved)))]
    rates = [
        (row[i] * v[i] + sum((abs(one) * w for j, (one, w) in enumerate(zip(row, v, strict=True)) if j != i), arb(0))) / v[i]
        for i, row in enumerate(A.tolist())
    ]
    return v, max((one.upper() for one in rates), default=arb(0)).max(arb(0))


def _spread(z: arb_mat) -> float:
    entries = z.entries()
    largest = max(float(abs(one.mid())) for one in entries)
    return max(float(one.rad()) for one in entries) / largest if largest > 0 else 0.0
