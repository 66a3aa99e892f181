"""An oscillation that RK4's own damping hides within all limits is reported with the run's numerics."""

import json

import numpy as np
import pytest

from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, simulate
from barbalat.report.documents import run_block
from barbalat.report.terminal.runs import numerics
from barbalat.run.results.spectrum import damping_of, worst_damping
from barbalat.signals import Sine
from barbalat.solvers import EULER, HEUN, RK4
from barbalat.solvers.simulation import Simulation

PLANT = Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[1.5, -1.0], x0=[3.0, -2.0])
BOX = ParameterBox([-3.0, -3.0], [3.0, 3.0])
PROBLEM = Problem(plant=PLANT, reference_model=ReferenceModel(k_0=2.0), reference=Sine(1.3, 0.9), uncertainty=BOX)


@pytest.fixture(scope="module")
def runs():
    """Runs by step. With the coarse step the run is within all limits but wrong by a factor of ten."""
    return {h: simulate(PROBLEM, Mrac(gamma=16000.0), Simulation(t_end=5.0, dt=h))["MRAC"] for h in (0.01, 0.0005)}


def test_a_run_that_hides_ringing_says_so(runs):
    coarse, fine = runs[0.01], runs[0.0005]
    rms = [float(np.sqrt(np.mean(run.e[:, 1] ** 2))) for run in (coarse, fine)]
    assert rms[1] > 5 * rms[0] and coarse.label is None and fine.label is None  # hidden, without a label
    assert coarse.damping is not None and fine.damping is None
    said = f"adds damping of up to {100 * coarse.damping.per_radian:.2g} % per radian to an oscillation as fast as the loop's"
    assert said in numerics(coarse) and said in coarse.numerics
    block = json.loads(json.dumps(run_block(coarse)))["solver_damping"]
    assert said in block["sentence"] and block["h_omega"] == coarse.damping.h_omega
    assert "solver_damping" not in run_block(fine) and "per radian" not in numerics(fine)


def test_the_damping_is_that_of_an_oscillator_that_is_stepped(runs):
    """The method itself integrates x' = i omega x for a hundred radians."""
    found = runs[0.01].damping
    h, x = found.h_omega, 1.0 + 0.0j
    for _ in range(1000):
        x = RK4.advance(lambda state, _: 1j * state, lambda state: state, x, dict.fromkeys(RK4.nodes, 0.0), h)
    assert found.per_radian == pytest.approx(1 - abs(x) ** (1 / (1000 * h)), rel=1e-9)


def test_what_has_no_such_damping():
    """Heun's and Euler's methods amplify. A mode that decays without oscillation or that the step resolves has no finding."""
    fast, h_omega = np.array([[2.0j, -0.1 + 1.5j]]), np.array([0.5, 1.0, 2.2, 2.8])
    assert worst_damping(RK4, fast).h_omega == 2.0
    assert worst_damping(HEUN, fast) is None and worst_damping(EULER, fast) is None
    assert worst_damping(RK4, np.array([-2.0 + 1.9j, 0.9j, -1.5, complex(np.nan, np.nan)])) is None
    assert (damping_of(RK4, h_omega) > 0).all() and damping_of(RK4, np.array([2.9]))[0] < 0
