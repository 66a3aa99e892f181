"""The cost per state of a delay and an actuator, compared with the plain loop in one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from barbalat.adaptation.laws import LeastSquares
from barbalat.cases.load import load_case
from barbalat.controllers import L1Adaptive, RobustMrac, Sampled
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel.grid import signal_table
from barbalat.solvers.simulation import Simulation
from benchmarks.race import Contestant, race
from benchmarks.table import Row

STEPS = 32_768
SIMULATION = Simulation(t_end=60.0, dt=1e-4)
ACTUATOR = TransferFunction([2500.0], [1.0, 100.0, 2500.0])
PATHS = {
    "plain": None,
    "delay": PlantInput(delay=0.01),
    "actuator": PlantInput(actuator=ACTUATOR),
    "delay and actuator": PlantInput(delay=0.01, actuator=ACTUATOR),
}
CONTROLLERS = {
    "L1-AC": L1Adaptive(gamma=100.0, filter=input_filter(0.02)),
    "robust MRAC": RobustMrac(tau=0.5, law=LeastSquares(covariance0=500.0), c_0=[1.0, 1.0]),
    "L1-AC sampled every 10 steps": Sampled(controller=L1Adaptive(gamma=100.0, filter=input_filter(0.02)), sample_time=1e-3),
}


def per_state(members: int, *, quick: bool) -> tuple[list[Row], list[str]]:
    """One row for each controller and input path, with the nanoseconds per step and state relative to the plain loop."""
    given = load_case("paper").problem
    if not isinstance(given, Problem):
        raise TypeError("the paper's case measures the state")
    rows = []
    for name, controller in CONTROLLERS.items():
        runs, sizes = {}, {}
        for what, path in PATHS.items():
            problem = replace(given, plant=replace(given.plant, input=path))
            runs[what], sizes[what] = advance(problem, controller, members)
        times = race([Contestant(what, STEPS, run) for what, run in runs.items()], members, 3 if quick else 9)
        plain = times["plain"].best / sizes["plain"]
        for what in list(PATHS)[1:]:
            each = times[what].best / sizes[what]
            ours, beside = (f"{times[which].best:.3g} ns, {sizes[which]} states" for which in (what, "plain"))
            rows.append(Row(f"{name}, {what}, {members} at once", ours, beside, each / plain, at_most=1.5))
    return rows, []


def advance(problem, controller, members: int) -> tuple[Callable[[int], np.ndarray], int]:
    """A function that advances the loop by a number of steps in machine code, and the loop's states."""
    batch = Batch.of([(problem, controller)] * members, SIMULATION)
    table = signal_table(problem.signals, SIMULATION, 0, STEPS)

    def run(steps: int) -> np.ndarray:
        finals = []
        for group in batch.groups:
            finals.append(group.state.copy())
            group.call(0, 1, steps, finals[-1], table)
        return np.concatenate(finals, axis=1)

    return run, batch.loop.size
