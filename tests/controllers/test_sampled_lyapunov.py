"""The implicit step of predictor and law: it solves its equations, and V decreases at any gain and sample time and with any
modification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import ParameterBox
from barbalat.controllers import L1Adaptive
from barbalat.controllers.l1 import Predictor
from barbalat.controllers.output.l1 import L1Output, OutputPredictor
from barbalat.laws import CompositeLearning, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.plants import ParameterBall
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem.regressors import Linear, MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Sample
from barbalat.signals import Sine


def random_known(random, n, m=1, *, gain_unknown=False, box=None):
    """A Hurwitz A_m with time constants from 0.01 to 10 s, B, and everything else that may be known to a controller."""
    while True:
        A_m = random.normal(size=(n, n)) * 10 ** random.uniform(-1, 1)
        A_m -= (max(np.linalg.eigvals(A_m).real.max(), 0) + 10 ** random.uniform(-1, 1)) * np.eye(n)
        b = random.normal(size=n) if m == 1 else random.normal(size=(n, m))
        known = Known(A_m=A_m, b=b, k_0=1.0 if m == 1 else np.eye(m), x0=np.zeros(n), estimate_set=box,
                      matched=MatchedTerm(Linear(), m, gain_unknown))  # fmt: skip
        if np.linalg.cond(known.P) < 1e6:
            return known


def implicit_by_dense_solve(known, gamma, T, x_hat, theta_hat, before, now, phi, u):
    """The solution of the implicit equations of predictor and law as one linear system in the values at the end."""
    n, p = len(x_hat), len(theta_hat)
    B = known.b.reshape(n, -1)
    Phi = phi.reshape(p, -1)
    PB = known.P @ B
    M = np.zeros((n + p, n + p))
    right = np.zeros(n + p)
    # x_hat_next = x_hat + T (A_m (x_mid - (x_next - x_hat_next)) + B (Phi'theta_next + u))
    M[:n, :n], M[:n, n:] = np.eye(n) - T * known.A_m, -T * B @ Phi.T
    right[:n] = x_hat + T * (known.A_m @ (before + now) / 2 - known.A_m @ now + B @ np.atleast_1d(u))
    # theta_next = theta_hat + T gamma Phi PB'(x_next - x_hat_next)
    M[n:, :n], M[n:, n:] = T * gamma * Phi @ PB.T, np.eye(p)
    right[n:] = theta_hat + T * gamma * Phi @ PB.T @ now
    end = np.linalg.solve(M, right)
    return end[:n], end[n:]


@pytest.mark.parametrize("m", [1, 2, 3])
def test_closed_form_against_a_dense_solve(m):
    """The tolerance 1e-9 is the dense system's condition number times rounding. The median difference is 1e-12."""
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
        phi = known.matched.phi((before.x + now.x) / 2)
        x_hat, theta_hat = implicit_by_dense_solve(known, gamma, T, state.x_hat, state.theta_hat, before.x, now.x, phi, u)
        np.testing.assert_allclose(following.x_hat, x_hat, rtol=1e-9, atol=1e-9 * np.abs(x_hat).max())
        np.testing.assert_allclose(following.theta_hat, theta_hat, rtol=1e-9, atol=1e-9 * np.abs(theta_hat).max())


