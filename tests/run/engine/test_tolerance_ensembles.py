"""Members with individual steps in one kernel, compared with single runs, fixed steps and SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import Simulation, load_case, simulate, simulate_ensemble
from barbalat.controllers.sampled import Sampled
from barbalat.judge.settings import Judge
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.compiled import Compiled
from barbalat.problem.measurement import Noise, Sensor

PAPER = load_case("paper")
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=0.1)
SIMULATION = Simulation(2.0, tolerance=1e-9)
GAMMAS = (0.02, 0.1, 0.3, 1.0, 3.0)


def same(one, other) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("max_abs_e", "rms_e", "theta_hat_final")
    )


def with_parameters(theta):
    return replace(PAPER.problem, plant=replace(PAPER.problem.plant, theta=np.array(theta)))


@pytest.mark.parametrize("wrap", [lambda c: c, lambda c: Sampled(c, 0.02)], ids=["continuous", "sampled"])
def test_members_end_where_scipy_takes_them(wrap) -> None:
    """Each member has a different gain, plant and initial estimate, all of which are arguments of one kernel."""
    members = [
        (with_parameters([4 - g, -3 + g]), wrap(replace(MRAC, gamma=g, theta_hat0=np.array([0.1 * g, 0.0])))) for g in GAMMAS
    ]
    found = simulate_ensemble(members, SIMULATION).metrics
    for i, (problem, controller) in enumerate(members):
        loop = ClosedLoop.of(problem, controller)
        rates, x, every = Compiled(right_hand_side(loop)), loop.initial(), loop.sample_time or 0.5

        def driven(t, problem=problem):
            return np.array([float(problem.reference(np.array(t)))])

        for k in range(round(2.0 / every)):
            if loop.sampled:
                x = np.asarray(loop.sample(x, driven(k * every)), float)
            x = solve_ivp(
                lambda t, y, rates=rates, driven=driven: rates(y, driven(t)),
                (k * every, (k + 1) * every),
                x,
                "DOP853",
                rtol=1e-12,
                atol=1e-12,
            ).y[:, -1]
            x = np.asarray(loop.limit(x))
        assert found.theta_hat_final[i] == pytest.approx(x[loop.theta_hat_rows], rel=1e-6)


def test_bits_depend_neither_on_threads_nor_on_neighbours() -> None:
    members = [(PAPER.problem, replace(MRAC, gamma=g)) for g in GAMMAS]
    alone, together = (simulate_ensemble(members, SIMULATION, threads=n).metrics for n in (1, 3))
    assert same(alone, together)
    some = simulate_ensemble([members[3], members[1]], SIMULATION).metrics
    assert same(some, together.of(np.array([3, 1])))


def test_figures_and_verdicts_are_those_of_fixed_steps() -> None:
    members = [(PAPER.problem, replace(MRAC, gamma=g)) for g in (0.02, 0.1)]
    ours, fixed = (
        simulate_ensemble(members, s, judge=Judge()) for s in (Simulation(20.0, tolerance=1e-8), Simulation(20.0, 1e-3))
    )
    assert ours.metrics.tail_max_abs_e == pytest.approx(fixed.metrics.tail_max_abs_e, rel=1e-3)
    assert ours.metrics.rms_e == pytest.approx(fixed.metrics.rms_e, rel=1e-3)
    assert np.array_equal(ours.judged.kinds, fixed.judged.kinds)


def test_each_member_has_its_own_noise() -> None:
    problem = replace(PAPER.problem, sensor=Sensor(noise=Noise(std=0.01, sample_time=0.02, seed=3)))
    members = [(problem, Sampled(MRAC, 0.01))] * 3
    found, single = simulate_ensemble(members, SIMULATION).metrics, simulate(*members[0], SIMULATION)["MRAC"].figures
    assert found.theta_hat_final[0].tolist() == single["theta_hat_final"]
    assert len(np.unique(found.rms_e[:, 0])) == 3
    given = simulate_ensemble(members, SIMULATION, numbers=[2, 2, 0]).metrics
    assert given.rms_e[:, 0].tolist() == found.rms_e[[2, 2, 0], 0].tolist()


def test_a_member_that_diverges_is_a_result() -> None:
    case, simulation = load_case("rohrs"), Simulation(30.0, tolerance=1e-6)
    classical = next(c for c in case.controllers if c.name == "Classical")
    single = simulate(case.problem, classical, simulation)["Classical"]
    found = simulate_ensemble([(case.problem, classical)] * 2, simulation).metrics
    assert found.diverged_at.tolist() == [single.diverged_at] * 2
    assert np.isnan(found.rms_e).all()
