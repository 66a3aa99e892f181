"""Regressors, several inputs and an unknown input gain, compared with SciPy on the matrix equations."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, MracClosedLoop
from barbalat.linear.pole_placement import place
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.loop.packing import column, symbols
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.output_feedback import Nonlinearity
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import GaussianRBF, Linear, Polynomial, Terms
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from independent import refusal

REGRESSORS = {
    "linear": (Linear(), lambda x: x),
    "polynomial": (Polynomial(degree=2), lambda x: np.array([x[0], x[1], x[0] ** 2, x[0] * x[1], x[1] ** 2])),
    "with constant": (Polynomial(degree=1, constant=True), lambda x: np.array([1, x[0], x[1]])),
    "gaussian": (
        GaussianRBF(centers=[[0.0, 0.0], [1.0, -1.0]], width=0.5),
        lambda x: np.exp([-(x @ x) / 0.5, -((x - [1, -1]) @ (x - [1, -1])) / 0.5]),
    ),
    "terms": (
        Terms(terms=("x1", "abs(x1)*x2", "-x2**3/2 + 1", "sin(x1)*exp(-x2) + tanh(x1) - cos(x2)", "sqrt(abs(x1))", "2.5")),
        lambda x: np.array([
            x[0], abs(x[0]) * x[1], -(x[1] ** 3) / 2 + 1, np.sin(x[0]) * np.exp(-x[1]) + np.tanh(x[0]) - np.cos(x[1]),
            np.sqrt(abs(x[0])), 2.5,
        ]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REGRESSORS)
def test_values_on_numbers_and_symbols(name):
    regressor, expected = REGRESSORS[name]
    state_column, x = symbols("x", 2)
    traced = ca.Function("phi", [state_column], [column(regressor(x))])
    random = np.random.default_rng(2)
    for _ in range(20):
        value = random.normal(size=2)
        np.testing.assert_allclose(regressor(value), expected(value), rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(np.asarray(traced(value))[:, 0], expected(value), rtol=1e-14, atol=1e-15)
    assert regressor.size(2) == len(expected(np.ones(2)))


@pytest.mark.parametrize(
    "term",
    ["__import__('os')", "x1.real", "x1 if x1 else 2", "lambda: 1", "x0", "y1", "max(x1, 2)", "x1**x2", "[x1]", "x1 <", "",
     "True", "x1; x2", "abs(x1, x2)", "x1 @ x2", "exp", "'x1'", "x1 and x2", "f'{x1}'", "(x1 := 2)", "1j", "x1 // x2"],
)  # fmt: skip
def test_nothing_but_formulas(term):
    assert "plant.regressor.terms" in refusal(lambda: Terms(terms=(term,)))


@pytest.mark.parametrize(
    "term",
    ["x1*(1/0)", "x1/0", "x1/(2-2)", "x1+(1e300)**2", "(0-1)**0.5*x1", "1e999*x1", f"x1+{'9' * 400}", "x1**1e999",
     "sqrt(0-1)*x1", "exp(1000)", "x1 + exp(1000) - exp(1000)", "0**-1", "abs(0/0)"],
)  # fmt: skip
def test_constants_are_finite_real_numbers(term):
    """A term with any other constant is rejected in one sentence that shows the part, for any x."""
    for make in (lambda: Terms(terms=(term,)), lambda: Nonlinearity(term.replace("x1", "y"))):
        assert len(refusal(make)) < 500


@pytest.mark.parametrize("term", ["-" * 900 + "x1", "abs(" * 900 + "x1" + ")" * 900, "+".join(["x1"] * 5000), "1+" * 5000 + "x1"])
def test_a_formula_too_deep_for_a_computer(term):
    assert len(refusal(lambda: Terms(terms=(term,)))) < 500


def test_a_long_sum_is_a_formula():
    """The sum is 300 levels deep and equals 300 x1. The folded constants equal Python's."""
    phi = Terms(terms=("+".join(["x1"] * 300), "x1*(2**0.5/3-sin(1))"))
    np.testing.assert_allclose(phi(np.array([2.0])), [600.0, 2 * (2**0.5 / 3 - np.sin(1.0))], rtol=1e-15)


