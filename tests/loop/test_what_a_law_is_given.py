"""The u that a law's rate receives is the command of the law, whatever is between the law and the plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from barbalat import L1Adaptive, Plant, Problem, ReferenceModel, Sampled, TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import PlantInput
from barbalat.signals import Constant

COMMAND = 3.0


class State(NamedTuple):
    theta_hat: np.ndarray
    memory: np.ndarray  # the integral of the u that the law receives


class Recorder:
    def initial(self):
        return State(np.zeros(0), np.zeros(1))

    def control(self, state, x, x_m, r):
        return COMMAND * r

    def derivative(self, state, x, x_m, r, u):
        return State(state.theta_hat, u * np.ones(1))

    def limit(self, state):
        return state


@dataclass(frozen=True)
class Recording:
    name: str = "recording"

    def bind(self, known):
        return Recorder()


def problem(path):
    plant = Plant(A_m=[[0, 1], [-2, -2]], b=[0, 1], theta=[0.6, -0.4], input=path)
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Constant(1.0))


PATHS = {
    "limits": PlantInput(saturation=[-1, 1]),
    "gain": PlantInput(gain=0.5),
    "delay": PlantInput(delay=0.1),
    "rate": PlantInput(rate_limit=1.0),
    "grid": PlantInput(quantization=2.0),
}


@pytest.mark.parametrize("path", PATHS)
def test_it_is_the_command(path):
    loop = ClosedLoop.of(problem(PATHS[path]), Recording()).following_within(1e-3)
    rates = loop.unpack(loop.derivative(loop.initial(), np.array([1.0] + [0.0] * (loop.signal_count - 1))))
    assert rates.controller.memory == COMMAND


@pytest.mark.parametrize("path", PATHS)
def test_it_is_the_held_command_of_a_sampled_one(path):
    loop = ClosedLoop.of(problem(PATHS[path]), Sampled(Recording(), 0.1, discretization="euler"))
    signals = np.array([1.0] + [0.0] * (loop.signal_count - 1))
    twice = loop.unpack(loop.sample(loop.sample(loop.initial(), signals), signals))
    assert twice.controller.memory == pytest.approx(0.1 * COMMAND)


@pytest.mark.parametrize("cut", [True, False])
def test_a_remedy_against_windup_cuts_it_by_itself(cut):
    """A predictor with the input sat(u) moves identically for every u beyond the limit. A predictor without anti-windup does
    not."""
    l1 = L1Adaptive(gamma=1.0, filter=TransferFunction([20.0], [1.0, 20.0]), saturated_predictor=cut)
    equations, x = l1.bind(problem(PATHS["limits"]).known), np.array([1.0, 0.0])
    rates = [equations.derivative(equations.initial(), x, x, 1.0, np.array(u)) for u in (1.0, COMMAND)]
    assert np.array_equal(rates[0].x_hat, rates[1].x_hat) == cut
