"""Sampled controllers: the compiled loop compared with a plain one, the limit of short samples, high gains and delays."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import Gradient, IntegralCost, LeastSquares, LeastSquaresBounded, LeastSquaresBoundedGain
from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.mrac import MracOutput
from barbalat.controllers.windup import ModifiedError
from barbalat.laws import CompositeLearning, DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.protocols import Sample
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.portable import standard_normal
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from independent import refusal


def plain_loop(loop, every, signals, dt, steps, noise=None):
    """RK4 with hold, written by hand: sample, step, sample, step."""
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
    "epsilon": Mrac(gamma=20.0, leakage=EpsilonModification(nu=0.2)),
    "learning, switching sigma": Mrac(
        gamma=[20.0, 30.0],
        learning=CompositeLearning(gamma_c=2.0, time_constant=0.3, forgetting=0.1, capacity=2.0),
        leakage=SwitchingSigma(sigma=0.5, M_0=0.2),
    ),
    "bounded, sigma": NormalizedMrac(
        law=LeastSquaresBounded(covariance0=20.0, forgetting=0.5, covariance_bound=40.0, leakage=FixedSigma(sigma=0.05))
    ),
    "bounded gain, dead zone": NormalizedMrac(
        law=LeastSquaresBoundedGain(covariance0=20.0, forgetting=0.5, covariance_bound=40.0, dead_zone=DeadZone(g_0=0.01))
    ),
    "integral cost": NormalizedMrac(law=IntegralCost(gamma=20.0, forgetting=0.5)),
}


EACH_KIND = ("l1", "robust", "learning, switching sigma", "bounded gain, dead zone")
"""Controllers with a predictor, with a covariance and an auxiliary input, with a memory, and with a constant estimate."""


@pytest.mark.parametrize("discretization", ["midpoint", "euler"])
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, discretization: discretization == "midpoint" or name in EACH_KIND)
def test_compiled_loop_against_a_plain_one(problems, name, discretization):
    """Samples are every three steps, and the noise changes every two. The tolerance 1e-10 is for sums in a different order over
    240 steps."""
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
    tail = moved[180 - 1 : steps - 1].sum(axis=0) / (60 * dt)  # the jump at a sample belongs to the step that starts there
    np.testing.assert_allclose(result.figures["theta_hat_variation_rate"], tail, rtol=1e-8)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name: name in EACH_KIND)
def test_midpoint_tends_to_the_continuous_controller(problems, name, sample):
    """Holding the control causes an error proportional to the sample time, so half the sample time halves the distance."""
    problem, controller = problems[2], CONTROLLERS[name]
    simulation = Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)[controller.name].x[-1]
    distances = []
    for every in (8, 4, 2)[: sample(2, 3)]:
        sampled = Sampled(controller=controller, sample_time=every * 2.0**-9)
        distances.append(np.abs(simulate(problem, [sampled], simulation)[controller.name].x[-1] - exact).max())
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_no_gain_makes_the_estimates_chatter(section_v):
    """In Section V at h = T = 1e-4 the variation with the midpoint forms is similar from 1e2 to 1e8. With the explicit Euler form
    it is a thousand times larger."""
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


@pytest.mark.parametrize("gamma", [1.0, 1e6])
@pytest.mark.full
def test_a_short_delay_costs_no_more_than_with_euler_or_without_samples(section_v, gamma):
    """Section V with T = 1e-3 and delays of one to fifty samples. The error is within 10 % of that of the Euler form. If
    a fine step resolves it, it is also within 10 % of the error of the continuous MRAC with half a sample period more delay,
    which is the average delay due to holding u.

    Up to one sample the midpoint form does not even chatter, as docs/sampled.md shows. The predictor stays close to the model.
    """
    T, delays = 1e-3, (1e-3, 2e-3, 1e-2, 5e-2)
    simulation = Simulation(t_end=20.0, dt=T / 2)

    def delayed(delay):
        return replace(section_v, plant=replace(section_v.plant, input=PlantInput(delay=delay)))

    def run(problem, controller, simulation=simulation):
        return simulate(problem, [controller], simulation)["c"]

    midpoint, euler = (
        Sampled(controller=Mrac(gamma=gamma, name="c"), sample_time=T, discretization=kind) for kind in ("midpoint", "euler")
    )
    undelayed = run(section_v, midpoint).metrics
    for delay in delays:
        found = run(delayed(delay), midpoint)
        largest = found.metrics.tail_max_abs_e[0].max()
        assert largest < 1.1 * run(delayed(delay), euler).metrics.tail_max_abs_e[0].max()
        if gamma == 1:
            fine = run(delayed(delay + T / 2), Mrac(gamma=gamma, name="c"), Simulation(t_end=20.0, dt=1e-4))
            assert largest < 1.1 * fine.metrics.tail_max_abs_e[0].max() + undelayed.tail_max_abs_e[0].max()
        loop = ClosedLoop.of(section_v, midpoint)
        x_hat = np.array([loop.unpack(state).controller.x_hat for state in found.states])
        assert np.abs(x_hat - found.x_m).max() < 0.05 * np.abs(found.x).max()
        chatter = found.metrics.theta_hat_variation_rate[0].max() / undelayed.theta_hat_variation_rate[0].max()
        assert chatter < 1.1 if delay == T else chatter > 100


def test_the_predictor_of_mrac_tends_to_the_model_with_the_sample_time(section_v):
    """At a gain of 1e6 and a delay of 20 ms the estimates jump between their bounds, and x_hat - x_m is of the order of T."""
    problem = replace(section_v, plant=replace(section_v.plant, input=PlantInput(delay=0.02)))
    distances = []
    for T in (2e-3, 1e-3, 5e-4):
        sampled = Sampled(controller=Mrac(gamma=1e6, name="c"), sample_time=T)
        run = simulate(problem, [sampled], Simulation(t_end=20.0, dt=2.5e-4))["c"]
        loop = ClosedLoop.of(problem, sampled)
        x_hat = np.array([loop.unpack(state).controller.x_hat for state in run.states])
        distances.append(np.abs(x_hat - run.x_m).max())
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.5) & (ratios < 3)).all()


def test_the_fast_loop_tolerates_one_sample_of_delay(section_v):
    """For Gamma -> infinity, u_next = u - v - theta'phi + k_0 r with the input v of the plant, so z^2 - a z + a = 0 for a delay
    of a T and |z|^2 = a. A delay of 0.9 T is tolerated without chatter, but 1.1 T is not. With a filter, delays of five samples
    and more are tolerated.
    """
    T = 1e-3
    rates = {}
    for scheme, controller in (
        ("mrac", Mrac(gamma=1e8, name="c")),
        ("l1", L1Adaptive(gamma=1e8, filter=input_filter(0.02), name="c")),
    ):
        for share in (0.9, 1.1, 5.0):
            problem = replace(section_v, plant=replace(section_v.plant, input=PlantInput(delay=share * T)))
            run = simulate(problem, [Sampled(controller=controller, sample_time=T)], Simulation(t_end=20.0, dt=T / 8))["c"]
            rates[scheme, share] = run.metrics.theta_hat_variation_rate[0].max()
    assert rates["mrac", 0.9] < 1
    assert min(rates["mrac", 1.1], rates["mrac", 5.0]) > 100
    assert max(rates["l1", share] for share in (0.9, 1.1, 5.0)) < 1


@pytest.mark.parametrize("remedy", [ModifiedError(), ModifiedError(mu=0.5, margin=0.1)])
def test_modified_error_by_the_midpoint_form(problems, remedy):
    """The anti-windup's predictor with sat(u) equals the adapted model. With short samples it tends to the continuous
    controller."""
    problem = replace(problems[2], plant=replace(problems[2].plant, input=PlantInput(saturation=[-2.5, 2.5])))
    controller, simulation = Mrac(gamma=20.0, modified_error=remedy, name="c"), Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)["c"]
    assert np.abs(exact.u).max() > 2.5
    distances = [
        np.abs(simulate(problem, [Sampled(controller=controller, sample_time=k * 2.0**-9)], simulation)["c"].x - exact.x).max()
        for k in (8, 4, 2)
    ]
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


VARIED = {
    "gain, sigma": lambda v: Mrac(gamma=2 * v, leakage=FixedSigma(sigma=0.1 * v), name="c"),
    "switching sigma": lambda v: Mrac(gamma=[2 * v, 1.0], leakage=SwitchingSigma(sigma=0.1 * v, M_0=2 * v), name="c"),
    "memory": lambda v: Mrac(
        gamma=2.0, learning=CompositeLearning(gamma_c=2 * v, time_constant=0.3 * v, forgetting=v - 1, capacity=2 * v), name="c"
    ),
    "covariance": lambda v: NormalizedMrac(
        law=LeastSquaresBounded(
            covariance0=20 * v, forgetting=0.3 * v, covariance_bound=60 * v, dead_zone=DeadZone(g_0=0.01 * v)
        ),
        name="c",
    ),
}


@pytest.mark.parametrize("discretization", [None, "midpoint"])
@pytest.mark.parametrize("name", VARIED)
@pytest.mark.short(kept=lambda name, discretization: discretization or name == "memory")
def test_settings_vary_over_an_ensemble(section_v, name, discretization):
    """In an ensemble the settings are symbols. Each member agrees with its single run. The tolerance is 1e-12 because constants
    are folded differently."""
    controllers = [VARIED[name](v) for v in (1.0, 1.5)]
    if discretization is not None:
        controllers = [Sampled(controller=c, sample_time=2e-3, discretization=discretization) for c in controllers]
    simulation = Simulation(t_end=1.0, dt=1e-3)
    together = simulate_ensemble([(section_v, c) for c in controllers], simulation).metrics
    for i, controller in enumerate(controllers):
        alone = simulate(section_v, [controller], simulation)["c"].metrics
        np.testing.assert_allclose(together.max_abs_e[i], alone.max_abs_e[0], rtol=1e-12)
        np.testing.assert_allclose(together.theta_hat_final[i], alone.theta_hat_final[0], rtol=1e-9, atol=1e-12)


def test_refusals(section_v):
    mrac = Mrac(gamma=1.0)
    assert "sample_time" in refusal(lambda: Sampled(controller=mrac, sample_time=0.0))
    assert "discretization" in refusal(lambda: Sampled(controller=mrac, sample_time=0.1, discretization="tustin"))
    assert "continuous" in refusal(lambda: Sampled(controller=Sampled(controller=mrac, sample_time=0.1), sample_time=0.1))
    simulation = Simulation(t_end=1.0, dt=0.01)
    sampled = Sampled(controller=mrac, sample_time=0.015)
    assert "whole number of solver steps" in refusal(lambda: simulate(section_v, [sampled], simulation))


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
def test_output_feedback_tends_to_the_continuous_controller(name, sample):
    problem, controller, simulation = output_problem(), OUTPUT[name], Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)["c"].y[-1]
    distances = [
        abs(simulate(problem, [Sampled(controller=controller, sample_time=every * 2.0**-9)], simulation)["c"].y[-1] - exact)
        for every in (8, 4, 2)[: sample(2, 3)]
    ]
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_the_filter_is_scipys_bilinear_one(problems):
    """With constant estimates u is k_0 r - theta_hat'x filtered by C(s) with the trapezoidal rule. The tolerance 1e-12 is for two
    different recursions."""
    T, theta_hat, C = 0.02, np.array([0.5, -0.3]), TransferFunction([100.0], [1.0, 14.0, 100.0])
    known, rng = problems[2].known, np.random.default_rng(3)
    twin = L1Adaptive(gamma=1e-30, filter=C, theta_hat0=theta_hat).bind(known).sampled(T)
    x, r = rng.normal(size=(60, 2)), rng.normal(size=60)
    x[0], r[0] = 0.0, 0.0  # at zero, as SciPy's recursion begins
    samples = [Sample(x_k, x_k, r_k) for x_k, r_k in zip(x, r, strict=True)]
    state, u = twin.initial(), [0.0]
    for before, now in pairwise(samples):
        state = twin.advance(state, before, u[-1], now)
        u.append(twin.control(state, *now))
    expected = lfilter(*bilinear(C.num, C.den, 1 / T), known.k_0 * r - x @ theta_hat)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


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


def test_output_refusal():
    classical = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1.0))
    assert "euler" in refusal(lambda: Sampled(controller=classical, sample_time=0.01).bind(output_problem().known))


def test_the_normalising_signal_of_a_sampled_controller(problems):
    """Under the held u (16) is n_d(t) = integral_0^t e^(-delta_0 (t - s)) u(s)^2 ds, summed over pieces of constant u."""
    T, delta_0 = 2.0**-6, 0.7
    law = LeastSquares(covariance0=20.0)
    continuous = RobustMrac(tau=0.3, law=law, normalization=Normalization(alpha_0=0.3, delta_0=delta_0), name="c")
    controller, simulation = Sampled(controller=continuous, sample_time=T), Simulation(t_end=2.0, dt=T, record_points=1000)
    run = simulate(problems[2], [controller], simulation)["c"]
    assert len(run.t) == 129  # every step is a sample
    n_d = np.array([float(run.loop.unpack(state).controller.n_d) for state in run.states])
    start, end = np.exp(-delta_0 * (run.t[:, None] - run.t[:-1])), np.exp(-delta_0 * (run.t[:, None] - run.t[1:]))
    expected = [((end[k, :k] - start[k, :k]) / delta_0 * run.u[:k] ** 2).sum() for k in range(len(run.t))]
    assert max(expected) > 0.1
    np.testing.assert_allclose(n_d, expected, rtol=1e-10, atol=1e-12)


def test_the_own_reference_model_varies_over_an_ensemble(section_v):
    """k_0 and A_m of the members differ, and therefore Phi and Gamma of their models. Each member agrees with its single run."""
    controller = Sampled(controller=Mrac(gamma=2.0, name="c"), sample_time=2e-3, discretization="euler")
    problems = [
        replace(section_v, reference_model=replace(section_v.reference_model, k_0=k_0), plant=replace(section_v.plant, A_m=A_m))
        for k_0, A_m in ((4.0, [[0.0, 1.0], [-0.3, -1.0]]), (3.0, [[0.0, 1.0], [-0.5, -1.5]]))
    ]
    simulation = Simulation(t_end=1.0, dt=1e-3)
    together = simulate_ensemble([(problem, controller) for problem in problems], simulation).metrics
    for i, problem in enumerate(problems):
        alone = simulate(problem, [controller], simulation)["c"].metrics
        np.testing.assert_allclose(together.max_abs_e[i], alone.max_abs_e[0], rtol=1e-12)
        np.testing.assert_allclose(together.theta_hat_final[i], alone.theta_hat_final[0], rtol=1e-9, atol=1e-12)
    assert together.max_abs_e[0, 0] != together.max_abs_e[1, 0]
