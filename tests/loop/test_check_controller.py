"""User-defined controllers are checked before they run: a fault is reported in one sentence, and correct controllers pass."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
import pytest

from barbalat import LinearFeedback, Mrac, Plant, Problem, TransferFunction
from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.controllers import RobustMrac, Sampled
from barbalat.interfaces import check_controller
from barbalat.loop import binding
from barbalat.loop.binding import bound, is_sampled
from barbalat.loop.structure import comes_from_outside
from barbalat.regressors import Terms
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.studies import delay_margins
from barbalat.validate import InputError
from foreign import WRONG, Bare, Plain, PlainEquations, Proportional, wrong
from independent import example_controllers, refusal

SIMULATION = Simulation(t_end=0.5, dt=1e-2)


def test_of_several_the_one_that_does_not_fit_is_named():
    """The named controller can't run, so there is nothing to certify. This is an error and not a finding."""
    squared = Plant(A_m=[[-1.0]], b=[1.0], theta=[0.5], regressor=Terms(terms=("x1**2",)))
    given, linear = Problem(plant=squared), LinearFeedback(controller=TransferFunction([1.0], [1.0, 0.0]), name="old PI")
    for use in (simulate, certify, delay_margins):
        message = refusal(lambda use=use: use(given, [Mrac(gamma=1.0), linear], SIMULATION))
        assert message == (
            "controller 'old PI': linear supports only the regressor phi(x) = x; all schemes but linear support others"
        )


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(problems, name):
    """The sentence is the same wherever the controller is used, with its class and name, the equation and a remedy."""
    controller, equation, remedy = WRONG[name]
    for use in (
        lambda: check_controller(controller, problems[2]),
        lambda: simulate(problems[2], [controller], SIMULATION),
        lambda: certify(problems[2], [controller], SIMULATION),
        lambda: simulate(problems[2], [Sampled(controller=controller, sample_time=0.1, discretization="euler")], SIMULATION),
    ):
        message = refusal(use)
        assert "Wrong 'wrong'" in message or "Sampled 'wrong'" in message
        assert f"WrongEquations.{equation}" in message
        assert remedy in message


def test_the_line_is_named(problems):
    """The line is named as in the interpreter's traceback, which remains available as the error's cause."""
    with pytest.raises(InputError, match=r"line \d+ of foreign.py \(if x\[0\] > 0:\)") as caught:
        check_controller(WRONG["if"][0], problems[2])
    assert isinstance(caught.value.__cause__, RuntimeError)


@pytest.mark.parametrize("make", [lambda: Plain(2.0), lambda: Bare(2.0), lambda: Proportional([1.0, 2.0])])
def test_what_is_right_passes_and_keeps_its_bits(problems, monkeypatch, make):
    check_controller(make(), problems[2])
    checked = simulate(problems[2], [make()], SIMULATION)
    monkeypatch.setattr(binding, "check_equations", lambda *_: None)
    monkeypatch.setattr(binding, "_checked", set())
    for name, result in simulate(problems[2], [make()], SIMULATION).items():
        np.testing.assert_array_equal(result.states, checked[name].states)


def test_a_plain_number_is_a_control(problems):
    """u = 0 is a plain number."""
    nothing = wrong(control=lambda self, s, x, x_m, r: 0.0)
    check_controller(nothing, problems[2])
    assert not simulate(problems[2], [nothing], SIMULATION)["wrong"].u.any()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_every_scheme_of_the_package_passes(problems, n):
    """Runs skip the check for these controllers, so it is made here, continuous and sampled."""
    for examples in example_controllers(n).values():
        for controller in examples:
            wrapped = [Sampled(controller=controller, sample_time=0.1, discretization=d) for d in ("euler", "midpoint")]
            forms = [controller, *([] if is_sampled(bound(problems[n], controller)) else wrapped)]
            for form in forms:
                try:
                    equations = bound(problems[n], form)
                except InputError:  # no midpoint form
                    assert form is forms[2]
                    continue
                assert not comes_from_outside(equations) and not comes_from_outside(form)
                check_controller(form, problems[n])


def test_every_controller_of_a_bundled_case_passes():
    """Some have output feedback, several inputs, learning or modifications."""
    for name in bundled():
        case = load_case(name)
        for controller in case.controllers:
            check_controller(controller, case.problem)


