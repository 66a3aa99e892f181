"""Guaranteed enclosure of the L1 norm (induced L-infinity norm) of a stable continuous-time system.

The impulse response is followed in Taylor segments, whose signs are proved with Bernstein coefficients. docs/l1-norms.md proves
that every source of error is bounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx, fmpq, fmpq_mat
from numpy.typing import ArrayLike

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.linear.enclosure import Enclosure, float_above, float_below
from barbalat.linear.l1_norms.decay import FloatMatrix, euclidean_norm, require_hurwitz
from barbalat.linear.l1_norms.model import (
    LONGEST_STEP,
    NormModel,
    System,
    Tolerances,
    build_model,
    column,
    log2_above,
    needed_bits,
    norm_lower_bound,
    tolerances,
)
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, BernsteinPiece, bernstein_matrix, remainder_constant, resolved
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.validate import Array, InputError


@dataclass
class Counters:
    """Work done so far, over all channels and attempts."""

    segments: int = 0
    sign_changes: int = 0


def integrate(model: NormModel, budget: arb, counters: Counters, work_limit: int) -> tuple[list[arb], list[arb]]:
    """Return lower and upper bounds (as balls) on the sum over inputs of |D| + integral |h| for each output row."""
    ladder = _Ladder(model)
    lowers = [sum(row, arb(0)) for row in model.feedthrough]
    uppers = list(lowers)
    for j in range(model.B.ncols()):
        start = column(model.B, j)
        if all(entry == 0 for entry in start.entries()):
            continue
        march = _March(model, ladder, tolerances(model, start, budget), counters, work_limit)
        march.run(start)
        for i, (value, gap) in enumerate(zip(march.integrals, march.gaps, strict=True)):
            lowers[i] += value - march.error
            uppers[i] += value + gap + march.error + march.tail
    return lowers, uppers


@dataclass(frozen=True)
class _Rung:
    """Constants of segments of length 2^exponent."""

    exponent: int
    length: arb
    transition: arb_mat  # e^(A length)
    contraction: arb  # e^(-rate length)
    remainder: arb  # bound on the integrated Taylor remainder, per unit of norm(A^(POLYNOMIAL_DEGREE + 1) x)
    error_growth: arb  # sqrt(length): integral of |c e^(As) e| over the segment, per unit of norm(e)
    monomial: list[arb_mat]  # for each row, the map from the state to the Taylor coefficients in segment time, 0 .. 1
    bernstein: list[arb_mat]  # for each row, the map from the state to the Bernstein coefficients


class _Ladder:
    """Segment lengths that are powers of two; their constants are computed when first used."""

    def __init__(self, model: NormModel) -> None:
        self.model = model
        self._taylor = [table.tolist() for table in model.taylor]
        self._rungs: dict[int, _Rung] = {}
        self._transitions: dict[int, arb_mat] = {}

    def rung(self, exponent: int) -> _Rung:
        """Return the constants of length 2^exponent."""
        if exponent not in self._rungs:
            self._rungs[exponent] = self._build(exponent)
        return self._rungs[exponent]

    def _transition(self, exponent: int) -> arb_mat:
        if exponent not in self._transitions:
            shorter = self._transitions.get(exponent - 1)
            self._transitions[exponent] = (self.model.A * arb(2) ** exponent).exp() if shorter is None else shorter * shorter
        return self._transitions[exponent]

    def _build(self, exponent: int) -> _Rung:
        length = arb(2) ** exponent
        scales = [length**k for k in range(POLYNOMIAL_DEGREE + 1)]
        monomial = [
            arb_mat([[entry * scale for entry in row] for row, scale in zip(rows, scales, strict=True)]) for rows in self._taylor
        ]
        change = bernstein_matrix(ctx.prec)
        return _Rung(
            exponent,
            length,
            self._transition(exponent),
            (-self.model.certificate.rate * length).exp(),
            length * remainder_constant(length),
            length.sqrt(),
            monomial,
            [change * table for table in monomial],
        )


@dataclass
class _March:
    """Integration of |h| for one input and all outputs, from t = 0 to where the tail is negligible."""

    model: NormModel
    ladder: _Ladder
    tolerances: Tolerances
    counters: Counters
    work_limit: int
    integrals: list[arb] = field(default_factory=list)
    gaps: list[arb] = field(default_factory=list)
    signs: list[int] = field(default_factory=list)
    error: arb = field(default_factory=lambda: arb(0))
    tail: arb = field(default_factory=lambda: arb(0))

    def run(self, start: arb_mat) -> None:
        """Integrate from the state `start` (n, 1).

        For each row, -error <= exact - integral <= gap + error + tail.
        """
        rows = self.model.C.nrows()
        self.integrals = [arb(0)] * rows
        self.gaps = [arb(0)] * rows
        self.signs = [0] * rows
        certificate = self.model.certificate
        # The state is an exact vector plus an error with a known norm, which the flow contracts. A box around
        # the vector would instead grow with every turn of the state (the wrapping effect).
        state = start.mid()
        error = certificate.norm(start - state).upper()
        exponent = self._first_exponent(state)
        top = math.floor(math.log2(min(self.tolerances.horizon, LONGEST_STEP / self.model.slowest)))
        while not self._finish(state, error):
            rung, local = self._step(state, min(exponent + 1, top))
            exponent = rung.exponent
            local += rung.error_growth * error
            tolerance = self.tolerances.piece / rung.length
            for i in range(rows):
                self._segment(rung, i, state, local, tolerance)
            self.error += local
            moved = rung.transition * state
            state = moved.mid()
            error = (rung.contraction * error + certificate.norm(moved - state)).upper()

    def _finish(self, state: arb_mat, error: arb) -> bool:
        """Complete the integral with a bound on the rest if this is small enough or the work limit is reached."""
        certificate, oscillation = self.model.certificate, self.model.oscillation
        stray = certificate.tail(error)
        if oscillation is not None:
            rest = oscillation.remainder_tail(state) + stray
            if rest <= self.tolerances.tail:
                self.error += rest  # the rest may cancel the oscillation as well as add to it
                found = oscillation.absolute_integrals(self.model.C, state)
                self.integrals = [a + b for a, b in zip(self.integrals, found, strict=True)]
                return True
        tail = certificate.tail(certificate.norm(state)) + stray
        if tail <= self.tolerances.tail or self.counters.segments >= self.work_limit:
            self.tail = tail
            return True
        return False

    def _remainder_norm(self, state: arb_mat) -> arb:
        return euclidean_norm(self.model.remainder * state)

    def _first_exponent(self, state: arb_mat) -> int:
        """Return the exponent of the longest first segment that the remainder allows, minus the usual increase."""
        # remainder rate: K(1) s^(d + 1/2) norm <= tolerance
        excess = log2_above(remainder_constant(arb(1)) * self._remainder_norm(state))
        if excess == -math.inf:
            return math.ceil(math.log2(self.tolerances.horizon)) - 1
        exponent = (log2_above(self.tolerances.remainder_rate) - excess) / (POLYNOMIAL_DEGREE + 0.5)
        return math.floor(exponent) - 1

    def _step(self, state: arb_mat, exponent: int) -> tuple[_Rung, arb]:
        """Return the longest segment up to 2^exponent whose remainder is tolerable, with the remainder."""
        norm = self._remainder_norm(state)
        while True:
            rung = self.ladder.rung(exponent)
            remainder = rung.remainder * norm
            if remainder <= self.tolerances.remainder_rate * rung.length:
                return rung, remainder
            exponent -= 1

    def _segment(self, rung: _Rung, row: int, state: arb_mat, error: arb, tolerance: arb) -> None:
        """Add the integral of |c x(s)| over one segment for one row c of C, exact up to `error`."""
        piece = BernsteinPiece((rung.bernstein[row] * state).entries())
        pieces = [piece]
        if not piece.gap <= tolerance:
            room = self.work_limit - self.counters.segments
            pieces = resolved(arb_poly((rung.monomial[row] * state).entries()), piece, tolerance, room)
        self.counters.segments += len(pieces)
        for piece in pieces:
            total = piece.total * rung.length
            self.integrals[row] += abs(total)
            self.gaps[row] += piece.gap * rung.length
            sign = int(total > error) - int(total < -error)  # 0 while the sign of h itself is not certain
            self.counters.sign_changes += sign * self.signs[row] < 0
            self.signs[row] = sign or self.signs[row]


# Working precision of the first attempt: two limbs (128 bits) are sufficient for the default width of a benign system.
_FIRST_BITS = 128
# Precision limit: it covers time scales 2^150 = 1e45 apart and as much cancellation; beyond it the work takes minutes.
_PRECISION_LIMIT = 4096
# Each repeated attempt tightens every tolerance by this factor.
_TIGHTENING = 2.0**-6
_ATTEMPTS = 4
# The ends differ by at least two units in the last place (2^-52 each), so no narrower width can be guaranteed.
_NARROWEST_WIDTH = 1e-15


def of_norm(states: float) -> Estimate:
    """The cost of an L1 norm: half a second and about 10 MB for 100 states."""
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

    Instead of the four matrices, one system may be given: a TransferFunction, a StateSpace, or a system of python-control (a
    state space of any size).

    A is (n, n), B (n, m), C (p, n), D (p, m); n may be 0. The norm is the induced L-infinity norm: the largest over outputs i of
    the sum over inputs j of |D_ij| + integral_0^inf |c_i e^(At) b_j| dt; t in s. Once more than `work_limit` segments have been
    integrated (about 50 us each at small order), the enclosure found so far is returned with converged=False; it is still valid.

    Raises ValueError for shapes that do not fit, entries that are not finite, an unusable relative_width or work_limit, and an A
    that is not certainly Hurwitz. Raises OverflowError if the norm exceeds the float64 range, ArithmeticError if its time scales
    or cancellations need more than 4096 bits, and InputError for a system beyond the budget.

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
        "the system of an L1 norm", system.order, of_norm, given=f"has {validate.counted(system.order, 'state')} and",
        fits=lambda most: f"at most {validate.counted(most, 'state')}", what=f"an L1 norm of "
        f"{validate.counted(system.order, 'state')}",
    )  # fmt: skip
    return enclosed(tuple((matrix.shape, matrix.tobytes()) for matrix in system.matrices), relative_width, work_limit)


@lru_cache(maxsize=4096)
def _rows(matrices: tuple[tuple[tuple[int, ...], bytes], ...], width: float, work_limit: int) -> tuple[tuple[float, ...], int]:
    system = System(*(np.frombuffer(data).reshape(shape) for shape, data in matrices))
    require_hurwitz(system.A)
    search = _NormSearch(system, width, work_limit)
    search.run()
    return search.rows, search.counters.segments


def row_norms(
    A: Array, B: Array, C: Array, D: Array, *, relative_width: float = 1e-9, work_limit: int = 20_000
) -> tuple[tuple[float, ...], int]:
    """Return an upper bound on the norm of each output, from one integration, and the number of segments; the width is relative
    to the largest norm. Raises the errors of ``l1_norm``.
    """
    system = _checked(A, B, C, D)
    return _rows(tuple((matrix.shape, matrix.tobytes()) for matrix in system.matrices), relative_width, work_limit)


@lru_cache(maxsize=4096)
def enclosed(matrices: tuple[tuple[tuple[int, ...], bytes], ...], width: float, work_limit: int) -> Enclosure:
    """The norm of a system given by the shapes and bytes of A, B, C and D, which makes it cacheable.

    Most norms are needed again, for other entries of a certificate and for other controllers of the same plant.
    """
    system = System(*(np.frombuffer(data).reshape(shape) for shape, data in matrices))
    require_hurwitz(system.A)
    return _NormSearch(system, width, work_limit).run()


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
        raise ValueError(f"the shapes do not form a system: A {a.shape}, B {b.shape}, C {c.shape}, D {d.shape}")
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
    rows: tuple[float, ...] = ()

    def run(self) -> Enclosure:
        """Return the first enclosure that is narrow enough, or the intersection of all if the work limit is reached."""
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
            bits += bits // 2  # in case rounding rather than a tolerance kept the enclosure wide
        if self.best is None:
            raise ArithmeticError(f"the L1 norm needs {bits} bits of precision, more than the limit of {_PRECISION_LIMIT}")
        return self.best

    def _attempt(self, bits: int, tightening: float) -> int:
        """Integrate all channels and record the enclosure; return the required bits if the present ones are too few."""
        model = build_model(self.system)
        if model is None:
            return 2 * bits
        scale = norm_lower_bound(model)
        if not scale > 0:
            if _identically_zero(self.system):
                self.best, self.rows = _static(self.system.D, self.width), (0.0,) * len(self.system.D)
                return bits
            return 2 * bits
        budget = scale * self.width * tightening
        needed = needed_bits(model, budget)
        if needed > bits:
            return needed
        lowers, uppers = integrate(model, budget, self.counters, self.work_limit)
        found = _enclosure(lowers, uppers, self.counters, bits, self.width)
        self.rows = tuple(float_above(value) for value in uppers)
        self.best = found if self.best is None else _intersection(self.best, found, self.width)
        return bits


def _intersection(first: Enclosure, second: Enclosure, width: float) -> Enclosure:
    """Return the common part of two enclosures of the same number, with the later one's counts."""
    lower, upper = max(first.lower, second.lower), min(first.upper, second.upper)
    converged = upper - lower <= width * upper
    return Enclosure(lower, upper, converged, second.sign_changes, second.segments, second.precision_bits)


