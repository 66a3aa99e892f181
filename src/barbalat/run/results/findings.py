"""Findings of a finished run: a demand that swings between the actuator's limits, and an error that runs away.

A limit cycle between the limits leaves the estimates at rest. The demand is looked at by its least and greatest values between
recorded instants, so that nothing is lost to decimation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Signal
from barbalat.validate import Array

TAIL = 0.75
"""Of the run: where its last quarter begins."""
FEWEST_SWITCHES = 8
"""From one limit to the other in the tail, one in each eighth of it, so that the swinging lasts until the end."""
SWITCHES_EACH_TURN = 2
"""A jump of the command may take the demand to one limit, and the overshoot after it to the other."""
LONGEST_PAUSE = 10.0
"""Between two switches, as a multiple of the usual pause in the tail; before a longer one the swinging had not begun."""
INSTANTS = 2**16
"""Of the tail, at which the signals are looked at."""


@dataclass(frozen=True, kw_only=True)
class RailToRail:
    """A demand that goes from one limit of the actuator to the other, again and again, until the run ends.

    limits    lower and upper
    since     when it begins [s]
    switches  how often it goes from one limit to the other in the last quarter, at least
    turns     how often the command and the disturbances turn or jump there
    input     its number among several, from 1; None for the only one
    noisy     whether measurement noise is on, which a controller may amplify up to the limits
    """

    limits: tuple[float, float]
    since: float
    switches: int
    turns: int
    input: int | None = None
    noisy: bool = False

    @property
    def sentence(self) -> str:
        """The finding as a sentence."""
        demand = "the demand" if self.input is None else f"the demand u_{self.input}"
        low, high = self.limits
        cause = "a limit cycle, or measurement noise that the controller amplifies" if self.noisy else "a limit cycle"
        return (
            f"{demand} swings from limit to limit ({low:g} to {high:g}) from t = {self.since:.4g} s until the end, at least "
            f"{self.switches} times in the last quarter, where the command and the disturbances turn {self.turns} times: {cause}"
        )

    def as_json(self) -> dict[str, Any]:
        """With the sentence."""
        return asdict(self) | {"sentence": self.sentence}


def rail_to_rail(problem: TrackingProblem, t: Array, t_end: float, u_min: Array, u_max: Array) -> RailToRail | None:
    """The first input of a run that swings between its limits; for a run that did not diverge.

    t (K,) are the recorded instants, u_min and u_max (K - 1, m) the extrema of the demands between them.

    None where no input has limits, or where none swings more often than the command and the disturbances turn.
    """
    paths = problem.plant.paths
    for i, path in enumerate(paths):
        if path.saturation is None:
            continue
        low, high = map(float, path.saturation)
        at = t[:-1][_switches(u_max[:, i] >= high, u_min[:, i] <= low)]
        tail = at[at >= TAIL * t_end]
        if not np.histogram(tail, bins=FEWEST_SWITCHES, range=(TAIL * t_end, t_end))[0].all():
            continue
        turns = _turns(problem.signals, t_end)
        if len(tail) <= SWITCHES_EACH_TURN * turns:
            continue
        pauses = np.flatnonzero(np.diff(at) > LONGEST_PAUSE * np.median(np.diff(tail)))
        since = float(at[pauses[-1] + 1] if len(pauses) else at[0])
        return RailToRail(
            limits=(low, high),
            since=since,
            switches=len(tail),
            turns=turns,
            input=i + 1 if len(paths) > 1 else None,
            noisy=problem.noise is not None,
        )
    return None


def _switches(up: Array, down: Array) -> Array:
    """The intervals in which a demand that was at one limit is at the other; both in one interval count once."""
    found, last = [], 0
    for k in np.flatnonzero(up | down):
        here = 0 if up[k] and down[k] else 1 if up[k] else -1
        if here in (0, -last):
            found.append(k)
        last = here
    return np.array(found, dtype=int)


def _turns(signals: Sequence[Signal], t_end: float) -> int:
    """How often these signals jump, or begin to move, or turn back, in the last quarter of the run."""
    t, found = np.linspace(TAIL * t_end, t_end, INSTANTS), 0
    for signal in signals:
        steps = np.sign(np.diff(np.asarray(signal(t), dtype=float)))
        moving = steps[steps != 0]
        found += int((moving[1:] != moving[:-1]).sum()) + int(((steps[1:] != 0) & (steps[:-1] == 0)).sum())
    return found


OUT_OF_PROPORTION = 1e3
"""|e| over the size of the model's motion: 60 dB above all that was commanded. Transients of high gains stay far below."""
STILL_GROWING = 1.2
"""|e| in the last quarter over that in the one before: growth like t gives 4/3, an exponential that came this far above 5."""


@dataclass(frozen=True)
class Runaway:
    """An error that is out of proportion and grows to the end: ``reaches`` is the largest |e|, ``ratio`` that over the motion."""

    reaches: float
    ratio: float

    @property
    def sentence(self) -> str:
        """The finding as a sentence."""
        return (
            f"|e| reaches {self.reaches:.3g}, {self.ratio:.2g} times the model's motion, and still grows at the end: "
            "the run runs away, though it has not diverged"
        )

    def as_json(self) -> dict[str, float]:
        """For ``run --json``."""
        return {"max_abs_e": self.reaches, "over_model": self.ratio}


def runaway(e_min: Array, e_max: Array, motion: Array) -> Runaway | None:
    """From the extrema of e over K intervals, (K, n), and the model's motion (..., n); None of a run that stays in proportion.

    Where the model stands still, the error at the start is what there is to compare with. Components may differ in their units:
    each is held against the largest of all.
    """
    reached = np.maximum(-e_min, e_max).max(axis=1, initial=0.0)
    size = float(np.abs(motion).max(initial=0.0)) or float(reached[:1].max(initial=0.0))
    quarter = len(reached) // 4
    if quarter == 0 or size == 0:
        return None
    last, before = float(reached[-quarter:].max()), float(reached[-2 * quarter : -quarter].max())
    grows = last > OUT_OF_PROPORTION * size and last > STILL_GROWING * before
    return Runaway(last, last / size) if grows else None
