"""The finding that a run does not follow because of the delay at the plant's input, which the model does not have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from barbalat.controllers import KnownParameters
from barbalat.problem.plant import PlantInput
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Square
from barbalat.solvers.simulation import Simulation

SIMULATION = Simulation(t_end=40.0, dt=2.0**-7, record_points=5000)


def told(problem, delay, gain):
    plant = replace(problem.plant, input=PlantInput(delay=delay))
    moved = replace(problem, plant=plant, reference=Square(amplitude=1.0, frequency=0.5))
    (run,) = simulate(moved, [KnownParameters(theta=gain * problem.plant.theta)], SIMULATION).values()
    return run, [one.sentence for one in run.findings if one.kind == "delayed"]


def test_a_loop_that_is_off_because_of_its_delay_says_how_far_the_delay_alone_keeps_it(problems):
    run, said = told(problems[1], 0.125, 1.0)
    (sentence,) = said
    late = run.t >= 30.0
    behind = np.abs(run.x_m[:, 0] - np.interp(run.t - 0.125, run.t, run.x_m[:, 0]))[late].max()
    assert f"up to {behind:.3g} from the model" in sentence


def test_nothing_is_said_of_a_loop_without_delay_or_off_for_another_reason(problems):
    assert not told(problems[1], 0.0, 1.0)[1]
    run, said = told(problems[1], 0.125, -4.0)
    assert run.verdict.kind.name != "FOLLOWS" and not said
