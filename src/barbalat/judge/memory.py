"""The judge's operations: the quantities kept for a run and how a sample updates them. The run need not be recorded.

The same lines are evaluated on CasADi's arrays, from which kernels, C and pages are generated, and on NumPy's. The memory is a
flat vector with named rows of extrema, counts and sums. The verdict follows from the memory alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from barbalat.protocols import Value

LEAST_RANGE = 1e-6
"""A control without limits counts as moving if it covers at least this fraction of its largest magnitude. Less is rounding."""
RISES_FROM, RISES_TO = 0.1, 0.9
"""The fractions of a step between which the rise time is measured, as in python-control's ``step_info``."""


class Sample(NamedTuple):
    """The judge's input at an instant, for n components of the error, m inputs and q commands.

    y, y_m         (n,) the state x or the measured output, of the plant and of the model
    e              (n,) y - y_m
    u              (m,) the demand, before the limits
    limited        (m,) the demand after the limits
    at_limit       (m,) 1 if the demand is at or beyond a limit and, with a rate limit, the control has arrived there, otherwise
                   0; 0 without limits
    at_rate_limit  (m,) 1 if the rate limit is active, otherwise 0
    r              (q,) the commands
    steps          the duration that the sample represents, in solver steps: 1, or less for a piece of a step
    """

    y: Value
    y_m: Value
    e: Value
    u: Value
    limited: Value
    at_limit: Value
    at_rate_limit: Value
    r: Value
    steps: Value


class Begins(IntEnum):
    """The events at which a quantity restarts: the run alone, the run and each window of a continuation, or also the tail."""

    RUN = 0
    WINDOW = 1
    TAIL = 2


class Rows(NamedTuple):
    """A quantity in the memory.

    begins   value before the first sample
    renewed  when the quantity restarts
    """

    name: str
    size: int
    begins: float = 0.0
    renewed: Begins = Begins.RUN


