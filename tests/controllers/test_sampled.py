"""Sampled controllers: the implicit midpoint step, its Lyapunov function, and the compiled loop against a plain one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from barbalat.adaptation import implicit
from barbalat.adaptation.gradient import Gradient
from barbalat.adaptation.least_squares import LeastSquares
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.midpoint import Predictor
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.output.midpoint import OutputPredictor
from barbalat.controllers.output.mrac import MracOutput
from barbalat.grid import Simulation
from barbalat.known_set import ParameterBox
from barbalat.linear import TransferFunction, input_filter
from barbalat.measurement import Noise, Sensor, standard_normal
from barbalat.output_problem import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem import Known, Problem
from barbalat.protocols import Sample
from barbalat.regressors import Linear, Uncertainty
from barbalat.signals import Sine
from barbalat.simulation import simulate
from independent import refusal


def random_known(random, n, m=1, *, gain_unknown=False, box=None):
    """A Hurwitz A_m with time constants from 0.01 to 10 s, B and everything a controller may know."""
    while True:
        A_m = random.normal(size=(n, n)) * 10 ** random.uniform(-1, 1)
        A_m -= (max(np.linalg.eigvals(A_m).real.max(), 0) + 10 ** random.uniform(-1, 1)) * np.eye(n)
        b = random.normal(size=n) if m == 1 else random.normal(size=(n, m))
        known = Known(A_m=A_m, b=b, k_0=1.0 if m == 1 else np.eye(m), x0=np.zeros(n), box=box,
                      uncertainty=Uncertainty(Linear(), m, gain_unknown))  # fmt: skip
        if np.linalg.cond(known.P) < 1e6:
            return known


def midpoint_by_dense_solve(known, gamma, T, x_hat, theta_hat, x_mid, phi, u):
    """The implicit midpoint equations of predictor and law as one linear system in the middle values."""
    n, p = len(x_hat), len(theta_hat)
    B = known.b.reshape(n, -1)
    Phi = phi.reshape(p, -1)
    PB = known.P @ B
    M = np.zeros((n + p, n + p))
    right = np.zeros(n + p)
    # x_hat_mid = x_hat + T/2 (A_m x_hat_mid + B (Phi'theta_mid + u))
    M[:n, :n], M[:n, n:] = np.eye(n) - T / 2 * known.A_m, -T / 2 * B @ Phi.T
    right[:n] = x_hat + T / 2 * B @ np.atleast_1d(u)
    # theta_mid = theta_hat + T/2 gamma Phi PB'(x_mid - x_hat_mid)
    M[n:, :n], M[n:, n:] = T / 2 * gamma * Phi @ PB.T, np.eye(p)
    right[n:] = theta_hat + T / 2 * gamma * Phi @ PB.T @ x_mid
    middle = np.linalg.solve(M, right)
    return 2 * middle[:n] - x_hat, 2 * middle[n:] - theta_hat


@pytest.mark.parametrize("m", [1, 2, 3])
def test_closed_form_against_a_dense_solve(m):
    """1e-9: the dense system's condition times rounding; seen 1e-12 in the median."""
    random = np.random.default_rng(7)
    for _ in range(200):
        n = int(random.integers(m, 5))
        known = random_known(random, n, m)
        gamma, T = 10 ** random.uniform(-2, 4), 10 ** random.uniform(-4, 0)
        twin = Predictor.of(L1Adaptive(gamma=gamma, filter=None).bind(known), T)
        p = n * m
        state = twin.initial()._replace(theta_hat=random.normal(size=p), x_hat=random.normal(size=n))
        before, now = (Sample(random.normal(size=n), None, np.zeros(() if m == 1 else m)) for _ in range(2))
        u = random.normal(size=() if m == 1 else m)
        following = twin.advance(state, before, u, now)
        x_mid = (before.x + now.x) / 2
        phi = known.uncertainty.phi(x_mid)
        x_hat, theta_hat = midpoint_by_dense_solve(known, gamma, T, state.x_hat, state.theta_hat, x_mid, phi, u)
        np.testing.assert_allclose(following.x_hat, x_hat, rtol=1e-9, atol=1e-9 * np.abs(x_hat).max())
        np.testing.assert_allclose(following.theta_hat, theta_hat, rtol=1e-9, atol=1e-9 * np.abs(theta_hat).max())


