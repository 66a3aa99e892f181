"""All claims of the paper, measured in order."""

from __future__ import annotations

from collections.abc import Callable

from barbalat.claims import figures, learning, numerics, robustness, stiff, tracking
from barbalat.claims.claim import Claim
from barbalat.claims.section_v import Runs
from barbalat.engine import Progress

Measurement = Callable[[Runs], list[Claim]]

CHEAP: tuple[Measurement, ...] = (
    lambda runs: [figures.erratum_claim(runs)],
    lambda _: tracking.claims(),
    lambda runs: [numerics.come_and_go(runs)],
    learning.claims,
    lambda _: [output_feedback()],
)
"""What rests on the figures' runs or takes seconds."""

THOROUGH: tuple[Measurement, ...] = (
    lambda runs: [figures.erratum_claim(runs)],
    lambda _: tracking.claims(),
    numerics.claims,
    stiff.claims,
    lambda _: robustness.claims(),
    learning.claims,
    lambda _: [output_feedback()],
)


def measure(runs: Runs, *, quick: bool = False, progress: Progress | None = None) -> list[Claim]:
    """The ledger; ``quick`` leaves out what takes longer than the figures themselves."""
    measurements = CHEAP if quick else THOROUGH
    ledger: list[Claim] = []
    for i, measurement in enumerate(measurements, start=1):
        ledger += measurement(runs)
        if progress is not None:
            progress(i / len(measurements))
    return ledger


def output_feedback() -> Claim:
    """A statement that waits for its scheme."""
    return Claim(
        id="l1-output-is-lti",
        where="Section IV",
        statement="The L1 output-feedback controller is an LTI controller with integral action and anti-windup",
        verdict="pending",
        measured="nothing yet",
        how="waits for the output-feedback schemes",
    )
