"""A study's reports, checked at a quarter of its step: false delays, artefacts of the solver, limit cycles at the limits."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from barbalat.certificates.certify import certify
from barbalat.controllers import Adrc, L1Adaptive, Mrac, Sampled
from barbalat.linear.systems import input_filter
from barbalat.problem.actuation import PlantInput
from barbalat.problem.modelling_error import GainError
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import ParameterBox, Problem
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine, Square
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import Bracket, delay_margins_ensemble, gains_scanned, margins_ensemble
from barbalat.study.finer_step import PlainRun, delays_confirmed, different, gains_confirmed
from barbalat.study.ideal_benchmark import Ideals, Judging
from barbalat.study.simulated_margins import with_simulated_margins
from foreign import PlainState

DRIVE = Problem(
    plant=Plant(A_m=[[-2.0]], b=[1.5], theta=[1.0], x0=[0.3]),
    reference_model=ReferenceModel(k_0=1.3),
    reference=Sine(amplitude=1.0, frequency=2.0),
    uncertainty=ParameterBox(lower=[-3.0], upper=[3.0]),
)
SIMULATION = Simulation(t_end=10.0, dt=2e-3)
NUMBERS = np.zeros(1, dtype=int)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ((1.0, 1.0), []),
        ((2.0, 1.0), ["oscillates already"]),
        ((0.5, 1.0), ["does not oscillate yet"]),
        ((1.0, 2.0), ["is lost already"]),
        ((1.0, 0.7), ["is not lost yet"]),
    ],
)
def test_true_delays_are_confirmed_and_false_ones_are_not(factors, said):
    """The delays are the true delays times these factors. The finer step says on which side the true delay is."""
    members = [(DRIVE, Mrac(gamma=100.0))]
    found = delay_margins_ensemble(members, SIMULATION)
    assert 0 < 2 * found.onset.tolerates[0] < found.loss.tolerates[0] < 1.0  # the factors keep the two apart
    false = (Bracket(f * one.tolerates, f * one.loses) for f, one in zip(factors, (found.onset, found.loss), strict=True))
    (confirmed,) = delays_confirmed(
        members, SIMULATION, replace(found, **dict(zip(("onset", "loss"), false, strict=True))), numbers=NUMBERS
    )
    assert confirmed.asked == 4 and confirmed.simulation.dt == 5e-4
    assert [any(text in change for change in confirmed.changes) for text in said] == [True] * len(said)
    assert len(confirmed.changes) == len(said)
    assert ("the step decides" in confirmed.sentence) == bool(said)


@pytest.mark.parametrize(("factor", "said"), [(1.0, None), (1.5, "already"), (0.6, "yet")])
def test_true_gains_are_confirmed_and_false_ones_are_not(factor, said):
    delayed = replace(DRIVE, plant=replace(DRIVE.plant, input=PlantInput(delay=0.1)))
    members, error, sizes = [(delayed, Adrc(bandwidth=4.0))], GainError(), gains_scanned()
    found = margins_ensemble(members, SIMULATION, sizes, Ideals(SIMULATION, sizes, error))
    assert found.onset.tolerates[0] > 0 and np.isfinite(found.loss.loses[0])
    false = (Bracket(factor * one.tolerates, factor * one.loses) for one in (found.onset, found.loss))
    false = replace(found, **dict(zip(("onset", "loss"), false, strict=True)))
    (confirmed,) = gains_confirmed(members, SIMULATION, false, error, numbers=NUMBERS, by=Judging())
    assert confirmed.asked > 0 and bool(confirmed.changes) == (said is not None)
    for change in confirmed.changes:
        factors = [float(text) for text in re.findall(r"a gain of ([0-9.]+)", change)]
        assert said in change and len(factors) == 1 and factors[0] > 1
    assert "simulated gains" in confirmed.sentence
    assert GainError(downwards=True).factor(0.25) == 0.8


def test_an_oscillation_that_is_the_solvers_is_told(section_v):
    """L1 at h |lambda| = 22 has oscillating estimates without a delay. A quarter of the step is outside the region of stability
    too."""
    controller = L1Adaptive(gamma=1e3, filter=input_filter(0.02))
    simulation = Simulation(t_end=10.0, dt=1e-3)
    plain = PlainRun.of(section_v, controller, simulation)
    assert plain.h_lambda_max > 7 * max(plain.limits)
    assert plain.label.startswith("outside the region of stability from") and not plain.settles
    found = with_simulated_margins(certify(section_v, controller, simulation), section_v, [controller], simulation)
    said = found[controller.name].assumptions
    assert found[controller.name].values["delay_onset_simulated"] == 0
    assert any("outside the region of stability" in text and "settles nothing" in text for text in said)
    assert not any("same verdicts" in text for text in said)  # an unstable run confirms nothing


def test_euler_steps_of_a_sampled_law_are_not_put_down_to_the_solver():
    """Its h |lambda| is far within the solver's limits. A smaller step of the solver leaves the spectral radius as it is;
    only a smaller sample time removes the finding."""

    def found(sample_time, dt):
        law = Sampled(Mrac(gamma=1e3), sample_time, discretization="euler")
        return PlainRun.of(DRIVE, law, Simulation(t_end=4.0, dt=dt))

    coarse, fine, quick = found(0.02, 1e-3), found(0.02, 2.5e-4), found(1e-3, 2.5e-4)
    assert coarse.label is not None and 100 * coarse.h_lambda_max < min(coarse.limits)
    assert fine.label is not None and fine.radius_max == pytest.approx(coarse.radius_max, rel=0.01)
    assert quick.label is None and not quick.sentences
    (said,) = coarse.sentences
    assert "sample time" in said and f"{coarse.radius_max:.4g}" in said
    assert "solver's limit" not in said and "check_numerics" not in said


def test_a_finer_step_confirms_each_controller():
    controllers = Mrac(gamma=10.0), Adrc(bandwidth=10.0)
    found = with_simulated_margins(certify(DRIVE, controllers, SIMULATION), DRIVE, controllers, SIMULATION)
    said = {name: one.assumptions for name, one in found.items()}
    assert all(any("a step of 0.0005 s gives the same verdicts" in text for text in one) for one in said.values())


RELAY_LIKE = Problem(
    plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[0.0], input=PlantInput(saturation=[-2.0, 2.0], delay=0.1)),
    reference_model=ReferenceModel(k_0=1.0),
    reference=Constant(0.5),
)
"""The plant x' = -x + u(t - 0.1), for which a feedback with the gain k > 16 is unstable. Limits keep the oscillation small."""


