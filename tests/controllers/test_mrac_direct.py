"""Direct MRAC: the textbook's first-order plant, the standard MRAC as a limit, and any input gain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from barbalat import DirectMrac, MitRule, Mrac, ParameterBox, Plant, Problem, ReferenceModel, certify, load_case, simulate
from barbalat.plants import ParameterBall, PlantInput
from barbalat.signals import Sines
from barbalat.solvers.simulation import Simulation
from independent import refusal

HALF_PERIOD = 10.0  # s, of the case's square wave


def textbook(gamma, until):
    """(y, y_m, theta_1, theta_2) after ``until`` s by the equations of Example 5.7 in the book's symbols, with error-controlled
    steps."""
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
    """The tolerance 1e-9 is for RK4 at 1 ms over 100 s, with motions on a scale of a second."""
    case = load_case("astrom-wittenmark")
    run = simulate(case.problem, case.controllers, case.simulation)[name]
    y, y_m, theta_1, theta_2 = textbook(gamma, 100.0)
    assert run.x[-1] == pytest.approx([y], abs=1e-9)
    assert run.e[-1] == pytest.approx([y - y_m], abs=1e-9)
    assert run.theta_hat[-1] == pytest.approx([theta_2], abs=1e-9)
    assert run.reported["k_r_hat"][-1] == pytest.approx([theta_1], abs=1e-9)
    assert run.true_values == pytest.approx([2.0])


def test_with_a_feedforward_that_rests_it_is_the_standard_mrac(problems):
    """The direct MRAC equals the standard MRAC for omega = 1, k_r_hat(0) = k_0 and a gain that moves k_r_hat by less than a
    rounding."""
    controllers = [Mrac(gamma=2.0), DirectMrac(gamma=2.0, gamma_r=1e-30)]
    plain, direct = simulate(problems[2], controllers, Simulation(t_end=10.0, dt=1e-3)).values()
    np.testing.assert_allclose(direct.theta_hat, plain.theta_hat, atol=1e-12)
    np.testing.assert_allclose(direct.e, plain.e, atol=1e-12)


@pytest.mark.parametrize("omega", [0.2, 5.0])
def test_the_gains_find_the_ideal_ones_whatever_the_input_s_gain(problems, omega):
    """With three sines for three gains, k_x -> theta/omega, k_r -> k_0/omega and e -> 0, without a known interval of omega."""
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
    """theta/omega is in these sets for every theta and omega, and the estimates stay in them. The tolerance 1e-12 is for a ball's
    roundings."""
    plant = replace(problems[2].plant, theta=theta.middle, input=PlantInput(gain=2.0))
    problem = replace(problems[2], plant=plant, uncertainty=theta, input_gain=(0.5, 4.0))
    equations = DirectMrac(gamma=500.0).bind(problem.known)
    rng = np.random.default_rng(1)
    points = np.concatenate([theta.drawn(rng, 500), theta.extreme_points(rng, 100)])
    for point, omega in zip(points, np.concatenate([rng.uniform(0.5, 4.0, 400), [0.5, 4.0] * 100]), strict=False):
        assert equations.gains.estimate_set.contains(point / omega * (1 - 1e-12))
        assert equations.gains.interval.contains(np.array([2.0 / omega]))
    given = replace(
        problem, plant=replace(plant, theta=10 * theta.middle)
    )  # the setting that drives the estimates to their bounds
    (run,) = simulate(given, [DirectMrac(gamma=500.0)], Simulation(t_end=5.0, dt=1e-3)).values()
    assert all(equations.gains.estimate_set.contains(point) for point in run.theta_hat)
    assert (run.reported["k_r_hat"] >= 0.5).all() and (run.reported["k_r_hat"] <= 4.0).all()


A_M, B_M = np.array([[0.0, 1.0, 0.2], [-2.0, -2.0, 0.3], [0.4, 0.0, -1.5]]), np.array([[0.0, 0.1], [1.0, 0.3], [-0.2, 0.8]])
THETA_2 = np.array([[0.5, -0.3], [0.4, 0.6], [-0.7, 0.2]])  # (p, m)
OMEGA_2 = np.array([0.4, 2.5])
K_0_2 = np.array([[1.5, 0.0], [0.2, 1.0]])


def several(**more):
    """A problem with three states, two inputs of unknown effectiveness and two commands."""
    plant = Plant(
        A_m=A_M, b=B_M, theta=THETA_2.reshape(-1), x0=[0.3, -0.1, 0.2], input=[PlantInput(gain=omega) for omega in OMEGA_2]
    )
    commands = Sines(amplitudes=(1.0, 0.5), frequencies=(0.7, 2.3)), Sines(amplitudes=(0.8, 0.6), frequencies=(1.1, 3.1))
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=K_0_2), reference=commands, **more)


def by_matrices(gamma, gamma_r, until):
    """(x, x_m, K_x, K_r) by the textbook equations K_x' = gamma phi e'PB, K_r' = -gamma_r B'Pe r', u = -K_x'x + K_r r."""
    P = solve_continuous_lyapunov(A_M.T, -np.eye(3))

    def rates(t, state):
        x, x_m, K_x, K_r = state[:3], state[3:6], state[6:12].reshape(3, 2), state[12:].reshape(2, 2)
        r = np.array([np.sin(0.7 * t) + 0.5 * np.sin(2.3 * t), 0.8 * np.sin(1.1 * t) + 0.6 * np.sin(3.1 * t)])
        e, u = x - x_m, -K_x.T @ x + K_r @ r
        x_dot = A_M @ x + B_M @ (THETA_2.T @ x + OMEGA_2 * u)
        K_x_dot, K_r_dot = gamma * np.outer(x, e @ P @ B_M), -gamma_r * np.outer(B_M.T @ P @ e, r)
        return np.concatenate([x_dot, A_M @ x_m + B_M @ K_0_2 @ r, K_x_dot.reshape(-1), K_r_dot.reshape(-1)])

    start = np.concatenate([[0.3, -0.1, 0.2] * 2, np.zeros(6), K_0_2.reshape(-1)])
    return solve_ivp(rates, (0, until), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


def test_several_inputs_are_the_textbooks_matrices():
    """The tolerance 1e-8 is for RK4 at 1 ms over 20 s, with motions on a scale of a second."""
    (run,) = simulate(several(), [DirectMrac(gamma=6.0, gamma_r=2.0)], Simulation(t_end=20.0, dt=1e-3)).values()
    expected = by_matrices(6.0, 2.0, 20.0)
    found = np.concatenate([run.x[-1], run.x[-1] - run.e[-1], run.theta_hat[-1], run.reported["k_r_hat"][-1]])
    np.testing.assert_allclose(found, expected, atol=1e-8)
    assert run.true_values == pytest.approx((THETA_2 / OMEGA_2).reshape(-1))


@pytest.mark.full
def test_the_gains_of_several_inputs_find_the_ideal_ones():
    """With four sines for five gains of each input and three states, K_x -> theta/omega and K_r -> k_0/omega, both within a
    hundredth."""
    (run,) = simulate(several(), [DirectMrac(gamma=40.0)], Simulation(t_end=600.0, dt=2e-3)).values()
    np.testing.assert_allclose(run.theta_hat[-1], (THETA_2 / OMEGA_2).reshape(-1), atol=1e-2)
    np.testing.assert_allclose(run.reported["k_r_hat"][-1], (K_0_2 / OMEGA_2[:, None]).reshape(-1), atol=1e-2)
    assert max(run.figures["tail_max_abs_e"]) < 1e-3


def test_the_bound_of_several_inputs_is_kept_and_its_v_never_grows(sample):
    """V and the bound from it are computed by hand along runs of random plants with effectivenesses from a fifth to five."""
    random, at, close = np.random.default_rng(6), Simulation(t_end=15.0, dt=2e-3, record_points=2000), 0.0
    P = solve_continuous_lyapunov(A_M.T, -np.eye(3))
    for _ in range(sample(2, 12)):
        theta, omega = random.normal(size=(3, 2)), 5 ** random.uniform(-1, 1, 2)
        plant = replace(several().plant, theta=theta.reshape(-1), input=[PlantInput(gain=one) for one in omega])
        gamma = random.uniform(1.0, 20.0, 6)
        problem, law = replace(several(), plant=plant), DirectMrac(gamma=gamma, gamma_r=4.0)
        (run,) = simulate(problem, [law], at).values()
        found = certify(problem, [law], at)[law.name]
        k_x = (run.theta_hat.reshape(-1, 3, 2) - theta / omega) ** 2 / gamma.reshape(3, 2) * omega
        k_r = (run.reported["k_r_hat"].reshape(-1, 2, 2) - K_0_2 / omega[:, None]) ** 2 / 4.0 * omega[:, None]
        V = np.einsum("ki,ij,kj->k", run.e, P, run.e) + k_x.sum(axis=(1, 2)) + k_r.sum(axis=(1, 2))
        assert (np.diff(V) <= 1e-9 * V[0]).all() and V[-1] < 0.99 * V[0]
        assert "error_bound" in found.guaranteed
        assert np.abs(run.e).max() <= found.values["error_bound"]
        assert found.values["error_bound"] == pytest.approx(np.sqrt(V[0] / np.linalg.eigvalsh(P)[0]), rel=1e-9)
        close = max(close, np.abs(run.e).max() / found.values["error_bound"])
    assert close > 0.05


@pytest.mark.parametrize("ball", [False, True])
def test_the_sets_of_several_inputs_hold_the_ideal_gains(ball):
    theta = THETA_2.reshape(-1)
    known = ParameterBall(center=theta, radius=1.5) if ball else ParameterBox(lower=theta - 0.8, upper=theta + 0.9)
    problem = several(uncertainty=known, input_gain=[(0.2, 1.0), (1.0, 4.0)])
    gains = DirectMrac(gamma=200.0).bind(problem.known).gains
    rng = np.random.default_rng(2)
    for point in np.concatenate([known.drawn(rng, 200), known.extreme_points(rng, 60)]):
        omega = np.array([rng.choice([0.2, 1.0, rng.uniform(0.2, 1.0)]), rng.choice([1.0, 4.0, rng.uniform(1.0, 4.0)])])
        assert gains.estimate_set.contains((point.reshape(3, 2) / omega).reshape(-1) * (1 - 1e-12))
        assert gains.interval.contains((K_0_2 / omega[:, None]).reshape(-1))
    (run,) = simulate(problem, [DirectMrac(gamma=200.0)], Simulation(t_end=5.0, dt=1e-3)).values()
    assert all(gains.estimate_set.contains(point) for point in run.theta_hat)
    assert all(gains.interval.contains(point) for point in run.reported["k_r_hat"])


def test_what_does_not_fit_is_refused(problems):
    plant, model = Plant(A_m=-np.eye(2), b=np.eye(2), theta=np.zeros(4)), ReferenceModel(k_0=[[1.0], [0.0]])
    known = Problem(plant=plant, reference_model=model).known
    assert "k_r0 must have the shape of k_0, 2 x 1" in refusal(lambda: DirectMrac(gamma=1.0, k_r0=1.0).bind(known))
    assert "number or a list" in refusal(lambda: DirectMrac(gamma=np.eye(4), gamma_r=1.0).bind(known))
    assert "fit the 4 parameters" in refusal(lambda: DirectMrac(gamma=[1.0, 1.0], gamma_r=1.0).bind(known))
    assert DirectMrac(gamma=1.0).bind(known).initial().k_r_hat.tolist() == [1.0, 0.0]
    said = refusal(lambda: MitRule(gamma=1.0).bind(known))
    assert said.startswith("mit-rule supports only plants with one input, got 2; ") and said.endswith(" support several")
    two_commands = {"reference_model": ReferenceModel(k_0=[[1.0, 2.0]]), "reference": several().reference}
    assert ("a single command for a plant with one input, got 2") in refusal(
        lambda: Problem(plant=problems[1].plant, **two_commands)
    )
    assert "gamma_r is missing" in refusal(lambda: DirectMrac(gamma=[1.0, 2.0]))
    known = replace(problems[1], input_gain=(0.5, 2.0)).known
    assert "k_r0 must lie" in refusal(lambda: DirectMrac(gamma=1.0, k_r0=7.0).bind(known))
    nearest = DirectMrac(gamma=1.0).bind(replace(problems[1], input_gain=(2.0, 4.0)).known)
    assert nearest.initial().k_r_hat.tolist() == [0.25]  # to k_0 = 0.5
    assert "fit the 2 parameters" in refusal(lambda: DirectMrac(gamma=[1.0], gamma_r=1.0).bind(problems[2].known))
