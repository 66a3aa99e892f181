"""MRAC with a network: its equations in other symbols, the identity behind its bounds, and what it learns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from barbalat import NetworkMrac, Plant, Problem, ReferenceModel, Sampled, Simulation, simulate
from barbalat.adaptation.modifications import EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.controllers.mrac_network import initial_inner_weights
from barbalat.regressors import Terms
from barbalat.signals import Sine, Square
from independent import refusal

A_M, B, THETA = np.array([[0.0, 1.0], [-1.0, -1.4]]), np.array([0.0, 1.0]), np.array([0.5, 1.0, -0.4])
PLANT = Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, 0.0], regressor=Terms(terms=["sin(x1)", "tanh(x2)", "cos(x1)"]))
MODEL = ReferenceModel(k_0=1.0)
SINE = Problem(plant=PLANT, reference_model=MODEL, reference=Sine(1.0, 0.7))
LEAKAGES = [FixedSigma(0.01), EpsilonModification(nu=0.1)]


def unknown(x):
    return 0.5 * np.sin(x[0]) + np.tanh(x[1]) - 0.4 * np.cos(x[0])


@pytest.mark.parametrize("leakage", LEAKAGES, ids=lambda one: type(one).__name__)
def test_a_run_is_the_equations_neuron_by_neuron(leakage):
    """The equations are written neuron by neuron and integrated with SciPy's adaptive steps. The tolerance
    1e-8 is for RK4 at 1 ms with motions of a second and a corner of the e-modification where e'P b changes its sign.
    """
    controller = NetworkMrac(gamma=20.0, gamma_v=7.0, leakage=leakage, neurons=3, scale=[2.0, 0.5], seed=4, spread=1.5)
    V_0 = controller.bind(SINE.known).V_0
    # P of A_m'P + P A_m = -I for this A_m by hand: p_12 = 1/2, p_22 = (1 + 2 p_12)/2.8
    P_b = np.array([0.5, 2.0 / 2.8])

    def rates(t, state):
        x, x_m, W, V = state[:2], state[2:4], state[4:8], state[8:].reshape(3, 3)
        r, mu = np.sin(0.7 * t), (x - x_m) @ P_b
        w = 0.01 if leakage is LEAKAGES[0] else 0.1 * abs(mu)
        x_bar = np.array([1.0, x[0] / 2.0, x[1] / 0.5])
        u, W_dot, V_dot = r - W[0], [20.0 * (mu - w * W[0])], np.zeros((3, 3))
        for i in range(3):
            z = sum(V[k, i] * x_bar[k] for k in range(3))
            h, slope = np.tanh(z), 1 / np.cosh(z) ** 2
            u -= W[i + 1] * h
            W_dot.append(20.0 * (mu * (h - slope * z) - w * W[i + 1]))
            V_dot[:, i] = 7.0 * (mu * W[i + 1] * slope * x_bar - w * V[:, i])
        return [*(A_M @ x + B * (unknown(x) + u)), *(A_M @ x_m + B * r), *W_dot, *V_dot.ravel()]

    start = [0.3, 0.0, 0.3, 0.0, *np.zeros(4), *V_0.ravel()]
    end = solve_ivp(rates, (0, 12.0), start, method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.05).y[:, -1]
    (run,) = simulate(SINE, [controller], Simulation(t_end=12.0, dt=1e-3)).values()
    np.testing.assert_allclose(run.x[-1], end[:2], atol=1e-8)
    np.testing.assert_allclose(run.theta_hat[-1], end[4:8], atol=1e-8)
    np.testing.assert_allclose(run.reported["V_hat"][-1], end[8:], atol=1e-8)
    assert run.figures["V_hat_final"] == run.reported["V_hat"][-1].tolist()
    assert run.true_values is None


TWO_INPUTS = Problem(
    plant=Plant(A_m=[[-1.0, 0.4], [0.0, -2.0]], b=[[1.0, 0.3], [0.0, 2.0]], theta=[[0.5, -1.0], [0.3, 0.2]], x0=[0.2, -0.1]),
    reference_model=ReferenceModel(k_0=[[1.0, 0.0], [0.5, 1.0]]),
    reference=[Sine(1.0, 0.7), Sine(0.5, 1.9)],
)


@pytest.mark.parametrize("leakage", LEAKAGES, ids=lambda one: type(one).__name__)
@pytest.mark.short(kept=lambda leakage: leakage is LEAKAGES[1])
def test_a_run_with_two_inputs_is_the_equations_weight_by_weight(leakage):
    """The equations are written as above, with the sum of |mu_j| in the e-modification. The tolerance 1e-7 is for corners where
    one of the two components changes its sign."""
    controller = NetworkMrac(gamma=20.0, gamma_v=7.0, leakage=leakage, neurons=2, scale=[2.0, 0.5], seed=4)
    V_0, plant, P = controller.bind(TWO_INPUTS.known).V_0, TWO_INPUTS.plant, TWO_INPUTS.known.P
    assert np.abs(plant.A_m.T @ P + P @ plant.A_m + np.eye(2)).max() < 1e-12

    def rates(t, state):
        x, x_m, W, V = state[:2], state[2:4], state[4:10].reshape(3, 2), state[10:].reshape(3, 2)
        r, e = np.array([np.sin(0.7 * t), 0.5 * np.sin(1.9 * t)]), x - x_m
        mu = [sum(plant.b[i, j] * P[i, k] * e[k] for i in range(2) for k in range(2)) for j in range(2)]
        w = 0.01 if leakage is LEAKAGES[0] else 0.1 * (abs(mu[0]) + abs(mu[1]))
        x_bar, u = np.array([1.0, x[0] / 2.0, x[1] / 0.5]), [r[0] - W[0, 0], 0.5 * r[0] + r[1] - W[0, 1]]
        W_dot, V_dot = np.zeros((3, 2)), np.zeros((3, 2))
        for j in range(2):
            W_dot[0, j] = 20.0 * (mu[j] - w * W[0, j])
        for i in range(2):
            z = V[:, i] @ x_bar
            h, slope = np.tanh(z), 1 / np.cosh(z) ** 2
            for j in range(2):
                u[j] -= W[i + 1, j] * h
                W_dot[i + 1, j] = 20.0 * (mu[j] * (h - slope * z) - w * W[i + 1, j])
            V_dot[:, i] = 7.0 * ((mu[0] * W[i + 1, 0] + mu[1] * W[i + 1, 1]) * slope * x_bar - w * V[:, i])
        f = [0.5 * x[0] + 0.3 * x[1], -1.0 * x[0] + 0.2 * x[1]]
        x_m_dot = plant.A_m @ x_m + plant.b @ [r[0], 0.5 * r[0] + r[1]]
        return [*(plant.A_m @ x + plant.b @ (np.array(f) + u)), *x_m_dot, *W_dot.ravel(), *V_dot.ravel()]

    start = [0.2, -0.1, 0.2, -0.1, *np.zeros(6), *V_0.ravel()]
    end = solve_ivp(rates, (0, 6.0), start, method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.05).y[:, -1]
    (run,) = simulate(TWO_INPUTS, [controller], Simulation(t_end=6.0, dt=1e-3)).values()
    np.testing.assert_allclose(run.x[-1], end[:2], atol=1e-7)
    np.testing.assert_allclose(run.theta_hat[-1], end[4:10], atol=1e-7)
    np.testing.assert_allclose(run.reported["V_hat"][-1], end[10:], atol=1e-7)


@pytest.mark.parametrize("leakage", LEAKAGES, ids=lambda one: type(one).__name__)
def test_what_its_weights_gain_is_what_e_gives_up(leakage):
    """U' = 2 e'P b W_hat'h - 2 w (|W_hat|^2 + |V_hat|^2) at random states, up to rounding. x enters only through h."""
    controller, random = NetworkMrac(gamma=3.0, gamma_v=0.4, leakage=leakage, neurons=5), np.random.default_rng(1)
    for problem, r in [(SINE, np.array(0.3)), (TWO_INPUTS, np.array([0.3, -0.7]))] * 25:
        equations, known = controller.bind(problem.known), problem.known
        x, x_m = 3 * random.normal(size=(2, 2))
        state = equations.initial()._replace(theta_hat=random.normal(size=6 * known.inputs), V_hat=random.normal(size=(3, 5)))
        W, V = state
        rates = equations.derivative(state, x, x_m, r, np.zeros(r.shape))
        mu = (x - x_m) @ known.P @ known.b
        w = 0.01 if leakage is LEAKAGES[0] else 0.1 * np.sum(np.abs(mu))
        found = 2 * W @ rates.theta_hat / 3.0 + 2 * np.sum(V * rates.V_hat) / 0.4
        output = known.k_0 @ r - equations.control(state, x, x_m, r) if r.ndim else r - equations.control(state, x, x_m, r)
        assert found == pytest.approx(2 * np.dot(mu, output) - 2 * w * (W @ W + np.sum(V * V)), rel=1e-10, abs=1e-10)


