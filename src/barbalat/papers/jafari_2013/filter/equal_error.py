"""Compares the delays that MRAC and L1-AC tolerate at equal error, with the same number of tunings for each.

The tunings are drawn by one rule over the settings of each scheme, so no setting is chosen by hand. MRAC has its gain. L1-AC has
its gain and its filter, which is (6) for one half of the tunings and has two slopes for the other half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import input_filter, two_slopes
from barbalat.papers.claim import Listing, short
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.papers.jafari_2013.tunings import Side, drawn, ranges
from barbalat.protocols import Controller, Signal
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins_ensemble
from barbalat.validate import Array

BUDGET, MORE = 8, 64
"""Number of tunings of each side without and with ``--full``. Sobol's sequence is balanced for powers of two."""
GAINS = (1e-4, 100.0)
"""The range of gains for both sides, from gains with little adaptation to the largest decade that the step resolves at r = 50."""
MRAC_KNOBS = {"Gamma": GAINS}
L1_KNOBS = {"kappa": (2e-3, 0.5), "Gamma": GAINS}
RESOLUTION = 0.05
"""Relative resolution of the bisection of delays."""
CRITERIA = {"onset": "up to the beginning of an oscillation", "loss": "up to the loss of the motion"}
RULE = (
    f"Equal error by one rule: the tunings are Sobol points over {ranges(MRAC_KNOBS)} for MRAC and over {ranges(L1_KNOBS)} "
    f"for L1-AC, half of these with (6) and half with (2 kappa s + 1)/(kappa s + 1)^2. A tuning matches one of the other side "
    f"if its RMS error is no larger and the delay that it tolerates is no shorter"
)


@dataclass(frozen=True, eq=False)
class Fronts:
    """The objectives of both sides under one command: the RMS error, and the negative delay by each of ``CRITERIA``."""

    command: str
    mrac: Side
    l1: Side

    def advantages(self, criterion: str) -> Array:
        """Return for each of L1-AC's tunings (K,) its delay divided by the longest of MRAC's tunings with no larger error."""
        return _over_the_best(self.l1, self.mrac, 1 + list(CRITERIA).index(criterion))

    def drawbacks(self, criterion: str) -> Array:
        """Return for each of MRAC's tunings (K,) its delay divided by the longest of L1-AC's tunings with no larger error."""
        return _over_the_best(self.mrac, self.l1, 1 + list(CRITERIA).index(criterion))


def _over_the_best(side: Side, other: Side, which: int) -> Array:
    """Return (K,) delays divided by the other side's longest delay at no larger error. The ratio is infinite if the other side
    has no such tuning, and 0 if no delay is tolerated."""
    error, delay, theirs = side.reached[:, 0], -side.reached[:, which], -other.reached[:, which]
    best = np.array([theirs[other.reached[:, 0] <= e].max(initial=0.0) if np.isfinite(e) else np.inf for e in error])
    return np.asarray(np.divide(delay, best, out=np.where(delay > 0, np.inf, 0.0), where=best > 0))


def fronts(command: str, signal: Signal, simulation: Simulation, count: int) -> Fronts:
    """Measure the tunings of both sides under a command."""
    mrac = [Mrac(gamma=float(gamma)) for (gamma,) in drawn(MRAC_KNOBS, count)]
    points = drawn(L1_KNOBS, count)
    with_6 = [L1Adaptive(gamma=float(gamma), filter=input_filter(float(kappa))) for kappa, gamma in points[::2]]
    with_two = [L1Adaptive(gamma=float(gamma), filter=two_slopes(float(kappa))) for kappa, gamma in points[1::2]]
    told = [f"{name}, kappa {short(kappa)} s, Gamma {short(gamma)}" for name, some in (("(6)", points[::2]), ("two slopes", points[1::2])) for kappa, gamma in some]  # fmt: skip
    reached = [_reached(signal, some, simulation) for some in (mrac, with_6, with_two)]
    return Fronts(
        command,
        Side("MRAC", tuple(f"Gamma {short(one.gamma)}" for one in mrac), reached[0]),
        Side("L1-AC", tuple(told), np.concatenate(reached[1:])),
    )


def _reached(signal: Signal, tunings: Sequence[Controller], simulation: Simulation) -> Array:
    """Return the objectives (K, 3), with an infinite error for a run that diverged."""
    problem = variant(reference=signal)
    found = delay_margins_ensemble([(problem, one) for one in tunings], simulation, resolution=RESOLUTION)
    error = np.linalg.norm(found.undelayed.rms_e, axis=1)
    return np.column_stack([np.where(np.isfinite(error), error, np.inf), -found.onset.tolerates, -found.loss.tolerates])


def reading(found: Sequence[Fronts], criterion: str) -> Reading:
    """Return the reading that the filter lowers the delay at equal error, which holds if MRAC matches every tuning of L1-AC."""
    said, matched = [], True
    for one in found:
        half, ahead = len(one.l1.tunings) // 2, one.advantages(criterion) > 1
        behind = one.drawbacks(criterion) > 1
        matched &= not ahead.any()
        said.append(
            f"{one.command}: {int(ahead[:half].sum())} of {half} L1-ACs with (6) and {int(ahead[half:].sum())} of {half} with "
            f"two slopes are not matched by MRAC; {int(behind.sum())} of {len(behind)} MRACs are not matched by L1-AC"
        )
    return Reading(
        f"at equal error, with both tuned by one rule, every tuning of L1-AC is matched by some tuning of MRAC, "
        f"{CRITERIA[criterion]}",
        bool(matched),
        "; ".join(said),
        "beside",
    )


def listing(found: Sequence[Fronts]) -> Listing:
    """Return a table with the largest advantage of each filter by each criterion, and its tuning."""
    rows = []
    for one in found:
        half = len(one.l1.tunings) // 2
        for criterion in CRITERIA:
            ratios = one.advantages(criterion)
            for part in (slice(None, half), slice(half, None)):
                finite = np.where(np.isfinite(ratios[part]), ratios[part], -1.0)
                best = int(finite.argmax()) + (part.start or 0)
                error, delay = one.l1.reached[best, 0], -one.l1.reached[best, 1 + list(CRITERIA).index(criterion)]
                rows.append((one.command, criterion, one.l1.tunings[best], short(error), short(delay), short(ratios[best])))
    return Listing(
        "For each filter, the L1-AC tuning with the largest advantage in delay over the MRAC tunings whose RMS error is no "
        "larger: its delay divided by the longest of theirs. If this ratio is below 1, MRAC matches every tuning with that "
        "filter",
        ("command", "criterion", "tuning of L1-AC", "RMS |e|", "delay [s]", "over MRAC's"),
        tuple(rows),
    )
