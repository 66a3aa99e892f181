"""The label of a run that left the stability region of its solver. A finer step shows whether the solver causes the oscillation.

Source: docs/numerics.md. The finer run decides only up to the time at which it also leaves the region. A divergence is attributed
to the solver only if a finer step removes it.
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
"""Metrics that differ by less than this fraction count as equal. It is far above the error of the finer step and far below a
decade."""
REMAINDER_SHARE = 0.1
"""If less than this fraction of a metric remains at the finer step, the metric is due to the solver; otherwise it is due to the
solver at most in part."""
ROUNDING_SHARE = 1e-5
"""A metric below this fraction of the model's state, the control or the estimates is rounding error or belongs to settled
motion."""
SAME_TIME_SHARE = 0.01
"""Divergences within this fraction of their time count as simultaneous; the times of a finite escape converge as the step is
reduced."""
OWN_GROWTH_FACTOR = 3.0
"""An error this many times as large as the model's state, in a run that is still inside the region, grows because of the loop."""


@dataclass(frozen=True)
class FinerStep:
    """The result of a finer step for a labelled run.

    origin   "solver": the finer run does not show the behaviour of the coarse one; "loop": it shows the same; "both": it shows
             a weaker or stronger form; "unsettled": no affordable step stayed inside the region of stability
    sentence the result as a sentence with numbers
    dt       the finer step [s], and t_end the horizon [s] over which the two are compared; None if none could be afforded
    diverged_at  when the finest run tried diverged [s]; None if it did not
    kind     the judge's class of the finer run over the whole time, if it stayed inside the region; otherwise None
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
    """The compared quantities of a run: metrics, the time [s] of its label, the largest |e| until then, and (p,) the path of the
    estimates.

    model, estimates  the largest |x_m| and |theta_hat_i|, as the size of the signals
    sample_time       sample time [s] of a law that is sampled by Euler steps, otherwise None
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
    """The check over [0, t_end], which is the whole run or a part of it; None if the finer run also left the region and decides
    nothing."""
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
    """Whether two divergences [s] occur at about the same time."""
    return abs(one - other) <= SAME_TIME_SHARE * max(one, other)


def _divergences(coarse: Seen, fine: Seen, at: str) -> tuple[Origin, str] | None:
    """The result if one of the two runs, or both, diverged."""
    if coarse.diverged_at is not None and fine.diverged_at is not None:
        if fine.unstable_from is None:
            return "loop", f"the loop itself diverges: {at} the run diverges at t = {fine.diverged_at:.4g} s"
        if fine.sound_error > OWN_GROWTH_FACTOR * fine.model:
            return "loop", (
                f"the loop itself diverges: {at} the run is numerically stable until t = {fine.unstable_from:.4g} s, "
                f"and |e| has "
                f"grown to {fine.sound_error:.3g} by then; the model's largest |x_m| is {fine.model:.3g}"
            )
        return None
    if fine.unstable_from is not None:
        return None
    if fine.diverged_at is not None:
        return "both", f"the {_whose(fine)} hides a divergence: {at} the run diverges at t = {fine.diverged_at:.4g} s"
    bounded = f"{at} the run stays bounded, max |e| {_text(fine.metrics.max_abs_e[0])}"
    return "solver", f"the divergence is due to the {_whose(fine)}: {bounded}"


def _figures(coarse: Seen, fine: Seen, at: str) -> tuple[Origin, str]:
    """The result if both stayed bounded: the effect of the finer step."""
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
        within = f"within {100 * EQUAL_FIGURES_SHARE:.0f} %"
        return "loop", f"the result is due to the loop itself: {at} it is the same {within} ({same})"
    numbers = f"{at} {', '.join(changed)}"
    if min(ratios.values()) < REMAINDER_SHARE:
        return "solver", f"the oscillation is due to the {_whose(fine)}: {numbers}"
    return "both", f"the result is not only due to the {_whose(fine)}: {numbers}"


def _whose(fine: Seen) -> str:
    return "solver" if fine.sample_time is None else "sampled law"


def _compared(seen: Seen) -> dict[str, tuple[Array, float]]:
    """The metrics of the tail and of the whole run, each with its reference size."""
    found, span = seen.metrics, seen.dt * seen.steps
    return {
        "the estimates' variation [1/s] in the tail": (found.theta_hat_variation_rate[0], 4 * seen.estimates / span),
        "the estimates' total path": (seen.path, seen.estimates),
        "max |e| in the tail": (found.tail_max_abs_e[0], seen.model),
        "max |e| over the run": (found.max_abs_e[0], seen.model),
        "max |u|": (found.max_abs_u[0], float(np.max(found.max_abs_u[0]))),
    }


def _ratio(before: Array, after: Array, noise: float) -> float:
    """The ratio after/before over all components together."""
    least = noise + 1e-300  # metrics of vanishing quantities count as equal
    return float((np.sum(after) + least) / (np.sum(before) + least))


def _text(values: Array) -> str:
    return ", ".join(f"{v:.3g}" for v in np.atleast_1d(values))


NOT_REPEATED = ", not settled without a finer step (check_numerics)"
"""The end of the label of a run that was not repeated."""


def label(unstable_from: float | None, diverged_at: float | None, kind: Class | None, check: FinerStep | None) -> str | None:
    """The label; None for a run that stayed inside the region, or whose class ``kind`` a finer step confirms with at least as
    much oscillation. Times are in s.

    A run that left the region is suspect; the solver causes its behaviour if ``check``, with a finer step, does not show it. A
    true finite escape leaves the stability region of any step just before it happens. Therefore neither the exit nor a finer step
    that also leaves the region shows whether the solver causes the divergence.
    """
    if unstable_from is None:
        return None
    outside = f"outside the region of stability from t = {unstable_from:.4g} s"
    diverges = "" if diverged_at is None else f"diverges at t = {diverged_at:.4g} s, "
    if check is None:
        return f"{diverges}{outside}{NOT_REPEATED}"
    if check.origin == "solver" or (diverged_at is None and check.kind is not None and check.kind is not kind):
        return f"numerically unstable from t = {unstable_from:.4g} s"
    if check.origin != "unsettled":
        return None if diverged_at is None else f"{diverges}{outside}"
    if diverged_at is not None and check.diverged_at is not None and at_the_same_time(diverged_at, check.diverged_at):
        return f"{diverges}also at h = {check.dt:g} s: whether plant or solver causes it is not settled"
    return f"{diverges}{outside}: whether plant or solver causes it is not settled"
