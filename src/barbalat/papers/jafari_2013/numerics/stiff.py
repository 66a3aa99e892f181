"""The claim that a solver for stiff problems does not help: implicit methods at a fixed step, and codes with automatic steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.papers.claim import Claim, Listing, Measurement, numbers
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff_methods import NEWTON_STEPS, RINGING_WINDOW, SciPyMethod
from barbalat.papers.jafari_2013.numerics.stiff_runs import (
    AGREEMENT_FACTOR,
    StiffRow,
    StiffSetting,
    agrees,
    cell,
    listing,
    ratio,
    rings_too_much,
)
from barbalat.papers.jafari_2013.sentences import SENTENCES


def stiff_solvers() -> Claim:
    """At the gains and steps of Figures 3 and 5, where RK4 fails: without projection, and with it as the figures are."""
    return _claim(StiffRuns.now())


def stiff_solvers_further() -> Claim:
    """The same, more gains, longer runs of the codes with automatic steps."""
    listings, right, followed = [], PAPER_SETTING.right, []
    for gain in FURTHER_GAINS:
        steps = (section_v.COARSE_STEP, section_v.FINE_STEP)
        rows = [gain.explicit(h) for h in steps] + [gain.implicit(h, midpoint=m) for h in steps for m in (True, False)]
        listings.append(listing(rows, gain.right, gain.gamma))
        followed.append((gain, [row for row in rows[2:] if agrees(row.boxed, gain.right[1], gain.span)]))
    loose = [row for t in LOOSE_TOLERANCES for row in PAPER_SETTING.automatic(LONG_BUDGETS, tolerance=t, t_end=AUTOMATIC_END)]
    compiled: dict[SciPyMethod, int] = {"LSODA": LONG_BUDGETS["LSODA"]}
    longer = PAPER_SETTING.automatic(compiled, tolerance=TOLERANCE, t_end=LONG_AUTOMATIC_END)
    gains = "; ".join(
        f"Gamma = {gain.gamma:g}: {', '.join(f'{row.name}, {row.setting}' for row in rows) or 'none'}" for gain, rows in followed
    )
    codes = "; ".join(f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}" for row in (*loose, *longer))
    more = Reading(
        "at more gains, and codes with automatic steps for longer: none follows the equations",
        not any(rows for _, rows in followed),
        f"implicit steps that follow the equations, with projection: {gains}. Automatic steps: {codes}",
        "beside",
    )
    return _claim(StiffRuns.now(full=True), more, listings=tuple(listings))


def _claim(tried: StiffRuns, *more: Reading, listings: tuple[Listing, ...] = ()) -> Claim:
    right, shown = PAPER_SETTING.right, [*tried.explicit, *tried.fixed, *tried.automatic, *tried.longer, *tried.loose]
    best, plain = tried.fixed[0], tried.explicit[0]
    neighbours = tuple(
        listing(rows, gain.right, gain.gamma) for gain, rows in zip(NEIGHBOURING_SETTINGS, tried.at_neighbours, strict=True)
    )
    return Claim(
        sentence=SENTENCES["stiff-solvers"],
        readings=(*_literal(tried), *_automatic(tried), *_phenomena(tried), _giving_up(tried), *more),
        shows=f"At the paper's h the {best.name} rings {ratio(best.boxed, right[1], best.span):.2f} times the true solution, RK4 {ratio(plain.boxed, right[1], plain.span):.0f} times.",
        measured="ringing of the estimates over that of the converged solution, without / with projection: "
        + "; ".join(f"{row.name}, {row.setting}: {cell(row, 0, right)} / {cell(row, 1, right)}" for row in (*tried.explicit, *tried.fixed))
        + ". Automatic steps: "
        + "; ".join(
            f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}, {row.free.evaluations} evaluations, {row.free.seconds:.1f} s"
            for row in (*tried.automatic, *tried.longer, *tried.loose)
        )
        + f". {NO_SINGULARITY}",
        how=        f"right: within a factor {AGREEMENT_FACTOR:g} of RK4 at h = {PAPER_SETTING.converged_step:g} s, which rings by {numbers(right[0].ringing(*TAIL_WINDOW))} without and "
        f"{numbers(right[1].ringing(*TAIL_WINDOW))} with projection; last quarter of {T_END:g} s. Implicit steps: {NEWTON_STEPS} Newton steps of the exact Jacobian, "
        f"the estimate limited at the step's end. Automatic steps: with projection, exact Jacobian, last 0.1 s; up to {AUTOMATIC_END:g} s no estimate is "
        f"beyond {_highest(AUTOMATIC_END):.1f} and the projection at rest; the phenomenon begins at {tried.explicit[0].free.reached:.1f} s",
        listings=(listing(shown, right, PAPER_SETTING.gamma), *neighbours, listing(tried.at_figure_5, FIGURE_5.right, FIGURE_5.gamma), *listings),
        would_change="holds: implicit steps, and codes at tight tolerances, none of which follows the equations with the projection",
        sharpened=FULL_COMMAND,
    )  # fmt: skip


def _literal(tried: StiffRuns) -> tuple[Reading, Reading]:
    """No solver at Figure 3's gain follows the equations; and a singularity: a converged solution that ends, against the proof that none does."""
    sentence, boxed = SENTENCES["stiff-solvers"], PAPER_SETTING.right[1]
    ends = min(path.reached for path in PAPER_SETTING.right)
    rows = [*tried.fixed, *tried.automatic, *tried.longer, *tried.loose]
    following = [row for row in rows if agrees(row.boxed, boxed, row.span)]
    return (
        sentence.reads(
            not following,
            f"{len(following)} of {len(rows)} follow them: {'; '.join(f'{row.name}, {row.setting} {cell(row, 1, PAPER_SETTING.right)}' for row in following) or 'none'}",
        ),
        sentence.reads(
            any(path.lost for path in PAPER_SETTING.right),
            f"the converged solution reaches {ends:g} s, its estimates at most {_highest(T_END):.2g}. {NO_SINGULARITY}",
            1,
        ),
    )