def test_refusals():
    assert "x3" in refusal(lambda: Terms(terms=("x1", "x3")).size(2))
    assert "list of formulas" in refusal(lambda: Terms(terms=()))
    assert "degree" in refusal(lambda: Polynomial(degree=0))
    assert "centers" in refusal(lambda: GaussianRBF(centers=[[1.0, 2.0, 3.0]], width=1.0).size(2))
    assert "width" in refusal(lambda: GaussianRBF(centers=[[1.0]], width=0.0))
    assert "plant.theta" in refusal(lambda: Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0], regressor=Polynomial(degree=2)))


A_M = np.array([[0.0, 1.0, 0.0], [-2.0, -3.0, 0.5], [0.3, 0.0, -1.5]])
B = np.array([[0.0, 0.1], [1.0, -0.4], [0.2, 1.5]])
THETA = np.array([[0.5, -1.0], [-0.7, 0.2], [0.4, 0.9]])
K_0 = np.array([[1.0, 0.5], [-0.3, 2.0]])
REFERENCE = (Sine(amplitude=1.0, frequency=1.0), Sine(amplitude=0.5, frequency=2.3, phase=0.4))


def two_inputs(**settings):
    box = ParameterBox(lower=np.full(6, -2.0), upper=np.full(6, 2.0))
    plant = Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, -0.2, 0.1], input=settings.pop("input", None))
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=K_0), reference=REFERENCE, uncertainty=box, **settings)


