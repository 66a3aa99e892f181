"""Figures 2-5: what the paper's descriptions say, as measured checks, and one added figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.papers.claim import Claim, Listing, Measurement, numbers, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.paper import ADDED_FIGURE, Check, PaperFigure
from barbalat.run.results.result import Result
from barbalat.validate import Array

THETA = np.array([4.0, -3.0])


def paper_figures(runs: Runs) -> list[PaperFigure]:
    """All figures, in the paper's order, then the added one."""
    return [_figure_2(runs), _figure_3(runs), _figure_4(runs), _figure_5(runs), _added(runs)]


def _figure_2(runs: Runs) -> PaperFigure:
    shown, plain = runs.coarse["Robust MRAC"], runs.coarse["Robust MRAC, no auxiliary input"]
    early = np.abs(shown.e[shown.t <= section_v.T_END / 4]).max(axis=0)
    tail = of_run(shown, "tail_max_abs_e")
    transient, without = of_run(shown, "max_abs_e"), of_run(plain, "max_abs_e")
    distance = float(np.abs(of_run(shown, "theta_hat_final") - THETA).max())
    checks = (
        error_converges(early, tail),
        Check(
            "the auxiliary input improves the transient",
            bool((transient < without).all()),
            f"max |e| {numbers(transient)}, without auxiliary input {numbers(without)}",
        ),
        Check(
            "the estimates converge to the true values",
            distance < 1e-3,  # the drawn line can't show a smaller distance on an axis of 10
            f"|theta_hat - theta*| = {distance:.2g} at the end",
        ),
        bounded(runs.coarse["Robust MRAC, no projection"], "bounded without projection too"),
    )
    return PaperFigure(
        key="2",
        title="Figure 2: robust MRAC (14)-(16)",
        caption=f"tau = {section_v.TAU}, P(0) = {section_v.COVARIANCE0:g} I, c_0 = [1, 1], h = 1e-4 s",
        results={r.name: r for r in (shown, runs.coarse["Robust MRAC, no projection"], plain)},
        checks=checks,
    )


def _figure_3(runs: Runs) -> PaperFigure:
    shown, half, free = (runs.coarse[name] for name in ("L1", "L1, kappa/2", "L1, no projection"))
    ratio = of_run(shown, "tail_max_abs_e") / of_run(half, "tail_max_abs_e")
    checks = (
        error_stays(shown),
        Check(
            f"the steady amplitude of the error is proportional to kappa, to within {100 * PROPORTIONAL_SHARE:.0f} %",
            bool((np.abs(ratio / 2 - 1) < PROPORTIONAL_SHARE).all()),
            f"doubling kappa from 0.01 to 0.02 s multiplies it by {numbers(ratio)}",
        ),
        sweeps_the_bounds(shown),
        diverges(free),
    )
    return PaperFigure(
        key="3",
        title="Figure 3: L1-AC, adaptive gain 1e4, step 1e-4 s",
        caption="kappa = 0.02 s, Gamma = 1e4, h = 1e-4 s",
        results={r.name: r for r in (shown, free, half)},
        checks=checks,
    )


def _figure_4(runs: Runs) -> PaperFigure:
    shown, free = runs.fine["L1, gamma 1e4"], runs.fine["L1, gamma 1e4, no projection"]
    rate = of_run(shown, "theta_hat_variation_rate")
    factor = of_run(runs.coarse["L1"], "theta_hat_variation_rate") / rate
    checks = (
        error_stays(shown),
        Check(
            "the high-frequency oscillation of the estimates is gone at the smaller step",
            bool((factor > 1e3).all()),  # from kilohertz sweeps to one slow wave in the command's rhythm
            f"total variation {numbers(rate)} per s in the tail, {numbers(factor)} times less than at h = 1e-4 s",
        ),
        bounded(free, "bounded without projection at this step"),
    )
    return PaperFigure(
        key="4",
        title="Figure 4: L1-AC, adaptive gain 1e4, step 1e-5 s",
        caption="kappa = 0.02 s, Gamma = 1e4, h = 1e-5 s",
        results={r.name: r for r in (shown, free)},
        checks=checks,
    )


def _figure_5(runs: Runs) -> PaperFigure:
    shown, free = runs.fine["L1, gamma 1e6"], runs.fine["L1, gamma 1e6, no projection"]
    return PaperFigure(
        key="5",
        title="Figure 5: L1-AC, adaptive gain 1e6, step 1e-5 s",
        caption="kappa = 0.02 s, Gamma = 1e6, h = 1e-5 s",
        results={r.name: r for r in (shown, free)},
        checks=(error_stays(shown), sweeps_the_bounds(shown), diverges(free)),
    )


