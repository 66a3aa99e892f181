"""Integration of |h| in Taylor segments from t = 0 to where a verified bound on the rest is negligible."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from flint import arb, arb_mat, arb_poly, ctx

from barbalat.linear.l1_norms.decay import euclidean_norm
from barbalat.linear.l1_norms.model import LONGEST_STEP, NormModel, Tolerances, column, log2_above, tolerances
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, BernsteinPiece, bernstein_matrix, remainder_constant, resolved


@dataclass
class Counters:
    """Work done so far, over all channels and attempts."""

    segments: int = 0
    sign_changes: int = 0


def integrate(model: NormModel, budget: arb, counters: Counters, work_limit: int) -> tuple[list[arb], list[arb]]:
    """Return lower and upper bounds (as balls) of each output row's sum over inputs of |D| + integral |h|."""
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
    monomial: list[arb_mat]  # per row: state to Taylor coefficients in the segment's own time 0 .. 1
    bernstein: list[arb_mat]  # per row: state to Bernstein coefficients


class _Ladder:
    """Segment lengths that are powers of two, their constants computed when first used."""

    def __init__(self, model: NormModel) -> None:
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
            self._transitions[exponent] = (self.model.A * arb(2) ** exponent).exp() if shorter is None else shorter * shorter
        return self._transitions[exponent]

    def _build(self, exponent: int) -> _Rung:
        length = arb(2) ** exponent
        scales = [length**k for k in range(POLYNOMIAL_DEGREE + 1)]
        monomial = []
        for table in self.model.taylor:
            rows = table.tolist()
            monomial.append(arb_mat([[entry * scales[k] for entry in rows[k]] for k in range(POLYNOMIAL_DEGREE + 1)]))
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
        # The state is an exact vector plus an error known only by its norm, which the flow contracts; a box
        # around the vector would grow with every turn of the state instead (the wrapping effect).
        state = start.mid()
        error = certificate.norm(start - state).upper()
        exponent = self._first_exponent(state)
        top = math.floor(math.log2(min(self.tolerances.horizon, LONGEST_STEP / self.model.slowest)))
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

    def _segment(self, rung: _Rung, row: int, state: arb_mat, error: arb) -> None:
        """Add the integral of |c x(s)| over one segment for one row c of C, exact up to `error`."""
        piece = BernsteinPiece((rung.bernstein[row] * state).entries())
        tolerance = self.tolerances.piece / rung.length
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
