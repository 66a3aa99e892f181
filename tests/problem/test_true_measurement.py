"""truth.C: the measurement of the simulated plant if it differs from the observer's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat.cases.load import load_case
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.departures import departures
from barbalat.problem.truth import Truth
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal


@pytest.fixture(scope="module")
def joint():
    found = load_case("flexible-joint")
    return replace(found, simulation=Simulation(t_end=1.0, dt=1e-3))


def run_of(case, problem):
    return simulate(problem, case.controllers[:1], case.simulation)["MRAC"]


def test_the_observers_own_matrix_changes_nothing(joint):
    own = joint.problem
    same = replace(own, truth=replace(own.truth, C=own.fixed_observer.C))
    np.testing.assert_array_equal(run_of(joint, own).x, run_of(joint, same).x)
    assert len(departures(own)) == len(departures(same))


def test_an_encoder_with_a_wrong_scale_is_read_with_it(joint):
    own = joint.problem
    C = [["1.1*m/m", 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]  # a formula, as in a case file
    wrong = replace(own, truth=replace(own.truth, C=C))
    loop = ClosedLoop.of(wrong, joint.controllers[0])
    np.testing.assert_allclose(loop.reading(np.array([1.0, 2.0, 3.0, 4.0])), [1.1, 2.0])
    assert any("measured" in one.sentence for one in departures(wrong))
    before, after = (run_of(joint, one) for one in (own, wrong))
    late = before.t > 0.25
    # the loop makes 1.1 theta follow the command
    ratio = np.linalg.norm(before.x[late, 0]) / np.linalg.norm(after.x[late, 0])
    assert 1.05 < ratio < 1.15


def test_refusals(joint):
    own = joint.problem
    message = refusal(lambda: replace(own, truth=Truth(C=[[1.0, 0.0, 0.0, 0.0]])))
    assert "truth.C must have 2 rows" in message
    plain = load_case("aircraft-lqi").problem
    assert "truth.C needs [observer]" in refusal(lambda: replace(plain, truth=Truth(C=[[1.0, 0.0]])))
