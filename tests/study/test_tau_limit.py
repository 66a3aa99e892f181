"""The smallest tau for a modelling error: the boundary compared with exact limits of frozen loops, the criterion with synthetic
runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat.adaptation.laws import Gradient, LeastSquares
from barbalat.certificates.linear_loops.frozen import FrozenLoops
from barbalat.controllers import KnownParameters, Mrac, RobustMrac
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.modelling_error import DelayError, ScaledError
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.study.tau_limit import Grown, TauStudy
from independent import refusal

FROZEN = RobustMrac(c_0=[1.0, 1.0], tau=0.1, law=Gradient(gamma=1e-60), theta_hat0=[4.0, -3.0])
LEARNING = RobustMrac(c_0=[1.0, 1.0], tau=0.1, law=LeastSquares(covariance0=500.0))


@pytest.mark.parametrize("error", [DelayError(), ScaledError(TransferFunction([-1.0, 0.0], [0.01, 1.0]))])
def test_frozen_estimates_against_the_exact_limit(section_v, error):
    """Without a command and with a gain of 1e-60, the state decays below the exact boundary and grows above it."""
    problem = replace(section_v, reference=Constant(0.0))
    sizes = np.array([0.03, 0.1])
    found = TauStudy(problem=problem, controller=FROZEN, error=error).limits(
        sizes, np.geomspace(5e-3, 0.5, 8), Simulation(t_end=50.0, dt=1e-3), near=Simulation(t_end=200.0, dt=1e-3)
    )
    for size, tolerates, loses in zip(sizes, found.tolerates, found.loses, strict=True):
        assert loses < tolerates < loses * 1.0101
        at_tolerated, at_loses = (
            error.limit(FrozenLoops(problem, replace(FROZEN, tau=tau)).at_theta) for tau in (tolerates, loses)
        )
        assert at_loses < size * 1.01  # within 1 % of the limit the growth is too slow for 200 s
        assert at_tolerated > size * 0.99


def test_slow_growth_is_lost(section_v):
    """The delay is 0.05 s and tau is 0.545 times the delay, where the frozen loop's limit is 0.549. There is no divergence within
    60 s, but within 240 s."""
    study = TauStudy(problem=section_v, controller=LEARNING, error=DelayError())
    sizes, taus = np.full(2, 0.05), np.array([0.545, 0.56]) * 0.05
    short = simulate_ensemble([study._member(s, t) for s, t in zip(sizes, taus, strict=True)], Simulation(t_end=60.0, dt=1e-3))
    assert np.isnan(short.metrics.diverged_at).all()
    lost = np.isnan(study.tail_errors(sizes, taus, Simulation(t_end=240.0, dt=1e-3)))
    np.testing.assert_array_equal(lost, [True, False])


def test_the_boundary_against_its_own_runs(section_v):
    study = TauStudy(problem=section_v, controller=LEARNING, error=DelayError())
    simulation = Simulation(t_end=25.0, dt=1e-3)
    sizes, taus = np.array([2e-3, 0.05, 1.5]), np.geomspace(2e-3, 1.0, 6)
    seen: list[float] = []
    found = study.limits(sizes, taus, simulation, resolution=0.05, progress=seen.append)
    assert seen[-1] == 1
    assert (np.diff(seen) >= 0).all()
    assert found.tolerates[0] == taus[0]  # no boundary within the scan
    assert found.loses[0] == 0
    assert np.isnan(found.tolerates[2])  # no tau tolerates the longest delay
    assert np.isnan(found.tail[2]).all()
    assert found.loses[1] < found.tolerates[1] < found.loses[1] * 1.051
    below = taus[taus < found.tolerates[1]]
    tried = np.concatenate([below, [found.loses[1], found.tolerates[1]]])
    tail = study.tail_errors(np.full(len(tried), 0.05), tried, simulation, threads=1)
    assert np.isnan(tail[:-1]).all()
    assert tail[-1] == found.at_tolerated[1]  # bit by bit, whatever ran with it
    plant = replace(section_v.plant, input=PlantInput(delay=0.05))
    alone = simulate(replace(section_v, plant=plant), [replace(LEARNING, tau=float(found.tolerates[1]))], simulation)[
        "Robust MRAC"
    ]
    assert alone.metrics.tail_max_abs_e.max() == pytest.approx(tail[-1], rel=1e-9)


def test_what_counts_as_grown():
    judge = Grown(growth=1.5, share=1.0).judge
    runs = {
        (8.0, 4.0, 2.0, 1.0): False,  # decays
        (1.0, 1.0, 1.0, 1.4): False,
        (1.0, 1.0, 1.0, 1.6): True,  # grows late
        (0.1, 5.0, 5.0, 5.0): True,  # an oscillation that started and stays
        (50.0, 5.0, 5.0, 5.0): False,  # a transient of learning
        (9.0, 50.0, 9.0, 9.0): True,  # a burst beyond the model's motion
        (np.nan,) * 4: True,  # diverged
        (0.0, 0.0, 0.0, 1e-9): False,  # rounding
    }
    quarters = np.array(list(runs))[:, :, None] * np.array([1.0, 0.1])
    np.testing.assert_array_equal(judge(quarters, 10.0), list(runs.values()))


def test_quarters_against_every_sample(section_v):
    """The quarters agree also if the steps don't divide evenly and if a run is longer than one call of the kernel."""
    for t_end, dt in ((1.0, 1e-3), (1.013, 1e-3), (50.0, 2e-4)):
        simulation = Simulation(t_end=t_end, dt=dt, record_points=10**6)
        members = [(section_v, Mrac(gamma=g)) for g in (1e-3, 1e-1)]
        found, plain = simulate_ensemble(members, simulation, quarters=True), simulate_ensemble(members, simulation)
        assert plain.quarters is None
        np.testing.assert_array_equal(found.metrics.max_abs_e, plain.metrics.max_abs_e)
        e = np.abs(simulate(section_v, [Mrac(gamma=1e-1)], simulation)["MRAC"].e)[:-1]
        parts = np.arange(len(e)) * 4 // len(e)
        expected = np.array([e[parts == k].max(axis=0) for k in range(4)])
        if len(e) % 4 == 0:
            np.testing.assert_array_equal(found.quarters[1], expected)
        else:  # one or two steps may be counted differently: 1 % of a quarter, in which e grows at most 30-fold
            np.testing.assert_allclose(found.quarters[1], expected, rtol=0.05)


