"""Section V as pages: lessons on Figures 2 to 5 and on the paper's statements about its schemes."""

from __future__ import annotations

from collections.abc import Sequence

from barbalat.cases.load import CaseText, text_to_start_from
from barbalat.explorer.explorer import Explorer, PageContents
from barbalat.explorer.lessons import BoundedGoal, FigureGoal, Lesson, SettingGoal, UnprojectedGoal
from barbalat.explorer.source import TextSource
from barbalat.papers.claim import Claim

TAU_PATH, KAPPA_PATH, GAMMA_PATH, MRAC_GAMMA_PATH = (
    "controller[0].tau",
    "controller[1].filter.kappa",
    "controller[1].gamma",
    "controller[2].gamma",
)
STEP_PATH, DELAY_PATH = "simulation.dt", "plant.input.delay"
PAPER = "jafari_2013"
"""The paper to whose reproduction these pages belong."""
PAPER_CASE = "paper"
"""The bundled case of these lessons."""
OSCILLATING_RATE, QUIET_RATE = 20.0, 1.0
"""The variation [1/s] of an estimate that sweeps the box once per second, there and back, and of an estimate that varies only
because of the command."""
QUIET_GAIN = 300.0
"""Gain of L1-AC. It is far below the gain at which the loop oscillates with the paper's step, so that the solver has no visible
effect."""

ON_THE_PAPER_S_EXAMPLE = (
    Lesson(
        key="figure-2", title="Figure 2: robust MRAC and the benefit of tau", shown=("Robust MRAC",),
        text=(
            "The error vanishes and the estimates converge. During the transient, the auxiliary input keeps the error small, in "
            "proportion to τ."
        ),
        goal="Reduce the largest error to at most 0.6 of its current value.",
        checks=(FigureGoal(controller="Robust MRAC", figure="max_abs_e", relation="<", value=0.6, share_of="start"),),
        example={TAU_PATH: 0.25}, claims=("figures-2-5", "tau-error"),
    ),
    Lesson(
        key="figure-3", title="Figure 3: L1-AC at h = 1e-4 s", shown=("L1",),
        text=(
            "The estimates sweep through the whole known set, thousands of times a second. "
            "Find out what this depends on."
        ),
        goal="Make the estimates quiet (variation below 1 per s) without a smaller step.",
        checks=(
            SettingGoal(path=STEP_PATH, relation=">=", value=1e-4),
            FigureGoal(controller="L1", figure="theta_hat_variation_rate", relation="<", value=QUIET_RATE),
        ),
        example={GAMMA_PATH: QUIET_GAIN}, claims=("numerical-oscillation", "oscillation-without-filter", "smaller-gain"),
    ),
    Lesson(
        key="onset", title="Where the oscillation begins", shown=("L1",), numbers={GAMMA_PATH: 3000.0},
        text=(
            "At this gain the loop oscillates at h = 1e-4 s. "
            "With half the step the oscillation disappears, because it begins at a fixed product of the step and √Γ."
        ),
        goal="Make the loop oscillate (variation above 20 per s) at half this step.",
        checks=(
            SettingGoal(path=STEP_PATH, relation="<=", value=5e-5),
            FigureGoal(controller="L1", figure="theta_hat_variation_rate", relation=">", value=OSCILLATING_RATE),
        ),
        example={STEP_PATH: 5e-5, GAMMA_PATH: 12000.0}, claims=("boundary",),
    ),
    Lesson(
        key="figure-4", title="Figure 4: a tenth of the step", shown=("L1",), numbers={STEP_PATH: 1e-5},
        text=(
            "The controller and the gain are the same, but the run takes six million steps instead of six hundred thousand. "
            "Now only the command moves the estimates."
        ),
        goal="Bring the oscillation back (variation above 20 per s) at this step.",
        checks=(
            SettingGoal(path=STEP_PATH, relation="<=", value=1e-5),
            FigureGoal(controller="L1", figure="theta_hat_variation_rate", relation=">", value=OSCILLATING_RATE),
        ),
        example={GAMMA_PATH: 1e6}, claims=("numerical-oscillation", "own-oscillation"),
    ),
    Lesson(
        key="figure-5", title="Figure 5: a hundred times the gain", shown=("L1",), numbers={STEP_PATH: 1e-5, GAMMA_PATH: 1e6},
        text="At Γ = 1e6 the smaller step no longer helps.",
        goal="Find a gain of at least 5e4 whose estimates are quiet at this step (variation below 1 per s).",
        checks=(
            SettingGoal(path=GAMMA_PATH, relation=">=", value=5e4),
            SettingGoal(path=STEP_PATH, relation=">=", value=1e-5),
            FigureGoal(controller="L1", figure="theta_hat_variation_rate", relation="<", value=QUIET_RATE),
        ),
        example={GAMMA_PATH: 5e4}, claims=("numerical-oscillation", "boundary"),
    ),
    Lesson(
        key="projection", title="Without projection", shown=("L1",), projection={"L1": False},
        text="With Figure 3's gain and step but without projection, the run diverges within three seconds.",
        goal="Keep L1-AC bounded for 60 s, still without projection.",
        checks=(UnprojectedGoal(controller="L1"), BoundedGoal(controller="L1")),
        example={GAMMA_PATH: QUIET_GAIN}, claims=("no-projection",),
    ),
    Lesson(
        key="bias", title="The cost of the filter", shown=("L1",), numbers={GAMMA_PATH: QUIET_GAIN},
        text="Even without any oscillation, an error remains at every gain. The filter causes it.",
        goal="Reduce the error in the tail to at most 0.55 of its current value.",
        checks=(FigureGoal(controller="L1", figure="tail_max_abs_e", relation="<", value=0.55, share_of="start"),),
        example={KAPPA_PATH: 0.01}, claims=("bias-kappa", "best-kappa-zero", "bound-10"),
    ),
    Lesson(
        key="kappa", title="Toward kappa = 0.05", shown=("L1",), numbers={GAMMA_PATH: QUIET_GAIN},
        text=(
            "The paper's condition on the filter, and with it the guarantee, holds only up to κ = 0.05 s. "
            "How the loop behaves beyond this limit is a different question."
        ),
        goal=(
            "Increase κ beyond 0.05 s, where the guarantee ends, and find a bounded loop with at least three times the error."
        ),
        checks=(
            SettingGoal(path=KAPPA_PATH, relation=">=", value=0.05),
            BoundedGoal(controller="L1"),
            FigureGoal(controller="L1", figure="tail_max_abs_e", relation=">", value=3.0, share_of="start"),
        ),
        example={KAPPA_PATH: 0.07}, claims=("kappa-0.05",),
    ),
    Lesson(
        key="small-gain", title="A small gain instead", shown=("L1", "MRAC"), numbers={MRAC_GAMMA_PATH: 1e-2},
        text="L1-AC has the gain of Figure 3, and the standard MRAC has a millionth of it. Both run with the same step.",
        goal=(
            "Find a gain of MRAC, at most 10, at which its largest error is at most a tenth of that of L1-AC and its estimates "
            "are quiet (variation below 1 per s)."
        ),
        checks=(
            SettingGoal(path=MRAC_GAMMA_PATH, relation="<=", value=10.0),
            FigureGoal(controller="MRAC", figure="max_abs_e", relation="<", value=0.1, share_of="L1"),
            FigureGoal(controller="MRAC", figure="theta_hat_variation_rate", relation="<", value=QUIET_RATE),
        ),
        example={MRAC_GAMMA_PATH: 1.0}, claims=("smaller-gain", "filtered-mrac"),
    ),
)  # fmt: skip

