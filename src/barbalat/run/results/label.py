"""The few words for a run that left its region of stability.

The solver is blamed for a divergence only where a finer step takes that away.
"""

from __future__ import annotations

from barbalat.run.results.step_comparison import FinerStep, at_the_same_time


def label(unstable_from: float | None, diverged_at: float | None, check: FinerStep | None) -> str | None:
    """None for a run that stayed inside. Times in s; ``check`` is what a finer step says, if one was run.

    A true finite escape leaves every step's region of stability just before it: neither the exit nor a finer step that exits too
    says whose the divergence is.
    """
    if unstable_from is None:
        return None
    exit_text = f"numerically unstable from t = {unstable_from:.4g} s"
    if diverged_at is None or (check is not None and check.origin == "solver"):
        return exit_text
    diverges = f"diverges at t = {diverged_at:.4g} s"
    outside = f"outside the solver's region of stability from t = {unstable_from:.4g} s"
    if check is None:
        return f"{diverges}, {outside}: not settled whose it is without a finer step (check_numerics)"
    if check.origin != "unsettled":
        return f"{diverges}, {outside}"
    if check.diverged_at is not None and at_the_same_time(diverged_at, check.diverged_at):
        return f"{diverges}, also at h = {check.dt:g} s: not settled whose it is"
    return f"{diverges}, {outside}: not settled whose it is"
