"""Claims on the cause of the oscillations, their beginning and their remedies."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.controllers import Mrac
from barbalat.controllers.sampled import Sampled
from barbalat.linear.margins import margins
from barbalat.papers.claim import Claim, Measurement, numbers, short, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs, by_component, figures
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers import RK4
from barbalat.validate import Array


def come_and_go(runs: Runs) -> Claim:
    """Compare the total variation at the steps and gains of Figures 3, 4 and 5."""
    rates = [
        np.array(result.figures["theta_hat_variation_rate"])
        for result in (runs.coarse["L1"], runs.fine["L1, gamma 1e4"], runs.fine["L1, gamma 1e6"])
    ]
    gone, back = bool((rates[1] < rates[0] / 1e3).all()), bool((rates[2] > rates[1] * 1e3).all())
    sentence = SENTENCES["numerical-oscillation"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(gone, f"{numbers(rates[0])} per s at Figure 3's step and {numbers(rates[1])} at Figure 4's"),
            sentence.reads(back, f"{numbers(rates[2])} per s at Figure 5's gain", 1),
        ),
        shows=f"The estimates vary by {rates[0][0]:.3g} per s in Figure 3, by {rates[1][0]:.2g} at a tenth of the step, and "
        f"by {rates[2][0]:.3g} in Figure 5.",
        measured=        f"variation of the estimates in the tail: {span(rates[0])} per s at Figure 3's gain and step, "
        f"{span(rates[1])} at Figure "
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
        would_change="an oscillation that remains as the step is reduced; own-oscillation measures the ringing of the exact "
            "solution",
    )  # fmt: skip


FILTERS_TRIED = (0.001, 0.005, section_v.KAPPA, 0.04)
"""Values of kappa in (6) [s], up to nearly the largest that Theorem 1 (ii) admits, 0.0434 s."""


def without_filter() -> Claim:
    """Compare the estimates of the standard MRAC with those of filtered schemes, from fast to slow filters, at Figure 3's gain
    and step."""
    given = section_v.problem()
    rate = figures([(given, Mrac(gamma=1e4))], 60.0, 1e-4).theta_hat_variation_rate[0]
    filtered = figures([(given, section_v.l1("L1", 1e4, kappa)) for kappa in FILTERS_TRIED], 60.0, 1e-4).theta_hat_variation_rate
    sentence, least = SENTENCES["oscillation-without-filter"], min(float(rate.min()), float(filtered.min()))
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(least > 1e3, f"{span(filtered)} per s with the filters and {numbers(rate)} without one"),),
        shows=f"With every filter (6) tried, kappa = {span(FILTERS_TRIED)} s, the estimates vary by at least "
        f"{short(filtered.min())} per s; without a filter by {short(rate.min())}.",
        measured=f"variation of the estimates per s: {numbers(rate)} without a filter, {span(filtered)} with "
        f"{len(FILTERS_TRIED)} filters, {span(filtered / rate)} times as much",
        how="Section V, Gamma = 1e4, h = 1e-4 s, RK4, 60 s",
        listings=(
            table(
                "The variation of the estimates in the tail [1/s]",
                {"scheme": ("MRAC, no filter", *(f"L1-AC, kappa = {kappa:g} s" for kappa in FILTERS_TRIED))}
                | {name: (rate[i], *filtered[:, i]) for i, name in enumerate(("first", "second"))},
            ),
        ),
        would_change="a filter (6) with which the estimates are quiet at this gain and step",
    )  # fmt: skip


RESOLVING_STEP = 2e-5
"""A step [s] with which h omega_a is at most 1.4 at Figure 3's gain."""
CREST = 50.0
"""The crest of Section V's command."""


