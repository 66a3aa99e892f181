"""The laws' implicit steps: each solves the continuous law at the end of the sample, and V satisfies the continuous law's
inequality."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from adaptation.examples import G_0, inside, known_sets, laws
from barbalat import ParameterBox
from barbalat.adaptation import implicit
from barbalat.adaptation.law import Estimation, SampleData
from barbalat.plants import ParameterBall
from barbalat.problem.known_set import Gain
from barbalat.validate import InputError


def scaled(random, modified):
    """The law with 1e2 to 1e8 times its gain. A covariance with a bound keeps that bound."""
    return modified.example.scaled(modified.law, 10 ** random.uniform(2, 8))


def data(random, theta, eta_over_m):
    phi = random.normal(size=len(theta)) * 10.0 ** random.uniform(-1, 1)
    m_s_squared = 1 + phi @ phi + random.uniform(0, 2)
    return theta @ phi + eta_over_m * np.sqrt(m_s_squared), phi, m_s_squared


def step(law, T, theta_hat, memory, z, phi, m_s_squared, known_set):
    return law.sampled_step(theta_hat, memory, SampleData(T, z, phi, m_s_squared), known_set)


def memory_of(random, law, theta):
    """An admissible memory of the law, from past data without modelling error."""
    memory = law.initial(len(theta))
    for _ in range(random.integers(0, 3)):
        memory = step(law, 0.1, np.zeros(len(theta)), memory, *data(random, theta, 0.0), None).memory
    return memory


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_step_solves_the_continuous_law_at_its_end(n):
    """theta_next = theta_hat + T theta_hat'(theta_next), evaluated independently. The tolerance is 1e-7 because the gains reach
    1e8."""
    random = np.random.default_rng(n)
    tried = 0
    for modified in laws(n):
        if modified.example.has_covariance or not modified.modification.implicit:
            continue
        for _ in range(40):
            law, T, theta = scaled(random, modified), 10 ** random.uniform(-4, 0), random.normal(size=n)
            theta_hat = theta + random.normal(size=n)
            z, phi, m_s_squared = data(random, theta, random.uniform(-1, 1))
            found = step(law, T, theta_hat, memory_of(random, law, theta), z, phi, m_s_squared, None)
            at_end = Estimation(phi, m_s_squared, (z - found.theta_hat @ phi) / m_s_squared)
            rate = law.rates(found.theta_hat, found.memory, at_end, None).theta_hat
            inverse = np.linalg.inv(modified.example.gain_of_V(law, found.memory, n))
            left = inverse @ (found.theta_hat - theta_hat) - T * inverse @ rate
            scale = T * (np.abs(z) * np.abs(phi).max() + 1) + np.abs(inverse).max()
            assert np.abs(left).max() <= 1e-7 * scale, modified.name
            tried += 1
    assert tried > 300


@pytest.mark.parametrize("n", [1, 2, 3])
def test_V_keeps_the_continuous_inequality(n, sample):
    """With n = eta/m_s, V_next <= V + T n^2 without modification and V_next <= V with a dead zone g_0 >= |n|. A leakage w adds T
    w |theta|^2/2.

    A switching leakage adds nothing. The tolerance is 1e-6 because V is computed with inverses of gains and covariances of up to
    1e8.
    """
    random = np.random.default_rng(40 + n)
    for modified in laws(n):
        modification, gain_of_V = modified.modification, modified.example.gain_of_V
        for i in range(sample(20, 60)):
            law, T, theta = scaled(random, modified), 10 ** random.uniform(-4, 1), random.uniform(-1, 1, n)
            eta = random.uniform(-G_0, G_0) if i % 2 else 0.0
            for known_set in known_sets(random, n):
                try:
                    implicit.require_sampled(law, known_set)
                except InputError:
                    assert isinstance(known_set, ParameterBall)
                    continue
                matrix = law.metric.is_matrix
                if matrix and n == 3 and known_set is not None:
                    continue  # corners of three faces are cut off
                target = theta if known_set is None else inside(random, known_set, n, on_the_border=False)
                memory = memory_of(random, law, target)
                start = (
                    target + random.normal(size=n)
                    if known_set is None
                    else inside(random, known_set, n, on_the_border=i % 3 == 0)
                )
                z, phi, m_s_squared = data(random, target, eta)
                found = step(law, T, start, memory, z, phi, m_s_squared, known_set)
                V = V_of(gain_of_V(law, memory, n), start - target)
                V_next = V_of(gain_of_V(law, found.memory, n), found.theta_hat - target)
                w = 0.0 if modification.leaks is None else modification.leaks((z - start @ phi) / np.sqrt(m_s_squared))
                added = T * w * target @ target / 2 * (2 if matrix else 1)
                if not modification.dead_zone:
                    added += T * eta**2
                assert V_next <= V + added + 1e-6 * (V + added) + 1e-12, (modified.name, known_set)


def V_of(gain, theta_tilde):
    return theta_tilde @ np.linalg.solve(gain, theta_tilde)


def test_the_covariances_stay_within_their_bounds_and_forget_exactly():
    """The next P^-1 is e^(-beta T) P^-1 + (1 - e^(-beta T))/beta phi phi'/m_s^2 if no bound is near. Bounds hold at every
    step."""
    random = np.random.default_rng(3)
    for modified in laws(3):
        law, example = modified.law, modified.example
        if not example.has_covariance or modified.modification.settings:
            continue
        memory, beta = law.initial(3), example.numbers.get("forgetting", 0.0)
        for _ in range(200):
            T = 10 ** random.uniform(-3, 1)
            z, phi, m_s_squared = data(random, np.zeros(3), 0.0)
            following = step(law, T, np.ones(3), memory, z, phi, m_s_squared, None).memory
            P = following.covariance
            np.testing.assert_allclose(P, P.T, atol=1e-10 * np.abs(P).max())
            if example.kept is not None:
                assert example.kept(P), modified.name
            else:
                weight = T if beta == 0 else (1 - np.exp(-beta * T)) / beta
                expected = np.exp(-beta * T) * np.linalg.inv(memory.covariance) + weight * np.outer(phi, phi) / m_s_squared
                if np.linalg.cond(expected) < 1e8:
                    np.testing.assert_allclose(np.linalg.inv(P), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
            memory = following


@pytest.mark.full
def test_many_short_steps_tend_to_the_continuous_law():
    """After one second with constant data, the result of 400 implicit steps is at most half as far from that of 4000 explicit
    steps as the result of 100 implicit steps.

    The tolerance is 1 % of the path of the estimate, which covers the error of the explicit steps and the instant of a reset.
    """
    random = np.random.default_rng(9)
    for modified in laws(2):
        law = modified.law
        theta, theta_hat, many = np.array([0.6, -0.8]), np.array([3.0, 6.0]), 4000
        z, phi, m_s_squared = data(random, theta, 0.02)
        fine = theta_hat, law.initial(2)
        for _ in range(many):
            rates = law.rates(*fine, Estimation(phi, m_s_squared, (z - fine[0] @ phi) / m_s_squared), None)
            moved = [a + rate / many for a, rate in zip(fine[1], rates.memory, strict=True)]
            fine = fine[0] + rates.theta_hat / many, law.limit(type(fine[1])(*moved) if moved else fine[1])
        distances = []
        for steps in (100, 400):
            coarse = theta_hat, law.initial(2)
            for _ in range(steps):
                coarse = step(law, 1 / steps, *coarse, z, phi, m_s_squared, None)
            distances.append(np.linalg.norm(coarse[0] - fine[0]) / np.linalg.norm(fine[0] - theta_hat))
        assert distances[1] <= distances[0] / 2 + 0.01 and distances[1] < 0.2, (modified.name, distances)


def test_the_step_within_a_set_against_a_quadratic_programme():
    """The step is the point of the set nearest to the step without a set, in the metric Gamma^-1 + K phi phi'."""
    random = np.random.default_rng(13)
    for _ in range(100):
        n = int(random.integers(1, 4))
        gamma, phi = 10 ** random.uniform(-1, 2, n), random.normal(size=n)
        coupling, error = 10 ** random.uniform(-2, 1), random.normal() * 5
        for known_set in known_sets(random, n)[1:]:
            if isinstance(known_set, ParameterBall):
                gamma = np.full(n, gamma[0])
            start = inside(random, known_set, n, on_the_border=random.random() < 0.3)
            used = float(gamma[0]) if isinstance(known_set, ParameterBall) else gamma
            found = implicit.step_within(start, Gain(used), phi, coupling, error, known_set)
            metric = np.diag(1 / gamma) + coupling * np.outer(phi, phi)
            free = implicit.step_within(start, Gain(used), phi, coupling, error, None)
            np.testing.assert_allclose(metric @ (free - start), phi * error, rtol=1e-9, atol=1e-9)

            def distance(theta, metric=metric, free=free):
                return (theta - free) @ metric @ (theta - free)

            limits, constraints = None, ()
            if isinstance(known_set, ParameterBox):
                limits = list(zip(known_set.lower, known_set.upper, strict=True))
            else:
                constraints = {"type": "ineq", "fun": lambda t, s=known_set: s.radius**2 - (t - s.center) @ (t - s.center)}
            least = minimize(distance, start, bounds=limits, constraints=constraints, options={"ftol": 1e-14, "maxiter": 500})
            assert distance(found) <= distance(least.x) * (1 + 1e-6) + 1e-9


