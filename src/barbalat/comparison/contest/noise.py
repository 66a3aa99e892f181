"""Measurement noise for a contest whose case has none: without any, the fastest loop that the margins admit would be the best."""

from __future__ import annotations

from dataclasses import replace

from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.study.motion import ModelMotion
from barbalat.validate import InputError

DEFAULT_SHARE = 1e-3
"""Of the model's largest motion, in each state: about one bit of ten, as of a plain sensor."""


def with_noise(problem: Problem, share: float, simulation: Simulation, sample_time: float, seed: int) -> Problem:
    """The problem, with Gaussian noise where it has none; ``share`` 0 leaves it without.

    sample_time  about how long a value is held [s]: the nearest whole number of solver steps
    """
    if problem.noise is not None or share == 0:
        return problem
    if not 0 < share < 1:
        raise InputError(f"noise must be a share of the model's motion, at least 0 and below 1, got {share:g}")
    steps = max(round(sample_time / simulation.dt), 1)
    held = simulation.dt * steps
    noise = Noise(std=[share * each for each in ModelMotion.of(problem, simulation).of_each], sample_time=held, seed=seed)
    sensor = Sensor(noise=noise) if problem.sensor is None else replace(problem.sensor, noise=noise)
    return replace(problem, sensor=sensor)
