"""Former guarantees that are false, each with a run or a count that contradicts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contradictions import OF_THE_LOOP, claims_where_nothing_holds, judged, runs_away
from mixtures import SIMULATION, TF

from barbalat import (
    L1Adaptive,
    LinearFeedback,
    Mrac,
    NormalizedMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Sampled,
    input_filter,
    simulate,
)
from barbalat.adaptation.law import Normalization
from barbalat.adaptation.modifications import DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify_where_possible
from barbalat.controllers import MracClosedLoop
from barbalat.controllers.output import LinearOutput, MracOutput
from barbalat.laws import Gradient
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem.regressors import Terms
from barbalat.signals import Constant, Sine, Step
from barbalat.signals.smooth import Clock
from barbalat.solvers.simulation import Simulation

UNSTABLE = Problem(
    plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[3.0]),
    reference_model=ReferenceModel(k_0=1.0),
    reference=Sine(1.0, 1.0),
    uncertainty=ParameterBox(lower=[-4.0], upper=[4.0]),
)
"""For x' = 2 x + u the loop diverges with estimates that stay near zero."""
OUTPUT = OutputProblem(
    plant=OutputPlant(transfer_function=TF([1.0], [1.0, -1.0])),
    reference_model=OutputReferenceModel(transfer_function=TF([2.0], [1.0, 2.0])),
    reference=Constant(1.0),
)
CLASS: dict[str, object] = {"order": 1, "relative_degree": 1, "sign": 1}
WIDE: dict[str, object] = {"law": Gradient(gamma=1.0, dead_zone=DeadZone(g_0=50.0))}
HEAVY: dict[str, object] = {"law": Gradient(gamma=1.0, leakage=FixedSigma(sigma=50.0))}
DIVERGING = {
    "a dead zone that is too wide": (UNSTABLE, NormalizedMrac(**WIDE)),
    "the same with output feedback": (OUTPUT, MracOutput(c_0_min=0.1, **WIDE, **CLASS)),
    "a leakage that is too large": (UNSTABLE, NormalizedMrac(**HEAVY)),
    "the same with output feedback and an auxiliary input": (OUTPUT, MracOutput(c_0_min=0.1, tau=0.5, **HEAVY, **CLASS)),
    "an epsilon-modification that is too large": (
        UNSTABLE,
        NormalizedMrac(law=Gradient(gamma=1.0, leakage=EpsilonModification(nu=50.0))),
    ),
    "a regressor that is no number everywhere": (
        replace(UNSTABLE, plant=replace(UNSTABLE.plant, regressor=Terms(terms=("sqrt(x1 + 0.3)",)))),
        Mrac(gamma=5.0),
    ),
    "a command without a bound": (replace(UNSTABLE, reference=Clock()), Mrac(gamma=1.0)),
}
"""Loops that were once called bounded. Each diverges or stops."""


@pytest.mark.parametrize("name", DIVERGING)
def test_what_runs_away_is_not_called_bounded(name):
    problem, controller = DIVERGING[name]
    certificates = certify_where_possible(problem, [controller], SIMULATION)
    (column,) = table_1(problem, [controller], certificates).columns
    (run,) = simulate(problem, [controller], Simulation(t_end=40.0, dt=2e-3)).values()
    assert runs_away(run) or not problem.commands[0](np.array(1e3)) < 1e3
    for row in (*OF_THE_LOOP, "modelling_error"):
        assert not column.cells[row].applies, row
    assert not claims_where_nothing_holds(certificates[controller.name], column)


def test_the_worst_of_a_set_says_nothing_of_a_theta_outside_it():
    """Without projection (9) holds for any theta of the case, so a run may exceed the largest bound over the set."""
    problem = replace(UNSTABLE, uncertainty=ParameterBox(lower=[-0.1], upper=[0.1]))
    controller = Mrac(gamma=0.5, projection=False)
    certificate, column = judged(problem, controller)
    (run,) = simulate(problem, [controller], SIMULATION).values()
    assert certificate.entry("error_bound_worst").value < max(run.figures["max_abs_e"]) <= certificate.values["error_bound"]
    assert "error_bound_worst" not in certificate.values and "worst" not in column.cells["transient"].text
    assert {"nu_0", "error_bound"} <= certificate.guaranteed and "nu_0_worst" not in certificate.values