WITH_A_DELAY = (
    Lesson(
        key="tau-and-delay", title="Theorem 2: tau against a modelling error",
        shown=("Robust MRAC",), numbers={TAU_PATH: 0.02, DELAY_PATH: 0.05},
        text=(
            "The input has a delay of 50 ms. Without the delay τ would be excellent, but with it the run diverges or leaves its "
            "limits."
        ),
        goal="Find a τ, neither too small nor too large, with which the loop tolerates this delay and the error in the tail is "
            "below 3.",
        checks=(
            SettingGoal(path=DELAY_PATH, relation=">=", value=0.05),
            BoundedGoal(controller="Robust MRAC"),
            FigureGoal(controller="Robust MRAC", figure="tail_max_abs_e", relation="<", value=3.0),
        ),
        example={TAU_PATH: 0.1}, claims=("tau-limit-delay", "delta-2-term"),
    ),
    Lesson(
        key="delay-and-filter", title="Delay against filter",
        shown=("L1", "MRAC"), numbers={DELAY_PATH: 0.1, GAMMA_PATH: 100.0},
        text=(
            "With a delay of 100 ms both L1-AC and the standard MRAC oscillate. "
            "Without the delay the filter only increases the error (see the lesson The cost of the filter); explore its effect "
            "with the delay."
        ),
        goal="Choose the filter so that the error of L1-AC in the tail is at most half of that of MRAC.",
        checks=(
            SettingGoal(path=DELAY_PATH, relation=">=", value=0.1),
            SettingGoal(path=MRAC_GAMMA_PATH, relation=">=", value=1.0),
            FigureGoal(controller="L1", figure="tail_max_abs_e", relation="<", value=0.5, share_of="MRAC"),
        ),
        example={KAPPA_PATH: 0.05}, claims=("filter-reduces-margins", "gain-reduces-margins"),
    ),
)  # fmt: skip

PAGES = {"explorer.html": ON_THE_PAPER_S_EXAMPLE, "explorer-delay.html": WITH_A_DELAY}
"""The lessons by file: ``barbalat reproduce`` writes them to the folder of its report."""


def late(text: str) -> str:
    """Return the text of the example with an input delay and a longer step, which is sufficient without fast adaptation."""
    changed = text.replace('name = "Section V"', 'name = "Section V with an input delay"', 1).replace("dt = 1e-4", "dt = 1e-3", 1)
    return changed.replace("[reference_model]", "[plant.input]\ndelay = 0.01\n\n[reference_model]", 1)


def explorer(file: str) -> Explorer:
    """Return the page with this name."""
    text = text_to_start_from(PAPER_CASE)
    return Explorer(TextSource(CaseText(late(text) if PAGES[file] is WITH_A_DELAY else text)), PAGES[file])


def contents(file: str) -> PageContents:
    """Return the content of the page with this name before anything is measured. A different process can make it."""
    return explorer(file).contents


def addresses(claims: Sequence[Claim]) -> dict[str, str]:
    """Return the address at which each figure and each measured claim can be tried, which is its first lesson."""
    found: dict[str, str] = {}
    for file, lessons in PAGES.items():
        for lesson in lessons:
            for name in (lesson.key, *(claim.id for claim in claims if claim.id in lesson.claims)):
                found.setdefault(name, f"{file}#lesson={lesson.key}")
    return found
