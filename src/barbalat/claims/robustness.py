"""Claims on tau: what it does to the error, and how small a modelling error lets it be."""

from __future__ import annotations

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.variants import figures, local_exponents, span, table


def tau_and_error() -> Claim:
    """Without modelling error."""
    taus = np.array([0.1, 0.05, 0.02, 0.01, 0.005])
    peaks = figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 60.0, 1e-4).max_abs_e.max(axis=1)
    exponents = local_exponents(peaks, taus)
    return Claim(
        "tau-error", "Theorem 2, eq. (17); Section III.B, after it", "Without modelling error the transient error of the robust MRAC is proportional to tau",
        verdict(holds=bool((np.abs(exponents - 1) < 0.05).all())),
        f"max |e| goes from {peaks[0]:.3g} at tau = {taus[0]:g} s to {peaks[-1]:.3g} at {taus[-1]:g} s, with local exponents of "
        f"{span(exponents)}",
        "Section V, sign of (14) corrected, RK4, h = 1e-4 s, 60 s",
        listings=(
            table(
                "The largest error of the robust MRAC against tau, and the local exponent from the row above",
                {"tau [s]": taus, "max |e|": peaks, "exponent": np.append(np.nan, exponents)},
            ),
        ),
        tested="the local exponent in tau of the largest |e_i| of a run, tau from 0.1 to 0.005 s",
        number=f"exponent of tau: {exponents.min():.2f} to {exponents.max():.2f}",
        would_change="an exponent below one as tau falls, at a step that resolves tau",
    )  # fmt: skip
