"""Fixed steps for contests, pages and derivatives of a variable-step case: the longest steps with which its runs agree with the
runs at the tolerance.

A contest adds noise, which jumps every few milliseconds, and tries short delays and gains that are almost too high for the step.
An ensemble of 64 tunings of MRAC on the first-order plant over 10 s takes 0.06 to 0.09 s of processor time at 20,000 fixed steps.
At a tolerance of 1e-6 it takes 0.4 s without noise, 1.4 s with it and 3 s with a delay. Making its kernel takes a further 0.6 to
1.4 s. A contest therefore searches with fixed steps, and repeats only the chosen tunings at the tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

FIGURES = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u")
"""The metrics that must agree. Trajectories are not compared, because an oscillating loop repeats its amplitude but not its
phase."""
AGREES = 0.01
"""Relative difference up to which two metrics, or two times of a divergence, agree."""
SMALL = 0.05
"""Errors in the tail are compared relative to at least this fraction of the largest error, since a tolerance may not resolve
smaller ones."""
FEWEST_STEPS, MOST_STEPS = 20_000, 10_000_000
"""Smallest and largest number of steps of a run that are tried. The smallest allows delays, filters and gains well beyond the
time scales of the motion."""


@dataclass(frozen=True)
class FixedSteps:
    """A simulation with fixed steps, and a sentence on how the steps were found; None if they are the steps of the case.

    tolerance  the simulation of the case if it has a tolerance
    """

    simulation: Simulation
    sentence: str | None = None
    tolerance: Simulation | None = None

    @property
    def chosen_sentence(self) -> str | None:
        """The sentence of a study that repeats its chosen runs at the tolerance."""
        if self.sentence is None or self.tolerance is None:
            return self.sentence
        return f"{self.sentence.removeprefix('all ')}; each chosen tuning is repeated at that tolerance"


def fixed_steps(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> FixedSteps:
    """Return the simulation unchanged if its steps are fixed. Raises InputError if no run of up to ``MOST_STEPS`` steps agrees
    with the run at the tolerance."""
    if simulation.tolerance is None:
        return FixedSteps(simulation)
    loops = [ClosedLoop.of(problem, controller) for controller in controllers]
    if any(loop.around is not None and loop.around.jitters for loop in loops):
        raise InputError.of(
            "simulation.tolerance",
            "does not determine a fixed step, and none can be found for samples with jitter: give simulation.dt",
        )
    sampled = [loop.sample_time for loop in loops] + ([] if problem.noise is None else [problem.noise.sample_time])
    t_end = Fraction(str(simulation.t_end))
    longest = _divisor([t_end, *(Fraction(str(time)) for time in sampled if time is not None)])
    most = min(t_end / FEWEST_STEPS, Fraction(str(problem.delay)) if problem.delay else t_end)
    expected = [_figures(problem, controller, simulation) for controller in controllers]
    for dt in _round_parts(longest, most, t_end / MOST_STEPS):
        tried = Simulation(simulation.t_end, float(dt), fused=simulation.fused)
        found = (_figures(problem, controller, tried) for controller in controllers)
        if all(_agree(one, other) for one, other in zip(found, expected, strict=True)):
            return FixedSteps(
                tried,
                f"all runs here use fixed steps, {tried.how}. This is the longest step tried at which the errors and controls "
                f"of the case's runs agree within {100 * AGREES:.0f} % with those of runs at simulation.tolerance = "
                f"{simulation.tolerance:g}",
                simulation,
            )
    raise InputError.of(
        "simulation.tolerance",
        f"= {simulation.tolerance:g} does not determine a fixed step: even with {MOST_STEPS:.0e} fixed steps the errors and "
        f"controls of the case's runs differ by more than {100 * AGREES:.0f} % from those at that tolerance. Give simulation.dt",
    )


def _divisor(periods: Sequence[Fraction]) -> Fraction:
    """The longest time that divides all of these times [s]."""
    common = lcm(*(one.denominator for one in periods))
    return Fraction(gcd(*(int(one * common) for one in periods)), common)


def _round_parts(whole: Fraction, most: Fraction, least: Fraction) -> Iterator[Fraction]:
    """The first, second, fifth, tenth, ... parts between ``most`` and ``least``, in decreasing order."""
    power = 1
    while whole / power >= least:
        for count in (power, 2 * power, 5 * power):
            if least <= whole / count <= most:
                yield whole / count
        power *= 10


def _figures(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Metrics:
    return simulate_ensemble([(problem, controller)], simulation).metrics


def _agree(one: Metrics, other: Metrics) -> bool:
    if np.isfinite(other.diverged_at[0]) or np.isfinite(one.diverged_at[0]):
        return bool(abs(one.diverged_at[0] - other.diverged_at[0]) <= AGREES * other.diverged_at[0])
    for name in FIGURES:
        found, expected = (np.ravel(getattr(metrics, name)) for metrics in (one, other))
        small = SMALL * float(np.max(other.max_abs_e)) if name == "tail_max_abs_e" else 0.0
        if not (np.abs(found - expected) <= AGREES * np.maximum(np.abs(expected), small)).all():
            return False
    return True
