"""The checker for users' own controllers and laws: correct ones pass, and each kind of fault is found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from barbalat import L1Output, L1PiecewiseConstant, Mrac, TransferFunction, input_filter, simulate
from barbalat.export import compiler
from barbalat.laws import Gradient, LeastSquares
from barbalat.problem.known_set import ParameterBox
from barbalat.solvers.simulation import Simulation
from barbalat.testing import CheckFailed, check, problem_kinds
from foreign import Bare, Plain, PlainEquations, PlainState, Proportional, wrong
from independent import example_controllers, example_output_controllers, refusal
from strangers import CONTROLLERS, LayeredEquations, TwoLayers
from turns import drawn


@pytest.fixture
def one(problems):
    return {"one": replace(problems[2], uncertainty=ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]))}


def test_a_law_that_is_right(one):
    """There is one sentence for each check, including the comparisons with SciPy and the compiled C."""
    text = str(check(Plain(5.0), one))
    assert text.startswith("plain: nothing is wrong\n")
    for words in ("on numbers and on symbols", "agrees with SciPy's integration", "equal single runs", "keeps theta_hat"):
        assert words in text
    assert "exported C" in text


@pytest.mark.full
@pytest.mark.parametrize("law", [*CONTROLLERS, Bare(5.0), Proportional([1.0, 1.0])], ids=lambda law: law.name)
def test_strangers_pass(one, law):
    check(law, one)


@pytest.mark.full
@pytest.mark.parametrize("law", [Gradient(gamma=5.0), LeastSquares(50.0)], ids=lambda law: type(law).__name__)
def test_an_adaptive_law_is_checked_within_a_scheme(law):
    found = check(law)
    assert found.name == type(law).__name__ and "keeps theta_hat" in str(found)


OUTPUT = {f"{name} on y": made for name, made in example_output_controllers(2).items() if name != "l1-output"}
OWN = example_controllers(2) | OUTPUT
TURN = drawn(list(OWN), 5)
"""The names that CI checks this time."""


@pytest.mark.full
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.bulk] * (name not in TURN)) for name in OWN])
def test_the_package_s_own_schemes_pass(name):
    check(OWN[name][0])


def test_a_controller_sampled_by_nature_is_compared_sample_by_sample(one):
    """The controller's sample time need not be a multiple of the checker's steps."""
    controller = L1PiecewiseConstant(sample_time=2.0**-6, filter=input_filter(0.05))
    assert "SciPy's integration" in str(check(controller, one))


def test_the_kinds_of_problems_do_what_they_are_there_for():
    """In the tight set the projection acts, and the actuator's limits are reached."""
    kinds = problem_kinds()
    mrac = Mrac(gamma=10.0)
    tight = simulate(kinds["a tight known set"], [mrac], Simulation(2.0, 2e-3))["MRAC"]
    assert (tight.adapting.on_bounds.least > 0.01).all()
    limited = simulate(kinds["limits of the input"], [mrac], Simulation(2.0, 2e-3))["MRAC"]
    assert np.abs(limited.u).max() > 0.8
    assert {"several inputs", "an unknown input gain", "a delay"} <= set(kinds)


def test_what_is_refused_is_told_and_everything_refused_is_wrong():
    given = L1Output(m=7.0, gamma=10.0, filter=TransferFunction([1.0], [1.0, 1.0]))
    with pytest.raises(CheckFailed, match=r"none of the problems can be used\n.*one output: it is rejected .*m/\(s \+ m\)"):
        check(given)


def test_without_a_compiler_the_export_is_said_to_be_left_out(one, monkeypatch):
    monkeypatch.setattr(compiler.shutil, "which", lambda _: None)
    assert "one: the exported C was not compared: " in str(check(Plain(5.0), one))


@dataclass(frozen=True, eq=False)
class Unfreezing(LayeredEquations):
    """A sampled controller that ignores a freeze."""

    sample_time: float = 0.02

    def advance(self, state, before, u, now):
        rates = self.derivative(state, *before, u)
        return type(state)(*(old + self.sample_time * rate for old, rate in zip(state, rates, strict=True)))

    def freezing(self, frozen):
        return self


def test_a_freeze_that_does_not_keep_what_is_learnt(one):
    class Law(TwoLayers):
        def bind(self, known):
            return Unfreezing(**vars(super().bind(known)))

    with pytest.raises(CheckFailed, match="a freeze does not keep k_hat, which is estimates"):
        check(Law(), one)


def test_all_that_is_wrong_is_listed(one):
    """One error lists all problems. A state that limit moves at every stage does not follow a differential equation."""
    drifting = wrong(limit=lambda self, s: PlainState(s.theta_hat + 1e-3))
    with pytest.raises(CheckFailed) as caught:
        check(drifting, one | {"two": one["one"]})
    for kind in ("one", "two"):
        assert f"{kind}: after 2 s its run differs by" in str(caught.value)


def test_what_can_t_be_traced_is_not_run(one):
    branching = wrong(control=lambda self, s, x, x_m, r: max(x[0], 0.0))
    with pytest.raises(CheckFailed, match=r"one: .*np.maximum") as caught:
        check(branching, one)
    assert "SciPy" not in str(caught.value)


def test_a_memory_outside_the_state(one):
    """Equations of one structure are checked once, so a memory outside the state would differ between members of an ensemble."""

    @dataclass(frozen=True)
    class Counting(Plain):
        def bind(self, known):
            MADE.append(known)
            return PlainEquations(self.gamma * len(MADE), known.P @ known.b, known.k_0, known.n)

    MADE: list[object] = []
    with pytest.raises(CheckFailed, match="differs from the same run on its own"):
        check(Counting(1.0, "counting"), one)


def test_what_is_neither_a_controller_nor_a_law():
    assert "check needs a controller" in refusal(lambda: check(3.0))


def test_a_class_that_needs_no_settings_is_made(one):
    assert check(TwoLayers, one).name == "two layers"


def test_a_bind_that_fails_is_wrong_and_no_refusal(one):
    class Law(TwoLayers):
        def bind(self, known):
            raise ZeroDivisionError("none")

    with pytest.raises(CheckFailed, match="one: bind raises ZeroDivisionError: none"):
        check(Law(), one)
