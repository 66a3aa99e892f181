"""The claim on the range of kappa in which the condition of Section V holds. Certified norms at a few values decide it for every
kappa."""

from __future__ import annotations

import math

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.rows import down, up
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Claim, Listing, Measurement, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.state_feedback import Known

THETA_MAX = 10.0
"""The largest |theta|_1 over Section V's known set."""
PRINTED_KAPPA = 0.05
"""The paper's limit on kappa [s], which has two decimals."""
LIMIT_WITHIN = 1e-6
"""Relative distance between the largest kappa with a proof and one without."""
TOLD_KAPPAS = (0.01, 0.02, 0.03, 0.04, PRINTED_KAPPA)
"""Further values of kappa [s] besides the limit."""


def condition() -> Claim:
    """Find the range in which the condition holds, and whether it fails between its end and the printed limit."""
    known = section_v.problem().known
    largest = theorem_1.kappa_admissible(known, THETA_MAX, LIMIT_WITHIN)
    least = fails_down_to(known, PRINTED_KAPPA)
    proved = math.floor(1e6 * largest) / 1e6
    sentence, held = SENTENCES["kappa-0.05"], holds_up_to(known, largest)
    value = _value(known, PRINTED_KAPPA)[0]
    readings = (
        sentence.reads(
            held and largest >= PRINTED_KAPPA, f"at {PRINTED_KAPPA:g} s the left side, which must be less than 1, is {value:.4f}"
        ),
        Reading(
            f"with the limit rounded to the safe side: kappa up to {proved:.6f} s",
            held and round(largest, 2) >= PRINTED_KAPPA,
            f"proved up to {proved:.6f} s, which rounds to the printed {PRINTED_KAPPA:g} s",
            "mended",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"The condition holds up to kappa = {proved:.4f} s, which the paper rounds up: at {PRINTED_KAPPA:g} s the left "
        f"side is {value:.4f}, but must be less than 1.",
        measured=f"holds for every kappa up to {proved:.6f} s" + ("" if largest >= PRINTED_KAPPA else _refuted(known, least)),
        how="certified enclosures of the norm; the limit is known to 1e-6; between the points, N(k2)/k2 <= N(k1)/k1 and N(k1) "
        "<= (2 - k1/k2) N(k2) for k1 < k2, where N(k) = ||W_b (C - 1)||_1; near zero, N(k) <= k ||s W_b||_1",
        listings=(_over_kappa(known, proved),),
        would_change="nothing that a simulation can show: the range is proved from both sides",
    )  # fmt: skip


def _over_kappa(known: Known, proved: float) -> Listing:
    kappas = sorted({*TOLD_KAPPAS, proved})
    bounds = [_value(known, kappa) for kappa in kappas]
    return table(
        "Guaranteed bounds on ||W_b (C - 1)||_1 theta_max, which must be less than 1, against the filter's time constant",
        {
            "kappa [s]": [f"{kappa:.6g}" for kappa in kappas],
            "at least": [down(lower, 6) for lower, _ in bounds],
            "at most": [up(upper, 6) for _, upper in bounds],
        },
    )


def _refuted(known: Known, least: float) -> str:
    if not math.isfinite(least):
        return f"; at {PRINTED_KAPPA:g} s it is undecided"
    return (
        f"; from {math.ceil(1e6 * least) / 1e6:.6f} s to {PRINTED_KAPPA:g} s it provably fails, and at {PRINTED_KAPPA:g} s the "
        f"left side is {_value(known, PRINTED_KAPPA)[0]:.4f}. The limit was rounded to the unsafe side"
    )


def _value(known: Known, kappa: float) -> tuple[float, float]:
    """Return guaranteed lower and upper bounds of ||W_b (C - 1)||_1 theta_max."""
    found = theorem_1.filter_condition(known, input_filter(kappa).realise(), THETA_MAX)
    return found.norm.lower * THETA_MAX / OUTWARD_FACTOR, found.value_upper


def holds_up_to(known: Known, kappa: float) -> bool:
    """Whether the condition is proved for every kappa' in (0, kappa].

    For k1 < k2, 1 - C_k1 = (1 - C_k2) [1 - (1 - k1/k2)/(k1 s + 1)], and the bracket's L1 norm is 2 - k1/k2. Therefore a value
    v < 1 at k2 stays below one down to (2 - 1/v) k2. Below kappa_max Theorem 1's own inequality N <= k ||s W_b||_1 applies.
    """
    small = theorem_1.kappa_max(theorem_1.derivative_norm(known), THETA_MAX) * (1 - 1e-9)
    while kappa > small:
        value = _value(known, kappa)[1]
        if value >= 1 - 1e-9:  # the width of the enclosures
            return False
        kappa *= max(2 - 1 / value, 0.5) * OUTWARD_FACTOR
    return True


def fails_down_to(known: Known, kappa: float) -> float:
    """Return the smallest kappa' found for which the condition is refuted on [kappa', kappa]; infinity if it is not refuted at
    kappa.

    For k1 < k2, 1 - C_k2 = (1 - C_k1) [1 + (k2/k1 - 1)/(k2 s + 1)], and the bracket's L1 norm is k2/k1. Therefore N(k)/k does
    not grow with k, and a value v > 1 at k2 stays above one down to k2/v.
    """
    least = math.inf
    while (value := _value(known, kappa)[0]) > 1 + LIMIT_WITHIN / 2:
        least = kappa = kappa / value * OUTWARD_FACTOR
    return least


ROWS = (Measurement(condition, 0.4, {"kappa-0.05": "the values of kappa for which the condition holds"}, place=100, quick=True),)
