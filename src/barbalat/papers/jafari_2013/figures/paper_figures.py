"""Figures 2-5, with the paper's statements about them as measured checks, and one added figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.papers.claim import Claim, Listing, Measurement, numbers, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.papers.paper import ADDED_FIGURE, Check, PaperFigure
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.result import Result
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

THETA = np.array([4.0, -3.0])


def paper_figures(runs: Runs) -> list[PaperFigure]:
    """Return all figures in the paper's order, and the added one last."""
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
            f"max |e| is {numbers(transient)}, and {numbers(without)} without an auxiliary input",
        ),
        Check(
            "the estimates converge to the true values",
            distance < 1e-3,  # a line on an axis of 10 cannot show a smaller distance
            f"|theta_hat - theta*| = {distance:.2g} at the end",
        ),
    )
    return PaperFigure(
        key="2",
        title=f"Figure 2: robust MRAC, {MENDED}",
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
            row="bias-kappa",
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
            "the estimates no longer oscillate permanently between the projection bounds",
            not _sweeps(shown),
            _swept(shown),
        ),
        Check(
            "the high-frequency oscillation of the estimates disappears at the smaller step",
            bool((factor > 1e3).all()),  # from kilohertz sweeps to one slow wave with the command's period
            f"the total variation is {numbers(rate)} per s in the tail, {numbers(factor)} times smaller than at h = 1e-4 s",
            row="numerical-oscillation",
        ),
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
        checks=(sweeps_the_bounds(shown), diverges(free)),
    )


def _added(runs: Runs) -> PaperFigure:
    mrac, robust, filtered = (runs.coarse[name] for name in ("MRAC", "Robust MRAC", "L1"))
    peaks = [of_run(r, "max_abs_e") for r in (mrac, robust, filtered)]
    tails = [of_run(r, "tail_max_abs_e") for r in (mrac, robust, filtered)]
    checks = (
        Check(
            "with a moderate gain the standard MRAC tracks better than L1-AC at the same step",
            bool((peaks[0] < peaks[2]).all() and (tails[0] < tails[2]).all()),
            f"max |e| is {numbers(peaks[0])} with MRAC and {numbers(peaks[2])} with L1-AC; in the tail it is {numbers(tails[0])} "
            f"and {numbers(tails[2])}",
        ),
    )
    return PaperFigure(
        key=ADDED_FIGURE,
        title="Added: the standard MRAC with a moderate gain, for comparison",
        caption=f"MRAC (3)-(4) with Gamma = {section_v.MODERATE_GAIN:g}; robust MRAC and L1-AC as in Figures 2 and 3; h = 1e-4 s",
        results={r.name: r for r in (mrac, robust, filtered)},
        checks=checks,
    )


def as_described(runs: Runs) -> Claim:
    """Return Figures 2-5 as a row of the ledger. All checks are shown beside each figure, including those that other rows
    decide."""
    shown = [figure for figure in paper_figures(runs) if figure.key != ADDED_FIGURE]
    checks = [check for figure in shown for check in figure.checks]
    own = [check for check in checks if not check.row]
    holding, elsewhere = sum(check.holds for check in own), sorted({check.row for check in checks if check.row})
    sentence = SENTENCES["figures-2-5"]
    printed, without = (
        of_run(runs.coarse[name], "max_abs_e")
        for name in (f"tau {section_v.TAU}, printed sign", "Robust MRAC, no auxiliary input")
    )
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(holding == len(own), f"{holding} of {len(own)} hold"),
            Reading(
                "Figure 2 with (14) as printed: the auxiliary input improves the transient",
                bool((printed < without).all()),
                f"max |e_i| is {numbers(printed)} with (14) as printed and {numbers(without)} without an auxiliary input",
                "beside",
            ),
        ),
        shows=f"{holding} of {len(own)} statements hold for {MENDED}. Figure 2's peak error is "
        f"{of_run(shown[0].shown[0], 'max_abs_e')[0]:.3g}; it is {printed[0]:.3g} as printed and {without[0]:.3g} without u_a. "
        "No curve is compared.",
        measured=f"{holding} of {len(own)} statements of the captions and the text hold. Other rows decide the remaining "
        f"statements about these figures: {', '.join((*elsewhere, 'loss-of-learning, any-command'))}",
        how=f"each statement is a measured check, and its number is shown beside the figure; {MENDED}, Section V's command. No "
        f"curve is compared, because no image of the figures is available; the fifth figure of the report is our own",
        listings=(_counted(shown),),
        would_change="a statement about a figure that fails with the solver, gain and step that the paper names",
    )  # fmt: skip


