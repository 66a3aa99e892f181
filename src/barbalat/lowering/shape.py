"""The sizes of a step function, which all targets share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopShape:
    """Sizes of a step function's arguments: state, accumulators, parameters, signals, and its memory of the past.

    delayed            channels whose value at every step is remembered; the step gets TAPS_PER_CHANNEL ones in a row of each back
    lag_per_member     whether members look back differently far
    noise              numbers of its own that each member gets at every step, the same for ``noise_hold`` steps
    sample_every       steps between two calls of the sampled part, which acts on the state before the step; 0: there is none
    in_pieces          a step may come in pieces, one after the other, with a row of signals for each: a row's last two entries
                       say whether the piece begins a step and whether it ends one. What is counted in steps counts no pieces

    sample_row         a row of the state: the sampled part is called before each step at which that is not 0, whatever its
                       number; ``sample_every`` is then 1. The part itself leaves members alone whose row is 0
    signal_row         a row of the state, of one member alone: the number of the row of signals that its step reads, a whole one

    ``None`` for ``noise_hold`` or ``sample_every``: an argument of every call, a count of at least 1. Compiled in is faster.
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
"""That a count of steps may have: machine code holds it in 64 bits with a sign, and neither LLVM nor ctypes says what is cut."""


def require_count(name: str, count: int, least: int) -> None:
    """ValueError for a count of steps that machine code can't hold, or that is too small: a divisor of 0 ends the process."""
    if not least <= count <= MOST_STEPS:
        raise ValueError(f"{name} must be from {least} to {MOST_STEPS}, got {count}")


TAPS_PER_CHANNEL = 3
"""Remembered values handed to a step for each delayed channel."""


ENTRY = "barbalat_loop"


WATCH_EVERY = 8
"""Steps between two looks: what is looked at may cost as much as half a step."""