def smaller_gain() -> Claim:
    """Test a moderate gain at the same step."""
    given = section_v.problem()
    mrac = figures([(given, Mrac(gamma=section_v.MODERATE_GAIN))], 60.0, 1e-4)
    l1 = figures([(given, section_v.l1("L1", 1e4))], 60.0, 1e-4)
    resolved = figures([(given, section_v.l1("L1", 1e4))], 60.0, RESOLVING_STEP)
    tolerated = margins(around_equilibrium(given, Mrac(gamma=section_v.MODERATE_GAIN), CREST)).delay
    smooth = bool((mrac.theta_hat_variation_rate < 1).all())
    better = bool((mrac.max_abs_e < l1.max_abs_e).all() and (mrac.tail_max_abs_e < l1.tail_max_abs_e).all())
    sentence = SENTENCES["smaller-gain"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(smooth, f"{numbers(mrac.theta_hat_variation_rate[0])} per s"),
            sentence.reads(better, f"the largest |e| is {numbers(mrac.max_abs_e[0])} with MRAC and {numbers(l1.max_abs_e[0])} "
            f"with L1-AC, and in the tail {numbers(mrac.tail_max_abs_e[0])} and {numbers(l1.tail_max_abs_e[0])}", 1),
            Reading(
                f"MRAC's errors are also smaller than those of L1-AC at h = {RESOLVING_STEP:g} s, a step that resolves "
                f"L1-AC's gain",
                bool((mrac.max_abs_e < resolved.max_abs_e).all() and (mrac.tail_max_abs_e < resolved.tail_max_abs_e).all()),
                f"the largest |e| of L1-AC is then {numbers(resolved.max_abs_e[0])}, and in the tail "
                f"{numbers(resolved.tail_max_abs_e[0])}",
                "beside",
            ),
        ),
        shows=f"Without modelling error MRAC's tail error is {mrac.tail_max_abs_e.max():.1g}; Figure 3's L1-AC has "
        f"{l1.tail_max_abs_e.max():.3g}, or {resolved.tail_max_abs_e.max():.3g} with a resolving step. MRAC's exact delay margin "
        f"at r = 50 is {tolerated:.1e} s.",
        measured=        f"MRAC with Gamma = {section_v.MODERATE_GAIN:g} has a tail error of at most "
            f"{mrac.tail_max_abs_e.max():.3g} and estimates that vary by at most {mrac.theta_hat_variation_rate.max():.3g} per "
            f"s. L1-AC with Gamma = 1e4 has a tail error of at most {l1.tail_max_abs_e.max():.3g}. Around the crest of the "
            f"command, r = {CREST:g}, that MRAC loop has an exact delay margin of {tolerated:.2g} s; with a longer delay its "
            f"estimates oscillate. The row gain-reduces-margins has the margins of both schemes",
        how="Section V, h = 1e-4 s, RK4, 60 s, without modelling error; the delay margin follows from the exact linearisation, "
        "including the law, around a constant command",
        listings=(
            by_component(
                f"Tail error and variation of the estimates at h = {section_v.COARSE_STEP:g} s",
                {f"MRAC, Gamma = {section_v.MODERATE_GAIN:g}": mrac, "L1-AC, Gamma = 10000": l1},
            ),
        ),
        would_change="an L1-AC loop that tracks as well at a gain and step without oscillation; filter-reduces-margins treats "
        "delays",
    )  # fmt: skip


def small_tau() -> list[Claim]:
    """Compare the smallest tau at which a run without modelling error is stable with the solver's limit of h/tau on the real
    axis."""
    h = 1e-4
    taus = np.append(np.geomspace(1e-5, 1e-4, 41), section_v.TAU)
    diverged = ~np.isnan(
        figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 10.0, h).diverged_at
    )
    observed, predicted = _largest(taus, diverged), h / RK4.real_limit
    sentence = SENTENCES["small-tau-numerics"]
    may_fail = Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(diverged.any()), f"diverges for tau up to {observed:.3g} s"),
            Reading("the limit is the solver's: h/tau on the real axis, to within a "
            "quarter", 0.8 < observed / predicted < 1.25, f"predicted {predicted:.3g} s", "beside"),
        ),
        shows=f"At h = 1e-4 s RK4 diverges for tau up to {observed:.3g} s; its stability limit predicts {predicted:.3g} s.",
        measured=        f"RK4 diverges for tau up to {observed:.3g} s; h/tau = {RK4.real_limit:.3f} predicts {predicted:.3g} s",
        how=SMALL_TAUS,
        listings=(
            table(
                "The robust MRAC around the limit h/tau of the solver",
                {
                    "": ("largest tau that diverges", "predicted limit", "smallest tau that is tolerated"),
                    "tau [s]": (observed, predicted, float(taus[~diverged].min(initial=np.inf))),
                    "h/tau": (h / observed, RK4.real_limit, h / float(taus[~diverged].min(initial=np.inf))),
                },
            ),
        ),
        would_change="a solver whose stability does not depend on h/tau, or a tau below the limit that does not diverge",
    )  # fmt: skip
    return [may_fail, _no_problems(taus, diverged, observed)]


SMALL_TAUS = f"Section V, robust MRAC, {MENDED}, RK4, h = 1e-4 s, 10 s; 41 values of tau from 1e-5 to 1e-4 s, and 0.5 s"
UNCHANGED_SHARE = 1e-3
"""The step counts as harmless if a tenth of it changes no error and no control by more than this fraction."""


