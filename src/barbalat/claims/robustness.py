"""Claims on unmodelled dynamics: what the filter, the gain and tau do to the margins."""

from __future__ import annotations

import numpy as np

from barbalat.claims import filter_margins, section_v, theorem_2
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.filter_margins import adapting_delay_margin
from barbalat.claims.variants import figures, numbers
from barbalat.controllers import Mrac


def claims() -> list[Claim]:
    """All of this group."""
    return [filter_margins.claim(), gain_and_margins(), tau_and_error(), *theorem_2.claims()]


def gain_and_margins() -> Claim:
    """The delay margin of the adapting loop against Gamma."""
    gains = (0.01, 1.0, 100.0, 1e4)
    unfiltered = np.array([adapting_delay_margin(Mrac(gamma=g), 1.0) for g in gains])
    filtered = np.array([adapting_delay_margin(section_v.l1("L1", g), 1.0) for g in gains])
    return Claim(
        "gain-reduces-margins", "Sections I, III", "A high adaptive gain reduces robustness",
        verdict(holds=bool((np.diff(unfiltered) < 0).all()), conditional=bool(filtered[-1] > filtered[1])),
        f"delay margin around r = 1 for Gamma {numbers(np.array(gains))}: MRAC {numbers(unfiltered)} s, L1-AC {numbers(filtered)} s: true of "
        "MRAC, while with the filter the margin tends to a limit above zero",
        "exact margins of the loops linearised with the law inside, kappa = 0.02 s",
    )  # fmt: skip


def tau_and_error() -> Claim:
    """Without modelling error."""
    taus = np.array([0.1, 0.05, 0.02, 0.01, 0.005])
    peaks = figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 60.0, 1e-4).max_abs_e.max(axis=1)
    exponents = np.diff(np.log(peaks)) / np.diff(np.log(taus))
    return Claim(
        "tau-error", "Theorem 2, eq. (17)", "Without modelling error the transient error of the robust MRAC is proportional to tau",
        verdict(holds=bool((np.abs(exponents - 1) < 0.05).all())),
        f"max |e| {numbers(peaks)} for tau {numbers(taus)} s: exponents {numbers(exponents)}",
        "Section V, sign of (14) corrected, RK4, h = 1e-4 s, 60 s",
    )  # fmt: skip
