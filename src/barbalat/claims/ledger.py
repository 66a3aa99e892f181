"""All claims of the paper, measured in order."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context, resource_tracker
from threading import current_thread, main_thread
from typing import TypeAlias

from barbalat.claims import (
    adapting_margins,
    any_command,
    condition,
    control_oscillation,
    delta_2,
    does_better,
    figures,
    filter_margins,
    l1_reference,
    learning,
    lemma_1,
    linear_design,
    numerics,
    onset,
    output_feedback,
    robustness,
    sampled,
    stiff,
    theta_size,
    tracking,
    unmodelled,
)
from barbalat.claims.claim import Claim
from barbalat.claims.section_v import Runs
from barbalat.run.progress import Progress


@dataclass(frozen=True)
class Measurement:
    """Some of the ledger's rows, and about how many seconds they take: the progress bar moves by that.

    ``measure`` stands alone, or judges the runs of Section V, which it is then given. ``sharper`` measures the same rows further
    than the plain command has time for, which is ``reproduce --full``; no verdict waits for it.
    """

    measure: Callable[..., Claim | list[Claim]]
    seconds: float
    quick: bool = False
    judges_runs: bool = False
    sharper: Callable[..., Claim | list[Claim]] | None = None
    sharper_seconds: float = 0.0

    def rows(self, *runs: Runs, full: bool = False) -> list[Claim]:
        """The rows."""
        measure = self.sharper if full and self.sharper else self.measure
        found = measure(*runs)
        return [found] if isinstance(found, Claim) else found

    def duration(self, *, full: bool) -> float:
        """About how many seconds the rows take."""
        return self.sharper_seconds if full and self.sharper else self.seconds


LEDGER = (
    Measurement(figures.as_described, 0.1, quick=True, judges_runs=True),
    Measurement(figures.without_projection, 0.1, quick=True, judges_runs=True),
    Measurement(figures.erratum_claim, 0.1, quick=True, judges_runs=True),
    Measurement(tracking.bound_9, 0.4, quick=True, sharper=tracking.bound_9_further, sharper_seconds=6.0),
    Measurement(tracking.bound_10, 0.6, quick=True, sharper=tracking.bound_10_further, sharper_seconds=8.0),
    Measurement(tracking.bias_is_proportional, 0.1, quick=True),
    Measurement(tracking.best_at_zero, 0.2, quick=True),
    Measurement(tracking.constant_command, 0.3, quick=True),
    Measurement(tracking.is_mrac, 0.1, quick=True),
    Measurement(condition.condition, 0.4, quick=True),
    Measurement(theta_size.filter_limits_theta, 2.6),
    Measurement(numerics.come_and_go, 0.1, quick=True, judges_runs=True),
    Measurement(onset.boundary, 5.0, judges_runs=True),
    Measurement(numerics.without_filter, 0.1),
    Measurement(numerics.smaller_gain, 0.1),
    Measurement(numerics.small_tau, 0.3),
    Measurement(stiff.own_oscillation, 3.5),
    Measurement(stiff.stiff_solvers, 10.0, sharper=stiff.stiff_solvers_further, sharper_seconds=120.0),
    Measurement(sampled.claim, 1.0),
    Measurement(sampled.delays, 1.0),
    Measurement(adapting_margins.gain_reduces_margins, 0.5),
    Measurement(filter_margins.claim, 8.0),
    Measurement(robustness.claims, 4.5),
    Measurement(lemma_1.claims, 2.0),
    Measurement(linear_design.claims, 5.5),
    Measurement(learning.loss_of_learning, 0.1, quick=True, judges_runs=True),
    Measurement(learning.exponential, 0.3, quick=True),
    Measurement(delta_2.claim, 2.0, sharper=partial(delta_2.claim, full=True), sharper_seconds=3.5),
    Measurement(any_command.claim, 2.5, sharper=partial(any_command.claim, full=True), sharper_seconds=20.0),
    Measurement(unmodelled.claim, 2.0, sharper=partial(unmodelled.claim, full=True), sharper_seconds=4.0),
    Measurement(control_oscillation.claim, 2.5, sharper=partial(control_oscillation.claim, full=True), sharper_seconds=7.5),
    Measurement(does_better.claim, 6.5, sharper=partial(does_better.claim, full=True), sharper_seconds=7.0),
    Measurement(l1_reference.claim, 1.5, sharper=partial(l1_reference.claim, full=True), sharper_seconds=4.0),
    Measurement(output_feedback.l1_is_linear, 0.4),
    Measurement(output_feedback.rohrs, 0.4),
    Measurement(output_feedback.any_relative_degree, 1.4),
)


UnderWay: TypeAlias = "dict[int, Future[list[Claim]]]"
"""By the place in ``LEDGER``: what is being measured in another process."""


@contextmanager
def under_way(processes: int, *, quick: bool = False, full: bool = False) -> Iterator[UnderWay]:
    """Measure what stands alone in so many processes of its own, the longest first; to be given to ``measure``.

    The program that calls this must be one that a new process may import: started by ``if __name__ == "__main__"``.
    """
    alone = [i for i in _chosen(quick) if not LEDGER[i].judges_runs]
    others = active_children()
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    try:
        with _deaf_children():
            longest_first = sorted(alone, key=lambda i: -LEDGER[i].duration(full=full))
            ahead = {i: pool.submit(_rows, i, full) for i in longest_first}
        yield ahead
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()  # nobody waits for what it measures
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes that start meanwhile leave Ctrl-C, which a terminal sends to all, to this one: they would print tracebacks.

    They inherit that it is blocked. Here it is neither lost, nor does it interrupt a process that is half started: it waits.
    """
    if sys.platform == "win32" or current_thread() is not main_thread():  # where signals can't be set, and none arrive
        yield
        return
    resource_tracker.ensure_running()  # it would unblock the signal when the first process starts it
    waiting: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: waiting.append(number))  # another thread may be the one to get it
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
    if waiting:
        signal.raise_signal(signal.SIGINT)


def _rows(place: int, full: bool) -> list[Claim]:
    return LEDGER[place].rows(full=full)


def _chosen(quick: bool) -> list[int]:
    return [i for i, measurement in enumerate(LEDGER) if measurement.quick or not quick]


def measure(
    runs: Runs, *, quick: bool = False, full: bool = False, progress: Progress | None = None, ahead: UnderWay | None = None
) -> list[Claim]:
    """The ledger. ``quick`` leaves out what takes longer than the figures, ``full`` sharpens rows, ``ahead`` is already under way."""
    chosen, ahead = _chosen(quick), ahead or {}
    seconds = {i: LEDGER[i].duration(full=full) for i in chosen}
    found: dict[int, list[Claim]] = {}

    def take(place: int, rows: list[Claim]) -> None:
        found[place] = rows
        if progress is not None:
            progress(sum(seconds[i] for i in found) / sum(seconds.values()))

    for i in chosen:
        if i not in ahead:
            take(i, LEDGER[i].rows(*([runs] if LEDGER[i].judges_runs else []), full=full))
    places = {future: i for i, future in ahead.items()}
    for future in as_completed(places):
        take(places[future], future.result())
    return [row for i in chosen for row in found[i]]
