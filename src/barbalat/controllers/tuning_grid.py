"""A scheme's knobs: the settings that a trade-off turns, and how far for a case. A scheme that has some says so itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np

from barbalat.problem.output_feedback import OutputKnown
from barbalat.problem.regressors import Linear
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Controller
from barbalat.validate import Array, Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class TuningGrid:
    """A scheme and the settings that are varied, all combinations of them; ``make`` builds the controller.

    traded  whether trade-offs have it where nobody says which; contests have all
    open    those whose values end where a grid has to end, and not at what the step or the model sets: a search goes beyond
    aims    keys of its certificate that its designers look at: what they promise of it, and under which condition
    """

    scheme: str
    values: dict[str, Array]
    make: Callable[..., Controller]
    traded: bool = True
    open: tuple[str, ...] = ()
    aims: tuple[str, ...] = ()

    def tunings(self) -> Iterator[dict[str, float]]:
        for combination in product(*self.values.values()):
            yield dict(zip(self.values, map(float, combination), strict=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class TuningScale:
    """How far knobs are turned for a case.

    highest_gain  that the step resolves
    highest_square  that it resolves of a gain times the square of what it multiplies: what highest_gain is for another regressor
    times         time constants [s], from five steps to the model's slowest
    density       values of a knob beside another one
    known         what the designer knows
    sample_time   of a scheme that is sampled by nature [s]
    saturated     whether schemes that have something against windup have it switched on
    theta_hat0    where estimates start; None leaves that to each scheme
    """

    highest_gain: float
    highest_square: float
    times: Array
    density: int
    known: Known
    sample_time: float
    saturated: bool = False
    theta_hat0: Vector | None = None

    def gains(self, lowest: float, count: int) -> Array:
        """``count`` gains from ``lowest`` times the highest up to that."""
        return self.highest_gain * np.geomspace(lowest, 1.0, count)

    @property
    def nominal(self) -> Array | None:
        """The gains of x that a scheme without estimates assumes, (n m,): the middle of the known set, as linear designs do."""
        theta_set = self.known.theta_set
        linear = isinstance(self.known.matched.regressor, Linear)
        return theta_set.middle if theta_set is not None and linear else None

    @property
    def frequencies(self) -> Array:
        """The frequencies that correspond to ``times`` [rad/s]."""
        return 1 / self.times[::-1]


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputTuningScale:
    """What the ranges of knobs follow from, of a case whose output is fed back.

    times        time constants [s], from five steps to the model's slowest
    known        what the designer knows
    sample_time  of a scheme that is sampled by nature [s]
    saturated    whether schemes that have something against windup have it switched on
    """

    times: Array
    known: OutputKnown
    sample_time: float
    saturated: bool = False


@runtime_checkable
class OutputTunable(Protocol):
    """A scheme that feeds back the output and says which of its settings are tuned, like ``Tunable``."""

    def output_knobs(self, reach: OutputTuningScale) -> TuningGrid:
        """Its settings that are varied, and how far."""
        ...


@runtime_checkable
class Tunable(Protocol):
    """A scheme's class that says which of its settings trade tracking for robustness; others enter trade-offs by hand only."""

    def knobs(self, reach: TuningScale) -> TuningGrid:
        """Its settings that are varied, and how far."""
        ...