@pytest.mark.parametrize(("m", "gain_unknown"), [(1, False), (2, False), (1, True), (2, True)])
def test_lyapunov_identity_at_any_gain_and_sample_time(m, gain_unknown):
    """V_next - V = -T |x_tilde_mid|^2 + 2 T x_tilde_mid'P w, for measured x with x_next = x + T (A_m x_mid + B (...) + w)."""
    random = np.random.default_rng(11 + m)
    for _ in range(400):
        n = int(random.integers(m, 5))
        known = random_known(random, n, m, gain_unknown=gain_unknown, box=None)
        p = n * m + (m if gain_unknown else 0)
        theta = np.concatenate([random.normal(size=n * m), random.uniform(0.5, 2, size=p - n * m)])
        box = ParameterBox(lower=theta - random.uniform(0, 3, p), upper=theta + random.uniform(0, 3, p))
        gamma, T = 10 ** random.uniform(-2, 10), 10 ** random.uniform(-5, 1)
        C = None if random.random() < 0.5 or gain_unknown else input_filter(0.05)
        equations = L1Adaptive(gamma=gamma, filter=C, theta_hat0=box.lower).bind(replace(known, box=box))
        for projected in (False, True):
            twin = Predictor.of(replace(equations, box=box if projected else None), T)
            theta_hat = random.uniform(box.lower, box.upper)
            state = twin.initial()._replace(theta_hat=theta_hat, x_hat=random.normal(size=n))
            x, u, w = random.normal(size=n), random.normal(size=() if m == 1 else m), random.normal(size=n)
            B = known.b.reshape(n, -1)
            # solve the measured sequence for x_next: what multiplies theta is linear in x_mid
            Theta = theta[: n * m].reshape(n, m)
            omega = theta[n * m :] if gain_unknown else np.ones(m)
            A = known.A_m + B @ Theta.T
            x_next = np.linalg.solve(
                np.eye(n) - T / 2 * A, (np.eye(n) + T / 2 * A) @ x + T * (B @ (omega * np.atleast_1d(u)) + w)
            )
            r = np.zeros(() if m == 1 else m)
            following = twin.advance(state, Sample(x, None, r), u, Sample(x_next, None, r))

            def V(state, x, known=known, gamma=gamma, theta=theta):
                x_tilde, theta_tilde = x - state.x_hat, state.theta_hat - theta
                return x_tilde @ known.P @ x_tilde + theta_tilde @ theta_tilde / gamma

            x_tilde_mid = (x + x_next - state.x_hat - following.x_hat) / 2
            change = -T * x_tilde_mid @ x_tilde_mid + 2 * T * x_tilde_mid @ known.P @ w
            # roundings of V's terms, and of x_next: it is solved for, with a condition that grows with T |A|
            sizes = V(state, x) + V(following, x_next) + np.abs(x_next).max() ** 2 * np.linalg.norm(known.P, 2)
            slack = 1e-11 * (1 + T * np.linalg.norm(A, 2)) ** 2 * sizes
            if projected:
                assert V(following, x_next) - V(state, x) <= change + slack
                assert box.contains(following.theta_hat)
            else:
                assert abs(V(following, x_next) - V(state, x) - change) <= slack


@pytest.mark.parametrize("kind", ["gradient", "least squares"])
def test_implicit_laws_never_take_V_up(kind):
    """Random regressors, gains and sample times; estimates on faces and in corners; n = 1 ... 4."""
    random = np.random.default_rng(3)
    for _ in range(1000):
        n = int(random.integers(1, 5))
        theta = random.normal(size=n)
        box = ParameterBox(lower=theta - random.uniform(0, 2, n), upper=theta + random.uniform(0, 2, n))
        theta_hat = np.clip(theta + random.normal(size=n) * 3, box.lower, box.upper)
        phi, T, m2 = random.normal(size=n) * 10 ** random.uniform(-2, 2), 10 ** random.uniform(-5, 2), 1 + random.exponential()
        if kind == "gradient":
            law = Gradient(gamma=10 ** random.uniform(-2, 8))
            memory = law.initial(n)
            metric = metric_next = np.eye(n) / law.gamma
        else:
            root = random.normal(size=(n, n)) + 2 * np.eye(n)
            law = LeastSquares(covariance0=root @ root.T * 10 ** random.uniform(-2, 3))
            memory = law.initial(n)
        known_set = box if random.random() < 0.7 and (kind == "gradient" or n < 3) else None
        rates = implicit.step(law, T, theta_hat, memory, theta @ phi, phi, m2, known_set)
        if kind == "least squares":
            metric = np.linalg.inv(memory.covariance)
            metric_next = metric + T / m2 * np.outer(phi, phi)
            np.testing.assert_allclose(
                np.linalg.inv(rates.memory.covariance), metric_next, rtol=1e-6, atol=1e-6 * np.abs(metric).max()
            )
        before, after = theta_hat - theta, rates.theta_hat - theta
        V = before @ metric @ before
        assert after @ metric_next @ after <= V * (1 + 1e-9) + 1e-12


