"""Guaranteed enclosure of the L1 norm (induced L-infinity norm) of a stable continuous-time system.

The impulse response is marched in Taylor segments whose sign is proved with Bernstein coefficients; see
NOTES.md for the proof that every source of error is bounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from math import comb

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx
from numpy.typing import ArrayLike

from barbalat.certify.enclosure import (
    DecayCertificate,
    Enclosure,
    FloatMatrix,
    decay_certificate,
    eigenvalues,
    euclidean_norm,
    float_above,
    float_below,
    require_hurwitz,
    scaled,
)
from barbalat.certify.modal import SlowOscillation, slow_oscillation

# Taylor degree of a segment. At degree d the remainder reaches 1e-12 for frequency * step = (1e-12 d!)^(1/d),
# 3 rad at d = 24: about one sign change a segment, which one set of Bernstein coefficients still resolves.
_DEGREE = 24
# Bits of (_DEGREE + 1)!, by which Taylor's remainder shrinks the noise of fast modes.
_FACTORIAL_BITS = 83
# Bits kept below the requested width for rounding, summed over all segments.
_GUARD_BITS = 40
# Precision limit: time scales 2^150 = 1e45 apart and as much cancellation fit; beyond it work grows to minutes.
_PRECISION_LIMIT = 4096
# Shares of the width given to Taylor remainders, the tail, and unresolved signs: 1/8 each, so that the sum and
# the final rounding to floats stay below one half even though the scale is only known from below.
_SHARE = 0.125
# Each repeated attempt tightens every share by this factor.
_TIGHTENING = 2.0**-6
_ATTEMPTS = 4
# A piece halved this often is shorter than rounding of its ends; its unresolved sign is then simply charged.
_HALVINGS_LIMIT = 64
_NEWTON_STEPS = 8
# A root this close to an end of a segment (relative) is left to halving, to keep the pieces from degenerating.
_NEAREST_SPLIT = 2.0**-40
# float64 ends differ by two units in the last place (2^-52 each) at best: a narrower width cannot be promised.
_NARROWEST_WIDTH = 1e-15


def l1_norm(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    relative_width: float = 1e-9,
    work_limit: int = 200_000,
) -> Enclosure:
    """Return a guaranteed enclosure of the L1 norm of the system (A, B, C, D), exactly as its float64 entries.

    A is (n, n), B (n, m), C (p, n), D (p, m); n may be 0. The norm is the induced L-infinity norm: the
    largest over outputs i of the sum over inputs j of |D_ij| + integral_0^inf |c_i e^(At) b_j| dt; t in s.
    Once more than `work_limit` segments have been integrated (some 50 us each at small order) the enclosure
    found so far is returned with converged=False; it is still valid.

    Raises ValueError for shapes that do not fit, entries that are not finite, an unusable relative_width or
    work_limit, and an A that is not certainly Hurwitz; OverflowError if the norm exceeds the float64 range.

    Source: Boyd and Barratt, Linear Controller Design (1991), section 5.2.3 (peak gain); Taylor models with
    Bernstein coefficients after Moore, Kearfott and Cloud, Introduction to Interval Analysis (2009).
    """
    system = _checked(A, B, C, D)
    if not _NARROWEST_WIDTH <= relative_width < 1.0:
        raise ValueError(f"relative_width must be in [{_NARROWEST_WIDTH}, 1), got {relative_width}")
    if work_limit < 1:
        raise ValueError(f"work_limit must be at least 1, got {work_limit}")
    if system.order == 0 or not system.B.any() or not system.C.any():
        if system.order:
            require_hurwitz(system.A)
        return _static(system.D, relative_width)
    require_hurwitz(system.A)
    return _Search(system, relative_width, work_limit).run()


@dataclass(frozen=True)
class _System:
    A: FloatMatrix
    B: FloatMatrix
    C: FloatMatrix
    D: FloatMatrix

    @property
    def order(self) -> int:
        return int(self.A.shape[0])


def _checked(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike) -> _System:
    """Return the four matrices as float64, or raise ValueError if they do not form a system."""
    matrices = [np.asarray(matrix, dtype=np.float64) for matrix in (A, B, C, D)]
    if any(matrix.ndim != 2 for matrix in matrices):
        raise ValueError("A, B, C and D must be two-dimensional arrays")
    a, b, c, d = matrices
    n, (p, m) = a.shape[0], d.shape
    if a.shape != (n, n) or b.shape != (n, m) or c.shape != (p, n) or p == 0 or m == 0:
        raise ValueError(f"shapes do not form a system: A {a.shape}, B {b.shape}, C {c.shape}, D {d.shape}")
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        raise ValueError("A, B, C and D must have finite entries")
    return _System(a, b, c, d)


def _static(D: FloatMatrix, width: float) -> Enclosure:
    """Return the largest absolute row sum of D (p, m), rounded outward."""
    with ctx.workprec(128):
        sums = [sum((abs(arb(value)) for value in row), arb(0)) for row in D.tolist()]
        return _enclosure(sums, sums, _Counters(), 128, width)


def _enclosure(
    lowers: list[arb], uppers: list[arb], counters: _Counters, bits: int, width: float
) -> Enclosure:
    """Return the largest of the row sums enclosed by the balls, as floats rounded outward."""
    lower = max(0.0, *(float_below(value) for value in lowers))
    upper = max(float_above(value) for value in uppers)
    if upper == math.inf:
        raise OverflowError("the L1 norm exceeds the float64 range")
    converged = upper - lower <= width * upper
    return Enclosure(lower, upper, converged, counters.sign_changes, counters.segments, bits)


@dataclass
class _Counters:
    """Work done so far, over all channels and attempts."""

    segments: int = 0
    sign_changes: int = 0


@dataclass(frozen=True)
class _Model:
    """Everything about the system that does not depend on the tolerance, at one working precision.

    States and time are rescaled (`scaled`), so times are in its unit, not in seconds.
    """

    A: arb_mat
    B: arb_mat
    C: arb_mat
    feedthrough: list[list[arb]]  # |D|, rows by columns
    certificate: DecayCertificate
    oscillation: SlowOscillation | None
    decay: float  # smallest |real part|
    fastest: float  # largest |eigenvalue|
    slowest: float  # smallest |eigenvalue|
    frequency: float  # largest imaginary part
    taylor: list[arb_mat]  # for each row c of C: rows c A^j / j!, j = 0 .. _DEGREE
    remainder: arb_mat  # factor of P times A^(_DEGREE + 1)


def _model(system: _System) -> _Model | None:
    """Return the model of the system at the current precision, None if the decay is not certified at it."""
    plant = scaled(system.A, system.B, system.C)
    A, C = plant.A, plant.C
    unit = arb(2) ** -plant.time_exponent
    spectrum = [(root * unit, multiplicity) for root, multiplicity in eigenvalues(system.A)]
    roots = [complex(root.mid()) for root, multiplicity in spectrum for _ in range(multiplicity)]
    decay = min(-root.real for root in roots)
    if not decay > 0.0:
        raise ArithmeticError("the time scales of A span more than the float64 range")
    # Half the slowest decay keeps P well conditioned for defective modes and costs at most twice the horizon.
    certificate = decay_certificate(A, C, roots, 0.5 * decay)
    if certificate is None:
        return None
    powers = [C]
    for order in range(1, _DEGREE + 1):
        powers.append(powers[-1] * A * (arb(1) / order))
    tables = [power.tolist() for power in powers]
    high_power = A
    for _ in range(_DEGREE):
        high_power = high_power * A
    return _Model(
        A,
        plant.B,
        C,
        [[abs(arb(value)) for value in row] for row in system.D.tolist()],
        certificate,
        slow_oscillation(A, C, spectrum),
        decay,
        max(abs(root) for root in roots),
        min(abs(root) for root in roots),
        max(abs(root.imag) for root in roots),
        [arb_mat([table[i] for table in tables]) for i in range(C.nrows())],
        certificate.factor * high_power,
    )


@dataclass(frozen=True)
class _Tolerances:
    """Steering values: bounds aimed at for one input, never part of a proof."""

    remainder_rate: arb  # Taylor remainder per unit of time
    tail: arb
    piece: arb  # unresolved sign of one piece
    horizon: float  # time until the tail is met


@dataclass
class _Search:
    """Adaptive repetition at growing precision and shrinking tolerance until the width is reached."""

    system: _System
    width: float
    work_limit: int
    counters: _Counters = field(default_factory=_Counters)
    best: Enclosure | None = None

    def run(self) -> Enclosure:
        """Return the first enclosure narrow enough, or the intersection of all when the work limit is hit."""
        bits = 128
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
        if self.best is None:
            raise ArithmeticError(
                f"the L1 norm needs {bits} bits of precision, more than the limit of {_PRECISION_LIMIT}"
            )
        return self.best

    def _attempt(self, bits: int, tightening: float) -> int:
        """Integrate all channels and record the enclosure; return the bits needed if these are too few."""
        model = _model(self.system)
        if model is None:
            return 2 * bits
        scale = _norm_lower_bound(model)
        if not scale > 0:
            if _identically_zero(self.system):
                self.best = _static(self.system.D, self.width)
                return bits
            return 2 * bits
        budget = scale * self.width * tightening
        needed = _needed_bits(model, budget)
        if needed > bits:
            return needed
        lowers, uppers = _integrate(model, budget, self.counters, self.work_limit)
        found = _enclosure(lowers, uppers, self.counters, bits, self.width)
        self.best = found if self.best is None else _intersection(self.best, found, self.width)
        return bits


def _intersection(first: Enclosure, second: Enclosure, width: float) -> Enclosure:
    """Return the common part of two enclosures of the same number, with the later one's counts."""
    lower, upper = max(first.lower, second.lower), min(first.upper, second.upper)
    converged = upper - lower <= width * upper
    return Enclosure(lower, upper, converged, second.sign_changes, second.segments, second.precision_bits)


