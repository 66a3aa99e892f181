"""Following a rate command: the problem of a trimmed aircraft about one of its axes, as the schemes read it.

x are deviations from trim [deg, deg/s], u the surface's deviation from its trim [deg], r the commanded rate [deg/s]. Everything
is computed from the linearised flight model; the reference model is the loop with linear-quadratic feedback.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.signals import Steps
from barbalat.validate import Array
from barbalat.vehicles.f16.airframe import Motion, Surfaces
from barbalat.vehicles.f16.equipment import Equipment
from barbalat.vehicles.f16.trim import Trim

SAMPLE_TIME = 0.01
"""The controllers' sample time [s]."""
COMMAND_STARTS = (1.0, 11.0, 21.0)
"""Times at which commands begin [s], one before the failure and two after it."""
RESTING_SECONDS = 2.0
"""Time between a command's two pulses [s]."""


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Which rate is followed, with which surface.

    states      of ``Motion``, measured and fed back
    rate        the one of them that follows the command
    surface     of ``Surfaces``
    attitude    of ``Motion``, the angle that the rate changes
    commanded   [deg/s]
    pulse       [s], the duration of the command in each direction
    crossover   [rad/s] of the linear-quadratic loop
    met         [deg, deg/s], typical magnitudes of the regressors 1 and x in such flights, by which adaptive gains are scaled
    off         the uncertainty of the surface's trim [deg] and of the gains of x, as known to the schemes
    equipment   the hardware between controller and aircraft
    """

    name: str
    meaning: str
    states: tuple[str, ...]
    rate: str
    surface: str
    attitude: str
    commanded: float
    pulse: float
    crossover: float
    met: tuple[float, ...]
    off: tuple[float, ...]
    equipment: Equipment

    @property
    def command(self) -> Steps:
        """The commanded rate: a pulse and its opposite, each ten seconds."""
        lags = (0.0, self.pulse, self.pulse + RESTING_SECONDS, 2 * self.pulse + RESTING_SECONDS)
        times = tuple(start + lag for start in COMMAND_STARTS for lag in lags)
        return Steps(times=times, values=(self.commanded, 0.0, -self.commanded, 0.0) * len(COMMAND_STARTS))

    @property
    def places(self) -> tuple[int, ...]:
        """Indices of the states in a ``Motion``."""
        return tuple(Motion._fields.index(name) for name in self.states)


PITCH = Followed(
    name="f16-pitch",
    meaning="the F-16 follows a pitch-rate command",
    states=("alpha", "q"),
    rate="q",
    surface="elevator",
    attitude="theta",
    commanded=3.0,  # changes the load factor by about 0.7 g
    pulse=2.0,
    # the pitch rate reaches 63 % of its command in 0.3 s, and the equipment's lag of 0.09 s takes 15 deg of the phase there
    crossover=3.0,
    met=(1.0, 3.0, 3.0),
    # half an elevator needs 0.6 deg and some tenths, a centre of gravity 5 % of the chord further aft needs 1.3 deg and 0.35
    off=(10.0, 0.5, 0.5),
    equipment=Equipment(),
)
ROLL = Followed(
    name="f16-roll",
    meaning="the F-16 follows a roll-rate command",
    states=("beta", "p", "r"),
    rate="p",
    surface="aileron",
    attitude="phi",
    commanded=20.0,  # 30 deg of bank in a pulse
    pulse=1.5,
    crossover=3.0,  # as in pitch; the bare roll mode is at 2.4 rad/s
    met=(1.0, 1.0, 20.0, 2.0),
    # half the ailerons need twice the gains, some hundredths of p's and tenths of beta's; 2000 lb off the middle need 3 deg
    off=(10.0, 2.0, 0.2, 0.5),
    equipment=Equipment(rate_limit=80.0, limit=21.5),  # of the ailerons: Stevens and Lewis, as above
)
AXES = {one.name: one for one in (PITCH, ROLL)}
"""The axes, by their names on the command line."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis:
    """One axis of a trimmed aircraft."""

    trim: Trim
    followed: Followed = PITCH

    @property
    def equipment(self) -> Equipment:
        """The hardware between controller and aircraft."""
        return self.followed.equipment

    @cached_property
    def model(self) -> tuple[Array, Array]:
        """A (n, n) and b (n,) of the states for the surface, in degrees as in radians."""
        rows = np.array(self.followed.places)
        return self.trim.A[np.ix_(rows, rows)], self.trim.B[rows, self.surface]

    @property
    def surface(self) -> int:
        """Its place in ``Surfaces``."""
        return Surfaces._fields.index(self.followed.surface)

    @property
    def rate(self) -> int:
        """The followed rate's index in x."""
        return self.followed.states.index(self.followed.rate)

    @property
    def surface_trim(self) -> float:
        """The deflection of the axis' surface in trimmed flight [deg]."""
        return float(np.rad2deg(self.trim.surfaces[self.surface]))

    @cached_property
    def gain(self) -> Array:
        """K, (n,): least integral of rate^2 + rho u^2 with rho = (b_rate/crossover)^2, so that the loop's gain is one there."""
        from scipy.linalg import solve_continuous_are

        A, b = self.model
        weight = np.zeros((len(b), len(b)))
        weight[self.rate, self.rate] = 1.0
        rho = (b[self.rate] / self.followed.crossover) ** 2
        P = solve_continuous_are(A, b[:, None], weight, np.array([[rho]]))
        return np.asarray(b @ P / rho)

    @property
    def A_m(self) -> Array:
        A, b = self.model
        return np.asarray(A - np.outer(b, self.gain))

    @property
    def k_0(self) -> float:
        """The gain with which the model's rate settles at its command."""
        _, b = self.model
        return float(-1 / np.linalg.solve(self.A_m, b)[self.rate])

    @property
    def travel(self) -> tuple[float, float]:
        """The remaining deflection on either side of the trim [deg]."""
        limit, trimmed = self.equipment.limit, self.surface_trim
        return -limit - trimmed, limit - trimmed

    @property
    def like(self) -> str:
        """The condition on whose linear model the schemes' numbers were found: its own."""
        return self.followed.name

    @property
    def sample_time(self) -> float:
        """The flight computer's sample time [s]."""
        return SAMPLE_TIME

    @property
    def time_unit(self) -> float:
        """Bandwidths are in rad/s."""
        return 1.0

    @property
    def frequency_unit(self) -> float:
        """So are adaptation frequencies."""
        return 1.0

    @property
    def met(self) -> Array:
        """(1 + n,), typical magnitudes of 1 and x in such flights."""
        return np.array(self.followed.met)

    @property
    def known_gain(self) -> Array:
        """(n,) of the linear-quadratic feedback, with which every scheme starts."""
        return self.gain

    @property
    def theta_hat0(self) -> Array:
        """(1 + n,), the initial estimates of adaptive schemes."""
        return self.nominal

    @property
    def linear_problem(self) -> Problem:
        """phi(x) = x, for linear controllers."""
        _, b = self.model
        return self._problem(Plant(A_m=self.A_m, b=b, theta=self.gain, input=self._input))

    @property
    def adaptive_problem(self) -> Problem:
        """phi(x) = (1, x): the trim may also be wrong. The gains of x are known up to ``Followed.off``."""
        _, b = self.model
        nominal, off = self.nominal, np.array(self.followed.off)
        plant = Plant(A_m=self.A_m, b=b, theta=nominal, input=self._input, regressor=Polynomial(degree=1, constant=True))
        return self._problem(plant, ParameterBox(lower=nominal - off, upper=nominal + off))

    @property
    def nominal(self) -> Array:
        """theta of phi(x) = (1, x) for the linearised aircraft, (1 + n,)."""
        return np.array([0.0, *self.gain])

    @property
    def _input(self) -> PlantInput:
        return PlantInput(saturation=self.travel)

    def _problem(self, plant: Plant, known: ParameterBox | None = None) -> Problem:
        return Problem(
            plant=plant,
            reference_model=ReferenceModel(k_0=self.k_0),
            reference=self.followed.command,
            uncertainty=known,
            name=self.followed.meaning,
        )
