"""A run that has left all proportion and grows is said to run away, long before 1e12; what stays in proportion is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import KnownParameters, Mrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.report.documents import run_block
from barbalat.run.results.findings import runaway
from barbalat.signals import Constant, Sine

UNSTABLE = Problem(
    plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[5.0, 3.0], x0=[0.1, 0.0]),
    reference_model=ReferenceModel(k_0=2.0),
    reference=Sine(amplitude=1.0, frequency=1.0),
)
NOTHING = KnownParameters(theta=[0.0, 0.0])  # x'' = 3 x + x' grows like e^(2.3 t), alike at every scale


def ran(problem, controller, t_end):
    (result,) = simulate(problem, [controller], Simulation(t_end=t_end, dt=1e-2)).values()
    return result


@pytest.mark.parametrize(("t_end", "gone"), [(1.0, False), (5.0, True), (9.0, True)])
def test_growth_out_of_proportion_is_said(t_end, gone):
    """e^(2.3 t): 10 after a second, 1e5 after five, 1e9 after nine. None of these is diverged."""
    result = ran(UNSTABLE, NOTHING, t_end)
    assert result.diverged_at is None
    assert (result.runaway is not None) == gone
    assert any("runs away" in warning for warning in result.warnings) == gone
    assert ("runaway" in run_block(result)) == gone
    if gone:
        assert result.runaway.reaches == pytest.approx(max(result.figures["max_abs_e"]))


def test_units_change_nothing():
    small = replace(UNSTABLE, reference=Sine(amplitude=1e-9, frequency=1.0), plant=replace(UNSTABLE.plant, x0=[1e-10, 0.0]))
    assert ran(small, NOTHING, 5.0).runaway.ratio == pytest.approx(ran(UNSTABLE, NOTHING, 5.0).runaway.ratio, rel=1e-6)


def test_beyond_the_limit_it_is_diverged():
    result = ran(UNSTABLE, NOTHING, 15.0)
    assert result.diverged_at is not None
    assert result.runaway is None


def test_a_run_that_follows_does_not():
    assert ran(UNSTABLE, Mrac(gamma=10.0), 5.0).runaway is None
    assert ran(replace(UNSTABLE, reference=Constant(0.0)), Mrac(gamma=10.0), 5.0).runaway is None


def test_the_arithmetic():
    """A transient that has passed is no runaway, whatever its size."""
    t = np.linspace(0, 1, 101)[1:, None]
    motion = np.ones((101, 1))
    passed = 1e6 * np.exp(-10 * t)
    assert runaway(-passed, passed, motion) is None
    held = np.full_like(t, 1e6)
    assert runaway(-held, held, motion) is None
    grown = 1e4 * t
    assert runaway(-grown, grown, motion).ratio == pytest.approx(1e4)
    assert runaway(0 * t, 0 * t, 0 * motion) is None