def _identically_zero(system: System) -> bool:
    """Whether D = 0 and every Markov parameter C A^j B vanishes exactly, over the rationals."""
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


def matrices(system: Any) -> tuple[Array, Array, Array, Array]:
    """A (n, n), B (n, m), C (p, n), D (p, m) of a system of this package, or of a continuous-time system of python-control. A
    state space is used unchanged, with any number of inputs and outputs. A transfer function has one of each; it is realised with
    coefficients divided by the leading coefficient of the denominator and rounded to floats.
    """
    if all(hasattr(system, name) for name in ("A", "B", "C", "D", "dt")):  # a state space of python-control
        if system.dt not in (0, None):
            raise InputError(f"the system must be a continuous-time one, got one with the sample time {system.dt}")
        return tuple(np.asarray(getattr(system, name), dtype=float) for name in "ABCD")  # type: ignore[return-value]
    if not isinstance(system, (StateSpace, TransferFunction)) and not hasattr(system, "ninputs"):
        raise InputError(
            "l1_norm takes the matrices A, B, C and D, or one TransferFunction, StateSpace or python-control system, "
            f"got {validate.show(system)}"
        )
    found = StateSpace.accept("the system", system)
    return found.A, found.B[:, None], found.C[None, :], np.array([[found.D]])