def _automatic(tried: StiffRuns) -> tuple[Reading, ...]:
    """Codes that choose their steps: tight, to where the phenomenon has begun and past the first second on a bound; and loose."""
    tight = [*tried.automatic, *tried.longer]
    failing = _failing(tried)
    return (
        Reading(
            f"the solver chooses its steps at a tight tolerance, {TOLERANCE:g} or {LOOSE_TOLERANCES[1]:g}: none follows the equations",
            not any(agrees(row.boxed, PAPER_SETTING.right[1], row.span) for row in tight),
            "; ".join(f"{row.name} to {row.span[1]:g} s {cell(row, 1, PAPER_SETTING.right)}" for row in tight),
        ),
        Reading(
            f"the solver chooses its steps at a loose tolerance, {LOOSE_TOLERANCES[0]:g}: each rings beyond the equations, or gives up",
            len(failing) == len(tried.loose),
            "; ".join(f"{row.name} {cell(row, 1, PAPER_SETTING.right)}{_amplitude(row)}" for row in tried.loose)
            + f"; the converged solution rings by {PAPER_SETTING.right[1].ringing(*tried.loose[0].span).max():.2g}. The bounds are 5 and -5",
        ),
    )


def _failing(tried: StiffRuns) -> list[StiffRow]:
    """The runs at the loose tolerance that show something of Figures 3 and 5: more ringing than the equations', or no end."""
    return [row for row in tried.loose if row.boxed.lost or rings_too_much(row.boxed, PAPER_SETTING.right[1], row.span)]


