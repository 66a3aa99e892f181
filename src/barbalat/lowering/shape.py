"""The sizes of a step function, which all targets share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopShape:
    """Sizes of a step function's arguments: state, accumulators, parameters, signals, and its memory of the past.

    delayed            channels whose value at every step is remembered; the step gets TAPS consecutive ones of each back
    lag_per_member     whether members look back differently far
    """

    states: int
    accumulators: int
    parameters: int
    signals: int
    delayed: int = 0
    lag_per_member: bool = False


TAPS = 4
"""Remembered values handed to a step for each delayed channel: enough for the cubic between them."""
