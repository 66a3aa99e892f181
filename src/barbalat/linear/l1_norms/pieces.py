"""Polynomials on a segment of time. The sign of each polynomial is proved with Bernstein coefficients; an unresolved sign widens
the enclosure."""

from __future__ import annotations

import math
from functools import lru_cache

from flint import arb, arb_mat, arb_poly, ctx

# Taylor degree of a segment. At degree d the remainder reaches 1e-12 for frequency * step = (1e-12 d!)^(1/d),
# 3 rad at d = 24: about one sign change a segment, which one set of Bernstein coefficients still resolves.
POLYNOMIAL_DEGREE = 24
# A piece that has been halved this often is shorter than the rounding errors of its ends; its unresolved sign then widens the
# enclosure.
_HALVINGS_LIMIT = 64
# Newton's method doubles the number of correct digits in each step: from one digit to beyond float64 in four or five steps.
_NEWTON_STEPS = 8
# Comparing balls with a ball takes half the time of comparing them with 0, which is converted each time.
_ZERO = arb(0)
# A root within this relative distance of an end is not split off; the piece is halved instead, so that no piece degenerates.
_NEAREST_SPLIT = 2.0**-40


@lru_cache(maxsize=8)
def bernstein_matrix(bits: int) -> arb_mat:
    """Return the matrix from Taylor to Bernstein coefficients of degree POLYNOMIAL_DEGREE on [0, 1], at `bits` bits.

    b_i = sum over k <= i of binomial(i, k)/binomial(d, k) a_k (Farouki, The Bernstein polynomial basis,
    2012).
    """
    size = POLYNOMIAL_DEGREE + 1
    with ctx.workprec(bits):
        inverses = [1 / arb(math.comb(POLYNOMIAL_DEGREE, k)) for k in range(size)]
        return arb_mat([[inverses[k] * math.comb(i, k) for k in range(size)] for i in range(size)])


def remainder_constant(length: arb) -> arb:
    """Return K: |h - Taylor polynomial| averages at most K norm(A^(d+1) x) over [0, length], d = POLYNOMIAL_DEGREE.

    The remainder integral_0^s (s-u)^d/d! c A^(d+1) e^(Au) x du is at most, by Cauchy-Schwarz and the
    certificate, s^(d+1/2)/(d! sqrt(2d+1)) norm(A^(d+1) x); its mean over the segment divides by d + 3/2.
    """
    degree = arb(POLYNOMIAL_DEGREE)
    power = length**POLYNOMIAL_DEGREE * length.sqrt()
    return power / (arb(math.factorial(POLYNOMIAL_DEGREE)) * (2 * degree + 1).sqrt() * (degree + arb(1.5)))


class BernsteinPiece:
    """Polynomial on [0, 1] by its Bernstein coefficients: |total| <= integral |p| <= |total| + gap.

    The mean of the coefficients is the integral; min(negative, positive part) of p is at most the same part
    of its coefficients, as the Bernstein polynomials are nonnegative, and 2 min(...) is the gap.
    """

    __slots__ = ("coefficients", "gap", "total")

    def __init__(self, coefficients: list[arb]) -> None:
        self.coefficients = coefficients
        self.total: arb = sum(coefficients, arb(0)) / len(coefficients)
        negative = [-value for value in coefficients if not value >= _ZERO]
        positive = [value for value in coefficients if not value <= _ZERO]
        self.gap: arb = arb(0)
        if negative and positive:
            below = sum((value.upper() for value in negative), arb(0))
            above = sum((value.upper() for value in positive), arb(0))
            self.gap = 2 * min(below, above) / len(coefficients)

    def blurred(self) -> bool:
        """Whether the gap is due to the radii of the coefficients, which halving cannot reduce."""
        noise = sum((value.rad() for value in self.coefficients), arb(0)) / len(self.coefficients)
        # A coefficient that is only noise contributes at most twice its radius, and the gap counts it twice.
        return not self.gap > 4 * noise

    def sign_variations(self) -> tuple[int, float]:
        """Return the number of sign variations, and the position in [0, 1] of the first one on the control polygon."""
        values = [float(value) for value in self.coefficients]
        scale = max(abs(value) for value in values)
        variations, place, last = 0, 0.5, 0
        for i, value in enumerate(values):
            if abs(value) <= 2.0**-52 * scale:  # rounding noise in floating point
                continue
            if values[last] * value < 0.0:
                variations += 1
                if variations == 1:
                    before = abs(values[last])
                    place = (last + (i - last) * before / (before + abs(value))) / (len(values) - 1)
            last = i
        return variations, place


def resolved(polynomial: arb_poly, piece: BernsteinPiece, tolerance: arb, room: int) -> list[BernsteinPiece]:
    """Return pieces in order of time, about `room` at most, whose gaps are within the tolerance.

    Pieces that cannot be resolved at this precision or within the room keep their larger gap.

    The child for [u, v] is p(u + (v - u) s) (v - u), so the children's integrals over [0, 1] add up.
    """
    pending = [(polynomial, piece, 0)]
    done: list[BernsteinPiece] = []
    while pending:
        polynomial, piece, halvings = pending.pop()
        full = halvings >= _HALVINGS_LIMIT or len(done) + len(pending) >= room
        if full or piece.gap <= tolerance or piece.blurred():
            done.append(piece)
            continue
        split = split_point(polynomial, piece)
        for start, length in ((split, 1 - split), (arb(0), split)):
            child = polynomial(arb_poly([start, length])) * length
            coefficients = child.coeffs()
            coefficients += [arb(0)] * (POLYNOMIAL_DEGREE + 1 - len(coefficients))
            column = arb_mat(POLYNOMIAL_DEGREE + 1, 1, coefficients)
            values = (bernstein_matrix(ctx.prec) * column).entries()
            pending.append((child, BernsteinPiece(values), halvings + 1))
    return done


def split_point(polynomial: arb_poly, piece: BernsteinPiece, nearest: float = _NEAREST_SPLIT) -> arb:
    """Return an exact point of (0, 1), at least ``nearest`` from either end: close to the root if there is exactly one, with an
    error of the order of ``nearest`` squared; otherwise the middle."""
    variations, place = piece.sign_variations()
    middle = arb(0.5)
    if variations != 1:
        return middle
    derivative = polynomial.derivative()
    point = arb(place)
    for _ in range(_NEWTON_STEPS):
        slope = derivative(point).mid()
        if slope == 0:
            return middle
        correction = (polynomial(point).mid() / slope).mid()
        point = (point - correction).mid()
        if not (point > nearest and point < 1 - nearest):
            return middle
        if abs(correction) < nearest:  # the next error is its square, beyond float64
            return point
    return middle
