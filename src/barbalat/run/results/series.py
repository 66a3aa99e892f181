"""The time series of a result, from the states at its instants."""

from __future__ import annotations

from typing import Any

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.run.kernel.portable import at_instants
from barbalat.run.kernel.step import output_function
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def series_along(loop: ClosedLoop, simulation: Simulation, t: Array, states: Array, signals: Array) -> dict[str, Any]:
    """The series by the field names of a ``Result``, from the states (K, S) and the signals (k, K) at the times t (K,) [s]."""
    e, u, theta_hat, x, x_m, y = (value.T for value in at_instants(output_function(loop), simulation, states.T, signals))
    return {
        "t": t,
        "x": x,
        "x_m": x_m,
        "y": y[:, 0] if loop.measured_outputs else None,
        "e": e,
        "u": u[:, 0] if loop.inputs == 1 else u,
        "r": signals[0] if loop.commands is None else signals[: loop.commands].T,
        "theta_hat": theta_hat,
        "states": states,
    }
