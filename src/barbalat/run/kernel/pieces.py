"""The pieces of a run between events: a break of a signal, a sample of a controller, new noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.measurement import Noise
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.attempt import Attempts, HeldPast
from barbalat.run.kernel.breaks import ON_GRID_ROUNDINGS
from barbalat.run.kernel.delay import brings_bends
from barbalat.run.kernel.portable import standard_normal_at
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

AT_AN_END = 1e-9
"""Share of a period: a sample this close to the beginning or end of a piece is treated as there."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The events of a loop over time.

    noise   of its measurement; None if there is none, or if it is left out
    number  the stream of that noise
    until   end of the run [s], beyond which signals are held and no jitter comes
    """

    attempts: Attempts
    noise: Noise | None = None
    number: int = 0
    until: float = np.inf

    def rows(self, kept: Array, values: Array | None = None, *, sampled_already: bool = False) -> Array:
        """(K, count) rows of the pieces of [kept[0], kept[-1]], followed by the end; the times ``kept`` (k,) [s] are kept
        exactly.

        values           values at which the signals are held; None if they continue
        sampled_already  whether a sample at the beginning has already been taken
        """
        signals = self.attempts.signals
        first, last, past = float(kept[0]), float(kept[-1]), self.attempts.past
        samples = _moved(self._samples(first, last), kept)
        renewed = np.zeros(0) if self.noise is None else _moved(_multiples(self.noise.sample_time, first, last), kept)
        arrivals = np.zeros(0) if past is None else past.delay + self._samples(first - past.delay, last - past.delay)
        fixed = np.union1d(kept, samples)
        begins = np.unique(np.concatenate([fixed, _moved(renewed, fixed), _moved(arrivals, fixed)]))
        ends, sampled = np.append(begins[1:], begins[-1]), np.isin(begins, samples)
        if sampled_already:
            sampled[0] = False
        driven = signals.rows(begins, ends) if values is None else signals.held(begins, values)
        return self.attempts.rows(ends, sampled, self._inside(begins), driven, self.noise_at(begins))

    def _samples(self, first: float, last: float) -> Array:
        """The instants from ``first`` to ``last`` [s] at which the controller samples."""
        loop = self.attempts.loop
        if loop.sample_time is None:
            return np.zeros(0)
        if loop.around is None or not loop.around.jitters:
            return _multiples(loop.sample_time, first, last)
        calls = self.attempts.calls(self.until)
        steady = loop.sample_time * np.arange(len(calls), np.ceil(last / loop.sample_time) + 1)
        calls, within = np.append(calls, steady), AT_AN_END * loop.sample_time
        return calls[(calls >= first - within) & (calls <= last + within)]

    def _inside(self, begins: Array) -> Array:
        """(K,) the samples that are in the delay when each piece begins."""
        loop, past = self.attempts.loop, self.attempts.past
        if past is None or loop.sample_time is None:
            return np.zeros(len(begins))
        samples, within = self._samples(0.0, float(begins[-1])), AT_AN_END * loop.sample_time
        entered, left = (np.searchsorted(samples, t + within, side="right") for t in (begins, begins - past.delay))
        return entered - left

    def noise_at(self, times: Array, before: Array | bool = False) -> Array:
        """(K, channels) the measurement's noise from these times (K,) [s] on, or up to them if ``before`` (K,) is true."""
        channels = self.attempts.loop.signals.noise
        if self.noise is None or not channels:
            return np.zeros((len(times), channels))
        periods = times / self.noise.sample_time
        rows = np.where(before, np.ceil(periods - AT_AN_END) - 1, np.floor(periods + AT_AN_END)).astype(int)
        return standard_normal_at(self.noise.seed, self.number, rows, channels)


def require_known_instants(loop: ClosedLoop, problem: TrackingProblem, simulation: Simulation) -> None:
    """InputError for features that can't yet be used with a tolerance, and for a sample time beyond the horizon."""
    if loop.sample_time is not None:
        require_within("sample_time", loop.sample_time, simulation.t_end)
    if problem.noise is not None:
        require_within("sensor.noise.sample_time", problem.noise.sample_time, simulation.t_end)
    if loop.delayed and brings_bends(loop):
        raise InputError.of(
            "simulation.tolerance",
            "allows a delay at the plant's input only after a sampled controller without dynamics in between: give simulation.dt",
        )
    if any(path is not None and path.rate_limit is not None for path in loop.paths):
        raise InputError.of("simulation.tolerance", "needs an input without a rate limit: give simulation.dt")


def past_of(loop: ClosedLoop, problem: TrackingProblem) -> HeldPast | None:
    """The content of the delay at the plant's input; None if there is none."""
    if not loop.delayed:
        return None
    assert loop.sample_time is not None
    jitters = loop.around is not None and loop.around.jitters
    return HeldPast.of(problem.delay, loop.sample_time, problem.history, jitters=jitters)


def require_within(field: str, period: float, t_end: float) -> None:
    """InputError for a period so long that the event would never happen."""
    if period > t_end:
        raise InputError.of(field, f"must not exceed simulation.t_end = {t_end:g} s, got {period:g} s")


def _multiples(period: float, first: float, last: float) -> Array:
    """The multiples of a period [s], none of them negative, from ``first`` to ``last`` [s]."""
    return period * np.arange(max(np.ceil(first / period - AT_AN_END), 0.0), np.floor(last / period + AT_AN_END) + 1)


def _moved(times: Array, kept: Array) -> Array:
    """The times [s], with those that equal one of ``kept`` up to rounding replaced by it."""
    after = np.searchsorted(kept, times).clip(1, len(kept) - 1)
    near = np.where(times - kept[after - 1] < kept[after] - times, kept[after - 1], kept[after])
    return np.where(np.abs(times - near) <= ON_GRID_ROUNDINGS * np.finfo(float).eps * np.abs(times), near, times)
