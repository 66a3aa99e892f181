"""Anti-windup: nothing changes unless a limit is active, and with an active limit nothing wrong is learnt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from barbalat.adaptation.laws import Gradient, LeastSquares
from barbalat.adaptation.learning import CompositeLearning
from barbalat.cases.load import load_case
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.windup import ModifiedError
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.loop.packing import flatten
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import ParameterBox, Plant, Problem
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine, Square
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=30.0, dt=1e-3)


def limited(problem, level):
    plant = replace(problem.plant, input=PlantInput(saturation=(-level, level)))
    return replace(problem, plant=plant, reference=Square(amplitude=2.0, frequency=0.5))


PAIRS = {
    "mrac": (Mrac(gamma=50.0, name="c"), Mrac(gamma=50.0, modified_error=ModifiedError(), name="c")),
    "mrac, mu": (Mrac(gamma=50.0, name="c"), Mrac(gamma=50.0, modified_error=ModifiedError(mu=5.0, margin=0.1), name="c")),
    "l1": (
        L1Adaptive(gamma=500.0, filter=input_filter(0.05), name="c"),
        L1Adaptive(gamma=500.0, filter=input_filter(0.05), saturated_predictor=True, name="c"),
    ),
}
LAWS = {"least squares": LeastSquares(covariance0=100.0), "gradient": Gradient(gamma=100.0)}
ON_THE_MODEL = {
    f"{kind.__name__}, {law}": tuple(
        kind(law=LAWS[law], **settings, saturated_predictor=remedied, name="c") for remedied in (False, True)
    )
    for kind, settings in ((RobustMrac, {"tau": 0.2}), (NormalizedMrac, {}))
    for law in LAWS
}


def unstable(level, **given):
    """An open-loop unstable plant with a limited input and a command that drives it into the limits."""
    return Problem(
        plant=Plant(
            A_m=[[0.0, 1.0], [-1.0, -1.4]], b=[0.0, 1.0], theta=[2.0, -1.0], x0=[0.5, 0.0],
            input=PlantInput(saturation=(-level, level), gain=given.pop("gain", 1.0)),
        ),
        reference=Sine(amplitude=2.0, frequency=0.7),
        uncertainty=ParameterBox(lower=[-4.0, -4.0], upper=[4.0, 4.0]),
        **given,
    )  # fmt: skip


@pytest.mark.parametrize("name", PAIRS | ON_THE_MODEL)
def test_without_a_limit_at_work_nothing_changes(problems, name):
    """The runs agree to rounding, since the kernel may reorder sums; the equations agree exactly."""
    problem, pair = limited(problems[2], 1e4), (PAIRS | ON_THE_MODEL)[name]
    plain, remedied = (simulate(problem, [controller], SIMULATION)["c"] for controller in pair)
    both, loop = [controller.bind(problem.known) for controller in pair], remedied.loop
    r = problem.reference(remedied.t)
    for i in range(0, len(remedied.t), 200):
        state = loop.unpack(remedied.states[i])
        own = state.controller._replace(e_d=0 * state.x) if name.startswith("mrac") else state.controller  # e_d is only rounding
        rates = [equations.derivative(own, state.x, state.x_m, r[i], remedied.u[i]) for equations in both]
        np.testing.assert_array_equal(*(flatten(part._replace(e_d=()) if name.startswith("mrac") else part) for part in rates))
    np.testing.assert_allclose(remedied.x, plain.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(remedied.theta_hat, plain.theta_hat, rtol=0, atol=1e-12)


def test_the_control_is_the_solution_of_its_own_equation():
    """u = u_c + mu (sat_inner(u) - u), where the limits of sat_inner are narrower by the margin. u is found by bisection on both
    sides."""
    remedy, limits = ModifiedError(mu=0.7, margin=0.2), np.array([-3.0, 2.0])
    for u_c in (-9.0, -2.6, -2.3, 0.4, 1.55, 1.7, 8.0):

        def excess(u, u_c=u_c):
            return u - u_c - remedy.mu * (np.clip(u, 0.8 * limits[0], 0.8 * limits[1]) - u)

        assert remedy.control(u_c, limits) == pytest.approx(brentq(excess, -20, 20, xtol=1e-13), abs=1e-12)


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("gain", [1.0, 0.7])
@pytest.mark.short(kept=lambda name, gain: gain == 0.7)
def test_at_the_limit_the_lyapunov_function_still_decreases(problems, name, gain):
    """V of the error that drives the law never grows with the remedy, but it does without. 0.7 is an unknown input gain.

    The tolerance is 1e-6 of V = 1, for steps across a corner of the saturation, where u = (...)/omega_hat changes fast.
    """
    problem = limited(problems[2], 3.0)
    if gain != 1.0:
        plant = replace(problem.plant, input=PlantInput(saturation=(-3.0, 3.0), gain=gain))
        problem = replace(problem, plant=plant, input_gain=(0.3, 2.0))
    P, theta = problem.known.P, problem.parameters
    grew = []
    for controller in PAIRS[name]:
        run = simulate(problem, [controller], replace(SIMULATION, record_points=30_000, t_end=15.0))["c"]
        loop = run.loop
        states = [loop.unpack(s) for s in run.states]
        if name == "l1":
            error = np.array([s.x - s.controller.x_hat for s in states])
        else:
            away = [s.controller.e_d if len(s.controller.e_d) else 0.0 for s in states]
            error = run.e - np.array(away).reshape(len(states), -1)
        V = np.einsum("ki,ij,kj->k", error, P, error) + ((run.theta_hat - theta) ** 2).sum(axis=1) / controller.gamma
        grew.append(float(np.maximum(np.diff(V), 0).sum()))
        assert (np.abs(run.u) > 3.0).any()
    assert grew[1] < (1e-9 if gain == 1.0 else 1e-6)
    assert grew[0] > 1e-3


@pytest.mark.parametrize("name", ON_THE_MODEL)
@pytest.mark.parametrize("sample_time", [None, 0.01])
@pytest.mark.short(kept=lambda name, sample_time: (sample_time is None) == name.startswith("RobustMrac"))
def test_the_parametric_model_is_exact_at_the_limit(name, sample_time):
    """z = theta'phi up to rounding with any step, because every Runge-Kutta step keeps the linear relation x - xi = Xi theta.

    With a sampled controller the plant moves between samples, and the relation holds up to the midpoint rule's T^2.
    """
    problem = unstable(2.0)
    misfit = []
    for continuous in ON_THE_MODEL[name]:
        controller = continuous if sample_time is None else Sampled(controller=continuous, sample_time=sample_time)
        run = simulate(problem, [controller], Simulation(t_end=20.0, dt=5e-3))["c"]
        assert (np.abs(run.u) > 2.0).any()
        loop = run.loop
        states = [loop.unpack(s) for s in run.states]
        away = [np.abs(s.x - s.controller.xi - s.controller.Xi @ problem.plant.theta).max() for s in states]
        misfit.append(max(away) / np.abs(run.x).max())
    if sample_time is None:
        assert misfit[1] < 1e-12
    else:
        assert misfit[1] < 0.05
    assert misfit[0] > 20 * misfit[1]


@pytest.mark.parametrize("name", ["RobustMrac, least squares", "RobustMrac, gradient"])
def test_what_winds_up_without_the_remedy_stays_bounded_with_it(name):
    """The plain scheme mistakes the limit for the plant and moves to the corner of the known set. u grows more than
    twentyfold."""
    problem = unstable(2.0)
    plain, remedied = (simulate(problem, [c], Simulation(t_end=20.0, dt=1e-3))["c"] for c in ON_THE_MODEL[name])
    assert (plain.theta_hat[-1] == 4.0).all()
    assert plain.figures["max_abs_u"] > 20 * remedied.figures["max_abs_u"]
    np.testing.assert_allclose(remedied.theta_hat[-1], problem.plant.theta, atol=0.05)


def test_the_bundled_f16_can_take_the_remedies():
    """The F-16's elevator has limits and unknown effectiveness. Ten times the command drives it into the limits."""
    problem = load_case("f16-short-period").problem
    problem = replace(problem, reference=Sine(amplitude=4.0, frequency=0.5))
    remedied = [
        Mrac(gamma=500.0, modified_error=ModifiedError(), name="m"),
        L1Adaptive(gamma=5000.0, filter=input_filter(0.2), saturated_predictor=True, name="l"),
    ]
    runs = simulate(problem, remedied, Simulation(t_end=20.0, dt=1e-3))
    for run in runs.values():
        assert run.diverged_at is None
        assert (np.abs(run.u) > 25.0).any()


