"""The judge's verdict on one run, which prints as a sentence."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

LEAST_SAID = 0.001
"""Fraction of the time at limits below which the sentence does not mention them."""
FOLLOWS_SHARE = 0.05
"""The default band of the tail's error, as a fraction of a component's scale."""


class Class(StrEnum):
    """The classes of runs. The first that applies is the class of a run."""

    LOST = "lost"
    CYCLE = "limit cycle"
    OFF = "off"
    FOLLOWS = "follows"


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """A control that oscillates without decay while command and disturbances are held, without noise.

    signal     the control, such as "u_limited[0]", the demand after the limits
    amplitude  half of the peak-to-peak value, in the unit of the control
    frequency  [rad/s], from passes from low to high; 0 if it was not measured
    """

    signal: str
    amplitude: float
    frequency: float

    @property
    def number(self) -> int:
        """The index of the input, numbered from 0."""
        return int(self.signal.partition("[")[2].rstrip("]"))

    def as_json(self) -> dict[str, Any]:
        """Return the fields under the names of the JSON contract."""
        return {"signal": self.signal, "amplitude": self.amplitude, "frequency": self.frequency}


@dataclass(frozen=True, kw_only=True)
class Response:
    """The step response of a component, the worst over all steps of the command. The names are those of python-control's
    ``step_info``.

    RiseTime      [s] from 10 to 90 % of the step; None if the response does not reach it
    SettlingTime  [s] into the judge's band; None if the response does not settle before the next step or the end of the run
    Overshoot     [% of the step]
    """

    RiseTime: float | None
    SettlingTime: float | None
    Overshoot: float

    def as_json(self) -> dict[str, float | None]:
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Further quantities measured over every solver step.

    IAE, ITAE  (n,) integrals of |e| and of t |e|
    activity   (m,) path of the limited control, the integral of |u'|; ``reversals`` is the number of its reversals
    responses  by component, if the command moves in steps; otherwise empty
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
class Deviation:
    """The largest |error| of a component in the tail, and its band, both in the plant's unit. The default band is a fraction of
    the scale."""

    component: str
    error: float
    band: float
    scale: float
    unit: str = ""

    def said(self, *, named: bool) -> str:
        """Return the error as a fraction of the scale, or in the plant's unit if the band was given in that unit or there is no
        scale."""
        unit, where = f" {self.unit}" if self.unit else "", f" in {self.component}"
        if self.band != FOLLOWS_SHARE * self.scale:
            return f"{self.error:.3g}{unit}{where if named else ''} (band {self.band:.3g}{unit})"
        if not self.scale > 0:
            return f"{self.error:.3g}{unit}{where}" + (" (nothing sets its scale)" if self.error > 0 else "")
        return percent(self.error / self.scale) + (where if named else "")

    def as_json(self) -> dict[str, Any]:
        """Return the fields under the names of the JSON contract."""
        return {"component": self.component, "error": self.error, "band": self.band, "scale": self.scale}


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict on a run, from its signals over every solver step.

    kind           lost, limit cycle, off (bounded, but outside the band), or follows
    component      the name of the component that is worst relative to its band. For a run that is not lost, it is chosen among
                   the states that are declared to follow a command, unless the run is off and only other states are outside
                   theirs
    beside         the worst component if that is a different one; otherwise the worst of the declared states
    error, band    the tail's largest |error| of ``component``, and its band, in the plant's unit
    scale          the scale of which the component's band is a fraction by default
    settled        whether the verdict is due to the plant and not to the solver; None if this was not examined
    cycle          the limit cycle; None if there is none
    at_limit       fraction of the time for which each input is at its limits; ``at_rate_limit`` is the same for its rate limit
    lost_at        the time by which the run was lost [s]; None if it was not lost
    lost_within    how much earlier that may have been [s]; 0 if it is known to the step
    lost_when_held whether a suspect that is not lost in its run is lost when it is continued with everything held
    figures        IAE and similar metrics; None if they were not requested
    bands          the bands of all components, as text
    of_the_solver  whether a finer step gives the same class without the oscillation that the run shows
    suspect        a description of a suspected limit cycle if the run cannot be continued, as with a flight model; otherwise
                   empty
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
    beside: Deviation | None = None

    def __str__(self) -> str:
        """Return the verdict in words, such as "follows within 3 %, at its limits 12 % of the time"."""
        said = [self._said, *self._limits, *([self.suspect] if self.suspect else [])]
        if self.of_the_solver:
            said.append("the verdict is the same at a finer step, but the oscillation is due to the solver")
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
        assert self.error is not None
        own = Deviation(component=self.component, error=self.error, band=self.band, scale=self.scale, unit=self.unit)
        if self.kind is Class.FOLLOWS:
            others = f", {self.beside.said(named=True)}" if self.beside else ""
            return f"follows within {own.said(named=self.beside is not None)}{others}"
        if self.beside is None:
            return f"off by {own.said(named=True)}"
        if self.beside.error > self.beside.band:
            return f"off by {own.said(named=True)} and by {self.beside.said(named=True)}"
        return f"within {self.beside.said(named=True)}, but off by {own.said(named=True)}"

    @property
    def _limits(self) -> list[str]:
        said = []
        for shares, what in ((self.at_limit, "limits"), (self.at_rate_limit, "rate limit")):
            share = max(shares, default=0.0)
            if share >= LEAST_SAID:
                said.append(f"at its {what} {percent(share)} of the time")
        return said

    def as_json(self) -> dict[str, Any]:
        """Return the fields under the names of the JSON contract."""
        return {
            "class": str(self.kind),
            "error": self.error,
            "band": self.band,
            "component": self.component,
            "scale": self.scale,
            "beside": None if self.beside is None else self.beside.as_json(),
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
    """A fraction in per cent with two digits, such as "3 %" or "0.021 %"; a nonzero fraction is never printed as 0."""
    return f"{float(np.format_float_positional(100 * share, 2, fractional=False)):.12g} %"