def _identically_zero(system: _System) -> bool:
    """Say whether D = 0 and every Markov parameter C A^j B vanishes, exactly, over the rationals."""
    from flint import fmpq, fmpq_mat

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


def _norm_lower_bound(model: _Model) -> arb:
    """Return a rigorous lower bound of the norm: the largest row sum of step-response variations.

    The step response of a channel changes by at most the integral of |h| between any two instants, here
    the octaves from the fastest to the slowest time scale. It only sets the tolerances.
    """
    first = math.floor(-math.log2(model.fastest)) - 1
    last = math.ceil(-math.log2(model.decay)) + 2
    try:
        gain = model.A.transpose().solve(model.C.transpose()).transpose()
    except ZeroDivisionError:  # singular at this precision only, A being Hurwitz
        return arb(0)
    transition = (model.A * arb(2) ** first).exp()
    previous = (gain * model.B).entries()
    totals = [arb(0)] * len(previous)
    for _ in range(first, last + 1):
        current = (gain * transition * model.B).entries()
        totals = [t + abs(now - old) for t, now, old in zip(totals, current, previous, strict=True)]
        previous = current
        transition = transition * transition
    columns = model.B.ncols()
    sums = [
        sum((t.abs_lower() for t in totals[i * columns : (i + 1) * columns]), sum(row, arb(0)))
        for i, row in enumerate(model.feedthrough)
    ]
    return max(sums, key=lambda value: float(value.log()) if value > 0 else -math.inf).lower()


