"""The predicted limits of gain and step, compared with the matrices of whole steps and with runs on both sides of the limits."""

import flint
import numpy as np
import pytest

from barbalat import Mrac, NormalizedMrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.laws import Gradient
from barbalat.signals import Constant
from barbalat.solvers import EULER, HEUN, RK4, SOLVERS

NONE = np.zeros(0)


@pytest.fixture(params=SOLVERS)
def solver(request):
    return SOLVERS[request.param]


@pytest.fixture(params=["paper", "third-order"])
def known(request):
    return load_case(request.param).problem.known


@pytest.fixture
def digits():
    """Compute with eighty digits. Euler's growth may be 1e-9 here, and every constant parameter adds an eigenvalue of 1."""
    before, flint.ctx.dps = flint.ctx.dps, 80
    yield
    flint.ctx.dps = before


def growth_of_a_step(known, solver, h, x, gamma):
    """The logarithm of the spectral radius of the matrix by which a step multiplies (x_tilde, theta_tilde)."""
    n = known.n
    M = flint.acb_mat(2 * n, 2 * n)
    for i in range(n):
        for j in range(n):
            M[i, j] = known.A_m[i, j]
            M[i, n + j] = -known.b[i] * x[j]
            M[n + i, j] = gamma * (known.P @ known.b)[j] * x[i]
    R = power = flint.acb_mat(flint.fmpz_mat(2 * n, 2 * n, [int(i == j) for i in range(2 * n) for j in range(2 * n)]))
    for k in range(1, len(solver.b) + 1):
        power = (
            power * M * (flint.arb(h) / k)
        )  # the stability polynomial of a method of order s with s stages is the truncated exponential series
        R = R + power
    return max(float(abs(value).log().mid()) for value in R.eig(algorithm="approx"))


@pytest.mark.parametrize("h", [1e-2, 1e-4])
def test_against_the_matrix_of_a_step(known, solver, h, digits):
    """The map is unstable 1 % above the limit and stable at all tested points below it, for any direction of x."""
    g = Oscillator(known, solver, NONE).largest_g(h)
    direction = np.random.default_rng(1).standard_normal(known.n)
    x = 3 * direction / np.linalg.norm(direction)
    beyond = 1.01 if solver.imaginary_limit == 0 else 1.2  # the formula ignores the damping there, so the true limit is larger
    assert growth_of_a_step(known, solver, h, x, beyond * g / 9) > 1e-30
    for fraction in (0.99, 0.5, 0.1, 1e-3, 1e-6):
        assert growth_of_a_step(known, solver, h, x, fraction * g / 9) <= 1e-30  # n - 1 modes stay at 1


def test_eulers_limit_in_closed_form(known):
    """For a fast oscillation -sigma +- j omega, h = 2 sigma/omega^2 with sigma = b'b/(4 b'P b). The tolerance 1e-2 is for the
    next term, h times A_m."""
    oscillator = Oscillator(known, EULER, NONE)
    for h in (1e-3, 1e-5):
        assert oscillator.largest_g(h) == pytest.approx(known.b @ known.b / (2 * oscillator.bPb**2 * h), rel=1e-2)


def test_first_order_plant_by_hand():
    """lambda^2 + a lambda + g b^2/(2a) = 0. Euler's h is 2/a while A_m's mode determines it, and a/(g b^2/(2a)) beyond."""
    a, b = 3.0, 2.0
    known = Problem(plant=Plant(A_m=[[-a]], b=[b], theta=[0.0])).known
    oscillator = Oscillator(known, EULER, NONE)
    assert oscillator.largest_step(1e-3) == pytest.approx(2 / a, rel=1e-9)
    for g in (10.0, 1e4):
        assert oscillator.largest_step(g) == pytest.approx(min(2 / a, 2 * a**2 / (g * b**2)), rel=1e-9)
    assert oscillator.largest_g(2.1 / a) == 0.0  # no gain is small enough


