"""The spectrum along a run: whether it stayed inside its solver's region of stability. Source: docs/numerics.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.closed_loop import ClosedLoop
from barbalat.grid import Simulation
from barbalat.stepping import jacobian_function
from barbalat.validate import Array


@dataclass(frozen=True)
class Stiffness:
    """How far a run stayed inside its solver's region of stability.

    h_lambda_max   the largest h |eigenvalue| of the exact Jacobian at the instants looked at
    unstable_from  the first of them [s] at which the solver amplified a mode that the equations don't; None if at none
    """

    h_lambda_max: float
    unstable_from: float | None


def stiffness(loop: ClosedLoop, simulation: Simulation, t: Array, states: Array, signals: Array) -> Stiffness:
    """From the Jacobian's eigenvalues at K instants t; states (K, size), signals (K, channels).

    A mode is amplified by the solver alone when |R(h lambda)| exceeds max(1, |e^(h lambda)|). It counts when, kept up for the
    whole run, that would make a factor e: a fixed threshold would blame Euler's method for its harmless growth of slow modes.
    """
    size = loop.size
    flat = np.asarray(jacobian_function(loop, simulation.dt)(states.T, signals.T))
    z = simulation.dt * np.linalg.eigvals(flat.reshape(size, len(states), size).transpose(1, 0, 2))
    with np.errstate(divide="ignore"):  # R may vanish: no growth at all
        spurious = np.log(np.abs(simulation.solver.amplification(z))) - np.maximum(z.real, 0)
    bad = np.flatnonzero(spurious.max(axis=1) * simulation.steps > 1)
    return Stiffness(float(np.abs(z).max()), float(t[bad[0]]) if len(bad) else None)