def without_projection(runs: Runs) -> Claim:
    """Run L1-AC without projection at the steps of Figures 3, 4 and 5."""
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
        measured=        f"L1-AC without projection diverges at the gain and step of Figures 3 and 5 ({times}). At those of "
            f"Figure 4 it stays bounded, with max |e| {numbers(of_run(smooth, 'max_abs_e'))}; {_one_step_before(ends[0])}. The "
            f"robust MRAC of Figure 2 stays bounded too, with max |e| {numbers(of_run(robust, 'max_abs_e'))}",
        how=f"RK4, 60 s; the robust MRAC has {MENDED}. The same equations are bounded at a tenth of the step (see the numerics "
            f"below the figures)",
        listings=(_ends((ends[0], smooth.diverged_at, ends[1])),),
        would_change="an RK4 run without projection that stays bounded there, or that diverges at Figure 4's gain and step; "
        "stiff-solvers treats implicit steps",
    )  # fmt: skip


def _one_step_before(lost: float | None) -> str:
    """Return the size of each signal one step before Figure 3's run without projection is lost, at ``lost`` [s]."""
    if lost is None:
        return "Figure 3's run is not lost"
    gamma, h = section_v.FIGURE_4_GAIN, section_v.COARSE_STEP
    until = Simulation(t_end=(round(lost / h) - 1) * h, dt=h)
    (run,) = simulate(section_v.problem(), [section_v.l1("L1", gamma, projection=False)], until).values()
    u, theta_hat, x = float(np.abs(run.u[-1]).max()), float(np.abs(run.theta_hat[-1]).max()), np.abs(run.x[-1])
    return (
        f"one step before Figure 3's run is lost, |u| is {u:.1g}, the larger |theta_hat_i| is {theta_hat:.1g} and |x_2| is "
        f"{x[1]:.1g}; x_1, the integral of x_2, grows last and is {x[0]:.3g}"
    )


def erratum_claim(runs: Runs) -> Claim:
    """Decide the sign of W_c0 in (14) from the dependence of the error on tau."""
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
            sentence.reads(as_printed, f"max |e_i| is {numbers(printed)} at tau = {tau:g} s and {numbers(printed_half)} at "
            f"{half:g} s"),
            Reading("with the sign of the swapping lemma", halved, f"{numbers(derived)} at tau = {tau:g} s, "
            f"{numbers(derived_half)} at {half:g} s", "mended"),
            Reading(
                "with the printed sign, the auxiliary input reduces the largest error compared with no auxiliary input",
                bool((np.minimum(printed, printed_half) < without).all()),
                f"{numbers(printed)} and, at half the tau, {numbers(printed_half)} with the printed sign, and {numbers(without)} "
                "without u_a",
                "beside",
            ),
        ),
        shows=f"Halving tau should halve the error: with the printed sign it goes from {printed[0]:.3g} to "
        f"{printed_half[0]:.3g}, and with the other sign from {derived[0]:.2g} to {derived_half[0]:.2g}.",
        measured=(
            f"from tau = {tau:g} s to {half:g} s max |e_1| goes from {derived[0]:.3g} to {derived_half[0]:.3g} with the sign of "
            f"the swapping lemma, and from {printed[0]:.3g} to {printed_half[0]:.3g} as printed"
        ),
        how="Section V over 60 s, RK4, h = 1e-4 s; a test confirms the swapping lemma's identity itself to rounding",
        listings=(
            table(
                "The largest errors of the transient, with the sign of the swapping lemma and with the printed sign",
                {"tau [s]": (tau, half)}
                | {f"|e_{i + 1}|, lemma": (derived[i], derived_half[i]) for i in range(2)}
                | {f"|e_{i + 1}|, printed": (printed[i], printed_half[i]) for i in range(2)},
            ),
        ),
        would_change="a definition of W_c0 or of the estimation error in the paper's source that makes the printed sign right",
    )  # fmt: skip


