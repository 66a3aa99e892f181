"""Limits of a law that is sampled by Euler steps, compared with formulas and runs."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.certify import certify
from barbalat.certificates.step_limits.oscillator import HeldOscillator
from barbalat.signals import Constant

PAPER = load_case("paper").problem
SIMULATION = Simulation(t_end=20.0, dt=1e-4)


def euler(controller, sample_time=1e-4):
    return Sampled(controller=controller, sample_time=sample_time, discretization="euler")


KEYS = ("nu_0", "gamma_max", "step_max", "error_bound", "error_bound_worst")


def certificate(controller):
    (found,) = certify(PAPER, (controller,), SIMULATION, keys=KEYS).values()
    return found


@pytest.mark.parametrize("sample_time", [1e-4, 1e-3])
def test_the_largest_gain_is_that_of_the_damped_oscillator(sample_time):
    """For small T, Gamma |x|^2 = b'b/(2 (b'P b)^2 T) with |x| bounded by the bounds on the model's state and on e."""
    found = certificate(euler(Mrac(gamma=1e-4), sample_time))
    known, nu_0 = PAPER.known, found.values["nu_0"]
    bPb = known.b @ known.P @ known.b
    largest_g = known.b @ known.b / (2 * bPb**2 * sample_time)
    gamma = ((np.sqrt(largest_g) - nu_0) / model_bounds(PAPER).x_m_euclidean) ** 2
    assert found.values["gamma_max"] == pytest.approx(gamma, rel=0.02)


def test_where_no_gain_is_shown_to_be_tolerated_the_reason_stands_there():
    """By hand, nu_0 alone exceeds sqrt(b'b/(2 (b'P b)^2 T)) for a long sample time."""
    found = certificate(euler(Mrac(gamma=1e-4), 0.05))
    entry = found.entry("gamma_max")
    assert found.values["nu_0"] ** 2 > 1 / (2 * (PAPER.known.b @ PAPER.known.P @ PAPER.known.b) ** 2 * 0.05)
    assert (entry.kind, entry.value) == ("does not apply", None)
    assert "no gain is shown to be tolerated" in entry.why
    assert "gamma_max" not in found.values


def filtered(gamma):
    return L1Adaptive(gamma=gamma, filter=input_filter(0.02))


@pytest.mark.parametrize(("make", "factor"), [(lambda gamma: Mrac(gamma=gamma), 10), (filtered, 100)])
def test_below_the_limit_no_label_and_well_above_one(make, factor):
    """The limit is for the largest possible |x|. This is twice the actual |x| for MRAC, and even larger for L1-AC with (10)."""
    gamma_max = certificate(euler(make(1.0))).values["gamma_max"]
    assert gamma_max > 0
    below, above = (simulate(PAPER, [euler(make(gamma))], SIMULATION) for gamma in (0.9 * gamma_max, factor * gamma_max))
    (sound,), (labelled,) = below.values(), above.values()
    assert sound.label is None
    assert labelled.label is not None


@pytest.mark.parametrize("a", [0.5, 60.0])
@pytest.mark.parametrize("T", [1e-9, 1e-3, 0.05])
def test_a_scalar_plant_has_a_closed_form(a, T):
    """Jury's criterion gives g <= 2 a^2/(T b^2), also for T > 2, where Euler's method would make the plant unstable."""
    problem = Problem(plant=Plant(A_m=[[-a]], b=[3.0], theta=[0.1]), reference=Constant(1.0))
    held = HeldOscillator(problem.known)
    exact = 2 * a**2 / (T * 9)
    assert held.largest_g(T) == pytest.approx(exact, rel=1e-6)
    assert held.largest_step(exact) == pytest.approx(T, rel=1e-6)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_sampled_law_on_a_fast_plant_turns_where_it_is_said_to(factor):
    """With a constant command and a tiny error, x equals the state of the model, and the steps of the estimates decay or grow."""
    a, T = 60.0, 0.05
    plant = Plant(A_m=[[-a]], b=[1.0], theta=[0.1])
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=a), reference=Constant(1.0))
    gamma = factor * 2 * a**2 / T
    controller = euler(Mrac(gamma=gamma, theta_hat0=[0.1 + 1e-9]), T)
    (run,) = simulate(problem, [controller], Simulation(t_end=20.0, dt=T / 50)).values()
    (found,) = certify(problem, (controller,), run.simulation, keys=KEYS).values()
    assert found.values["gamma_max"] == pytest.approx(gamma / factor, rel=1e-3)
    assert any("admits sample times only up to" in finding for finding in found.findings) == (factor > 1)
    assert "error_bound" not in found.values
    assert (abs(run.theta_hat[-1, 0] - 0.1) < 1e-6) == (factor < 1)  # or beyond 1
    assert (run.label is None) == (factor < 1)


def test_an_error_bound_is_given_only_where_the_law_can_be_trusted():
    chattering, continuous = certificate(euler(Mrac(gamma=1e4))), certificate(Mrac(gamma=1e4))
    assert not {"error_bound", "error_bound_worst"} & chattering.values.keys()
    assert any("admits sample times only up to" in finding and "error_bound" in finding for finding in chattering.findings)
    (run,) = simulate(PAPER, [euler(Mrac(gamma=1e4))], SIMULATION).values()
    assert max(run.figures["max_abs_e"]) > continuous.values["error_bound"]  # the limit would not have held
    calm = certificate(euler(Mrac(gamma=1e-4)))
    assert calm.entry("error_bound").value == certificate(Mrac(gamma=1e-4)).values["error_bound"]
    assert calm.entry("error_bound").kind == "does not apply" and "sampled" in calm.entry("error_bound").why


def test_the_midpoint_form_has_no_limits():
    found = certificate(Sampled(controller=Mrac(gamma=1e4), sample_time=1e-4))
    assert not {"gamma_max", "step_max"} & found.values.keys()
