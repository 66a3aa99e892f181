"""Witnesses of L1 norms: a quadratic form with its rate, and the steps on which an impulse response is followed.

Witnesses alone prove nothing: a checker follows the response on these steps in ball arithmetic (docs/proofs.md, "The L1 norm"). A
step ends where an output changes sign, so that the integral of |h| is known to the last digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx

from barbalat.linear.conditions import balance
from barbalat.linear.l1_norms.decay import decay_certificate, euclidean_norm
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, BernsteinPiece, bernstein_matrix, split_point
from barbalat.validate import Array

CLOSENESS = 2.0**-60
"""Target width of the enclosure relative to the norm, far below that of a certificate's enclosure."""
FIRST_BITS, MOST_BITS = 256, 4096
RATES = (0.5, 0.25, 0.05)
"""Fractions of the slowest decay that are tried."""
MOST_STEPS = 40_000
"""Largest number of steps for one input, half a minute of work; a response that takes more has no witness."""
NEAREST_ROOT = 2.0**-60
"""Working precision of a step in bits; a root is computed to twice as many."""
SHORTEST_PIECE = 2.0**-90
"""Relative length, in steps, of an interval on which an undecided sign widens the enclosure instead of ending the step."""


def dyadic(value: arb) -> str:
    """An exact ball as a whole number and a power of two."""
    mantissa, exponent = value.mid().man_exp()
    return f"{int(mantissa)}p{int(exponent)}"


def witness(A: arb_mat, B: arb_mat, C: arb_mat, size: float, *, closeness: float = CLOSENESS) -> dict[str, Any] | None:
    """A witness for c_i e^(At) b_j of all outputs and inputs, where ``size`` is approximately the norm; None if there is none.

    A (n, n), B (n, m), C (p, n): balls, practically exact at 1024 bits.
    """
    spectrum = np.linalg.eigvals(as_floats(A))
    decay = float(-spectrum.real.max())
    if not (decay > 0 and math.isfinite(size) and size > 0):
        return None
    stiffness = math.log2(float(np.abs(spectrum).max()) / float(np.abs(spectrum).min()))
    bits = FIRST_BITS + 64 * math.ceil((POLYNOMIAL_DEGREE + 2) * stiffness / 64)
    while bits <= MOST_BITS:
        with ctx.workprec(bits):
            form = _quadratic_form(A, C, spectrum, decay)
            if form is not None:
                march = _March(A, C, *form, size=arb(size), closeness=closeness)
                steps = [march.steps(column_of(B, j)) for j in range(B.ncols())]
                if all(one is not None for one in steps):
                    P, rate = form
                    rows = [[dyadic(entry) for entry in row] for row in P.tolist()]
                    return {"bits": bits, "P": rows, "rate": dyadic(rate), "steps": steps}
        bits *= 2
    return None


def as_floats(matrix: arb_mat) -> Array:
    """The balls' centres, rounded."""
    return np.array([[float(entry) for entry in row] for row in matrix.tolist()])


def column_of(matrix: arb_mat, j: int) -> arb_mat:
    """One column (n, 1)."""
    return arb_mat([[matrix[i, j]] for i in range(matrix.nrows())])


def _quadratic_form(A: arb_mat, C: arb_mat, spectrum: Array, decay: float) -> tuple[arb_mat, arb] | None:
    """P and a rate with A'P + PA + 2 rate P + C'C < 0, found in balanced coordinates and in a unit of time that suits the size of
    A."""
    floats = as_floats(A)
    _, scale = balance(floats)  # powers of two
    n, time = A.nrows(), math.frexp(float(np.abs(floats / scale[:, None] * scale).max()))[1]
    up = [arb(float(one)) for one in scale]
    unit = arb(2) ** time
    scaled_A = arb_mat([[A[i, j] * up[j] / (up[i] * unit) for j in range(n)] for i in range(n)])
    scaled_C = arb_mat([[C[i, j] * up[j] for j in range(n)] for i in range(C.nrows())])
    roots = [complex(one) / 2.0**time for one in spectrum]
    for share in RATES:
        rate = math.ldexp(share * decay, -time)
        found = decay_certificate(scaled_A, scaled_C, roots, rate)
        if found is not None:
            P = found.factor.transpose() * found.factor
            entries = [[(P[i, j] / (up[i] * up[j] * unit)).mid() for j in range(n)] for i in range(n)]
            for i in range(n):
                for j in range(i):
                    entries[i][j] = entries[j][i]
            return arb_mat(entries), arb(rate) * unit
    return None


