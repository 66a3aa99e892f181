"""The loop with frozen estimates on plants beyond the paper, against the loop written by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, input_filter
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, series
from barbalat.plants import PlantInput
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

A_M, B, THETA = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([0.0, 1.0]), np.array([5.0, 1.5])
SIMULATION = Simulation(t_end=10.0, dt=1e-3)
KAPPA = 0.05
SCHEMES = {"plain": Mrac(gamma=10.0), "filtered": L1Adaptive(gamma=10.0, filter=input_filter(KAPPA))}


@pytest.mark.parametrize("delay", [0.0, 0.02])
@pytest.mark.parametrize("omega", [0.5, 2.0])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_beside_an_unknown_gain_the_loop_is_that_of_the_parameters(scheme, omega, delay):
    """u = (k_0 r - theta'x)/omega: omega leaves the loop, so that the gain margin is beside the case's own.

    With C(s) u = C/(1 - C) [k_0 r - theta'x - omega u] = (k_0 r - theta'x)/(kappa s + omega): omega stays in the filter.
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
    unknown = replace(problem, plant=replace(problem.plant, theta=[20.0, 1.5]))  # outside the set: projected, it can't rest there
    text = certify(unknown, [controller], SIMULATION)[controller.name].entry("delay_margin").why
    assert "limit acts" in text
