"""What the integration needs to know of a system at one working precision, and the tolerances it aims at."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import arb, arb_mat, ctx

from barbalat.linear.l1_norms.decay import DecayCertificate, FloatMatrix, decay_certificate, eigenvalues, euclidean_norm, scaled
from barbalat.linear.l1_norms.modal import SlowOscillation, slow_oscillation
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, remainder_constant

# Bits kept below the requested width for rounding, summed over all segments.
_GUARD_BITS = 40
# Longest segment, in units of 1/(slowest eigenvalue): a handful of them reaches the tail, and the noise of
# fast modes that the Taylor coefficients magnify grows with the power POLYNOMIAL_DEGREE + 1 of it.
LONGEST_STEP = 4.0
# Shares of the width given to Taylor remainders, the tail, and unresolved signs: 1/8 each, so that the sum
# and the final rounding to floats stay below one half even though the scale is only known from below.
_TRUNCATION_SHARE = 0.125


@dataclass(frozen=True)
class System:
    """The float64 matrices as given: A (n, n), B (n, m), C (p, n), D (p, m)."""

    A: FloatMatrix
    B: FloatMatrix
    C: FloatMatrix
    D: FloatMatrix

    @property
    def order(self) -> int:
        """Number of states n."""
        return int(self.A.shape[0])


@dataclass(frozen=True)
class NormModel:
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
    taylor: list[arb_mat]  # for each row c of C: rows c A^j / j!, j = 0 .. POLYNOMIAL_DEGREE
    remainder: arb_mat  # factor of P times A^(POLYNOMIAL_DEGREE + 1)


def build_model(system: System) -> NormModel | None:
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
    # The radii of repeated products grow with the powers of |A|, the products only with those of A: twice the
    # digits keep the difference out of sight.
    with ctx.workprec(2 * ctx.prec):
        powers = [C]
        for order in range(1, POLYNOMIAL_DEGREE + 1):
            powers.append(powers[-1] * A * (arb(1) / order))
        high_power = certificate.factor
        for _ in range(POLYNOMIAL_DEGREE + 1):
            high_power = high_power * A
    tables = [power.tolist() for power in powers]
    return NormModel(
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
        high_power,
    )


def norm_lower_bound(model: NormModel) -> arb:
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


def needed_bits(model: NormModel, budget: arb) -> int:
    """Return the precision at which rounding stays below the budget and fast modes below notice."""
    # Rounding of the state is relative to its entries, whose contributions may cancel in the norm: a box of
    # their size has the norm without the cancellation.
    boxes = [
        arb_mat(model.B.nrows(), 1, [arb(0, abs(entry).upper()) for entry in column(model.B, j).entries()])
        for j in range(model.B.ncols())
    ]
    rounding = max(log2_above(model.certificate.tail(model.certificate.norm(box))) for box in boxes)
    # Rounding also re-excites fast modes that have died out, which then hold the segments short through the
    # Taylor remainder: over the longest segment it must not notice them.
    longest = arb(LONGEST_STEP / model.slowest)
    constant = longest * remainder_constant(longest)
    stiffness = max(log2_above(constant * euclidean_norm(model.remainder * box)) for box in boxes)
    bits = max(rounding, stiffness) - log2_above(budget) + _GUARD_BITS
    # Whole multiples of a limb (64 bits) cost the same as the bits below them.
    return 64 * math.ceil(bits / 64.0)


@dataclass(frozen=True)
class Tolerances:
    """Steering values: bounds aimed at for one input, never part of a proof."""

    remainder_rate: arb  # Taylor remainder per unit of time
    tail: arb
    piece: arb  # unresolved sign of one piece
    horizon: float  # time until the tail is met


def tolerances(model: NormModel, start: arb_mat, budget: arb) -> Tolerances:
    """Return the tolerances of one of the inputs, whose state starts at the column `start` (n, 1)."""
    share = budget * _TRUNCATION_SHARE / model.B.ncols()
    rate = 0.5 * model.decay
    initial = log2_above(model.certificate.tail(model.certificate.norm(start)))
    horizon = max(1.0, (initial - log2_above(share)) * math.log(2.0)) / rate
    # Sign changes expected until the horizon, with as many again for pieces split for other reasons.
    pieces = 64.0 + 2.0 * horizon * model.frequency / math.pi
    return Tolerances(share / horizon, share, share / pieces, horizon)


def log2_above(value: arb) -> float:
    """Return about log2 of the upper end of a ball, -inf if that is not positive; to steer with only."""
    return float(value.upper().log()) / math.log(2.0) if value.upper() > 0 else -math.inf


def column(matrix: arb_mat, index: int) -> arb_mat:
    """Return one column (n, 1) of a matrix (n, m)."""
    return arb_mat(matrix.nrows(), 1, [matrix[i, index] for i in range(matrix.nrows())])
