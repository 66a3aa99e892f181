"""A linear loop's margins and peak gains under the certificate's keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certify.loops import around_equilibrium, series
from barbalat.certify.margins import complementary_sensitivity, margins, sensitivity
from barbalat.certify.peaks import peak_gain
from barbalat.closed_loop import ClosedLoop
from barbalat.linear import StateSpace
from barbalat.problem import Problem, TrackingProblem
from barbalat.validate import InputError

KEYS = {"delay": "delay_margin", "phase": "phase_margin", "gain_up": "gain_margin", "gain_down": "gain_reduction_margin"}
"""The certificate's names of what ``Margins`` holds."""


def margins_of(problem: TrackingProblem, loop: StateSpace, which: str, findings: list[str]) -> dict[str, Any]:
    """Margins of the loop with the plant's input dynamics in it; the delay margin is what is left beside the plant's delay."""
    dynamics = problem.plant.paths[0].dynamics
    loop = loop if dynamics is None else series(dynamics.realise(), loop)
    try:
        found = margins(loop)
    except InputError as error:
        findings.append(f"linear loop {which}: {error}")
        return {}
    left = found.delay - problem.delay
    if problem.delay > 0:
        if left <= 0:
            findings.append(
                f"linear loop {which}: unstable, it bears a delay of {found.delay:.4g} s and has {problem.delay:.4g} s"
            )
            return {}
        return {"delay_margin": finite(left), "margins_of": f"the linear loop {which}, beside the delay the plant has"}
    values = {key: finite(getattr(found, name)) for name, key in KEYS.items()}
    unlimited = [key for key, value in values.items() if value is None]
    return values | {
        "unlimited": unlimited or None,
        "sensitivity_peak": peak_gain(sensitivity(loop)).gain,
        "complementary_sensitivity_peak": peak_gain(complementary_sensitivity(loop)).gain,
        "margins_of": f"the linear loop {which}, broken at the plant input",
    }


def adapting_margins(problem: Problem, loop: ClosedLoop, findings: list[str]) -> dict[str, Any]:
    """The delay margin of the adaptive loop linearised at the constant command sup |r|."""
    level = problem.commands[0].bound  # type: ignore[attr-defined]  # model_bounds has checked that it is there
    if level == 0:
        return {}
    equations: Any = loop.equations
    if not equations.modifications.is_off:
        findings.append("the adapting loop's margin is given for the plain law only: with the modification it rests elsewhere")
        return {}
    found = margins_of(problem, around_equilibrium(loop, level), f"linearised at the constant command {level:g}", findings)
    return {"delay_margin_adapting": found["delay_margin"]} if "delay_margin" in found else {}


def finite(value: float) -> float | None:
    """The value, or ``None`` for what has none."""
    return value if np.isfinite(value) else None
