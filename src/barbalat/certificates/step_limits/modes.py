"""What a solver's step makes of the modes of a linear loop."""

from __future__ import annotations

import numpy as np

from barbalat.linear.largest import largest
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def largest_step(simulation: Simulation, modes: Array) -> float:
    """The largest step up to which no mode is amplified by the solver alone."""
    beyond = 2 * simulation.solver.reach / float(np.abs(modes).max())
    return largest(lambda h: not amplifies(simulation, h, modes), 0.0, beyond)


def amplifies(simulation: Simulation, h: float, modes: Array) -> bool:
    """R| above max(1, |e^z|) by so much that it makes a factor e up to t_end.|Say whether the method amplifies along a run: |R|
    exceeds max(1, |e^z|) by so much that it makes a factor e up to t_end.|R| above max(1, |e^z|) by so much that it makes a
    factor e up to t_end."""
    z = h * modes
    with np.errstate(divide="ignore"):
        spurious = np.log(np.abs(simulation.solver.amplification(z))) - np.maximum(z.real, 0)
    return bool((spurious * simulation.t_end / h > 1).any())
