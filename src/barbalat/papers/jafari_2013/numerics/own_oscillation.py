"""The claim that Figure 3's oscillation comes from the solver, tested by the oscillation that remains as the step tends to 0."""

from __future__ import annotations

import numpy as np

from barbalat.papers.claim import Claim, Measurement, numbers, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff import (
    CONVERGED_STEPS,
    PAPER_SETTING,
    T_END,
    TAIL_WINDOW,
)
from barbalat.papers.jafari_2013.numerics.stiff_methods import RINGING_WINDOW
from barbalat.papers.jafari_2013.numerics.stiff_runs import RINGING_END, RINGING_START, rk4
from barbalat.papers.jafari_2013.sentences import SENTENCES


def own_oscillation() -> Claim:
    """Compare the ringing that remains as the step goes to zero with that of Figure 3's run, second by second."""
    figure_3 = rk4(PAPER_SETTING.gamma, section_v.COARSE_STEP, T_END)[1]
    steps = [rk4(PAPER_SETTING.gamma, h, T_END) for h in (section_v.FINE_STEP, *CONVERGED_STEPS)]
    free, boxed = ([path.ringing(*TAIL_WINDOW) for path in paths] for paths in zip(*steps, strict=True))
    seconds = [(RINGING_START, 1.0), *((float(t), t + 1.0) for t in range(1, round(T_END)))]
    drawn, own = (np.array([path.ringing(*ends) for ends in seconds]) for path in (figure_3, steps[1][1]))
    agree = bool(np.allclose(free[1], free[2], rtol=0.1))
    shares = (own / drawn).max(axis=1)
    after = np.array([start >= NUMERICAL_FROM for start, _ in seconds])
    sentence = SENTENCES["own-oscillation"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool((shares < OWN_SHARE).all()), f"{shares.min():.1g} to {shares.max():.2g} times Figure 3's "
            f"ringing; the ratio is largest in the second from {seconds[int(shares.argmax())][0]:g} s, where the exact solution "
            f"rings with an amplitude of up to {own[shares.argmax()].max():.2g}"),
            Reading(
                f"the first {NUMERICAL_FROM:g} s, in which Figure 3's run still agrees with the exact solution, are left out",
                bool((shares[after] < OWN_SHARE).all()),
                f"at most {shares[after].max():.2g} times Figure 3's ringing: the exact solution rings with an amplitude of up "
                f"to {own[after].max():.2g} and Figure 3's run of up to {drawn[after].max():.2g}. In the last quarter the "
                f"amplitude of the exact solution is {own[-5:].max():.0e}",
            ),
            Reading(
                "without the projection the exact solution does not ring either: in the last quarter the ringing at a converged "
                "step does not exceed that at h = 1e-5 s",
                not (agree and bool((free[2] > 3 * free[0]).all())),
                f"at most {free[0].max():.2g} at h = {section_v.FINE_STEP:g} s, where RK4's damping hides the ringing, and "
                f"{free[2].max():.2g} at {CONVERGED_STEPS[1]:g} s",
                "beside",
            ),
        ),
        shows=f"After {NUMERICAL_FROM:g} s Figure 3's run rings from bound to bound, with an amplitude of {drawn.max():.2g}, and "
            f"the exact solution with at most {own[after].max():.2g}. Before that, both ring alike, with up to "
            f"{own[~after].max():.2g}.",
        measured=f"with the projection the exact solution rings with an amplitude of up to {own.max():.2g} until an estimate "
            f"reaches its bound at {RINGING_END:g} s, and with at most {own[-5:].max():.1g} in the last quarter. Figure 3's run "
            f"rings with an amplitude of up to {drawn.max():.2g}. Without projection the exact solution rings with an amplitude "
            f"of {numbers(free[2])} in the last quarter. At h = 1e-5 s the numerical damping of RK4 reduces this ringing to "
            f"{free[0].max():.2g}",
        how=f"L1-AC, kappa = 0.02 s, Gamma = 1e4, RK4, {T_END:g} s; the equations are solved with h = {CONVERGED_STEPS[0]:g} s "
        f"(the result agrees with that for h = {CONVERGED_STEPS[1]:g} s to within a tenth); Figure 3 is computed with h = "
        f"{section_v.COARSE_STEP:g} s; the ringing is half the largest swing within {RINGING_WINDOW:g} s, "
        f"with the drift of its midpoint removed",
        listings=(
            table(
                "The ringing of the two estimates in each second, with projection, in the exact solution and in Figure 3's run",
                {
                    "second from [s]": [start for start, _ in seconds],
                    **{f"{i}, equations": own[:, i - 1] for i in (1, 2)},
                    **{f"{i}, Figure 3": drawn[:, i - 1] for i in (1, 2)},
                },
            ),
            table(
                "The ringing of the two estimates in the last quarter for each step of RK4, with and without projection",
                {
                    "h [s]": (section_v.FINE_STEP, *CONVERGED_STEPS),
                    **{f"{i}, with": [each[i - 1] for each in boxed] for i in (1, 2)},
                    **{f"{i}, without": [each[i - 1] for each in free] for i in (1, 2)},
                },
            ),
        ),
        would_change="holds: a converged solution that rings less than a tenth of Figure 3's run from the start; fails: one "
        "that rings as Figure 3's run does when it goes from bound to bound",
    )  # fmt: skip


OWN_SHARE = 0.1
"""An oscillation is attributed to the solver if less than this fraction of it remains in the solution of the equations."""
NUMERICAL_FROM = 2.0
"""Time [s] from which RK4 at the paper's step has left the solution, and the estimates reach both bounds."""


ROWS = (
    Measurement(own_oscillation, 5.7, {"own-oscillation": "whose oscillation Figure 3 shows"}, place=170, shares="converged"),
)
