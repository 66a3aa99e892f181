"""The loop with frozen estimates on plants beyond the paper, compared with the loop written by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import DirectMrac, L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, input_filter, simulate
from barbalat.adaptation.modifications import FixedSigma
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.certificates.summary import five
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, series
from barbalat.plants import PlantInput
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation

A_M, B, THETA = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([0.0, 1.0]), np.array([5.0, 1.5])
SIMULATION = Simulation(t_end=10.0, dt=1e-3)
KAPPA = 0.05
SCHEMES = {"plain": Mrac(gamma=10.0), "filtered": L1Adaptive(gamma=10.0, filter=input_filter(KAPPA))}


@pytest.mark.parametrize("delay", [0.0, 0.02])
@pytest.mark.parametrize("omega", [0.5, 2.0])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_beside_an_unknown_gain_the_loop_is_that_of_the_parameters(scheme, omega, delay):
    """With u = (k_0 r - theta'x)/omega the loop does not depend on omega, so the gain margin is relative to the case's gain.

    With C(s), u = C/(1 - C) [k_0 r - theta'x - omega u] = (k_0 r - theta'x)/(kappa s + omega), where omega remains in the filter.
    """
    controller = SCHEMES[scheme]
    problem = Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, input=PlantInput(gain=omega, delay=delay)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=1.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-10, -10], upper=[10, 10]),
        input_gain=(0.2, 5.0),
    )
    loop = StateSpace(A_M + np.outer(B, THETA), B, THETA, 0.0)
    hand = margins(loop if scheme == "plain" else series(input_filter(KAPPA / omega).realise(), loop), delay)
    certificates = certify(problem, [controller], SIMULATION)
    found = certificates[controller.name]
    for key, value in (("delay_margin", hand.delay), ("phase_margin", hand.phase), ("gain_margin", hand.gain_up)):
        assert found.values[key] == (pytest.approx(value, rel=1e-9) if np.isfinite(value) else None)
        assert found.entry(key).kind == "exact"
    assert "estimates frozen" in found.entry("delay_margin").of
    assert "theta_hat = theta" in found.entry("delay_margin").of
    (column,) = table_1(problem, [controller], certificates).columns
    assert "delay margin" in column.cells["margins"].text
    adapting = found.entry("delay_margin_adapting")
    assert adapting is not None and (adapting.applies or "largest eigenvalue" in adapting.why)
    line = five(column, found, SIMULATION.dt)[2].text
    assert "with frozen estimates" in line and ("adapting: not known" in line) == (not adapting.applies)
    unknown = replace(
        problem, plant=replace(problem.plant, theta=[20.0, 1.5])
    )  # outside the set, where a projected estimate can't be at rest
    text = certify(unknown, [controller], SIMULATION)[controller.name].entry("delay_margin").why
    assert "limit of the controller acts" in text


def test_beside_an_unknown_gain_the_law_has_a_margin_of_its_own():
    """At rest under a constant command, the loop tolerates any delay with frozen estimates, but not with an active law."""
    problem = Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=B, theta=[0.6, -0.4], x0=[1.0, 0.0], input=PlantInput(gain=0.8)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Constant(1.0),
        uncertainty=ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0]),
        input_gain=(0.5, 1.5),
    )
    controller = Mrac(gamma=20.0, theta_hat0=[0.6, -0.4, 0.8001])
    certificates = certify(problem, [controller, DirectMrac(name="direct", gamma=20.0)], SIMULATION)
    found = certificates[controller.name]
    for one in certificates.values():
        assert one.values["delay_margin"] is None and one.entry("delay_margin").kind == "exact"
        assert one.values["delay_margin_adapting"] < 0.2
    for share, grows in ((0.9, False), (1.1, True)):
        path = PlantInput(gain=0.8, delay=share * found.values["delay_margin_adapting"])
        run = simulate(replace(problem, plant=replace(problem.plant, input=path)), controller, SIMULATION)[controller.name]
        early, late = (np.abs(run.e[(run.t >= a) & (run.t < b)]).max() for a, b in ((2.0, 4.0), (8.0, 10.0)))
        assert (late > early) == grows


def test_a_margin_with_the_law_inside_that_is_not_given_is_said_to_be_missing():
    controller = Mrac(gamma=20.0, leakage=FixedSigma(sigma=0.1))
    problem = Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, input=PlantInput(gain=0.8)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Constant(1.0),
        input_gain=(0.5, 1.5),
    )
    assert (
        "only for the plain law" in certify(problem, [controller], SIMULATION)[controller.name].entry("delay_margin_adapting").why
    )
