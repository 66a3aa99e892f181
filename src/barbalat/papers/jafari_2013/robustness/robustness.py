"""The claim on the effect of tau on the error without a modelling error."""

from __future__ import annotations

import numpy as np

from barbalat.papers.claim import Claim, Measurement, span, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, local_exponents
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED

EQUAL_NU_FACTOR = 1.05
"""Two values of max |e|/tau count as equal up to this factor."""


def tau_and_error() -> Claim:
    """Measure the error without modelling error, from Figure 2's tau downwards."""
    taus = np.array([section_v.TAU, 0.1, 0.05, 0.02, 0.01, 0.005])
    peaks = figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 60.0, 1e-4).max_abs_e.max(axis=1)
    exponents, nu = local_exponents(peaks, taus), peaks / taus
    below = exponents[1:]
    sentence = SENTENCES["tau-error"]
    doubled = peaks[1:-1:2] / peaks[2::2]  # 0.1 to 0.05 s, 0.02 to 0.01 s
    readings = (
        sentence.reads(
            bool(nu.max() < nu[-1] * EQUAL_NU_FACTOR),
            f"the smallest nu is {nu[0]:.3g} at {taus[0]:g} s, {nu[1]:.3g} at {taus[1]:g} s and {nu[-1]:.3g} at {taus[-1]:g} s",
        ),
        Reading(
            f"exactly proportional, not just at most proportional, for tau from {taus[1]:g} s down to {taus[-1]:g} s",
            bool((np.abs(doubled / 2 - 1) < PROPORTIONAL_SHARE).all()),
            f"doubling tau multiplies the error by {span(doubled)}; the local exponents are {span(below)}, and "
            f"{exponents[0]:.3g} between the last of these and Figure 2's tau",
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"In runs with {MENDED}, max |e|/tau is {nu[0]:.3g} 1/s at tau = {taus[0]:g} s, {nu[1]:.3g} at {taus[1]:g} s and "
        f"{nu[-1]:.3g} at {taus[-1]:g} s.",
        measured=        f"max |e| goes from {peaks[0]:.3g} at tau = {taus[0]:g} s to {peaks[-1]:.3g} at {taus[-1]:g} s. Its "
            f"local exponents are {span(below)} below {taus[1]:g} s, where the error is proportional to tau, and "
            f"{exponents[0]:.3g} up to {taus[0]:g} s, where it grows less than proportionally",
        how=f"Section V, {MENDED}, RK4, h = 1e-4 s, 60 s. The paper says that the bound is quantifiable but does not give nu. "
            f"The smallest nu of these runs is not a bound derived beforehand, and with (14) as printed no nu exists "
            f"(erratum-14)",
        listings=(
            table(
                "The largest error of the robust MRAC against tau, and the local exponent relative to the row above",
                {"tau [s]": taus, "max |e|": peaks, "max |e|/tau": nu, "exponent": np.append(np.nan, exponents)},
            ),
        ),
        would_change=f"a max |e|/tau that keeps growing as tau falls below {taus[1]:g} s, at a step that resolves tau",
    )  # fmt: skip


ROWS = (Measurement(tau_and_error, 0.3, {"tau-error": "the robust MRAC's error is proportional to tau"}, place=230),)
