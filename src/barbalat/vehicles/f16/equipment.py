"""The hardware between a controller and the aircraft: converter, transport delay, actuator and sensors."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Equipment:
    """The actuator of an axis's surface and the sensors of the feedback. The defaults are those of the elevator.

    actuator_lag     lag of the first-order actuator [s], by default the lag for 20.2 rad/s
    rate_limit       largest rate of the surface [deg/s]
    limit            largest deflection on both sides [deg]
    sensor_lag       lag of each first-order sensor [s]
    transport_delay  delay from the sample to the actuator's command [s], by default two samples, for bus and computer

    Source of the actuator: Stevens and Lewis, Aircraft Control and Simulation, section 3.5, after NASA TP-1538.
    """

    actuator_lag: float = 1 / 20.2
    rate_limit: float = 60.0
    limit: float = 25.0
    sensor_lag: float = 0.02
    transport_delay: float = 0.02

    @property
    def lag(self) -> float:
        """The total equivalent delay at frequencies below 1/actuator_lag [s]."""
        return self.actuator_lag + self.sensor_lag + self.transport_delay


class Actuator:
    """The response of a surface from command to deflection, in solver steps of the aircraft."""

    def __init__(self, equipment: Equipment, step: float, start: float) -> None:
        self.equipment, self.step, self.deflection = equipment, step, start
        self._share = -float(np.expm1(-step / equipment.actuator_lag))  # exact for a held command
        self._most = equipment.rate_limit * step
        self._runaway = 0
        self._waiting = deque([start] * self._steps(equipment.transport_delay))

    def _steps(self, delay: float) -> int:
        return round(delay / self.step)

    def delay_more(self, seconds: float) -> None:
        """Delay commands by this time from now on. Until the first delayed command arrives, the last one is held."""
        self._waiting.extendleft([self._waiting[0] if self._waiting else self.deflection] * self._steps(seconds))

    def run_away(self, seconds: float) -> None:
        """Move the surface to its negative end (nose up for an elevator) as fast as possible for this time, whatever the
        command."""
        self._runaway = self._steps(seconds)

    def advance(self, command: float) -> float:
        """Advance by one step and return the deflection at its end [deg]."""
        limit = self.equipment.limit
        self._waiting.append(min(max(command, -limit), limit))
        arrived = self._waiting.popleft()
        if self._runaway:
            self._runaway -= 1
            self.deflection = max(self.deflection - self._most, -limit)
            return self.deflection
        wanted = self._share * (arrived - self.deflection)
        self.deflection += min(max(wanted, -self._most), self._most)
        return self.deflection


class Sensors:
    """First-order lags of the measured quantities, as deviations from trim."""

    def __init__(self, equipment: Equipment, step: float, count: int = 2) -> None:
        self._share = -float(np.expm1(-step / equipment.sensor_lag)) if equipment.sensor_lag > 0 else 1.0
        self.output = [0.0] * count

    def advance(self, seen: Sequence[float]) -> list[float]:
        share = self._share
        self.output = [one + share * (now - one) for one, now in zip(self.output, seen, strict=True)]
        return self.output