def test_quarters_of_a_run_that_diverged(section_v):
    members = [(section_v, KnownParameters(theta=theta)) for theta in ([0.0, 0.0], [4.0, -3.0])]  # the plant alone is unstable
    found = simulate_ensemble(members, Simulation(t_end=100.0, dt=0.5), quarters=True)
    assert np.isnan(found.quarters[0]).all()
    assert np.isfinite(found.quarters[1]).all()


def test_refusals(section_v):
    simulation = Simulation(t_end=1.0, dt=0.01)
    study = TauStudy(problem=section_v, controller=LEARNING, error=DelayError())
    assert "sizes" in refusal(lambda: study.limits([0.2, 0.1], [0.1, 0.2], simulation))
    assert "taus" in refusal(lambda: study.limits([0.1, 0.2], [0.0, 0.2], simulation))
    assert "delay" in refusal(lambda: study.limits([0.001], [0.1, 0.2], simulation))  # below two steps
    assert "controller" in refusal(lambda: TauStudy(problem=section_v, controller=Mrac(gamma=1.0), error=DelayError()))
    assert "growth" in refusal(lambda: Grown(growth=1.0))
    assert "share" in refusal(lambda: Grown(share=0.0))
    short = Simulation(t_end=0.6, dt=0.1)
    assert "eight" in refusal(lambda: simulate_ensemble([(section_v, LEARNING)], short, quarters=True))
