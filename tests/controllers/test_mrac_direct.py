"""Direct MRAC: the textbook's first-order plant, the standard MRAC as its limit, and any gain of the input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import (
    DirectMrac,
    Mrac,
    ParameterBall,
    ParameterBox,
    Plant,
    PlantInput,
    Problem,
    ReferenceModel,
    Sines,
    load_case,
    simulate,
)
from barbalat.solvers.simulation import Simulation
from independent import refusal

HALF_PERIOD = 10.0  # s, of the case's square wave


def textbook(gamma, until):
    """Example 5.7's equations in its own symbols, (y, y_m, theta_1, theta_2) after ``until`` s, by error-controlled steps."""
    state = np.zeros(4)
    for k in range(round(until / HALF_PERIOD)):
        u_c = 1.0 if k % 2 == 0 else -1.0

        def rates(t, state, u_c=u_c):
            y, y_m, theta_1, theta_2 = state
            e = y - y_m
            return -y + 0.5 * (theta_1 * u_c - theta_2 * y), -2 * y_m + 2 * u_c, -gamma * u_c * e, gamma * y * e

        state = solve_ivp(rates, (0, HALF_PERIOD), state, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return state


@pytest.mark.parametrize(("name", "gamma"), [("Direct MRAC", 1.0), ("Direct MRAC, gamma = 5", 5.0)])
def test_the_textbook_s_first_order_plant(name, gamma):
    """RK4 at 1 ms over 100 s, of motions of a second: 1e-9."""
    case = load_case("astrom-wittenmark")
    run = simulate(case.problem, case.controllers, case.simulation)[name]
    y, y_m, theta_1, theta_2 = textbook(gamma, 100.0)
    assert run.x[-1] == pytest.approx([y], abs=1e-9)
    assert run.e[-1] == pytest.approx([y - y_m], abs=1e-9)
    assert run.theta_hat[-1] == pytest.approx([theta_2], abs=1e-9)
    assert run.reported["k_r_hat"][-1] == pytest.approx([theta_1], abs=1e-9)
    assert run.true_values == pytest.approx([2.0])


def test_with_a_feedforward_that_rests_it_is_the_standard_mrac(problems):
    """omega = 1, k_r_hat(0) = k_0, and a gain that moves it by less than a rounding."""
    controllers = [Mrac(gamma=2.0), DirectMrac(gamma=2.0, gamma_r=1e-30)]
    plain, direct = simulate(problems[2], controllers, Simulation(t_end=10.0, dt=1e-3)).values()
    np.testing.assert_allclose(direct.theta_hat, plain.theta_hat, atol=1e-12)
    np.testing.assert_allclose(direct.e, plain.e, atol=1e-12)


@pytest.mark.parametrize("omega", [0.2, 5.0])
def test_the_gains_find_the_ideal_ones_whatever_the_input_s_gain(problems, omega):
    """Three sines for three gains: k_x -> theta/omega, k_r -> k_0/omega, and e -> 0, with no interval of omega known."""
    plant = replace(problems[2].plant, input=PlantInput(gain=omega))
    problem = Problem(
        plant=plant,
        reference_model=problems[2].reference_model,
        reference=Sines(amplitudes=(1.0, 1.0, 1.0), frequencies=(0.7, 1.3, 2.9)),
    )
    (run,) = simulate(problem, [DirectMrac(gamma=20.0 / omega)], Simulation(t_end=600.0, dt=2e-3)).values()
    assert run.theta_hat[-1] == pytest.approx(plant.theta / omega, abs=1e-3 / omega)
    assert run.reported["k_r_hat"][-1] == pytest.approx([2.0 / omega], abs=1e-3 / omega)
    assert max(run.figures["tail_max_abs_e"]) < 1e-3
    assert run.true_values == pytest.approx(plant.theta / omega)


@pytest.mark.parametrize(
    "theta", [ParameterBox(lower=[-1.0, -0.5], upper=[4.0, 2.0]), ParameterBall(center=[0.5, -1.0], radius=1.5)]
)
def test_the_sets_of_the_ideal_gains(problems, theta):
    """theta/omega lies in them for every theta and omega, and the estimates stay in them; 1e-12: a ball's roundings."""
    plant = replace(problems[2].plant, theta=theta.middle, input=PlantInput(gain=2.0))
    problem = replace(problems[2], plant=plant, uncertainty=theta, input_gain=(0.5, 4.0))
    equations = DirectMrac(gamma=500.0).bind(problem.known)
    rng = np.random.default_rng(1)
    points = np.concatenate([theta.drawn(rng, 500), theta.extreme_points(rng, 100)])
    for point, omega in zip(points, np.concatenate([rng.uniform(0.5, 4.0, 400), [0.5, 4.0] * 100]), strict=False):
        assert equations.gains.box.contains(point / omega * (1 - 1e-12))
        assert equations.gains.interval.contains(np.array([2.0 / omega]))
    given = replace(problem, plant=replace(plant, theta=10 * theta.middle))  # what makes the estimates run to the bounds
    (run,) = simulate(given, [DirectMrac(gamma=500.0)], Simulation(t_end=5.0, dt=1e-3)).values()
    assert all(equations.gains.box.contains(point) for point in run.theta_hat)
    assert (run.reported["k_r_hat"] >= 0.5).all() and (run.reported["k_r_hat"] <= 4.0).all()


def test_what_does_not_fit_is_refused(problems):
    plant, model = Plant(A_m=-np.eye(2), b=np.eye(2), theta=np.zeros(4)), ReferenceModel(k_0=[[1.0], [0.0]])
    assert "one input" in refusal(lambda: DirectMrac(gamma=1.0).bind(Problem(plant=plant, reference_model=model).known))
    assert "gamma_r is missing" in refusal(lambda: DirectMrac(gamma=[1.0, 2.0]))
    known = replace(problems[1], input_gain=(0.5, 2.0)).known
    assert "k_r0 must lie" in refusal(lambda: DirectMrac(gamma=1.0, k_r0=7.0).bind(known))
    nearest = DirectMrac(gamma=1.0).bind(replace(problems[1], input_gain=(2.0, 4.0)).known)
    assert nearest.initial().k_r_hat.tolist() == [0.25]  # to k_0 = 0.5
    assert "fit the 2 parameters" in refusal(lambda: DirectMrac(gamma=[1.0], gamma_r=1.0).bind(problems[2].known))
