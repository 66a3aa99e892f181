"""Rows of the tables of docs/laboratory/bounds.md: no worst run exceeds its bound, and those of linear loops come within a few
per cent of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, Sampled
from barbalat.designs import pi_feedback
from barbalat.papers.jafari_2013 import section_v
from barbalat.plants import PlantInput
from barbalat.signals import Sine
from certificates.bounds.tightness import KEYS, OF_RESPONSES, values
from certificates.bounds.worst_runs import Loops, by_mutation, by_pulses


@pytest.mark.parametrize("sampled", [True, False])
def test_the_worst_command_and_disturbance_come_close_to_the_bounds_of_a_linear_loop(sampled):
    given = section_v.problem()
    plant = replace(given.plant, x0=np.zeros(2), input=PlantInput(delay=0.015 if sampled else 0.0))
    problem = replace(given, plant=plant, disturbance=Sine(amplitude=20.0, frequency=1.0))
    controller = pi_feedback(given.known, unmodelled_delay=0.03)
    found = values(problem, Sampled(controller, 0.01) if sampled else controller, OF_RESPONSES, t_end=12.0)
    worst, known = by_pulses(problem, Sampled(controller, 0.01) if sampled else controller, 12.0, 0.01, 4)
    bounds = found.get("error_bound_held", found["error_bound"]), found["state_bound"], found["control_bound"]
    for bound, run in zip(bounds, worst, strict=True):
        assert run <= bound <= 1.03 * run
    assert known <= found["error_bound"]


def test_no_command_no_disturbance_and_no_estimate_exceeds_the_bound_of_mrac():
    problem = replace(section_v.problem(), disturbance=Sine(amplitude=2.0, frequency=1.0))
    bound = values(problem, Mrac(gamma=1.0), KEYS)["error_bound"]
    loops = Loops(problem, size=2.0, theta=False, started=True)
    found = by_mutation(loops, np.random.default_rng(28), T=2.0, h=2e-3, rounds=3)
    replayed = found.replayed(Mrac(gamma=1.0, theta_hat0=found.start))
    assert abs(replayed - found.peak) < 0.01 * found.peak
    assert 0.1 * bound < replayed <= bound