def _needed_bits(model: _Model, budget: arb) -> int:
    """Return the precision at which rounding stays below the budget and fast modes below notice."""
    columns = [_column(model.B, j) for j in range(model.B.ncols())]
    largest = max(_log2(model.certificate.tail(model.certificate.norm(column))) for column in columns)
    rounding = largest - _log2(budget) + _GUARD_BITS
    # Rounding re-excites modes that have died out; the Taylor remainder magnifies them by
    # (fastest * step)^(_DEGREE + 1) / (_DEGREE + 1)!, with steps up to about 4/slowest.
    ratio = math.log2(model.fastest) - math.log2(model.slowest) + 2.0
    stiffness = max(0.0, (_DEGREE + 1) * ratio - _FACTORIAL_BITS)
    # Whole multiples of a limb (64 bits) cost the same as the bits below them.
    return 64 * math.ceil((rounding + stiffness) / 64.0)


def _log2(value: arb) -> float:
    return float(value.upper().log()) / math.log(2.0) if value.upper() > 0 else -math.inf


def _column(matrix: arb_mat, index: int) -> arb_mat:
    return arb_mat(matrix.nrows(), 1, [matrix[i, index] for i in range(matrix.nrows())])


def _tolerances(model: _Model, start: arb_mat, budget: arb) -> _Tolerances:
    """Return the tolerances of one of the inputs, whose state starts at the column `start` (n, 1)."""
    share = budget * _SHARE / model.B.ncols()
    rate = 0.5 * model.decay
    initial = _log2(model.certificate.tail(model.certificate.norm(start)))
    horizon = max(1.0, (initial - _log2(share)) * math.log(2.0)) / rate
    # Sign changes expected until the horizon, with as many again for pieces split for other reasons.
    pieces = 64.0 + 2.0 * horizon * model.frequency / math.pi
    return _Tolerances(share / horizon, share, share / pieces, horizon)


