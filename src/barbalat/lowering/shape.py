"""The sizes of a step function, which all targets share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Recalled:
    """Records of the steps of a member: a step reads earlier records and writes one. Each lane has separate records.

    width    numbers of a record
    records  successive records that a step reads
    first    the row of the state with the number of the first of these records
    last     the row of the state with the number of the record that the step writes
    """

    width: int
    records: int
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class LoopShape:
    """Sizes of a step function's arguments: state, accumulators, parameters, signals, and its memory of the past.

    delayed            number of channels whose value is stored at every step; the step receives TAPS_PER_CHANNEL successive
                       stored values of each channel
    lag_per_member     whether members have different lags
    noise              number of random numbers that each member receives at every step, constant for ``noise_hold`` steps
    sample_every       steps between two calls of the sampled part, which acts on the state before the step; 0 without a sampled
                       part
    in_pieces          a step may come in successive pieces, with a row of signals for each: a row's last two entries say whether
                       the piece begins a step and whether it ends one. Counts of steps do not include pieces

    sample_row         a row of the state: the sampled part is called before each step at which it is nonzero, whatever the step's
                       number; ``sample_every`` is then 1. The part itself leaves members unchanged if this row is 0
    signal_row         a row of the state: the number of the row of signals that a member's step reads
    rows_per_member    whether each lane has separate rows
    recalled           the records of earlier steps; None without records, as with ``delayed``

    If ``noise_hold`` or ``sample_every`` is ``None``, it is an argument of every call, at least 1. A compiled-in value is faster.
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
    rows_per_member: bool = False
    recalled: Recalled | None = None

    def __post_init__(self) -> None:
        for name, count, least in (("noise_hold", self.noise_hold, 1), ("sample_every", self.sample_every, 0)):
            if count is not None:
                require_count(name, count, least)


MOST_STEPS = 2**63 - 1
"""Largest number of steps: machine code stores it in a signed 64-bit integer, and neither LLVM nor ctypes reports an overflow."""


def require_count(name: str, count: int, least: int) -> None:
    """Raise ValueError for a number of steps that machine code can't represent, or that is too small: a division by 0 would end
    the process."""
    if not least <= count <= MOST_STEPS:
        raise ValueError(f"{name} must be from {least} to {MOST_STEPS}, got {count}")


TAPS_PER_CHANNEL = 3
"""Number of stored values that a step receives for each delayed channel."""


ENTRY = "barbalat_loop"


WATCH_EVERY = 8
"""Steps between two evaluations of the monitored quantity, each of which may cost as much as half a step."""
