"""A command as the output of a linear system that restarts at each jump; the model's response to it is enclosed."""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

from barbalat.linear.followed import MOST_BITS, MOST_STEPS, Generator
from barbalat.protocols import Signal
from barbalat.signals import Constant, Sine, Sines, Square, Step, Steps
from barbalat.validate import InputError


def generator(signal: Signal, t_end: float) -> Generator:
    """The signal as the output of a linear system for 0 <= t <= t_end; raises InputError if there is no such system."""
    with ctx.workprec(MOST_BITS):  # sines and instants must be accurate at any precision of the enclosure
        return _generator(signal, t_end)


def _generator(signal: Signal, t_end: float) -> Generator:
    if isinstance(signal, Sine):
        signal = Sines((signal.amplitude,), (signal.frequency,), (signal.phase,), signal.constant)
    if isinstance(signal, Sines):
        count = len(signal.amplitudes)
        S, c, w = np.zeros((2 * count + 1, 2 * count + 1)), np.zeros(2 * count + 1), [arb(1)]
        c[0], c[1::2] = signal.constant, signal.amplitudes
        for i, (frequency, phase) in enumerate(zip(signal.frequencies, signal.phases or (), strict=True)):
            S[2 * i + 1, 2 * i + 2], S[2 * i + 2, 2 * i + 1] = frequency, -frequency
            w += [arb(phase).sin(), arb(phase).cos()]
        return Generator(S, c, [(arb(t_end), w)])
    times, levels = _levels(signal, t_end)
    ends = [*times[1:], arb(t_end)]
    pieces = [(end - start, [level]) for start, end, level in zip(times, ends, levels, strict=True)]
    return Generator(np.zeros((1, 1)), np.ones(1), pieces)


def _levels(signal: Signal, t_end: float) -> tuple[list[arb], list[arb]]:
    """The instants from 0 on at which a signal jumps, and its values after them."""
    if isinstance(signal, Constant):
        return [arb(0)], [arb(signal.amplitude)]
    if isinstance(signal, Step):
        signal = Steps((signal.start,), (signal.constant + signal.amplitude,), signal.constant)
    if isinstance(signal, Steps):
        first = sum(time <= 0 for time in signal.times)
        later = [(time, value) for time, value in zip(signal.times, signal.values, strict=True) if 0 < time < t_end]
        start = signal.values[first - 1] if first else signal.initial
        return [arb(0), *(arb(time) for time, _ in later)], [arb(start), *(arb(value) for _, value in later)]
    if isinstance(signal, Square):
        return _half_periods(signal, t_end)
    raise InputError("the response to the case's command is enclosed only for sums of sines and for piecewise constant signals")


def _half_periods(signal: Square, t_end: float) -> tuple[list[arb], list[arb]]:
    phase, frequency = arb(signal.phase), arb(signal.frequency)
    first = (phase / arb.pi()).floor().unique_fmpz()
    if first is None:
        raise InputError(f"the sign of the square wave at t = 0 is not certain for the phase {signal.phase:g}")
    half, times = int(first), [arb(0)]
    levels = [arb(signal.constant) + (-1) ** half * arb(signal.amplitude)]
    while len(times) <= MOST_STEPS:
        half += 1
        at = (half * arb.pi() - phase) / frequency
        if not at < t_end:
            return times, levels
        times.append(at)
        levels.append(arb(signal.constant) + (-1) ** half * arb(signal.amplitude))
    raise InputError(f"the command jumps more than {MOST_STEPS} times up to t_end")
