"""Guaranteed enclosure of the L1 norm (induced L-infinity norm) of a stable continuous-time system.

The impulse response is marched in Taylor segments whose sign is proved with Bernstein coefficients; see
docs/l1-norms.md for the proof that every source of error is bounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, ctx, fmpq, fmpq_mat
from numpy.typing import ArrayLike

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.linear.enclosure import Enclosure, float_above, float_below
from barbalat.linear.l1_norms.decay import FloatMatrix, require_hurwitz
from barbalat.linear.l1_norms.march import Counters, integrate
from barbalat.linear.l1_norms.matrices import matrices
from barbalat.linear.l1_norms.model import System, build_model, needed_bits, norm_lower_bound

# Working precision of the first attempt: two limbs, enough for the default width of a benign system.
_FIRST_BITS = 128
# Precision limit: time scales 2^150 = 1e45 apart and as much cancellation fit; beyond, work grows to minutes.
_PRECISION_LIMIT = 4096
# Each repeated attempt tightens every tolerance by this factor.
_TIGHTENING = 2.0**-6
_ATTEMPTS = 4
# The ends are two units in the last place (2^-52 each) apart at best: no narrower width can be promised.
_NARROWEST_WIDTH = 1e-15


def of_norm(states: float) -> Estimate:
    """What an L1 norm costs: half a second and some 10 MB for 100 states."""
    return Estimate(memory=1000.0 * states**2, seconds=5e-7 * states**3)


def l1_norm(
    A: Any,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    D: ArrayLike | None = None,
    *,
    relative_width: float = 1e-9,
    work_limit: int = 20_000,
) -> Enclosure:
    """Return a guaranteed enclosure of the L1 norm of the system with exactly these float64 matrices.

    In place of the four, one system: a TransferFunction, a StateSpace, or python-control's (a state space of any size).

    A is (n, n), B (n, m), C (p, n), D (p, m); n may be 0. The norm is the induced L-infinity norm: the
    largest over outputs i of the sum over inputs j of |D_ij| + integral_0^inf |c_i e^(At) b_j| dt; t in s.
    Once more than `work_limit` segments have been integrated (some 50 us each at small order) the enclosure
    found so far is returned with converged=False; it is still valid.

    Raises ValueError for shapes that do not fit, entries that are not finite, an unusable relative_width or
    work_limit, and an A that is not certainly Hurwitz; OverflowError if the norm exceeds the float64 range;
    ArithmeticError if its time scales or cancellations need more than 4096 bits; InputError for a system beyond the budget.

    Source: Boyd and Barratt, Linear Controller Design (1991), section 5.2.3 (peak gain); Taylor models with
    Bernstein coefficients after Moore, Kearfott and Cloud, Introduction to Interval Analysis (2009).
    """
    system = _checked(*(matrices(A) if B is None and C is None and D is None else (A, B, C, D)))
    if not _NARROWEST_WIDTH <= relative_width < 1.0:
        raise ValueError(f"relative_width must be in [{_NARROWEST_WIDTH}, 1), got {relative_width}")
    if work_limit < 1:
        raise ValueError(f"work_limit must be at least 1, got {work_limit}")
    if system.order == 0 or not system.B.any() or not system.C.any():
        if system.order:
            require_hurwitz(system.A)
        return _static(system.D, relative_width)
    budget.require(
        "the system of an L1 norm", system.order, of_norm, given=f"has {system.order} states and",
        fits=lambda most: f"at most {most} states", what=f"an L1 norm of {system.order} states",
    )  # fmt: skip
    require_hurwitz(system.A)
    return _NormSearch(system, relative_width, work_limit).run()


def _checked(A: ArrayLike, B: ArrayLike | None, C: ArrayLike | None, D: ArrayLike | None) -> System:
    """Return the four matrices as float64, or raise ValueError if they do not form a system."""
    missing = [name for name, matrix in zip("ABCD", (A, B, C, D), strict=True) if matrix is None]
    if missing:
        raise ValueError(f"l1_norm needs all four matrices, or one system; not given: {', '.join(missing)}")
    given = [np.asarray(matrix, dtype=np.float64) for matrix in (A, B, C, D)]
    if any(matrix.ndim != 2 for matrix in given):
        raise ValueError("A, B, C and D must be two-dimensional arrays")
    a, b, c, d = given
    n, (p, m) = a.shape[0], d.shape
    if a.shape != (n, n) or b.shape != (n, m) or c.shape != (p, n) or p == 0 or m == 0:
        raise ValueError(f"shapes do not form a system: A {a.shape}, B {b.shape}, C {c.shape}, D {d.shape}")
    if not all(np.isfinite(matrix).all() for matrix in given):
        raise ValueError("A, B, C and D must have finite entries")
    return System(a, b, c, d)


def _static(D: FloatMatrix, width: float) -> Enclosure:
    """Return the largest absolute row sum of D (p, m), rounded outward."""
    with ctx.workprec(128):
        sums = [sum((abs(arb(value)) for value in row), arb(0)) for row in D.tolist()]
        return _enclosure(sums, sums, Counters(), 128, width)


def _enclosure(lowers: list[arb], uppers: list[arb], counters: Counters, bits: int, width: float) -> Enclosure:
    """Return the largest of the row sums enclosed by the balls, as floats rounded outward."""
    lower = max(0.0, *(float_below(value) for value in lowers))
    upper = max(float_above(value) for value in uppers)
    if upper == math.inf:
        raise OverflowError("the L1 norm exceeds the float64 range")
    converged = upper - lower <= width * upper
    return Enclosure(lower, upper, converged, counters.sign_changes, counters.segments, bits)


@dataclass
class _NormSearch:
    """Adaptive repetition at growing precision and shrinking tolerance until the width is reached."""

    system: System
    width: float
    work_limit: int
    counters: Counters = field(default_factory=Counters)
    best: Enclosure | None = None

    def run(self) -> Enclosure:
        """Return the first enclosure narrow enough, or the intersection of all when the work limit is hit."""
        bits = _FIRST_BITS
        tightening = 1.0
        attempts = 0
        while attempts < _ATTEMPTS and bits <= _PRECISION_LIMIT:
            with ctx.workprec(bits):
                needed = self._attempt(bits, tightening)
            if needed > bits:
                bits = needed
                continue
            if self.best is not None and (self.best.converged or self.counters.segments >= self.work_limit):
                return self.best
            attempts += 1
            tightening *= _TIGHTENING
            bits += bits // 2  # in case rounding, not a tolerance, kept the enclosure wide
        if self.best is None:
            raise ArithmeticError(f"the L1 norm needs {bits} bits of precision, more than the limit of {_PRECISION_LIMIT}")
        return self.best

    def _attempt(self, bits: int, tightening: float) -> int:
        """Integrate all channels and record the enclosure; return the bits needed if these are too few."""
        model = build_model(self.system)
        if model is None:
            return 2 * bits
        scale = norm_lower_bound(model)
        if not scale > 0:
            if _identically_zero(self.system):
                self.best = _static(self.system.D, self.width)
                return bits
            return 2 * bits
        budget = scale * self.width * tightening
        needed = needed_bits(model, budget)
        if needed > bits:
            return needed
        lowers, uppers = integrate(model, budget, self.counters, self.work_limit)
        found = _enclosure(lowers, uppers, self.counters, bits, self.width)
        self.best = found if self.best is None else _intersection(self.best, found, self.width)
        return bits


def _intersection(first: Enclosure, second: Enclosure, width: float) -> Enclosure:
    """Return the common part of two enclosures of the same number, with the later one's counts."""
    lower, upper = max(first.lower, second.lower), min(first.upper, second.upper)
    converged = upper - lower <= width * upper
    return Enclosure(lower, upper, converged, second.sign_changes, second.segments, second.precision_bits)


def _identically_zero(system: System) -> bool:
    """Say whether D = 0 and every Markov parameter C A^j B vanishes, exactly, over the rationals."""
    if system.D.any():
        return False

    def exact(matrix: FloatMatrix) -> fmpq_mat:
        entries = [fmpq(*value.as_integer_ratio()) for value in matrix.ravel().tolist()]
        return fmpq_mat(matrix.shape[0], matrix.shape[1], entries)

    A, columns, C = exact(system.A), exact(system.B), exact(system.C)
    for _ in range(system.order):
        if any(entry != 0 for entry in (C * columns).entries()):
            return False
        columns = A * columns
    return True
