"""Closed form of the slowest oscillation, split off a lightly damped system with a verified projector."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import acb, acb_mat, arb, arb_mat, ctx

from barbalat.linear.l1_norms.decay import DecayCertificate, decay_certificate, identity

# Marching time takes about one segment a sign change; the closed form costs about as much as this many.
_WORTHWHILE_SIGN_CHANGES = 12.0
# Time constants until an oscillation falls below the tolerance 1e-9 or so: ln(1e10).
_TIME_CONSTANTS = 23.0


@dataclass(frozen=True)
class SlowOscillation:
    """Simple complex pair eigenvalue, conj(eigenvalue) that outlives every other mode.

    `projector` (n, n) is the complex spectral projector on the eigenvalue with positive imaginary part;
    `complement` is I - 2 Re(projector), the projector on all other modes. `remainder` bounds the motion of
    the other modes, None if there are none (n = 2).
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
    """Return the slowest pair of A (n, n) with its projector, None where it would not shorten the work.

    `spectrum` are the exact eigenvalue enclosures with multiplicities. None is also returned where the
    projector or the decay of the rest cannot be verified at the working precision.
    """
    ordered = sorted(spectrum, key=lambda item: float(item[0].real.mid()), reverse=True)
    index = next((k for k, (root, _) in enumerate(ordered) if root.imag > 0), None)
    if index is None or ordered[index][1] != 1:
        return None
    slowest = ordered[index][0]
    others = ordered[:index] + ordered[index + 1 :]
    rest = [item for item in others if not item[0].overlaps(slowest.conjugate())]
    if len(rest) != len(others) - 1:  # an eigenvalue too close to the pair to tell at this precision
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
        # Shifting the pair to the decay of the rest leaves e^(As) unchanged on the rest, since the projector
        # commutes with A; the certificate then sees only the faster decay.
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

    The integral depends on the amplitude with Lipschitz constant 1/decay, so it is evaluated at an exact
    amplitude and the ball widened; zeros lie pi/frequency apart and the arcs form a geometric series.
    """
    decay, frequency = -eigenvalue.real, eigenvalue.imag
    centre = acb(amplitude.mid())
    deviation = abs(amplitude - centre).upper()
    if centre == 0:
        return arb(0).union((deviation / decay).upper())
    first_zero = _first_zero(centre, frequency)
    if first_zero is None:
        # A zero at the very start cannot be told from one just before it: turn the phase by a hair.
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
