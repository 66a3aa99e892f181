"""What a method's own damping makes of a loop's oscillations: ringing that a run inside of every limit does not show."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from barbalat.solvers import Tableau
from barbalat.validate import Array

RESOLVED_TURN = 1.0
"""h omega [rad] up to which nothing is said: six steps a period, where RK4 damps by 0.6 % a radian; Heun and Euler amplify."""


@dataclass(frozen=True)
class SolverDamping:
    """How the method damps an oscillation of the loop that it does not resolve, where the equations need not damp it at all.

    per_radian  the part of an undamped oscillation's amplitude that the method takes away a radian, at the worst instant
    h_omega     the step times the frequency there [rad]
    solver      the method's name
    """

    per_radian: float
    h_omega: float
    solver: str

    @property
    def sentence(self) -> str:
        """The same for people."""
        return (
            f"{self.solver} at this step damps an oscillation as fast as the loop's (h omega = {self.h_omega:.3g}) by up to "
            f"{100 * self.per_radian:.2g} % a radian, which the equations don't: a finer step may show more of it"
        )

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"sentence": self.sentence}


def damping_of(solver: Tableau, h_omega: Array) -> Array:
    """1 - |R(i h omega)|^(1/(h omega)), for h omega > 0 of any shape; below 0 where the method amplifies."""
    growth = solver.growth(1j * h_omega)  # |R|^2 - 1
    with np.errstate(divide="ignore"):  # R may vanish: nothing is left
        return np.asarray(-np.expm1(np.log1p(np.maximum(growth, -1.0)) / (2 * h_omega)))


def worst_damping(solver: Tableau, z: Array) -> SolverDamping | None:
    """Of the modes h lambda, of any shape: of those that oscillate, |Im| >= |Re|, and that the step does not resolve."""
    h_omega = np.abs(z.imag)
    h_omega = h_omega[(h_omega > RESOLVED_TURN) & (h_omega >= np.abs(z.real)) & np.isfinite(h_omega)]
    if len(h_omega) == 0:
        return None
    damped = damping_of(solver, h_omega)
    worst = int(damped.argmax())
    if damped[worst] <= 0:
        return None
    return SolverDamping(float(damped[worst]), float(h_omega[worst]), solver.name)
