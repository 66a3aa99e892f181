"""The numbers of a system that the integration needs at one working precision, its slowest oscillation and its tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from flint import acb, acb_mat, arb, arb_mat, ctx

from barbalat.linear.l1_norms.decay import (
    DecayCertificate,
    FloatMatrix,
    decay_certificate,
    eigenvalues,
    euclidean_norm,
    identity,
    scaled,
)
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, remainder_constant

# Stepping through time takes about one segment per sign change; the closed form costs about as much as this many segments.
_WORTHWHILE_SIGN_CHANGES = 12.0
# Number of time constants until an oscillation has decayed below a tolerance of about 1e-9: ln(1e10).
_TIME_CONSTANTS = 23.0


@dataclass(frozen=True)
class SlowOscillation:
    """The simple complex pair eigenvalue, conj(eigenvalue) that decays more slowly than every other mode.

    `projector` (n, n) is the complex spectral projector on the eigenvalue with positive imaginary part; `complement` is I - 2
    Re(projector), the projector on all other modes. `remainder` bounds the motion of the other modes, None if there are no other
    modes (n = 2).
    """

    eigenvalue: acb
    projector: acb_mat
    complement: arb_mat
    remainder: DecayCertificate | None

    def remainder_tail(self, x: arb_mat) -> arb:
        """Return a bound on integral_0^inf |c e^(As) y| ds, y the part of x (n, 1) in the other modes."""
        if self.remainder is None:
            return arb(0)
        return self.remainder.tail(self.remainder.norm(self.complement * x))

    def absolute_integrals(self, C: arb_mat, x: arb_mat) -> list[arb]:
        """Return integral_0^inf |c e^(As) y| ds of each row c of C (p, n), y the part of x in the pair."""
        amplitudes = acb_mat(C) * (self.projector * acb_mat(x))
        return [_oscillation_integral(2 * value, self.eigenvalue) for value in amplitudes.entries()]


def slow_oscillation(A: arb_mat, C: arb_mat, spectrum: list[tuple[acb, int]]) -> SlowOscillation | None:
    """Return the slowest pair of A (n, n) with its projector; None if using it would not shorten the work.

    `spectrum` are the exact eigenvalue enclosures with multiplicities. None is also returned if the projector or the decay of
    the rest cannot be verified at the working precision.
    """
    ordered = sorted(spectrum, key=lambda item: float(item[0].real.mid()), reverse=True)
    index = next((k for k, (root, _) in enumerate(ordered) if root.imag > 0), None)
    if index is None or ordered[index][1] != 1:
        return None
    slowest = ordered[index][0]
    others = ordered[:index] + ordered[index + 1 :]
    rest = [item for item in others if not item[0].overlaps(slowest.conjugate())]
    if len(rest) != len(others) - 1:  # an eigenvalue cannot be separated from the pair at this precision
        return None
    decay = -float(slowest.real.mid())
    rest_decay = min((-float(root.real.mid()) for root, _ in rest), default=math.inf)
    saved = float(slowest.imag.mid()) / math.pi * _TIME_CONSTANTS * (1.0 / decay - 1.0 / rest_decay)
    if rest and not saved > _WORTHWHILE_SIGN_CHANGES:
        return None
    projector = _spectral_projector(A, slowest, others)
    if not all(entry.is_finite() for entry in projector.entries()):
        return None
    pair = arb_mat(A.nrows(), A.ncols(), [2 * entry.real for entry in projector.entries()])
    remainder = None
    if rest:
        # Shifting the pair to the decay of the rest leaves e^(As) unchanged on the rest, because the projector commutes with A;
        # the certificate then depends only on the faster decay.
        shifted = A - pair * arb(rest_decay - decay)
        roots = [complex(root.mid()) for root, multiplicity in rest for _ in range(multiplicity)]
        moved = complex(-rest_decay, float(slowest.imag.mid()))
        remainder = decay_certificate(shifted, C, [*roots, moved, moved.conjugate()], 0.5 * rest_decay)
        if remainder is None:
            return None
    return SlowOscillation(slowest, projector, identity(A.nrows()) - pair, remainder)


def _spectral_projector(A: arb_mat, eigenvalue: acb, others: list[tuple[acb, int]]) -> acb_mat:
    """Return the product of (A - mu I)/(eigenvalue - mu) over the other eigenvalues mu with multiplicity.

    By Cayley-Hamilton the product vanishes on the generalised eigenspaces of all mu and is the identity on
    the eigenvector of the simple eigenvalue, so it is the spectral projector, defective rest or not.
    """
    n = A.nrows()
    matrix = acb_mat(A)
    unit = acb_mat(identity(n))
    projector = unit
    for root, multiplicity in others:
        factor = (matrix - unit * root) * (1 / (eigenvalue - root))
        for _ in range(multiplicity):
            projector = projector * factor
    return projector


def _oscillation_integral(amplitude: acb, eigenvalue: acb) -> arb:
    """Return integral_0^inf |Re(amplitude e^(eigenvalue s))| ds for Re(eigenvalue) < 0 < Im(eigenvalue).

    The integral depends on the amplitude with Lipschitz constant 1/decay, so it is evaluated at an exact amplitude and the ball
    is widened. Zeros lie pi/frequency apart, and the arcs form a geometric series.
    """
    decay, frequency = -eigenvalue.real, eigenvalue.imag
    centre = acb(amplitude.mid())
    deviation = abs(amplitude - centre).upper()
    if centre == 0:
        return arb(0).union((deviation / decay).upper())
    first_zero = _first_zero(centre, frequency)
    if first_zero is None:
        # A zero exactly at the start cannot be distinguished from one just before it, so the phase is rotated slightly.
        turned = acb((centre * acb(0, -(arb(2) ** (-(ctx.prec // 2)))).exp()).mid())
        deviation += abs(turned - centre).upper()
        centre = turned
        first_zero = _first_zero(centre, frequency)
    if first_zero is None:
        return arb(0).union((abs(amplitude) / decay).upper())
    growth = (eigenvalue * first_zero).exp()
    begin = abs((centre * (growth - 1) / eigenvalue).real)
    modulus_squared = decay * decay + frequency * frequency
    half_turn = arb.pi() * decay / frequency
    arcs = abs(centre) * (-decay * first_zero).exp() * frequency / modulus_squared * (half_turn / 2).coth()
    spread = (deviation / decay).upper()
    return begin + arcs + arb(0, spread)


def _first_zero(amplitude: acb, frequency: arb) -> arb | None:
    """Return the s in [0, pi/frequency] with Re(amplitude e^(i frequency s)) = 0, None if undecided."""
    phase = amplitude.arg()
    guess = math.ceil(float(phase.mid()) / math.pi - 0.5)
    for turns in (guess, guess - 1, guess + 1):
        angle = arb.pi() * (arb(turns) + arb(0.5)) - phase
        if angle >= 0 and angle <= arb.pi():
            return angle / frequency
    return None


# The radii of repeated products grow with the powers of |A|, but the products only with the powers of A; with twice the digits,
# the difference is negligible.
_DIGITS_OF_POWERS = 2
# Bits kept below the requested width for rounding, summed over all segments.
_GUARD_BITS = 40
# Longest segment, in units of 1/(slowest eigenvalue). A handful of such segments reaches the tail; the rounding noise of fast
# modes, which the Taylor coefficients magnify, grows with the power POLYNOMIAL_DEGREE + 1 of the length.
LONGEST_STEP = 4.0
# Fraction of the width allotted to each of Taylor remainders, the tail and unresolved signs. With 1/8 each, the sum and the final
# rounding to floats stay below one half although only a lower bound on the scale is known.
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

    @property
    def matrices(self) -> tuple[FloatMatrix, FloatMatrix, FloatMatrix, FloatMatrix]:
        """A, B, C and D."""
        return self.A, self.B, self.C, self.D


@dataclass(frozen=True)
class NormModel:
    """Everything that is needed about the system at one working precision and does not depend on the tolerance.

    States and time are rescaled (`scaled`), so times are in the rescaled unit, not in seconds. Parts that only the integration
    needs are computed at their first use, which must be at the same precision: many models only determine the precision.
    """

    A: arb_mat
    B: arb_mat
    C: arb_mat
    feedthrough: list[list[arb]]  # |D|, rows by columns
    certificate: DecayCertificate
    spectrum: list[tuple[acb, int]]  # enclosures of the eigenvalues with their multiplicities
    decay: float  # smallest |real part|
    fastest: float  # largest |eigenvalue|
    slowest: float  # smallest |eigenvalue|
    frequency: float  # largest imaginary part
    remainder: arb_mat  # factor of P times A^(POLYNOMIAL_DEGREE + 1)

    @cached_property
    def oscillation(self) -> SlowOscillation | None:
        """The slowest oscillation, if it shortens the work."""
        return slow_oscillation(self.A, self.C, self.spectrum)

    @cached_property
    def taylor(self) -> list[arb_mat]:
        """For each row c of C the rows c A^j / j!, j = 0 .. POLYNOMIAL_DEGREE."""
        with ctx.workprec(_DIGITS_OF_POWERS * ctx.prec):
            powers = [self.C]
            for order in range(1, POLYNOMIAL_DEGREE + 1):
                powers.append(powers[-1] * self.A * (arb(1) / order))
        tables = [power.tolist() for power in powers]
        return [arb_mat([table[i] for table in tables]) for i in range(self.C.nrows())]


def build_model(system: System) -> NormModel | None:
    """Return the model of the system at the current precision; None if the decay cannot be certified at this precision."""
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
    with ctx.workprec(_DIGITS_OF_POWERS * ctx.prec):
        high_power = certificate.factor
        for _ in range(POLYNOMIAL_DEGREE + 1):
            high_power = high_power * A
    return NormModel(
        A,
        plant.B,
        C,
        [[abs(arb(value)) for value in row] for row in system.D.tolist()],
        certificate,
        spectrum,
        decay,
        max(abs(root) for root in roots),
        min(abs(root) for root in roots),
        max(abs(root.imag) for root in roots),
        high_power,
    )


def norm_lower_bound(model: NormModel) -> arb:
    """Return a rigorous lower bound on the norm: the largest row sum of step-response variations.

    The step response of a channel changes by at most the integral of |h| between any two instants, here the octaves from the
    fastest to the slowest time scale. This bound only sets the tolerances.
    """
    first = math.floor(-math.log2(model.fastest)) - 1
    last = math.ceil(-math.log2(model.decay)) + 2
    try:
        gain = model.A.transpose().solve(model.C.transpose()).transpose()
    except ZeroDivisionError:  # singular only at this precision, because A is Hurwitz
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
    """Return the precision at which rounding stays within the budget and fast modes stay negligible."""
    # Rounding of the state is relative to its entries, whose contributions may cancel in the norm; the norm of a box of their
    # size does not include this cancellation.
    boxes = [
        arb_mat(model.B.nrows(), 1, [arb(0, abs(entry).upper()) for entry in column(model.B, j).entries()])
        for j in range(model.B.ncols())
    ]
    rounding = max(log2_above(model.certificate.tail(model.certificate.norm(box))) for box in boxes)
    # Rounding also re-excites decayed fast modes, which would keep the segments short through the Taylor remainder. They must be
    # negligible over the longest segment.
    longest = arb(LONGEST_STEP / model.slowest)
    constant = longest * remainder_constant(longest)
    stiffness = max(log2_above(constant * euclidean_norm(model.remainder * box)) for box in boxes)
    bits = max(rounding, stiffness) - log2_above(budget) + _GUARD_BITS
    # Whole multiples of a limb (64 bits) cost the same as the bits below them.
    return 64 * math.ceil(bits / 64.0)


@dataclass(frozen=True)
class Tolerances:
    """Target values for one input; they guide the computation and are never part of a proof."""

    remainder_rate: arb  # Taylor remainder per unit of time
    tail: arb
    piece: arb  # allowance for the unresolved sign of one piece
    horizon: float  # time until the tail begins


def tolerances(model: NormModel, start: arb_mat, budget: arb) -> Tolerances:
    """Return the tolerances of one of the inputs, whose state starts at the column `start` (n, 1)."""
    share = budget * _TRUNCATION_SHARE / model.B.ncols()
    rate = 0.5 * model.decay
    initial = log2_above(model.certificate.tail(model.certificate.norm(start)))
    horizon = max(1.0, (initial - log2_above(share)) * math.log(2.0)) / rate
    # Twice the number of sign changes expected until the horizon, since pieces are also split for other reasons.
    pieces = 64.0 + 2.0 * horizon * model.frequency / math.pi
    return Tolerances(share / horizon, share, share / pieces, horizon)


def log2_above(value: arb) -> float:
    """Return approximately log2 of the upper end of a ball, -inf if it is not positive; used only to guide the computation."""
    return float(value.upper().log()) / math.log(2.0) if value.upper() > 0 else -math.inf


def column(matrix: arb_mat, index: int) -> arb_mat:
    """Return one column (n, 1) of a matrix (n, m)."""
    return arb_mat(matrix.nrows(), 1, [matrix[i, index] for i in range(matrix.nrows())])
