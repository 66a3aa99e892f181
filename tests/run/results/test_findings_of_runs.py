"""The common findings of a problem's runs: a record that ends before the run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, Simulation, simulate
from barbalat.run.results.findings import held_after_its_end
from barbalat.signals import Recorded, Sine


@pytest.mark.parametrize(("ends", "said"), [(3.0, True), (4.0, False), (9.0, False)])
def test_a_record_that_ends_before_the_run_is_told(section_v, ends, said):
    command = Recorded([0.0, 1.0, ends], [0.0, 1.0, 0.5])
    problem = replace(section_v, reference=command)
    assert float(command(np.array([3.9]))[0]) == pytest.approx(0.5) or not said  # held
    sentence = f"the recorded command ends at t = {ends:g} s and is held at its last value, 0.5, until t = 4 s"
    (run,) = simulate(problem, [Mrac(gamma=1.0)], Simulation(t_end=4.0, dt=1e-3)).values()
    assert held_after_its_end(problem, 4.0) == (sentence if said else None)
    assert (sentence in run.warnings) == said


def test_a_disturbance_is_told_as_one(section_v):
    problem = replace(section_v, disturbance=Recorded([0.0, 2.0], [0.0, 1.0]))
    assert held_after_its_end(problem, 3.0).startswith("a recorded disturbance ends at t = 2 s")
    assert held_after_its_end(replace(section_v, reference=Sine(amplitude=1.0, frequency=1.0)), 3.0) is None
