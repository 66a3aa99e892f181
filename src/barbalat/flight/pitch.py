"""Following a pitch-rate command: the problem that a trimmed aircraft poses, as the schemes read it.

x = (alpha, q) in deviations from trim [deg, deg/s], u the elevator in deviations from its trim [deg], r the commanded pitch rate
[deg/s]. Everything is computed from the linearised flight model; the model to follow is the loop of linear-quadratic feedback.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from barbalat.flight.equipment import Equipment
from barbalat.flight.trim import Trim
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant
from barbalat.problem.reference_model import ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.signals import Constant
from barbalat.validate import Array

SAMPLE_TIME = 0.01
"""[s]."""
COMMANDED = 3.0
"""[deg/s]: pitch rates that are asked for, a load factor of about 0.7 g more or less."""
CROSSOVER = 3.0
"""[rad/s] of the linear-quadratic loop: the pitch rate reaches 63 % of its command in 0.3 s, and the equipment's lag of 0.09 s
takes 15 deg of the phase there."""
RANGE = (10.0, 0.5, 0.5)
"""By how much a trim elevator [deg] and the gains of alpha and q may be off, as the schemes know it: half an elevator asks for
0.6 deg and some tenths, a centre of gravity by 5 % of the chord aft for 1.3 deg and 0.35."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PitchAxis:
    """The pitch axis of a trimmed aircraft with its equipment."""

    trim: Trim
    equipment: Equipment = field(default_factory=Equipment)

    @cached_property
    def gain(self) -> Array:
        """K, (2,): least integral of q^2 + rho u^2 with rho = (M_delta/CROSSOVER)^2, so that the loop's gain is one there."""
        from scipy.linalg import solve_continuous_are

        A, b = self.trim.short_period
        rho = (b[1] / CROSSOVER) ** 2
        P = solve_continuous_are(A, b[:, None], np.diag([0.0, 1.0]), np.array([[rho]]))
        return np.asarray(b @ P / rho)

    @property
    def A_m(self) -> Array:
        A, b = self.trim.short_period
        return np.asarray(A - np.outer(b, self.gain))

    @property
    def k_0(self) -> float:
        """With which the model's pitch rate settles at its command."""
        _, b = self.trim.short_period
        return float(-1 / np.linalg.solve(self.A_m, b)[1])

    @property
    def travel(self) -> tuple[float, float]:
        """What the elevator has left on either side of its trim [deg]."""
        trimmed = float(np.rad2deg(self.trim.elevator))
        return -self.equipment.limit - trimmed, self.equipment.limit - trimmed

    @property
    def linear_problem(self) -> Problem:
        """phi(x) = x: what linear controllers read."""
        _, b = self.trim.short_period
        return self._problem(Plant(A_m=self.A_m, b=b, theta=self.gain, input=self._input))

    @property
    def adaptive_problem(self) -> Problem:
        """phi(x) = (1, x): the trim may be off too. The gains of alpha and q are known up to ``RANGE``."""
        _, b = self.trim.short_period
        nominal = self.nominal
        plant = Plant(A_m=self.A_m, b=b, theta=nominal, input=self._input, regressor=Polynomial(degree=1, constant=True))
        return self._problem(plant, ParameterBox(lower=nominal - RANGE, upper=nominal + RANGE))

    @property
    def nominal(self) -> Array:
        """theta of phi(x) = (1, x) for the linearised aircraft, (3,)."""
        return np.array([0.0, *self.gain])

    @property
    def _input(self) -> PlantInput:
        return PlantInput(saturation=self.travel)

    def _problem(self, plant: Plant, known: ParameterBox | None = None) -> Problem:
        return Problem(
            plant=plant,
            reference_model=ReferenceModel(k_0=self.k_0),
            reference=Constant(0.0),
            uncertainty=known,
            name="F-16, pitch rate",
        )
