"""Lemma 1 along runs, compared with identities that the claim's code does not contain."""

import numpy as np
import pytest

from barbalat import RobustMrac, Simulation, TransferFunction
from barbalat.laws import LeastSquares, Normalization
from barbalat.papers.jafari_2013.robustness.lemma_1 import along
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.plants import PlantInput
from barbalat.signals import Constant

SIMULATION = Simulation(t_end=10.0, dt=1e-3, record_points=500)


def scheme(**change):
    return RobustMrac(**({"c_0": [1.0, 1.0], "tau": 0.5, "law": LeastSquares(covariance0=10.0)} | change))


def error(mu):
    return PlantInput(multiplicative=TransferFunction([-mu, 0.0], [0.05, 1.0]))


def test_without_modelling_error_eta_is_zero():
    run = along(variant(reference=Constant(5.0)), scheme(projection=False), SIMULATION)
    assert np.abs(run.eta).max() < 1e-10  # z is theta'phi up to rounding
    assert run.integrals["eta"][-1] < 1e-20


@pytest.mark.parametrize("mu", [0.0, 0.02, 0.1])
def test_the_energy_balance_of_least_squares(mu):
    """d/dt theta_tilde'P^-1 theta_tilde = -(epsilon m_s)^2 + (eta/m_s)^2, from P^-1' = phi phi'/m_s^2."""
    problem = variant(reference=Constant(5.0), input=error(mu) if mu else None)
    run = along(problem, scheme(projection=False, normalization=Normalization(alpha_0=1.0)), SIMULATION)
    balance = run.V + run.integrals["error"] - run.integrals["eta"]
    assert np.abs(balance / run.V[0] - 1).max() < 1e-8  # RK4 of fourth order at h = 1e-3 s


def test_the_integrals_are_those_of_the_recorded_quantities():
    problem = variant(reference=Constant(5.0), input=error(0.1))
    run = along(problem, scheme(), Simulation(t_end=10.0, dt=1e-3, record_points=10_000))
    for name, values in (("error", run.error), ("epsilon", run.epsilon), ("rate", run.rate), ("eta", run.eta)):
        trapezoid = np.trapezoid(values**2, dx=1e-3)
        assert run.integrals[name][-1] == pytest.approx(
            trapezoid, rel=1e-3
        )  # the trapezoidal rule's own error during a fast start


def test_the_constant_is_the_least_one():
    run = along(variant(reference=Constant(5.0), input=error(0.1)), scheme(), SIMULATION)
    part, allowed = run.integrals["error"], run.integrals["eta"]
    ratios = (part[None, :] - part[:, None]) / (allowed[None, :] - allowed[:, None] + 1)
    assert run.constant("error") == pytest.approx(np.triu(ratios).max(), rel=1e-12)