def test_corners_that_are_cut_take_boundedness_away(no_searches):
    """With a gain matrix in a box of five parameters V may grow, and nothing else keeps x bounded."""
    p, random = 5, np.random.default_rng(1)
    root = random.normal(size=(p, p))
    gain = np.eye(p) + 0.3 * (root @ root.T)
    plant = Plant(A_m=np.diag(-np.arange(1.0, p + 1)), b=np.ones(p), theta=np.full(p, 0.1))
    box = ParameterBox(lower=np.full(p, -0.2), upper=np.full(p, 0.2))
    for problem in (Problem(plant=plant, uncertainty=box), Problem(plant=plant)):
        for controller in (Mrac(gamma=gain), L1Adaptive(gamma=gain, filter=input_filter(0.01)), MracClosedLoop(
            gamma=gain, model_feedback=-np.eye(p))):  # fmt: skip
            _, column = judged(problem, controller)
            expected = problem.uncertainty is None and not isinstance(controller, L1Adaptive)
            assert column.cells["stability"].applies == expected


def test_to_zero_only_where_the_signals_come_to_rest(no_searches):
    """L1-AC (Theorem 1 (iii)), an integrator and L1 output feedback converge only for constant r and d."""
    small = replace(UNSTABLE, plant=replace(UNSTABLE.plant, theta=[1.5]))
    schemes = (
        (small, L1Adaptive(gamma=100.0, filter=input_filter(0.02))),
        (small, LinearFeedback(controller=TF([60.0, 60.0], [1.0, 0.0]))),
        (OUTPUT, LinearOutput(loop=TF([20.0, 20.0], [1.0, 0.0]), feedforward=TF([20.0, 20.0], [1.0, 0.0]))),
    )
    for problem, controller in schemes:
        for changes, holds in (
            ({"reference": Step(1.0, start=1.0)}, True),
            ({"reference": Sine(1.0, 1.0)}, False),
            ({"reference": Constant(1.0), "output_disturbance": Sine(0.5, 1.0)}, False),
        ):
            if "output_disturbance" in changes and problem.feedback == "state":
                continue
            given = replace(problem, **changes)
            _, column = judged(given, controller)
            (run,) = simulate(given, [controller], SIMULATION).values()
            assert column.cells["tracking"].applies == holds
            assert (max(run.figures["tail_max_abs_e"]) < 1e-4) == holds


def test_a_robustness_of_what_breaks_its_conditions():
    """Here tau >= 1/delta_0 and M_0 < |theta|, whereas Theorem 2 and the switching sigma require the opposite."""
    dynamic = Normalization(alpha_0=1.0, delta_0=0.7)
    plain, narrow = Gradient(gamma=1.0), Gradient(gamma=1.0, leakage=SwitchingSigma(sigma=1.0, M_0=0.1))
    for tau, law, holds in ((0.5, plain, True), (2.0, plain, False), (0.5, narrow, False)):
        for problem, controller in (
            (UNSTABLE, RobustMrac(tau=tau, law=law, normalization=dynamic)),
            (OUTPUT, MracOutput(tau=tau, law=law, normalization=dynamic, lower=[-9.0, 0.1], upper=[9.0, 9.0], **CLASS)),
        ):
            assert judged(problem, controller)[1].cells["modelling_error"].applies == holds


def test_V_of_a_sampled_law_does_grow():
    """The plant moves between samples, so the claim that no sample time makes V grow was too strong."""
    problem = replace(UNSTABLE, uncertainty=None, plant=replace(UNSTABLE.plant, x0=[2.0]))
    controller = Sampled(controller=Mrac(gamma=100.0, theta_hat0=problem.plant.theta), sample_time=0.4)
    _, column = judged(problem, controller, Simulation(t_end=12.0, dt=4e-3))
    (run,) = simulate(problem, [controller], Simulation(t_end=12.0, dt=4e-3)).values()
    assert np.abs(run.theta_hat - problem.plant.theta).max() > 0.01  # V(0) = 0
    assert (
        column.cells["estimates"].kind == "guaranteed"
        and "only the plant's motion between samples" in column.cells["estimates"].text
    )


class Bolder(Mrac):
    """A law that has only the settings in common with its parent. Its estimates move in the opposite direction."""

    def bind(self, known):
        return replace(super().bind(known), P=-known.P)


def test_a_subclass_with_equations_of_its_own_has_nothing_of_its_parents_certificate():
    controller = Bolder(gamma=1.0, projection=False)
    certificate, column = judged(UNSTABLE, controller)
    (run,) = simulate(UNSTABLE, [controller], SIMULATION).values()
    assert runs_away(run) and not claims_where_nothing_holds(certificate, column)
    assert "error_bound" not in certificate.values and not any(cell.kind == "guaranteed" for cell in column.cells.values())
