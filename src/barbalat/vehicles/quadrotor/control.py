"""The whole controller of a flight: the position loop around the attitude loop, with geometric control around the schemes of the
axes."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from barbalat.run.kernel.sampled_controller import Agreement, Resumable, Step
from barbalat.validate import Array
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, POSITION_SAMPLE, Axes, Axis
from barbalat.vehicles.quadrotor.geometry import (
    UP,
    AttitudeCommand,
    allocated,
    attitude_errors,
    carried,
    commanded_attitude,
    cross,
    turned,
    wanted_thrust,
)
from barbalat.vehicles.quadrotor.simulator import Motion
from barbalat.vehicles.quadrotor.trajectory import Path
from barbalat.vehicles.vehicle import Aboard

OUTER_EVERY = round(POSITION_SAMPLE / ATTITUDE_SAMPLE)
"""Number of attitude samples per position sample."""


class Memory(NamedTuple):
    """The state of a whole controller between two samples. It is never changed in place."""

    states: tuple[Array, ...]
    wanted: Array
    commanded: Array
    model: AttitudeCommand


class Control:
    """The controller from measurements to thrusts. It is not safe for several threads.

    The position controller's demand contains measurement noise. The attitude's axes therefore follow a model of it, a body that
    obeys the geometric controller at once. Their errors are then due to the vehicle alone, and its command is known.
    """

    def __init__(self, axes: Axes, aboard: Aboard) -> None:
        self.axes, self.name, self.vehicle = axes, aboard.name, axes.hover.vehicle
        self._mixer, self._hover, self._inertia = axes.hover.mixer, axes.hover.thrusts, np.asarray(self.vehicle.inertia)
        steps = [(axis, one.step()) for axis, one in zip(axes.all, aboard.loops, strict=True)]
        self._attitude, self._position = steps[: len(axes.attitude)], steps[len(axes.attitude) :]
        self.reset(np.eye(3), np.zeros(3))

    def reset(self, attitude: Array, rates: Array) -> None:
        """Reset the laws and set the model to the vehicle's state, when control is handed over."""
        for _, step in (*self._attitude, *self._position):
            step.reset()
        self._wanted, self._commanded = wanted_thrust(np.zeros(3)), np.eye(3)
        self._model = AttitudeCommand(attitude, rates, np.zeros(3))

    @property
    def resumable(self) -> bool:
        """Whether the controller's state can be set to that of a different flight. An exported step's state is inaccessible."""
        return len(self._states) == len(self._attitude) + len(self._position)

    @property
    def _states(self) -> list[Array]:
        steps = [step for _, step in (*self._attitude, *self._position)]
        return [step.state for step in steps if isinstance(step, Resumable)]

    @property
    def memory(self) -> Memory:
        """Everything that determines the next sample, except the measurement, for a resumable controller."""
        return Memory(tuple(state.copy() for state in self._states), self._wanted, self._commanded, self._model)

    @memory.setter
    def memory(self, memory: Memory) -> None:
        for state, kept in zip(self._states, memory.states, strict=True):
            state[:] = kept
        _, self._wanted, self._commanded, self._model = memory

    def __call__(self, measured: Motion, planned: Path, k: int) -> Array:
        """Return the thrusts (4,) [N] at sample k."""
        if k % OUTER_EVERY == 0:
            errors = np.column_stack([measured.position - planned.position[k], measured.velocity - planned.velocity[k]])
            self._wanted = wanted_thrust(planned.acceleration[k] + _asked(self._position, errors))
            self._commanded = commanded_attitude(self._wanted)
        self._follow(AttitudeCommand(self._commanded, planned.rates[k], planned.rate_changes[k]))
        R, Omega = measured.attitude, measured.rates
        turning = _asked(self._attitude, attitude_errors(R, Omega, self._model)) + carried(R, Omega, self._model)
        turning += cross(Omega, self._inertia * Omega) / self._inertia
        return allocated(self._mixer, self._hover, self.vehicle.thrust, float(self._wanted @ (R @ UP)), turning)

    def agreement(self) -> Agreement | None:
        """Return the agreement of the exported C of all six axes since the last call, over the samples of one flight."""
        told = [(axis.name, step.agreement()) for axis, step in (*self._attitude, *self._position)]
        named = [
            replace(one, difference=f"{name}: {one.difference}") if one.difference else one
            for name, one in told
            if one is not None
        ]
        return Agreement.together(named, flights=1) if named else None

    def _follow(self, command: AttitudeCommand) -> None:
        """Advance the model by one sample with a held acceleration."""
        R, Omega, acceleration = self._model
        R, Omega = (
            turned(R, ATTITUDE_SAMPLE * (Omega + 0.5 * ATTITUDE_SAMPLE * acceleration)),
            Omega + ATTITUDE_SAMPLE * acceleration,
        )
        errors = attitude_errors(R, Omega, command)
        asked = np.array([axis.feedback(x) for (axis, _), x in zip(self._attitude, errors, strict=True)])
        self._model = AttitudeCommand(R, Omega, asked + carried(R, Omega, command))


def _asked(loops: list[tuple[Axis, Step]], errors: Array) -> Array:
    """Return the sum of the feedback and the scheme's control, each limited, (3,)."""
    return np.array(
        [axis.feedback(x) + axis.limited(float(step(x, 0.0)[0])) for (axis, step), x in zip(loops, errors, strict=True)]
    )
