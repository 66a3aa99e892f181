"""The numerical limits in the JSON contract: adaptation_frequency, gamma_max and step_max of a controller under its solver.

All of them are estimates, made before any simulation with slow quantities frozen. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from barbalat.adaptation.law import AdaptiveLaw, GainLimitedLaw, RatedLaw
from barbalat.certificates.bounds.laws import ModifiedScheme, least_gain
from barbalat.certificates.bounds.model import largest_along_the_command
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.controllers import robust_mrac_several
from barbalat.controllers.robust_mrac import Equations
from barbalat.problem.known_set import Gain
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

STEP_TOO_LONG = NotApplicable("the step is too long for the controller's other states, at any gain of the law")

KEYS_AT_MODEL = {key: f"{key}_at_model" for key in ("gamma_max", "step_max")}
"""The certificate keys for the limits along the model's motion."""


class FrozenLaw(Protocol):
    """A frozen law and its integration: an Oscillator under a solver, or a HeldOscillator in discrete time."""

    @property
    def bPb(self) -> float: ...

    def largest_g(self, h: float) -> float:
        """The largest g = Gamma |x|^2 for a step."""
        ...

    def largest_step(self, g: float) -> float:
        """The largest step for all gains from 0 to g."""
        ...


def under_the_solver(problem: Problem, simulation: Simulation, filter_poles: Array | None) -> Oscillator:
    """The frozen law together with the other integrated parts: the dynamics before the plant's inputs, and C(s)."""
    others = [input_poles(problem), np.zeros(0) if filter_poles is None else filter_poles]
    return Oscillator(problem.known, simulation.solver, np.concatenate(others))


def of_lyapunov_law(
    problem: Problem,
    gamma: float | Array,
    simulation: Simulation,
    offset: float,
    factor: float,
    filter_poles: Array | None = None,
    oscillator: FrozenLaw | None = None,
) -> dict[str, Any]:
    """Limits on a law theta_hat' = Gamma (e'P b) x, |x|_2 <= offset + factor/sqrt(Gamma), from the extreme eigenvalues of a
    matrix.

    gamma_max is ``None`` for a gain matrix, and if the gain is unlimited, which requires x = 0. If no gain can be shown to be
    tolerated, gamma_max is the reason, as a text.
    """
    oscillator = oscillator or under_the_solver(problem, simulation, filter_poles)
    root_g = math.sqrt(Gain(gamma).largest) * (offset + factor / math.sqrt(least_gain(gamma)))  # of x'Gamma x
    largest_root = math.sqrt(oscillator.largest_g(simulation.dt))
    return {
        "adaptation_frequency": math.sqrt(oscillator.bPb) * root_g,
        "gamma_max": _largest_gain(largest_root, offset, factor) if np.ndim(gamma) == 0 else None,
        "step_max": oscillator.largest_step(root_g**2),
    }


def of_the_motion(
    problem: Problem,
    gamma: float | Array,
    simulation: Simulation,
    oscillator: FrozenLaw | None = None,
    filter_poles: Array | None = None,
) -> dict[str, Any]:
    """The limits for |x| as large as |x_m| under the command of the case, with separate keys.

    If the bound on |x| is far above the motion for this command, oscillations begin at these limits, and the other limits are
    conservative.
    """
    if not is_needed(*KEYS_AT_MODEL.values()):
        return {}
    reach = largest_along_the_command(problem, simulation)
    limits = of_lyapunov_law(problem, gamma, simulation, reach, 0.0, filter_poles, oscillator)
    return {name: limits[key] for key, name in KEYS_AT_MODEL.items()}


def with_modifications(values: dict[str, Any], controller: ModifiedScheme, simulation: Simulation) -> dict[str, Any]:
    """Return the limits with the contribution of a leakage and a memory: the estimates also decay, at up to Gamma (w + gamma_c
    R).

    The gain up to which this decay is stable is not computed. If w or R has no bound (an epsilon-modification, a memory without
    forgetting and capacity), there is no step_max.
    """
    law, learning = controller.leakage, controller.learning
    if law is None and learning is None:
        return values
    pull = 0.0
    if law is not None:
        pull += law.largest
    if learning is not None:
        held = math.inf if learning.capacity is None else learning.capacity
        pull += learning.gamma_c * min(
            held, math.inf if learning.forgetting == 0 else 1 / learning.forgetting
        )  # of lambda_max(R)
    alone = simulation.solver.real_limit / (Gain(controller.gamma).largest * pull)
    step_max = values["step_max"]
    return values | {"gamma_max": None, "step_max": min(step_max, alone) if step_max and alone else None}


def _largest_gain(root_g: float, offset: float, factor: float) -> float | NotApplicable | None:
    """The largest Gamma with sqrt(Gamma) |x|_2 <= root_g."""
    room = root_g - factor
    if root_g == 0:
        return STEP_TOO_LONG
    if room <= 0:
        return NotApplicable(
            "no gain is shown to be tolerated: |x| is known to fall only with 1/sqrt(Gamma), so sqrt(Gamma) |x| may be "
            f"{factor:.4g} at every gain, and the step tolerates {root_g:.4g}"
        )
    return None if offset == 0 else (room / offset) ** 2


def of_parametric_model(
    problem: Problem, equations: Equations | robust_mrac_several.Equations, simulation: Simulation
) -> dict[str, Any]:
    """Limits on a law on the parametric model (13), whose adaptation is a decay because the estimates don't affect the
    regressor."""
    filters = [np.linalg.eigvals(problem.known.A_m), input_poles(problem), np.array([-equations.normalization.delta_0])]
    if equations.Q is not None:
        filters.append(np.linalg.eigvals(equations.Q.A))
    others = Oscillator(problem.known, simulation.solver, np.concatenate(filters)).largest_step(0.0)
    return of_decay(equations.law, simulation, others)


def of_decay(law: AdaptiveLaw, simulation: Simulation, others: float) -> dict[str, Any]:
    """step_max and gamma_max of a law whose adaptation is a decay; ``others`` is the largest step for everything else."""
    limit, values = simulation.solver.real_limit, dict[str, Any]()
    if isinstance(law, RatedLaw) and (fastest := law.fastest_rate) is not None:
        values["step_max"] = min(others, limit / fastest)
    if isinstance(law, GainLimitedLaw) and (largest := law.gain_of_rate(limit / simulation.dt)) is not None:
        values["gamma_max"] = largest if simulation.dt <= others else STEP_TOO_LONG
    return values


def input_poles(problem: TrackingProblem) -> Array:
    """Return the poles of the dynamics before the plant's inputs, which are integrated together with the adaptation."""
    return np.concatenate([np.zeros(0) if path.dynamics is None else path.dynamics.poles for path in problem.plant.paths])
