"""The claim that a solver for stiff problems does not help, tested with implicit methods at fixed steps and with variable-step
codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.papers.claim import Claim, Listing, Measurement, numbers
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff_methods import NEWTON_STEPS, RINGING_WINDOW, SciPyMethod
from barbalat.papers.jafari_2013.numerics.stiff_runs import (
    AGREEMENT_FACTOR,
    RINGING_END,
    RINGING_START,
    StiffRow,
    StiffSetting,
    agrees,
    cell,
    listing,
    ratios,
    rings_too_much,
)
from barbalat.papers.jafari_2013.sentences import SENTENCES


def stiff_solvers() -> Claim:
    """Run the solvers at the gains and steps of Figures 3 and 5, at which RK4 fails, without projection and with it as in the
    figures."""
    return _claim(StiffRuns.now())


def stiff_solvers_further() -> Claim:
    """Run the same solvers, with longer runs at the other gains, and with more and longer runs of the variable-step codes."""
    listings, right, followed = [], PAPER_SETTING.right, []
    for gain in FURTHER_GAINS:
        rows = [gain.explicit(h) for h in STEPS] + _implicit(gain)
        listings.append(listing(rows, gain.right, gain.gamma))
        followed.append((gain, [row for row in rows[2:] if agrees(row.boxed, gain.right[1], row.span)]))
    loose = [row for t in LOOSE_TOLERANCES for row in PAPER_SETTING.automatic(LONG_BUDGETS, tolerance=t, t_end=AUTOMATIC_END)]
    compiled: dict[SciPyMethod, int] = {"LSODA": LONG_BUDGETS["LSODA"]}
    longer = PAPER_SETTING.automatic(compiled, tolerance=TOLERANCE, t_end=LONG_AUTOMATIC_END)
    gains = "; ".join(
        f"Gamma = {gain.gamma:g}: {', '.join(f'{row.name}, {row.setting}' for row in rows) or 'none'}" for gain, rows in followed
    )
    codes = "; ".join(f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}" for row in (*loose, *longer))
    more = Reading(
        "in longer runs, at the other gains and with variable-step solvers, no solver agrees with the exact solution",
        not any(rows for _, rows in followed),
        f"implicit steps that agree with the exact solution, with projection: {gains}. Variable steps: {codes}",
        "beside",
    )
    return _claim(StiffRuns.now(full=True), more, listings=tuple(listings))


def _claim(tried: StiffRuns, *more: Reading, listings: tuple[Listing, ...] = ()) -> Claim:
    right, at_paper = PAPER_SETTING.right, tried.fixed[GAINS.index(PAPER_SETTING)]
    rk4 = ratios(tried.explicit[0].boxed, right[1], tried.explicit[0].span)[1]
    tables = [
        listing(rows, gain.right, gain.gamma) for gain, rows in zip(GAINS, tried.fixed, strict=True) if gain is not PAPER_SETTING
    ]
    return Claim(
        sentence=SENTENCES["stiff-solvers"],
        readings=(*_literal(tried), *_automatic(tried), *_supplementary(tried), _giving_up(tried), *more),
        shows=f"At h = {STEPS[1]:g} s implicit midpoint rings at most {_worst(tried, 2):.2f} times as much as the exact solution "
        f"for Gamma up to {GAINS[-1].gamma:g} (RK4 in Figure 3: {rk4:.2g} times). No singularity occurs.",
        measured="the ringing of the estimates divided by that of the converged solution, smallest and largest in any second, "
        "without / with projection: "
        + "; "
        "".join(f"{row.name}, {row.setting}: {cell(row, 0, right)} / "
        f"{cell(row, 1, right)}" for row in (*tried.explicit, *at_paper))
        + ". Variable steps: "
        + "; ".join(
            f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}, {row.free.evaluations} evaluations, "
            f"{row.free.seconds:.1f} s"
            for row in (*tried.tight, *tried.loose)
        )
        + f". {NO_SINGULARITY}",
        how=f"The ringing is half the largest swing within {RINGING_WINDOW:g} s, with the drift of its midpoint removed, in each "
        f"second from {RINGING_START:g} to {RINGING_END:g} s. A result is right if its ringing in each second is within a factor "
        f"of {AGREEMENT_FACTOR:g} of that of RK4 at h = {PAPER_SETTING.converged_step:g} s, which rings with an amplitude of up "
        f"to {numbers(right[1].ringing(*PAPER_SETTING.span))}. Implicit steps use {NEWTON_STEPS} Newton steps with the exact "
        "Jacobian, and the estimate is limited at the end of each step. Variable steps use the projection and the exact "
        f"Jacobian. In that time no converged estimate exceeds {_highest(RINGING_END):.2g} in magnitude, and the projection does "
        f"not act; RK4 at the paper's step leaves the solution at {tried.explicit[0].free.reached:.1f} s",
        listings=(listing([*tried.explicit, *at_paper, *tried.tight, *tried.loose], right, PAPER_SETTING.gamma), *tables, *listings),
        would_change="holds: for both methods and both steps, implicit steps that ring more than the exact solution at some gain",
        sharpened=FULL_COMMAND,
    )  # fmt: skip


def _worst(tried: StiffRuns, place: int) -> float:
    """Return the largest ratio of one implicit method's ringing to that of the exact solution, at any gain; infinite if a run is
    lost."""
    rows = [(rows[place], gain) for rows, gain in zip(tried.fixed, GAINS, strict=True)]
    return max(np.inf if row.boxed.lost else ratios(row.boxed, gain.right[1], row.span)[1] for row, gain in rows)


def _literal(tried: StiffRuns) -> tuple[Reading, Reading]:
    """Return the two literal readings: that no solver avoids the phenomena at every gain, and that the converged solution may end
    in a singularity, which a proof excludes."""
    sentence, avoiding = SENTENCES["stiff-solvers"], _avoiding(tried)
    ends = min(path.reached for path in PAPER_SETTING.right)
    return (
        sentence.reads(
            not avoiding, f"{len(avoiding)} of {len(tried.fixed[0])} combinations avoid them at all {len(tried.fixed)} gains: "
            f"{'; '.join(avoiding) or 'none'}"
        ),
        sentence.reads(
            any(path.lost for path in PAPER_SETTING.right),
            f"the converged solution reaches {ends:g} s, and its estimates are at most {_highest(T_END):.2g}. {NO_SINGULARITY}",
            1,
        ),
    )  # fmt: skip


def _avoiding(tried: StiffRuns) -> list[str]:
    """Return a phrase for each implicit method and step that shows nothing of Figures 3 and 5 at any gain, with the ringing of
    its estimates."""
    found = []
    for rows in zip(*tried.fixed, strict=True):
        if not any(_shows_them(row, gain) for row, gain in zip(rows, GAINS, strict=True)):
            each = [ratios(row.boxed, gain.right[1], row.span) for row, gain in zip(rows, GAINS, strict=True)]
            found.append(
                f"{rows[0].name}, {rows[0].setting}, {min(least for least, _ in each):.2g} to "
                f"{max(most for _, most in each):.3g} times the equations'"
            )
    return found  # fmt: skip


def _shows_them(row: StiffRow, gain: StiffSetting) -> bool:
    """Whether a run shows the phenomena of Figures 3 and 5: with projection, estimates that ring more than in the exact solution;
    without projection, unbounded signals."""
    return row.free.lost or row.boxed.lost or rings_too_much(row.boxed, gain.right[1], row.span)


def _automatic(tried: StiffRuns) -> tuple[Reading, ...]:
    """Return the readings obtained with adaptive-step solvers. The runs with a tight tolerance extend beyond the start of the
    phenomenon and the first second at a bound; others have a loose tolerance."""
    right, failing = PAPER_SETTING.right, _failing(tried)
    return (
        Reading(
            f"with variable steps at a tight tolerance, {TOLERANCE:g} or {LOOSE_TOLERANCES[1]:g}, each solver rings more than "
            f"the exact solution or gives up",
            all(_shows_them(row, PAPER_SETTING) for row in tried.tight),
            "; ".join(f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}" for row in tried.tight),
        ),
        Reading(
            f"with variable steps at a loose tolerance, {LOOSE_TOLERANCES[0]:g}, each solver rings more than the exact solution "
            f"or gives up",
            len(failing) == len(tried.loose),
            "; ".join(f"{row.name} to {row.span[1]:g} s {cell(row, 1, right)}{_amplitude(row)}" for row in tried.loose)
            + f"; the converged solution rings with an amplitude of {right[1].ringing(*PAPER_SETTING.span).max():.2g}. The "
            f"bounds are 5 and -5",
        ),
        Reading(
            "some solver for stiff problems shows them: a milder meaning of \"in general\", which the rules on quantifiers do "
            "not adopt",
            bool(failing),
            "; ".join(f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}" for row in failing) or f"0 of "
            f"{len(tried.loose)} runs",
            "beside",
        ),
    )  # fmt: skip


def _failing(tried: StiffRuns) -> list[StiffRow]:
    """Return the runs at the loose tolerance that ring more than the exact solution or do not reach their end."""
    return [row for row in tried.loose if _shows_them(row, PAPER_SETTING)]


def _supplementary(tried: StiffRuns) -> tuple[Reading, ...]:
    """Return the readings on whether solvers follow the exact solution, including its ringing, which the sentence does not
    require."""
    coarse, fine = (
        [(row, gain) for gain, rows in zip(GAINS, tried.fixed, strict=True) for row in rows if row.setting == rows[first].setting]
        for first in (0, 2)
    )
    return (
        _followed("at the paper's step of 1e-4 s no implicit method agrees with the exact solution at every gain: those that do "
            "not ring too much are too damped", coarse),
        _followed("at a tenth of that step, no implicit method agrees with the exact solution at every gain either", fine),
        Reading(
            "without projection, signals become unbounded at some gain",
            any(row.free.lost for row, _ in (*coarse, *fine)),
            f"{sum(row.free.lost for row, _ in (*coarse, *fine))} of {len(coarse) + len(fine)} implicit runs are lost",
            "beside",
        ),
    )  # fmt: skip


def _followed(says: str, pairs: list[tuple[StiffRow, StiffSetting]]) -> Reading:
    """Return the reading that no method follows the exact solution at each of its gains."""
    names = {row.name for row, _ in pairs}
    following = [n for n in names if all(agrees(row.boxed, gain.right[1], row.span) for row, gain in pairs if row.name == n)]
    told = "; ".join(f"Gamma = {gain.gamma:g}, {row.name} {cell(row, 1, gain.right)}" for row, gain in pairs)
    return Reading(says, not following, told, "beside")


def _amplitude(row: StiffRow) -> str:
    return "" if row.boxed.lost else f", amplitude {row.boxed.ringing(*row.span).max():.2g}"


NO_SINGULARITY = (
    "The solution of (1)-(8) without modelling error has no singularity at any Gamma: V of Theorem 1 does not grow for any u, "
    "so theta_hat is bounded. Therefore x, x_hat and the filter obey linear equations with bounded coefficients and stay finite "
    "at all times"
)


def _giving_up(tried: StiffRuns) -> Reading:
    """Return the reading on codes that give up as at a singularity: their step falls below the resolution of t in double
    precision."""
    codes = [*tried.tight, *tried.loose]
    gave_up = [f"{row.name}, {row.setting}, at {row.boxed.reached:.4g} s" for row in codes if row.boxed.lost]
    return Reading(
        "a solver gives up, as if it had met a singularity",
        bool(gave_up),
        f"{len(gave_up)} of {len(codes)} variable-step runs gave up" + "".join(f": {said}" for said in gave_up),
        "beside",
    )


def _highest(until: float) -> float:
    """Return the largest estimate of the converged solution up to this time."""
    return float(np.nanmax(np.abs([(p.least, p.greatest) for p in PAPER_SETTING.right])[:, :, : round(until / RINGING_WINDOW)]))


def _implicit(gain: StiffSetting) -> list[StiffRow]:
    """Run both methods at both of the paper's steps."""
    return [gain.implicit(h, midpoint=midpoint) for h in STEPS for midpoint in (True, False)]


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


