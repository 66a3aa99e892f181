"""The six axes on which schemes act, three of the attitude and three of the position, in the form that schemes expect.

The state of an axis is x = (e, e'), which is e_R [rad] and e_Omega [rad/s], or the error of position [m] and of velocity [m/s]. u
is an acceleration [rad/s^2] or [m/s^2]. The feedback -K x of the geometric controller is always active, and a scheme adds u to
it. The scheme's plant is therefore x' = A_m x + b (theta'phi(x) + u) with A_m = A - b K, where theta is zero unless something
fails. The only command is e = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.signals import Constant
from barbalat.validate import Array
from barbalat.vehicles.quadrotor.body import GRAVITY
from barbalat.vehicles.quadrotor.hover import Hover

PHASE = np.pi / 6
"""Phase lost to the lag at the crossover of each loop [rad]. Half of the 65 deg of a double integrator with linear-quadratic
feedback then remains for unmodelled effects."""
CROSSOVER = 1.55
"""Crossover frequency of the linear-quadratic feedback divided by its natural frequency. At the crossover |sqrt(2) s + 1| =
|s|^2."""
YAW_SHARE = 0.4
"""Natural frequency of yaw, as a fraction of the natural frequency of roll and pitch. Rotors produce yaw only by drag, whose
moment is a tenth of the moment of lift."""
ATTITUDE_SAMPLE, POSITION_SAMPLE = 1 / 400, 1 / 100
"""Sample times of the attitude and the position controllers [s]."""
MOMENT_SHARE = 1 / 3
"""Moment limit of each of roll, pitch and yaw, as a fraction of the hover thrust. With all three at their limits, no rotor's
thrust is below zero at hover."""
ADDED_SHARE = 0.5
"""The scheme's fraction of an axis's authority. The feedback has the rest, so neither limits the other, and a predictor knows the
limit on u. Half of the position authority lifts an additional 35 % of the mass."""
MET_SHARE = 0.5
"""The disturbance of an axis whose problem is simulated alone or exported, as a fraction of the limit of the scheme. Without it
the axis would stay at rest."""
TILT = np.deg2rad(35.0)
"""Largest tilt of the position control relative to the tilt that the path demands. It limits the acceleration to g times its
tangent, horizontally, upwards and downwards."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis:
    """One axis.

    A, b         the matrices of x = (e, e') for u
    frequency    the natural frequency of the feedback [rad/s]
    lag          the lag between u and its effect at low frequencies [s]
    limit        the limit on u on both sides, which is also the limit on the feedback
    size         the typical size of the errors
    like         the axis with the same linear model, on which settings are found: "roll", "yaw" or "forward"
    """

    name: str
    like: str
    A: Array
    b: Array
    frequency: float
    lag: float
    sample_time: float
    limit: float
    size: float

    @cached_property
    def gain(self) -> Array:
        """K (2,), which minimises the integral of e^2 + u^2/frequency^4. The damping ratio is 0.71."""
        from scipy.linalg import solve_continuous_are

        rho = self.frequency**-4
        P = solve_continuous_are(self.A, self.b[:, None], np.diag([1.0, 0.0]), np.array([[rho]]))
        return np.asarray(self.b @ P / rho)

    @cached_property
    def A_m(self) -> Array:
        return np.asarray(self.A - np.outer(self.b, self.gain))

    @property
    def range(self) -> Array:
        """The known bounds of theta for phi(x) = (1, x), (3,): the whole limit and half of each gain."""
        return np.array([self.limit, *(0.5 * self.gain)])

    @property
    def time_unit(self) -> float:
        """The lag [s], because bandwidths are multiples of its inverse."""
        return self.lag

    @property
    def frequency_unit(self) -> float:
        """The feedback's natural frequency [rad/s], of which adaptation frequencies are multiples."""
        return self.frequency

    @property
    def met(self) -> Array:
        """Typical magnitudes of 1 and x in flight (3,)."""
        return np.array([1.0, self.size, self.size * self.frequency])

    @property
    def known_gain(self) -> None:
        """None, because A_m already contains the feedback of the geometric controller."""

    @property
    def theta_hat0(self) -> None:
        """None, because adaptive schemes begin at zero."""

    def feedback(self, errors: Array) -> float:
        """Return -K x, limited."""
        return self.limited(-float(self.gain @ errors))

    def limited(self, u: float) -> float:
        return min(max(u, -self.limit), self.limit)

    @cached_property
    def linear_problem(self) -> Problem:
        """The problem with phi(x) = x."""
        return self._problem(Plant(A_m=self.A_m, b=self.b, theta=np.zeros(2), input=self._input))

    @cached_property
    def adaptive_problem(self) -> Problem:
        """The problem with phi(x) = (1, x)."""
        regressor = Polynomial(degree=1, constant=True)
        plant = Plant(A_m=self.A_m, b=self.b, theta=np.zeros(3), input=self._input, regressor=regressor)
        return self._problem(plant, ParameterBox(lower=-self.range, upper=self.range))

    @property
    def _input(self) -> PlantInput:
        return PlantInput(saturation=(-self.limit, self.limit))

    def _problem(self, plant: Plant, known: ParameterBox | None = None) -> Problem:
        return Problem(
            plant=plant,
            reference_model=ReferenceModel(k_0=float(self.frequency**2)),
            reference=Constant(0.0),
            disturbance=Constant(MET_SHARE * self.limit),
            uncertainty=known,
            name=f"Quadrotor, {self.name}",
        )