def _integrate(
    model: _Model, budget: arb, counters: _Counters, work_limit: int
) -> tuple[list[arb], list[arb]]:
    """Return lower and upper bounds (as balls) of each output row's sum over inputs of |D| + integral |h|."""
    ladder = _Ladder(model)
    lowers = [sum(row, arb(0)) for row in model.feedthrough]
    uppers = list(lowers)
    for j in range(model.B.ncols()):
        start = _column(model.B, j)
        if all(entry == 0 for entry in start.entries()):
            continue
        march = _March(model, ladder, _tolerances(model, start, budget), counters, work_limit)
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
    remainder: arb  # bound on the integrated Taylor remainder, per unit of norm(A^(_DEGREE + 1) x)
    error_growth: arb  # sqrt(length): integral of |c e^(As) e| over the segment, per unit of norm(e)
    monomial: list[arb_mat]  # per row: state to Taylor coefficients in the segment's own time 0 .. 1
    bernstein: list[arb_mat]  # per row: state to Bernstein coefficients


class _Ladder:
    """Segment lengths that are powers of two, their constants computed when first used."""

    def __init__(self, model: _Model) -> None:
        self.model = model
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
            self._transitions[exponent] = (
                (self.model.A * arb(2) ** exponent).exp() if shorter is None else shorter * shorter
            )
        return self._transitions[exponent]

    def _build(self, exponent: int) -> _Rung:
        length = arb(2) ** exponent
        scales = [length**k for k in range(_DEGREE + 1)]
        monomial = []
        for table in self.model.taylor:
            rows = table.tolist()
            monomial.append(arb_mat([[entry * scales[k] for entry in rows[k]] for k in range(_DEGREE + 1)]))
        change = _bernstein_matrix(ctx.prec)
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


def remainder_constant(length: arb) -> arb:
    """Return K with |h - Taylor polynomial| averaging at most K norm(A^(d+1) x) over [0, length], d = _DEGREE.

    The remainder integral_0^s (s-u)^d/d! c A^(d+1) e^(Au) x du is at most, by Cauchy-Schwarz and the
    certificate, s^(d+1/2)/(d! sqrt(2d+1)) norm(A^(d+1) x); its mean over the segment divides by d + 3/2.
    """
    degree = arb(_DEGREE)
    power = length**_DEGREE * length.sqrt()
    return power / (arb(math.factorial(_DEGREE)) * (2 * degree + 1).sqrt() * (degree + arb(1.5)))


@lru_cache(maxsize=8)
def _bernstein_matrix(bits: int) -> arb_mat:
    """Return the matrix from Taylor to Bernstein coefficients of degree _DEGREE on [0, 1], at `bits` bits.

    b_i = sum over k <= i of binomial(i, k)/binomial(d, k) a_k (Farouki, The Bernstein polynomial basis, 2012).
    """
    size = _DEGREE + 1
    with ctx.workprec(bits):
        inverses = [1 / arb(comb(_DEGREE, k)) for k in range(size)]
        return arb_mat([[inverses[k] * comb(i, k) for k in range(size)] for i in range(size)])


