"""Lyapunov functions supplied by authors of laws: accepted ones hold numerically, and false ones are rejected."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from barbalat import InputError, Mrac, ParameterBox, Sampled, Simulation, certify, simulate
from barbalat.certificates.certificates import column_of
from barbalat.certificates.summary import five
from barbalat.interfaces import Lyapunov
from barbalat.plants import ParameterBall, PlantInput
from barbalat.regressors import Polynomial, Terms
from barbalat.testing import check
from certificates.lyapunov.own_laws import Own, a_problem, laws

SIMULATION = Simulation(t_end=8.0, dt=1e-3)
RESOLVED = Simulation(t_end=8.0, tolerance=1e-9)
"""Solver of the runs that are compared with bounds. A fixed step may be too long for a fast law, and the run would then violate a
bound that the solution satisfies."""


def certificate(problem, law):
    return certify(problem, [law], SIMULATION)[law.name]


def refused(problem, law):
    """Check that the certificate rejects the bound, and return its entry."""
    found = certificate(problem, law)
    entry = found.entry("error_bound")
    assert entry.value is None or not entry.applies
    assert not found.guaranteed & {"error_bound", "error_bound_worst", "error_limit", "lyapunov_decay"}
    return entry


def why_not(problem, law):
    return refused(problem, law).why


@pytest.mark.parametrize("law", laws.CONTROLLERS, ids=lambda law: law.name)
def test_the_three_laws_have_the_bound_of_the_mrac(law):
    """By hand, |e_i|^2 <= (P^-1)_ii |theta|^2/gamma with initial estimates of zero. The tuner's V(0) is the same, as xi starts at
    zero too."""
    problem = a_problem(np.random.default_rng(3))
    P, theta = problem.known.P, problem.plant.theta
    found = certificate(problem, law)
    largest = np.sqrt(np.linalg.inv(P).diagonal().max() / law.gamma)
    assert found.values["error_bound"] == pytest.approx(largest * np.linalg.norm(theta), rel=1e-9)
    assert found.values["error_bound_worst"] == pytest.approx(largest * np.sqrt(2), rel=1e-9)
    assert found.values["error_limit"] == 0
    assert {"error_bound", "error_bound_worst", "error_bound_command", "estimates_error_bound"} <= found.guaranteed
    of_estimates = np.linalg.norm(theta) * (np.sqrt(2) if law.name == "high-order tuner" else 1)
    assert found.values["estimates_error_bound"] == pytest.approx(of_estimates, rel=1e-9)


@pytest.mark.parametrize("law", laws.CONTROLLERS, ids=lambda law: law.name)
def test_no_run_exceeds_the_bounds(law, sample):
    """Random plants, initial values, commands and theta, some at the corners of the set. 1e-6 of the bound is allowed for the
    solver's error."""
    rng = np.random.default_rng(4)
    for _ in range(sample(2, 25)):
        problem = a_problem(rng, int(rng.integers(1, 4)))
        if rng.random() < 0.5:
            problem = replace(problem, plant=replace(problem.plant, theta=np.sign(problem.plant.theta)))
        chosen = replace(law, gamma=float(10 ** rng.uniform(-1, 1.3)))
        found = certificate(problem, chosen)
        assert "error_bound" in found.guaranteed, found.findings
        result = simulate(problem, [chosen], RESOLVED)[chosen.name]
        assert np.abs(result.e).max() <= found.values["error_bound"] * (1 + 1e-6)
        assert found.values["error_bound"] <= found.values["error_bound_worst"] * (1 + 1e-12)
        off = np.abs(result.theta_hat - problem.plant.theta).max()
        assert off <= found.values["estimates_error_bound"] * (1 + 1e-6)


@pytest.mark.full
@pytest.mark.parametrize("law", laws.CONTROLLERS, ids=lambda law: law.name)
def test_the_three_laws_are_laws(law):
    assert str(check(law))