@dataclass(frozen=True, kw_only=True)
class Electronics:
    """The hardware between the vehicle and its controllers.

    delay           delay from a sample to the motor command [s]
    rate_lag        lag of the first-order rate sensors [s]
    attitude_noise  standard deviation of white noise at the samples [rad]; likewise the others [rad/s, m, m/s]
    """

    delay: float = 0.005
    rate_lag: float = 0.0
    attitude_noise: float = 0.003
    rate_noise: float = 0.02
    position_noise: float = 0.005
    velocity_noise: float = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class Axes:
    """All six axes, designed as cascades. The lag of the position loop is the lag of the attitude loop."""

    hover: Hover
    electronics: Electronics = field(default_factory=Electronics)

    @cached_property
    def attitude(self) -> tuple[Axis, ...]:
        """The axes of roll, pitch and yaw, in this order."""
        lag = self.hover.vehicle.motor_lag + self.electronics.delay + ATTITUDE_SAMPLE / 2
        fast = PHASE / (CROSSOVER * lag)
        return tuple(
            Axis(
                name=name, like=like, A=self._block(3 + i, 9 + i), b=(self.hover.B @ self.hover.mixer[:, 1 + i])[[3 + i, 9 + i]],
                frequency=frequency, lag=lag, sample_time=ATTITUDE_SAMPLE, size=0.1,
                limit=ADDED_SHARE * MOMENT_SHARE * self._moment(1 + i),
            )
            for i, (name, like, frequency) in enumerate(
                (("roll", "roll", fast), ("pitch", "roll", fast), ("yaw", "yaw", YAW_SHARE * fast))
            )
        )  # fmt: skip

    @cached_property
    def position(self) -> tuple[Axis, ...]:
        """The axes of forward, left and up, in this order."""
        roll = self.attitude[0]
        lag = float(roll.gain[1] / roll.gain[0])  # lag of the closed attitude loop
        limit = ADDED_SHARE * GRAVITY * np.tan(TILT)
        frequency = PHASE / (CROSSOVER * lag)
        return tuple(
            Axis(
                name=name, like="forward", A=self._block(i, 6 + i), b=np.array([0.0, 1.0]), frequency=frequency, lag=lag,
                sample_time=POSITION_SAMPLE, size=0.3, limit=limit,
            )
            for i, name in enumerate(("forward", "left", "up"))
        )  # fmt: skip

    @property
    def all(self) -> tuple[Axis, ...]:
        """The axes of the attitude, followed by those of the position."""
        return self.attitude + self.position

    def _block(self, *rows: int) -> Array:
        return np.asarray(self.hover.A[np.ix_(rows, rows)])

    def _moment(self, column: int) -> float:
        """Return the angular acceleration that reduces a rotor's thrust from hover to zero [rad/s^2]."""
        return float(self.hover.thrusts.min() / np.abs(self.hover.mixer[:, column]).max())
