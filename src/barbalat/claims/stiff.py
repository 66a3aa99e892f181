"""The claim that a solver for stiff problems does not help: implicit methods at a fixed step, and codes with automatic steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, Listing, Reading, of_readings, verdict
from barbalat.claims.stiff_methods import NEWTON_STEPS, WINDOW, SciPyMethod
from barbalat.claims.stiff_runs import AGREEMENT_FACTOR, Gain, Row, agrees, cell, listing, rk4
from barbalat.claims.variants import numbers, table

T_END = 20.0
TAIL = (0.75 * T_END, T_END)
AUTOMATIC_END = 3.0
"""[s]: past the time at which RK4 has left the solution at the paper's step, and before any estimate reaches its bound."""
LATE_WINDOW = (AUTOMATIC_END - 0.1, AUTOMATIC_END)
LONG_AUTOMATIC_END = 10.0
"""[s]: past the time that an estimate lies on its bound, from 6.5 to 9.3 s."""
TOLERANCE = 1e-7
"""Relative, of the codes with automatic steps; at 1e-6 they damp the ringing by a quarter and more (docs/claims.md)."""
BUDGETS: dict[SciPyMethod, int] = {"LSODA": 1_000_000, "BDF": 20_000, "Radau": 20_000}
"""LSODA is compiled; SciPy's other two are Python, 20 to 40 us for each evaluation, and would need half a minute each."""
LONG_BUDGETS: dict[SciPyMethod, int] = {"LSODA": 3_000_000, "BDF": 3_000_000, "Radau": 3_000_000}
"""What they need to ``AUTOMATIC_END`` at ``LOOSE_TOLERANCES``."""
LOOSE_TOLERANCES = (1e-3, 1e-6)
CONVERGED_STEPS = (1e-6, 5e-7)
"""Steps [s] at which h |lambda| is 0.07 and less: two that agree show what the equations do."""
PAPER = Gain(1e4, T_END, CONVERGED_STEPS[1], TAIL)
FIGURE_5 = Gain(1e6, AUTOMATIC_END, 2e-7, LATE_WINDOW)
"""The converged step is 1e-7 s within 0.2 % of the ringing."""
FURTHER_GAINS = (Gain(3e3, T_END, 1e-6, TAIL), Gain(1e5, T_END, 2.5e-7, TAIL), Gain(1e6, 10.0, 1e-7, (9.9, 10.0)))
"""Of ``reproduce --full``; the last is as long as its converged step allows within a quarter of a minute."""
SHARPENED = (
    f"Gamma = {', '.join(f'{each.gamma:g}' for each in FURTHER_GAINS)} at h = 1e-4 and 1e-5 s over {FURTHER_GAINS[0].t_end:g} s ({FURTHER_GAINS[-1].t_end:g} s at "
    f"the largest); all four codes to {AUTOMATIC_END:g} s at tolerances of {LOOSE_TOLERANCES[0]:g} and {LOOSE_TOLERANCES[1]:g}, two to "
    f"{LONG_AUTOMATIC_END:g} s at {TOLERANCE:g}"
)