def _phenomena(tried: StiffRuns) -> tuple[Reading, ...]:
    """Other gains, and runs without projection: beside the literal reading, which speaks of every solver at Figure 3's gain."""
    at_paper = [row for row in tried.fixed if row.setting == tried.fixed[0].setting]
    pairs = [(gain, row) for gain, rows in zip(NEIGHBOURING_SETTINGS, tried.at_neighbours, strict=True) for row in rows[1:]]
    return (
        Reading(
            f"at {' and '.join(f'Gamma = {gain.gamma:g}' for gain in NEIGHBOURING_SETTINGS)}, Figure 3's step: implicit steps swing beyond the equations",
            all(row.boxed.lost or rings_too_much(row.boxed, gain.right[1], gain.span) for gain, row in pairs),
            "; ".join(f"Gamma = {gain.gamma:g}, {row.name} {cell(row, 1, gain.right)}" for gain, row in pairs),
            "beside",
        ),
        Reading(
            f"at Figure 5's gain and step, with the projection, to {FIGURE_5.t_end:g} s: no implicit step follows the equations",
            not any(agrees(row.boxed, FIGURE_5.right[1], row.span) for row in tried.at_figure_5[1:]),
            "; ".join(f"{row.name} {cell(row, 1, FIGURE_5.right)}" for row in tried.at_figure_5),
            "beside",
        ),
        Reading(
            "signals that go unbounded, at Figure 3's gain, without projection",
            all(row.free.lost for row in tried.fixed),
            f"{sum(row.free.lost for row in tried.fixed)} of {len(tried.fixed)} implicit runs are lost",
            "beside",
        ),
        Reading(
            "a ringing of the solver's own, beyond that of the equations, at Figure 3's gain and step, without projection",
            all(rings_too_much(row.free, PAPER_SETTING.right[0], TAIL_WINDOW) for row in at_paper),
            "; ".join(f"{row.name} {cell(row, 0, PAPER_SETTING.right)}" for row in at_paper)
            + ". The midpoint rule is stable at any step, but damps nothing of what it does not resolve: no swing between the bounds, no signal unbounded",
            "beside",
        ),
    )


def _amplitude(row: StiffRow) -> str:
    return "" if row.boxed.lost else f", by {row.boxed.ringing(*row.span).max():.2g}"


NO_SINGULARITY = (
    "Of (1)-(8) without modelling error the solution has no singularity, at any Gamma: V of Theorem 1 does not grow, whatever u is, so theta_hat is bounded; x, x_hat "
    "and the filter then obey linear equations with bounded coefficients and stay finite at all times"
)


def _giving_up(tried: StiffRuns) -> Reading:
    """What a code says that meets a singularity, or takes something for one: its step falls below what doubles can add to t."""
    codes = [*tried.automatic, *tried.longer, *tried.loose]
    gave_up = [f"{row.name}, {row.setting}, at {row.boxed.reached:.4g} s" for row in codes if row.boxed.lost]
    return Reading(
        "a code gives up, as if it met a singularity",
        bool(gave_up),
        f"{len(gave_up)} of {len(codes)} runs with automatic steps gave up" + "".join(f": {said}" for said in gave_up),
        "beside",
    )


def _highest(until: float) -> float:
    """The largest estimate of the converged solution until then."""
    return float(np.nanmax(np.abs([(p.least, p.greatest) for p in PAPER_SETTING.right])[:, :, : round(until / RINGING_WINDOW)]))


ROWS = (
    Measurement(
        stiff_solvers,
        12.0,
        {"stiff-solvers": "solvers for stiff problems"},
        place=180,
        sharper=stiff_solvers_further,
        sharper_seconds=190.0,
        shares="converged",
    ),
)


