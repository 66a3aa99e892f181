"""Claims on the oscillations: whose they are, where they begin, what removes them."""

from __future__ import annotations

import numpy as np

from barbalat.controllers import Mrac
from barbalat.papers.claim import Claim, Measurement, Reading, numbers, of_readings, span, table, verdict
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs, by_component, figures
from barbalat.solvers import RK4
from barbalat.validate import Array


def come_and_go(runs: Runs) -> Claim:
    """The total variation at the steps and gains of Figures 3, 4, 5."""
    rates = [
        np.array(result.figures["theta_hat_variation_rate"])
        for result in (runs.coarse["L1"], runs.fine["L1, gamma 1e4"], runs.fine["L1, gamma 1e6"])
    ]
    gone, back = bool((rates[1] < rates[0] / 1e3).all()), bool((rates[2] > rates[1] * 1e3).all())
    return Claim(
        "numerical-oscillation", "Section V, discussion of Figures 3 to 5", "The oscillations are numerical: gone at h = 1e-5 s, back at Gamma = 1e6",
        verdict(holds=gone and back),
        f"variation of the estimates in the tail: {span(rates[0])} per s at Figure 3's gain and step, {span(rates[1])} at Figure "
        f"4's step, {span(rates[2])} at Figure 5's gain",
        "Figures 3, 4, 5, every step",
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
        tested="the variation of both estimates in the tail: a thousandth and less at a tenth of the step, a thousand times that and more at Figure 5's gain",
        number=f"an estimate varies {rates[0][0] / rates[1][0]:.2g} times less at h = {section_v.FINE_STEP:g} s",
        would_change="an oscillation that stays as the step falls; what the equations themselves ring is the row own-oscillation",
    )  # fmt: skip


def without_filter() -> Claim:
    """The standard MRAC at the gain and step of Figure 3."""
    rate = figures([(section_v.problem(), Mrac(gamma=1e4))], 60.0, 1e-4).theta_hat_variation_rate[0]
    filtered = figures([(section_v.problem(), section_v.l1("L1", 1e4))], 60.0, 1e-4).theta_hat_variation_rate[0]
    return Claim(
        "oscillation-without-filter", "Abstract; Section V, discussion of Figures 3 to 5", "The filter does not cause the oscillations and does not remove them from the estimates",
        verdict(holds=bool((rate > 1e3).all() and (filtered > 1e3).all())),
        f"variation of the estimates per s: {numbers(rate)} without filter, {numbers(filtered)} with it, {span(filtered / rate)} times as much",
        "Section V, Gamma = 1e4, h = 1e-4 s, RK4, 60 s",
        listings=(
            table(
                "The variation of the estimates in the tail [1/s]",
                {"scheme": ("MRAC, no filter", "L1-AC"), "first": (rate[0], filtered[0]), "second": (rate[1], filtered[1])},
            ),
        ),
        tested="the variation of both estimates in the tail at Figure 3's gain and step: above 1000 per s with the filter and without",
        number=f"estimates vary {(filtered / rate).min():.2g} times as much with the filter",
        would_change="estimates that are quiet with the filter, or without it, at this gain and step",
    )  # fmt: skip


def smaller_gain() -> Claim:
    """A moderate gain at the same step."""
    given = section_v.problem()
    mrac = figures([(given, Mrac(gamma=section_v.MODERATE_GAIN))], 60.0, 1e-4)
    l1 = figures([(given, section_v.l1("L1", 1e4))], 60.0, 1e-4)
    smooth = bool((mrac.theta_hat_variation_rate < 1).all())
    better = bool((mrac.max_abs_e < l1.max_abs_e / 10).all() and (mrac.tail_max_abs_e < l1.tail_max_abs_e / 10).all())
    readings = (
        Reading("the oscillations are gone", verdict(holds=smooth), f"{numbers(mrac.theta_hat_variation_rate[0])} per s"),
        Reading("the plain MRAC then tracks better, by ten times and more", verdict(holds=better), f"{numbers(mrac.tail_max_abs_e[0])} in the tail"),
    )  # fmt: skip
    return Claim(
        "smaller-gain", "Abstract; Section V, discussion of Figures 3 to 5; Section VI", "Reducing the gain removes the oscillations, and the plain MRAC then tracks better than L1-AC",
        of_readings(readings),
        f"MRAC with Gamma = {section_v.MODERATE_GAIN:g} has a tail error of at most {mrac.tail_max_abs_e.max():.3g} and "
        "estimates that vary by at most "
        f"{mrac.theta_hat_variation_rate.max():.3g} per s, L1-AC with Gamma = 1e4 a tail error of at most "
        f"{l1.tail_max_abs_e.max():.3g}",
        "Section V, h = 1e-4 s, RK4, 60 s, without modelling error",
        listings=(
            by_component(
                f"Tail error and variation of the estimates at h = {section_v.COARSE_STEP:g} s",
                {f"MRAC, Gamma = {section_v.MODERATE_GAIN:g}": mrac, "L1-AC, Gamma = 10000": l1},
            ),
        ),
        number=f"tail error of L1-AC over MRAC's: {(l1.tail_max_abs_e / mrac.tail_max_abs_e).min():.2g} times",
        readings=readings,
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
    return Claim(
        "small-tau-numerics", "Section III.B, after Theorem 2", "A very small tau fails numerically even without modelling error",
        verdict(holds=0.8 < observed / predicted < 1.25),
        f"diverges up to tau = {observed:.3g} s; predicted from h/tau = {RK4.real_limit:.3f}: {predicted:.3g} s",
        "Section V, robust MRAC, RK4, h = 1e-4 s, 10 s, 41 values of tau from 1e-5 to 1e-4 s",
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
        tested="the largest tau that diverges within 10 s at h = 1e-4 s, over the tau at which the solver's limit is passed",
        number=f"largest tau that diverges over predicted: {observed / predicted:.2f}",
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
