"""Limits of the numerics beyond phi(x) = x and one input: bounds are compared with samples, and modes with full matrices and with
runs."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, input_filter, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.bounds.formulas import TIGHTNESS_RATIO, Ball, largest_square
from barbalat.certificates.certify import certify
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.plants import PlantInput
from barbalat.regressors import GaussianRBF, Polynomial, Terms
from barbalat.run.results.adapting import regressor_along
from barbalat.signals import Sine
from barbalat.solvers import RK4

REGRESSORS = {
    "polynomial": (Polynomial(degree=3, constant=True), 3),
    "wing rock": (load_case("wing-rock").problem.plant.regressor, 2),
    "gaussian": (GaussianRBF(centers=[[0.5, -0.2], [-1.0, 1.0], [0.0, 3.0]], width=0.4), 2),
    "functions": (
        Terms(terms=("sin(3*x1)", "exp(-x2)", "tanh(x1)/(2 + x2**2)", "sqrt(abs(x1))", "2 - cos(x1)", "1/(3 + x2)", "-x1*x2")),
        2,
    ),
}


@pytest.mark.parametrize("name", REGRESSORS)
def test_the_bound_holds_and_is_tight(name):
    """The bound is compared with 500 points of each of ten boxes and with their corners."""
    regressor, n = REGRESSORS[name]
    random = np.random.default_rng(4)
    for _ in range(10):
        low, high = -random.uniform(0.1, 2.0, n), random.uniform(0.1, 2.0, n)
        corners = [np.where(choice, high, low) for choice in product((False, True), repeat=n)]
        points = [*(low + (high - low) * random.uniform(size=(500, n))), *corners]
        values = np.array([np.sum(np.asarray(regressor(point), dtype=float) ** 2) for point in points])
        bound = largest_square(regressor, low, high)
        assert bound >= values.max()
        assert bound <= 1.1 * TIGHTNESS_RATIO * values.max()  # 500 points in the interior miss the largest value by this much


@pytest.mark.parametrize(
    ("regressor", "low", "high", "exact"),
    [
        (Terms(terms=("sin(x1)",)), [-10.0], [10.0], 1.0),
        (Terms(terms=("sin(x1)",)), [-1e12], [1e12], 1.0),  # a ball around zero, regardless of how the box is cut
        (Terms(terms=("sin(x1)**3",)), [-1e12], [1e12], 1.0),
        (Terms(terms=("x1*x1", "x1")), [-2.0], [1.0], 20.0),
        (GaussianRBF(centers=[[3.0, 0.0]], width=1.0), [-2.0, -1.0], [2.0, 1.0], np.exp(-1.0)),
        (Terms(terms=("x1*x2",)), [-1.0, -3.0], [2.0, 1.0], 36.0),
    ],
)
def test_known_maxima(regressor, low, high, exact):
    bound = largest_square(regressor, np.array(low), np.array(high))
    assert exact <= bound <= TIGHTNESS_RATIO * exact * (1 + 1e-9)


def test_balls_compute_what_numbers_compute():
    """For every operation of a formula at a point, the ball equals the value up to a rounding."""
    from flint import arb

    formula = Terms(terms=("(x1 - 2)/(3 - x1)**2 + abs(-x1)*2 - 1/x1 + sqrt(x1) + 2**2*tanh(x1) - exp(sin(x1)*cos(x1))",))
    x = np.empty(1, dtype=object)
    x[0] = Ball(arb(0.7))
    (found,) = formula(x)
    assert float(found.value.mid()) == pytest.approx(float(formula(np.array([0.7]))[0]), rel=1e-14)
    assert float(found.value.rad()) < 1e-13


def test_what_balls_cannot_bound_is_infinite():
    assert largest_square(Terms(terms=("1/x1",)), np.array([-1.0]), np.array([1.0])) == np.inf


def test_modes_of_several_inputs_are_those_of_the_whole_error_system():
    """For (x_tilde, theta_tilde) with a frozen Phi (p m, m), the part that is not stationary has the modes of n + m states."""
    problem = load_case("lateral-aircraft").problem
    known, gamma = problem.known, 3.0
    phi = np.random.default_rng(1).normal(size=problem.plant.regressor.size(known.n))
    Phi = np.kron(phi[:, None], np.eye(known.inputs))
    size = known.n + len(Phi)
    whole = np.zeros((size, size))
    whole[: known.n, : known.n] = known.A_m
    whole[: known.n, known.n :] = -known.b @ Phi.T
    whole[known.n :, : known.n] = gamma * Phi @ known.b.T @ known.P
    expected = np.linalg.eigvals(whole)
    expected = expected[np.argsort(-np.abs(expected))][: known.n + known.inputs]
    found = Oscillator(known, RK4, np.zeros(0)).modes(np.array([gamma * phi @ phi]))[0]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-7)


def problems():
    """Problems with nonlinear regressors, with an unknown gain and with two inputs."""
    nonlinear = Problem(
        plant=Plant(
            A_m=[[0.0, 1.0], [-2.0, -3.0]],
            b=[0.0, 1.0],
            theta=[1.0, -0.5, 0.3],
            x0=[0.3, 0.0],
            regressor=Terms(terms=("x1", "x2", "x1*x2")),
        ),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=1.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-2.0, -2.0, -1.0], upper=[2.0, 2.0, 1.0]),
    )
    gain = Problem(
        plant=Plant(A_m=[[-1.0]], b=[2.0], theta=[1.5], x0=[0.5], input=PlantInput(gain=1.3)),
        reference_model=ReferenceModel(k_0=0.5),
        reference=Sine(amplitude=2.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-3.0], upper=[3.0]),
        input_gain=(0.8, 2.0),
    )
    return {"nonlinear": nonlinear, "gain": gain, "inputs": load_case("lateral-aircraft").problem}


@pytest.mark.parametrize("name", ["nonlinear", "gain", "inputs"])
@pytest.mark.parametrize("gamma", [5.0, 500.0])
def test_no_run_is_faster_than_its_certificate_says(name, gamma):
    """The test checks the frequency by the regressor at every recorded instant of the run, and the label at the printed step."""
    problem, controller = problems()[name], Mrac(gamma=gamma)
    found = certify(problem, (controller,), Simulation(t_end=8.0, dt=1e-3))["MRAC"].values
    (run,) = simulate(problem, [controller], Simulation(t_end=8.0, dt=1e-3)).values()
    known, b = problem.known, problem.known.b.reshape(problem.known.n, -1)
    phi = regressor_along(run.loop, run.states, run.x, run.u)
    largest = max(np.linalg.eigvalsh(part @ b.T @ known.P @ b @ part.T)[-1] for part in phi)
    assert np.sqrt(gamma * largest) <= found["adaptation_frequency"]
    steps = int(np.ceil(8.0 / (0.99 * found["step_max"])))
    (at_limit,) = simulate(problem, [controller], Simulation(t_end=8.0, dt=8.0 / steps)).values()
    assert at_limit.label is None


@pytest.mark.parametrize("name", ["nonlinear", "gain", "inputs"])
@pytest.mark.parametrize("scheme", ["mrac", "l1"])
def test_gain_and_step_say_the_same(name, scheme):
    """For the largest gain that a step allows, the largest step is this step. One search varies g, and the other varies h."""
    problem, h = problems()[name], 2e-4

    def controller(gamma):
        return Mrac(gamma=gamma) if scheme == "mrac" else L1Adaptive(gamma=gamma, filter=input_filter(0.05), name="MRAC")

    simulation = Simulation(t_end=1.0, dt=h)
    gamma_max = certify(problem, (controller(1.0),), simulation)["MRAC"].values["gamma_max"]
    assert gamma_max > 0
    again = certify(problem, (controller(gamma_max),), simulation)["MRAC"].values
    assert again["step_max"] == pytest.approx(h, rel=2e-3)
    assert again["gamma_max"] == pytest.approx(gamma_max, rel=2e-3)


def test_robust_mrac_on_a_nonlinear_plant_has_no_nu_0():
    """As with phi(x) = x, the constants of Lemma 1 differ from the constants of Theorem 1."""
    case = load_case("wing-rock")
    found = certify(case.problem, case.controllers, case.simulation)["Robust MRAC"]
    assert "nu_0" not in found.values
    assert found.guaranteed == {"initial_parameter_error"}
    assert found.values["step_max"] > case.simulation.dt


def test_a_regressor_without_a_bound_has_no_limits():
    problem = problems()["nonlinear"]
    plant = replace(problem.plant, regressor=Terms(terms=("x1", "x2", "1/(0.01 + x1)")))
    found = certify(replace(problem, plant=plant), (Mrac(gamma=5.0),), Simulation(t_end=1.0, dt=1e-3))["MRAC"]
    assert not {"adaptation_frequency", "gamma_max", "step_max"} & found.values.keys()
