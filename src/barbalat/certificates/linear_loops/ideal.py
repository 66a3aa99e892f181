"""The linear loops that the schemes become: broken at the plant input, L from the plant's input v to -u.

With the parameters known and with infinitely fast adaptation the loops are linear and exact; around a constant command the
adaptive loop is linearised with its adaptive law inside.
"""

from __future__ import annotations

import numpy as np

from barbalat.linear.systems import StateSpace, series
from barbalat.problem.plant import Plant
from barbalat.validate import Array


def known_parameters(plant: Plant, theta_hat: Array, C: StateSpace | None = None) -> StateSpace:
    """u = C(s)[-theta_hat'x] on the plant with its own theta: what MRAC (C = 1) or L1-AC is once the estimates rest."""
    A = plant.A_m + np.outer(plant.b, plant.theta)
    feedback = StateSpace(A, plant.b, np.array(theta_hat, dtype=float), 0.0)
    return feedback if C is None else series(feedback, C)


def fast_adaptation(plant: Plant, C: StateSpace) -> StateSpace:
    """L1-AC for Gamma -> infinity, inside the projection bounds: an LTI controller.

    The predictor error vanishes, so theta_hat'x becomes theta'x + v - u: what is missing of the desired dynamics. Then
    u = -C [theta'x + v - u], that is L = C/(1 - C) (1 + theta'G), G = (sI - A_m - b theta')^-1 b.
    """
    A = plant.A_m + np.outer(plant.b, plant.theta)
    disturbance = StateSpace(A, plant.b, plant.theta, 1.0)  # 1 + theta'G
    # C/(1 - C): the filter with its output fed back to its input
    integrator = StateSpace(C.A + np.outer(C.B, C.C), C.B, C.C, 0.0)
    return series(disturbance, integrator)
