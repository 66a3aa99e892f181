"""When a run with a delay counts as lost: two criteria, the onset of oscillation and the loss of the motion.

They answer different questions, and the ranking of adaptive schemes depends on which is asked: see docs/robustness.md.
What the reference model itself does along a run is the measure of errors and of oscillations.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from barbalat import validate
from barbalat.linear.driven_response import driven_response
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.metrics import Metrics
from barbalat.settings import Settings
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

REST_SHARE = 0.1
"""Of the largest magnitude: the regressor's square, with which the law turns, is then a hundredth of what it was."""
REST_SENTENCE = (
    "in the last quarter, where both criteria look, the command asks for less than a tenth of the run's motion: what oscillates "
    "only while the plant moves is not seen"
)


@dataclass(frozen=True)
class ReferenceMotion:
    """What x_m does along a run, or y_m where the output is measured.

    largest    the largest magnitude of a component
    of_each    the same of each component
    rms        of |x_m|_2 over the run
    crossings  how often a component crosses its own range [1/s]: by the run's variation, or by the model's fastest mode,
               |lambda|/pi as of a sine, whichever is more
    in_tail    the largest magnitude in the last quarter of the run
    """

    largest: float
    rms: float
    crossings: float
    in_tail: float
    of_each: tuple[float, ...]

    @property
    def comes_to_rest(self) -> bool:
        """Whether the last quarter of the run asks for hardly any motion: there a regressor moves nothing."""
        return self.in_tail < REST_SHARE * self.largest

    @classmethod
    def of(cls, problem: TrackingProblem, simulation: Simulation) -> ReferenceMotion:
        """The motion of a problem's model: the response of a linear system to the command."""
        A, B, C = problem.model.matrices
        t, moved = driven_response(A, B, C, problem.model.x0, problem.commands, simulation.t_end, simulation.steps)
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


NOISE_SENTENCE = (
    "the onset of oscillation is looked for without the case's measurement noise, which moves estimates as fast as an "
    "oscillation does; beside it the loop must not be lost with the noise, and a drift that the noise drives is no onset"
)


EXAMINED = (
    "oscillation is judged in the last quarter of the run by the estimates and by the growth of |e| over the run without a "
    "delay: a limit cycle that is there without a delay, leaves the estimates at rest and keeps |e| below the largest |x_m|, is "
    "not seen"
)
EXAMINED_WITHOUT_ESTIMATES = (
    "this controller has no estimates: oscillation is judged in the last quarter of the run by the growth of |e| over the run "
    "without a delay alone, and a limit cycle that is there without a delay and keeps |e| below the largest |x_m| is not seen"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Expected:
    """What M runs are judged against; (M,) unless said otherwise.

    error      largest |e| of the tail without the modelling error that is tried
    rate       (M, p) how fast the estimates vary in the tail without it [1/s]
    motion     the largest |x_m| of the run
    width      (M, p) of the range in which each estimate is known to lie; infinite where it is not known
    crossings  how often the model crosses its own range [1/s]
    explained  what the modelling error adds to the tail's error where theta is known: see ``ideal_benchmark.ideal_errors``
    """

    error: Array
    rate: Array
    motion: Array
    width: Array
    crossings: Array
    explained: Array

    def of(self, chosen: Array, explained: Array) -> Expected:
        """What runs of the members ``chosen``, (J,), are judged against, each with what its modelling error explains, (J,)."""
        values = {field.name: getattr(self, field.name)[chosen] for field in fields(self)}
        return Expected(**values | {"explained": explained})


@dataclass(frozen=True)
class Lost(Settings):
    """The loss of the motion: the run diverged, or its error grew by ``share`` of the model's own motion.

    share  of the largest |x_m| of the run, for the growth of the tail's largest |e|. 1 by default: the error that the delay
           adds has become as large as the motion that is asked for. It is no boundary of stability: an oscillation that
           projection or saturation keeps smaller than that is borne
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        validate.freeze(self, share=validate.positive("share", self.share))

    def judge(self, metrics: Metrics, expected: Expected) -> Array:
        """(M,) which members have an error beyond what is expected of them."""
        tail = tail_error(metrics)
        return np.asarray(~(tail <= expected.error + self.share * expected.motion))  # NaN, a diverged run, is lost


@dataclass(frozen=True)
class Onset(Settings):
    """The onset of oscillation: the run is no longer the undelayed motion with what a delay does to a loop that knows theta.

    It diverged; or in its tail an estimate swings: it moves over more than ``share`` of the range in which it is known to lie,
    as fast as if it crossed that range more often than the model crosses its own, and faster than ``multiple`` times its rate
    without the delay (a limit cycle that projection bounds does); or the tail's largest |e| has grown by more than ``share`` of
    the largest |x_m| beyond what the delay adds where theta is known (an oscillation of the state that saturation bounds does).

    share 0.1 and multiple 2 by default; docs/robustness.md says how little the result depends on them.
    """

    share: float = 0.1
    multiple: float = 2.0

    def __post_init__(self) -> None:
        validate.freeze(
            self, share=validate.positive("onset.share", self.share), multiple=validate.positive("onset.multiple", self.multiple)
        )

    def judge(self, metrics: Metrics, expected: Expected) -> Array:
        """(M,) which members have an error beyond the usual, or estimates that swing too fast."""
        usual = expected.error + expected.explained + self.share * expected.motion
        grown = ~(tail_error(metrics) <= usual)  # NaN, a diverged run, is lost
        limit = np.maximum(self.multiple * expected.rate, _crossing(expected))
        return np.asarray(grown | self._swings(metrics, expected, limit))

    def undelayed(self, metrics: Metrics, expected: Expected) -> Array:
        """(M,) whether estimates swing without a delay: ``multiple`` times as fast as the crossings of the range ask for."""
        return self._swings(metrics, expected, self.multiple * _crossing(expected))

    def driven(self, expected: Expected) -> Array:
        """(M,) whether an estimate moves so fast without a delay that ``multiple`` times its rate decides, and not the crossings.

        An oscillation is then seen only where it is faster than what drives the loop already: the command, or a disturbance.
        """
        return np.asarray((expected.rate > _crossing(expected)).any(axis=1))

    def _swings(self, metrics: Metrics, expected: Expected, limit: Array) -> Array:
        span = metrics.theta_hat_tail_max - metrics.theta_hat_tail_min
        swinging = (metrics.theta_hat_variation_rate > limit) & (span > self.share * expected.width)
        return np.asarray(swinging.any(axis=1))


def _crossing(expected: Expected) -> Array:
    """(M, p) the rate [1/s] of estimates that cross their range as often as the model does its own."""
    return np.asarray(expected.width * expected.crossings[:, None])


def tail_error(metrics: Metrics) -> Array:
    """(M,) the largest |e| of the tail; NaN where the run diverged."""
    return np.asarray(metrics.tail_max_abs_e.max(axis=1))


def tracks(error: Array, motion: Array) -> Array:
    """(M,) whether a run follows its model at all: its tail's error is finite and not above the model's own motion."""
    return np.asarray(error <= motion)
