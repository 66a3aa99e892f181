"""A linear loop's margins and peak gains under the certificate's keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates.linear_loops.around_equilibrium import around_equilibrium
from barbalat.linear.delayed_peaks import delayed_peaks
from barbalat.linear.interconnections import complementary_sensitivity, sensitivity, series
from barbalat.linear.margins import margins
from barbalat.linear.peaks import peak_gain
from barbalat.linear.systems import StateSpace
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import InputError

KEYS = {"delay": "delay_margin", "phase": "phase_margin", "gain_up": "gain_margin", "gain_down": "gain_reduction_margin"}
"""The certificate's names of what ``Margins`` holds."""


def margins_of(problem: TrackingProblem, loop: StateSpace, which: str, findings: list[str]) -> dict[str, Any]:
    """Margins of the loop with the plant's input dynamics and delay in it: the delay margin is what it bears besides."""
    loop = with_input_dynamics(problem, loop)
    try:
        found = margins(loop, problem.delay)
    except InputError as error:
        findings.append(f"linear loop {which}: {error}")
        return {}
    values = {key: finite(getattr(found, name)) for name, key in KEYS.items()}
    unlimited = [key for key, value in values.items() if value is None]
    beside = f", beside its delay of {problem.delay:g} s" if problem.delay > 0 else ""
    return values | {
        "unlimited": unlimited or None,
        **_peaks(loop, problem.delay, which, findings),
        "margins_of": f"the linear loop {which}, broken at the plant input{beside}",
    }


def _peaks(loop: StateSpace, delay: float, which: str, findings: list[str]) -> dict[str, float]:
    """max |S| and max |T|; a finding where they are not known."""
    try:
        if delay > 0:
            S, T = delayed_peaks(loop, delay)
        else:
            S, T = (peak_gain(system(loop)).gain for system in (sensitivity, complementary_sensitivity))
    except InputError as error:
        findings.append(f"linear loop {which}: {error}")
        return {}
    return {"sensitivity_peak": S, "complementary_sensitivity_peak": T}


def adapting_margins(problem: Problem, loop: ClosedLoop, findings: list[str]) -> dict[str, Any]:
    """The delay margin of the adaptive loop linearised at the constant command sup |r|."""
    level = problem.commands[0].bound  # type: ignore[attr-defined]  # model_bounds has checked that it is there
    if level == 0:
        return {}
    equations: Any = loop.equations
    if not equations.modifications.is_off:
        findings.append("the adapting loop's margin is given for the plain law only: with the modification it rests elsewhere")
        return {}
    try:
        found = margins(with_input_dynamics(problem, around_equilibrium(loop, level)), problem.delay)
    except InputError as error:
        findings.append(f"linear loop linearised at the constant command {level:g}: {error}")
        return {}
    return {"delay_margin_adapting": finite(found.delay)}


def with_input_dynamics(problem: TrackingProblem, loop: StateSpace) -> StateSpace:
    """The loop with the actuator and the unmodelled dynamics at the plant's input in it; the delay is not."""
    dynamics = problem.plant.paths[0].dynamics
    return loop if dynamics is None else series(dynamics.realise(), loop)


def finite(value: float) -> float | None:
    """The value, or ``None`` for what has none."""
    return value if np.isfinite(value) else None
