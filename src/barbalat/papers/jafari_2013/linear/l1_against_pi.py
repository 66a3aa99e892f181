"""L1-AC beside a PI controller with as large a delay margin: with a filter of first order, and with one of two slopes."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.controllers import L1Adaptive
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.papers.claim import Claim, Listing, Reading, of_readings, verdict
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.linear.linear_family import SIZES, at_one, over_sizes
from barbalat.papers.wording import table
from barbalat.validate import Array

GAMMA = 100.0
"""As beside the linear designs: the loop moves as its limit of fast adaptation, and h = 1e-4 s resolves it."""
SEARCHED_KAPPAS = (1e-3, 0.5)
"""[s]: between these time constants of the second filter its delay margin rises past that of the first."""
THETA_MAX = 10.0
"""Section V's, of |theta|_1 over the known set."""


def second_order_filter(kappa: float) -> TransferFunction:
    """C = (2 kappa s + 1)/(kappa s + 1)^2: C(0) = 1 and C'(0) = 0, so that 1 - C = (kappa s)^2/(kappa s + 1)^2 has two slopes."""
    return TransferFunction([2 * kappa, 1.0], [kappa**2, 2 * kappa, 1.0])


def claim(l1: Array, pi: Array) -> Claim:
    """From the tail errors of L1-AC with the first-order filter and of the PI over the sizes, (sizes,) each."""
    from scipy.optimize import brentq

    margin = _delay_margin(input_filter(section_v.KAPPA))
    kappa = float(brentq(lambda value: _delay_margin(second_order_filter(value)) - margin, *SEARCHED_KAPPAS))
    C = second_order_filter(kappa)
    second = over_sizes(L1Adaptive(gamma=GAMMA, filter=C, name="two slopes"))[:-1]
    condition = theorem_1.filter_condition(section_v.problem().known, C.realise(), THETA_MAX).value_upper
    readings = (
        _reading(f"C of first order, (6), kappa = {section_v.KAPPA:g} s", l1, pi),
        _reading(f"C with C'(0) = 0, (2 kappa s + 1)/(kappa s + 1)^2, kappa = {kappa:.3g} s", second, pi),
    )
    return Claim(
        "l1-against-pi", "not in the paper: this project, after Section IV, which misses a comparison with linear robust designs",
        "L1-AC tracks better than a PI controller with as large a delay margin",
        of_readings(readings),
        "; ".join(f"{reading.says}: {reading.measured}" for reading in readings) + ". In the limit of fast adaptation L1-AC is a linear loop with "
        f"S = 1 - C: one slope of rejection with (6), where the PI has two; two with C'(0) = 0, for which Theorem 1's condition has {condition:.2f} on its left",
        f"as adaptive-against-linear, without a delay; all with a delay margin of {1e3 * margin:.0f} ms at Section V's theta",
        listings=(_over_sizes(l1, second, pi),),
        number=f"tail error over PI's: {at_one(l1 / pi):.2g} by (6), {at_one(second / pi):.2g} by C'(0) = 0",
        readings=readings,
        condition="1 - C has two slopes, C'(0) = 0; with the first-order filter (6), the paper's, the PI tracks better",
        would_change="another C, as the readings show; another design of the PI, another delay margin or command",
    )  # fmt: skip


def _over_sizes(l1: Array, second: Array, pi: Array) -> Listing:
    told = slice(None, None, 3)  # a factor of two from row to row
    return table(
        "Tail errors max |e| over the size of the uncertainty; a dash where a loop diverged",
        {
            "size": SIZES[told],
            "L1-AC, C of first order": l1[told],
            "L1-AC, C'(0) = 0": second[told],
            "PI": pi[told],
        },
    )


def _delay_margin(C: TransferFunction) -> float:
    """Exact, of the limit of fast adaptation at Section V's theta [s]."""
    return margins(fast_adaptation(section_v.problem().plant, C.realise())).delay


def _reading(says: str, l1: Array, pi: Array) -> Reading:
    both = ~(np.isnan(l1) | np.isnan(pi))
    ratio = l1[both] / pi[both]
    return Reading(
        says,
        verdict(holds=bool((ratio < 1).any()), conditional=bool((ratio >= 1).any())),
        f"its tail error is {ratio.min():.2g} to {ratio.max():.2g} times the PI's over the sizes that both bear, {at_one(l1 / pi):.2g} times at size 1",
    )