@pytest.mark.full
def test_it_learns_what_no_regressor_was_given_for():
    """With either modification, the error is at most a tenth of the error with the network switched off."""
    problem = replace(SINE, reference=Square(amplitude=1.0, frequency=0.5))
    made = [NetworkMrac(gamma=1e-9, leakage=FixedSigma(0.002), name="off")]
    made += [NetworkMrac(gamma=50.0, leakage=one, name=type(one).__name__) for one in (FixedSigma(0.002), LEAKAGES[1])]
    off, *on = simulate(problem, made, Simulation(t_end=40.0, dt=5e-3)).values()
    for run in on:
        assert max(run.figures["tail_max_abs_e"]) < 0.1 * max(off.figures["tail_max_abs_e"])


def test_the_initial_inner_weights_are_those_of_the_seed():
    """The weights follow from the definition of PCG64's raw bits, whose upper 53 are a double in [0, 1)."""
    raw = np.random.PCG64(7).random_raw(6)
    expected = [1.5 * (2 * (int(bits) // 2**11 / 2**53) - 1) for bits in raw]
    assert initial_inner_weights(7, 1.5, (2, 3)).ravel().tolist() == expected
    made = NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], seed=7, spread=1.5, neurons=2).bind(SINE.known)
    given = NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], V_hat0=made.V_0.tolist()).bind(SINE.known)
    assert made.V_0.tolist() == given.V_0.tolist() and made.V_0.shape == (3, 2)
    assert (initial_inner_weights(8, 1.5, (2, 3)) != initial_inner_weights(7, 1.5, (2, 3))).all()


