"""Projections of laws with their own V: only the known set's projection, applied as the theorem assumes, supports a bound."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import barbalat_check
from barbalat import ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, certify, simulate
from barbalat.certificates.proof import proof
from barbalat.interfaces import Lyapunov
from barbalat.plants import ParameterBall
from barbalat.problem.known_set import Gain
from barbalat.signals import Square
from certificates.lyapunov.own_laws import Own, State, a_problem, laws

SIMULATION = Simulation(t_end=8.0, dt=1e-3)
COUPLED = np.array([[5.0, -1.5], [-1.5, 0.5]])
OF_V = {"lyapunov_decay", "error_bound", "error_bound_worst", "error_bound_command", "estimates_error_bound", "error_limit"}


@dataclass(frozen=True, eq=False)
class Equations:
    law: Projecting
    known: object

    def initial(self):
        return State(np.full(self.known.parameters, self.law.start))

    def control(self, state, x, x_m, r):
        return self.known.k_0 * r - self.law.used(self.known.estimate_set, state.theta_hat) @ self.known.matched.phi(x)

    def derivative(self, state, x, x_m, r, u):
        rate = ((x - x_m) @ (self.known.P @ self.known.b)) * self.known.matched.phi(x)
        return State(self.law.rate(self.known.estimate_set, rate, state.theta_hat, self.law.gamma))

    def limit(self, state):
        return State(self.law.limit(self.known.estimate_set, state.theta_hat))

    def lyapunov(self, state, x, x_m, theta):
        e, off = x - x_m, state.theta_hat - theta
        metric = np.linalg.inv(
            np.array(self.law.gamma, dtype=float) * np.eye(len(off)) if np.ndim(self.law.gamma) < 2 else COUPLED
        )
        return Lyapunov(V=e @ self.known.P @ e + off @ ((metric + metric.T) / 2).round(9) @ off)


@dataclass(frozen=True)
class Projecting:
    """An MRAC; ``rate``, ``limit`` and ``used`` say what is done with the known set."""

    gamma: object = 4.0
    rate: Callable = lambda known, g, theta_hat, gamma: known.project(gamma * g, theta_hat)
    limit: Callable = lambda known, theta_hat: known.limit(theta_hat)
    used: Callable = lambda known, theta_hat: theta_hat
    start: float = 0.0
    name: str = "projecting"

    def bind(self, known):
        return Equations(self, known)


def corner():
    """The theta of this case is near a corner of the box, and its command drives the estimates into it."""
    plant = Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[-0.0787, 0.1456], x0=[0.0, 0.0])
    known = ParameterBox(lower=[-0.0788, -2.74], upper=[0.0, 2.736])
    command = Square(amplitude=0.4123, frequency=0.2249)
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=4.0), reference=command, uncertainty=known)


def ball():
    plant = Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[0.99, -0.1], x0=[0.0, 0.0])
    known = ParameterBall(center=[0.0, 0.0], radius=1.0)
    return Problem(
        plant=plant, reference_model=ReferenceModel(k_0=4.0), reference=Square(amplitude=0.5, frequency=0.3), uncertainty=known
    )


def certificate(problem, law):
    return certify(problem, [law], SIMULATION)[law.name]


def outside(known, g, theta_hat, gamma):
    return gamma @ known.project(g, theta_hat) if np.ndim(gamma) == 2 else gamma * known.project(g, theta_hat)


def handed(known, g, theta_hat, gamma):
    gain = Gain(gamma)
    return known.project(gain.times(g), theta_hat, gain)


NOT_EXACTLY, NOT_WHOLE = "is not exactly what `project` returns", "something other than a whole array of the state"
MISUSED = {
    "a gain matrix outside": (Projecting(gamma=COUPLED, rate=outside), NOT_EXACTLY),
    "a gain outside": (Projecting(rate=outside), NOT_EXACTLY),
    "a gain outside, no limit": (Projecting(rate=outside, limit=lambda known, t: t), NOT_EXACTLY),
    "an addition": (Projecting(rate=lambda k, g, t, c: k.project(c * g / 2, t) + c * g / 2), NOT_EXACTLY),
    "both signs changed": (Projecting(rate=lambda k, g, t, c: -k.project(-c * g, t)), NOT_EXACTLY),
    "a limit to a fourth": (Projecting(limit=lambda known, t: known.limit(4 * t) / 4), NOT_WHOLE),
    "a projection of twice the estimates": (Projecting(rate=lambda k, g, t, c: k.project(c * g, 2 * t)), NOT_WHOLE),
    "a projection of the shifted estimates": (Projecting(rate=lambda k, g, t, c: k.project(c * g, t - 3.0)), NOT_WHOLE),
    "a projection of the negative estimates": (Projecting(rate=lambda k, g, t, c: k.project(c * g, -t)), NOT_WHOLE),
    "a projection of the reversed estimates": (Projecting(rate=lambda k, g, t, c: k.project(c * g, t[::-1])), NOT_WHOLE),
    "u of limited estimates": (Projecting(used=lambda known, t: known.limit(2 * t) / 2), NOT_WHOLE),
    "a limit that is not used": (Projecting(limit=lambda known, t: (known.limit(t), t)[1]), "evaluated on numbers"),
    "a gain that is not positive": (Projecting(rate=lambda k, g, t, c: k.project(c * g, t, Gain(0.0))), "positive definite"),
    "estimates that start outside": (Projecting(start=-9.0), "do not start in the known set"),
    "a limit without a projection": (Projecting(rate=lambda k, g, t, c: c * g), "without a projection of their rates"),
}


@pytest.mark.parametrize("what", MISUSED)
def test_a_misused_projection_is_refused(what):
    law, reason = MISUSED[what]
    found = certificate(corner(), law)
    assert not found.guaranteed & OF_V
    assert reason in found.entry("error_bound").why


def test_a_diagonal_gain_outside_a_projection_onto_a_ball_is_refused():
    found = certificate(ball(), Projecting(gamma=np.diag([0.25, 64.0]), rate=outside))
    assert NOT_EXACTLY in found.entry("error_bound").why
    assert not found.guaranteed & OF_V


def is_read(value):
    """Whether ``certify`` reads the expression, in exact variables."""
    return isinstance(value, np.ndarray) and value.dtype.kind == "O"


class OnNumbers(Equations):
    """On numbers the limit is another one than on variables."""

    def limit(self, state):
        return state if is_read(state.theta_hat) else State(np.clip(state.theta_hat, -0.5, 0.5))


class OnTheFaces(Equations):
    """On numbers the estimates move outward on the upper faces of the known set."""

    def derivative(self, state, x, x_m, r, u):
        found, upper = super().derivative(state, x, x_m, r, u), self.known.estimate_set.upper
        return found if is_read(state.theta_hat) else State(found.theta_hat + np.where(state.theta_hat >= upper, 1.0, 0.0))


@pytest.mark.parametrize("equations", [OnNumbers, OnTheFaces])
def test_the_code_is_compared_on_the_faces_and_beyond(equations):
    class Other(Projecting):
        def bind(self, known):
            return equations(self, known)

    assert "evaluated on numbers" in certificate(corner(), Other()).entry("error_bound").why


PROPER = {
    "a gain in the rate": (corner, Projecting()),
    "a gain": (corner, Projecting(rate=handed)),
    "a gain matrix": (corner, Projecting(gamma=COUPLED, rate=handed)),
    "no limit": (corner, Projecting(limit=lambda known, t: t)),
    "limited estimates in u": (corner, Projecting(used=lambda known, t: known.limit(t))),
    "a ball": (ball, Projecting()),
    "a ball and a gain": (ball, Projecting(rate=handed)),
}


@pytest.mark.parametrize("what", PROPER)
def test_a_proper_projection_is_accepted_and_its_run_keeps_the_bound(what):
    problem, law = PROPER[what]
    problem = problem()
    found = certificate(problem, law)
    assert OF_V - {"error_limit"} <= found.guaranteed, found.entry("error_bound").why
    result = simulate(problem, [law], Simulation(t_end=20.0, dt=1e-3))[law.name]
    assert np.abs(result.e).max() <= found.values["error_bound"] * (1 + 1e-6)
    barbalat_check.check(document_of(problem, law))


def test_five_bounded_parameters_with_a_gain_matrix_are_refused():
    """The projection is exact for up to four bounded parameters."""
    problem = a_problem(np.random.default_rng(3), 5)
    known = ParameterBox(lower=-np.ones(5), upper=np.ones(5))
    law = Projecting(rate=lambda k, g, t, c: k.project(g, t, Gain(np.eye(5) + 0.5)))
    found = certificate(replace(problem, uncertainty=known), law)
    assert "cuts the corners of the set" in found.entry("error_bound").why


def test_a_sampled_law_has_no_decay_of_V():
    law = Sampled(controller=laws.CompositeAdaptation(), sample_time=0.01, discretization="euler")
    found = certificate(a_problem(np.random.default_rng(14)), law)
    assert not found.guaranteed & OF_V
    assert found.entry("lyapunov_decay").kind == "does not apply"


# --- Files ----------------------------------------------------------------------------------------------------------------------


def document_of(problem, law):
    found = proof("own", problem, [law], SIMULATION, certify(problem, [law], SIMULATION))
    return json.loads(json.dumps(found, allow_nan=False))


def of_law(document):
    (one,) = document["controllers"].values()
    return one["facts"]["law"]


def in_another_rate(law):
    law["control"][0]["above"]["n_1"] = "1"


def a_gain_outside(law):
    """The file of a law whose gain matrix multiplies the result of ``project``."""
    law["normals"][0]["gain"] = [["1", "0"], ["0", "1"]]


def an_indefinite_gain(law):
    law["normals"][0]["gain"] = [["1", "2"], ["2", "1"]]


def without_the_gain(law):
    del law["normals"][0]["gain"]


def reversed_estimates(law):
    law["normals"][0]["of"].reverse()


def twice(law):
    law["rates"]["theta_hat_1"]["above"]["n_1"] = "-2"


def one_limited(law):
    law["limited"] = law["limited"][:1]


FORGED = {
    "a normal in u": (in_another_rate, "add up|a normal may act on projected estimates only"),
    "a gain outside": (a_gain_outside, "n occurs as -gain n only"),
    "an indefinite gain": (an_indefinite_gain, "must be positive definite"),
    "no gain": (without_the_gain, "gain"),
    "other estimates": (reversed_estimates, "n occurs as -gain n only"),
    "a normal twice": (twice, "n occurs as -gain n only"),
    "a part of the estimates limited": (one_limited, "all projected estimates or none"),
}


@pytest.mark.parametrize("what", FORGED)
def test_a_forged_projection_is_refused(what):
    change, reason = FORGED[what]
    document = document_of(corner(), Projecting(gamma=COUPLED, rate=handed))
    change(of_law(document))
    with pytest.raises(barbalat_check.Refused, match=reason):
        barbalat_check.check(document)


def test_a_ball_needs_vs_metric():
    """A diagonal gain that multiplies the result of a projection onto a ball, as a file without that gain states it."""
    document = document_of(ball(), Projecting(gamma=0.25, rate=handed))
    law = of_law(document)
    law["rates"]["theta_hat_2"]["above"] = {
        monomial: str(256 * barbalat_check.number(factor)) for monomial, factor in law["rates"]["theta_hat_2"]["above"].items()
    }
    with pytest.raises(barbalat_check.Refused, match="n occurs as -gain n only"):
        barbalat_check.check(document)


@pytest.mark.parametrize("law", [laws.CompositeAdaptation(), Own(projects=True)], ids=lambda law: law.name)
def test_noise_is_a_premise_that_is_missing(law):
    document = document_of(a_problem(np.random.default_rng(3)), law)
    barbalat_check.check(document)
    document["plant"]["noise"] = "GaussianNoise"
    with pytest.raises(barbalat_check.Refused, match="noise"):
        barbalat_check.check(document)


def test_the_assumptions_name_the_projection():
    assert any("known set" in one for one in barbalat_check.check(document_of(corner(), Projecting()))[1])