class Case:
    """A random loop and one of its samples, x_next = x + T (A_m x_mid + B (Theta'phi + omega u) + w) with phi in the middle."""

    def __init__(self, random, m=1, *, gain_unknown=False, matrix=False, **modifications):
        self.n = n = int(random.integers(m, 5))
        known = random_known(random, n, m, gain_unknown=gain_unknown)
        p = n * m + (m if gain_unknown else 0)
        self.theta = np.concatenate([random.normal(size=n * m), random.uniform(0.5, 2, size=p - n * m)])
        self.T = 10 ** random.uniform(-5, 1)
        self.gamma = 10 ** random.uniform(-2, 10)
        if matrix:
            root = random.normal(size=(p, p))
            self.gamma = self.gamma * (root @ root.T / p + np.eye(p))
        self.metric = np.linalg.inv(self.gamma * np.eye(p) if np.ndim(self.gamma) < 2 else self.gamma)
        C = None if random.random() < 0.5 or gain_unknown else input_filter(0.05)
        box = ParameterBox(lower=self.theta - random.uniform(0, 3, p), upper=self.theta + random.uniform(0, 3, p))
        centre = self.theta + random.normal(size=p)
        self.box, self.ball = box, ParameterBall(center=centre, radius=np.linalg.norm(centre - self.theta) * 1.1)
        self.x, self.u, self.w = random.normal(size=n), random.normal(size=() if m == 1 else m), random.normal(size=n)
        self.x_hat, self.share = random.normal(size=n), random.uniform(0, 1, p)
        # solve the measured sequence for x_next: the factor of theta is linear in x_mid
        B = known.b.reshape(n, -1)
        omega = self.theta[n * m :] if gain_unknown else np.ones(m)
        A = known.A_m + B @ self.theta[: n * m].reshape(n, m).T
        right = (np.eye(n) + self.T / 2 * A) @ self.x + self.T * (B @ (omega * np.atleast_1d(self.u)) + self.w)
        self.x_next = np.linalg.solve(np.eye(n) - self.T / 2 * A, right)
        self.P, self.stiffness = known.P, (1 + self.T * np.linalg.norm(A, 2)) ** 2
        self.known = replace(known, estimate_set=box)
        self.settings = L1Adaptive(gamma=self.gamma, filter=C, theta_hat0=box.lower, **modifications)
        self.r = np.zeros(() if m == 1 else m)

    def inside(self, known_set):
        """A random estimate in the set, sometimes on a face or in a corner."""
        if isinstance(known_set, ParameterBall):
            return known_set.center + (self.theta - known_set.center) * (2 * self.share[0] - 1)
        return np.clip(
            self.box.lower + (1.4 * self.share - 0.2) * (self.box.upper - self.box.lower), self.box.lower, self.box.upper
        )

    def run(self, known_set, **state):
        """The state before and after the step, and V of both."""
        twin = Predictor.of(replace(self.settings.bind(self.known), estimate_set=known_set), self.T)
        before = twin.initial()._replace(theta_hat=self.inside(known_set), x_hat=self.x_hat, **state)
        after = twin.advance(before, Sample(self.x, None, self.r), self.u, Sample(self.x_next, None, self.r))
        return before, after, self.V(before, self.x), self.V(after, self.x_next)

    def V(self, state, x):
        x_tilde, theta_tilde = x - state.x_hat, state.theta_hat - self.theta
        return x_tilde @ self.P @ x_tilde + theta_tilde @ self.metric @ theta_tilde

    def fall(self, after):
        """-T |x_tilde|^2 + 2 T x_tilde'P w at the end of the step."""
        x_tilde = self.x_next - after.x_hat
        return -self.T * x_tilde @ x_tilde + 2 * self.T * x_tilde @ self.P @ self.w

    def slack(self, *V):
        """Tolerance for roundings of V's terms and of x_next, whose equation has a condition number that grows with T |A|."""
        return 1e-11 * self.stiffness * (sum(V) + np.abs(self.x_next).max() ** 2 * np.linalg.norm(self.P, 2))

    def moved(self, before, after):
        """|x_tilde_next - x_tilde|_P^2 + |theta_hat_next - theta_hat|^2 in V's metric: the additional decrease due to the
        implicit step."""
        x = self.x_next - after.x_hat - self.x + before.x_hat
        theta = after.theta_hat - before.theta_hat
        return x @ self.P @ x + theta @ self.metric @ theta


@pytest.mark.parametrize(("m", "gain_unknown"), [(1, False), (2, False), (3, False), (1, True), (2, True)])
def test_lyapunov_identity_at_any_gain_and_sample_time(m, gain_unknown, sample):
    """V_next - V = fall - moved without a set, and at most this value within a box or a ball."""
    random = np.random.default_rng(11 + m)
    for _ in range(sample(75, 300)):
        case = Case(random, m, gain_unknown=gain_unknown)
        before, after, V, V_next = case.run(None)
        assert abs(V_next - V - case.fall(after) + case.moved(before, after)) <= case.slack(V, V_next)
        for known_set in (case.box, case.ball):
            before, after, V, V_next = case.run(known_set)
            assert V_next - V <= case.fall(after) + case.slack(V, V_next)
            if known_set is case.box:
                assert known_set.contains(after.theta_hat)
            else:
                assert np.linalg.norm(after.theta_hat - known_set.center) <= known_set.radius


