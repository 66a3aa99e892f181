"""The certificate of MRAC with a closed-loop reference model, compared with formulas from SciPy's matrices and by hand, and with
runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import expm, solve_continuous_lyapunov

from barbalat import MracClosedLoop, ParameterBox, Plant, certify, simulate
from barbalat.plants import ParameterBall, PlantInput
from barbalat.regressors import Terms
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

GAMMA, DT = 4.0, 1e-3
FEEDBACK = {n: -2.0 * np.eye(n) + 0.3 * np.eye(n, k=1) for n in (1, 2, 3)}
"""The gain L. A_m + L is faster than A_m, so its P is smaller, and nu_0 computed with the P of A_m would be too small."""
QUADRATURE = {"rel": 1e-5}
"""Relative tolerance. Trapezoids of 2e-3 s have an error of (3 * 2e-3)^2/12 = 3e-6 for the fastest mode, of 3/s. The truncation
is 1e-9, and the width of the enclosures is 1e-6."""


def l1_norms(A, B):
    """The integrals over time of the magnitudes of the entries of exp(A t) B."""
    step, samples, transition = 2e-3, [B], expm(2e-3 * A)
    while np.abs(samples[-1]).max() > 1e-9 * np.abs(B).max():
        samples.append(transition @ samples[-1])
    return trapezoid(np.abs(samples), dx=step, axis=0)


@pytest.fixture(params=[1, 2, 3], scope="module")
def certified(request, problems):
    """n, the problem at rest, its certificate, P of A_m + L, and the L1 norm from e_c to e."""
    n = request.param
    problem = replace(problems[n], plant=replace(problems[n].plant, x0=np.zeros(n)))
    controller = MracClosedLoop(gamma=GAMMA, model_feedback=FEEDBACK[n])
    keys = ("nu_0", "error_bound", "adaptation_frequency", "gamma_max")
    found = certify(problem, [controller], Simulation(t_end=1.0, dt=DT), keys=keys)[controller.name].values
    A_m, L = problem.plant.A_m, FEEDBACK[n]
    P = solve_continuous_lyapunov((A_m + L).T, -np.eye(n))
    return n, problem, found, P, (np.eye(n) + l1_norms(A_m, L)).sum(axis=1).max()


def nu_0(problem, P):
    return np.linalg.norm(problem.parameters) / np.sqrt(np.linalg.eigvalsh(P)[0])  # theta_hat(0) = 0


def test_the_error_s_bound_is_that_of_the_loop_s_own_matrix(certified):
    """|e_i| <= carried nu_0/sqrt(Gamma) with nu_0 for P of A_m + L. With P of A_m the bound would be smaller, but it would have
    no proof."""
    n, problem, found, P, carried = certified
    wrong = solve_continuous_lyapunov(problem.plant.A_m.T, -np.eye(n))
    assert nu_0(problem, wrong) < 0.9 * nu_0(problem, P)
    assert found["nu_0"] == pytest.approx(nu_0(problem, P), rel=1e-9)
    assert found["error_bound"] == pytest.approx(carried * nu_0(problem, P) / np.sqrt(GAMMA), **QUADRATURE)


def test_the_limits_count_all_of_the_state(certified):
    """The fastest frequency of adaptation and the gain at which RK4 leaves the imaginary axis use |x|_2 <= |x_m|_2 + sqrt(n) max
    |e_i|."""
    n, problem, found, P, carried = certified
    plant, command = problem.plant, problem.reference_model.k_0 * problem.reference.bound
    x_m = np.linalg.norm(l1_norms(plant.A_m, plant.b[:, None])) * abs(command)
    e_by_root_gain = np.sqrt(n) * carried * nu_0(problem, P)
    root_bPb = np.sqrt(plant.b @ P @ plant.b)
    assert found["adaptation_frequency"] == pytest.approx(root_bPb * (np.sqrt(GAMMA) * x_m + e_by_root_gain), **QUADRATURE)
    largest = 2 * np.sqrt(2) / DT  # RK4's limit on the imaginary axis
    assert found["gamma_max"] == pytest.approx(((largest / root_bPb - e_by_root_gain) / x_m) ** 2, **QUADRATURE)


def test_by_hand(problems):
    """With x' = -x + 2 (u + theta x), theta = 1.5 and L = -2, P is 1/6, and the L1 norm of 1 + 2/(s + 1) is 3. The tolerance 1e-6
    is the enclosures' width."""
    problem = replace(problems[1], plant=replace(problems[1].plant, x0=np.zeros(1)))
    controller = MracClosedLoop(gamma=GAMMA, model_feedback=[[-2.0]])
    found = certify(problem, [controller], Simulation(t_end=1.0, dt=DT), keys=("nu_0", "error_bound"))[controller.name].values
    assert found["nu_0"] == pytest.approx(1.5 * np.sqrt(6), rel=1e-9)
    assert found["error_bound"] == pytest.approx(3 * 1.5 * np.sqrt(6) / 2, rel=1e-6)


SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def random_member(problems, seed):
    """A random problem of order 1 to 3 with a scalar, diagonal or matrix gain and a box, a ball or no known set."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    given, theta = problems[n], rng.uniform(-1.0, 1.0, n)
    box, ball = ParameterBox(lower=-2 * np.ones(n), upper=2 * np.ones(n)), ParameterBall(center=np.zeros(n), radius=2.0)
    root = rng.normal(size=(n, n))
    sizes = (10 ** rng.uniform(0, 2), 10 ** rng.uniform(0, 2, n), 5 * (root @ root.T + 0.3 * np.eye(n)))
    problem = replace(
        given,
        plant=Plant(A_m=given.plant.A_m, b=given.plant.b, theta=theta, x0=rng.normal(size=n)),
        uncertainty=(box, ball, None)[seed // 3 % 3],
        reference=Sine(amplitude=rng.uniform(0.1, 5), frequency=10 ** rng.uniform(-1, 1)),
    )
    L = -rng.uniform(0, 5) * np.eye(n) + 0.2 * rng.normal(size=(n, n))
    return problem, MracClosedLoop(gamma=sizes[seed // 9 % 3], model_feedback=L)


EACH_PAIR = [n + 3 * known_set + 9 * ((n + known_set) % 3) for n in range(3) for known_set in range(3)]
"""Seeds that cover every pair of an order, a known set and a kind of gain. The first 27 cover every triple."""


def test_the_bound_holds_along_runs(problems, by_turns):
    for seed in by_turns([*EACH_PAIR, *(seed for seed in range(1000) if seed not in EACH_PAIR)], len(EACH_PAIR)):
        problem, controller = random_member(problems, seed)
        if np.linalg.eigvals(problem.plant.A_m + controller.model_feedback).real.max() > -0.01:
            continue
        (found,) = certify(problem, [controller], SIMULATION, keys=("error_bound",)).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed


TERMS = {1: ("sin(x1)",), 2: ("x1*x2", "sin(x2)"), 3: ("x1*x2", "x3", "tanh(x1)")}


def test_the_bound_holds_for_another_regressor_too(problems, by_turns):
    """The Lyapunov function holds for any phi(x). The margins come from one linearisation, and none is guaranteed."""
    for seed in by_turns(range(300), 9):
        problem, controller = random_member(problems, seed)
        problem = replace(problem, plant=replace(problem.plant, regressor=Terms(terms=TERMS[problem.plant.n])))
        if np.linalg.eigvals(problem.plant.A_m + controller.model_feedback).real.max() > -0.01:
            continue
        (found,) = certify(problem, [controller], SIMULATION, keys=("error_bound", "delay_margin")).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed and "delay_margin" not in found.guaranteed
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed


def test_the_worst_theta_of_a_box_is_a_vertex(problems):
    """nu_0 is convex in theta, so the largest bound at the vertices is the bound for the set. The tolerance 1e-9 is for outward
    rounding."""
    given, controller = problems[2], MracClosedLoop(gamma=3.0, model_feedback=-np.eye(2))
    box = ParameterBox(lower=[-1.0, -2.0], upper=[4.0, 0.5])
    vertices = [[a, b] for a in (-1.0, 4.0) for b in (-2.0, 0.5)]
    keys, found = ("nu_0", "nu_0_worst", "error_bound", "error_bound_worst"), []
    for theta in vertices:
        problem = replace(given, plant=replace(given.plant, theta=np.array(theta)), uncertainty=box)
        found.append(certify(problem, [controller], SIMULATION, keys=keys)[controller.name].values)
    assert max(values["nu_0"] for values in found) == pytest.approx(found[0]["nu_0_worst"], rel=1e-9)
    assert max(values["error_bound"] for values in found) == pytest.approx(found[0]["error_bound_worst"], rel=1e-9)


def test_nothing_is_claimed_beside_a_delay(problems):
    plant = replace(problems[2].plant, input=PlantInput(delay=0.1))
    (found,) = certify(
        replace(problems[2], plant=plant), [MracClosedLoop(gamma=1.0, model_feedback=-np.eye(2))], SIMULATION
    ).values()
    assert "error_bound" not in found.values and "delay 0.1 s" in found.entry("error_bound").why
