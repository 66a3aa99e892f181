"""Linear controllers from sample to sample by the trapezoidal rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from barbalat.controllers.steps import LinearStep
from barbalat.controllers.twin import SampledTwin
from barbalat.protocols import Equations, Sample, Value


@dataclass(frozen=True, eq=False)
class Tustin(SampledTwin):
    """A linear controller on the output or on the state, whose NamedTuple is the state of its linear system."""

    continuous: Equations
    sample_time: float
    step: LinearStep

    explicit: ClassVar[bool] = False

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        rest = type(state)(np.zeros(state[0].shape))  # at the origin the derivative is the forcing alone
        forcings = [self.continuous.derivative(rest, *sample, u)[0] for sample in (before, now)]
        return type(state)(self.step.end(state[0], (forcings[0] + forcings[1]) / 2))