def test_positive_mu_keeps_the_control_nearer_to_its_limits(problems):
    problem = limited(problems[2], 3.0)
    peaks = [
        simulate(problem, [Mrac(gamma=50.0, modified_error=ModifiedError(mu=mu), name="c")], SIMULATION)["c"].figures["max_abs_u"]
        for mu in (0.0, 1.0, 10.0)
    ]
    assert peaks[0] > peaks[1] > peaks[2] > 3.0


def test_the_sampled_predictor_takes_what_is_left_of_u(problems):
    """In the midpoint form the estimates drift less with anti-windup than without."""
    problem = limited(problems[2], 3.0)
    astray = []
    for controller in PAIRS["l1"]:
        run = simulate(problem, [Sampled(controller=controller, sample_time=0.01)], SIMULATION)["c"]
        astray.append(np.linalg.norm(run.theta_hat - problem.plant.theta, axis=1).max())
    assert astray[1] <= np.linalg.norm(problem.plant.theta) * 1.05 < astray[0]


def test_refusals(problems):
    free = problems[2]
    remedied = PAIRS["mrac"][1]
    assert "plant.input.saturation" in refusal(lambda: remedied.bind(free.known))
    assert "plant.input.saturation" in refusal(lambda: PAIRS["l1"][1].bind(free.known))
    for plain_or_not in ON_THE_MODEL.values():
        assert "plant.input.saturation" in refusal(lambda c=plain_or_not[1]: c.bind(free.known))
    assert "margin" in refusal(lambda: ModifiedError(margin=1.0))
    assert "mu" in refusal(lambda: ModifiedError(mu=-1.0))
    learning = CompositeLearning(gamma_c=1.0, time_constant=0.1)
    assert "learning" in refusal(lambda: Mrac(gamma=1.0, modified_error=ModifiedError(), learning=learning))


