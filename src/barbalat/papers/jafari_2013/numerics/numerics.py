"""Claims on the oscillations: whose they are, where they begin, what removes them."""

from __future__ import annotations

import numpy as np

from barbalat.controllers import Mrac
from barbalat.papers.claim import Claim, Measurement, numbers, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs, by_component, figures
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.solvers import RK4
from barbalat.validate import Array


def come_and_go(runs: Runs) -> Claim:
    """The total variation at the steps and gains of Figures 3, 4, 5."""
    rates = [
        np.array(result.figures["theta_hat_variation_rate"])
        for result in (runs.coarse["L1"], runs.fine["L1, gamma 1e4"], runs.fine["L1, gamma 1e6"])
    ]
    gone, back = bool((rates[1] < rates[0] / 1e3).all()), bool((rates[2] > rates[1] * 1e3).all())
    sentence = SENTENCES["numerical-oscillation"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(gone, f"{numbers(rates[0])} per s at Figure 3's step, {numbers(rates[1])} at Figure 4's"),
            sentence.reads(back, f"{numbers(rates[2])} per s at Figure 5's gain", 1),
        ),
        shows=f"The estimates vary by {rates[0][0]:.3g} per s in Figure 3, by {rates[1][0]:.2g} at a tenth of the step, by {rates[2][0]:.3g} in Figure 5.",
        measured=        f"variation of the estimates in the tail: {span(rates[0])} per s at Figure 3's gain and step, {span(rates[1])} at Figure "
        f"4's step, {span(rates[2])} at Figure 5's gain",
        how="Figures 3, 4, 5, every step",
        listings=(
            table(
                "The variation of the estimates in the tail [1/s], L1-AC",
                {
                    "figure": ("3", "4", "5"),
                    "Gamma": (1e4, 1e4, 1e6),
                    "h [s]": (section_v.COARSE_STEP, section_v.FINE_STEP, section_v.FINE_STEP),
                    "first": [rate[0] for rate in rates],
                    "second": [rate[1] for rate in rates],
                },
            ),
        ),
        would_change="an oscillation that stays as the step falls; what the equations themselves ring is the row own-oscillation",
    )  # fmt: skip


def without_filter() -> Claim:
    """The standard MRAC at the gain and step of Figure 3."""
    rate = figures([(section_v.problem(), Mrac(gamma=1e4))], 60.0, 1e-4).theta_hat_variation_rate[0]
    filtered = figures([(section_v.problem(), section_v.l1("L1", 1e4))], 60.0, 1e-4).theta_hat_variation_rate[0]
    sentence, least = SENTENCES["oscillation-without-filter"], min(float(rate.min()), float(filtered.min()))
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(least > 1e3, f"{numbers(filtered)} per s with the filter, {numbers(rate)} without it"),),
        shows=f"The estimates vary by {filtered.min():.3g} per s and more with the filter, by {rate.min():.3g} without it.",
        measured=        f"variation of the estimates per s: {numbers(rate)} without filter, {numbers(filtered)} with it, {span(filtered / rate)} times as much",
        how="Section V, Gamma = 1e4, h = 1e-4 s, RK4, 60 s",
        listings=(
            table(
                "The variation of the estimates in the tail [1/s]",
                {"scheme": ("MRAC, no filter", "L1-AC"), "first": (rate[0], filtered[0]), "second": (rate[1], filtered[1])},
            ),
        ),
        would_change="estimates that are quiet with the filter, or without it, at this gain and step",
    )  # fmt: skip


