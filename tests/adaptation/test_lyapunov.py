"""The Lyapunov laws of MRAC and L1-AC with matrix gains, modifications and memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adaptation import examples
from barbalat import L1Adaptive, Mrac, input_filter
from barbalat.adaptation.lyapunov import Modifications
from barbalat.laws import CompositeLearning, DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import ParameterBall
from barbalat.problem.known_set import Gain
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Step
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from independent import brute_force, integrate, refusal

MATRIX = np.array([[3.0, 1.0], [1.0, 2.0]])
LEARNING = CompositeLearning(gamma_c=2.0, time_constant=0.2)
VARIANTS = {
    "diagonal": {"gamma": [2.0, 5.0]},
    "matrix": {"gamma": MATRIX},
    "sigma": {"leakage": FixedSigma(sigma=0.1)},
    "switching": {"gamma": MATRIX, "leakage": SwitchingSigma(sigma=0.1, M_0=0.4)},
    "epsilon": {"leakage": EpsilonModification(nu=0.3)},
    "dead zone": {"dead_zone": DeadZone(g_0=0.05)},
    "learning": {"gamma": MATRIX, "learning": LEARNING},
    "learning, forgetting, capacity, sigma": {
        "learning": CompositeLearning(gamma_c=2.0, time_constant=0.2, forgetting=0.1, capacity=0.5),
        "leakage": FixedSigma(sigma=0.1),
    },
}
SCHEMES = {"mrac": Mrac, "l1": lambda **s: L1Adaptive(filter=input_filter(0.05), **s)}


def controller(scheme, variant, **more):
    return SCHEMES[scheme](**({"gamma": 4.0} | VARIANTS[variant] | more))


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.short(kept=lambda scheme, variant, ball: ball == (scheme == "mrac"))
def test_the_kernel_does_what_plain_stepping_does(problems, scheme, variant, ball):
    problem, settings = problems[2], controller(scheme, variant)
    if ball:
        problem = replace(problem, uncertainty=ParameterBall(center=[0.1, 0.0], radius=0.6))
    dt, steps = 2.0**-6, 128
    samples = brute_force(ClosedLoop.of(problem, settings), problem.signals, "rk4", dt, steps)
    result = simulate(problem, [settings], Simulation(t_end=steps * dt, dt=dt, solver=RK4, record_points=steps))[settings.name]
    np.testing.assert_allclose(result.theta_hat, samples.theta_hat, rtol=0, atol=1e-9)  # 128 steps with roundings of 1e-16
    np.testing.assert_allclose(result.e, samples.e, rtol=0, atol=1e-9)
    assert all(problem.uncertainty.contains(theta_hat) for theta_hat in result.theta_hat)


def written_out(problem, gamma, sigma, g_0, gamma_c, tau_f):
    """x, x_m, theta_hat and the memory of MRAC by the equations in docs/laws.md, where the memory's z is W-filtered data.

    Here z is computed by its definition: b^+ (x' - A_m x) - u filtered by 1/(tau_f s + 1), with x' known in this test.
    """
    p, k_0 = problem.plant, problem.reference_model.k_0
    n, b_plus, P = p.n, p.b / (p.b @ p.b), problem.known.P

    def derivative(t, y):
        x, x_m, theta_hat, phi, z, R, Q = np.split(y, np.cumsum([n, n, n, n, 1, n * n]))
        R, r, e = R.reshape(n, n), problem.reference(np.array(t)), x - x_m
        u = -theta_hat @ x + k_0 * r
        x_dot = p.A_m @ x + p.b * (p.theta @ x + u)
        size = np.sqrt(e @ P @ e)
        share = max(0.0, 1 - g_0 / size) if size else 0.0
        theta_hat_dot = gamma @ (share * (e @ P @ p.b) * x - sigma * theta_hat + gamma_c * (Q - R @ theta_hat))
        m_squared = 1 + phi @ phi
        z_dot = (b_plus @ (x_dot - p.A_m @ x) - u - z) / tau_f
        data_rates = [(np.outer(phi, phi) / m_squared).ravel(), z * phi / m_squared]
        return np.concatenate([x_dot, p.A_m @ x_m + p.b * k_0 * r, theta_hat_dot, (x - phi) / tau_f, z_dot, *data_rates])

    return derivative, np.concatenate([p.x0, p.x0, np.zeros(n + n + 1 + n * n + n)])


@pytest.mark.parametrize("case", ["sigma", "dead zone", "learning"])
def test_against_the_equations_written_out(problems, case):
    """The reference is a run of an eighth-order method with error control on a second copy of the equations, with a matrix gain
    and without projection."""
    problem = problems[2]
    sigma, g_0, gamma_c = {"sigma": (0.1, 0.0, 0.0), "dead zone": (0.0, 0.05, 0.0), "learning": (0.0, 0.0, 2.0)}[case]
    derivative, y0 = written_out(problem, MATRIX, sigma, g_0, gamma_c, 0.2)
    exact = integrate(derivative, y0, 4.0, [4.0], rtol=1e-11, atol=1e-11)[:, 0]
    settings = controller("mrac", case, gamma=MATRIX, projection=False)
    result = simulate(problem, [settings], Simulation(t_end=4.0, dt=2.0**-10))["MRAC"]
    # 1e-8: h^4 = 1e-12 times derivatives of modes up to 20 rad/s, and the kink of the dead zone lowers the order
    atol = 1e-6 if case == "dead zone" else 1e-8
    np.testing.assert_allclose(result.x[-1], exact[:2], atol=atol)
    np.testing.assert_allclose(result.theta_hat[-1], exact[4:6], atol=atol)


@pytest.mark.parametrize("seed", range(5))
def test_V_does_not_grow_pointwise(problems, seed):
    """V = e'P e + theta_tilde'Gamma^-1 theta_tilde along (1)-(4) does not grow at random states, also on the boundary of the set.

    With the dead zone, this holds for V = max(0, sqrt(e'P e) - g_0)^2 + ... and a disturbance within the bound in its docstring.
    """
    problem = problems[3]
    plant, P, n = problem.plant, problem.known.P, 3
    random = np.random.default_rng(seed)
    for known_set in examples.known_sets(random, n):
        for gamma in (2.0, np.arange(1.0, 4.0), examples.random_gain(random, n)):
            for off in ("plain", "switching", "dead zone", "learning"):
                theta = examples.inside(random, known_set, n, on_the_border=False)
                theta_hat = examples.inside(random, known_set, n, on_the_border=True)
                e, x = random.normal(size=n), 10 * random.normal(size=n)
                data = random.normal(size=(n, 2))
                R = data @ data.T
                law, g_0, d = Modifications(), 0.0, 0.0
                if off == "switching":
                    law = Modifications(leakage=SwitchingSigma(sigma=1.0, M_0=examples.M_0))
                if off == "dead zone":
                    g_0 = 0.3
                    law = Modifications(dead_zone=DeadZone(g_0=g_0))
                    d_0 = g_0 / (2 * np.linalg.norm(P @ plant.b) * np.sqrt(np.linalg.eigvalsh(P)[-1]))
                    d = random.uniform(-d_0, d_0)
                memory = ()
                if off == "learning":
                    law = Modifications(learning=LEARNING)
                    memory = LEARNING.initial(plant.b, plant.x0, n)._replace(R=R, Q=R @ theta)
                rate = law.rate(Gain(gamma), e, P, plant.b, x, theta_hat, memory, known_set)
                theta_tilde = theta_hat - theta
                e_dot = plant.A_m @ e + plant.b * (-theta_tilde @ x + d)
                size = np.sqrt(e @ P @ e)
                share = max(0.0, 1 - g_0 / size)
                terms = share * 2 * e @ P @ e_dot, 2 * theta_tilde @ np.linalg.solve(Gain(gamma).as_matrix(n), rate)
                assert sum(terms) <= 1e-10 * sum(map(abs, terms))  # terms that cancel do so up to rounding


def test_the_memory_holds_z_as_theta_times_R(problems):
    """Q = R theta holds along a whole run, with and without forgetting, because the filter uses no derivatives and is exact."""
    problem = problems[3]
    for learning in (LEARNING, CompositeLearning(gamma_c=1.0, time_constant=0.5, forgetting=0.3, capacity=0.2)):
        settings = Mrac(gamma=5.0, learning=learning)
        loop = ClosedLoop.of(problem, settings)
        states = brute_force(loop, problem.signals, "rk4", 2.0**-7, 1000).states
        for state in states[::100]:
            memory = loop.unpack(state).controller.memory
            np.testing.assert_allclose(memory.Q, memory.R @ problem.plant.theta, atol=1e-8)  # h^4 = 4e-9 times derivatives
            if learning.capacity is not None:
                assert np.trace(memory.R) <= learning.capacity


def test_learning_needs_no_persistent_excitation(problems):
    """A step command provides excitation only for a while. Without a memory the MRAC keeps its parameter error; with a memory
    the error vanishes.

    h Gamma gamma_c capacity = 2^-8 50 6 = 1.2 is below RK4's limit of 2.78, so the step resolves the memory's term.
    """
    problem = replace(problems[3], reference=Step(amplitude=1.0, start=1.0))
    simulation = Simulation(t_end=30.0, dt=2.0**-8)
    memory = CompositeLearning(gamma_c=6.0, time_constant=0.2, capacity=1.0)
    plain, learnt = (simulate(problem, [Mrac(gamma=50.0, learning=learning)], simulation)["MRAC"] for learning in (None, memory))
    error = [np.linalg.norm(result.theta_hat - problem.plant.theta, axis=1) for result in (plain, learnt)]
    assert error[0][-1] > 0.5 * error[0][0]
    assert error[1][-1] < 1e-9 * error[1][0]
    assert max(learnt.figures["tail_max_abs_e"]) < 1e-9


def test_a_scalar_a_diagonal_and_a_matrix_of_equal_entries_are_one_law(problems):
    simulation = Simulation(t_end=8.0, dt=2.0**-7)
    runs = [simulate(problems[2], [Mrac(gamma=g)], simulation)["MRAC"] for g in (3.0, [3.0, 3.0], 3 * np.eye(2))]
    for other in runs[1:]:
        np.testing.assert_allclose(other.theta_hat, runs[0].theta_hat, atol=1e-12)  # sums in a different order


def test_members_of_an_ensemble_differ_in_matrix_gain_ball_and_modification(problems):
    """Each member agrees with its single run, up to roundings of constants that have become parameters."""
    simulation = Simulation(t_end=4.0, dt=2.0**-7)
    members = [
        (
            replace(problems[2], uncertainty=ParameterBall(center=[0.1 * i, 0.0], radius=0.5 + 0.2 * i)),
            Mrac(gamma=MATRIX * (1 + i), leakage=SwitchingSigma(sigma=0.1 * (i + 1), M_0=0.4), learning=LEARNING),
        )
        for i in range(3)
    ]
    together = simulate_ensemble(members, simulation).metrics
    for i, (problem, settings) in enumerate(members):
        alone = simulate(problem, [settings], simulation)["MRAC"]
        np.testing.assert_allclose(together.theta_hat_final[i], alone.theta_hat[-1], atol=1e-10)
        np.testing.assert_allclose(together.max_abs_e[i], alone.figures["max_abs_e"], atol=1e-10)


def test_what_the_theory_does_not_carry_is_refused():
    assert "memory" in refusal(lambda: Mrac(gamma=1.0, learning=LEARNING, dead_zone=DeadZone(g_0=0.1)))
    assert "proportional" in refusal(lambda: Mrac(gamma=1.0, learning=LEARNING, leakage=EpsilonModification(nu=0.1)))
    assert "CompositeLearning" in refusal(lambda: Mrac(gamma=1.0, learning=2.0))
    assert "learning.gamma_c" in refusal(lambda: CompositeLearning(gamma_c=-1.0, time_constant=1.0))
    assert "learning.capacity" in refusal(lambda: CompositeLearning(gamma_c=1.0, time_constant=1.0, capacity=0.0))