@pytest.mark.parametrize("filtered", [False, True])
def test_two_inputs_against_the_matrix_equations(filtered):
    """With Theta (3, 2), DOP853 integrates x' = A_m x + B (Theta'x + u) and Theta_hat' = Gamma x e'P B. The tolerance 1e-8 is for
    RK4 at h = 1e-3 with gamma = 20."""
    problem = two_inputs()
    gamma, kappa, P = 20.0, 0.1, problem.known.P

    def slope(t, s):
        x, x_m, x_hat, Theta_hat, u_f = s[:3], s[3:6], s[6:9], s[9:15].reshape(3, 2), s[15:]
        r = np.array([float(signal(np.array(t))) for signal in REFERENCE])
        wanted = -Theta_hat.T @ x + K_0 @ r
        u = u_f if filtered else wanted
        error = x - (x_hat if filtered else x_m)
        return [
            *(A_M @ x + B @ (THETA.T @ x + u)),
            *(A_M @ x_m + B @ K_0 @ r),
            *(A_M @ x_hat + B @ (Theta_hat.T @ x + u)),
            *(gamma * np.outer(x, error @ P @ B)).reshape(-1),
            *((wanted - u_f) / kappa),
        ]

    x0 = problem.plant.x0
    exact = solve_ivp(slope, (0, 4), [*x0, *x0, *x0, *np.zeros(8)], method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    settings = {"gamma": gamma, "projection": False, "name": "c"}
    controller = L1Adaptive(filter=input_filter(kappa), **settings) if filtered else Mrac(**settings)
    run = simulate(problem, [controller], Simulation(t_end=4.0, dt=1e-3))["c"]
    np.testing.assert_allclose(run.x[-1], exact[:3], atol=1e-8)
    np.testing.assert_allclose(run.theta_hat[-1], exact[9:15], atol=1e-8)
    assert run.u.shape == (len(run.t), 2)
    assert len(run.figures["max_abs_u"]) == 2
    assert {"u_1", "u_2", "r_1", "r_2", "theta_hat_6"} <= set(run.columns())
    assert run.to_xarray()["u"].dims == ("t", "input")


def test_unknown_gain_lyapunov_function_and_interval(problems):
    """V = e'Pe + (theta_tilde'theta_tilde + omega_tilde^2)/gamma never grows, and the bound (9) with omega in nu_0 holds."""
    problem = replace(problems[2], plant=replace(problems[2].plant, input=PlantInput(gain=0.6)), input_gain=(0.3, 2.0))
    run = simulate(problem, [Mrac(gamma=10.0)], Simulation(t_end=20.0, dt=1e-3))["MRAC"]
    P, true = problem.known.P, problem.parameters
    np.testing.assert_array_equal(true, [1.0, -0.5, 0.6])
    tilde = run.theta_hat - true
    V = np.einsum("ki,ij,kj->k", run.e, P, run.e) + (tilde**2).sum(axis=1) / 10.0
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    assert run.theta_hat[0].tolist() == [0.0, 0.0, 1.0]
    assert (run.theta_hat[:, 2] >= 0.3).all()
    bound = certify(problem, (run.controller,), run.simulation)["MRAC"]
    assert "error_bound" in bound.guaranteed
    assert max(run.figures["max_abs_e"]) <= bound.values["error_bound"]


def test_exact_gain_estimate_is_the_known_gain(problems):
    """gamma = 1e-12 keeps omega_hat at the true 1, with which C/(1 - C) in feedback is C, for L1 and MRAC."""
    plain = problems[2]
    unknown = replace(plain, input_gain=(0.5, 2.0))
    simulation = Simulation(t_end=5.0, dt=1e-3)
    for controller in (Mrac(gamma=1e-12, name="c"), L1Adaptive(gamma=1e-12, filter=input_filter(0.1), name="c")):
        a, b = (simulate(problem, [controller], simulation)["c"] for problem in (plain, unknown))
        np.testing.assert_allclose(b.x, a.x, atol=1e-8)


def test_members_with_several_inputs():
    simulation = Simulation(t_end=2.0, dt=1e-2)
    members = []
    for i in range(5):
        problem = two_inputs(input=[PlantInput(gain=1.1 + 0.1 * i), PlantInput(saturation=(-1.0 - i, 1.0 + i))])
        members.append((problem, Mrac(gamma=1.0 + i)))
    together = simulate_ensemble(members, simulation).metrics
    for i, (problem, controller) in enumerate(members):
        alone = simulate(problem, [controller], simulation)["MRAC"].metrics
        np.testing.assert_allclose(together.max_abs_u[i], alone.max_abs_u[0], rtol=1e-10)


@pytest.mark.parametrize("name", ["wing-rock", "f16-short-period", "lateral-aircraft", "first-order"])
def test_bundled_plants_stay_bounded_and_track(name):
    """Every controller of the literature cases follows its model: the error in the tail is a small part of the model's motion."""
    case = load_case(name)
    for run in simulate(case.problem, case.controllers, case.simulation).values():
        assert run.diverged_at is None
        motion = np.abs(run.x_m[3 * len(run.t) // 4 :]).max(axis=0).max()
        assert max(run.figures["tail_max_abs_e"]) < 0.5 * motion


def test_wing_rock_diverges_without_control():
    """The published coefficients have a saddle and negative damping at the origin. The motion grows from 0.02 rad to more than 1
    rad within 20 s."""
    plant = load_case("wing-rock").problem.plant
    A = plant.A_m + np.outer(plant.b, plant.theta[:2])
    np.testing.assert_allclose(A, [[0, 1], [0.2314, 0.6918]], atol=1e-12)

    def slope(t, x):
        phi = np.array([x[0], x[1], abs(x[0]) * x[1], abs(x[1]) * x[1], x[0] ** 3])
        return plant.A_m @ x + plant.b * (plant.theta @ phi)

    run = solve_ivp(slope, (0, 20), [0.02, 0.0], rtol=1e-9, atol=1e-10, events=lambda t, x: x[0] - 1)
    assert len(run.t_events[0])


@pytest.mark.parametrize(
    ("name", "modes"),
    [
        # published: one unstable and one stable real short-period mode; Dutch roll, roll subsidence and spiral
        ("f16-short-period", [-1.91089, -0.18537]),
        ("lateral-aircraft", [-3.6152, -0.4236 - 3.0642j, -0.4236 + 3.0642j, -0.0163]),
    ],
)
def test_aircraft_modes(name, modes):
    """Eigenvalues of A = A_m + B theta' from the printed matrices. The tolerance is 2e-3 because the modes are printed with that
    many digits."""
    plant = load_case(name).problem.plant
    A = plant.A_m + plant.b.reshape(plant.n, -1) @ plant.theta.reshape(plant.n, -1).T
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A)), np.sort_complex(modes), atol=2e-3)


