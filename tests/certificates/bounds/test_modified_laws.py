"""Certificates with matrix gains, balls and modified laws: all remaining guarantees are compared with simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, NormalizedMrac, ParameterBox, Sampled, input_filter
from barbalat.certificates.bounds import laws
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.laws import (
    CompositeLearning,
    DeadZone,
    EpsilonModification,
    FixedSigma,
    Gradient,
    LeastSquares,
    LeastSquaresForgetting,
    SwitchingSigma,
)
from barbalat.linear.margins import margins
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import ParameterBall
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=20.0, dt=2.0**-8)
MATRIX = np.array([[3.0, 1.0], [1.0, 2.0]])


BOUNDS = ("error_bound", "error_bound_worst", "reference_error_bound", "nu_1", "nu_2")


def certificate(problem, controller, keys=None):
    return certify(problem, (controller,), SIMULATION, keys=keys)[controller.name]


@pytest.mark.dear
def test_the_bounds_hold_for_matrix_gains_balls_and_what_leaves_V_alone(problems, sample):
    """The bounds are those printed by ``certify``: |e| <= sqrt(theta_tilde'Gamma^-1 theta_tilde/lambda_min(P)) for MRAC and (10)
    for L1-AC.

    There are only a few members. test_modified_bounds.py has 1600 of random dimension.
    """
    random = np.random.default_rng(3)
    learning = CompositeLearning(gamma_c=1.0, time_constant=0.3, capacity=1.0)
    for make in (
        lambda gamma: Mrac(gamma=gamma),
        lambda gamma: Mrac(gamma=gamma, leakage=SwitchingSigma(sigma=0.5, M_0=5.0)),
        lambda gamma: Mrac(gamma=gamma, learning=learning),
        lambda gamma: L1Adaptive(gamma=gamma, filter=input_filter(0.02), learning=learning),
    ):
        members = []
        for _ in range(sample(1, 5)):
            root = random.normal(size=(2, 2))
            ball = ParameterBall(center=random.uniform(-1, 1, 2), radius=random.uniform(1, 2))
            angle = random.uniform(0, 2 * np.pi)
            theta = ball.center + 0.999 * ball.radius * np.array([np.cos(angle), np.sin(angle)])
            given = replace(problems[2], plant=replace(problems[2].plant, theta=theta), uncertainty=ball)
            controller = replace(make(10 ** random.uniform(0, 2) * (root @ root.T + 0.1 * np.eye(2))), theta_hat0=ball.center)
            members.append((given, controller))
        peaks = simulate_ensemble(members, SIMULATION).metrics.max_abs_e.max(axis=1)
        found = [certificate(*member, BOUNDS) for member in members]
        bounds = np.array([f.values["error_bound"] for f in found])
        assert all("error_bound" in f.guaranteed for f in found)
        assert (peaks <= bounds).all()
        assert (peaks / bounds).max() > 0.02  # a bound that is not trivial


def test_equal_gains_have_equal_bounds(problems):
    """A matrix gamma I gives the same bounds as the scalar gamma, also in the worst case over the set."""
    scalar, matrix = (certificate(problems[2], Mrac(gamma=gamma)).values for gamma in (3.0, 3 * np.eye(2)))
    for key in ("error_bound", "error_bound_worst", "adaptation_frequency", "step_max", "delay_margin_adapting"):
        assert matrix[key] == pytest.approx(scalar[key], rel=1e-9)
    assert matrix.get("gamma_max") is None


def test_the_weighted_error_against_numpy():
    random = np.random.default_rng(1)
    for n in (1, 2, 4):
        root, error = random.normal(size=(n, n)), random.normal(size=n)
        gamma = root @ root.T + np.eye(n)
        exact = np.sqrt(error @ np.linalg.solve(gamma, error))
        assert exact * (1 - 1e-13) <= laws.weighted_error(error, gamma) <= exact * (1 + 1e-11)
        assert laws.least_gain(gamma) <= np.linalg.eigvalsh(gamma)[0] * (1 + 1e-13)
        assert laws.least_gain(np.diag(gamma).copy()) == np.diag(gamma).min()


VOID = {
    "sigma": {"leakage": FixedSigma(sigma=0.1)},
    "epsilon": {"leakage": EpsilonModification(nu=0.1)},
    "dead zone": {"dead_zone": DeadZone(g_0=0.1)},
    "M_0 below the set": {"leakage": SwitchingSigma(sigma=0.1, M_0=1.0)},
}


@pytest.mark.parametrize("name", VOID)
def test_no_bound_is_given_where_V_may_grow(problems, name):
    for controller in (Mrac(gamma=5.0, **VOID[name]), L1Adaptive(gamma=5.0, filter=input_filter(0.01), **VOID[name])):
        found = certificate(problems[2], controller, BOUNDS)
        assert not set(BOUNDS) & found.values.keys()
        assert not set(BOUNDS) & found.guaranteed
        assert any("bound" in finding or "M_0" in finding for finding in found.findings)


def test_M_0_may_be_the_set_itself(problems):
    """M_0 may equal the radius 6 of a ball about zero or the norm of the corner (3, 4) of a box. A value lower by a few roundings
    is not enough."""
    given = problems[2]
    ball = replace(given, uncertainty=ParameterBall(center=[0.0, 0.0], radius=6.0))
    box = replace(given, uncertainty=ParameterBox(lower=[-3.0, -4.0], upper=[3.0, 4.0]))
    for problem, M_0 in ((ball, 6.0), (box, 5.0), (replace(given, uncertainty=None), float(np.hypot(1, 0.5)) * (1 + 1e-15))):
        for value, holds in ((M_0, True), (M_0 * (1 - 4e-15), False)):
            controller = Mrac(gamma=1.0, leakage=SwitchingSigma(sigma=0.1, M_0=value))
            assert (laws.why_no_bound(controller, problem) is None) == holds


def test_a_fixed_sigma_does_break_the_bound(problems):
    """No bound is given because for a small enough theta_tilde(0) the leakage's bias exceeds (9)."""
    problem = problems[2]
    controller = Mrac(gamma=50.0, theta_hat0=problem.plant.theta, leakage=FixedSigma(sigma=1.0))
    plain = certificate(problem, Mrac(gamma=50.0, theta_hat0=problem.plant.theta), BOUNDS).values["error_bound"]
    assert max(simulate(problem, [controller], SIMULATION)["MRAC"].figures["max_abs_e"]) > 10 * plain


def test_the_normalised_schemes_say_what_their_law_guarantees(problems):
    cases = {
        LeastSquares(covariance0=5.0): "converges to zero",
        LeastSquares(covariance0=5.0, leakage=SwitchingSigma(sigma=0.1, M_0=5.0)): "converges to zero",
        LeastSquares(covariance0=5.0, leakage=SwitchingSigma(sigma=0.1, M_0=0.5)): "M_0 = 0.5 does not bound |theta|",
        Gradient(gamma=5.0, leakage=FixedSigma(sigma=0.1)): "x stays bounded if FixedSigma is small enough",
        Gradient(gamma=5.0, dead_zone=DeadZone(g_0=0.1)): "x stays bounded if a dead zone is small enough",
        LeastSquaresForgetting(covariance0=5.0, forgetting=0.1): "persistently exciting",
    }
    for law, words in cases.items():
        controller = NormalizedMrac(law=law)
        certificates = {controller.name: certificate(problems[2], controller)}
        (column,) = table_1(problems[2], [controller], certificates).columns
        assert words in column.cells["tracking"].text


def test_the_adapting_loop_with_a_matrix_gain(problems):
    """The margin by the reduced loop agrees with the full Jacobian's Nyquist curve, because theta_hat moves along Gamma x
    only."""
    import casadi as ca

    from barbalat.certificates.linear_loops.ideal import equilibrium
    from barbalat.loop.packing import column, flatten, symbols

    problem = replace(problems[2], uncertainty=None)
    controller = Mrac(gamma=MATRIX)
    loop = ClosedLoop.of(problem, controller)
    reduced = around_equilibrium(problem, controller, 1.0)
    rest, _ = equilibrium(problem, loop, 1.0)
    flat, state = symbols("state", loop.size)
    push, v = symbols("v", 1)
    parts = loop.unpack(state)
    one = np.array(1.0)
    u = loop.equations.control(parts.controller, parts.x, parts.x_m, one)
    rates = loop.equations.derivative(parts.controller, parts.x, parts.x_m, one, u)
    slope = column(np.concatenate([loop.plant.derivative(parts.x, v[0]), loop.model.derivative(parts.x_m, one), flatten(rates)]))
    f = ca.Function(
        "f", [flat, push], [ca.jacobian(slope, flat), ca.jacobian(slope, push), ca.jacobian(column(u.reshape(1)), flat)]
    )
    A, B, C = (np.array(part) for part in f(rest, 0.0))
    for w in (0.3, 1.0, 3.0, 10.0):
        full = -(C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B))[0, 0]
        ours = reduced.C @ np.linalg.solve(1j * w * np.eye(reduced.order) - reduced.A, reduced.B)
        assert ours == pytest.approx(full, rel=1e-9)
    assert margins(reduced).delay > 0