def _no_problems(taus: Array, diverged: Array, observed: float) -> Claim:
    """Test the conclusion's sentence at Section V's settings. The effect of very small tau, from the previous row's runs, is
    shown beside it."""
    sentence, above = SENTENCES["no-numerical-problems"], ~diverged[taus > observed]
    member = (section_v.problem(), section_v.robust_mrac("r"))
    coarse, fine = (figures([member], section_v.T_END, h) for h in (section_v.COARSE_STEP, section_v.FINE_STEP))
    rate, changed = float(coarse.theta_hat_variation_rate.max()), _changed(coarse, fine)
    euler = figures(
        [(section_v.problem(), Sampled(member[1], section_v.COARSE_STEP, discretization="euler"))],
        section_v.T_END,
        section_v.COARSE_STEP,
    )
    lost = bool(np.isfinite(coarse.diverged_at).any())
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(
                not lost and rate < 1 and changed < UNCHANGED_SHARE,
                f"{'lost' if lost else 'not lost'}; the estimates vary by {rate:.1g} per s. Reducing the step to a tenth "
                f"changes errors and control by a fraction of at most {changed:.0e}",
            ),
            Reading("sampling the robust MRAC at 10 kHz, with explicit Euler steps and the control held between samples, changes "
            "its errors by less than a hundredth", _changed(euler, fine) < 0.01, "they change by a fraction of at most "
            f"{_changed(euler, fine):.1g}", "beside"),
            Reading("at any tau, without modelling error, RK4 at the paper's step does not diverge within 10 "
            "s", not diverged.any(), f"{diverged.sum()} of {len(taus)} values of tau diverge, up to {observed:.3g} s; "
                f"{above.sum()} of {len(above)} larger values do not", "beside"),
        ),
        shows=f"At Section V's tau = {section_v.TAU:g} s, reducing the step to a tenth changes every result by a fraction of at "
        f"most {changed:.0e}; below {observed:.2g} s RK4 diverges, as Section III.B warns.",
        measured=f"at Section V's settings the estimates vary by {rate:.1g} per s in the tail, and reducing the step to a tenth "
            f"changes the largest errors and the largest control by a fraction of {changed:.1g}. The runs diverge at "
            f"{diverged.sum()} of {len(taus)} values of tau, up to {observed:.3g} s (see small-tau-numerics)",
        how=f"Section V, robust MRAC, {MENDED}, RK4, h = {section_v.COARSE_STEP:g} and {section_v.FINE_STEP:g} s, "
        f"{section_v.T_END:g} s, every step; small tau: {SMALL_TAUS}",
        listings=(
            table(
                "The robust MRAC of Section V at the paper's step, at a tenth of it, and sampled",
                {
                    "": ("RK4, h = 1e-4 s", "RK4, h = 1e-5 s", "Euler steps at 10 kHz"),
                    **{f"max |e_{i + 1}|": [run.max_abs_e[0, i] for run in (coarse, fine, euler)] for i in range(2)},
                    **{f"|e_{i + 1}|, tail": [run.tail_max_abs_e[0, i] for run in (coarse, fine, euler)] for i in range(2)},
                    "max |u|": [float(np.ravel(run.max_abs_u)[0]) for run in (coarse, fine, euler)],
                },
            ),
        ),
        would_change="fails: a run at Section V's tau that diverges or leaves its limits, oscillates or depends on the step. "
        "The sentence does not mention other values of tau",
    )  # fmt: skip


def _changed(one: Metrics, other: Metrics) -> float:
    """Return the largest relative difference in the largest error, in the tail error and in the control."""
    pairs = ((getattr(run, name) for run in (one, other)) for name in ("max_abs_e", "tail_max_abs_e", "max_abs_u"))
    return max(float(np.abs(np.ravel(a) / np.ravel(b) - 1).max()) for a, b in pairs)


def _largest(values: Array, chosen: Array) -> float:
    return float(values[chosen].max()) if chosen.any() else float("nan")


ROWS = (
    Measurement(
        come_and_go, 0.1, {"numerical-oscillation": "the oscillations are numerical"}, place=120, quick=True, judges_runs=True
    ),
    Measurement(without_filter, 0.4, {"oscillation-without-filter": "the filter does not remove the oscillations"}, place=140),
    Measurement(smaller_gain, 0.5, {"smaller-gain": "a smaller gain removes the oscillations"}, place=150),
    Measurement(
        small_tau,
        0.8,
        {
            "small-tau-numerics": "a very small tau fails numerically",
            "no-numerical-problems": "no numerical problems with the robust MRAC",
        },
        place=160,
    ),
)
