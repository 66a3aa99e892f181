"""The label of a run that left its solver's region of stability, and whose its oscillation is: a finer step tells.

Source: docs/numerics.md. The finer run decides only as far as it stayed inside the region itself. The solver is blamed for a
divergence only where a finer step takes that away.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from barbalat.judge.verdict import Class
from barbalat.run.kernel.metrics import Metrics
from barbalat.validate import Array

Origin = Literal["solver", "loop", "both", "unsettled"]

EQUAL_FIGURES_SHARE = 0.1
"""Figures that differ by less than this fraction are called the same: far above the finer step's own error, far below decades."""
REMAINDER_SHARE = 0.1
"""Where less than this fraction of a figure is left at the finer step, the solver made it; where more is left, at most a part."""
ROUNDING_SHARE = 1e-5
"""Of the model's state, of the control, of the estimates: a figure below this shows roundings and what has settled."""
SAME_TIME_SHARE = 0.01
"""Divergences within this share of their time come at about the same time; those of an escape converge as the step falls."""
OWN_GROWTH_FACTOR = 3.0
"""An error that was this many times as large as the model's state while the run was still sound grows by itself."""


@dataclass(frozen=True)
class FinerStep:
    """What a finer step says of a labelled run.

    origin   "solver": the finer run does without what the coarse one shows; "loop": it shows the same; "both": less, or more;
             "unsettled": no step that could be afforded stayed inside the region of stability
    sentence the same for people, with the numbers
    dt       the finer step [s], t_end the horizon [s] over which the two are compared; None where none could be afforded
    diverged_at  when the finer run diverged [s], the finest one that was tried; None where it did not
    kind     the judge's class of the finer run over the whole time, where that stayed inside the region; else None
    """

    origin: Origin
    sentence: str
    dt: float | None = None
    t_end: float | None = None
    diverged_at: float | None = None
    kind: Class | None = None

    def as_json(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if name != "kind"}


@dataclass(frozen=True, eq=False)
class Seen:
    """What is compared of a run: figures, the time [s] of its label, the largest |e| until then; (p,) the estimates' path.

    model, estimates  the largest |x_m| and |theta_hat_i|: the size of the signals
    sample_time       of a law that is sampled by Euler steps [s], else None
    kind              the judge's class
    """

    dt: float
    metrics: Metrics
    unstable_from: float | None
    sound_error: float
    path: Array
    model: float
    estimates: float
    steps: int
    sample_time: float | None = None
    kind: Class | None = None

    @property
    def diverged_at(self) -> float | None:
        return self.metrics.end_of(0)


def compare(coarse: Seen, fine: Seen, t_end: float, *, whole: bool) -> FinerStep | None:
    """The verdict over [0, t_end], the whole run or a part; None where the finer run left the region too and says nothing."""
    details = [] if fine.sample_time is None else [f"sampled every {fine.sample_time:g} s"]
    details += [] if whole else [f"up to t = {t_end:g} s"]
    at = "".join([f"at h = {fine.dt:g} s", *(f", {detail}" for detail in details), "," if details else ""])
    if coarse.diverged_at is None and fine.diverged_at is None:
        found = None if fine.unstable_from is not None else _figures(coarse, fine, at)
    else:
        found = _divergences(coarse, fine, at)
    if found is None:
        return None
    kind = fine.kind if whole and fine.unstable_from is None else None
    return FinerStep(*found, dt=fine.dt, t_end=t_end, diverged_at=fine.diverged_at, kind=kind)


def at_the_same_time(one: float, other: float) -> bool:
    """Whether two divergences [s] come at about the same time."""
    return abs(one - other) <= SAME_TIME_SHARE * max(one, other)


def _divergences(coarse: Seen, fine: Seen, at: str) -> tuple[Origin, str] | None:
    """Where one of the two runs, or both, did not stay bounded."""
    if coarse.diverged_at is not None and fine.diverged_at is not None:
        if fine.unstable_from is None:
            return "loop", f"the divergence is the loop's own: {at} it comes at t = {fine.diverged_at:.4g} s"
        if fine.sound_error > OWN_GROWTH_FACTOR * fine.model:
            return "loop", (
                f"the divergence is the loop's own: {at} the run is sound until t = {fine.unstable_from:.4g} s, and |e| has "
                f"grown to {fine.sound_error:.3g} by then; the model's largest |x_m| is {fine.model:.3g}"
            )
        return None
    if fine.unstable_from is not None:
        return None
    if fine.diverged_at is not None:
        return "both", f"the {_whose(fine)} hides a divergence: {at} the run diverges at t = {fine.diverged_at:.4g} s"
    bounded = f"{at} the run stays bounded, max |e| {_text(fine.metrics.max_abs_e[0])}"
    return "solver", f"the divergence is the {_whose(fine)}'s: {bounded}"