def smaller_gain() -> Claim:
    """A moderate gain at the same step."""
    given = section_v.problem()
    mrac = figures([(given, Mrac(gamma=section_v.MODERATE_GAIN))], 60.0, 1e-4)
    l1 = figures([(given, section_v.l1("L1", 1e4))], 60.0, 1e-4)
    smooth = bool((mrac.theta_hat_variation_rate < 1).all())
    better = bool((mrac.max_abs_e < l1.max_abs_e).all() and (mrac.tail_max_abs_e < l1.tail_max_abs_e).all())
    sentence = SENTENCES["smaller-gain"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(smooth, f"{numbers(mrac.theta_hat_variation_rate[0])} per s"),
            sentence.reads(better, f"largest |e| {numbers(mrac.max_abs_e[0])} against {numbers(l1.max_abs_e[0])}, in the tail {numbers(mrac.tail_max_abs_e[0])} against {numbers(l1.tail_max_abs_e[0])}", 1),
        ),
        shows=f"Tail error at the same step: MRAC with Gamma = {section_v.MODERATE_GAIN:g} {mrac.tail_max_abs_e.max():.1g}, L1-AC of Figure 3 {l1.tail_max_abs_e.max():.3g}.",
        measured=        f"MRAC with Gamma = {section_v.MODERATE_GAIN:g} has a tail error of at most {mrac.tail_max_abs_e.max():.3g} and "
        "estimates that vary by at most "
        f"{mrac.theta_hat_variation_rate.max():.3g} per s, L1-AC with Gamma = 1e4 a tail error of at most "
        f"{l1.tail_max_abs_e.max():.3g}",
        how="Section V, h = 1e-4 s, RK4, 60 s, without modelling error",
        listings=(
            by_component(
                f"Tail error and variation of the estimates at h = {section_v.COARSE_STEP:g} s",
                {f"MRAC, Gamma = {section_v.MODERATE_GAIN:g}": mrac, "L1-AC, Gamma = 10000": l1},
            ),
        ),
        would_change="an L1-AC that tracks as well at a gain and step without oscillation; under a delay see filter-reduces-margins",
    )  # fmt: skip


def small_tau() -> Claim:
    """Without modelling error: the smallest tau that the step bears, against h/tau at the solver's limit on the real axis."""
    h = 1e-4
    taus = np.geomspace(1e-5, 1e-4, 41)
    diverged = ~np.isnan(
        figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 10.0, h).diverged_at
    )
    observed, predicted = _largest(taus, diverged), h / RK4.real_limit
    sentence = SENTENCES["small-tau-numerics"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(diverged.any()), f"diverges up to tau = {observed:.3g} s"),
            Reading("the limit is the solver's: h/tau on the real axis, to within a quarter", 0.8 < observed / predicted < 1.25, f"predicted {predicted:.3g} s", "beside"),
        ),
        shows=f"At h = 1e-4 s RK4 diverges up to tau = {observed:.3g} s; its stability limit predicts {predicted:.3g} s.",
        measured=        f"diverges up to tau = {observed:.3g} s; predicted from h/tau = {RK4.real_limit:.3f}: {predicted:.3g} s",
        how="Section V, robust MRAC, RK4, h = 1e-4 s, 10 s, 41 values of tau from 1e-5 to 1e-4 s",
        listings=(
            table(
                "The robust MRAC around the limit h/tau of the solver",
                {
                    "": ("largest tau that diverges", "predicted limit", "smallest tau that is borne"),
                    "tau [s]": (observed, predicted, float(taus[~diverged].min(initial=np.inf))),
                    "h/tau": (h / observed, RK4.real_limit, h / float(taus[~diverged].min(initial=np.inf))),
                },
            ),
        ),
        would_change="a solver whose stability does not depend on h/tau, or a tau below the limit that is borne",
    )  # fmt: skip


def _largest(values: Array, chosen: Array) -> float:
    return float(values[chosen].max()) if chosen.any() else float("nan")


ROWS = (
    Measurement(
        come_and_go, 0.1, {"numerical-oscillation": "the oscillations are numerical"}, place=120, quick=True, judges_runs=True
    ),
    Measurement(without_filter, 0.2, {"oscillation-without-filter": "the filter does not cause the oscillations"}, place=140),
    Measurement(smaller_gain, 0.2, {"smaller-gain": "a smaller gain removes the oscillations"}, place=150),
    Measurement(small_tau, 0.4, {"small-tau-numerics": "a very small tau fails numerically"}, place=160),
)