def test_V_falls_with_a_matrix_gain():
    """The box has two parameters. With more its corners are cut off, and the inequality is not claimed. The tolerance is 1e-7
    because Gamma^-1 is computed."""
    random = np.random.default_rng(5)
    for _ in range(300):
        case = Case(random, matrix=True)
        before, after, V, V_next = case.run(None)
        assert abs(V_next - V - case.fall(after) + case.moved(before, after)) <= 1e4 * case.slack(V, V_next)
        if case.n <= 2:
            _, after, V, V_next = case.run(case.box)
            assert V_next - V <= case.fall(after) + 1e4 * case.slack(V, V_next)


def test_the_predictor_is_fed_with_the_estimate_inside_the_set(sample):
    """x_hat follows from the estimate within the set, so with C = 1 it stays at the model. The tolerance 1e-9 is for sums in
    different orders."""
    random = np.random.default_rng(17)
    for m in (1, 2):
        agree = []
        for _ in range(sample(100, 200)):
            case = Case(random, m)
            for known_set in (case.box, case.ball) if m == 1 else (case.box,):
                before, after, _, _ = case.run(known_set)
                phi = case.known.matched.phi((case.x + case.x_next) / 2)
                A_m, B = case.known.A_m, case.known.b.reshape(case.n, -1)
                entering = B @ (np.atleast_1d(phi.T @ after.theta_hat) + np.atleast_1d(case.u))
                start = before.x_hat + case.T * (entering - A_m @ (case.x_next - case.x) / 2)
                x_hat = np.linalg.solve(np.eye(case.n) - case.T * A_m, start)
                agree.append(np.abs(x_hat - after.x_hat).max() <= 1e-9 * (np.abs(x_hat).max() + np.abs(start).max()))
        assert np.mean(agree) > (0.99 if m == 1 else 0.9)  # several inputs: only if the active faces were found


LEAKAGES = {
    "sigma": FixedSigma(sigma=0.3),
    "epsilon": EpsilonModification(nu=0.5),
    "switching": SwitchingSigma(sigma=0.3, M_0=9.0),
}


@pytest.mark.parametrize("kind", LEAKAGES)
def test_leakage(kind, sample):
    """V_next - V = fall - moved - 2 T w theta_tilde'theta_hat without a set. With a set it is at most fall + T w |theta|^2/2.

    The switching leakage decreases V in every case, because |theta| < M_0.
    """
    random = np.random.default_rng(23)
    for i in range(sample(100, 400)):
        case = Case(random, leakage=LEAKAGES[kind], matrix=i % 4 == 3)
        ease = 1e4 if i % 4 == 3 else 1.0  # Gamma^-1 is computed
        for known_set in (None, case.box, case.ball):
            if known_set is not None and i % 4 == 3 and (case.n > 2 or known_set is case.ball):
                continue
            before, after, V, V_next = case.run(known_set)
            phi = (case.x + case.x_next) / 2
            start = before.x_hat + case.T * (
                case.known.b * (phi @ before.theta_hat + case.u) - case.known.A_m @ (case.x_next - case.x) / 2
            )
            still = np.linalg.solve(np.eye(case.n) - case.T * case.known.A_m, start)
            error = (case.x_next - still) @ case.P @ case.known.b  # e'P b with constant estimates
            w = {"sigma": 0.3, "epsilon": 0.5 * abs(error), "switching": 0.0}[kind]
            slack = ease * case.slack(V, V_next, case.T * w * after.theta_hat @ after.theta_hat)
            if known_set is None and kind != "switching":
                leaked = 2 * case.T * w * (after.theta_hat - case.theta) @ after.theta_hat
                assert abs(V_next - V - case.fall(after) + case.moved(before, after) + leaked) <= slack
            assert V_next - V <= case.fall(after) + case.T * w * case.theta @ case.theta / 2 + slack