def test_the_bound_of_a_copy_is_the_mracs():
    """The bound equals ``error_bound_command`` of the built-in scheme, which also bounds each component."""
    problem = a_problem(np.random.default_rng(5), 3)
    built_in = certify(problem, [Mrac(gamma=4.0)], SIMULATION)["MRAC"].values["error_bound_command"]
    assert certificate(problem, Own(projects=True)).values["error_bound_command"] == pytest.approx(built_in, rel=1e-9)


@pytest.mark.parametrize(
    ("law", "reason"),
    [
        (Own(sign=-1.0), "false: V' \\+ W"),
        (Own(share=2.0), "false: V' \\+ W"),
        (Own(sigma=0.1), "false: V' \\+ W"),
        (Own(claimed=1.1), "false: V' \\+ W"),
        (Own(claimed=-1.0), "W is not shown to be nonnegative everywhere"),
        (Own(share=-1.0), "V is not positive definite"),
        (Own(regressor="x_m"), "not shown|false"),
    ],
    ids=["sign", "metric", "leakage", "decay", "negative W", "negative V", "no set"],
)
def test_a_false_V_is_refused(law, reason):
    entry = refused(a_problem(np.random.default_rng(6), projected=law.projects), law)
    assert re.search(reason, entry.why)
    assert entry.theorem


def test_the_author_of_a_refused_V_is_not_told_that_there_is_none():
    """The certificate once said of a law with a V that it lacks a Lyapunov function."""
    problem, law = a_problem(np.random.default_rng(6)), Own(sign=-1.0)
    found = certificate(problem, law)
    line = five(column_of(problem, law, found), found, None)[1]
    assert "the V of the law is not accepted: V' <= -W is false" in line.text
    assert line.text.endswith("What is missing: another V of this law, for which V' <= -W can be shown")
    document = json.dumps(found.entry("error_bound").as_json())
    assert "the package has none" not in document and "a Lyapunov function" not in document


def test_a_projection_in_another_metric_than_Vs_is_refused():
    """A projection onto a box needs no metric with a diagonal gain. A projection onto a ball does, and the law does not pass
    one."""
    law, problem = Own(diagonal=True, projects=True), a_problem(np.random.default_rng(6))
    assert "error_bound" in certificate(problem, law).guaranteed
    ball = replace(problem, uncertainty=ParameterBall(center=[0.0, 0.0], radius=1.5))
    assert "the projection is not shown to lower V" in why_not(ball, law)


def test_a_V_that_needs_the_known_set():
    """With e' = (A_m + b theta')e - b theta_tilde'x_m, P(A_m + b theta') + (A_m + b theta')'P < 0 holds at the corners but not
    outside."""
    rng, law = np.random.default_rng(7), Own(regressor="x_m", projects=True, claimed=0.0)
    small, accepted = a_problem(rng, size=0.3), 0
    P, A_m, b = small.known.P, small.plant.A_m, small.plant.b
    for size in (0.02, 0.1, 0.3, 1.0, 3.0):
        corners = [np.array([s, t]) * size for s in (-1, 1) for t in (-1, 1)]
        forms = [P @ (A_m + np.outer(b, c)) for c in corners]
        holds = max(np.linalg.eigvalsh(form + form.T).max() for form in forms) < 0
        known = ParameterBox(lower=[-size] * 2, upper=[size] * 2)
        problem = replace(small, plant=replace(small.plant, theta=[size / 2] * 2), uncertainty=known)
        found = certificate(problem, law)
        assert ("error_bound" in found.guaranteed) == holds
        accepted += holds
        if holds:
            assert any("theta" in one and "known set" in one for one in found.assumptions)
            result = simulate(problem, [law], RESOLVED)["own"]
            assert np.abs(result.e).max() <= found.values["error_bound"]
    assert 0 < accepted < 5


class Untuned(laws.HighOrderTunerEquations):
    """The tuner without normalisation: mu = 0."""

    def derivative(self, state, x, x_m, r, u):
        full = super().derivative(state, x, x_m, r, u)
        return full._replace(theta_hat=self.beta * (state.ahead - state.theta_hat))


class LateFilter(laws.CompositeEquations):
    """The filter starts at zero, whatever x(0)."""

    def initial(self):
        return super().initial()._replace(zeta=np.zeros(1)[0])


