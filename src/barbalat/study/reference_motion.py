"""The motion of the reference model along a run: the scale for errors and for speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.linear.driven_response import driven_response
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers.simulation import Simulation

REST_SHARE = 0.1
"""Fraction of the largest magnitude at which the square of the regressor, which drives the law, is 1 % of its maximum."""
REST_SENTENCE = (
    "in the last quarter, which the judge evaluates, the command requires less than a tenth of the run's motion: an "
    "oscillation that occurs only while the plant moves is not detected"
)


@dataclass(frozen=True)
class ReferenceMotion:
    """The motion of x_m along a run, or of y_m with output feedback.

    largest    the largest magnitude of a component
    of_each    the largest magnitude of each component
    rms        RMS of |x_m|_2 over the run
    crossings  rate at which a component crosses its range [1/s], computed from the variation over the run, or from the fastest
               mode of the model (|lambda|/pi, as for a sine), whichever is larger
    in_tail    the largest magnitude in the last quarter of the run
    """

    largest: float
    rms: float
    crossings: float
    in_tail: float
    of_each: tuple[float, ...]

    @property
    def comes_to_rest(self) -> bool:
        """Whether the command requires hardly any motion in the last quarter of the run, in which case the regressor is
        negligible there."""
        return self.in_tail < REST_SHARE * self.largest

    @classmethod
    def of(cls, problem: TrackingProblem, simulation: Simulation) -> ReferenceMotion:
        """The motion of a problem's model: the response of a linear system to the command."""
        A, B, C = problem.model.matrices
        t, moved = driven_response(A, B, C, problem.model.x0, problem.commands, simulation.t_end, simulation.stepped.steps)
        ranges, variation = np.ptp(moved, axis=0), np.abs(np.diff(moved, axis=0)).sum(axis=0)
        moving = ranges > 0
        swept = float((variation[moving] / ranges[moving]).max()) / simulation.t_end if moving.any() else 0.0
        fastest = float(np.abs(np.linalg.eigvals(A)).max()) / np.pi
        return cls(
            largest=float(np.abs(moved).max()),
            rms=float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
            crossings=max(swept, fastest),
            in_tail=float(np.abs(moved[t >= 0.75 * simulation.t_end]).max()),
            of_each=tuple(np.abs(moved).max(axis=0).tolist()),
        )
