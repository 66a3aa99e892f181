"""Robust MRAC for several inputs: the swapping identity, the scheme for one input as a special case, laws and rejections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    NormalizedMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Sampled,
    certify,
    load_case,
    simulate,
)
from barbalat.adaptation.law import Normalization
from barbalat.certificates.certificates import table_1
from barbalat.controllers import robust_mrac_several as several
from barbalat.laws import (
    DeadZone,
    EpsilonModification,
    FixedSigma,
    Gradient,
    IntegralCost,
    LeastSquares,
    LeastSquaresForgetting,
    SwitchingSigma,
)
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import ParameterBall, PlantInput
from barbalat.signals import Constant, Sines
from barbalat.solvers.simulation import Simulation
from independent import integrate, jacobian_against_differences, refusal, symbols_against_numbers

A_M = np.array([[0.0, 1.0, 0.0], [-2.0, -3.0, 0.5], [0.2, 0.0, -1.5]])
B = np.array([[0.0, 0.0], [1.0, 0.3], [0.0, 1.0]])
THETA = np.array([[1.0, -0.5], [0.4, 0.3], [-0.6, 0.8]])  # (n, m)
FIRST, SECOND = Sines((1.0, 0.7, 0.4), (0.5, 1.3, 2.1)), Sines((0.8, 0.6, 0.5), (0.8, 1.7, 2.9))


def two_inputs(**more):
    given = {
        "plant": Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, -0.2, 0.5]),
        "reference_model": ReferenceModel(k_0=[[2.0, 0.0], [0.5, 1.0]]),
        "reference": (FIRST, SECOND),
    }
    return Problem(**given | more)


LAWS = {
    "gradient": Gradient(gamma=20.0),
    "matrix gain": Gradient(gamma=20.0 * np.eye(6) + 2.0),
    "least squares": LeastSquares(covariance0=50.0),
    "forgetting": LeastSquaresForgetting(covariance0=20.0, forgetting=0.2),
    "integral cost": IntegralCost(gamma=20.0, forgetting=0.5),
    "leaking": Gradient(gamma=20.0, leakage=FixedSigma(sigma=0.1)),
    "dead zone": LeastSquares(covariance0=50.0, dead_zone=DeadZone(g_0=0.01)),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.short(kept=lambda law: law in ("least squares", "matrix gain", "dead zone"))
def test_the_swapping_identity_and_what_the_auxiliary_input_leaves_of_it(law):
    """C_0 e = epsilon m_s^2 + C_0 (sI - A_m)^-1 [Xi theta_hat'] + W_m[u_a] for any law, also with projection, by the law's own
    states.

    With u_a = -Q[a], where a is the sum of the first two terms, C_0 e is a minus a/(tau s + 1), which is integrated with the loop
    here. The tolerance 1e-7 is for the integration's 1e-11 over a stable system with the corners of the projection.
    """
    tau = 0.3
    box = ParameterBox(lower=np.full(6, -0.7), upper=np.full(6, 1.1))
    loop = ClosedLoop.of(two_inputs(uncertainty=box), RobustMrac(tau=tau, law=LAWS[law]))
    equations = loop.equations

    def signals(t):
        return np.array([float(FIRST(np.array(t))), float(SECOND(np.array(t)))])

    def derivative(t, y):
        parts = loop.unpack(y[:-2])
        a = equations.auxiliary_input_argument(parts.controller, parts.x)
        return np.concatenate([loop.derivative(y[:-2], signals(t)), (a - y[-2:]) / tau])

    states = integrate(derivative, np.append(loop.initial(), [0.0, 0.0]), 6.0, np.linspace(0, 6, 13), rtol=1e-10, atol=1e-12)
    for y in states.T:
        parts = loop.unpack(y[:-2])
        a = equations.auxiliary_input_argument(parts.controller, parts.x)
        np.testing.assert_allclose(equations.C_0 @ (parts.x - parts.x_m), a - y[-2:], atol=1e-7)
    assert np.abs(a).max() > 1e-4  # it is not trivially true


def test_with_one_input_it_is_the_scheme_for_one(problems):
    """The two sets of equations, compared on one plant at random states, share only the laws. The tolerance 1e-12 is for
    roundings."""
    problem, random = problems[3], np.random.default_rng(2)
    for law in (Gradient(gamma=20.0), LeastSquares(covariance0=50.0), IntegralCost(gamma=5.0, forgetting=0.4)):
        one = RobustMrac(tau=0.2, law=law, normalization=Normalization(alpha_0=0.5)).bind(problem.known)
        C_0 = one.c_0[None]
        same = several.Equations(
            A_m=one.A_m, B=one.b[:, None], k_0=np.array([[one.k_0]]), matched=problem.known.matched, C_0=C_0,
            Q=several.AuxiliaryFilter.of(C_0, one.A_m, one.b[:, None], 0.2), law=law, normalization=one.normalization,
            theta_hat0=one.theta_hat0, x0=one.x0, estimate_set=None,
        )  # fmt: skip

        class Matrix:
            """Phi(x) of one input as a matrix with one column."""

            def phi(self, x):
                return x[:, None]

        same, one = replace(same, matched=Matrix()), replace(one, estimate_set=None)
        state = one.initial()._replace(
            theta_hat=random.normal(size=3), xi=random.normal(size=3), Xi=random.normal(size=(3, 3)), n_d=np.array(0.7)
        )
        x, u = random.normal(size=3), random.normal(size=1)
        mine, theirs = same.derivative(state, x, x, np.ones(1), u), one.derivative(state, x, x, 1.0, u[0])
        for field in ("theta_hat", "xi", "Xi", "n_d", "swapping"):
            np.testing.assert_allclose(getattr(mine, field), getattr(theirs, field), rtol=1e-12, atol=1e-12)
        for a, b in zip(mine.memory, theirs.memory, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
        w = 1j * np.array([0.1, 1.0, 10.0, 100.0])
        Q = [same.Q.C @ np.linalg.solve(s * np.eye(3) - same.Q.A, same.Q.B) + same.Q.D for s in w]
        np.testing.assert_allclose(np.ravel(Q), one.Q.response(w.imag), rtol=1e-9)


@pytest.mark.parametrize("scheme", ["robust", "normalised"])
@pytest.mark.short(kept=lambda scheme: scheme == "robust")
def test_the_estimates_find_all_parameters(scheme):
    """Six sines excite six parameters, so theta_hat -> theta and e -> 0."""
    law = LeastSquares(covariance0=500.0)
    controller = RobustMrac(tau=0.2, law=law) if scheme == "robust" else NormalizedMrac(law=law)
    (run,) = simulate(two_inputs(), [controller], Simulation(t_end=200.0, dt=5e-3)).values()
    assert run.theta_hat[-1] == pytest.approx(THETA.reshape(-1), abs=2e-2)
    assert max(run.figures["tail_max_abs_e"]) < 2e-2
    assert run.adapting.excitation is not None


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.short(kept=lambda law: law == "integral cost")
def test_symbols_numbers_and_jacobians(law):
    loop = ClosedLoop.of(two_inputs(reference=(Constant(1.0), Constant(0.5))), RobustMrac(tau=0.2, law=LAWS[law]))
    fixed = replace_commands(loop)
    symbols_against_numbers(fixed, size=2.0)
    jacobian_against_differences(fixed)


def replace_commands(loop):
    """The loop under the commands (r, r), because the shared checks accept one signal."""

    class One:
        """The same loop with one signal for both commands."""

        def __getattr__(self, name):
            return getattr(loop, name)

        def derivative(self, state, signals):
            return loop.derivative(state, twice(signals))

        def outputs(self, state, signals):
            return loop.outputs(state, twice(signals))

    return One()


def twice(signals):
    return np.concatenate([signals[:1], signals[:1]])


KNOWN_SETS = {
    "box": ParameterBox(lower=np.full(6, -0.2), upper=np.full(6, 0.2)),
    "ball": ParameterBall(center=np.zeros(6), radius=0.3),
}


@pytest.mark.parametrize("law", ["gradient", "least squares"])
@pytest.mark.parametrize("known_set", KNOWN_SETS)
@pytest.mark.short(kept=lambda known_set, law: law == "gradient")
def test_the_estimates_stay_in_the_set_that_they_want_to_leave(known_set, law):
    problem, simulation = two_inputs(uncertainty=KNOWN_SETS[known_set]), Simulation(t_end=4.0, dt=4e-3)
    runs = [RobustMrac(tau=0.2, law=LAWS[law], projection=on, name=f"projection {on}") for on in (True, False)]
    inside, free = simulate(problem, runs, simulation).values()
    assert all(KNOWN_SETS[known_set].contains(point) for point in inside.theta_hat)
    assert not all(KNOWN_SETS[known_set].contains(point) for point in free.theta_hat)


def test_a_limit_that_the_model_knows_is_not_learnt_from():
    """With sat(u) in the model z = phi'theta stays exact, so epsilon m_s^2 = -phi'theta_tilde. The tolerance 1e-9 is for RK4 at 2
    ms."""
    plant = Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, -0.2, 0.5], input=PlantInput(saturation=[-0.6, 0.6]))
    controller = RobustMrac(tau=0.2, law=LAWS["gradient"], saturated_predictor=True)
    (run,) = simulate(two_inputs(plant=plant), [controller], Simulation(t_end=10.0, dt=2e-3)).values()
    assert np.abs(run.u).max() > 0.7
    for state, x in zip(run.states[::20], run.x[::20], strict=True):
        parts = run.loop.unpack(state).controller
        phi, m_s_squared, epsilon = run.loop.equations.estimation(parts, x)
        np.testing.assert_allclose(epsilon * m_s_squared, -phi.T @ (parts.theta_hat - THETA.reshape(-1)), atol=1e-6)


def test_an_aircraft_beside_the_others():
    """On lateral-aircraft, whose actuators are unknown to the scheme, the scheme follows the model, and Table 1 lists the
    remaining properties."""
    case = load_case("lateral-aircraft")
    controller = RobustMrac(tau=0.5, law=Gradient(gamma=100.0), normalization=Normalization(alpha_0=1.0))
    (run,) = simulate(case.problem, [controller], Simulation(t_end=10.0, dt=5e-3)).values()
    assert run.diverged_at is None
    column = judged(case.problem, controller)
    assert "actuator" in column.cells["stability"].why
    assert column.cells["modelling_error"].why == "not known: Theorem 2 is for one input"
    column = judged(two_inputs(), controller)
    assert column.cells["stability"].kind == column.cells["tracking"].kind == "guaranteed"


def judged(problem, controller):
    found = certify(problem, [controller], Simulation(t_end=1.0, dt=1e-3))
    return table_1(problem, [controller], found).columns[0]


def test_what_does_not_fit_is_refused():
    known = two_inputs().known
    law = LAWS["gradient"]
    assert "c_0" in refusal(lambda: RobustMrac(tau=0.2, law=law, c_0=[1.0, 0.0, 0.0]).bind(known))
    assert "nonsingular" in refusal(lambda: NormalizedMrac(law=law, c_0=[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).bind(known))
    unstable_zero = [[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert "zeros" in refusal(lambda: NormalizedMrac(law=law, c_0=unstable_zero).bind(known))
    leaking = Gradient(gamma=1.0, leakage=EpsilonModification(nu=1.0))
    assert "one input" in refusal(lambda: NormalizedMrac(law=leaking).bind(known))
    NormalizedMrac(law=Gradient(gamma=1.0, leakage=SwitchingSigma(sigma=1.0, M_0=3.0))).bind(known)
    assert "takes the input gain as known" in refusal(
        lambda: NormalizedMrac(law=law).bind(two_inputs(input_gain=(0.5, 2.0)).known)
    )
    assert "law.gamma" in refusal(lambda: NormalizedMrac(law=Gradient(gamma=np.ones(3))).bind(known))
    assert "euler" in refusal(lambda: Sampled(controller=NormalizedMrac(law=law), sample_time=0.01).bind(known))
