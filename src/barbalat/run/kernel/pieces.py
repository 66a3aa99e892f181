"""The pieces of a run between instants at which something happens: a signal breaks, a controller samples, noise is renewed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.problem.measurement import Noise
from barbalat.run.kernel.attempt import Attempts
from barbalat.run.kernel.breaks import ON_GRID_ROUNDINGS
from barbalat.run.kernel.portable import standard_normal_at
from barbalat.validate import Array, InputError

AT_AN_END = 1e-9
"""Of a period: a sample so near to where pieces begin or end is meant to lie there."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """What happens to a loop at instants of its own.

    noise  of its measurement; None where there is none, or where it is left out
    """

    attempts: Attempts
    noise: Noise | None = None

    def rows(self, kept: Array, values: Array | None = None, *, sampled_already: bool = False) -> Array:
        """(K, count) rows of the pieces of [kept[0], kept[-1]], with the end behind the last; ``kept`` (k,) [s] are kept exactly.

        values           at which the signals are held; None where they go on
        sampled_already  whether a sample at the beginning is over
        """
        loop, signals = self.attempts.loop, self.attempts.signals
        samples = np.zeros(0) if loop.sample_time is None else _moved(_multiples(loop.sample_time, kept), kept)
        renewed = np.zeros(0) if self.noise is None else _moved(_multiples(self.noise.sample_time, kept), kept)
        begins = np.unique(np.concatenate([kept, samples, _moved(renewed, np.union1d(kept, samples))]))
        ends, sampled = np.append(begins[1:], begins[-1]), np.isin(begins, samples)
        if sampled_already:
            sampled[0] = False
        driven = signals.rows(begins, ends) if values is None else signals.held(begins, values)
        return self.attempts.rows(ends, sampled, driven, self.noise_at(begins))

    def noise_at(self, times: Array) -> Array:
        """(K, channels) the measurement's noise from these times (K,) [s] on."""
        channels = self.attempts.loop.signals.noise
        if self.noise is None or not channels:
            return np.zeros((len(times), channels))
        rows = np.floor(times / self.noise.sample_time + AT_AN_END).astype(int)
        return standard_normal_at(self.noise.seed, 0, rows, channels)


def require_within(field: str, period: float, t_end: float) -> None:
    """InputError for one so long that nothing would ever happen."""
    if period > t_end:
        raise InputError.of(field, f"must not exceed simulation.t_end = {t_end:g} s, got {period:g} s")


def _multiples(period: float, kept: Array) -> Array:
    """The multiples of a period [s] from the first to the last of these times."""
    first, last = np.ceil(kept[0] / period - AT_AN_END), np.floor(kept[-1] / period + AT_AN_END)
    return period * np.arange(first, last + 1)


def _moved(times: Array, kept: Array) -> Array:
    """The times [s], of which those that are one of ``kept`` but for roundings are that one."""
    after = np.searchsorted(kept, times).clip(1, len(kept) - 1)
    near = np.where(times - kept[after - 1] < kept[after] - times, kept[after - 1], kept[after])
    return np.where(np.abs(times - near) <= ON_GRID_ROUNDINGS * np.finfo(float).eps * np.abs(times), near, times)
