"""The sizes of a step function, which all targets share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopShape:
    """Sizes of a step function's arguments: state, accumulators, parameters, signals, and its memory of the past.

    delayed            number of channels whose value is stored at every step; the step receives TAPS_PER_CHANNEL successive
                       stored values of each
    lag_per_member     whether members have different lags
    noise              number of random numbers that each member receives at every step, constant for ``noise_hold`` steps
    sample_every       steps between two calls of the sampled part, which acts on the state before the step; 0 without one
    in_pieces          a step may come in successive pieces, with a row of signals for each: a row's last two entries say whether
                       the piece begins a step and whether it ends one. Counts of steps don't count pieces

    sample_row         a row of the state: the sampled part is called before each step at which it is nonzero, whatever its
                       number; ``sample_every`` is then 1. The part itself leaves members unchanged whose row is 0
    signal_row         a row of the state, for a single member only: the number of the row of signals that its step reads

    ``None`` for ``noise_hold`` or ``sample_every``: it is an argument of every call, at least 1. A compiled-in value is faster.
    """

    states: int
    accumulators: int
    parameters: int
    signals: int
    delayed: int = 0
    lag_per_member: bool = False
    noise: int = 0
    noise_hold: int | None = 1
    sample_every: int | None = 0
    in_pieces: bool = False
    sample_row: int | None = None
    signal_row: int | None = None

    def __post_init__(self) -> None:
        for name, count, least in (("noise_hold", self.noise_hold, 1), ("sample_every", self.sample_every, 0)):
            if count is not None:
                require_count(name, count, least)


MOST_STEPS = 2**63 - 1
"""Largest number of steps: machine code stores it in a signed 64-bit integer, and neither LLVM nor ctypes reports an overflow."""


def require_count(name: str, count: int, least: int) -> None:
    """ValueError for a number of steps that machine code can't represent, or that is too small: a division by 0 would end the
    process."""
    if not least <= count <= MOST_STEPS:
        raise ValueError(f"{name} must be from {least} to {MOST_STEPS}, got {count}")


TAPS_PER_CHANNEL = 3
"""Stored values passed to a step for each delayed channel."""


ENTRY = "barbalat_loop"


WATCH_EVERY = 8
"""Steps between two evaluations: the monitored quantity may cost as much as half a step."""