@dataclass
class _March:
    """The steps along |c_i e^(At) b|, for all rows of C at once."""

    A: arb_mat
    C: arb_mat
    P: arb_mat
    rate: arb
    size: arb
    closeness: float = CLOSENESS
    decay: float = field(init=False)
    transitions: dict[str, arb_mat] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.decay = float(self.rate)

    def steps(self, start: arb_mat) -> list[str] | None:
        """Durations until the rest is negligible."""
        x, found, tail = start.mid(), list[str](), (2 * self.rate).sqrt() * self.size * self.closeness / 4
        per_second = float(self.size) * self.closeness * self.decay / 400
        while not self._norm(x) <= tail:
            if len(found) >= MOST_STEPS:
                return None
            terms = [x]
            for k in range(1, POLYNOMIAL_DEGREE + 2):
                terms.append(self.A * terms[-1] * (arb(1) / k))
            step = self._step(terms, per_second)
            if step is None:
                return None
            found.append(dyadic(step))
            x = (self._transition(found[-1], step) * x).mid()
        return found

    def _transition(self, name: str, step: arb) -> arb_mat:
        """e^(A step), computed by repeatedly squaring the exponential of a short part; its balls stay small where fast modes have
        decayed."""
        if name not in self.transitions:
            size = float(np.abs(as_floats(self.A)).sum(axis=1).max()) * float(step)
            halvings = max(0, math.frexp(size)[1])
            part = (self.A * (step * arb(2) ** -halvings)).exp()
            for _ in range(halvings):
                part = part * part
            self.transitions[name] = part
        return self.transitions[name]

    def _norm(self, x: arb_mat) -> arb:
        return euclidean_norm(arb_mat([[((x.transpose() * self.P * x)[0, 0]).upper().max(arb(0)).sqrt()]]))

    def _step(self, terms: list[arb_mat], per_second: float) -> arb | None:
        """The longest power of two whose remainder is tolerable, or the time up to which an output changes its sign."""
        d = POLYNOMIAL_DEGREE
        beyond = self._norm(terms[-1])  # |A^25 x|_P/25!
        longest = 8.0 / self.decay
        if beyond > 0:
            room = math.log2(per_second * math.sqrt(2 * d + 1)) - float(beyond.log()) / math.log(2)
            longest = min(longest, 2.0 ** (room / (d + 0.5)))
        if not longest > 0:
            return None
        step = arb(2) ** math.floor(math.log2(longest))
        outputs = [[(self.C * term)[i, 0] for term in terms[:-1]] for i in range(self.C.nrows())]
        tolerance = self.size * self.closeness / 1000
        shortest = step * SHORTEST_PIECE
        for coefficients in outputs:
            step = _to_the_first_sign_change(coefficients, step, tolerance, shortest)
        return step


def _to_the_first_sign_change(coefficients: list[arb], step: arb, tolerance: arb, shortest: arb) -> arb:
    """A step, no longer than the given one, on which the integral of |p| of the polynomial is known within the tolerance."""
    while step > shortest:
        powers = [step**k for k in range(POLYNOMIAL_DEGREE + 1)]
        local = [a * power for a, power in zip(coefficients, powers, strict=True)]
        piece = BernsteinPiece((bernstein_matrix(ctx.prec) * arb_mat([[one] for one in local])).entries())
        if piece.gap * step <= tolerance or piece.blurred():
            break
        step = (step * _cut(split_point(arb_poly(local), piece, NEAREST_ROOT))).mid()
    return step


def _cut(point: arb) -> arb:
    """The point rounded to 128 bits; no witness needs more."""
    with ctx.workprec(128):
        return (point + 0).mid()