def _added(runs: Runs) -> PaperFigure:
    mrac, robust, filtered = (runs.coarse[name] for name in ("MRAC", "Robust MRAC", "L1"))
    peaks = [of_run(r, "max_abs_e") for r in (mrac, robust, filtered)]
    tails = [of_run(r, "tail_max_abs_e") for r in (mrac, robust, filtered)]
    checks = (
        Check(
            "with a moderate gain the standard MRAC tracks better than L1-AC at the same step",
            bool((peaks[0] < peaks[2]).all() and (tails[0] < tails[2]).all()),
            f"max |e| {numbers(peaks[0])} against {numbers(peaks[2])}; in the tail {numbers(tails[0])} against "
            f"{numbers(tails[2])}",
        ),
    )
    return PaperFigure(
        key=ADDED_FIGURE,
        title="Added: the standard MRAC with a moderate gain beside them",
        caption=f"MRAC (3)-(4) with Gamma = {section_v.MODERATE_GAIN:g}; robust MRAC and L1-AC as in Figures 2 and 3; h = 1e-4 s",
        results={r.name: r for r in (mrac, robust, filtered)},
        checks=checks,
    )


def as_described(runs: Runs) -> Claim:
    """Figures 2-5 as a row of the ledger; the checks stand beside each figure."""
    shown = [figure for figure in paper_figures(runs) if figure.key != ADDED_FIGURE]
    checks = [check for figure in shown for check in figure.checks]
    holding = sum(check.holds for check in checks)
    sentence = SENTENCES["figures-2-5"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(holding == len(checks), f"{holding} of {len(checks)} hold"),),
        shows=f"{holding} of {len(checks)} statements of the text and of the captions hold; no curve is compared.",
        measured=f"{holding} of {len(checks)} statements of the captions and the text hold, {sum(f.reproduced for f in shown)} of "
        f"{len(shown)} figures in all of theirs",
        how="each statement as a measured check, with its number beside the figure. No curve is compared, for no image of the figures is at hand; the fifth figure of the report is ours",
        listings=(_counted(shown),),
        would_change="a statement on a figure that fails at the solver, gain and step that the paper names",
    )  # fmt: skip


def without_projection(runs: Runs) -> Claim:
    """At the steps of Figures 3, 4 and 5."""
    ends = [r.diverged_at for r in (runs.coarse["L1, no projection"], runs.fine["L1, gamma 1e6, no projection"])]
    smooth, robust = runs.fine["L1, gamma 1e4, no projection"], runs.coarse["Robust MRAC, no projection"]
    times = ", ".join("bounded" if at is None else f"t = {at:.4g} s" for at in ends)
    latest = "stays bounded" if None in ends else f"diverges by t = {max(at for at in ends if at is not None):.4g} s"
    sentence = SENTENCES["no-projection"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(None not in ends, f"at Figures 3 and 5: {times}"),
            sentence.reads(smooth.diverged_at is None, f"max |e| {numbers(of_run(smooth, 'max_abs_e'))} at Figure 4's step", 1),
        ),
        shows=f"Without projection L1-AC {latest} at the settings of Figures 3 and 5; at a tenth of the step it "
        f"{'stays bounded' if smooth.diverged_at is None else 'diverges too'}.",
        measured=        f"L1-AC without projection diverges at the gain and step of Figures 3 and 5 ({times}), and stays bounded at those of Figure 4, max |e| "
        f"{numbers(of_run(smooth, 'max_abs_e'))}; the robust MRAC of Figure 2 stays bounded too, "
        f"{numbers(of_run(robust, 'max_abs_e'))}",
        how="RK4, 60 s; the same equations at a tenth of the step are bounded, see the numerics under the figures",
        listings=(_ends((ends[0], smooth.diverged_at, ends[1])),),
        would_change="a run of RK4 without projection that stays bounded there (of implicit steps see stiff-solvers), or diverges at Figure 4's gain and step",
    )  # fmt: skip


def erratum_claim(runs: Runs) -> Claim:
    """The sign of W_c0 in (14), decided by how the error answers to tau."""
    tau, half = section_v.ERRATUM_TAUS
    derived, derived_half, printed, printed_half = (
        of_run(runs.coarse[f"tau {value}{sign}"], "max_abs_e") for sign in ("", ", printed sign") for value in (tau, half)
    )
    halved, as_printed = (
        bool((np.abs(error / of_half / (tau / half) - 1) < PROPORTIONAL_SHARE).all())
        for error, of_half in ((derived, derived_half), (printed, printed_half))
    )
    without = of_run(runs.coarse["Robust MRAC, no auxiliary input"], "max_abs_e")
    sentence = SENTENCES["erratum-14"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(as_printed, f"max |e_i| {numbers(printed)} at tau = {tau:g} s, {numbers(printed_half)} at {half:g} s"),
            Reading("with the sign of the swapping lemma", halved, f"{numbers(derived)} at tau = {tau:g} s, {numbers(derived_half)} at {half:g} s", "mended"),
            Reading(
                "as printed the auxiliary input makes the largest error smaller than none at all does",
                bool((np.minimum(printed, printed_half) < without).all()),
                f"{numbers(printed)} and {numbers(printed_half)} as printed, {numbers(without)} without u_a",
                "beside",
            ),
        ),
        shows=f"Half the tau should halve the error: as printed {printed[0]:.3g} to {printed_half[0]:.3g}, with the other sign {derived[0]:.2g} to {derived_half[0]:.2g}.",
        measured=(
            f"from tau = {tau:g} s to {half:g} s max |e_1| goes from {derived[0]:.3g} to {derived_half[0]:.3g} with the sign of "
            "the swapping "
            f"lemma, from {printed[0]:.3g} to {printed_half[0]:.3g} as printed"
        ),
        how="Section V over 60 s, RK4, h = 1e-4 s; the swapping lemma's identity itself is held to rounding by a test",
        listings=(
            table(
                "The largest errors of the transient, with the sign of the swapping lemma and with the printed one",
                {"tau [s]": (tau, half)}
                | {f"|e_{i + 1}|, lemma": (derived[i], derived_half[i]) for i in range(2)}
                | {f"|e_{i + 1}|, printed": (printed[i], printed_half[i]) for i in range(2)},
            ),
        ),
        would_change="another definition of W_c0 or of the estimation error in the paper's source, with which the printed sign is right",
    )  # fmt: skip


