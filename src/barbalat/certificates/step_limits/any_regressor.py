"""The limits of the numerics for any regressor, several inputs and an unknown input gain, from a bound of |phi(x)| on a box.

|x_i| <= |x_m,i| + |e|, and |e| <= nu_0/sqrt(Gamma) by (9), which holds for MRAC with every regressor; for L1-AC it is assumed.
On that box |phi(x)|_2 is bounded by balls, and omega_a^2 <= Gamma |phi|_2^2 ||b'P b||. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.certificates.bounds import laws
from barbalat.certificates.bounds.model import command_bounds, state_bounds
from barbalat.certificates.bounds.regressor import largest_square
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.step_limits.frozen_laws import STEP_TOO_LONG, FrozenLaw, input_poles, with_modifications
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.linear.largest import largest_from
from barbalat.problem.known_set import Gain
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

MOST_HALVINGS = 60
"""Gains that are tried below the largest one that could be borne, each half the one before."""


def of_lyapunov_law(
    excited: Excited, simulation: Simulation, nu_0: float, filter_poles: Array | None = None, oscillator: FrozenLaw | None = None
) -> dict[str, Any]:
    """adaptation_frequency, gamma_max, step_max under the contract's keys; ``None`` where there is no such limit."""
    problem, controller, gamma = excited.problem, excited.controller, excited.controller.gamma
    if oscillator is None:
        beside = [input_poles(problem), np.zeros(0) if filter_poles is None else filter_poles]
        oscillator = Oscillator(problem.known, simulation.solver, np.concatenate(beside))
    g = Gain(gamma).largest * excited.largest_square(laws.error_level(problem, controller, nu_0))
    if not math.isfinite(g):
        return {}
    values: dict[str, Any] = {
        "adaptation_frequency": math.sqrt(oscillator.bPb * g),
        "gamma_max": None if np.ndim(gamma) else _largest_gain(excited, oscillator.largest_g(simulation.dt), nu_0),
        "step_max": oscillator.largest_step(g),
    }
    return with_modifications(values, controller, simulation)


@dataclass(frozen=True, eq=False)
class Excited:
    """How large the regressor of the law can be.

    divides_by_gain  whether an unknown input gain's estimate divides u, as in MRAC, where a filter or a predictor does not take
                     it up again: the coupling is then multiplied by omega/omega_hat
    """

    problem: Problem
    controller: laws.ModifiedScheme
    divides_by_gain: bool

    def largest_square(self, error: float) -> float:
        """phi|_2^2, with u below phi where its gain is unknown, while no component of e exceeds ``error``.|Return the largest
        |phi|_2^2, with u below phi where its gain is unknown, while no component of e exceeds ``error``.|phi|_2^2, with u below
        phi where its gain is unknown, while no component of e exceeds ``error``."""
        problem = self.problem
        bounds = self._model + error
        phi = largest_square(problem.plant.regressor, -bounds, bounds)
        gains = problem.known.gains
        if gains is None:
            return phi
        command = command_bounds(problem)
        u = (self._largest_theta() * math.sqrt(phi) + command) / gains.lower
        ratio = float(np.max(gains.upper / gains.lower)) if self.divides_by_gain else 1.0
        return ratio * (phi + float(np.max(u**2)))

    @cached_property
    def _model(self) -> Array:
        """(n,) bounds of the model's state; a search for a gain asks for them again and again."""
        return np.array(state_bounds(self.problem))

    def _largest_theta(self) -> float:
        """|theta_hat|_2 without the gains: |theta|_2 and the distance that V keeps it from theta, or the known set's."""
        problem = self.problem
        equations, theta = self.controller.bind(problem.known), problem.plant.theta
        error = equations.theta_hat0 - problem.parameters
        largest = float(np.linalg.norm(theta) + np.linalg.norm(error))
        known_set = problem.uncertainty
        if known_set is None or equations.box is None or not equations.box.bounds_theta:
            return largest
        return min(largest, known_set.farthest(np.zeros(known_set.size)))


def _largest_gain(excited: Excited, largest_g: float, nu_0: float) -> float | NotApplicable | None:
    """The largest Gamma with Gamma |phi|^2 <= largest_g; ``None`` for phi = 0, where no gain is too large.

    |phi|^2 falls with Gamma, since the error does, so that its limit for Gamma -> infinity gives a gain that is too large.
    """

    def bears(gamma: float) -> bool:
        return gamma * excited.largest_square(nu_0 / math.sqrt(gamma)) <= largest_g

    if largest_g == 0:
        return STEP_TOO_LONG
    at_rest = excited.largest_square(0.0)
    if at_rest == 0:
        return None
    beyond = largest_g / at_rest * (1 + 1e-9)
    found = largest_from(bears, beyond, within=1e-3, least=beyond / 2**MOST_HALVINGS)
    return found or NotApplicable(
        f"no gain is shown to be borne: the bound of |phi| grows as the gain falls, so that Gamma |phi|^2 stays above the "
        f"{largest_g:.4g} that the step bears"
    )