def test_composite_learning():
    """Q = R theta is kept up to rounding, and V_next - V = fall - moved - 2 T gamma_c theta_tilde'R theta_tilde without a set."""
    random = np.random.default_rng(29)
    for i in range(400):
        learning = CompositeLearning(
            gamma_c=2.0, time_constant=0.3, forgetting=0.0 if i % 2 else 0.4, capacity=None if i % 3 else 1.5
        )
        case = Case(random, learning=learning)
        b = case.known.b
        # w along b enters the memory: leave it out
        A = case.known.A_m + np.outer(b, case.theta)
        right = (np.eye(case.n) + case.T / 2 * A) @ case.x + case.T * b * case.u
        case.x_next, case.w = np.linalg.solve(np.eye(case.n) - case.T / 2 * A, right), np.zeros(case.n)
        data = random.normal(size=(case.n, 2))
        R = data @ data.T * 0.1
        filtered = random.normal(size=case.n)
        zeta = b @ case.x / (b @ b) - 0.3 * case.theta @ filtered  # so that z = theta'phi
        memory = learning.initial(b, case.x, case.n)._replace(zeta=np.asarray(zeta), phi=filtered, R=R, Q=R @ case.theta)
        for known_set in (None, case.box):
            before, after, V, V_next = case.run(known_set, memory=memory)
            R_next, Q_next = after.memory.R, after.memory.Q
            scale = np.abs(R_next).max() * (1 + np.abs(case.theta).max()) * case.stiffness
            np.testing.assert_allclose(Q_next, R_next @ case.theta, atol=1e-10 * scale)
            assert np.linalg.eigvalsh(R_next)[0] >= -1e-12 * np.abs(R_next).max()
            if learning.capacity is not None and np.trace(R) <= 1.5:
                assert np.trace(R_next) <= 1.5 * (1 + 1e-12)
            slack = 1e3 * case.slack(V, V_next)
            if known_set is None:
                away = after.theta_hat - case.theta
                learnt = 2 * case.T * 2.0 * away @ R_next @ away
                assert abs(V_next - V - case.fall(after) + case.moved(before, after) + learnt) <= slack
            assert V_next - V <= case.fall(after) + slack


def test_lyapunov_identity_of_the_output_predictor():
    """The identity for V = y_tilde^2 + m sigma_tilde^2/gamma and any measured y, whose sequence determines w."""
    random = np.random.default_rng(8)
    for i in range(500):
        gamma, T, m = 10 ** random.uniform(-2, 10), 10 ** random.uniform(-5, 1), 10 ** random.uniform(-1, 2)
        bound = None if i % 2 else random.uniform(1, 4)
        controller = L1Output(m=m, gamma=gamma, sigma_bound=bound, filter=TransferFunction([20.0], [1.0, 20.0]))
        problem = OutputProblem(
            plant=OutputPlant(transfer_function=TransferFunction([m], [1.0, m])),
            reference_model=OutputReferenceModel(transfer_function=TransferFunction([m], [1.0, m])),
            reference=Sine(amplitude=1.0, frequency=1.0),
        )
        twin = OutputPredictor.of(controller.bind(problem.known), T)
        y, y_next, u = random.normal(size=3)
        s, sigma = random.uniform(-1, 1, 2)
        state = twin.initial()._replace(theta_hat=np.array([sigma]), y_hat=random.normal(size=1))
        zero = np.zeros(())
        after = twin.advance(state, Sample(np.array(y), zero, zero), np.array(u), Sample(np.array(y_next), zero, zero))
        w = (y_next - y) / T + m * (y + y_next) / 2 - m * (u + s)

        def V(state, y, m=m, gamma=gamma, s=s):
            return (y - state.y_hat[0]) ** 2 + m * (state.theta_hat[0] - s) ** 2 / gamma

        y_tilde = y_next - after.y_hat[0]
        moved = (y_tilde - y + state.y_hat[0]) ** 2 + m * (after.theta_hat[0] - sigma) ** 2 / gamma
        change = -2 * m * T * y_tilde**2 + 2 * T * y_tilde * w
        sizes = V(state, y) + V(after, y_next) + abs(2 * T * y_tilde * w) + 2 * m * T * y_tilde**2
        slack = 1e-10 * (1 + m * T) ** 2 * sizes
        assert V(after, y_next) - V(state, y) <= change + slack
        if bound is None:
            assert abs(V(after, y_next) - V(state, y) - change + moved) <= slack
        else:
            assert abs(after.theta_hat[0]) <= bound
