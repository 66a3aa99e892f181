"""What Lemma 1 speaks of along a run of the robust MRAC; its integrals are states of the simulated loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation.law import Estimation
from barbalat.controllers import RobustMrac
from barbalat.controllers.robust_mrac import Equations as RobustEquations
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Value
from barbalat.roles import Role, roles_of
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


class LemmaState(NamedTuple):
    """The scheme's own state, and integrals along the run."""

    scheme: Any
    eta: Value  # of eta^2/m_s^2
    error: Value  # of (epsilon m_s)^2
    epsilon: Value  # of epsilon^2
    rate: Value  # of |theta_hat'|^2

    @property
    def theta_hat(self) -> Value:
        return self.scheme.theta_hat


@dataclass(frozen=True, eq=False)
class LemmaEquations:
    """The robust MRAC's equations, and the integrals of Lemma 1; theta, which no controller knows, enters these alone."""

    scheme: RobustEquations
    theta: Array

    @property
    def roles(self) -> dict[str, Role]:
        return {f"scheme.{path}": role for path, role in roles_of(self.scheme).items()}

    def initial(self) -> LemmaState:
        return LemmaState(self.scheme.initial(), *(np.zeros(()) for _ in range(4)))

    def control(self, state: LemmaState, x: Value, x_m: Value, r: Value) -> Value:
        return self.scheme.control(state.scheme, x, x_m, r)

    def eta(self, state: LemmaState, x: Value) -> Value:
        phi, m_s_squared, epsilon = self.scheme.estimation(state.scheme, x)
        return epsilon * m_s_squared + (state.theta_hat - self.theta) @ phi  # (13): z - theta'phi

    def derivative(self, state: LemmaState, x: Value, x_m: Value, r: Value, u: Value) -> LemmaState:
        rates = self.scheme.derivative(state.scheme, x, x_m, r, u)
        _, m_s_squared, epsilon = self.scheme.estimation(state.scheme, x)
        return LemmaState(
            scheme=rates,
            eta=self.eta(state, x) ** 2 / m_s_squared,
            error=epsilon * epsilon * m_s_squared,
            epsilon=epsilon * epsilon,
            rate=rates.theta_hat @ rates.theta_hat,
        )

    def limit(self, state: LemmaState) -> LemmaState:
        return state._replace(scheme=self.scheme.limit(state.scheme))


@dataclass(frozen=True, eq=False)
class Observed:
    """A robust MRAC with Lemma 1's integrals."""

    scheme: RobustMrac
    theta: Array
    name: str = "observed"

    def bind(self, known: Known) -> LemmaEquations:
        bound = self.scheme.bind(known)
        assert isinstance(bound, RobustEquations)  # Section V has one input
        return LemmaEquations(bound, self.theta)


@dataclass(frozen=True, eq=False)
class Along:
    """What Lemma 1 speaks of, at K instants of a run, (K, ...); the integrals run from 0."""

    t: Array
    epsilon: Array
    error: Array  # epsilon m_s
    rate: Array  # |theta_hat'|
    theta_hat: Array
    eta: Array  # over m_s
    V: Array
    integrals: dict[str, Array]

    def constant(self, name: str) -> float:
        """The least nu with: integral over [t, t + T] <= nu (integral of eta^2/m_s^2 over it + 1), over all pairs of instants."""
        return self._least(name, self.integrals["eta"])

    def constant_of_largest(self, name: str) -> float:
        """The least nu with: integral over [t, t + T] <= nu (mu T + 1), mu the largest eta^2/m_s^2: the paper's definition."""
        return self._least(name, (self.eta**2).max() * self.t)

    def _least(self, name: str, allowed: Array) -> float:
        part = self.integrals[name]
        return max(float(((part[i:] - part[i]) / (allowed[i:] - allowed[i] + 1)).max()) for i in range(len(part)))


def along(problem: Problem, controller: RobustMrac, simulation: Simulation) -> Along:
    """Simulate, and evaluate at the recorded instants."""
    (run,) = simulate(problem, [Observed(controller, problem.plant.theta)], simulation).values()
    equations, loop = controller.bind(problem.known), run.loop
    rows = [loop.unpack(flat) for flat in run.states]
    states = [row.controller for row in rows]
    found = [equations.estimation(state.scheme, row.x) for state, row in zip(states, rows, strict=True)]
    phi, m_s_squared, epsilon = (np.array([getattr(f, name) for f in found]) for name in Estimation._fields)
    covariance, theta_tilde = np.array([s.scheme.memory.covariance for s in states]), run.theta_hat - problem.plant.theta
    pairs = zip((state.scheme for state in states), found, strict=True)
    rates = [equations.law.rates(scheme.theta_hat, scheme.memory, f, equations.estimate_set).theta_hat for scheme, f in pairs]
    m_s = np.sqrt(m_s_squared)
    return Along(
        t=run.t,
        epsilon=epsilon,
        error=epsilon * m_s,
        theta_hat=run.theta_hat,
        rate=np.linalg.norm(rates, axis=1),
        eta=(epsilon * m_s_squared + (theta_tilde * phi).sum(axis=1)) / m_s,
        V=(theta_tilde * np.linalg.solve(covariance, theta_tilde[..., None])[..., 0]).sum(axis=1),
        integrals={name: np.array([getattr(s, name) for s in states]) for name in ("eta", "error", "epsilon", "rate")},
    )
