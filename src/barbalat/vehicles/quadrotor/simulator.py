"""The quadrotor in MuJoCo, whose state can be set, whose motion can be stepped, and whose accelerations can be read."""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np

from barbalat.validate import Array, require_extra
from barbalat.vehicles.quadrotor.body import INTEGRATOR, SLOPE, STEP, Quadrotor, SlungMass, mjcf

ROTORS = 4
BODY_COORDINATES = 7
"""Number of coordinates of a free body: three for its position and four for its quaternion."""


def _unheard(_: str) -> None:
    """Ignore MuJoCo's warnings, which would otherwise be written to a file. They concern NaNs, for which flights are checked
    anyway."""


class Motion(NamedTuple):
    """The motion of a rigid body. All quantities except the rates are in fixed axes that point forward, left and up at the
    start."""

    position: Array  # (3,) [m]
    attitude: Array  # (3, 3), whose columns are the body's axes
    velocity: Array  # (3,) [m/s]
    rates: Array  # (3,) [rad/s], about the body's axes


class Simulator:
    """A quadrotor, at rest on the ground with stopped rotors."""

    def __init__(self, vehicle: Quadrotor, *, step: float = STEP, integrator: str = INTEGRATOR) -> None:
        require_extra("mujoco", "flight", "a flight model")
        self.vehicle, self.step, self.integrator = vehicle, step, integrator
        self._load(None)

    def _load(self, slung: SlungMass | None) -> None:
        import mujoco

        self.mujoco = mujoco
        mujoco.set_mju_user_warning(_unheard)
        text = mjcf(self.vehicle, slung=slung, step=self.step, integrator=self.integrator)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.body = self.model.body("vehicle").id

    def put(self, motion: Motion, thrusts: Array) -> None:
        """Set the state, with rotors settled at their thrusts (4,) [N]."""
        data, quaternion = self.data, np.empty(4)
        self.mujoco.mju_mat2Quat(quaternion, motion.attitude.reshape(-1))
        data.qpos[:3], data.qpos[3:BODY_COORDINATES] = motion.position, quaternion
        data.qvel[:3], data.qvel[3:6] = motion.velocity, motion.rates
        data.act[:] = data.ctrl[:] = thrusts
        self.mujoco.mj_forward(self.model, data)

    def stand(self, forward: float, left: float, heading: float) -> None:
        """Place the vehicle at rest elsewhere on the ground, which rises to the left, and turn it about the normal of the ground
        [m, m, deg]."""
        data, slope, turn = self.data, np.deg2rad(SLOPE), np.deg2rad(heading) / 2
        data.qpos[:3] += forward, left, left * np.tan(slope)
        upright = data.qpos[3:BODY_COORDINATES].copy()
        self.mujoco.mju_mulQuat(data.qpos[3:BODY_COORDINATES], upright, np.array([np.cos(turn), 0.0, 0.0, np.sin(turn)]))
        self.mujoco.mj_forward(self.model, data)

    def copied(self) -> Simulator:
        """Return an independent copy in the same state."""
        found = copy.copy(self)
        found.model, found.data = copy.copy(self.model), copy.copy(self.data)
        return found

    def advance(self, commands: Array, steps: int = 1) -> None:
        """Advance by this number of steps with these commanded thrusts (4,) [N]. The thrust of a rotor is limited to its
        range."""
        self.data.ctrl[:] = commands
        self.mujoco.mj_step(self.model, self.data, steps)

    def hook_on(self, slung: SlungMass) -> None:
        """Attach a mass that hangs vertically below the vehicle and initially has its velocity."""
        before, effectiveness, lags = self.data, self.model.actuator_gainprm.copy(), self.model.actuator_dynprm.copy()
        wind = self.model.opt.wind.copy()
        self._load(slung)
        self.model.actuator_gainprm[:], self.model.actuator_dynprm[:], self.model.opt.wind[:] = effectiveness, lags, wind
        self.data.qpos[:BODY_COORDINATES], self.data.qvel[:6], self.data.act[:] = (
            before.qpos[:BODY_COORDINATES],
            before.qvel[:6],
            before.act,
        )
        self.data.time = before.time
        self.mujoco.mju_negQuat(
            self.data.qpos[BODY_COORDINATES:], before.qpos[3:BODY_COORDINATES]
        )  # the cable hangs vertically at any attitude of the vehicle
        self.mujoco.mju_rotVecQuat(turning := np.empty(3), before.qvel[3:6], before.qpos[3:BODY_COORDINATES])
        self.mujoco.mju_rotVecQuat(
            self.data.qvel[6:9], -turning, before.qpos[3:BODY_COORDINATES]
        )  # and does not turn with the vehicle
        self.mujoco.mj_forward(self.model, self.data)

    def weaken(self, rotor: int, effectiveness: float) -> None:
        """Scale a rotor's thrust and torque."""
        self.model.actuator_gainprm[rotor, 0] = effectiveness

    def slow_down(self, motor_lag: float) -> None:
        """Set the lag of all motors [s]."""
        self.model.actuator_dynprm[:, 0] = motor_lag

    def blow(self, wind: Array) -> None:
        """Set the velocity of the air (3,) [m/s]."""
        self.model.opt.wind[:] = wind

    @property
    def motion(self) -> Motion:
        """The current motion."""
        data, attitude = self.data, np.empty(9)
        self.mujoco.mju_quat2Mat(attitude, data.qpos[3:BODY_COORDINATES])
        return Motion(data.qpos[:3].copy(), attitude.reshape(3, 3), data.qvel[:3].copy(), data.qvel[3:6].copy())

    @property
    def thrusts(self) -> Array:
        """The rotors' thrusts (4,) [N]."""
        return np.asarray(self.data.actuator_force.copy())

    @property
    def accelerations(self) -> Array:
        """The derivatives (6,) of the velocity [m/s^2] and of the body's rates [rad/s^2] in the current state."""
        self.mujoco.mj_forward(self.model, self.data)
        return np.asarray(self.data.qacc[:6].copy())

    @property
    def energy(self) -> float:
        """The kinetic plus the potential energy [J]."""
        self.model.opt.enableflags |= self.mujoco.mjtEnableBit.mjENBL_ENERGY
        self.mujoco.mj_forward(self.model, self.data)
        return float(self.data.energy.sum())