def test_euler_s_steps_of_the_sampled_form():
    """The steps of 10 ms are computed by hand from the run's measurements, and the model under its held command with SciPy. The
    results agree up to rounding."""
    controller, T = NetworkMrac(gamma=5.0, leakage=LEAKAGES[0], neurons=2), 0.01
    at = Simulation(t_end=1.0, dt=1e-3, record_points=1000)
    (run,) = simulate(SINE, [Sampled(controller, T, discretization="euler")], at).values()
    equations = controller.bind(SINE.known)
    A_d, B_d, *_ = cont2discrete((A_M, B[:, None], np.eye(2), np.zeros((2, 1))), T)
    state, x_m = equations.initial(), np.array([0.3, 0.0])
    for k in range(100):
        r = np.sin(0.7 * T * k)
        rates = equations.derivative(state, run.x[10 * k], x_m, r, 0.0)
        state = type(state)(*(old + T * rate for old, rate in zip(state, rates, strict=True)))
        x_m = A_d @ x_m + B_d[:, 0] * r
    np.testing.assert_allclose(run.theta_hat[-1], state.theta_hat, atol=1e-11)


def test_what_does_not_fit_is_refused():
    plant = Plant(A_m=-np.eye(2), b=np.eye(2), theta=np.zeros(4))
    several = Problem(
        plant=plant, reference_model=ReferenceModel(k_0=[[1.0], [0.0]]), reference=[Sine(1.0, 1.0)], input_gain=(0.5, 2.0)
    )
    assert "input gain" in refusal(lambda: NetworkMrac(gamma=1.0, leakage=LEAKAGES[0]).bind(several.known))
    assert "sigma" in refusal(lambda: NetworkMrac(gamma=1.0)) and "nu" in refusal(lambda: NetworkMrac(gamma=1.0))
    switching = SwitchingSigma(sigma=0.1, M_0=1.0)
    assert "EpsilonModification" in refusal(lambda: NetworkMrac(gamma=1.0, leakage=switching))
    for wrong in ({"neurons": 0}, {"neurons": 2.5}, {"seed": -1}, {"scale": [1.0, 0.0]}, {"spread": 0.0}, {"gamma_v": -1.0}):
        (field,) = wrong
        assert refusal(lambda wrong=wrong: NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], **wrong)).startswith(field)
    two_columns = {"neurons": 3, "V_hat0": np.ones((3, 2))}
    assert "3 columns" in refusal(lambda: NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], **two_columns))
    fits_no_plant = NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], V_hat0=np.ones((2, 2)))
    assert "V_hat0" in refusal(lambda: fits_no_plant.bind(SINE.known))
    assert "scale" in refusal(lambda: NetworkMrac(gamma=1.0, leakage=LEAKAGES[0], scale=[1.0]).bind(SINE.known))
    gain = replace(SINE, input_gain=(0.5, 2.0))
    assert "input gain" in refusal(lambda: NetworkMrac(gamma=1.0, leakage=LEAKAGES[0]).bind(gain.known))
    midpoint = Sampled(NetworkMrac(gamma=1.0, leakage=LEAKAGES[0]), 0.01)
    assert "give discretization = 'euler'" in refusal(lambda: midpoint.bind(SINE.known))
