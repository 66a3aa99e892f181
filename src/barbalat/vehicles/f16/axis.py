"""The problem of a trimmed aircraft that follows a rate command about one of its axes, in the form that the schemes expect.

x are deviations from trim [deg, deg/s], u is the deviation of the surface from trim [deg], and r is the commanded rate [deg/s].
Everything is computed from the linearised flight model. The reference model is the loop with linear-quadratic feedback.
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
"""Times at which commands begin [s]: one command before the failure and two after it."""
RESTING_SECONDS = 2.0
"""Time between the two pulses of a command [s]."""


@dataclass(frozen=True, kw_only=True)
class Followed:
    """A rate that follows its command, and the surface that controls it.

    states      the entries of ``Motion`` that are measured and fed back
    rate        the state that follows the command
    surface     an entry of ``Surfaces``
    attitude    the entry of ``Motion`` that the rate changes
    commanded   size of the command [deg/s]
    pulse       duration of the command in each direction [s]
    crossover   crossover of the linear-quadratic loop [rad/s]
    met         typical magnitudes of the regressors 1 and x in such flights [deg, deg/s], by which adaptive gains are scaled
    off         the uncertainty of the surface trim [deg] and of the gains of x, which the schemes know
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
        """The commanded rate: a pulse followed by its opposite, every ten seconds."""
        lags = (0.0, self.pulse, self.pulse + RESTING_SECONDS, 2 * self.pulse + RESTING_SECONDS)
        times = tuple(start + lag for start in COMMAND_STARTS for lag in lags)
        return Steps(times=times, values=(self.commanded, 0.0, -self.commanded, 0.0) * len(COMMAND_STARTS))

    @property
    def places(self) -> tuple[int, ...]:
        """The indices of the states in a ``Motion``."""
        return tuple(Motion._fields.index(name) for name in self.states)


PITCH = Followed(
    name="f16-pitch",
    meaning="the F-16 tracks a pitch-rate command",
    states=("alpha", "q"),
    rate="q",
    surface="elevator",
    attitude="theta",
    commanded=3.0,  # changes the load factor by about 0.7 g
    pulse=2.0,
    # the pitch rate reaches 63 % of its command in 0.3 s; there the equipment lag of 0.09 s costs 15 deg of phase
    crossover=3.0,
    met=(1.0, 3.0, 3.0),
    # With half the elevator effectiveness, trim is off by 0.6 deg and the gains by a few tenths. With a centre of gravity 5 % of
    # the chord further aft, trim is off by 1.3 deg and the gains by 0.35.
    off=(10.0, 0.5, 0.5),
    equipment=Equipment(),
)
ROLL = Followed(
    name="f16-roll",
    meaning="the F-16 tracks a roll-rate command",
    states=("beta", "p", "r"),
    rate="p",
    surface="aileron",
    attitude="phi",
    commanded=20.0,  # 30 deg of bank in a pulse
    pulse=1.5,
    crossover=3.0,  # as in pitch; the bare roll mode is at 2.4 rad/s
    met=(1.0, 1.0, 20.0, 2.0),
    # With half the aileron effectiveness, the gains are off by as much as their size, a few hundredths for p and a few tenths for
    # beta. With 2000 lb off the middle, trim is off by 3 deg.
    off=(10.0, 2.0, 0.2, 0.5),
    equipment=Equipment(rate_limit=80.0, limit=21.5),  # data of the ailerons: Stevens and Lewis, as above
)
AXES = {one.name: one for one in (PITCH, ROLL)}
"""The axes by their names on the command line."""


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
        """A (n, n) and b (n,) of the states for the surface, which are the same in degrees and in radians."""
        rows = np.array(self.followed.places)
        return self.trim.A[np.ix_(rows, rows)], self.trim.B[rows, self.surface]

    @property
    def surface(self) -> int:
        """The surface's index in ``Surfaces``."""
        return Surfaces._fields.index(self.followed.surface)

    @property
    def rate(self) -> int:
        """The index of the followed rate in x."""
        return self.followed.states.index(self.followed.rate)

    @property
    def surface_trim(self) -> float:
        """The deflection of the control surface in trimmed flight [deg]."""
        return float(np.rad2deg(self.trim.surfaces[self.surface]))

    @cached_property
    def gain(self) -> Array:
        """K (n,), which minimises the integral of rate^2 + rho u^2. With rho = (b_rate/crossover)^2 the loop's gain is one at the
        crossover."""
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
        """The gain of the command with which the model's rate settles at the command."""
        _, b = self.model
        return float(-1 / np.linalg.solve(self.A_m, b)[self.rate])

    @property
    def travel(self) -> tuple[float, float]:
        """The available deflection on either side of the trim [deg]."""
        limit, trimmed = self.equipment.limit, self.surface_trim
        return -limit - trimmed, limit - trimmed

    @property
    def like(self) -> str:
        """The condition on whose linear model the parameters of the schemes were found: here, the condition of the axis."""
        return self.followed.name

    @property
    def sample_time(self) -> float:
        """The sample time of the flight computer [s]."""
        return SAMPLE_TIME

    @property
    def time_unit(self) -> float:
        """One second, because bandwidths are in rad/s."""
        return 1.0

    @property
    def frequency_unit(self) -> float:
        """One rad/s, because adaptation frequencies are in rad/s."""
        return 1.0

    @property
    def met(self) -> Array:
        """Typical magnitudes of 1 and x in such flights (1 + n,)."""
        return np.array(self.followed.met)

    @property
    def known_gain(self) -> Array:
        """The gain of the linear-quadratic feedback (n,), with which every scheme starts."""
        return self.gain

    @property
    def theta_hat0(self) -> Array:
        """The initial estimates of adaptive schemes (1 + n,)."""
        return self.nominal

    @property
    def linear_problem(self) -> Problem:
        """The problem with phi(x) = x, for linear controllers."""
        _, b = self.model
        return self._problem(Plant(A_m=self.A_m, b=b, theta=self.gain, input=self._input))

    @property
    def adaptive_problem(self) -> Problem:
        """The problem with phi(x) = (1, x), because the trim may also be wrong. The gains of x are known up to
        ``Followed.off``."""
        _, b = self.model
        nominal, off = self.nominal, np.array(self.followed.off)
        plant = Plant(A_m=self.A_m, b=b, theta=nominal, input=self._input, regressor=Polynomial(degree=1, constant=True))
        return self._problem(plant, ParameterBox(lower=nominal - off, upper=nominal + off))

    @property
    def nominal(self) -> Array:
        """theta (1 + n,) of the linearised aircraft for phi(x) = (1, x)."""
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
