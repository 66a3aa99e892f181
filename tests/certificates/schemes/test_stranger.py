"""Certificates of classes from outside the package, compared with loops written by hand and with the loops of the schemes that
they copy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import control
import numpy as np
import pytest

from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops.at_rest import rest_of
from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.controllers import KnownParameters, L1Adaptive, Mrac, Sampled
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Sensor
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from foreign import Plain, PlainState, Proportional

SIMULATION = Simulation(t_end=20.0, dt=1e-3)


def random_problem(rng, n):
    """A random problem with a Hurwitz A_m, a matched theta and a command. Every other problem has a first-order actuator whose
    gain is not 1."""
    A_m = rng.normal(size=(n, n))
    A_m -= (np.linalg.eigvals(A_m).real.max() + rng.uniform(0.5, 2)) * np.eye(n)
    actuator = TransferFunction([40.0], [1.0, 50.0]) if rng.random() < 0.5 else None
    plant = Plant(
        A_m=A_m, b=rng.normal(size=n), theta=rng.normal(size=n), x0=rng.normal(size=n), input=PlantInput(actuator=actuator)
    )
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=1.3), reference=Sine(amplitude=2.0, frequency=1.0))


def test_the_margins_of_a_copy_are_those_of_the_mrac(sample):
    """The loop of the copy is computed by the other method, with the equilibrium for theta and the directions of the estimates by
    Gamma x.

    The tolerance 1e-6 is for eigenvalues and zeros of one loop in two sets of coordinates.
    """
    rng, compared = np.random.default_rng(1), 0
    for _ in range(sample(10, 300)):
        problem = random_problem(rng, int(rng.integers(1, 4)))
        if problem.plant.paths[0].dynamics is not None:  # there MRAC's own linearisation ignores the actuator's gain
            problem = replace(problem, plant=replace(problem.plant, input=PlantInput()))
        gamma = float(10 ** rng.uniform(-1, 2))
        own = certify(problem, [Plain(gamma)], SIMULATION)["plain"].values
        known = certify(problem, [Mrac(gamma=gamma)], SIMULATION)["MRAC"].values
        for key in ("delay_margin", "phase_margin", "gain_margin", "delay_margin_adapting", "sensitivity_peak"):
            assert (key in own) == (key in known)
            if known.get(key) is not None:
                compared += 1
                assert own[key] == pytest.approx(known[key], rel=1e-6)
    assert compared > 10


def test_the_rest_is_one(sample):
    """All rates are zero there, and e is zero if the law has no leakage, also with an actuator with a gain of 0.8."""
    rng = np.random.default_rng(2)
    for _ in range(sample(10, 300)):
        problem = random_problem(rng, int(rng.integers(1, 4)))
        rest = rest_of(problem, ClosedLoop.of(problem, Plain(3.0)), frozen=False)
        assert not isinstance(rest, NotApplicable)
        rates = rest.loop.derivative(rest.state, rest.signals)
        terms = np.abs(np.concatenate([rest.state, rest.signals])).max()
        assert (
            np.abs(rates).max() < 1e-7 * max(1.0, terms) ** 3
        )  # products of three factors: e, x, and a combination of Gamma and P
        e = rest.loop.outputs(rest.state, rest.signals).e
        assert np.abs(e).max() < 1e-6 * terms


def test_the_step_is_where_a_mode_is_amplified(problems):
    """The reference is given by eigenvalues of central differences of the right-hand side, inserted into the method's stability
    polynomial."""
    problem = problems[2]
    found = certify(problem, [Plain(8.0)], SIMULATION)["plain"].values["step_max"]
    rest = rest_of(problem, ClosedLoop.of(problem, Plain(8.0)), frozen=False)
    d = 1e-6
    J = np.array([
        rest.loop.derivative(rest.state + d * unit, rest.signals) - rest.loop.derivative(rest.state - d * unit, rest.signals)
        for unit in np.eye(rest.loop.size)
    ]).T / (2 * d)  # fmt: skip
    modes = np.linalg.eigvals(J)
    modes = modes[np.abs(modes) > 1e-6]  # the direction in which the loop is stationary
    R = SIMULATION.solver.amplification
    assert (np.abs(R(0.98 * found * modes)) < 1).all()
    assert (np.abs(R(1.02 * found * modes)) > 1).any()


def test_a_loop_without_estimates_is_its_linear_loop(problems):
    """u = k_0 r - K x has the loop written by hand."""
    plant, K = problems[2].plant, np.array([1.0, 1.5])
    found = certify(problems[2], [Proportional(K)], SIMULATION)["proportional"]
    hand = margins(StateSpace(plant.A_m + np.outer(plant.b, plant.theta), plant.b, K, 0.0))
    for key, value in (("delay_margin", hand.delay), ("phase_margin", hand.phase), ("gain_margin", hand.gain_up)):
        assert found.values[key] == (pytest.approx(value, rel=1e-9) if np.isfinite(value) else None)
    assert "delay_margin_adapting" not in {entry.key for entry in found.entries}
    (column,) = table_1(problems[2], [Proportional(K)], {"proportional": found}).columns
    assert column.cells["estimates"].text == "it estimates nothing"
    assert column.cells["margins"].kind == "exact"


class OutputGain(Proportional):
    feedback: ClassVar[str] = "output"

    def bind(self, known):
        return self

    def control(self, state, y, y_m, r):
        return self.K[0] * (r - y)


def test_output_feedback():
    """u = K (r - y) has L = K G."""
    G = TransferFunction([4.0], [1.0, 3.0, 3.0, 1.0])
    problem = OutputProblem(
        plant=OutputPlant(transfer_function=G),
        reference_model=OutputReferenceModel(transfer_function=TransferFunction([1.0], [1.0, 1.0])),
        reference=Sine(amplitude=1.0, frequency=1.0),
    )
    found = certify(problem, [OutputGain([1.2])], SIMULATION)["proportional"].values
    hand = margins(TransferFunction([4.8], [1.0, 3.0, 3.0, 1.0]))
    assert found["delay_margin"] == pytest.approx(hand.delay, rel=1e-8)
    assert found["gain_margin"] == pytest.approx(hand.gain_up, rel=1e-8)


def test_nothing_is_claimed_beside_what_was_computed(problems):
    """The certificates of the other controllers do not change."""
    controllers = [Mrac(gamma=2.0), Plain(2.0)]
    found = certify(problems[2], controllers, SIMULATION)
    assert found["MRAC"] == certify(problems[2], controllers[:1], SIMULATION)["MRAC"]
    plain = found["plain"]
    assert not plain.guaranteed
    bound = plain.entry("error_bound")
    assert bound is not None and bound.kind == "does not apply" and bound.why == "no proof is known for this controller"
    column = table_1(problems[2], controllers, found).columns[1]
    assert column.scheme == "Plain"
    for key in ("stability", "tracking", "transient", "estimates", "modelling_error"):
        assert column.cells[key].text == "no proof is known for this controller" and not column.cells[key].applies


def test_sampled_its_linear_loop_is_its_own(problems):
    sampled = Sampled(controller=Plain(2.0), sample_time=0.05, discretization="euler")
    found = certify(problems[2], [sampled], SIMULATION)["plain"]
    assert not found.guaranteed
    assert all("in sampled-data form" in entry.of for entry in found.entries if entry.kind == "exact")
    assert len(table_1(problems[2], [sampled], {"plain": found}).columns) == 1


def test_known_parameters_have_a_certificate_too(problems):
    """The loop is linearised by hand, with theta constant."""
    plant = problems[2].plant
    found = certify(problems[2], [KnownParameters(theta=plant.theta)], SIMULATION)["Known parameters"].values
    hand = margins(StateSpace(plant.A_m + np.outer(plant.b, plant.theta), plant.b, plant.theta, 0.0))
    assert found["gain_margin"] == pytest.approx(hand.gain_up, rel=1e-9)


class Winding(Proportional):
    """An integrator whose input never becomes zero."""

    name = "winding"

    def initial(self):
        return PlainState(np.zeros(1))

    def derivative(self, state, x, x_m, r, u):
        return PlainState(1.0 + 0 * state.theta_hat)


def test_where_nothing_rests_it_is_said(problems):
    found = certify(problems[2], [Winding([1.0, 1.0])], SIMULATION)["winding"]
    for key in ("delay_margin_adapting", "step_max"):
        entry = found.entry(key)
        assert entry is not None and "no equilibrium of the loop was found" in entry.why
    assert (
        found.values["delay_margin"] is None or found.values["delay_margin"] > 0
    )  # with a frozen estimate it has an equilibrium


@pytest.mark.parametrize("controller", [Mrac(gamma=5.0), L1Adaptive(gamma=5.0, filter=input_filter(0.05))])
def test_the_linear_loop_is_that_of_a_scheme_that_is_known(problems, controller):
    """With a predictor and a filter among the states, the whole frequency response agrees."""
    problem = problems[2]
    loop = ClosedLoop.of(problem, controller)
    rest = rest_of(problem, loop, frozen=False)
    w = np.geomspace(1e-2, 1e2, 30)
    other = around_equilibrium(problem, controller, problem.commands[0].bound)
    np.testing.assert_allclose(rest.broken(frozen=False).response(w), other.response(w), rtol=1e-8)


def test_the_margins_of_each_of_several_inputs():
    """u = -Theta'x with actuators, a lag and the loop of the other input closed by hand with python-control. The tolerance 1e-6
    is for the roots of its polynomials."""
    rng, T_a, lag = np.random.default_rng(4), (20.0, 35.0), 0.02
    A_m, b, theta = (
        np.array([[0.0, 1.0, 0.0], [-2.0, -2.0, 0.3], [0.4, 0.0, -1.5]]),
        rng.normal(size=(3, 2)),
        rng.normal(size=(3, 2)),
    )
    plant = Plant(
        A_m=A_m, b=b, theta=theta.reshape(-1), input=[PlantInput(actuator=TransferFunction([w], [1.0, w])) for w in T_a]
    )
    commands = (Sine(amplitude=1.0, frequency=1.0), Sine(amplitude=1.0, frequency=0.7))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=commands, sensor=Sensor(lag=lag))
    law = KnownParameters(theta=(theta + 4 * b).reshape(-1))
    gains = law.theta.reshape(3, 2).T
    A = np.zeros((8, 8))  # x, the sensor, the actuators' outputs
    A[:3, :3], A[:3, 6:], A[3:6, :3], A[3:6, 3:6] = A_m + b @ theta.T, b, np.eye(3) / lag, -np.eye(3) / lag
    A[6:, 3:6], A[6:, 6:] = -np.diag(T_a) @ gains, -np.diag(T_a)
    found = certify(problem, [law], SIMULATION)[law.name].values
    for i in range(2):
        open_one, enters = A.copy(), np.zeros((8, 1))
        enters[:3, 0], open_one[:3, 6 + i] = b[:, i], 0.0
        loop = control.ss(open_one, enters, -np.eye(8)[[6 + i]], 0)
        up, phases, _, _, crossovers, _ = control.stability_margins(loop, returnall=True)
        assert found["gain_margin_each"][i] == pytest.approx(up[up > 1].min(), rel=1e-6)
        lags = np.radians(phases % 360) / crossovers
        assert found["delay_margin_each"][i] == (pytest.approx(lags.min(), rel=1e-6) if len(lags) else None)
    assert any(found["delay_margin_each"])
    assert (
        "delay_margin_each"
        not in certify(replace(problem, plant=replace(plant, input=PlantInput(delay=0.01))), [law], SIMULATION)[law.name].values
    )


class TwoLayers(NamedTuple):
    theta_hat: np.ndarray
    xi: np.ndarray


@dataclass(frozen=True)
class HighOrderTuner:
    """theta_hat follows xi, which follows the gradient. Both are constant wherever xi = theta_hat and theta_hat'x = theta'x."""

    xi_0: float
    name: str = "two layers"

    def bind(self, known):
        return _Bound(self.xi_0, known.P @ known.b, known.k_0)


@dataclass(frozen=True)
class _Bound:
    xi_0: float
    P_b: np.ndarray
    k_0: float

    def initial(self):
        return TwoLayers(np.zeros(len(self.P_b)), np.full(len(self.P_b), self.xi_0))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        speed = 20.0 * (1 + 0.1 * (x @ x))
        return TwoLayers(speed * (state.xi - state.theta_hat), 20.0 * ((x - x_m) @ self.P_b) * x)

    def limit(self, state):
        return state


DRIVE = Problem(
    plant=Plant(A_m=[[0.0, 1.0], [-9.0, -4.2]], b=[0.0, 5.0], theta=[1.8, 0.44]),
    reference_model=ReferenceModel(k_0=1.8),
    reference=Sine(amplitude=1.0, frequency=0.5),
)


def test_a_law_with_two_layers_is_linearised_where_its_estimates_are_right():
    """For any initial value of the second layer, the loop with frozen estimates equals the loop with known parameters."""
    found = [certify(DRIVE, [HighOrderTuner(xi_0)], SIMULATION)["two layers"] for xi_0 in (0.0, 1.0, -5.0, 20.0)]
    adapting = [one.values["delay_margin_adapting"] for one in found]
    assert adapting == pytest.approx([adapting[0]] * 4, rel=1e-9)  # Newton's steps end within 1e-9 of the equilibrium
    assert "theta_hat = theta" in found[0].entry("delay_margin_adapting").of
    plant = DRIVE.plant
    hand = margins(StateSpace(plant.A_m + np.outer(plant.b, plant.theta), plant.b, plant.theta, 0.0))
    assert [one.values["delay_margin"] for one in found] == pytest.approx([hand.delay] * 4, rel=1e-9)


class WithGain(NamedTuple):
    theta_hat: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class GrowingGain(_Bound):
    """A gain that grows while there is an error and can have any value at equilibrium. The linear loop depends on it."""

    name: str = "growing gain"

    def bind(self, known):
        return GrowingGain(self.xi_0, known.P @ known.b, known.k_0)

    def initial(self):
        return WithGain(np.zeros(len(self.P_b)), np.full(1, self.xi_0))

    def derivative(self, state, x, x_m, r, u):
        e = x - x_m
        return WithGain(state.gain[0] * (e @ self.P_b) * x, (e @ e) * np.ones(1))


def test_no_margin_where_another_state_rests_anywhere():
    found = certify(DRIVE, [GrowingGain(1.0, np.zeros(2), 1.0)], SIMULATION)["growing gain"]
    entry = found.entry("delay_margin_adapting")
    assert not entry.applies
    assert "many" in entry.why
    assert "theta_hat = theta" in entry.why
    assert found.entry("delay_margin").kind == "exact"  # with frozen estimates the gain has no effect
