"""What the judge says of one run: a value that prints as a sentence."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

LEAST_SAID = 0.001
"""Of the time: what a control spends less of at its limits is no matter of the sentence."""
FOLLOWS_SHARE = 0.05
"""The default band of the tail's error, as a part of a component's scale."""


class Class(StrEnum):
    """What a run did; the first of these that holds."""

    LOST = "lost"
    CYCLE = "limit cycle"
    OFF = "off"
    FOLLOWS = "follows"


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """A control that swings for ever with command and disturbances held and without noise.

    signal     which control, such as "u_limited[0]": what the limits leave of the demand
    amplitude  half of its swing, in the control's unit
    frequency  [rad/s], by its passes from low to high; 0 where it was not measured
    """

    signal: str
    amplitude: float
    frequency: float

    @property
    def number(self) -> int:
        """The input's number, from 0."""
        return int(self.signal.partition("[")[2].rstrip("]"))

    def as_json(self) -> dict[str, Any]:
        """By the names of the JSON contract."""
        return {"signal": self.signal, "amplitude": self.amplitude, "frequency": self.frequency}


@dataclass(frozen=True, kw_only=True)
class Response:
    """A component's response to the command's steps, the worst over all of them, by the names of python-control's ``step_info``.

    RiseTime      [s] from 10 to 90 % of the step; None where a step is not risen to
    SettlingTime  [s] into the judge's band; None where the response does not settle before the next step, or the end
    Overshoot     [% of the step]
    """

    RiseTime: float | None
    SettlingTime: float | None
    Overshoot: float

    def as_json(self) -> dict[str, float | None]:
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What else is measured over every solver step.

    IAE, ITAE  (n,) integrals of |e| and of t |e|
    activity   (m,) the path of the limited control, the integral of |u'|; and how often it reverses
    responses  by components, where the command moves in steps; else empty
    """

    IAE: tuple[float, ...]
    ITAE: tuple[float, ...]
    activity: tuple[float, ...]
    reversals: tuple[int, ...]
    responses: dict[str, Response] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "IAE": list(self.IAE),
            "ITAE": list(self.ITAE),
            "control_activity": list(self.activity),
            "control_reversals": list(self.reversals),
        }
        return found | ({"step_info": {name: one.as_json() for name, one in self.responses.items()}} if self.responses else {})


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a run did, judged by its signals over every solver step.

    kind           lost, limit cycle, off (bounded, but outside the band), or follows
    component      the name of the component that is worst against its own band
    error, band    of that component in the plant's unit: the tail's largest |error|, and the band
    scale          what the component's band is a part of by default
    settled        whether it is the plant's and not the solver's; None where that was not examined
    cycle          the limit cycle; None where there is none
    at_limit       share of the time at which each input is at its limits, and ``at_rate_limit`` at its rate limit
    lost_at        by when the run was lost [s]; None where it was not
    lost_within    how much earlier that may have been [s]; 0 where it is known to the step
    lost_when_held whether a suspect that is not lost in its run is lost when it is continued with everything held
    figures        IAE and the like; None where they were not asked for
    bands          of all components, as they are said
    of_the_solver  whether a finer step comes to the same class without the oscillation that the run shows
    suspect        what looks like a limit cycle where no run can be taken further, as beside a flight model; else empty
    """

    kind: Class
    component: str
    error: float | None
    band: float
    scale: float
    unit: str = ""
    input_unit: str = ""
    settled: bool | None = None
    cycle: Cycle | None = None
    at_limit: tuple[float, ...] = ()
    at_rate_limit: tuple[float, ...] = ()
    lost_at: float | None = None
    figures: Figures | None = None
    bands: str = ""
    suspect: str = ""
    of_the_solver: bool = False
    lost_within: float = 0.0
    lost_when_held: bool = False

    def __str__(self) -> str:
        """Such as "follows within 3 %, at its limits 12 % of the time"."""
        said = [self._said, *self._limits, *([self.suspect] if self.suspect else [])]
        if self.of_the_solver:
            said.append("at a finer step too, but its oscillation is the solver's")
        if self.settled is False:
            said.append("not settled by the solver")
        return ", ".join(said)

    @property
    def _said(self) -> str:
        if self.kind is Class.LOST:
            return "lost" if self.lost_at is None else f"lost at t = {self.lost_at:.4g} s"
        if self.kind is Class.CYCLE:
            assert self.cycle is not None
            unit = f" {self.input_unit}" if self.input_unit else ""
            at = f" at {self.cycle.frequency:.3g} rad/s" if self.cycle.frequency else ""
            return f"limit cycle, u swings by ±{self.cycle.amplitude:.3g}{unit}{at}"
        how = "follows within" if self.kind is Class.FOLLOWS else "off by"
        return f"{how} {self._error}"

    @property
    def _error(self) -> str:
        """As a part of the scale; in the plant's unit where the band was given in it, or where nothing sets a scale."""
        assert self.error is not None
        unit, where = (
            f" {self.unit}" if self.unit else "",
            "" if self.kind is Class.FOLLOWS else f" in {self.component}",
        )
        if self.band != FOLLOWS_SHARE * self.scale:
            return f"{self.error:.3g}{unit}{where} (band {self.band:.3g}{unit})"
        if not self.scale > 0:
            return f"{self.error:.3g}{unit} in {self.component}" + (" (nothing sets its scale)" if self.error > 0 else "")
        return percent(self.error / self.scale) + where

    @property
    def _limits(self) -> list[str]:
        said = []
        for shares, what in ((self.at_limit, "limits"), (self.at_rate_limit, "rate limit")):
            share = max(shares, default=0.0)
            if share >= LEAST_SAID:
                said.append(f"at its {what} {percent(share)} of the time")
        return said

    def as_json(self) -> dict[str, Any]:
        """By the names of the JSON contract."""
        return {
            "class": str(self.kind),
            "error": self.error,
            "band": self.band,
            "component": self.component,
            "scale": self.scale,
            "settled": self.settled,
            "cycle": None if self.cycle is None else self.cycle.as_json(),
            "at_limit": list(self.at_limit),
            "at_rate_limit": list(self.at_rate_limit),
            "lost_at": self.lost_at,
            "lost_within": None if self.lost_at is None else self.lost_within,
            "lost_when_held": self.lost_when_held,
            "bands": self.bands,
            "sentence": str(self),
            **({"suspect": self.suspect} if self.suspect else {}),
        }


def percent(share: float) -> str:
    """With two digits: "3 %", "0.021 %"; a share that is not 0 never reads as 0."""
    return f"{float(np.format_float_positional(100 * share, 2, fractional=False)):.12g} %"
