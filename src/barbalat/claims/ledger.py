"""All claims of the paper, measured in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from barbalat.claims import (
    adapting_margins,
    condition,
    figures,
    learning,
    lemma_1,
    linear_design,
    numerics,
    onset,
    output_feedback,
    robustness,
    sampled,
    stiff,
    theta_size,
    tracking,
)
from barbalat.claims.claim import Claim
from barbalat.claims.section_v import Runs
from barbalat.engine import Progress


@dataclass(frozen=True)
class Measurement:
    """Some of the ledger's rows, and about how many seconds they take: the progress bar moves by that."""

    measure: Callable[[Runs], Claim | list[Claim]]
    seconds: float
    quick: bool = False


LEDGER = (
    Measurement(figures.as_described, 0.1, quick=True),
    Measurement(figures.without_projection, 0.1, quick=True),
    Measurement(figures.erratum_claim, 0.1, quick=True),
    Measurement(lambda _: tracking.bound_9(), 0.4, quick=True),
    Measurement(lambda _: tracking.bound_10(), 0.6, quick=True),
    Measurement(lambda _: tracking.bias_is_proportional(), 0.1, quick=True),
    Measurement(lambda _: tracking.best_at_zero(), 0.2, quick=True),
    Measurement(lambda _: tracking.constant_command(), 0.3, quick=True),
    Measurement(lambda _: tracking.is_mrac(), 0.1, quick=True),
    Measurement(lambda _: condition.condition(), 0.4, quick=True),
    Measurement(lambda _: theta_size.filter_limits_theta(), 2.6),
    Measurement(numerics.come_and_go, 0.1, quick=True),
    Measurement(onset.boundary, 5.0),
    Measurement(lambda _: numerics.without_filter(), 0.1),
    Measurement(lambda _: numerics.smaller_gain(), 0.1),
    Measurement(lambda _: numerics.small_tau(), 0.3),
    Measurement(lambda _: stiff.own_oscillation(), 3.5),
    Measurement(lambda _: stiff.stiff_solvers(), 7.0),
    Measurement(lambda _: sampled.claim(), 1.0),
    Measurement(lambda _: sampled.delays(), 1.0),
    Measurement(lambda _: adapting_margins.claims(), 1.0),
    Measurement(lambda _: robustness.claims(), 10.5),
    Measurement(lambda _: lemma_1.claims(), 2.0),
    Measurement(lambda _: linear_design.claims(), 5.5),
    Measurement(learning.loss_of_learning, 0.1, quick=True),
    Measurement(lambda _: learning.exponential(), 0.3, quick=True),
    Measurement(lambda _: output_feedback.l1_is_linear(), 0.4),
    Measurement(lambda _: output_feedback.rohrs(), 0.4),
    Measurement(lambda _: output_feedback.any_relative_degree(), 1.4),
)


def measure(runs: Runs, *, quick: bool = False, progress: Progress | None = None) -> list[Claim]:
    """The ledger; ``quick`` leaves out what takes longer than the figures themselves."""
    chosen = [measurement for measurement in LEDGER if measurement.quick or not quick]
    done, total = 0.0, sum(measurement.seconds for measurement in chosen)
    ledger: list[Claim] = []
    for measurement in chosen:
        found = measurement.measure(runs)
        ledger += [found] if isinstance(found, Claim) else found
        done += measurement.seconds
        if progress is not None:
            progress(done / total)
    return ledger