@dataclass(frozen=True)
class Memory:
    """The memory for a loop with n components of e, m inputs and q commands.

    limited     (m,) whether each input has limits, which then define its range; otherwise its range is what it has covered in the
                tail, or in the run so far, but at least its largest magnitude there
    hysteresis  a reversal counts once the control has moved back by this fraction of its range
    weighed     whether to keep the sum of the points at which each control turned back (see ``Kept.swings``)
    detailed    whether to keep what sweeps don't need: IAE, ITAE, the control's path, and the responses to steps of the command
    gains       (n, q) steady-state gains of the model's components if responses are wanted; otherwise empty
    bands       (n,) bands for settling, NaN for the fraction ``settles`` of the model's largest motion so far
    """

    components: int
    inputs: int
    commands: int
    limited: tuple[bool, ...]
    rate_limited: tuple[bool, ...]
    hysteresis: float
    weighed: bool = False
    detailed: bool = False
    gains: tuple[tuple[float, ...], ...] = ()
    bands: tuple[float, ...] = ()
    settles: float = 0.05

    @cached_property
    def layout(self) -> tuple[Rows, ...]:
        """All quantities in the order of the memory."""
        n, m, q, inf = self.components, self.inputs, self.commands, np.inf
        found = [
            Rows("largest y_m", n), Rows("largest y", n), Rows("largest e", n, renewed=Begins.TAIL),
            Rows("farthest", m, -inf), Rows("direction", m, 1.0), Rows("reversals", m),
            Rows("low", m, inf, renewed=Begins.TAIL), Rows("high", m, -inf, renewed=Begins.TAIL),
            Rows("range", m, renewed=Begins.TAIL),
            Rows("at limit", sum(self.limited)), Rows("at rate limit", sum(self.rate_limited)),
        ]  # fmt: skip
        if self.weighed:
            found += [Rows("turned at", m)]
        if self.detailed:
            found += [Rows("before", m), Rows("path", m), Rows("steps", 1), Rows("IAE", n), Rows("ITAE", n)]
        if self.gains:
            found += [
                Rows("command", q), Rows("jumped at", 1), Rows("target", n), Rows("change", n), Rows("overshoot", n),
                Rows("rise from", n, inf), Rows("rising", n), Rows("rise", n), Rows("never risen", n),
                Rows("outside", n), Rows("settling", n), Rows("never settled", n),
            ]  # fmt: skip
        return tuple(found)

    @cached_property
    def places(self) -> dict[str, slice]:
        """The positions of each quantity's rows."""
        found, start = {}, 0
        for rows in self.layout:
            found[rows.name] = slice(start, start + rows.size)
            start += rows.size
        return found

    @cached_property
    def begins(self) -> tuple[float, ...]:
        """The memory before the first sample."""
        return tuple(rows.begins for rows in self.layout for _ in range(rows.size))

    def renewed(self, at: Begins) -> list[int]:
        """Return the rows that restart at this event."""
        return [i for rows in self.layout if rows.renewed >= at for i in range(*self.places[rows.name].indices(1 << 30))]

    @property
    def responses(self) -> slice:
        """The rows for the responses to steps of the command. A step at the very end of a run is not counted."""
        return slice(self.places["command"].start if self.gains else len(self.begins), None)

    def update(self, memory: Value, sample: Sample, ranges: Value) -> Value:
        """Return the memory (rows,) after one more sample. ``ranges`` (m,) are upper - lower for inputs with limits, and are
        ignored for others."""
        old = {name: memory[rows] for name, rows in self.places.items()}
        new = {
            "largest y_m": np.maximum(old["largest y_m"], np.abs(sample.y_m)),
            "largest y": np.maximum(old["largest y"], np.abs(sample.y)),
            "largest e": np.maximum(old["largest e"], np.abs(sample.e)),
            "low": np.minimum(old["low"], sample.limited),
            "high": np.maximum(old["high"], sample.limited),
        }
        new |= self._counted(old, sample) | self._reversed(old, new, sample, ranges)
        if self.detailed:
            new |= _detailed(old, sample)
        if self.gains:
            new |= self._responses(old, sample, new["largest y_m"])
        return np.concatenate([new[rows.name] for rows in self.layout])

    def _counted(self, old: dict[str, Value], sample: Sample) -> dict[str, Value]:
        """Return the number of steps for which the limits constrain the control."""
        at_limit = _chosen(sample.at_limit, self.limited)
        at_rate_limit = _chosen(sample.at_rate_limit, self.rate_limited)
        return {
            "at limit": old["at limit"] + sample.steps * at_limit,
            "at rate limit": old["at rate limit"] + sample.steps * at_rate_limit,
        }

    def _reversed(self, old: dict[str, Value], new: dict[str, Value], sample: Sample, ranges: Value) -> dict[str, Value]:
        """Return the rows on reversals. The limited control reverses when its distance from its farthest point exceeds the
        hysteresis.

        Everything is measured in the direction of motion, so a farther point has a larger value. A decrease at the start also
        counts as a reversal.
        """
        free = tuple(not limited for limited in self.limited)
        moved, far = _chosen(new["high"] - new["low"], free), _chosen(np.abs(sample.limited), free)
        covered = np.maximum(np.maximum(_chosen(old["range"], free), moved), far)
        width = _merged(ranges, covered, self.limited)
        along = old["direction"] * sample.limited
        farthest = np.maximum(old["farthest"], along)
        back = along - farthest < -self.hysteresis * width
        turned = {"turned at": old["turned at"] + np.where(back, farthest, 0.0 * along)} if self.weighed else {}
        return turned | {
            "farthest": np.where(back, -along, farthest),
            "direction": np.where(back, -old["direction"], old["direction"]),
            "reversals": old["reversals"] + np.where(back, 1.0, 0.0 * along),
            "range": width,
        }

    def _responses(self, old: dict[str, Value], sample: Sample, scale: Value) -> dict[str, Value]:
        """Return overshoot [fraction of the step], rise and settling time [steps], each the worst over all steps of the command
        so far."""
        now, begun = old["steps"], old["steps"] > 0
        given = np.array(self.bands)
        bands = np.where(np.isnan(given), 0.0, given) + np.where(np.isnan(given), self.settles, 0.0) * scale
        jumped = np.maximum(np.where(begun, 0.0, 1.0), np.where(np.sum(np.abs(sample.r - old["command"])) > 0, 1.0, 0.0))
        target = np.where(jumped > 0, np.array(self.gains) @ sample.r, old["target"])
        change = np.where(jumped > 0, target - np.where(begun, old["target"], sample.y), old["change"])
        since = now - np.where(jumped > 0, now, old["jumped at"])
        size = np.abs(change)
        beyond = np.where(change > 0, 1.0, -1.0) * (sample.y - target)  # below 0 on the way to the target
        passed = beyond / np.where(size > 0, size, 1.0)
        steps = np.where(size > 0, 1.0, 0.0)
        rise_from = np.where(jumped > 0, np.inf + 0.0 * size, old["rise from"])
        rise_from = np.where(steps * (passed >= RISES_FROM - 1) * (rise_from == np.inf) > 0, since + 0.0 * size, rise_from)
        waiting = np.where(jumped > 0, steps, old["rising"])
        risen = waiting * np.where(passed >= RISES_TO - 1, 1.0, 0.0)
        outside = steps * np.where(np.abs(sample.y - target) > bands, 1.0, 0.0)
        over = np.where(begun, jumped, 0.0)  # so the previous target no longer matters
        return {
            "command": sample.r,
            "jumped at": np.where(jumped > 0, now, old["jumped at"]),
            "target": target,
            "change": change,
            "overshoot": np.maximum(old["overshoot"], steps * np.maximum(passed, 0.0 * passed)),
            "rise from": rise_from,
            "rising": waiting - risen,
            "rise": np.maximum(old["rise"], np.where(risen > 0, since - rise_from, 0.0 * size)),
            "never risen": np.maximum(old["never risen"], over * old["rising"]),
            "outside": outside,
            "settling": np.maximum(old["settling"], outside * (since + sample.steps)),
            "never settled": np.maximum(old["never settled"], over * old["outside"]),
        }


def _detailed(old: dict[str, Value], sample: Sample) -> dict[str, Value]:
    """Return integrals in units of a step, by rectangles from the left."""
    begun = old["steps"] > 0
    absolute = sample.steps * np.abs(sample.e)
    return {
        "before": sample.limited,
        "path": old["path"] + np.where(begun, np.abs(sample.limited - old["before"]), 0.0 * sample.limited),
        "steps": old["steps"] + sample.steps,
        "IAE": old["IAE"] + absolute,
        "ITAE": old["ITAE"] + old["steps"] * absolute,
    }


def _chosen(values: Value, which: Sequence[bool]) -> Value:
    """Return the entries for which ``which`` is true."""
    return values[[i for i, wanted in enumerate(which) if wanted]]


def _merged(some: Value, others: Value, which: Sequence[bool]) -> Value:
    """Return the entries of ``some`` where ``which`` is true, and the entries of ``others`` elsewhere."""
    if all(which):
        return some
    rest = iter(range(len(which)))
    parts = [some[i : i + 1] if wanted else others[(k := next(rest)) : k + 1] for i, wanted in enumerate(which)]
    return np.concatenate(parts)
