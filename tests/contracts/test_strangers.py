"""Classes from outside the package: they run, and what can't be known of them is said."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
import pytest

from barbalat.adaptation.laws import LAWS, Gradient
from barbalat.certificates.bounds.laws import guarantee_of, kept_from_zero
from barbalat.certificates.certify import certify
from barbalat.certificates.table_1 import table_1
from barbalat.controllers import NormalizedMrac, RobustMrac, Sampled
from barbalat.run.check_numerics import check_numerics
from barbalat.run.simulate import simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=2.0, dt=1e-3)


@dataclass(frozen=True)
class Strange:
    """The gradient law, without what is known of it."""

    gamma: float

    def initial(self, n):
        return ()

    def rates(self, theta_hat, memory, estimation, known_set):
        return Gradient(gamma=self.gamma).rates(theta_hat, memory, estimation, known_set)

    def limit(self, memory):
        return memory


@dataclass(frozen=True)
class Plain:
    """u = -theta_hat'x + k_0 r with theta_hat' = gamma x (e'P b), by hand: no settings of the package's."""

    gamma: float
    name: str = "plain"

    def bind(self, known):
        return PlainEquations(self.gamma, known.P @ known.b, known.k_0, known.n)


class PlainState(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class PlainEquations:
    gamma: float
    P_b: np.ndarray
    k_0: float
    n: int

    def initial(self):
        return PlainState(np.zeros(self.n))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        return state._replace(theta_hat=self.gamma * ((x - x_m) @ self.P_b) * x)

    def limit(self, state):
        return state


@pytest.mark.parametrize("scheme", [NormalizedMrac, lambda law: RobustMrac(tau=0.2, law=law)])
def test_a_law_from_outside_runs_as_the_law_that_it_copies(problems, scheme):
    """The same lines: to the last bit, continuous and sampled by Euler steps."""
    for make in (lambda c: c, lambda c: Sampled(controller=c, sample_time=5e-3, discretization="euler")):
        runs = [simulate(problems[2], [make(scheme(law=law))], SIMULATION) for law in (Strange(7.0), Gradient(gamma=7.0))]
        found, expected = (next(iter(run.values())) for run in runs)
        np.testing.assert_array_equal(found.states, expected.states)


def test_nothing_is_claimed_of_a_law_from_outside(problems):
    controller = NormalizedMrac(law=Strange(7.0))
    found = certify(problems[2], [controller], SIMULATION)[controller.name]
    assert "step_max" not in found.values and "gamma_max" not in found.values
    for scheme in (controller, RobustMrac(tau=0.2, law=Strange(7.0))):
        (column,) = table_1(problems[2], [scheme], certify(problems[2], [scheme], SIMULATION)).columns
        for key in ("stability", "tracking", "transient", "estimates", "modelling_error"):
            assert not column.cells[key].applies, key
        assert "no guarantee of Strange is known" in column.cells["stability"].why
    sampled = Sampled(controller=controller, sample_time=5e-3)
    message = refusal(lambda: simulate(problems[2], [sampled], SIMULATION))
    assert "sampled_step" in message and "Strange" in message and "'euler'" in message


def test_a_scheme_from_outside(problems):
    """It runs, continuous and sampled; the midpoint form is its own to know."""
    plain = Plain(5.0)
    run = simulate(problems[2], [plain], SIMULATION)["plain"]
    assert np.isfinite(run.states).all() and run.adapting.on_bounds is None and run.adapting.excitation is None
    euler = Sampled(controller=plain, sample_time=5e-3, discretization="euler")
    results = simulate(problems[2], [euler], SIMULATION)
    assert results["plain"].stiffness.radius_max is not None
    assert check_numerics(results).keys() == results.keys()
    assert "midpoint" in refusal(lambda: simulate(problems[2], [replace(euler, discretization="midpoint")], SIMULATION))


def test_what_is_no_law():
    assert "initial, rates and limit" in refusal(lambda: NormalizedMrac(law=3.0))


@pytest.mark.parametrize("name", LAWS)
def test_every_registered_law_knows_what_it_guarantees(name):
    """In words: bounded and to zero without a set and without modifications, but for unbounded forgetting."""
    settings = {"gamma": 2.0, "covariance0": 2.0, "forgetting": 0.3, "covariance_bound": 9.0, "rho_0": 20.0, "rho_1": 0.5}
    law = LAWS[name](**{field.name: settings[field.name] for field in fields(LAWS[name]) if field.name in settings})
    found = guarantee_of(law, None)
    assert found.bounded == found.error_to_zero == (name != "least-squares-forgetting")
    assert ("nothing is guaranteed" in kept_from_zero(found)) == (not found.bounded)