class OtherFilter(laws.CompositeEquations):
    """phi_f is filtered with a different time constant from z."""

    def filters(self, state, x, u):
        zeta, phi_f = super().filters(state, x, u)
        return zeta, 2 * phi_f


class Unlearning(laws.ConcurrentEquations):
    """The recorded data count negatively, although Q = R theta still holds."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        R, Q = found.R + self.forgetting * state.R, found.Q + self.forgetting * state.Q
        return found._replace(R=-R, Q=-Q)


class Escaping(laws.CompositeEquations):
    """A part of the state that V does not contain diverges."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        return found._replace(phi_f=found.phi_f + state.phi_f**2)

    def lyapunov(self, state, x, x_m, theta):
        e, off = x - x_m, state.theta_hat - theta
        return Lyapunov(V=e @ self.known.P @ e + off @ off / self.gamma)


class TrackingOnly(laws.CompositeEquations):
    """Composite adaptation without the prediction error, and a zeta that diverges at once."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        rate = self.gamma * self.known.matched.phi(x) * ((x - x_m) @ self.known.P @ self.known.b)
        return found._replace(theta_hat=rate, zeta=1 + state.zeta * state.zeta)

    limit = laws.HighOrderTunerEquations.limit

    def lyapunov(self, state, x, x_m, theta):
        e, off = x - x_m, state.theta_hat - theta
        return Lyapunov(V=e @ self.known.P @ e + off @ off / self.gamma)


class OnlyLimited(laws.CompositeEquations):
    """The estimates are clipped to the set without projecting their rate."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        return found._replace(theta_hat=self.gamma * self.known.matched.phi(x) * ((x - x_m) @ self.known.P @ self.known.b))

    def lyapunov(self, state, x, x_m, theta):
        return replace(super().lyapunov(state, x, x_m, theta), W=0.0)


class AlongTheProjection(laws.CompositeEquations):
    """A part of the state that V does not contain grows with the projected rate, of which V bounds only the integral."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        rate = self.gamma * self.known.matched.phi(x) * ((x - x_m) @ self.known.P @ self.known.b)
        rate = self.estimate_set.project(rate, state.theta_hat)
        return found._replace(theta_hat=rate, zeta=state.zeta * rate[0])

    def lyapunov(self, state, x, x_m, theta):
        return replace(super().lyapunov(state, x, x_m, theta), W=0.0, zero=())


class Branching(laws.HighOrderTunerEquations):
    """The law behaves differently on numbers and on symbols."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        return found if isinstance(x, np.ndarray) and x.dtype.kind == "O" else found._replace(ahead=-found.ahead)