def test_gain_and_step_are_two_sides_of_one_limit(known, solver):
    """The tolerance 1e-6 is for the rounding of small decay rates, 1e-16 of the frequency, next to the square of a large
    frequency."""
    oscillator = Oscillator(known, solver, NONE)
    for h in (1e-2, 1e-4):
        assert oscillator.largest_step(oscillator.largest_g(h)) == pytest.approx(h, rel=1e-6)


def test_a_fast_filter_binds(known, solver):
    slow = Oscillator(known, solver, np.array([-1000.0])).largest_step(1e-3)
    assert slow == pytest.approx(solver.real_limit / 1000, rel=1e-9)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_run_on_both_sides(name):
    """Near its equilibrium under a constant command, the MRAC is the frozen oscillator. A small error decays below the limit and
    grows above it."""
    solver, h = SOLVERS[name], 1e-3
    base = load_case("paper").problem
    x = -np.linalg.solve(base.plant.A_m, base.plant.b * 4 * 2.0)
    problem = Problem(
        plant=Plant(A_m=base.plant.A_m, b=base.plant.b, theta=[4, -3], x0=x),
        reference_model=ReferenceModel(k_0=4),
        reference=Constant(2.0),
    )
    gamma = Oscillator(problem.known, solver, NONE).largest_g(h) / float(x @ x)

    def run(factor):
        """The largest error of the whole run and the largest error of its last quarter, relative to the largest error that the
        equations allow."""
        controller = Mrac(gamma=factor * gamma, theta_hat0=[4 + 1e-6, -3], projection=False)
        metrics = simulate(problem, [controller], Simulation(t_end=800.0, dt=h, solver=solver))["MRAC"].metrics
        allowed = 1e-6 / np.sqrt(factor * gamma * np.linalg.eigvalsh(problem.known.P)[0])  # (9)
        return np.nan_to_num(np.array([metrics.max_abs_e.max(), metrics.tail_max_abs_e.max()]) / allowed, nan=np.inf)

    largest, tail = run(0.9)
    assert largest < 1
    assert tail < 1e-2  # Euler leaves 10 % of the decay rate b'b/(4 b'P b) = 0.115/s: exp(-6.9) after 600 s
    assert run(1.2)[0] > 1e2  # until the estimates have drifted to values for which A_m - b theta_tilde' has better damping


@pytest.mark.parametrize("name", SOLVERS)
def test_a_normalised_gradient_law_on_both_sides(name):
    """The law's decay rate is Gamma |phi|^2/m_s^2, which is close to Gamma for a large regressor."""
    h, base = 1e-3, load_case("paper").problem
    problem = Problem(plant=base.plant, reference_model=base.reference_model, reference=Constant(1e4))
    simulation = Simulation(t_end=10.0, dt=h, solver=SOLVERS[name])
    values = certify(problem, (NormalizedMrac(law=Gradient(gamma=1.0)),), simulation)["Normalised MRAC"].values
    assert values["gamma_max"] == pytest.approx(SOLVERS[name].real_limit / h)

    def moves(factor):
        controller = NormalizedMrac(law=Gradient(gamma=factor * values["gamma_max"]), projection=False)
        metrics = simulate(problem, [controller], simulation)["Normalised MRAC"].metrics
        return np.inf if np.isfinite(metrics.diverged_at[0]) else metrics.theta_hat_variation_rate.max()

    assert moves(0.9) < 1
    assert moves(1.1) > 1e3


@pytest.mark.parametrize("solver", [EULER, HEUN, RK4])
def test_every_adaptive_scheme_has_its_limits(solver):
    case = load_case("paper")
    found = certify(case.problem, case.controllers, Simulation(t_end=60.0, dt=1e-4, solver=solver))
    for name in ("L1", "MRAC"):
        assert found[name].values["gamma_max"] > 0 and found[name].values["step_max"] > 0
        assert not {"gamma_max", "step_max", "adaptation_frequency"} & found[name].guaranteed
    # Q(s) decays with 1/tau and W_m's zero, the law with up to 2 P(0) = 1000 1/s
    assert found["Robust MRAC"].values["step_max"] == pytest.approx(solver.real_limit / 1000, rel=1e-9)
