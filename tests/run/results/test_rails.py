"""A demand that swings from limit to limit: counted by hand on demands that are known, and found in a loop that does."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.cases.load import parse_case
from barbalat.run.results.findings import rail_to_rail

T = np.linspace(0.0, 20.0, 2001)
LIMITED = """
name = "limited"
[plant]
A_m = [[-1.0]]
b = [1.0]
theta = [0.5]
{inputs}
[reference_model]
k_0 = 1.0
[reference]
{command}
[simulation]
t_end = 20.0
dt = 1e-2
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 1.0
"""
HELD, SINE = 'kind = "constant"\nvalue = 1.0', 'kind = "sine"\namplitude = 1.0\nfrequency = 10.0'
LIMITS = "[plant.input]\nsaturation = [-2.0, 1.0]"


def found(demand, command=HELD, inputs=LIMITS):
    """``demand`` at fine instants; of each interval of the record its least and greatest values."""
    problem = parse_case(LIMITED.format(command=command, inputs=inputs)).problem
    fine = np.array([demand(t) for t in np.linspace(T[:-1], T[1:], 11)])
    return rail_to_rail(problem, T, 20.0, fine.min(axis=0)[:, None], fine.max(axis=0)[:, None])


def swinging(since=0.0, amplitude=3.0, pulsation=10.0):
    return lambda t: np.where(t >= since, amplitude * np.sin(pulsation * t), 0.0)


@pytest.mark.parametrize(("since", "begins"), [(0.0, 0.05), (9.0, 9.1)])
def test_a_sine_over_both_limits(since, begins):
    """Its switches in the tail are its half periods there: 10 * 5/pi = 15.9. It is at a limit at asin(1/3)/10 s first."""
    rails = found(swinging(since))
    assert rails.limits == (-2.0, 1.0) and 15 <= rails.switches <= 16 and rails.turns == 0 and not rails.noisy
    assert rails.since == pytest.approx(begins + np.pi / 10, abs=0.25)
    assert "swings from limit to limit (-2 to 1)" in rails.sentence and rails.as_json()["sentence"] == rails.sentence


def test_two_limits_within_each_recorded_interval_count_once():
    rails = found(swinging(pulsation=2000.0))
    assert rails.switches == 500


@pytest.mark.parametrize(
    "demand",
    [
        swinging(amplitude=1.9),  # reaches the upper limit alone
        swinging(amplitude=0.5),
        lambda t: np.where(t < 19.0, swinging()(t), 0.0),  # comes to rest
        lambda t: np.where(t < 14.0, swinging()(t), 0.0),
        swinging(since=18.0),  # in less than the whole tail: nobody knows whether it goes on
        swinging(pulsation=3.0),  # 4.8 switches
    ],
)
def test_what_is_no_swinging_from_limit_to_limit(demand):
    assert found(demand) is None


def test_a_command_that_turns_as_often_explains_it():
    assert found(swinging(), SINE) is None
    assert found(swinging(pulsation=40.0), SINE).turns == pytest.approx(10 * 5 / np.pi, abs=1)


def test_without_limits_nothing_is_said():
    assert found(swinging(), inputs="") is None


def test_noise_is_named_as_another_cause():
    text = LIMITED.format(command=HELD, inputs=LIMITS) + "[sensor]\nnoise = { std = 0.1, sample_time = 0.01 }\n"
    problem = parse_case(text).problem
    low, high = np.full((2000, 1), -3.0), np.full((2000, 1), 3.0)
    rails = rail_to_rail(problem, T, 20.0, low, high)
    assert rails.noisy and rails.sentence.endswith("a limit cycle, or measurement noise that the controller amplifies")