def test_a_pi_with_anti_windup_is_back_calculation_with_its_own_time_constant():
    """The rate of the integrator's contribution to u is k_p/T_i e + (sat(u) - u)/T_i."""
    problem, k_p, T_i = limited(load_case("paper").problem, 1.0), 3.0, 0.7
    pi = LinearFeedback(TransferFunction([k_p * T_i, k_p], [T_i, 0.0]), output=[0.0, 1.0], anti_windup=k_p)
    equations = pi.bind(problem.known)
    state, x, x_m = equations.initial(), np.zeros(2), np.array([0.0, 0.2])
    rates = [equations.K.C @ equations.derivative(state, x, x_m, 0.0, u).K for u in (0.5, 4.0, -2.0)]
    np.testing.assert_allclose(rates, k_p / T_i * 0.2 + np.array([0.0, -3.0, 1.0]) / T_i, rtol=1e-12)


def test_anti_windup_makes_any_linear_controller_forget_at_a_limit():
    """For an order above one, with an integrator and without feedthrough, A - L C is stable."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, -2.0, 5.0], [0.0, 0.0, -30.0]])
    K = StateSpace(A, np.array([0.0, 0.0, 30.0]), np.array([1.0, 0.3, 0.0]), 0.0)
    equations = LinearFeedback(K, anti_windup=0.5).bind(limited(load_case("paper").problem, 1.0).known)
    assert np.linalg.eigvals(K.A - np.outer(equations.L, K.C)).real.max() < -0.1


def test_anti_windup_needs_limits():
    problem = load_case("paper").problem
    unlimited = LinearFeedback(TransferFunction([1.0], [1.0, 0.0]), anti_windup=1.0)
    assert "anti_windup needs plant.input.saturation" in refusal(lambda: unlimited.bind(problem.known))