def plain_loop(loop, every, signals, dt, steps, noise=None):
    """RK4 with hold, written out: sample, step, sample, step."""
    y = loop.initial()
    states = []
    for k in range(steps + 1):
        drawn = [] if noise is None else noise[k]

        def at(t, left=False, drawn=drawn):
            return np.array([float((s.before if left else s)(np.array(t))) for s in signals] + list(drawn))

        if k % every == 0:
            y = loop.sample(y, at(k * dt))
        states.append(y)
        f = loop.derivative
        k_1 = f(y, at(k * dt))
        k_2 = f(loop.limit(y + dt / 2 * k_1), at((k + 0.5) * dt))
        k_3 = f(loop.limit(y + dt / 2 * k_2), at((k + 0.5) * dt))
        k_4 = f(loop.limit(y + dt * k_3), at((k + 1) * dt, left=True))
        y = loop.limit(y + dt / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))
    return np.array(states)


CONTROLLERS = {
    "mrac": Mrac(gamma=20.0),
    "l1": L1Adaptive(gamma=50.0, filter=input_filter(0.1)),
    "normalized": NormalizedMrac(law=Gradient(gamma=10.0)),
    "robust": RobustMrac(tau=0.3, law=LeastSquares(covariance0=20.0)),
}


@pytest.mark.parametrize("discretization", ["midpoint", "euler"])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_compiled_loop_against_a_plain_one(problems, name, discretization):
    """Samples every three steps, noise that changes every two. 1e-10: sums in another order, over 240 steps."""
    dt, steps, every = 2.0**-7, 240, 3
    noise = Noise(std=[0.01, 0.02], sample_time=2 * dt, seed=5)
    problem = replace(problems[2], sensor=Sensor(noise=noise))
    controller = Sampled(controller=CONTROLLERS[name], sample_time=every * dt, discretization=discretization)
    loop = ClosedLoop.of(problem, controller)
    drawn = standard_normal(5, 0, 0, steps // 2 + 1, 2)[np.arange(steps + 1) // 2]
    expected = plain_loop(loop, every, problem.signals, dt, steps, drawn)
    result = simulate(problem, [controller], Simulation(t_end=steps * dt, dt=dt, record_points=10_000))[controller.name]
    np.testing.assert_allclose(result.states, expected, rtol=1e-10, atol=1e-10)
    moved = np.abs(np.diff([loop.unpack(s).controller.theta_hat for s in expected], axis=0))
    tail = moved[180 - 1 : steps - 1].sum(axis=0) / (60 * dt)  # the jump of a sample is counted in the step that it starts
    np.testing.assert_allclose(result.figures["theta_hat_variation_rate"], tail, rtol=1e-8)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_midpoint_tends_to_the_continuous_controller(problems, name):
    """Holding the control costs an error in proportion to the sample time: halving it halves the distance."""
    problem, controller = problems[2], CONTROLLERS[name]
    simulation = Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)[controller.name].x[-1]
    distances = []
    for every in (8, 4, 2):
        sampled = Sampled(controller=controller, sample_time=every * 2.0**-9)
        distances.append(np.abs(simulate(problem, [sampled], simulation)[controller.name].x[-1] - exact).max())
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_no_gain_makes_the_estimates_chatter(section_v):
    """Section V at h = T = 1e-4: the midpoint forms vary alike from 1e2 to 1e8, the explicit Euler form a thousand times more."""
    simulation = Simulation(t_end=20.0, dt=1e-4)
    fine = simulate(section_v, [Mrac(gamma=100.0)], simulation)["MRAC"]
    for make in (
        lambda gamma: Mrac(gamma=gamma, name="c"),
        lambda gamma: L1Adaptive(gamma=gamma, filter=input_filter(0.02), name="c"),
    ):
        rates = {}
        for gamma in (1e2, 1e4, 1e6, 1e8):
            run = simulate(section_v, [Sampled(controller=make(gamma), sample_time=1e-4)], simulation)["c"]
            rates[gamma] = np.array(run.figures["theta_hat_variation_rate"])
        for rate in rates.values():
            np.testing.assert_allclose(rate, rates[1e4], rtol=0.01)
        euler = simulate(section_v, [Sampled(controller=make(1e2), sample_time=1e-4, discretization="euler")], simulation)["c"]
        assert (np.array(euler.figures["theta_hat_variation_rate"]) > 1000 * rates[1e2]).all()
    # the same order as the continuous law at a gain that the step resolves
    assert (rates[1e8] < 3 * np.array(fine.figures["theta_hat_variation_rate"]) + 1).all()