def test_the_step_of_several_inputs_within_a_box_against_a_quadratic_programme():
    """This is the comparison of the previous test, with a matrix K for the inputs. If no guess of the active faces is right, the
    result is the step without a set."""
    random, solved = np.random.default_rng(17), 0
    for _ in range(100):
        n, m = int(random.integers(2, 5)), int(random.integers(2, 4))
        gamma, phi, error = 10 ** random.uniform(-1, 1, n), random.normal(size=(n, m)), random.normal(size=m) * 5
        root = random.normal(size=(m, m))
        coupling = root @ root.T + 0.1 * np.eye(m)
        box = ParameterBox(lower=-random.uniform(0.1, 1, n), upper=random.uniform(0.1, 1, n))
        start = random.uniform(box.lower, box.upper)
        found = implicit.step_within(start, Gain(gamma), phi, coupling, error, box)
        if not box.contains(found):
            np.testing.assert_array_equal(found, implicit.step_within(start, Gain(gamma), phi, coupling, error, None))
            continue
        solved += box.reached_by(found[None])
        metric = np.diag(1 / gamma) + phi @ coupling @ phi.T
        gradient = metric @ (found - start) - phi @ error  # it is zero inside, and on a face it only keeps the estimate there
        scale = 1e-9 * np.abs(phi @ error).max()
        assert (gradient[found > box.lower] <= scale).all()
        assert (gradient[found < box.upper] >= -scale).all()
    assert solved > 60


@pytest.mark.parametrize("leaking", [False, True])
def test_a_leaking_step_keeps_to_the_set_and_zero(leaking):
    """With a leakage, the set is the smallest box that contains the known one and zero, or the smallest concentric ball that
    contains zero."""
    random = np.random.default_rng(17)
    for _ in range(50):
        lower = random.uniform(-3, 2, 3)
        box = ParameterBox(lower=lower, upper=lower + random.uniform(0.1, 2, 3))
        points = np.array([box.lower, box.upper] + [np.zeros(3)] * leaking)
        kept = box.kept_by_steps(3, leaking=leaking)
        np.testing.assert_array_equal([kept.lower, kept.upper], [points.min(axis=0), points.max(axis=0)])
        ball = ParameterBall(center=random.uniform(-2, 2, 3), radius=random.uniform(0.1, 2))
        kept = ball.kept_by_steps(3, leaking=leaking)
        np.testing.assert_array_equal(kept.center, ball.center)
        to_zero = np.linalg.norm(ball.center) if leaking else 0.0
        assert kept.radius == pytest.approx(max(ball.radius, to_zero), rel=1e-14)