@dataclass
class _March:
    """Integration of |h| for one input and all outputs, from t = 0 to where the tail is negligible."""

    model: _Model
    ladder: _Ladder
    tolerances: _Tolerances
    counters: _Counters
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
        # The state is an exact vector plus an error known only by its norm, which the flow contracts; a box
        # around the vector would grow with every turn of the state instead (the wrapping effect).
        state = start.mid()
        error = certificate.norm(start - state).upper()
        exponent = self._first_exponent(state)
        top = math.ceil(math.log2(self.tolerances.horizon))
        while not self._finish(state, error):
            rung, local = self._step(state, min(exponent + 1, top))
            exponent = rung.exponent
            local += rung.error_growth * error
            for i in range(rows):
                self._segment(rung, i, state, local)
            self.error += local
            moved = rung.transition * state
            state = moved.mid()
            error = (rung.contraction * error + certificate.norm(moved - state)).upper()

    def _finish(self, state: arb_mat, error: arb) -> bool:
        """Close the integral with a bound on the rest if that is small enough or the work limit is hit."""
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
        """Return the exponent of the longest first segment that the remainder allows, less the usual rise."""
        # remainder rate: K(1) s^(d + 1/2) norm <= tolerance
        excess = _log2(remainder_constant(arb(1)) * self._remainder_norm(state))
        if excess == -math.inf:
            return math.ceil(math.log2(self.tolerances.horizon)) - 1
        exponent = (_log2(self.tolerances.remainder_rate) - excess) / (_DEGREE + 0.5)
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

    def _segment(self, rung: _Rung, row: int, state: arb_mat, error: arb) -> None:
        """Add the integral of |c x(s)| over one segment for one row c of C, exact up to `error`."""
        piece = _Piece((rung.bernstein[row] * state).entries())
        tolerance = self.tolerances.piece / rung.length
        pieces = [piece]
        if not piece.gap <= tolerance:
            pieces = _resolved(arb_poly((rung.monomial[row] * state).entries()), piece, tolerance)
        self.counters.segments += len(pieces)
        for piece in pieces:
            total = piece.total * rung.length
            self.integrals[row] += abs(total)
            self.gaps[row] += piece.gap * rung.length
            sign = int(total > error) - int(total < -error)  # 0 while the sign of h itself is not certain
            self.counters.sign_changes += sign * self.signs[row] < 0
            self.signs[row] = sign or self.signs[row]


class _Piece:
    """Polynomial on [0, 1] by its Bernstein coefficients: |total| <= integral |p| <= |total| + gap.

    The mean of the coefficients is the integral; min(negative, positive part) of p is at most the same part
    of its coefficients, as the Bernstein polynomials are nonnegative, and 2 min(...) is the gap.
    """

    __slots__ = ("coefficients", "gap", "total")

    def __init__(self, coefficients: list[arb]) -> None:
        self.coefficients = coefficients
        self.total: arb = sum(coefficients, arb(0)) / len(coefficients)
        negative = [-value for value in coefficients if not value >= 0]
        positive = [value for value in coefficients if not value <= 0]
        self.gap: arb = arb(0)
        if negative and positive:
            below = sum((value.upper() for value in negative), arb(0))
            above = sum((value.upper() for value in positive), arb(0))
            self.gap = 2 * min(below, above) / len(coefficients)

    def sign_variations(self) -> tuple[int, float]:
        """Return the number of sign variations and where the first lies on the control polygon, in [0, 1]."""
        values = [float(value) for value in self.coefficients]
        scale = max(abs(value) for value in values)
        variations, place, last = 0, 0.5, 0
        for i, value in enumerate(values):
            if abs(value) <= 2.0**-52 * scale:  # noise of the float image
                continue
            if values[last] * value < 0.0:
                variations += 1
                if variations == 1:
                    before = abs(values[last])
                    place = (last + (i - last) * before / (before + abs(value))) / (len(values) - 1)
            last = i
        return variations, place


def _resolved(polynomial: arb_poly, piece: _Piece, tolerance: arb) -> list[_Piece]:
    """Return pieces, in order of time, whose gaps are within the tolerance (or cannot be halved further).

    A child on [u, v] is p(u + (v - u) s) (v - u), so that integrals over [0, 1] of the children add up.
    """
    pending = [(polynomial, piece, 0)]
    done: list[_Piece] = []
    while pending:
        polynomial, piece, halvings = pending.pop()
        if piece.gap <= tolerance or halvings >= _HALVINGS_LIMIT:
            done.append(piece)
            continue
        split = _split_point(polynomial, piece)
        for start, length in ((split, 1 - split), (arb(0), split)):
            child = polynomial(arb_poly([start, length])) * length
            coefficients = child.coeffs()
            coefficients += [arb(0)] * (_DEGREE + 1 - len(coefficients))
            column = arb_mat(_DEGREE + 1, 1, coefficients)
            values = (_bernstein_matrix(ctx.prec) * column).entries()
            pending.append((child, _Piece(values), halvings + 1))
    return done


def _split_point(polynomial: arb_poly, piece: _Piece) -> arb:
    """Return an exact point of (0, 1): close to the only root if there is one, else the middle."""
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
        if not (point > _NEAREST_SPLIT and point < 1 - _NEAREST_SPLIT):
            return middle
        if abs(correction) < _NEAREST_SPLIT:  # the next error is its square, beyond float64
            return point
    return middle
