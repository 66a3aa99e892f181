"""The knobs of a scheme: the settings that a trade-off varies and their ranges for a case. Each scheme declares its knobs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np

from barbalat.problem.output_feedback import OutputKnown
from barbalat.problem.regressors import Linear
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Controller
from barbalat.validate import Array, Vector

SLOW_SLOPE = 10.0
"""Second slope kappa_2 as a multiple of the slowest time constant: |s kappa_2/(s kappa_2 + 1)| is 0.995 or more for all faster
dynamics."""
SLOWNESS_RATIO = 100.0
"""Ratio to the model's slowest rate below which dynamics are too slow to matter within a run."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TuningGrid:
    """A scheme and the settings that are varied, in all combinations; ``make`` builds the controller.

    traded  whether trade-offs include it by default; contests include all schemes
    open    settings whose range has arbitrary ends, not derived from the step or the model; a search may leave this range
    whole   settings whose listed values already cover their whole range
    aims    keys of its certificate that matter to designers: its guarantees and their conditions
    """

    scheme: str
    values: dict[str, Array]
    make: Callable[..., Controller]
    traded: bool = True
    open: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    aims: tuple[str, ...] = ()

    def tunings(self) -> Iterator[dict[str, float]]:
        for combination in product(*self.values.values()):
            yield dict(zip(self.values, map(float, combination), strict=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class TuningScale:
    """The ranges of knobs for a case.

    highest_gain  the highest gain that the step resolves
    highest_square  the highest product of a gain and the squared norm of its regressor that the step resolves, from which the
                    highest gain for a different regressor follows
    times         time constants [s], from five steps to the slowest one of the model; wider in ``sampled``
    density       number of values of a knob that is combined with another knob
    known         the known part of the plant
    sample_time   of a scheme that is always sampled [s]
    saturated     whether schemes with a windup remedy use it
    theta_hat0    the initial estimates; with None each scheme uses its default
    """

    highest_gain: float
    highest_square: float
    times: Array
    density: int
    known: Known
    sample_time: float
    saturated: bool = False
    theta_hat0: Vector | None = None

    def sampled(self, sample_time: float, beyond: float) -> TuningScale:
        """The ranges for a contest of sampled controllers: gains ``beyond`` times as large, time constants from half a sample
        period to ten times the slowest one.

        The midpoint form of a lag has its pole at zero if the time constant is half a sample period, and oscillates if it is
        shorter.
        """
        return replace(
            self,
            highest_gain=beyond * self.highest_gain,
            highest_square=beyond * self.highest_square,
            times=np.geomspace(sample_time / 2, 10 * self.times[-1], len(self.times)),
            sample_time=sample_time,
        )

    def gains(self, lowest: float, count: int) -> Array:
        """``count`` gains from ``lowest`` times the highest gain up to the highest."""
        return self.highest_gain * np.geomspace(lowest, 1.0, count)

    @property
    def nominal(self) -> Array | None:
        """The parameters that a scheme without estimates assumes, (n m,), as in linear designs: theta at the declared values of
        [parameters], or else the middle of the known set."""
        if self.known.nominal is not None:
            return self.known.nominal
        theta_set = self.known.theta_set
        linear = isinstance(self.known.matched.regressor, Linear)
        return theta_set.middle if theta_set is not None and linear else None

    @property
    def slope_ratios(self) -> Array:
        """Ratios of the second to the first time constant of ``two_slopes``: 1, and a ratio so large that C is (6)."""
        return np.array([1.0, SLOW_SLOPE * self.times[-1] / self.times[0]])

    @property
    def frequencies(self) -> Array:
        """The frequencies that correspond to ``times`` [rad/s]."""
        return 1 / self.times[::-1]


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputTuningScale:
    """The ranges of knobs for a case with output feedback.

    times        time constants [s], from five steps to the slowest one of the model
    known        the known part of the plant
    sample_time  of a scheme that is always sampled [s]
    saturated    whether schemes with a windup remedy use it
    """

    times: Array
    known: OutputKnown
    sample_time: float
    saturated: bool = False


@runtime_checkable
class OutputTunable(Protocol):
    """A scheme with output feedback that declares its tuned settings, like ``Tunable``."""

    def output_knobs(self, reach: OutputTuningScale) -> TuningGrid:
        """The settings that are varied, with their ranges."""
        ...


@runtime_checkable
class Tunable(Protocol):
    """A scheme class that declares which of its settings trade tracking against robustness. Other schemes enter trade-offs only
    with fixed settings."""

    def knobs(self, reach: TuningScale) -> TuningGrid:
        """The settings that are varied, with their ranges."""
        ...