STEPS = (section_v.COARSE_STEP, section_v.FINE_STEP)
T_END = 20.0
TAIL_WINDOW = (0.75 * T_END, T_END)
AUTOMATIC_END = 3.0
"""Horizon [s] beyond the time at which RK4 at the paper's step has left the solution, and before any estimate reaches its
bound."""
LONG_AUTOMATIC_END = 10.0
"""Horizon [s] beyond the time during which an estimate is at its bound, which is from 6.5 to 9.3 s."""
TOLERANCE = 1e-7
"""Relative tolerance of the variable-step codes. At 1e-6 they damp the ringing up to 3 s by a quarter or more
(docs/laboratory/claims.md)."""
LOOSE_TOLERANCES = (1e-3, 1e-6)
"""Loose tolerances. The first is the default of MATLAB's ode15s, which the paper's authors would have used without setting a
tolerance."""
LOOSE_END, RADAU_END = 4.0, 1.5
"""Horizons [s] at the loose tolerances without ``--full``. With ``--full`` all four codes run to ``LONG_AUTOMATIC_END``, which
takes a minute or more."""
RADAU_BUDGET: dict[SciPyMethod, int] = {"Radau": 1_000_000}
"""Largest number of evaluations, ten times the steps that the code needs to ``RADAU_END``. SciPy's BDF and Radau are written in
Python and take 20 to 40 us for each evaluation."""
LONG_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 3_000_000, "BDF": 3_000_000, "Radau": 3_000_000}
"""Largest numbers of evaluations, which the codes need to ``AUTOMATIC_END`` at ``LOOSE_TOLERANCES``."""
FULL_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 30_000_000, "BDF": 30_000_000, "Radau": 30_000_000}
"""Largest number of evaluations to ``LONG_AUTOMATIC_END`` at the loose tolerance, more than any code needs to reach the end or
to give up."""
CONVERGED_STEPS = (1e-6, 5e-7)
"""Two steps [s] at which h |lambda| is at most 0.07. If their results agree, they show the behaviour of the equations."""
PAPER_SETTING = StiffSetting(1e4, T_END, CONVERGED_STEPS[0])
FIGURE_5 = StiffSetting(1e6, AUTOMATIC_END, 2e-7)
"""The settings of Figures 3 and 5. At the converged step of Figure 5's setting the ringing is within 0.2 % of the ringing at 1e-7
s."""
GAINS = (StiffSetting(3e3, 6.0, 1e-6), PAPER_SETTING, StiffSetting(1e5, 2.0, 2.5e-7), FIGURE_5)
"""Settings at which RK4 fails with the paper's step of 1e-4 s, with the horizons for which there is time without ``--full``."""
FURTHER_GAINS = (StiffSetting(3e3, T_END, 1e-6), StiffSetting(1e5, T_END, 2.5e-7), StiffSetting(1e6, 10.0, 1e-7))
"""The settings of ``reproduce --full``. The last run is as long as its converged step allows within a quarter of a minute."""
FULL_COMMAND = (
    f"Gamma = {', '.join(f'{each.gamma:g}' for each in FURTHER_GAINS)} at h = 1e-4 and 1e-5 s over {FURTHER_GAINS[0].t_end:g} s "
    f"({FURTHER_GAINS[-1].t_end:g} s at "
    f"the largest); SciPy's LSODA, BDF and Radau as well as CVODES, to {AUTOMATIC_END:g} s at tolerances of "
    f"{LOOSE_TOLERANCES[0]:g} and "
    f"{LOOSE_TOLERANCES[1]:g}, all four to {LONG_AUTOMATIC_END:g} s at {LOOSE_TOLERANCES[0]:g}; CVODES and LSODA to "
    f"{LONG_AUTOMATIC_END:g} s at {TOLERANCE:g}"
)


