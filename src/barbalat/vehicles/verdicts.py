"""The judge for flight models, which evaluates its operations over a flight's record sample by sample.

Each vehicle has its own criteria for a loss, such as an envelope or the ground. Flights are not continued with the command held
and without gusts and noise, so limit cycles can only be suspected, not confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.judge.along import along
from barbalat.judge.cycles import explained, suspects
from barbalat.judge.held import Held
from barbalat.judge.judged import Cycles, Judged, Kept
from barbalat.judge.memory import Memory, Sample
from barbalat.judge.scale import ROUNDING
from barbalat.judge.settings import CYCLE_SHARE, Judge
from barbalat.judge.verdict import Class, Verdict, percent
from barbalat.validate import Array, counted

TAIL_SHARE = 0.75
"""Fraction of a flight's duration that precedes its tail."""
WHOLE_SWING = 0.8
"""Fraction of the range of a control. If its average motion between reversals is larger, it swings from limit to limit."""
SWINGS = "swings from limit to limit"


@dataclass(frozen=True, eq=False)
class Followed:
    """The judge's data for a flight of K samples: n tracking components, m controls with limits, q commands.

    names, units  names and units of the components; the unit of the controls
    y, y_m        (K, n) the actual motion and the commanded one
    u, limited    (K, m) the demanded controls, and the controls after their limits
    limits        (2, m) the ends of the controls' ranges
    commands      (K, q) the commands
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    y: Array
    y_m: Array
    u: Array
    limited: Array
    limits: Array
    commands: Array
    input_unit: str = ""

    @property
    def samples(self) -> Sample:
        """The samples in the form for the judge, over the instants."""
        low, high = self.limits
        at_limit, nothing = ((self.u >= high) | (self.u <= low)).astype(float), np.zeros_like(self.u)
        steps = np.ones((len(self.y), 1))
        return Sample(self.y, self.y_m, self.y - self.y_m, self.u, self.limited, at_limit, nothing, self.commands, steps)


def verdict_of(seen: Followed, t: Array, duration: float, lost: str) -> Verdict:
    """Return the verdict on a flight with samples at t (K,) [s] and the planned duration [s]. A nonempty ``lost`` means that the
    flight was lost."""
    inputs, tail = seen.u.shape[1], int(np.searchsorted(t, TAIL_SHARE * duration))
    memory = Memory(
        components=seen.y.shape[1],
        inputs=inputs,
        commands=seen.commands.shape[1],
        limited=(True,) * inputs,
        rate_limited=(False,) * inputs,
        hysteresis=CYCLE_SHARE,
        weighed=True,
    )
    head, rest = (Sample(*(part[which] for part in seen.samples)) for which in (slice(0, tail), slice(tail, None)))
    ranges = np.diff(seen.limits, axis=0)[0]
    before = along(memory, head, ranges)
    whole = along(memory, rest, ranges, start=before, renewed=True) if len(rest.y) else before
    kept = Kept(memory, before[:, None], whole[:, None])
    model = kept.of("largest y_m")
    scale = np.where(model > ROUNDING * model.max(), model, model.max())
    bands = replace(Judge().bands(seen.names, seen.units, scale), lost=np.full_like(scale, np.inf))
    suspect = suspects(kept.reversals)
    found = Judged.of(
        kept,
        bands,
        Cycles.none(1, inputs, suspect),
        lost_at=t[-1:],
        diverged=np.array([bool(lost)]),
        dt=float(t[-1]) / max(len(t) - 1, 1),
        steps=len(t) - 1,
    )
    verdict = found.verdict(0)
    return verdict if verdict.kind is Class.LOST else replace(verdict, suspect=_suspected(seen, kept, tail, t))


def _suspected(seen: Followed, kept: Kept, tail: int, t: Array) -> str:
    """Return a sentence on motion of the controls in the tail that the commands do not explain; empty if there is none."""
    if tail >= len(t):
        return ""
    reversals, swings = kept.reversals, kept.swings
    limited = kept.in_tail("at limit") / (len(t) - tail)
    held = Held.along(seen.commands[tail:].T)
    if not suspects(reversals)[0] or explained(reversals, swings, limited, held)[0]:
        return ""
    worst = int(swings[0].argmax())
    count = int(reversals[0, worst])
    each = swings[0, worst] / count if count else 0.0
    if each > WHOLE_SWING:
        return f"{SWINGS} in the tail, {count} times"
    return f"its control reverses {count} times in the tail, by {percent(each)} of its range"


def said_of(verdicts: Sequence[Verdict]) -> str:
    """Summarise a controller's flights in one sentence: "follows in 7, is off in 3, is lost in 1 of 11 flights, ..."."""
    counts = {kind: sum(one.kind is kind for one in verdicts) for kind in (Class.FOLLOWS, Class.OFF, Class.LOST)}
    words = {Class.FOLLOWS: "follows in", Class.OFF: "is off in", Class.LOST: "is lost in"}
    said = ", ".join(f"{words[kind]} {count}" for kind, count in counts.items() if count)
    parts = [f"{said} of {counted(len(verdicts), 'flight')}"]
    errors = [one.error / one.scale for one in verdicts if one.kind is not Class.LOST and one.error is not None and one.scale > 0]
    if errors:
        parts.append(f"its largest error {percent(max(errors))}")
    most = max((max(one.at_limit, default=0.0) for one in verdicts), default=0.0)
    if most > 0:
        parts.append(f"at its limits up to {percent(most)} of the time")
    if swinging := sum(one.suspect.startswith(SWINGS) for one in verdicts):
        parts.append(f"it {SWINGS} in {swinging}")
    return ", ".join(parts)
