"""The contract of every registered law, with every modification that it accepts."""

from __future__ import annotations

import numpy as np
import pytest

from adaptation import examples
from barbalat import Problem
from barbalat.adaptation.laws import LAWS
from barbalat.controllers import NormalizedMrac, RobustMrac
from barbalat.laws import DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import ParameterBall
from barbalat.problem.known_set import limit
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sines
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError
from independent import brute_force, refusal

N = 3
FAMILY = examples.laws(N)
TRIALS = 200
BY_NAME = pytest.mark.parametrize("modified", [pytest.param(each, id=each.name) for each in FAMILY])
SHORT = {
    each.name
    for each in FAMILY
    if each.name.endswith(", plain") or each.name.startswith(("gradient 2", "least-squares-bounded 0"))
}
"""Every law, and every modification of a law with a gain and of one with a covariance."""


def test_the_registry_has_examples_of_every_law():
    assert set(examples.LAW_EXAMPLES) == set(LAWS)
    assert {type(each.law) for each in FAMILY} == set(LAWS.values())


@pytest.mark.parametrize("kind", LAWS)
def test_a_law_takes_the_modifications_that_its_source_allows(kind):
    """The combinations in the table in docs/laws.md are accepted, and all others are rejected."""
    for name, modification in examples.MODIFICATIONS.items():
        if name not in examples.LAW_EXAMPLES[kind].takes:
            with pytest.raises((InputError, TypeError)):
                LAWS[kind](**examples.LAW_EXAMPLES[kind].numbers, **modification.settings)


@pytest.mark.parametrize("kind", LAWS)
def test_every_law_has_a_fastest_rate_or_says_that_nothing_bounds_it(kind):
    """The values are derived by hand for each law's example. The tolerance 1e-15 is one rounding of a sum of two terms."""
    example = examples.LAW_EXAMPLES[kind]
    found = LAWS[kind](**example.numbers).fastest_rate
    assert found == (None if example.fastest_rate is None else pytest.approx(example.fastest_rate, rel=1e-15))


def derivative_of_V(modified, theta, theta_hat, memory, estimation, known_set):
    """The derivative of theta_tilde'Gamma^-1 theta_tilde/2 or theta_tilde'P^-1 theta_tilde/2 from the rates, and its scale."""
    law, example = modified.law, modified.example
    rates = law.rates(theta_hat, memory, estimation, known_set)
    inverse = np.linalg.inv(example.gain_of_V(law, memory, N))
    theta_tilde = theta_hat - theta
    terms = [theta_tilde @ inverse @ rates.theta_hat]
    if example.has_covariance:
        terms.append(-theta_tilde @ inverse @ rates.memory.covariance @ inverse @ theta_tilde / 2)
    raw = law.rates(theta_hat, memory, estimation, None).theta_hat
    return sum(terms), sum(map(abs, terms)) + abs(theta_tilde @ inverse @ raw) + 1


