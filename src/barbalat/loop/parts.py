"""What a closed loop's state, what drives it and what is measured of it consist of: named parts of flat vectors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

from barbalat.protocols import Value


class Held(NamedTuple):
    """What a sampled controller keeps from one sample to the next."""

    u: Value  # the control
    measured: Value  # what was sampled: the state, or y
    x_m: Value  # the state of its own reference model, from sample to sample
    r: Value  # the command that was sampled
    started: Value  # 0 before the first sample, then 1
    theta_hat: Value  # the estimates as they were before this step's sample, if it has one


class LoopState(NamedTuple):
    """The loop's state; a part that the loop lacks is an empty tuple or array."""

    x: Value  # (n,) plant
    x_m: Value  # (n,) reference model
    input: Any  # an InputState for each input with limits or unmodelled dynamics
    sensor: Value  # (n,) lagged measurement
    controller: Any  # the scheme's own NamedTuple
    held: Any  # Held


class Outputs(NamedTuple):
    """What is measured at every solver step and recorded."""

    e: Value  # (n,) tracking error x - x_m, or y - y_m where the output is fed back
    u: Value  # (m,) control
    theta_hat: Value  # (n,) estimates
    x: Value  # (n,)
    x_m: Value  # (n,)
    y: Value  # (1,) measured output, (0,) where the state is measured


class Signals(NamedTuple):
    """What drives the loop at one instant."""

    r: Value  # command, or (q,) commands
    matched: Value  # (0,) or (1,) matched disturbance
    unmatched: Value  # (k,) other disturbances
    at_output: Value  # (0,) or (1,): added to the output
    clock: Value  # (0,) or (1,): t, for a plant that depends on it
    noise: Value  # (n,) or (0,): standard Gaussian numbers of the measurement
    delayed: Value  # (0,) or (m,): what leaves the delay at the plant's input


@dataclass(frozen=True)
class SignalSizes:
    """How many entries each part of ``Signals`` has in a flat vector, in which they stand in that order.

    commands  None for a single one, which is a number
    """

    commands: int | None
    matched: int
    unmatched: int
    at_output: int
    clock: int
    noise: int
    delayed: int

    @property
    def timed(self) -> int:
        """Entries that are functions of time: r, the disturbances, t itself."""
        return (self.commands or 1) + self.matched + self.unmatched + self.at_output + self.clock

    @property
    def total(self) -> int:
        return self.timed + self.noise + self.delayed

    def named(self, flat: Value) -> Signals:
        """The parts of a flat vector."""
        sizes = (self.commands or 1, self.matched, self.unmatched, self.at_output, self.clock, self.noise, self.delayed)
        r, *others = (flat[start:end] for start, end in pairwise(accumulate(sizes, initial=0)))
        return Signals(flat[0] if self.commands is None else r, *others)