def own_oscillation() -> Claim:
    """What is left of the oscillation when the step goes to zero."""
    steps = [rk4(PAPER.gamma, h, T_END) for h in (section_v.FINE, *CONVERGED_STEPS)]
    free, boxed = ([path.ringing(*TAIL) for path in paths] for paths in zip(*steps, strict=True))
    early = [path.ringing(*LATE_WINDOW) for path in (steps[0][1], steps[2][1])]
    agree = bool(np.allclose(free[1], free[2], rtol=0.1))
    readings = (
        Reading(
            "with the projection, as Figure 4 shows it, after the first seconds",
            verdict(holds=bool((boxed[2] < 0.01).all())),
            f"ringing of at most {boxed[0].max():.2g} at h = {section_v.FINE:g} s, {boxed[2].max():.2g} at "
            f"{CONVERGED_STEPS[1]:g} s",
        ),
        Reading(
            "without projection: what rings at h = 1e-4 s is the solver's alone",
            verdict(holds=not (agree and bool((free[2] > 3 * free[0]).all()))),
            f"ringing of at most {free[0].max():.2g} at h = {section_v.FINE:g} s, {free[2].max():.2g} at {CONVERGED_STEPS[1]:g} "
            "s",
        ),
    )
    return Claim(
        "own-oscillation", "Section V, discussion and caption of Figure 4", "With the step reduced to 1e-5 s the oscillation is gone, because it was numerical",
        of_readings(readings),
        f"the estimates' ringing at h = {CONVERGED_STEPS[1]:g} s with projection: at most {boxed[2].max():.2g}, gone once they "
        "have touched "
        f"their bounds (at {AUTOMATIC_END:g} s, before that, {numbers(early[0])} at h = 1e-5 s, {numbers(early[1])} at 5e-7 s). "
        f"Without projection {numbers(free[2])}: there the equations themselves ring, and at h = 1e-5 s "
        "RK4's own damping hides it",
        f"L1-AC, kappa = 0.02 s, Gamma = 1e4, RK4, {T_END:g} s; ringing: half the largest swing within {WINDOW:g} s, over every step of the last quarter",
        listings=(
            table(
                "The ringing of the two estimates with RK4, by its step, with projection and without",
                {
                    "h [s]": (section_v.FINE, *CONVERGED_STEPS),
                    **{f"{i}, with": [each[i - 1] for each in boxed] for i in (1, 2)},
                    **{f"{i}, without": [each[i - 1] for each in free] for i in (1, 2)},
                },
            ),
        ),
        number=f"ringing at h = 5e-7 s: {boxed[2].max():.2g} with projection, {free[2].max():.2g} without, where 1e-5 s shows {free[0].max():.2g}",
        readings=readings,
        would_change="a converged solution without projection that doesn't ring, or one with projection that does",
    )  # fmt: skip


@dataclass(frozen=True)
class Tried:
    """All that was run, by what it is for."""

    explicit: list[Row]
    fixed: list[Row]
    automatic: list[Row]
    at_figure_5: list[Row]

    @staticmethod
    def now() -> Tried:
        """What the plain command has time for."""
        return Tried(
            explicit=[PAPER.explicit(h) for h in (section_v.COARSE, section_v.FINE)],
            fixed=[
                PAPER.implicit(section_v.COARSE, midpoint=True),
                PAPER.implicit(section_v.COARSE, midpoint=False),
                PAPER.implicit(section_v.FINE, midpoint=True),
            ],
            automatic=PAPER.automatic(BUDGETS, tolerance=TOLERANCE, t_end=AUTOMATIC_END),
            at_figure_5=[FIGURE_5.explicit(section_v.FINE)]
            + [FIGURE_5.implicit(section_v.FINE, midpoint=midpoint) for midpoint in (True, False)],
        )


def stiff_solvers() -> Claim:
    """At the gains and steps of Figures 3 and 5, where RK4 fails: without projection, and with it as the figures are."""
    return _claim(Tried.now())


def stiff_solvers_further() -> Claim:
    """The same, more gains, longer runs of the codes with automatic steps."""
    listings, right, followed = [], PAPER.right, []
    for gain in FURTHER_GAINS:
        steps = (section_v.COARSE, section_v.FINE)
        rows = [gain.explicit(h) for h in steps] + [gain.implicit(h, midpoint=m) for h in steps for m in (True, False)]
        listings.append(listing(rows, gain.right, gain.gamma))
        followed.append((gain, [row for row in rows[2:] if agrees(row.boxed, gain.right[1], gain.span)]))
    loose = [row for t in LOOSE_TOLERANCES for row in PAPER.automatic(LONG_BUDGETS, tolerance=t, t_end=AUTOMATIC_END)]
    compiled: dict[SciPyMethod, int] = {"LSODA": LONG_BUDGETS["LSODA"]}
    longer = PAPER.automatic(compiled, tolerance=TOLERANCE, t_end=LONG_AUTOMATIC_END)
    gains = "; ".join(
        f"Gamma = {gain.gamma:g}: {', '.join(f'{row.name}, {row.setting}' for row in rows) or 'none'}" for gain, rows in followed
    )
    codes = "; ".join(f"{row.name}, {row.setting}, to {row.span[1]:g} s {cell(row, 1, right)}" for row in (*loose, *longer))
    more = Reading(
        "at more gains, and codes with automatic steps for longer",
        verdict(holds=not all(rows for _, rows in followed), conditional=any(rows for _, rows in followed)),
        f"implicit steps that follow the equations, with projection: {gains}. Automatic steps: {codes}",
    )
    return _claim(Tried.now(), more, listings=tuple(listings))


