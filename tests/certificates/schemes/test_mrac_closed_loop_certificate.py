"""The certificate of the MRAC with a closed-loop reference model, against its formulas with SciPy's matrices and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import expm, solve_continuous_lyapunov

from barbalat import MracClosedLoop, certify
from barbalat.solvers.simulation import Simulation

GAMMA, DT = 4.0, 1e-3
FEEDBACK = {n: -2.0 * np.eye(n) + 0.3 * np.eye(n, k=1) for n in (1, 2, 3)}
"""L: A_m + L is faster than A_m, so that its P is smaller and nu_0 with P of A_m would be too small."""
QUADRATURE = {"rel": 1e-5}
"""Trapezoids of 2e-3 s err by (3 * 2e-3)^2/12 = 3e-6 of a mode of 3/s, the fastest; cut off is 1e-9, enclosures 1e-6."""


def l1_norms(A, B):
    """The integrals over time of the entries' magnitudes of exp(A t) B."""
    step, samples, transition = 2e-3, [B], expm(2e-3 * A)
    while np.abs(samples[-1]).max() > 1e-9 * np.abs(B).max():
        samples.append(transition @ samples[-1])
    return trapezoid(np.abs(samples), dx=step, axis=0)


@pytest.fixture(params=[1, 2, 3])
def certified(request, problems):
    """(n, problem at rest, its certificate, P of A_m + L, the L1 norm from e_c to e)."""
    n = request.param
    problem = replace(problems[n], plant=replace(problems[n].plant, x0=np.zeros(n)))
    controller = MracClosedLoop(gamma=GAMMA, model_feedback=FEEDBACK[n])
    found = certify(problem, [controller], Simulation(t_end=1.0, dt=DT))[controller.name].values
    A_m, L = problem.plant.A_m, FEEDBACK[n]
    P = solve_continuous_lyapunov((A_m + L).T, -np.eye(n))
    return n, problem, found, P, (np.eye(n) + l1_norms(A_m, L)).sum(axis=1).max()


def nu_0(problem, P):
    return np.linalg.norm(problem.parameters) / np.sqrt(np.linalg.eigvalsh(P)[0])  # theta_hat(0) = 0


def test_the_error_s_bound_is_that_of_the_loop_s_own_matrix(certified):
    """|e_i| <= carried nu_0/sqrt(Gamma), nu_0 with P of A_m + L; with P of A_m it would be smaller, which nothing proves."""
    n, problem, found, P, carried = certified
    wrong = solve_continuous_lyapunov(problem.plant.A_m.T, -np.eye(n))
    assert nu_0(problem, wrong) < 0.9 * nu_0(problem, P)
    assert found["nu_0"] == pytest.approx(nu_0(problem, P), rel=1e-9)
    assert found["error_bound"] == pytest.approx(carried * nu_0(problem, P) / np.sqrt(GAMMA), **QUADRATURE)


def test_the_limits_count_all_of_the_state(certified):
    """|x|_2 <= |x_m|_2 + sqrt(n) max |e_i|: the adaptation's fastest frequency, and the gain at which RK4 leaves its axis."""
    n, problem, found, P, carried = certified
    plant, command = problem.plant, problem.reference_model.k_0 * problem.reference.bound
    x_m = np.linalg.norm(l1_norms(plant.A_m, plant.b[:, None])) * abs(command)
    e_by_root_gain = np.sqrt(n) * carried * nu_0(problem, P)
    root_bPb = np.sqrt(plant.b @ P @ plant.b)
    assert found["adaptation_frequency"] == pytest.approx(root_bPb * (np.sqrt(GAMMA) * x_m + e_by_root_gain), **QUADRATURE)
    largest = 2 * np.sqrt(2) / DT  # RK4's piece of the imaginary axis
    assert found["gamma_max"] == pytest.approx(((largest / root_bPb - e_by_root_gain) / x_m) ** 2, **QUADRATURE)


def test_by_hand(problems):
    """x' = -x + 2 (u + theta x), theta = 1.5, L = -2: P = 1/6, the L1 norm of 1 + 2/(s + 1) is 3. 1e-6: the enclosures' width."""
    problem = replace(problems[1], plant=replace(problems[1].plant, x0=np.zeros(1)))
    controller = MracClosedLoop(gamma=GAMMA, model_feedback=[[-2.0]])
    found = certify(problem, [controller], Simulation(t_end=1.0, dt=DT))[controller.name].values
    assert found["nu_0"] == pytest.approx(1.5 * np.sqrt(6), rel=1e-9)
    assert found["error_bound"] == pytest.approx(3 * 1.5 * np.sqrt(6) / 2, rel=1e-6)