class Saturating(laws.HighOrderTunerEquations):
    """A saturated error that drives the adaptation."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        return found._replace(ahead=np.tanh(found.ahead))


class Clipping(laws.HighOrderTunerEquations):
    """A limit on the error that drives the adaptation."""

    def derivative(self, state, x, x_m, r, u):
        found = super().derivative(state, x, x_m, r, u)
        return found._replace(ahead=np.minimum(found.ahead, 1))


@pytest.mark.parametrize(
    ("law", "equations", "reason"),
    [
        (laws.HighOrderTuner(), Untuned, "V' <= -W is false"),
        (laws.CompositeAdaptation(), LateFilter, "not zero at t = 0"),
        (laws.CompositeAdaptation(), OtherFilter, "its rate is not zero"),
        (laws.ConcurrentLearning(), Unlearning, "not shown to remain so"),
        (laws.CompositeAdaptation(), Escaping, "not shown|false|finite time"),
        (laws.CompositeAdaptation(), TrackingOnly, "finite time"),
        (laws.CompositeAdaptation(), AlongTheProjection, "finite time"),
        (laws.CompositeAdaptation(), OnlyLimited, "without a projection of their rates"),
        (laws.HighOrderTuner(), Branching, "evaluated on numbers, its code differs"),
        (laws.HighOrderTuner(), Saturating, r"V' <= -W is not shown: its functions \(tanh\) count"),
        (laws.HighOrderTuner(), Clipping, "minimum"),
    ],
    ids=lambda part: part.__name__ if isinstance(part, type) else "",
)
def test_a_law_that_misses_its_V_is_refused(law, equations, reason):
    problem = a_problem(np.random.default_rng(8))

    class Wrong(type(law)):
        def bind(self, known):
            right = super().bind(known)
            return equations(**vars(right))

    assert re.search(reason, why_not(problem, Wrong(name=law.name)))


def test_what_the_case_breaks_voids_the_bounds():
    problem = a_problem(np.random.default_rng(9))
    law = laws.CompositeAdaptation()
    late = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.1)))
    assert "delay" in why_not(late, law)
    outside = replace(problem, plant=replace(problem.plant, theta=[3.0, 0.0]))
    assert "theta outside" in why_not(outside, law)


@pytest.mark.parametrize(
    "regressor", [Polynomial(degree=2), Terms(terms=("x1", "sin(x2)", "x1*exp(-x2)"))], ids=["powers", "terms"]
)
@pytest.mark.dear
def test_other_regressors(regressor):
    problem = a_problem(np.random.default_rng(10), projected=False)
    p = regressor.size(2)
    problem = replace(problem, plant=replace(problem.plant, theta=np.full(p, 0.2), regressor=regressor), uncertainty=None)
    for law in (laws.CompositeAdaptation(), laws.HighOrderTuner(), Own()):
        found = certificate(problem, law)
        assert "error_bound" in found.guaranteed, (law.name, found.findings)
    dividing = replace(problem, plant=replace(problem.plant, regressor=Terms(terms=tuple(["1/x1"] * p))))
    assert "denominator" in why_not(dividing, Own())


def test_a_ball_is_bounded_by_the_box_around_it():
    problem = a_problem(np.random.default_rng(11))
    ball = replace(problem, uncertainty=ParameterBall(center=[0.0, 0.0], radius=1.5))
    found = certificate(ball, laws.CompositeAdaptation())
    assert found.values["error_bound_worst"] >= np.sqrt(np.linalg.inv(ball.known.P).diagonal().max() / 10) * 1.5


def test_accepted_is_true_on_numbers(sample):
    """For laws with random factors on random plants, if V' <= -W is accepted, V does not grow at any step of a run.

    The tolerance is 1e-7 of V(0), far above the solver's error over a step.
    """
    rng, accepted = np.random.default_rng(12), 0
    for _ in range(sample(8, 40)):
        problem = a_problem(rng, projected=rng.random() < 0.5)
        law = Own(
            gamma=float(rng.uniform(1, 9)), sign=rng.choice([1.0, 1.0, 0.9]), share=rng.choice([1.0, 1.0, 1.1]),
            claimed=0.0, regressor=rng.choice(["x", "x_m"]), projects=problem.uncertainty is not None,
        )  # fmt: skip
        if "error_bound" not in certificate(problem, law).guaranteed:
            continue
        accepted += 1
        result = simulate(problem, [law], RESOLVED)["own"]
        e, off = result.e, result.theta_hat - problem.plant.theta
        V = np.einsum("ki,ij,kj->k", e, problem.known.P, e) + (off**2).sum(axis=1) / law.gamma * law.share
        assert np.diff(V).max() <= 1e-7 * V[0]
    assert accepted


def test_plants_that_it_is_not_for_say_so():
    problem = a_problem(np.random.default_rng(13))
    unknown_gain = replace(problem, input_gain=(0.5, 2.0))
    with pytest.raises(InputError):
        certificate(unknown_gain, laws.CompositeAdaptation())


def test_a_sampled_law_has_no_such_bound():
    problem = a_problem(np.random.default_rng(14))
    sampled = Sampled(controller=laws.CompositeAdaptation(), sample_time=0.01, discretization="euler")
    found = certify(problem, [sampled], SIMULATION)[sampled.name]
    assert not found.guaranteed & {
        "error_bound",
        "error_bound_worst",
        "error_bound_command",
        "estimates_error_bound",
        "error_limit",
    }
