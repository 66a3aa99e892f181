"""What a sampled form has of the continuous equations that it stands for."""

from __future__ import annotations

from typing import Any

from barbalat.protocols import Equations, Value


class SampledForm:
    """It starts as they do, and holds their control."""

    continuous: Equations

    def initial(self) -> Any:
        return self.continuous.initial()

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)
