"""At which gains, steps and tolerances the codes for stiff problems are tried, and for how long."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff_methods import SciPyMethod
from barbalat.papers.jafari_2013.numerics.stiff_runs import StiffRow, StiffSetting

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
                FULL_BUDGETS if full else {}, tolerance=LOOSE_TOLERANCES[0], t_end=LONG_AUTOMATIC_END if full else LOOSE_END
            ),
            at_figure_5=[FIGURE_5.explicit(section_v.FINE_STEP)]
            + [FIGURE_5.implicit(section_v.FINE_STEP, midpoint=midpoint) for midpoint in (True, False)],
            at_neighbours=tuple(
                [gain.explicit(section_v.COARSE_STEP)]
                + [gain.implicit(section_v.COARSE_STEP, midpoint=midpoint) for midpoint in (True, False)]
                for gain in NEIGHBOURING_SETTINGS
            ),
        )
