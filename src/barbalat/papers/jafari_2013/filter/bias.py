"""The claim that the filter leaves a constant bias proportional to kappa: beside a sine, and beside a constant command."""

from __future__ import annotations

import numpy as np

from barbalat.papers.claim import Claim, Measurement, span, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, local_exponents, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.signals import Constant
from barbalat.validate import Array

KAPPAS = np.array([0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125])
"""[s]: halved from twice Section V's on; the first is the last power of two of it that Theorem 1's condition admits."""
STAYING_SHARE, LASTING_SHARE = 1e-2, 1e-3
"""Of the largest error, above which the tail's error stays; of the error beside a sine, above which one beside a constant command stays."""


def doubles(amplitudes: Array) -> Array:
    """Whether each is twice the next, to within the rule's share; (k - 1,) for (k,) amplitudes at settings that halve."""
    return np.asarray(np.abs(amplitudes[:-1] / amplitudes[1:] / 2 - 1) < PROPORTIONAL_SHARE)


def bias_is_proportional() -> Claim:
    """The steady error against kappa: as it falls, and beside a constant command."""
    given, gamma, sentence = section_v.problem(), 100.0, SENTENCES["bias-kappa"]
    found = figures([(given, section_v.l1("L1", gamma, float(k))) for k in KAPPAS], 60.0, 1e-4)
    tail, ratios = found.tail_max_abs_e[:, 0], found.tail_max_abs_e[:-1, 0] / found.tail_max_abs_e[1:, 0]
    exponents = local_exponents(tail, KAPPAS)
    held = figures([(variant(reference=Constant(50.0)), section_v.l1("L1", 1.0))], 120.0, 1e-3).tail_max_abs_e[0, 0]
    own = int(np.abs(KAPPAS[:-1] - section_v.KAPPA).argmin())
    size, share = tail[own], float(tail[own] / found.max_abs_e[own, 0])
    doubled = doubles(tail)
    readings = (
        sentence.reads(share > STAYING_SHARE, f"max |e_1| in the tail is {size:.3g}, {share:.2g} of the largest, at kappa = {KAPPAS[own]:g} s"),
        sentence.reads(
            bool(held > LASTING_SHARE * size),
            f"max |e_1| in the tail of 120 s is {held:.1g} beside r = 50; beside Section V's sine of that size {size:.3g}, which is a sine as well",
            1,
        ),
        sentence.reads(
            bool(doubled.all()), f"twice the kappa makes the error {span(ratios)} times as large; from {KAPPAS[own + 1]:g} to {KAPPAS[own]:g} s {ratios[own]:.3g} times", 2
        ),
        Reading(f"kappa up to {section_v.KAPPA:g} s, beside a sine: proportional", bool(doubled[own:].all()), f"twice the kappa: {span(ratios[own:])} times", "beside"),
    )  # fmt: skip
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"The tail's error beside a sine: {ratios[own]:.3g} times at twice the kappa. Beside a constant command {held:.0e} is left.",
        measured=f"max |e_1| in the tail goes from {tail[0]:.3g} at kappa = {KAPPAS[0]:g} s to {tail[-1]:.3g} at {KAPPAS[-1]:g} s, the local exponent "
        f"from {exponents[0]:.3g} to {exponents[-1]:.3g}: to 1 as kappa falls. Beside a constant command {held:.1g} is left",
        how=f"Section V, Gamma = {gamma:g}, RK4, h = 1e-4 s, 60 s; constant command: Gamma = 1, h = 1e-3 s, 120 s",
        listings=(
            table(
                "The steady error against the filter's time constant, and the local exponent from the row above",
                {"kappa [s]": KAPPAS, "max |e_1|, tail": tail, "exponent": np.append(np.nan, exponents)},
            ),
        ),
        would_change="holds: an error that stays beside a constant command too; fails: one that goes to zero beside a sine, or does not grow with kappa. "
        "With another C than (6) see l1-against-pi",
    )  # fmt: skip


ROWS = (Measurement(bias_is_proportional, 0.1, {"bias-kappa": "the filter's steady error"}, place=60, quick=True),)
