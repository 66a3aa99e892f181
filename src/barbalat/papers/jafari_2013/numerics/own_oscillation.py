"""The claim that the oscillation is the solver's alone: what is left of it when the step goes to zero."""

from __future__ import annotations

import numpy as np

from barbalat.papers.claim import Claim, Measurement, numbers, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff import (
    AUTOMATIC_END,
    CONVERGED_STEPS,
    LATE_WINDOW,
    PAPER_SETTING,
    T_END,
    TAIL_WINDOW,
)
from barbalat.papers.jafari_2013.numerics.stiff_methods import RINGING_WINDOW
from barbalat.papers.jafari_2013.numerics.stiff_runs import rk4
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.validate import Array


def own_oscillation() -> Claim:
    """What is left of the oscillation when the step goes to zero."""
    steps = [rk4(PAPER_SETTING.gamma, h, T_END) for h in (section_v.FINE_STEP, *CONVERGED_STEPS)]
    free, boxed = ([path.ringing(*TAIL_WINDOW) for path in paths] for paths in zip(*steps, strict=True))
    early = [path.ringing(*LATE_WINDOW) for path in (steps[0][1], steps[2][1])]
    agree = bool(np.allclose(free[1], free[2], rtol=0.1))
    return Claim(
        sentence=SENTENCES["own-oscillation"],
        readings=_readings(free, boxed, agree),
        shows=f"A converged solution rings by {boxed[2].max():.1g} with the projection, by {free[2].max():.2g} without it, which RK4's damping hides at h = 1e-5 s.",
        measured=        f"the estimates' ringing at h = {CONVERGED_STEPS[1]:g} s with projection: at most {boxed[2].max():.2g}, gone once they "
        "have touched "
        f"their bounds (at {AUTOMATIC_END:g} s, before that, {numbers(early[0])} at h = 1e-5 s, {numbers(early[1])} at 5e-7 s). "
        f"Without projection {numbers(free[2])}: there the equations themselves ring, and at h = 1e-5 s "
        f"RK4's own damping hides it: {free[0].max():.2g} is left",
        how=f"L1-AC, kappa = 0.02 s, Gamma = 1e4, RK4, {T_END:g} s; ringing: half the largest swing within {RINGING_WINDOW:g} s, over every step of the last quarter",
        listings=(
            table(
                "The ringing of the two estimates with RK4, by its step, with projection and without",
                {
                    "h [s]": (section_v.FINE_STEP, *CONVERGED_STEPS),
                    **{f"{i}, with": [each[i - 1] for each in boxed] for i in (1, 2)},
                    **{f"{i}, without": [each[i - 1] for each in free] for i in (1, 2)},
                },
            ),
        ),
        would_change="a converged solution without projection that doesn't ring, or one with projection that does",
    )  # fmt: skip


def _readings(free: list[Array], boxed: list[Array], agree: bool) -> tuple[Reading, ...]:
    sentence = SENTENCES["own-oscillation"]
    return (
        sentence.reads(bool((boxed[2] < 0.01).all()), f"ringing of at most {boxed[0].max():.2g} at h = {section_v.FINE_STEP:g} s, {boxed[2].max():.2g} at {CONVERGED_STEPS[1]:g} s"),
        sentence.reads(
            not (agree and bool((free[2] > 3 * free[0]).all())),
            f"ringing of at most {free[0].max():.2g} at h = {section_v.FINE_STEP:g} s, {free[2].max():.2g} at {CONVERGED_STEPS[1]:g} s",
            1,
        ),
    )  # fmt: skip


ROWS = (
    Measurement(
        own_oscillation, 5.7, {"own-oscillation": "at h = 1e-5 s the oscillation is gone"}, place=170, shares="converged"
    ),
)