def test_a_limit_cycle_at_the_actuators_limits_is_told():
    """With a gain too high for the delay the demand moves from limit to limit for ever. With a smaller one it settles.

    The frequency is counted by hand from a run with every step recorded.
    """
    simulation = Simulation(t_end=8.0, dt=2e-3)
    wild, tame = PlainRun.of(RELAY_LIKE, Gain(60.0), simulation), PlainRun.of(RELAY_LIKE, Gain(2.0), simulation)
    assert tame.verdict.cycle is None
    (run,) = simulate(RELAY_LIKE, [Gain(60.0)], replace(simulation, record_points=simulation.steps)).values()
    rising = run.t[1:][np.diff(np.sign(np.ravel(run.u))) > 0]
    late = rising[rising >= 4.0]
    assert wild.verdict.cycle.amplitude == pytest.approx(2.0)
    assert wild.verdict.cycle.frequency == pytest.approx(2 * np.pi / np.diff(late).mean(), rel=0.02)
    margins = delay_margins_ensemble([(RELAY_LIKE, Gain(60.0))], simulation)
    assert margins.oscillates[0] and margins.onset.tolerates[0] == margins.onset.loses[0] == 0


def test_a_command_that_asks_for_both_limits_is_no_limit_cycle():
    simulation = Simulation(t_end=8.0, dt=2e-3)
    asked = replace(
        RELAY_LIKE,
        reference=Square(amplitude=5.0, frequency=8.0),
        plant=replace(RELAY_LIKE.plant, input=PlantInput(saturation=[-2.0, 2.0])),
    )
    (run,) = simulate(asked, [Gain(0.0)], simulation).values()
    assert run.u.max() > 2 and run.u.min() < -2
    assert PlainRun.of(asked, Gain(0.0), simulation).verdict.cycle is None


class Gain:
    """A user's own controller u = k_0 r - k x."""

    def __init__(self, k: float) -> None:
        self.k, self.name = k, f"gain {k:g}"

    def bind(self, known):
        self.k_0 = known.k_0
        return self

    def initial(self):
        return PlainState(np.zeros(0))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - self.k * x[0]

    def derivative(self, state, x, x_m, r, u):
        return state

    def limit(self, state):
        return state


def test_an_infinite_figure_differs_from_a_finite_one() -> None:
    """A tuning that was lost at the finer step was once confirmed by it."""
    assert different(1.0, np.inf)
    assert different(np.inf, 1.0)
    assert not different(np.inf, np.inf)
    assert not different(1.0, 1.05)
    assert different(1.0, 1.2)