def _figures(coarse: Seen, fine: Seen, at: str) -> tuple[Origin, str]:
    """Where both stayed bounded: what the finer step changes."""
    before, after = _compared(coarse), _compared(fine)
    pairs = {text: (value, after[text][0]) for text, (value, _) in before.items()}
    ratios = {text: _ratio(*pair, ROUNDING_SHARE * max(before[text][1], after[text][1])) for text, pair in pairs.items()}
    changed = [
        f"{text} {'falls' if ratios[text] < 1 else 'rises'} from {_text(coarsely)} to {_text(finely)}"
        for text, (coarsely, finely) in pairs.items()
        if abs(ratios[text] - 1) > EQUAL_FIGURES_SHARE
    ]
    if not changed:
        same = ", ".join(f"{text} {_text(finely)}" for text, (_, finely) in pairs.items())
        return "loop", f"what the run shows is the loop's own: {at} it is the same within {EQUAL_FIGURES_SHARE:.0%} ({same})"
    numbers = f"{at} {', '.join(changed)}"
    if min(ratios.values()) < REMAINDER_SHARE:
        return "solver", f"the oscillation is the {_whose(fine)}'s: {numbers}"
    return "both", f"what the run shows is not the {_whose(fine)}'s alone: {numbers}"


def _whose(fine: Seen) -> str:
    return "solver" if fine.sample_time is None else "sampled law"


def _compared(seen: Seen) -> dict[str, tuple[Array, float]]:
    """The figures of the tail and of the whole run, each with the size of what it is a figure of."""
    found, span = seen.metrics, seen.dt * seen.steps
    return {
        "the estimates' variation [1/s] in the tail": (found.theta_hat_variation_rate[0], 4 * seen.estimates / span),
        "their path in all": (seen.path, seen.estimates),
        "max |e| in the tail": (found.tail_max_abs_e[0], seen.model),
        "max |e| in all": (found.max_abs_e[0], seen.model),
        "max |u|": (found.max_abs_u[0], float(np.max(found.max_abs_u[0]))),
    }


def _ratio(before: Array, after: Array, noise: float) -> float:
    """All components together: after / before."""
    least = noise + 1e-300  # figures of nothing at all are the same
    return float((np.sum(after) + least) / (np.sum(before) + least))


def _text(values: Array) -> str:
    return ", ".join(f"{v:.3g}" for v in np.atleast_1d(values))


def label(unstable_from: float | None, diverged_at: float | None, kind: Class | None, check: FinerStep | None) -> str | None:
    """None for a run that stayed inside, or whose class, ``kind``, a finer step finds too and shows no less. Times in s.

    That a run left the region makes it a suspect; what it shows is the solver's where ``check``, what a finer step says, does
    without it. A true finite escape leaves every step's region of stability just before it: neither the exit nor a finer step
    that exits too says whose the divergence is.
    """
    if unstable_from is None:
        return None
    outside = f"outside the region of stability from t = {unstable_from:.4g} s"
    diverges = "" if diverged_at is None else f"diverges at t = {diverged_at:.4g} s, "
    if check is None:
        return f"{diverges}{outside}, not settled without a finer step (check_numerics)"
    if check.origin == "solver" or (diverged_at is None and check.kind is not None and check.kind is not kind):
        return f"numerically unstable from t = {unstable_from:.4g} s"
    if check.origin != "unsettled":
        return None if diverged_at is None else f"{diverges}{outside}"
    if diverged_at is not None and check.diverged_at is not None and at_the_same_time(diverged_at, check.diverged_at):
        return f"{diverges}also at h = {check.dt:g} s: not settled whose it is"
    return f"{diverges}{outside}: not settled whose it is"