def test_refusals(section_v):
    mrac = Mrac(gamma=1.0)
    assert "sample_time" in refusal(lambda: Sampled(controller=mrac, sample_time=0.0))
    assert "discretization" in refusal(lambda: Sampled(controller=mrac, sample_time=0.1, discretization="tustin"))
    assert "continuous" in refusal(lambda: Sampled(controller=Sampled(controller=mrac, sample_time=0.1), sample_time=0.1))
    simulation = Simulation(t_end=1.0, dt=0.01)
    sampled = Sampled(controller=mrac, sample_time=0.015)
    assert "whole number of solver steps" in refusal(lambda: simulate(section_v, [sampled], simulation))


def test_P_is_the_one_of_the_proof(section_v):
    known = section_v.known
    np.testing.assert_allclose(known.P, solve_continuous_lyapunov(known.A_m.T, -np.eye(2)), rtol=1e-14)
    assert isinstance(section_v, Problem)


OUTPUT = {
    "l1-output": L1Output(m=3.0, gamma=50.0, filter=TransferFunction([20.0], [1.0, 20.0]), name="c"),
    "mrac-output": MracOutput(order=2, relative_degree=1, sign=1, law=Gradient(gamma=5.0), c_0_min=0.1, tau=0.3, name="c"),
    "mrac-output, least squares": MracOutput(
        order=2, relative_degree=1, sign=1, law=LeastSquares(covariance0=5.0), c_0_min=0.1, name="c"
    ),
    "linear": LinearOutput(loop=TransferFunction([3.0, 4.0], [1.0, 0.0]), name="c"),
}


def output_problem():
    return OutputProblem(
        plant=OutputPlant(transfer_function=TransferFunction([2.0, 6.0], [1.0, 3.0, 1.0])),
        reference_model=OutputReferenceModel(transfer_function=TransferFunction([3.0], [1.0, 3.0])),
        reference=Sine(amplitude=1.0, frequency=1.0),
    )


@pytest.mark.parametrize("name", OUTPUT)
def test_output_feedback_tends_to_the_continuous_controller(name):
    problem, controller, simulation = output_problem(), OUTPUT[name], Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)["c"].y[-1]
    distances = [
        abs(simulate(problem, [Sampled(controller=controller, sample_time=every * 2.0**-9)], simulation)["c"].y[-1] - exact)
        for every in (8, 4, 2)
    ]
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_linear_state_feedback_by_tustin(problems):
    problem, simulation = problems[2], Simulation(t_end=4.0, dt=2.0**-9)
    controller = LinearFeedback(controller=TransferFunction([3.0, 4.0], [1.0, 0.0]), name="c")
    exact = simulate(problem, [controller], simulation)["c"].x[-1]
    far, near = (
        np.abs(
            simulate(problem, [Sampled(controller=controller, sample_time=every * 2.0**-9)], simulation)["c"].x[-1] - exact
        ).max()
        for every in (8, 4)
    )
    assert 1.6 < far / near < 2.6


def test_lyapunov_identity_of_the_output_predictor():
    """V = y_tilde^2 + m sigma_tilde^2/gamma, for any measured y: w is then what the sequence says."""
    random = np.random.default_rng(8)
    for _ in range(500):
        gamma, T, m = 10 ** random.uniform(-2, 10), 10 ** random.uniform(-5, 1), 10 ** random.uniform(-1, 2)
        controller = L1Output(m=m, gamma=gamma, filter=TransferFunction([20.0], [1.0, 20.0]))
        twin = OutputPredictor.of(controller.bind(output_problem().known), T)
        y, y_next, u, s = random.normal(size=4)
        state = twin.initial()._replace(theta_hat=random.normal(size=1), y_hat=random.normal(size=1))
        zero = np.zeros(())
        after = twin.advance(state, Sample(np.array(y), zero, zero), np.array(u), Sample(np.array(y_next), zero, zero))
        w = (y_next - y) / T + m * (y + y_next) / 2 - m * (u + s)

        def V(state, y, m=m, gamma=gamma, s=s):
            return (y - state.y_hat[0]) ** 2 + m * (state.theta_hat[0] - s) ** 2 / gamma

        middle = (y + y_next - state.y_hat[0] - after.y_hat[0]) / 2
        change = -2 * m * T * middle**2 + 2 * T * middle * w
        sizes = V(state, y) + V(after, y_next) + abs(2 * T * middle * w) + 2 * m * T * middle**2
        assert abs(V(after, y_next) - V(state, y) - change) <= 1e-10 * (1 + m * T) ** 2 * sizes


def test_output_refusal():
    classical = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1.0))
    assert "euler" in refusal(lambda: Sampled(controller=classical, sample_time=0.01).bind(output_problem().known))