def test_limits_of_a_law_with_a_pull_of_its_own(problems):
    """step_max is compared with runs: below it the memory's term is resolved, and well above it the run has a label."""
    learning = CompositeLearning(gamma_c=6.0, time_constant=0.2, capacity=1.0)
    controller = Mrac(gamma=50.0, learning=learning)
    step_max = certificate(problems[2], controller, ("step_max",)).values["step_max"]
    assert step_max <= 2.79 / (50 * 6)
    assert certificate(problems[2], Mrac(gamma=50.0, leakage=EpsilonModification(nu=1.0))).values.get("step_max") is None
    fine, coarse = (
        simulate(problems[2], [controller], Simulation(t_end=16.0, dt=h))["MRAC"].stiffness for h in (2.0**-8, 2.0**-5)
    )
    assert 2.0**-8 < step_max < 2.0**-5
    assert fine.unstable_from is None and coarse.unstable_from is not None


def test_the_midpoint_law_takes_matrix_gains_and_refuses_what_is_not_proven(problems):
    """V also decreases at every sample with a matrix gain, at gains far beyond the explicit limit. Everything else is
    rejected."""
    problem = problems[2]
    sampled = Sampled(controller=Mrac(gamma=1e6 * MATRIX), sample_time=2.0**-6)
    result = simulate(problem, [sampled], Simulation(t_end=16.0, dt=2.0**-8))["MRAC"]
    assert result.diverged_at is None
    assert all(problem.uncertainty.contains(theta_hat) for theta_hat in result.theta_hat)
    ball = replace(problem, uncertainty=ParameterBall(center=[0.0, 0.0], radius=2.0))

    def bind(controller, problem=problem):
        return Sampled(controller=controller, sample_time=0.1).bind(problem.known)

    bind(Mrac(gamma=2.0), ball)
    assert "scalar gain" in refusal(lambda: bind(Mrac(gamma=MATRIX), ball))
    assert "scalar gain" in refusal(lambda: bind(NormalizedMrac(law=LeastSquares(covariance0=2.0)), ball))
    assert "dead zone" in refusal(lambda: bind(Mrac(gamma=2.0, dead_zone=DeadZone(g_0=0.1))))
    euler = Sampled(
        controller=Mrac(gamma=2.0, learning=CompositeLearning(gamma_c=1.0, time_constant=0.3)),
        sample_time=2.0**-6,
        discretization="euler",
    )
    assert simulate(ball, [euler], Simulation(t_end=4.0, dt=2.0**-8))["MRAC"].diverged_at is None
