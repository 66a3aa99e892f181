"""Margins of linear controllers over the known set with an unknown input gain, compared with loops written by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import barbalat_check
from barbalat import DirectMrac, Mrac, ParameterBox, Plant, Problem, ReferenceModel, certify
from barbalat.certificates.proof import proof
from barbalat.controllers import Adrc, BaselineAlone, LinearFeedback
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.plants import ParameterBall, PlantInput
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation

A_M, B = np.array([[0.0, 1.0], [-1.0, -1.4]]), np.array([0.0, 1.0])
PI = LinearFeedback(controller=TransferFunction([5.0, 5.0], [1.0, 0.0]), name="PI")
SETS = {"box": ParameterBox(lower=[-1, -1], upper=[1, 1]), "ball": ParameterBall(center=[0, 0], radius=1.2)}
SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def problem_with(known_set, omega=1.0, gains=(0.5, 2.0)):
    return Problem(
        plant=Plant(A_m=A_M, b=B, theta=[0.5, -0.3], input=PlantInput(gain=omega)),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(1.0),
        uncertainty=known_set,
        input_gain=gains,
    )


def loop_by_hand(theta, omega):
    """The loop of a PI on c'x with c = P b, broken at the plant's input."""
    from scipy.linalg import solve_continuous_lyapunov

    c = solve_continuous_lyapunov(A_M.T, -np.eye(2)) @ B
    A = np.block([[A_M + np.outer(B, theta), np.zeros((2, 1))], [c, 0.0]])
    return StateSpace(A, np.append(B, 0.0), omega * np.append(5.0 * c, 5.0), 0.0)


@pytest.mark.parametrize("shape", SETS)
@pytest.mark.parametrize("omega", [1.0, 0.6])
def test_margins_in_the_set_are_the_least_over_theta_and_the_gain(shape, omega, sample):
    problem = problem_with(SETS[shape], omega)
    (found,) = certify(problem, [PI], SIMULATION)["PI"].values["margins_over_known_set"]
    for key, name in (("delay_margin", "delay"), ("phase_margin", "phase"), ("gain_reduction_margin", "gain_down")):
        entry = found[key]
        assert SETS[shape].contains(entry["theta"]) and 0.5 <= entry["input_gain"] <= 2.0
        hand = getattr(margins(loop_by_hand(np.array(entry["theta"]), entry["input_gain"])), name)
        assert entry["value"] == pytest.approx(hand, rel=1e-9)
    rng = np.random.default_rng(3)
    drawn = SETS[shape].drawn(rng, sample(100, 3000))
    for theta, gain in zip(drawn, rng.uniform(0.5, 2.0, len(drawn)), strict=True):
        assert margins(loop_by_hand(theta, gain)).delay >= found["delay_margin"]["value"]


def test_a_gain_for_which_the_loop_is_unstable_is_found():
    """At omega = 0.5 the baseline does not stabilise the plants with theta_1 near 1."""
    (found,) = certify(problem_with(SETS["box"]), [BaselineAlone()], SIMULATION)["Baseline"].values["margins_over_known_set"]
    theta, omega = np.array(found["unstable_at"]), found["unstable_at_gain"]
    assert np.linalg.eigvals(A_M + np.outer(B, theta)).real.max() >= 0 and 0.5 <= omega <= 2.0


@pytest.mark.parametrize("controller", [PI, Adrc(bandwidth=5.0), BaselineAlone()], ids=lambda one: one.name)
def test_bounds_over_the_set_assume_the_gain_that_the_controller_takes(controller):
    known_set = ParameterBox(lower=[-0.3, -0.3], upper=[0.3, 0.3])
    plain = replace(problem_with(known_set), plant=Plant(A_m=A_M, b=B, theta=[0.2, -0.1]))
    certificate = certify(plain, [controller], SIMULATION)[controller.name]
    assert certificate.entry("error_bound").applies and any("all of uncertainty.input_gain" in note for note in certificate.notes)
    off = replace(plain, plant=replace(plain.plant, input=PlantInput(gain=1.5)))
    other = certify(off, [controller], SIMULATION)[controller.name]
    assert (
        other.entry("error_bound").applies
        and "theta and the input gain are those given in the case" in other.entry("error_bound").assumptions
    )
    assert any("for the case's input gain, not for all of" in note for note in other.notes)


@pytest.mark.dear
def test_the_checker_refuses_bounds_of_pi_for_another_gain():
    problem = problem_with(ParameterBox(lower=[-0.3, -0.3], upper=[0.3, 0.3]))
    problem = replace(problem, plant=replace(problem.plant, theta=[0.2, -0.1]))
    document = proof("gain", problem, [PI], SIMULATION, certify(problem, [PI], SIMULATION))
    barbalat_check.check(document)
    document["plant"]["gain"] = [1.5]
    with pytest.raises(barbalat_check.Refused, match="the gain that the controller takes it to have"):
        barbalat_check.check(document)


@pytest.mark.parametrize("omega", [1.0, 0.6])
@pytest.mark.parametrize("law", [Mrac(gamma=5.0), DirectMrac(gamma=5.0)], ids=["mrac", "direct"])
def test_frozen_estimates_that_include_the_gain_have_margins_over_the_set(law, omega):
    """With true estimates u = (k_0 r - theta'x)/omega, so that L = theta'(sI - A)^-1 b for every gain."""
    wide = problem_with(ParameterBox(lower=[0.2, -0.6], upper=[2.5, 0.4]), omega)
    (found,) = certify(wide, [law], SIMULATION, keys=["margins_over_known_set"])[law.name].values["margins_over_known_set"]
    worst = found["delay_margin"]
    theta = np.array(worst["theta"])
    expected = margins(StateSpace(A_M + np.outer(B, theta), B, theta, 0.0)).delay
    assert worst["value"] == pytest.approx(expected, rel=1e-9)
    assert worst["value"] <= margins(StateSpace(A_M + np.outer(B, [0.5, -0.3]), B, np.array([0.5, -0.3]), 0.0)).delay