T_END = 20.0
TAIL_WINDOW = (0.75 * T_END, T_END)
AUTOMATIC_END = 3.0
"""[s]: past the time at which RK4 has left the solution at the paper's step, and before any estimate reaches its bound."""
LATE_WINDOW = (AUTOMATIC_END - 0.1, AUTOMATIC_END)
LONG_AUTOMATIC_END = 10.0
"""[s]: past the time that an estimate lies on its bound, from 6.5 to 9.3 s."""
TOLERANCE = 1e-7
"""Relative, of the codes with automatic steps; to 3 s at 1e-6 they damp the ringing by a quarter and more (docs/claims.md)."""
EVALUATION_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 1_000_000}
"""It needs half of that. SciPy's BDF and Radau are Python, 20 to 40 us for each evaluation, half a minute each: ``--full`` has them."""
LONG_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 3_000_000, "BDF": 3_000_000, "Radau": 3_000_000}
"""What they need to ``AUTOMATIC_END`` at ``LOOSE_TOLERANCES``."""
LOOSE_TOLERANCES = (1e-3, 1e-6)
"""The first is what MATLAB's ode15s has unless told otherwise: what the paper's authors would have got without a word."""
LOOSE_END = 4.0
"""[s]: of the plain command at the loose tolerance; ``--full`` goes to ``LONG_AUTOMATIC_END`` with all four codes, in a minute and more."""
FULL_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 30_000_000, "BDF": 30_000_000, "Radau": 30_000_000}
"""Evaluations to ``LONG_AUTOMATIC_END`` at the loose tolerance: more than any of them needs to arrive, or to give up."""
CONVERGED_STEPS = (1e-6, 5e-7)
"""Steps [s] at which h |lambda| is 0.07 and less: two that agree show what the equations do."""
PAPER_SETTING = StiffSetting(1e4, T_END, CONVERGED_STEPS[0], TAIL_WINDOW)
FIGURE_5 = StiffSetting(1e6, AUTOMATIC_END, 2e-7, LATE_WINDOW)
"""The converged step is 1e-7 s within 0.2 % of the ringing."""
NEIGHBOURING_SETTINGS = (StiffSetting(3e3, 6.0, 1e-6, (4.5, 6.0)), StiffSetting(1e5, 2.0, 2.5e-7, (1.5, 2.0)))
"""Gains around the paper's first one, at each of which RK4 fails at its step of 1e-4 s, for as long as the plain command has time."""
FURTHER_GAINS = (
    StiffSetting(3e3, T_END, 1e-6, TAIL_WINDOW),
    StiffSetting(1e5, T_END, 2.5e-7, TAIL_WINDOW),
    StiffSetting(1e6, 10.0, 1e-7, (9.9, 10.0)),
)
"""Of ``reproduce --full``; the last is as long as its converged step allows within a quarter of a minute."""
FULL_COMMAND = (
    f"Gamma = {', '.join(f'{each.gamma:g}' for each in FURTHER_GAINS)} at h = 1e-4 and 1e-5 s over {FURTHER_GAINS[0].t_end:g} s ({FURTHER_GAINS[-1].t_end:g} s at "
    f"the largest); SciPy's BDF and Radau beside the two codes, to {AUTOMATIC_END:g} s at tolerances of {LOOSE_TOLERANCES[0]:g} and "
    f"{LOOSE_TOLERANCES[1]:g}, all four to {LONG_AUTOMATIC_END:g} s at {LOOSE_TOLERANCES[0]:g}; both codes to {LONG_AUTOMATIC_END:g} s at {TOLERANCE:g}"
)


@dataclass(frozen=True)
class StiffRuns:
    """All that was run, by what it is for."""

    explicit: list[StiffRow]
    fixed: list[StiffRow]
    automatic: list[StiffRow]
    longer: list[StiffRow]
    loose: list[StiffRow]
    at_figure_5: list[StiffRow]
    at_neighbours: tuple[list[StiffRow], ...]

    @staticmethod
    def now(*, full: bool = False) -> StiffRuns:
        """What the plain command has time for; in full all codes to the end at the loose tolerance."""
        return StiffRuns(
            explicit=[PAPER_SETTING.explicit(h) for h in (section_v.COARSE_STEP, section_v.FINE_STEP)],
            fixed=[
                PAPER_SETTING.implicit(section_v.COARSE_STEP, midpoint=True),
                PAPER_SETTING.implicit(section_v.COARSE_STEP, midpoint=False),
                PAPER_SETTING.implicit(section_v.FINE_STEP, midpoint=True),
            ],
            automatic=PAPER_SETTING.automatic(EVALUATION_BUDGETS, tolerance=TOLERANCE, t_end=AUTOMATIC_END),
            longer=PAPER_SETTING.automatic({}, tolerance=LOOSE_TOLERANCES[1], t_end=LONG_AUTOMATIC_END),
            loose=PAPER_SETTING.automatic(
                FULL_BUDGETS if full else EVALUATION_BUDGETS,
                tolerance=LOOSE_TOLERANCES[0],
                t_end=LONG_AUTOMATIC_END if full else LOOSE_END,
            ),
            at_figure_5=[FIGURE_5.explicit(section_v.FINE_STEP)]
            + [FIGURE_5.implicit(section_v.FINE_STEP, midpoint=midpoint) for midpoint in (True, False)],
            at_neighbours=tuple(
                [gain.explicit(section_v.COARSE_STEP)]
                + [gain.implicit(section_v.COARSE_STEP, midpoint=midpoint) for midpoint in (True, False)]
                for gain in NEIGHBOURING_SETTINGS
            ),
        )