def _claim(tried: Tried, *more: Reading, listings: tuple[Listing, ...] = ()) -> Claim:
    readings = (*_readings(tried), *more)
    right, shown = PAPER.right, [*tried.explicit, *tried.fixed, *tried.automatic]
    best = tried.fixed[0]
    return Claim(
        "stiff-solvers", "Section V, discussion of Figures 3 to 5",
        "Even with a solver for stiff problems the phenomena of Figures 3 and 5 cannot be avoided, nor a possible singularity",
        of_readings(readings),
        "ringing of the estimates over that of the converged solution, without / with projection: "
        + "; ".join(f"{row.name}, {row.setting}: {cell(row, 0, right)} / {cell(row, 1, right)}" for row in (*tried.explicit, *tried.fixed))
        + f". Automatic steps, up to {AUTOMATIC_END:g} s: "
        + "; ".join(f"{row.name} {cell(row, 0, right)}, {row.free.evaluations} evaluations, {row.free.seconds:.1f} s" for row in tried.automatic),
        f"right: within a factor {AGREEMENT_FACTOR:g} of RK4 at h = {PAPER.converged_step:g} s, which rings by {numbers(right[0].ringing(*TAIL))} without and "
        f"{numbers(right[1].ringing(*TAIL))} with projection; last quarter of {T_END:g} s. Implicit steps: {NEWTON_STEPS} Newton steps of the exact Jacobian, "
        f"the estimate limited at the step's end. Automatic steps: relative tolerance {TOLERANCE:g}, exact Jacobian, last 0.1 s; up to there no estimate is "
        f"beyond {_highest():.1f} and the projection at rest; the phenomenon begins at {tried.explicit[0].free.reached:.1f} s",
        listings=(listing(shown, right, PAPER.gamma), listing(tried.at_figure_5, FIGURE_5.right, FIGURE_5.gamma), *listings),
        number=f"ringing over the converged one's at Figure 3's step, with projection: RK4 {cell(tried.explicit[0], 1, right)}, {best.name} {cell(best, 1, right)}",
        readings=readings,
        would_change="implicit steps that swing between the bounds, or codes with automatic steps that do, on this problem at one of the paper's gains",
        sharpened=SHARPENED,
    )  # fmt: skip


def _readings(tried: Tried) -> tuple[Reading, ...]:
    free, boxed = PAPER.right
    automatic = [row for row in tried.automatic if agrees(row.free, free, row.span)]
    undecided = [row.name for row in tried.automatic if not row.free.lost and row.free.reached < row.span[1] * (1 - 1e-9)]
    gave_up = [row.name for row in tried.automatic if row.free.lost]
    return (
        Reading(
            "swings between the bounds, at Figure 3's gain and step, with the projection",
            verdict(holds=not any(agrees(row.boxed, boxed, TAIL) for row in tried.fixed)),
            "; ".join(f"{row.name}, {row.setting} {cell(row, 1, PAPER.right)}" for row in tried.fixed),
        ),
        Reading(
            "signals that go unbounded, at Figure 3's gain, without projection",
            verdict(holds=all(row.free.lost for row in tried.fixed)),
            "; ".join(f"{row.name}, {row.setting} {cell(row, 0, PAPER.right)}" for row in tried.fixed),
        ),
        Reading(
            f"at Figure 5's gain and step, with the projection, to {FIGURE_5.t_end:g} s",
            verdict(holds=not any(agrees(row.boxed, FIGURE_5.right[1], row.span) for row in tried.at_figure_5[1:])),
            "; ".join(f"{row.name} {cell(row, 1, FIGURE_5.right)}" for row in tried.at_figure_5),
        ),
        Reading(
            f"codes with automatic steps, to {AUTOMATIC_END:g} s",
            verdict(holds=not automatic),
            f"{len(automatic)} of {len(tried.automatic)} right: {', '.join(row.name for row in automatic) or 'none'}; "
            f"not decided, their evaluations spent: {', '.join(undecided) or 'none'}",
        ),
        Reading(
            "a possible singularity of the solution: that a code gives up, on this problem; in general it is not tested",
            verdict(holds=bool(gave_up)),
            f"{len(gave_up)} of {len(tried.automatic)} codes gave up",
        ),
    )


def _highest() -> float:
    """The largest estimate of the converged solution until ``AUTOMATIC_END``."""
    return float(np.nanmax(np.abs([(p.least, p.greatest) for p in PAPER.right])[:, :, : round(AUTOMATIC_END / WINDOW)]))
