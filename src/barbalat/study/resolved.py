"""The simulation of a study of a variable-step case. Every run chooses its steps, and a grid replaces the step where a study
needs one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.side_by_side import expected_attempts
from barbalat.run.kernel.members import Members
from barbalat.solvers.simulation import Simulation

FEWEST_INSTANTS, MOST_INSTANTS = 2000, 50_000
"""Smallest and largest number of recorded instants of a run; the study's resolution is a tenth of the interval between them. The
smallest number is enough to try delays and filters well beyond the time scales of the motion."""
ATTEMPTS_EACH_INSTANT = 5
"""Number of steps in the case's runs for each recorded instant. The fastest oscillation advances by about 1.5 rad in a step, and
RK4 is stable up to 2.8 rad in a step of the resolution. Therefore gains can be tried at which the loop oscillates up to four
times as fast as in the case's runs."""


def resolved(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> Simulation:
    """Return the simulation unchanged if its steps are fixed. With a tolerance, the resolution follows from the number of steps
    that the runs of these controllers take, if any are given."""
    if simulation.tolerance is None:
        return simulation
    attempts = [expected_attempts(Members.read([(problem, one)], simulation)) for one in controllers]
    instants = min(max(attempts, default=0.0) / ATTEMPTS_EACH_INSTANT, MOST_INSTANTS)
    return replace(simulation, record_points=max(int(instants), FEWEST_INSTANTS, simulation.record_points))