def test_once_for_a_structure(problems, monkeypatch):
    """The check is repeated only for other shapes and options, not for each member of an ensemble."""
    made = []
    monkeypatch.setattr(binding, "_checked", set())
    monkeypatch.setattr(binding, "check_equations", lambda equations, *_: made.append(equations))
    simulate_ensemble([(problems[2], Plain(0.1 * k)) for k in range(1, 30)], SIMULATION)
    assert len(made) == 1
    bound(problems[3], Plain(1.0))
    assert len(made) == 2

    class Optional(Bare):
        slow = False

        def bind(self, known):
            equations = super().bind(known)
            equations.slow = self.slow
            return equations

    for expected in (3, 3, 4, 4):
        controller = Optional(1.0)
        controller.slow = expected > 3
        bound(problems[2], controller)
        assert len(made) == expected


@dataclass(frozen=True, eq=False)
class Rooted(PlainEquations):
    def derivative(self, state, x, x_m, r, u):
        return state._replace(theta_hat=math.sqrt(self.gamma) * ((x - x_m) @ self.P_b) * x)


@dataclass(frozen=True)
class RootedLaw(Plain):
    def bind(self, known):
        return Rooted(self.gamma, known.P @ known.b, known.k_0, known.n)


def test_settings_that_vary_are_symbols_in_an_ensemble(problems):
    """A function of math may be applied to a setting that is one number. If the setting varies, the result would be NaN."""
    simulate(problems[2], [RootedLaw(4.0)], SIMULATION)
    message = refusal(lambda: simulate_ensemble([(problems[2], RootedLaw(g)) for g in (1.0, 4.0)], SIMULATION))
    assert "Rooted.derivative" in message and "NumPy" in message


@dataclass(frozen=True)
class StrangeLaw:
    """A faulty law in a scheme of the package."""

    def initial(self, n):
        return ()

    def rates(self, theta_hat, memory, estimation, known_set):
        return np.array([float(value) for value in theta_hat]), ()

    def limit(self, memory):
        return memory


def test_a_law_from_outside_inside_a_scheme_of_the_package(problems):
    assert "derivative" in refusal(lambda: simulate(problems[2], [RobustMrac(tau=0.2, law=StrangeLaw())], SIMULATION))


class UnstoredChunks(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True)
class OwnSampling:
    """A controller that is sampled by its own equations."""

    wrong: bool = False
    sample_time: float = 0.1
    name: str = "sampling"

    def bind(self, known):
        return self

    def initial(self):
        return UnstoredChunks(np.zeros(1))

    def control(self, state, x, x_m, r):
        return r - state.theta_hat[0]

    def advance(self, state, before, u, now):
        return UnstoredChunks(np.zeros(2)) if self.wrong else UnstoredChunks(0.5 * state.theta_hat + before.x[:1] * u - now.r)


def test_a_controller_that_samples_by_itself(problems):
    check_controller(OwnSampling(), problems[2])
    message = refusal(lambda: simulate(problems[2], [OwnSampling(wrong=True)], SIMULATION))
    assert "OwnSampling.advance" in message and "(2,)" in message


class Nothing:
    name = "nothing"
    bind: ClassVar = lambda self, known: 3.0


class Failing:
    name = "failing"

    def bind(self, known):
        return known.there_is_no_such_thing


def test_what_bind_returns(problems):
    message = refusal(lambda: check_controller(Nothing(), problems[2]))
    assert "Nothing 'nothing'" in message and "initial, control, derivative, limit" in message
    message = refusal(lambda: simulate(problems[2], [Failing()], SIMULATION))
    assert "Failing 'failing': bind fails in line" in message and "there_is_no_such_thing" in message
    partial = type("Partial", (Plain,), {"bind": lambda self, known: type("Half", (), {"initial": None, "control": None})()})(1.0)
    assert "a Half without derivative, limit" in refusal(lambda: check_controller(partial, problems[2]))


def test_what_is_no_controller(problems):
    for use in (
        lambda controller: check_controller(controller, problems[2]),
        lambda controller: certify(problems[2], [controller], SIMULATION),
        lambda controller: simulate(problems[2], [controller], SIMULATION),
    ):
        for controller in (3.0, Plain, None):
            assert "must have a name and a method bind" in refusal(lambda use=use, c=controller: use(c))
        assert "the name of a Plain" in refusal(lambda use=use: use(replace(Plain(1.0), name=7)))
    assert "problem must be" in refusal(lambda: check_controller(Plain(1.0), "problem"))
