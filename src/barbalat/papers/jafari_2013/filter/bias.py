"""The claim that the filter leaves a constant bias proportional to kappa, tested with a sine and with a constant command."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.papers.claim import Claim, Measurement, span, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, local_exponents, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.signals import Constant
from barbalat.validate import Array

KAPPAS = np.array([0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125])
"""Time constants of the filter [s], each half of the previous one. The first is twice Section V's."""
BISECTIONS = 8
"""Number of bisections between Section V's kappa and Theorem 1's kappa_max, after which the end of proportionality is known to
1e-4 s."""
THETA_MAX = 10.0
"""The largest |theta|_1 over Section V's known set."""
STAYING_SHARE, LASTING_SHARE = 1e-2, 1e-3
"""An error is said to remain if the error in the tail exceeds the first fraction of the largest error or, with a constant
command, the second fraction of the error with a sine."""


def doubles(amplitudes: Array) -> Array:
    """Return whether each amplitude is twice the next to within the rule's fraction, (k - 1,) for (k,) amplitudes. Each setting
    is half of the previous one."""
    return np.asarray(np.abs(amplitudes[:-1] / amplitudes[1:] / 2 - 1) < PROPORTIONAL_SHARE)


def _over_half(gamma: float, kappa: float) -> float:
    """Return the error in the tail divided by the same error with half the kappa."""
    members = [(section_v.problem(), section_v.l1("L1", gamma, k)) for k in (kappa, kappa / 2)]
    larger, smaller = figures(members, 60.0, 1e-4).tail_max_abs_e[:, 0]
    return float(larger / smaller)


def _ends(gamma: float, admitted: float) -> float:
    """Return the kappa [s] up to which the error is proportional, at most the largest one that Theorem 1 admits."""
    low, high = section_v.KAPPA, admitted
    if abs(_over_half(gamma, high) / 2 - 1) < PROPORTIONAL_SHARE:
        return high
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        inside = abs(_over_half(gamma, middle) / 2 - 1) < PROPORTIONAL_SHARE
        low, high = (middle, high) if inside else (low, middle)
    return low


def bias_is_proportional() -> Claim:
    """Measure the steady error for decreasing kappa, and with a constant command."""
    given, gamma, sentence = section_v.problem(), 100.0, SENTENCES["bias-kappa"]
    found = figures([(given, section_v.l1("L1", gamma, float(k))) for k in KAPPAS], 60.0, 1e-4)
    tail, ratios = found.tail_max_abs_e[:, 0], found.tail_max_abs_e[:-1, 0] / found.tail_max_abs_e[1:, 0]
    exponents = local_exponents(tail, KAPPAS)
    held = figures([(variant(reference=Constant(50.0)), section_v.l1("L1", 1.0))], 120.0, 1e-3).tail_max_abs_e[0, 0]
    own = int(np.abs(KAPPAS[:-1] - section_v.KAPPA).argmin())
    size, share = tail[own], float(tail[own] / found.max_abs_e[own, 0])
    doubled, admitted = doubles(tail), theorem_1.kappa_max(theorem_1.derivative_norm(given.known), THETA_MAX)
    ends = _ends(gamma, admitted)
    readings = (
        sentence.reads(share > STAYING_SHARE, f"at kappa = {KAPPAS[own]:g} s max |e_1| in the tail is {size:.3g}, {share:.2g} of "
        f"its maximum over the whole run"),
        sentence.reads(
            bool(held > LASTING_SHARE * size),
            f"with r = 50 max |e_1| in the tail of 120 s is {held:.1g}; with Section V's sine of the same size it is {size:.3g}, "
            "and this error is itself a sine",
            1,
        ),
        sentence.reads(
            bool(doubled[own - 1 : own + 1].all()),
            f"the error grows by a factor of {ratios[own]:.3g} from {KAPPAS[own + 1]:g} to {KAPPAS[own]:g} s and by a factor of "
            f"{ratios[own - 1]:.3g} from there to {KAPPAS[own - 1]:g} s",
            2,
        ),
        Reading(
            f"proportional at every kappa that part (ii) of Theorem 1 admits, up to kappa_max = {admitted:.4f} s",
            ends >= admitted,
            f"to within a tenth up to {ends:.4f} s, where the error is {_over_half(gamma, ends):.3g} times the error at "
            f"half that kappa",
            "beside",
        ),
        Reading(f"proportional at every kappa up to {section_v.KAPPA:g} s", bool(doubled[own:].all()), f"doubling kappa "
        f"multiplies the error by {span(ratios[own:])}", "beside"),
    )  # fmt: skip
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"With a sine, doubling kappa multiplies the error by {ratios[own]:.3g}; the error is proportional to kappa "
        f"within a tenth up to {ends:.4f} s. With a constant command it is {held:.0e}.",
        measured=f"max |e_1| in the tail goes from {tail[0]:.3g} at kappa = {KAPPAS[0]:g} s to {tail[-1]:.3g} at {KAPPAS[-1]:g} "
        f"s; its local exponent goes from {exponents[0]:.3g} to {exponents[-1]:.3g} and tends to 1 as kappa falls. With a "
        f"constant command an error of {held:.1g} remains, as Theorem 1 (iii) of the paper says",
        how=f"Section V, Gamma = {gamma:g}, RK4, h = 1e-4 s, 60 s; constant command: Gamma = 1, h = 1e-3 s, 120 s",
        listings=(
            table(
                "The steady error against the filter's time constant, and the local exponent relative to the row above",
                {"kappa [s]": KAPPAS, "max |e_1|, tail": tail, "exponent": np.append(np.nan, exponents)},
            ),
        ),
        would_change=""
        "holds: an error that remains with a constant command too; fails: an error that goes to zero with a sine, or does not "
        "grow with kappa. l1-against-pi treats filters other than (6)",
    )  # fmt: skip


ROWS = (Measurement(bias_is_proportional, 0.8, {"bias-kappa": "the filter's steady error"}, place=60, quick=True),)