def _counted(shown: Sequence[PaperFigure]) -> Listing:
    checks = [(figure.key, check) for figure in shown for check in figure.checks]
    return table(
        "The statements about the figures, and the row that decides each",
        {
            "figure": [key for key, _ in checks],
            "statement": [check.statement for _, check in checks],
            "holds": ["yes" if check.holds else "no" for _, check in checks],
            "decided by": [check.row or "figures-2-5" for _, check in checks],
        },
    )


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
        {"no-projection": "boundedness is due to the projection"},
        place=20,
        quick=True,
        judges_runs=True,
    ),
    Measurement(erratum_claim, 0.1, {"erratum-14": "the sign of W_c0 in (14)"}, place=30, quick=True, judges_runs=True),
)


PARAMETER_BOUND = 5.0
"""The magnitude of the projection's bounds on each component of theta_hat."""


def of_run(result: Result, name: str) -> Array:
    """Return a figure as an array. Entries without a finite value are NaN, with which every comparison fails."""
    return np.array(result.figures[name], dtype=float)


def error_converges(early: Array, tail: Array) -> Check:
    """Check that the error converges to zero in 60 s: in every component it falls to two decades below the error of the first
    quarter."""
    return Check(
        "with Section V's command the tracking error converges to zero",
        bool((tail < early / 100).all()),
        f"max |e| is {numbers(early)} in the first quarter and {numbers(tail)} in the last",
    )


def error_stays(result: Result) -> Check:
    """Check that the error in the tail is about as large as over the whole run."""
    peak, tail = of_run(result, "max_abs_e"), of_run(result, "tail_max_abs_e")
    return Check(
        "the tracking error does not converge to zero",
        bool((tail > peak / 2).all()),  # in the last quarter the error is still of the size of its largest value
        f"max |e| is {numbers(peak)}, and still {numbers(tail)} in the last quarter",
    )


def sweeps_the_bounds(result: Result) -> Check:
    """Check that the estimates swing permanently from bound to bound."""
    return Check("the estimates oscillate permanently between the projection bounds", _sweeps(result), _swept(result))


def _sweeps(result: Result) -> bool:
    """Whether the estimates reach both bounds, with hundreds of sweeps per second. The command alone causes one in 12 s."""
    least, most = of_run(result, "theta_hat_tail_min"), of_run(result, "theta_hat_tail_max")
    return bool((least == -PARAMETER_BOUND).all() and (most == PARAMETER_BOUND).all() and (_sweep_rate(result) > 100).all())


def _sweep_rate(result: Result) -> Array:
    """Return the rate of sweeps across the box, there and back [1/s]."""
    return np.asarray(of_run(result, "theta_hat_variation_rate") / (2 * 2 * PARAMETER_BOUND))


def _swept(result: Result) -> str:
    least, most = of_run(result, "theta_hat_tail_min"), of_run(result, "theta_hat_tail_max")
    return (
        f"in the tail they range from {numbers(least)} to {numbers(most)}; their total variation amounts to "
        f"{numbers(_sweep_rate(result))} full sweeps per s"
    )


def diverges(result: Result) -> Check:
    """Check that a run without projection diverges."""
    at = result.diverged_at
    return Check(
        "without projection all signals become unbounded",
        at is not None,
        "bounded" if at is None else f"diverged at t = {at:.4f} s",
        row="no-projection",
    )
