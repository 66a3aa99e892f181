"""The simulation of a study of a case with a tolerance: every run has its own steps, and a grid replaces the step where a study
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
"""Smallest and largest number of recorded instants of a run; a tenth of their distance is the study's resolution. With the
smallest number, delays and filters well beyond the time scales of the motion can be tried."""
ATTEMPTS_EACH_INSTANT = 5
"""Steps of the case's own runs for each recorded instant. The fastest oscillation advances by some 1.5 rad in a step, and RK4 is
stable up to 2.8 rad in a step of the resolution: gains are tried at which the loop oscillates up to four times as fast as in the
case's own runs."""


def resolved(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> Simulation:
    """The simulation itself if its steps are fixed; with a tolerance its resolution follows from the number of steps that these
    controllers' runs take, if there are any."""
    if simulation.tolerance is None:
        return simulation
    attempts = [expected_attempts(Members.read([(problem, one)], simulation)) for one in controllers]
    instants = min(max(attempts, default=0.0) / ATTEMPTS_EACH_INSTANT, MOST_INSTANTS)
    return replace(simulation, record_points=max(int(instants), FEWEST_INSTANTS, simulation.record_points))