def test_place():
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, 3.0]])
    poles = np.linalg.eigvals(place(A, [0.0, 0.0, 1.0], [-4.0, [-1.0, 2.0]]))
    np.testing.assert_allclose(np.sort_complex(poles), [-4, -1 - 2j, -1 + 2j], atol=1e-9)
    assert "3 poles" in refusal(lambda: place(A, [0.0, 0.0, 1.0], [-1.0, -2.0]))
    assert "got 4: -1, -2+1j, -2-1j, -2" in refusal(lambda: place(A, [0.0, 0.0, 1.0], [-1.0, [-2.0, 1.0], -2.0]))
    assert "must lie in Re s < 0, got 0" in refusal(lambda: place(A, [0.0, 0.0, 1.0], [-1.0, 0.0, -2.0]))


def test_place_of_poles_that_coincide():
    """With one input any number of poles may coincide (critical damping), by their polynomial. With m inputs m poles may."""
    A, B = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, 3.0]]), np.eye(3)[:, 1:]
    for poles in ([-1.0, -1.0, -2.0], [-3.0, -3.0, -3.0]):
        found = place(A, [0.2, -0.1, 1.0], poles)
        np.testing.assert_allclose(np.poly(found), np.poly(poles), rtol=1e-12)
        np.testing.assert_allclose(np.linalg.matrix_rank(np.column_stack([found - A, [0.2, -0.1, 1.0]])), 1)  # b K
    np.testing.assert_allclose(np.poly(place(A, B, [-1.0, -1.0, -2.0])), np.poly([-1.0, -1.0, -2.0]), rtol=1e-9)
    assert "has -1 3 times, but 2 inputs" in refusal(lambda: place(A, B, [-1.0, -1.0, -1.0]))
    assert "does not reach the mode at 5" in refusal(lambda: place(np.diag([1.0, 5.0]), [1.0, 0.0], [-1.0, -1.0]))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: replace(two_inputs(), reference_model=ReferenceModel(k_0=1.0)), ["k_0", "2 x 2"]),
        (lambda: replace(two_inputs(), reference_model=ReferenceModel(k_0=np.ones((2, 3)))), ["k_0", "2 x 2"]),
        (lambda: replace(two_inputs(), reference=Sine(amplitude=1.0, frequency=1.0)), ["k_0", "2 x 1"]),
        (lambda: replace(two_inputs(), disturbance=Sine(amplitude=1.0, frequency=1.0)), ["disturbance", "one input"]),
        (lambda: two_inputs(input=[PlantInput()]), ["plant.input", "2"]),
        (lambda: two_inputs(input=[PlantInput(delay=0.1), PlantInput()]), ["plant.input", "same delay"]),
        (lambda: replace(two_inputs(), uncertainty=ParameterBox(lower=[-1.0], upper=[1.0])), ["uncertainty", "6"]),
        (lambda: replace(two_inputs(), input_gain=(0.0, 1.0)), ["input_gain", "0 < lower"]),
        (lambda: replace(two_inputs(), input_gain=((0.5, 1.0), (2.0, 1.0))), ["input_gain", "0 < lower", "[2, 1]"]),
        (lambda: replace(two_inputs(), input_gain=((0.5, 1.0),) * 3), ["input_gain", "2 x 2"]),
        (lambda: Plant(A=np.eye(3), A_m=A_M, b=B), ["matched", "outside the range"]),
        (lambda: MracClosedLoop(gamma=1.0, model_feedback=-np.eye(2)).bind(two_inputs().known), ["one input", "2"]),
        (lambda: LinearFeedback(controller=TransferFunction([1.0], [1.0, 1.0])).bind(two_inputs().known), ["one input"]),
        (
            lambda: Mrac(gamma=1.0, projection=True).bind(replace(two_inputs(), uncertainty=None, input_gain=(0.5, 2.0)).known),
            ["projection", "uncertainty.lower"],
        ),
    ],
)  # fmt: skip
def test_bad_problems(make, words):
    message = refusal(make)
    assert all(word in message for word in words)
