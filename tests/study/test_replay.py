"""A recorded flight through an estimator alone."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, load_case
from barbalat.cases.load import CaseText
from barbalat.loop.packing import unflatten
from barbalat.plants import LuenbergerObserver
from barbalat.run.engine.simulate import recorded
from barbalat.signals import Sine
from barbalat.studies import replay
from independent import refusal

T = 0.01
PROBLEM = Problem(
    Plant(A_m=[[0.0, 1.0], [-1.0, -2.0]], b=[0.0, 1.0], theta=[1.5, -0.5], x0=[0.2, 0.0]),
    ReferenceModel(k_0=1.0),
    Sine(amplitude=1.0, frequency=1.5),
    uncertainty=ParameterBox(lower=[-3.0, -3.0], upper=[3.0, 3.0]),
)
SCHEMES = [Sampled(Mrac(gamma=50.0), T), Sampled(L1Adaptive(gamma=500.0, filter=input_filter(0.05)), T)]


def flight(controller, problem=PROBLEM):
    """Measurements, commands, inputs and estimates of a simulated flight."""
    T = controller.sample_time
    run = recorded(problem, controller, Simulation(t_end=500 * T, dt=T / 5), 500)
    acting = [run.loop.computer.initial(run.measured[0]) for _ in run.states]
    acting = [unflatten(template, state, 0)[0] for template, state in zip(acting, run.states, strict=True)]
    u = np.array([one.held.u.reshape(-1) for one in acting])
    estimates = np.array([run.loop.theta_hat(one.controller) for one in acting])
    return T * np.arange(len(u)), run.measured, u, run.commands, estimates


@pytest.mark.parametrize("controller", SCHEMES, ids=lambda one: one.name)
def test_its_own_flight_teaches_a_scheme_what_it_learnt_in_flight(controller) -> None:
    t, x, u, r, estimates = flight(controller)
    found = replay(PROBLEM, controller, t, x, u, r)
    assert np.ptp(estimates, axis=0).min() > 0.1
    # the same equations with sums in a different order
    assert np.abs(found.theta_hat - estimates).max() < 1e-9 and np.abs(found.proposed - u).max() < 1e-9


@pytest.mark.parametrize("controller", SCHEMES, ids=lambda one: one.name)
def test_beside_an_observer_what_it_is_given_is_handed_in(controller) -> None:
    problem = replace(PROBLEM, observer=LuenbergerObserver(poles=[-12.0, -15.0], measured=[[1.0, 0.0]]))
    t, y, u, r, estimates = flight(controller, problem)
    assert y.shape == (len(t), 1) and np.ptp(estimates, axis=0).min() > 0.1
    found = replay(problem, controller, t, y, u, r)
    assert np.abs(found.theta_hat - estimates).max() < 1e-9 and np.abs(found.proposed - u).max() < 1e-9
    assert "measured" in refusal(lambda: replay(problem, controller, t, np.repeat(y, 2, axis=1), u, r))


def test_around_a_baseline_the_whole_control_is_handed_in(tmp_path) -> None:
    text, noise = CaseText.read("magnetic-levitation").text, re.compile(r"\[sensor\.noise\]\n(.+\n)+")
    assert noise.search(text)  # it would start the model at a different state than in flight
    (tmp_path / "quiet.toml").write_text(noise.sub("", text), "utf-8")
    case = load_case(tmp_path / "quiet.toml")
    problem, controller = case.problem, case.controllers[0]
    t, x, u, r, estimates = flight(controller, problem)
    found = replay(problem, controller, t, x, u, r)
    assert np.ptp(estimates, axis=0).max() > 1e-3
    assert np.abs(found.theta_hat - estimates).max() < 1e-9 and np.abs(found.proposed - u).max() < 1e-9


def test_a_flight_of_another_controller_teaches_something_else() -> None:
    t, x, u, r, estimates = flight(SCHEMES[0])
    found = replay(PROBLEM, SCHEMES[1], t, x, u, r)
    assert np.abs(found.theta_hat[-1] - estimates[-1]).max() > 1e-3
    assert np.abs(found.proposed - u).max() > 1e-3  # the control of the law is recorded, but not applied


def test_other_times_and_continuous_controllers_are_refused() -> None:
    t, x, u, r, _ = flight(SCHEMES[0])
    assert "times must be one sample time of 0.01 s apart" in refusal(lambda: replay(PROBLEM, SCHEMES[0], 2 * t, x, u, r))
    assert "MRAC is continuous" in refusal(lambda: replay(PROBLEM, Mrac(gamma=50.0), t, x, u, r))