@dataclass(frozen=True)
class StiffRuns:
    """All runs, by their purpose.

    explicit  RK4 at Figure 3's gain, at the steps of Figures 3 and 4
    fixed     the implicit steps for each of ``GAINS``, always in the same order
    """

    explicit: list[StiffRow]
    fixed: tuple[list[StiffRow], ...]
    tight: list[StiffRow]
    loose: list[StiffRow]

    @staticmethod
    def now(*, full: bool = False) -> StiffRuns:
        """Simulate the runs; with ``full``, run all codes to the end at the loose tolerance."""
        loosely = [(RADAU_BUDGET, RADAU_END), ({}, LOOSE_END)] if not full else [(FULL_BUDGETS, LONG_AUTOMATIC_END)]
        tightly = ((TOLERANCE, AUTOMATIC_END), (LOOSE_TOLERANCES[1], LONG_AUTOMATIC_END))
        return StiffRuns(
            explicit=[PAPER_SETTING.explicit(h) for h in STEPS],
            fixed=tuple(_implicit(gain) for gain in GAINS),
            tight=[row for tolerance, t_end in tightly for row in PAPER_SETTING.automatic({}, tolerance=tolerance, t_end=t_end)],
            loose=[
                row
                for budgets, t_end in loosely
                for row in PAPER_SETTING.automatic(budgets, tolerance=LOOSE_TOLERANCES[0], t_end=t_end)
            ],
        )
