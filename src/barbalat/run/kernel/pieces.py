"""The pieces of a run between events: a break of a signal, a sample of a controller, new noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import budget
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.measurement import Noise
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.attempt import Attempts
from barbalat.run.kernel.breaks import ON_GRID_ROUNDINGS
from barbalat.run.kernel.delay import brings_bends
from barbalat.run.kernel.portable import standard_normal_at
from barbalat.solvers.simulation import STEP, Simulation
from barbalat.validate import Array, InputError

AT_AN_END = 1e-9
"""Fraction of a period: a sample closer than this to the beginning or end of a piece is treated as occurring there."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The events of a loop over time.

    noise   the measurement's noise; None without noise, or if it is omitted
    number  the stream of that noise
    until   end of the run [s], after which signals are held and there is no jitter
    """

    attempts: Attempts
    noise: Noise | None = None
    number: int = 0
    until: float = np.inf

    def rows(self, kept: Array, values: Array | None = None, *, sampled_already: bool = False) -> Array:
        """(K, count) rows of the pieces of [kept[0], kept[-1]], followed by the end; the times ``kept`` (k,) [s] are kept
        exactly.

        values           values at which the signals are held; None if the signals continue
        sampled_already  whether a sample at the beginning has already been taken
        """
        signals = self.attempts.signals
        first, last = float(kept[0]), float(kept[-1])
        samples = _moved(self._samples(first, last), kept)
        renewed = np.zeros(0) if self.noise is None else _moved(_multiples(self.noise.sample_time, first, last), kept)
        fixed = np.union1d(kept, samples)
        begins = np.union1d(fixed, _moved(renewed, fixed))
        ends, sampled = np.append(begins[1:], begins[-1]), np.isin(begins, samples)
        if sampled_already:
            sampled[0] = False
        driven = signals.rows(begins, ends) if values is None else signals.held(begins, values)
        return self.attempts.rows(ends, sampled, driven, self.noise_at(begins))

    def _samples(self, first: float, last: float) -> Array:
        """The instants from ``first`` to ``last`` [s] at which the controller samples."""
        loop = self.attempts.sampling
        if loop.sample_time is None:
            return np.zeros(0)
        if loop.around is None or not loop.around.jitters:
            return _multiples(loop.sample_time, first, last)
        calls = self.attempts.calls(self.until)
        steady = loop.sample_time * np.arange(len(calls), np.ceil(last / loop.sample_time) + 1)
        calls, within = np.append(calls, steady), AT_AN_END * loop.sample_time
        return calls[(calls >= first - within) & (calls <= last + within)]

    def noise_at(self, times: Array, before: Array | bool = False) -> Array:
        """(K, channels) the measurement's noise after these times (K,) [s], or before them where ``before`` (K,) is true."""
        channels = self.attempts.loop.signals.noise
        if self.noise is None or not channels:
            return np.zeros((len(times), channels))
        periods = times / self.noise.sample_time
        rows = np.where(before, np.ceil(periods - AT_AN_END) - 1, np.floor(periods + AT_AN_END)).astype(int)
        return standard_normal_at(self.noise.seed, self.number, rows, channels)


def require_known_instants(loop: ClosedLoop, problem: TrackingProblem, simulation: Simulation) -> None:
    """Raise InputError for features that cannot yet be used with a tolerance, and for a sample time beyond the horizon."""
    loop.require_run()
    if loop.sample_time is not None:
        require_within("sample_time", loop.sample_time, simulation.t_end)
    if problem.noise is not None:
        require_within("sensor.noise.sample_time", problem.noise.sample_time, simulation.t_end)
    if loop.delayed and brings_bends(loop):
        steps, t_end = simulation.t_end / problem.delay, simulation.t_end
        budget.require(
            "plant.input.delay", int(min(steps, 1e30)), STEP.times,
            given=f"= {problem.delay:g} s makes {steps:.3g} steps up to t_end = {t_end:g}, which",
            fits=lambda most: f"a delay of {t_end / most:.3g} s",
        )  # fmt: skip


def require_within(field: str, period: float, t_end: float) -> None:
    """Raise InputError for a period longer than the run, during which the event would never occur."""
    if period > t_end:
        raise InputError.of(field, f"must not exceed simulation.t_end = {t_end:g} s, got {period:g} s")


def _multiples(period: float, first: float, last: float) -> Array:
    """The nonnegative multiples of a period [s] from ``first`` to ``last`` [s]."""
    return period * np.arange(max(np.ceil(first / period - AT_AN_END), 0.0), np.floor(last / period + AT_AN_END) + 1)


def _moved(times: Array, kept: Array) -> Array:
    """The times [s], in which times that equal one of ``kept`` up to rounding are replaced by it."""
    after = np.searchsorted(kept, times).clip(1, len(kept) - 1)
    near = np.where(times - kept[after - 1] < kept[after] - times, kept[after - 1], kept[after])
    return np.where(np.abs(times - near) <= ON_GRID_ROUNDINGS * np.finfo(float).eps * np.abs(times), near, times)