def _counted(shown: Sequence[PaperFigure]) -> Listing:
    hold = [str(sum(check.holds for check in figure.checks)) for figure in shown]
    columns = {"figure": [figure.key for figure in shown], "statements": [str(len(figure.checks)) for figure in shown]}
    return table("The statements on each figure, and how many of them hold", columns | {"hold": hold})


def _ends(diverged_at: Sequence[float | None]) -> Listing:
    settings = {
        "figure": ("3", "4", "5"),
        "Gamma": (1e4, 1e4, 1e6),
        "h [s]": (section_v.COARSE_STEP, section_v.FINE_STEP, section_v.FINE_STEP),
    }
    ends = [np.nan if at is None else at for at in diverged_at]
    return table("L1-AC without projection at the settings of the figures", settings | {"diverges at [s]": ends})


ROWS = (
    Measurement(as_described, 0.1, {"figures-2-5": "Figures 2 to 5 look as described"}, place=10, quick=True, judges_runs=True),
    Measurement(
        without_projection,
        0.1,
        {"no-projection": "boundedness is the projection's doing"},
        place=20,
        quick=True,
        judges_runs=True,
    ),
    Measurement(erratum_claim, 0.1, {"erratum-14": "the sign of W_c0 in (14)"}, place=30, quick=True, judges_runs=True),
)


PARAMETER_BOUND = 5.0
"""Of each component of theta_hat, on either side."""


def of_run(result: Result, name: str) -> Array:
    """A figure as an array; entries without a finite value are NaN, which no comparison lets pass."""
    return np.array(result.figures[name], dtype=float)


def error_converges(early: Array, tail: Array) -> Check:
    """To zero in 60 s: two decades below the first quarter's error in every component."""
    return Check(
        "the tracking error converges to zero",
        bool((tail < early / 100).all()),
        f"max |e| {numbers(early)} in the first quarter, {numbers(tail)} in the last",
    )


def error_stays(result: Result) -> Check:
    """The tail is no smaller than the whole run."""
    peak, tail = of_run(result, "max_abs_e"), of_run(result, "tail_max_abs_e")
    return Check(
        "the tracking error does not converge to zero",
        bool((tail > peak / 2).all()),  # in the last quarter it is still of the size of its largest value
        f"max |e| {numbers(peak)}, in the last quarter still {numbers(tail)}",
    )


def sweeps_the_bounds(result: Result) -> Check:
    """The estimates run from bound to bound without end."""
    least, most = of_run(result, "theta_hat_tail_min"), of_run(result, "theta_hat_tail_max")
    rate = of_run(result, "theta_hat_variation_rate")
    sweeps = rate / (2 * 2 * PARAMETER_BOUND)  # there and back across the box, per second
    permanent = bool((least == -PARAMETER_BOUND).all() and (most == PARAMETER_BOUND).all() and (sweeps > 100).all())
    return Check(
        "the estimates oscillate permanently between the projection bounds, with no learning",
        permanent,  # both bounds reached, hundreds of sweeps a second where the command makes one in 12 s
        f"tail from {numbers(least)} to {numbers(most)}, total variation worth {numbers(sweeps)} full sweeps per s",
    )


def diverges(result: Result) -> Check:
    """A run without projection leaves all bounds."""
    at = result.diverged_at
    return Check(
        "without projection all signals go unbounded",
        at is not None,
        "bounded" if at is None else f"diverged at t = {at:.4f} s",
    )


def bounded(result: Result, statement: str) -> Check:
    """A run to its end."""
    at = result.diverged_at
    return Check(
        statement, at is None, f"max |e| {numbers(of_run(result, 'max_abs_e'))}" if at is None else f"diverged at t = {at:.4f} s"
    )
