"""The quadrotor's axes for the rule of ``flight_tuning``: the whole loop, of which a scheme is only a part.

The plant is an axis at hover behind its lags: for the attitude the motors and the command delay, for the position also the
attitude loop. It follows a model of its command as in flight. The input is the sum of the model's acceleration, the feedback of
the error and the scheme's part, and the last two each have a limit. The margins are those of the whole loop. The command is as
large as the errors in flights. From ``OFF_AT`` on a constant disturbance uses a fraction of the scheme's limit. All measurements
have the flights' noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat import Plant, Problem, ReferenceModel, Simulation, TransferFunction
from barbalat.cases.build import Case
from barbalat.comparison.contest.entrant import Entrant
from barbalat.comparison.contest.rule import Rule
from barbalat.comparison.contest.tuned import Qualified, qualify
from barbalat.comparison.search.aim import Plants
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.judge.settings import Judge
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.protocols import Controller, Sample, SampledEquations, Value
from barbalat.roles import Role, declared_roles
from barbalat.signals import Step, Steps
from barbalat.study.verdicts import Criterion
from barbalat.validate import Array
from barbalat.vehicles.quadrotor.axes import Axes, Axis
from barbalat.vehicles.quadrotor.schemes import SCHEMES
from barbalat.vehicles.schemes import OnLoop

DELAY_SHARE, GAIN_MARGIN = 0.5, 1.5
"""Required delay margin with a scheme, as a fraction of the delay margin of the feedback alone; and the required gain margin of
3.5 dB as a factor, which the contest chose because the position's loop alone has only a factor of 1.9."""
T_END, OFF_AT, STEPS_AT = 40.0, 16.0, (4.0, 10.0, 28.0, 34.0)
"""Times relative to the axis' natural frequency: the command steps there and back before the disturbance and where runs are
judged."""
DISTURBANCE = 0.25
"""Disturbance as a fraction of the limits of the scheme and the feedback. With half of the input's effectiveness the feedback
alone still compensates it."""
KNOB_VALUES = 24


@dataclass(frozen=True, eq=False)
class Both:
    """The inputs of an axis: the model's acceleration, the feedback and the scheme's part. The last two are computed from
    errors."""

    added: SampledEquations
    gain: Array
    k_0: float
    limit: float

    @property
    def sample_time(self) -> float:
        return self.added.sample_time

    @property
    def roles(self) -> Mapping[str, Role]:
        return declared_roles(self.added) or {}

    def initial(self) -> NamedTuple:
        return self.added.initial()

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        error = Sample(x - x_m, 0 * x_m, 0 * r)
        asked = np.clip(-(self.gain @ error.x), -self.limit, self.limit)
        return self.k_0 * r - self.gain @ x_m + asked + np.clip(self.added.control(state, *error), -self.limit, self.limit)

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> NamedTuple:
        errors = [Sample(one.x - one.x_m, 0 * one.x_m, 0 * one.r) for one in (before, now)]
        return self.added.advance(state, errors[0], self.added.control(state, *errors[0]), errors[1])


@dataclass(frozen=True, eq=False)
class WithFeedback:
    """A scheme on an axis, together with the feedback, as one controller of the whole loop."""

    axis: Axis
    scheme: OnLoop

    @property
    def name(self) -> str:
        return self.scheme.controller.name

    def bind(self, known: object) -> Both:
        added = self.scheme.controller.bind(self.scheme.problem.known)
        assert isinstance(added, SampledEquations)
        return Both(added, self.axis.gain, float(self.axis.frequency**2), self.axis.limit)


def lagging(axes: Axes, axis: Axis) -> PlantInput:
    """The dynamics ahead of an axis."""
    motors, way = axes.hover.vehicle.motor_lag, axes.electronics.delay
    if axis in axes.attitude:
        actuator, delay = TransferFunction([1.0], [motors, 1.0]), way
    else:
        stiffness, damping = axes.attitude[0].gain
        actuator, delay = TransferFunction([stiffness], [1.0, damping, stiffness]), motors + way
    return PlantInput(actuator=actuator, delay=delay)


def tolerated_alone(axes: Axes, axis: Axis) -> float:
    """The delay margin of the feedback behind the lags and half a sample, from the linear loop [s]."""
    path = lagging(axes, axis)
    assert path.actuator is not None
    loop = StateSpace(axis.A, axis.b, axis.gain, 0.0)
    lag = path.actuator.realise()
    whole = StateSpace(
        np.block([[loop.A, np.outer(loop.B, lag.C)], [np.zeros((lag.order, loop.order)), lag.A]]),
        np.concatenate([loop.B * lag.D, lag.B]),
        np.concatenate([loop.C, np.zeros(lag.order)]),
        0.0,
    )
    return margins(whole, path.delay + axis.sample_time / 2).delay


def as_linearised(axes: Axes, axis: Axis) -> Problem:
    """The whole loop of an axis."""
    electronics = axes.electronics
    if axis in axes.attitude:
        noise = (electronics.attitude_noise, electronics.rate_noise)
    else:
        noise = (electronics.position_noise, electronics.velocity_noise)
    return Problem(
        plant=Plant(A_m=axis.A_m, b=axis.b, theta=axis.gain, input=lagging(axes, axis)),
        reference_model=ReferenceModel(k_0=float(axis.frequency**2)),
        reference=Steps(times=tuple(_samples(axis, at) for at in STEPS_AT), values=(axis.size, 0.0, -axis.size, 0.0)),
        disturbance=Step(amplitude=DISTURBANCE * axis.limit, start=_samples(axis, OFF_AT)),
        sensor=Sensor(noise=Noise(std=noise, sample_time=axis.sample_time)),
        name=f"Quadrotor, {axis.name}",
    )


def _samples(axis: Axis, of_frequency: float) -> float:
    """A time [s] rounded to a whole number of samples."""
    return axis.sample_time * round(of_frequency / (axis.frequency * axis.sample_time))


def rule_of(axes: Axes, axis: Axis, trials: int) -> Rule:
    """The rule of one axis."""
    delay = float(f"{DELAY_SHARE * tolerated_alone(axes, axis):.2g}")
    return Rule(delay_margin=delay, gain_margin=GAIN_MARGIN, until=Criterion.LOSS, plants=1, trials=trials)


def tuned(axes: Axes, axis: Axis, scheme: str, rule: Rule) -> Qualified:
    """The result of the rule for one scheme on an axis."""
    contestant = SCHEMES[scheme]

    def made(**numbers: float) -> Controller:
        return WithFeedback(axis, contestant.make(axis, numbers))

    values = {knob: np.geomspace(low, high, KNOB_VALUES) for knob, (low, high) in contestant.knobs.items()}
    least = made(**{knob: float(tried[0]) for knob, tried in values.items()})
    problem = as_linearised(axes, axis)
    simulation = Simulation(t_end=_samples(axis, T_END), dt=axis.sample_time)
    plants = Plants.of(Case(problem, (least,), simulation), rule.aim, [problem])
    entrant = Entrant(knobs=TuningGrid(scheme=scheme, values=values, make=made))
    return qualify(entrant, rule, plants, simulation, judge=Judge())
