"""Contestants, the check that they do the same work, and interleaved timing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

CHECK_STEPS = 2000
TOLERANCE = 1e-9
"""Tolerance relative to the largest entry of the state. Different orders of summation cause differences of some 1e-16 in each
step, which grow to about 1e-12 over 2000 steps of these loops. A wrong coefficient causes a difference of 1e-3."""

ENOUGH = 1.5
"""Seconds after which a contestant is no longer timed if it has had two turns."""


class Contestant(NamedTuple):
    """``run(steps)`` advances every member from its initial state and returns the final states, (size, M) or the first rows."""

    name: str
    steps: int  # number of steps in one timed call
    run: Callable[[int], np.ndarray]
    threads: bool = False  # whether it also uses other threads

    def seconds(self) -> float:
        """The time of one call. It is the thread's processor time, which other programs do not affect. With several threads it is
        elapsed time."""
        clock = time.perf_counter if self.threads else time.thread_time
        start = clock()
        self.run(self.steps)
        return clock() - start


def best_seconds(call: Callable[[], None], repeats: int) -> float:
    """The best of several calls in the thread's processor time."""
    best = np.inf
    for _ in range(repeats):
        started = time.thread_time()
        call()
        best = min(best, time.thread_time() - started)
    return best


class Time(NamedTuple):
    """Nanoseconds for one step of one member: the best of the repeats and the fraction by which the median is slower."""

    name: str
    best: float
    spread: float

    def __str__(self) -> str:
        return f"{self.best:.4g} ns (median +{100 * self.spread:.0f}%)"


class WrongNumbersError(Exception):
    """Raised if a contestant does not compute the same as the kernel, so its time would be meaningless."""


def check(contestants: Sequence[Contestant], expected: np.ndarray) -> None:
    """Raise WrongNumbersError unless all contestants have the kernel's state after ``CHECK_STEPS`` steps."""
    scale = np.abs(expected).max()
    for contestant in contestants:
        found = contestant.run(CHECK_STEPS)
        error = np.abs(found - expected[: len(found)]).max() / scale
        if not error <= TOLERANCE:
            raise WrongNumbersError(
                f"{contestant.name} is {error:.2g} (relative) off the kernel after {CHECK_STEPS} steps; "
                f"rounding explains at most {TOLERANCE:g}"
            )


def race(contestants: Sequence[Contestant], members: int, repeats: int) -> dict[str, Time]:
    """Time all contestants in turn several times, so a busy moment of the machine affects all of them."""
    samples: dict[str, list[float]] = {contestant.name: [] for contestant in contestants}
    assert len(samples) == len(contestants), "two contestants of one name would share their times"
    for turn in range(repeats):
        for contestant in contestants:
            if turn >= 2 and sum(samples[contestant.name]) * contestant.steps * members > ENOUGH * 1e9:
                continue
            samples[contestant.name].append(contestant.seconds() / contestant.steps / members * 1e9)
    return {name: Time(name, min(s), float(np.median(s)) / min(s) - 1) for name, s in samples.items()}


def fastest(contestants: Sequence[Contestant], members: int, count: int) -> list[Contestant]:
    """Run a short race first, so only the best variants of a peer take part in the long one."""
    times = race(contestants, members, 3)
    return sorted(contestants, key=lambda contestant: times[contestant.name].best)[:count]
