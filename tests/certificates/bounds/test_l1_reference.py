"""L1-AC's distance to its reference system: the bound on random problems integrated by plain NumPy, closed forms, and the
certificate's entry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import L1Adaptive, Problem, Simulation, TransferFunction, input_filter
from barbalat.adaptation.modifications import FixedSigma
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.certify import certify
from barbalat.certificates.entry import Entry
from barbalat.papers.jafari_2013 import section_v
from barbalat.plants import PlantInput
from certificates.bounds import random_problems

H, T_END = 2e-3, 10.0
"""sqrt(Gamma b'P b) |x| stays below 500 rad/s: RK4's error is far below the distance."""


def largest_distances(members: list[tuple[Problem, L1Adaptive]], C: TransferFunction) -> np.ndarray:
    """The largest |x_i - x_ref,i| (M,) over all RK4 steps of problems that share A_m, b, k_0, x0, r and C."""
    given, filter_ = members[0][0], C.realise()
    known, r = given.known, given.reference
    theta = np.array([problem.plant.theta for problem, _ in members])
    low, high = (np.array([getattr(problem.uncertainty, side) for problem, _ in members]) for side in ("lower", "upper"))
    gamma = np.array([[controller.gamma] for _, controller in members])
    Pb, b, A, count = known.P @ known.b, known.b, known.A_m.T, len(members)
    rest = np.zeros((count, filter_.order))

    def rates(s: list[np.ndarray], r: float) -> list[np.ndarray]:
        x, x_hat, theta_hat, c, x_ref, c_ref = s
        theta_hat = np.clip(theta_hat, low, high)
        wanted, known_sum = -(theta_hat * x).sum(1) + known.k_0 * r, (theta * x_ref).sum(1)
        u, u_ref = c @ filter_.C, c_ref @ filter_.C
        return [
            x @ A + np.outer((theta * x).sum(1) + u, b),
            x_hat @ A + np.outer((theta_hat * x).sum(1) + u, b),
            gamma * ((x - x_hat) @ Pb)[:, None] * x,
            c @ filter_.A.T + np.outer(wanted, filter_.B),
            x_ref @ A + np.outer(known_sum + u_ref, b),
            c_ref @ filter_.A.T + np.outer(-known_sum + known.k_0 * r, filter_.B),
        ]

    x0 = np.tile(known.x0, (count, 1))
    s = [x0, x0, np.array([controller.theta_hat0 for _, controller in members]), rest, x0, rest]
    largest = np.zeros(count)
    for k in range(round(T_END / H)):
        t = H * k
        at = [float(f(np.array(time))) for f, time in ((r, t), (r, t + H / 2), (r.before, t + H))]
        k_1 = rates(s, at[0])
        k_2 = rates([a + H / 2 * f for a, f in zip(s, k_1, strict=True)], at[1])
        k_3 = rates([a + H / 2 * f for a, f in zip(s, k_2, strict=True)], at[1])
        k_4 = rates([a + H * f for a, f in zip(s, k_3, strict=True)], at[2])
        s = [a + H / 6 * (p + 2 * q + 2 * v + w) for a, p, q, v, w in zip(s, k_1, k_2, k_3, k_4, strict=True)]
        s[2] = np.clip(s[2], low, high)
        largest = np.maximum(largest, np.abs(s[0] - s[4]).max(axis=1))
    return largest


@pytest.mark.parametrize("n", range(1, 5))
@pytest.mark.short(kept=lambda n: n == 2)
def test_the_bound_is_never_violated(n, sample):
    """The test has 400 problems for each n (40 in the short tests), with filters of order 1 and 2."""
    rng, used = np.random.default_rng(300 + n), []
    while len(used) < sample(1, 10):
        command, order = random_problems.COMMANDS[len(used) % 4], 1 + len(used) % 2
        group = random_problems.system(rng, n, command)
        C = random_problems.admissible_filter(rng, group, order)
        if C is None:
            continue
        members, bounds = [], []
        for problem in group:
            gamma, start = 10 ** rng.uniform(-1, 3), random_problems.start_of(rng, problem)
            members.append((problem, L1Adaptive(gamma=gamma, filter=C, theta_hat0=start)))
            nu = theorem_1.nu_0(theorem_1.initial_parameter_error(start, problem.plant.theta), problem.known)
            condition = theorem_1.filter_condition(problem.known, C.realise(), problem.uncertainty.theta_max)
            bounds.append(theorem_1.reference_error_bound(theorem_1.mrac_bound(nu, gamma), condition, C.realise()))
        used.append(largest_distances(members, C) / np.array(bounds))
    ratio = np.concatenate(used)
    assert np.isfinite(ratio).all()
    assert (ratio < 1).all()
    assert ratio.max() > 0.02  # some problem comes near the bound


def test_section_v_by_hand():
    """C = 1/(kappa s + 1) has norm 1, and |theta_tilde(0)| = 5. The other numbers come from the condition and from P."""
    given, C = section_v.problem(), input_filter(section_v.KAPPA).realise()
    condition = theorem_1.filter_condition(given.known, C, 10.0)
    nu = 5 / math.sqrt(np.linalg.eigvalsh(given.known.P)[0])
    assert 1 <= theorem_1.filter_norm(C) == pytest.approx(1, rel=1e-9)  # the width of an enclosure
    expected = nu / (1 - 10 * condition.norm.upper)
    found = theorem_1.reference_error_bound(theorem_1.nu_0(5.0, given.known), condition, C)
    assert found == pytest.approx(expected, rel=1e-9) and found >= expected
    fails = theorem_1.filter_condition(given.known, input_filter(0.06).realise(), 10.0)
    assert theorem_1.reference_error_bound(1.0, fails, C) == math.inf


def test_the_exact_gain_by_trapezoids():
    """The impulse responses of (I - G theta')^-1 C of Section V are computed from w = C[x_tilde], g = G[theta'(w + g)]."""
    kappa, theta = section_v.KAPPA, np.array([4.0, -3.0])
    A_m, b = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0])
    A = np.zeros((5, 5))  # w_1, w_2, g (2), c: c' = (v - c)/kappa, g' = A_m g + b (v - c), v = theta'(w + g)
    v = np.concatenate([theta, theta, [0.0]])
    A[0, 0] = A[1, 1] = -1 / kappa
    A[2:4, 2:4] = A_m
    A[2:4] += np.outer(b, v - np.eye(5)[4])
    A[4] = (v - np.eye(5)[4]) / kappa
    outputs = np.hstack([np.eye(2), np.eye(2), np.zeros((2, 1))])
    h, columns = 5e-4, np.vstack([np.eye(2) / kappa, np.zeros((3, 2))])
    step, responses = expm(A * h), []
    for _ in range(60_000):
        responses.append(outputs @ columns)
        columns = step @ columns
    norm = np.trapezoid(np.abs(np.array(responses)), dx=h, axis=0).sum(axis=1).max()
    found = theorem_1.exact_gain(section_v.problem().known, input_filter(kappa).realise(), theta)
    assert found == pytest.approx(norm, rel=2e-4)  # trapezoids with steps of a fortieth of the filter's time constant
    assert found < 1 / (
        1 - 7 * theorem_1.filter_condition(section_v.problem().known, input_filter(kappa).realise(), 1.0).norm.lower
    )


def entry_of(problem: Problem, controller: L1Adaptive) -> Entry:
    return certify(problem, (controller,), Simulation(t_end=60.0, dt=1e-4))["L1"].entry("reference_error_bound")


def test_the_entry_is_guaranteed():
    found = certify(section_v.problem(), (section_v.l1("L1", 1e4),), Simulation(t_end=60.0, dt=1e-4))["L1"]
    assert "reference_error_bound" in found.guaranteed
    assert found.values["reference_error_bound"] == pytest.approx(0.1159, rel=1e-3)
    assert found.values["reference_error_bound"] < found.values["error_bound"]


@pytest.mark.full
def test_the_entry_does_not_apply_where_an_assumption_fails():
    given = section_v.problem()
    delayed = replace(given, plant=replace(given.plant, input=PlantInput(delay=0.01)))
    entry = entry_of(delayed, section_v.l1("L1", 1e4))
    assert entry.kind == "does not apply" and "delay" in entry.why
    too_slow = entry_of(given, section_v.l1("L1", 1e4, 0.06))
    assert too_slow.value is None and "but must be below 1" in too_slow.why
    pulled = entry_of(given, replace(section_v.l1("L1", 1e4), leakage=FixedSigma(sigma=0.1)))
    assert pulled.value is None and "FixedSigma" in pulled.why