@BY_NAME
def test_V_does_not_grow_where_the_theory_says_so(modified, sample):
    """The inequality holds pointwise at random states, inside the known set and on its border, for any theta in the set.

    It holds without modelling error, and with a dead zone also for every |eta|/m_s <= g_0. With a fixed sigma or the
    epsilon-modification it holds where |theta_tilde| >= |theta|, because w theta_tilde'theta_hat >= 0 there.
    """
    random, modification = np.random.default_rng(11), modified.modification
    looked_at, trials = 0, sample(TRIALS // 8, TRIALS)
    for _ in range(trials):
        for known_set in examples.known_sets(random, N):
            theta = examples.inside(random, known_set, N, on_the_border=random.uniform() < 0.3)
            theta_hat = examples.inside(random, known_set, N, on_the_border=random.uniform() < 0.7)
            if known_set is None:
                theta_hat = 3 * theta_hat  # where the leakage acts
            memory = modified.example.memory(random, modified.law, theta)
            eta = random.uniform(-1, 1) * examples.G_0 if modification.dead_zone else 0.0
            if modification.leaks is not None and np.linalg.norm(theta_hat - theta) < np.linalg.norm(theta):
                continue
            looked_at += 1
            given = examples.estimation(random, theta, theta_hat, eta)
            value, scale = derivative_of_V(modified, theta, theta_hat, memory, given, known_set)
            assert value <= 1e-10 * scale  # inverses of matrices with condition numbers of up to 1e5
    assert looked_at > trials / 2


@BY_NAME
def test_the_estimate_does_not_leave_the_set(modified, sample):
    """With random data and far too long steps, limit(theta_hat + h rate) lies exactly in the set."""
    random, law = np.random.default_rng(12), modified.law
    for known_set in examples.known_sets(random, N)[1:]:
        theta = examples.inside(random, known_set, N, on_the_border=True)
        theta_hat = examples.inside(random, known_set, N, on_the_border=False)
        memory = law.initial(N)
        for _ in range(sample(20, 100)):
            rates = law.rates(theta_hat, memory, examples.estimation(random, theta + random.normal(size=N), theta_hat), known_set)
            theta_hat = limit(theta_hat + 10 * rates.theta_hat, known_set)
            assert known_set.contains(theta_hat)


@BY_NAME
@pytest.mark.short(kept=lambda modified: modified.name in SHORT)
def test_the_kernel_does_what_plain_stepping_does(modified, problems):
    """The machine code of the robust MRAC with a ball agrees with the textbook's RK4 on NumPy arrays, including resets and
    bounds."""
    given = problems[N]
    ball = ParameterBall(center=[0.2, -0.1, 0.3], radius=0.9)
    outward = (
        given.plant.theta - ball.center
    )  # theta lies outside, so every law reaches the sphere, except a law that always leaks
    command = Sines(amplitudes=(100.0, 100.0), frequencies=(0.7, 2.3))
    problem = Problem(plant=given.plant, reference_model=given.reference_model, reference=command, uncertainty=ball)
    start = ball.center + 0.98 * ball.radius * outward / np.linalg.norm(outward)
    controller = RobustMrac(tau=0.2, law=modified.law, theta_hat0=start)
    dt, steps = 2.0**-5, 96
    samples = brute_force(ClosedLoop.of(problem, controller), problem.signals, "rk4", dt, steps)
    simulation = Simulation(t_end=steps * dt, dt=dt, solver=RK4, record_points=steps)
    result = simulate(problem, [controller], simulation)[controller.name]
    # 96 steps of roundings of 1e-16 times terms up to 1e4. At the sphere a rounding decides on a projection of the same order.
    np.testing.assert_allclose(result.theta_hat, samples.theta_hat, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.e, samples.e, rtol=0, atol=1e-9)
    assert all(ball.contains(theta_hat) for theta_hat in result.theta_hat)
    away = np.linalg.norm(result.theta_hat - ball.center, axis=1)
    assert modified.modification.leaks is not None or away.max() > ball.radius - 1e-9


@pytest.mark.parametrize("kind", LAWS)
def test_a_scheme_learns_with_every_law(kind, problems):
    """In 60 s of the normalised MRAC with each plain law, the error in the last quarter is at most half of the error in the whole
    run."""
    strong = examples.plain(kind, N)[0] | examples.LAW_EXAMPLES[kind].strong
    controller = NormalizedMrac(law=LAWS[kind](**strong))
    metrics = simulate_ensemble([(problems[N], controller)], Simulation(t_end=64.0, dt=2.0**-7)).metrics
    assert np.isnan(metrics.diverged_at).all()
    assert metrics.tail_max_abs_e.max() < 0.5 * metrics.max_abs_e.max()


REFUSED = [
    ("integral-cost", {"leakage": EpsilonModification(nu=1.0)}, "integral-cost"),
    ("least-squares", {"leakage": FixedSigma(sigma=1.0)}, "lower bound"),
    ("least-squares", {"leakage": EpsilonModification(nu=1.0)}, "lower bound"),
    ("least-squares-forgetting", {"leakage": FixedSigma(sigma=1.0)}, "bounds"),
    ("least-squares-forgetting", {"leakage": EpsilonModification(nu=1.0)}, "bounds"),
    ("least-squares-forgetting", {"dead_zone": DeadZone(g_0=0.1)}, "grows"),
    ("least-squares-resetting", {"leakage": EpsilonModification(nu=1.0)}, "proportional"),
    ("least-squares-bounded", {"leakage": EpsilonModification(nu=1.0)}, "proportional"),
    ("least-squares-bounded-gain", {"leakage": FixedSigma(sigma=1.0)}, "lower bound"),
    ("least-squares-bounded-gain", {"leakage": EpsilonModification(nu=1.0)}, "lower bound"),
    ("gradient", {"leakage": 0.1}, "FixedSigma"),
    ("gradient", {"leakage": SwitchingSigma}, "FixedSigma"),
    ("gradient", {"dead_zone": 0.1}, "DeadZone"),
]


@pytest.mark.parametrize(("kind", "extra", "word"), REFUSED)
def test_what_the_theory_does_not_carry_is_refused(kind, extra, word):
    settings = examples.plain(kind, N)[0]
    assert word in refusal(lambda: LAWS[kind](**settings, **extra))
