"""All claims of the paper, measured in order."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from multiprocessing import active_children, get_context, resource_tracker
from threading import current_thread, main_thread
from typing import Any, NamedTuple, TypeAlias

from barbalat.certificates.overview import Certified
from barbalat.claims import (
    adapting_margins,
    condition,
    figures,
    filter_margins,
    learning,
    lemma_1,
    linear_design,
    numerics,
    onset,
    output_feedback,
    robustness,
    sampled,
    section_v,
    stiff,
    theorem_2,
    theta_size,
    tracking,
)
from barbalat.claims.claim import Claim
from barbalat.claims.paper_certificates import certified_paper
from barbalat.claims.section_v import Runs
from barbalat.run.progress import Progress
from barbalat.validate import InputError

RUNS_OF_SECTION_V = 6.0
"""Seconds that the runs take which some rows judge, about."""


@dataclass(frozen=True)
class Measurement:
    """Some of the ledger's rows.

    names    the rows' names, and what each is about in a few words: a row can be found before it is measured
    seconds  what they take in a process of their own, about: the longest are begun first, and the time that is left is forecast
    ``measure`` stands alone, or judges the runs of Section V, which it is then given.
    """

    measure: Callable[..., Claim | list[Claim]]
    seconds: float
    names: Mapping[str, str]
    quick: bool = False
    judges_runs: bool = False

    def rows(self, *runs: Runs) -> list[Claim]:
        """The rows."""
        found = self.measure(*runs)
        return [found] if isinstance(found, Claim) else found

    def as_json(self) -> list[dict[str, Any]]:
        """A block for each row, without a verdict: that is measured."""
        return [{"id": name, "about": about, "seconds": self.seconds, "quick": self.quick} for name, about in self.names.items()]


LEDGER = (
    Measurement(figures.as_described, 0.1, {"figures-2-5": "Figures 2 to 5 look as described"}, quick=True, judges_runs=True),
    Measurement(
        figures.without_projection, 0.1, {"no-projection": "boundedness is the projection's doing"}, quick=True, judges_runs=True
    ),
    Measurement(figures.erratum_claim, 0.1, {"erratum-14": "the sign of W_c0 in (14)"}, quick=True, judges_runs=True),
    Measurement(tracking.bound_9, 0.6, {"bound-9": "the standard MRAC's bound (9)"}, quick=True),
    Measurement(tracking.bound_10, 0.8, {"bound-10": "L1-AC's bound (10)"}, quick=True),
    Measurement(tracking.bias_is_proportional, 0.1, {"bias-kappa": "the filter's steady error"}, quick=True),
    Measurement(tracking.best_at_zero, 0.2, {"best-kappa-zero": "the bound (10) is best without a filter"}, quick=True),
    Measurement(tracking.constant_command, 0.4, {"constant-command": "errors for constant r"}, quick=True),
    Measurement(tracking.is_mrac, 0.2, {"filtered-mrac": "L1-AC with C = 1 is the standard MRAC"}, quick=True),
    Measurement(condition.condition, 0.4, {"kappa-0.05": "for which kappa the condition holds"}, quick=True),
    Measurement(
        theta_size.filter_limits_theta, 1.6, {"filter-limits-theta": "the filter limits the size of the unknown parameters"}
    ),
    Measurement(
        numerics.come_and_go, 0.1, {"numerical-oscillation": "the oscillations are numerical"}, quick=True, judges_runs=True
    ),
    Measurement(onset.boundary, 6.0, {"boundary": "where the oscillations begin"}, judges_runs=True),
    Measurement(
        numerics.without_filter, 0.2, {"oscillation-without-filter": "the filter does not cause the oscillations"}
    ),
    Measurement(numerics.smaller_gain, 0.2, {"smaller-gain": "a smaller gain removes the oscillations"}),
    Measurement(numerics.small_tau, 0.4, {"small-tau-numerics": "a very small tau fails numerically"}),
    Measurement(stiff.own_oscillation, 5.7, {"own-oscillation": "at h = 1e-5 s the oscillation is gone"}),
    Measurement(stiff.stiff_solvers, 7.0, {"stiff-solvers": "solvers for stiff problems"}),
    Measurement(sampled.claim, 1.6, {"sampled-midpoint": "a sampled law that no gain destabilises"}),
    Measurement(sampled.delays, 0.9, {"sampled-delay": "sampled controllers and delays"}),
    Measurement(
        adapting_margins.claims, 1.9,
        {
            "filter-margins-adapting": "margins of the adapting loop, with and without the filter",
            "gain-reduces-margins": "a high adaptive gain reduces robustness",
        },
    ),
    Measurement(filter_margins.claim, 9.0, {"filter-reduces-margins": "the filter reduces the margins"}),
    Measurement(robustness.tau_and_error, 0.3, {"tau-error": "the robust MRAC's error is proportional to tau"}),
    Measurement(
        theorem_2.claims, 5.0,
        {
            "tau-limit-delay": "the lower limit of tau with an input delay",
            "tau-limit-mu": "the lower limit of tau with Delta_m = -mu s",
        },
    ),
    Measurement(
        lemma_1.claims, 2.5,
        {
            "lemma-1-bounded": "what Lemma 1 (i) bounds",
            "lemma-1-no-error": "Lemma 1 (ii) without modelling error",
            "lemma-1-small": "Lemma 1 (ii) with a modelling error",
        },
    ),
    Measurement(
        linear_design.claims, 7.0,
        {
            "adaptive-against-linear": "adaptive schemes against linear robust designs",
            "l1-against-pi": "L1-AC against a PI controller",
        },
    ),
    Measurement(
        learning.loss_of_learning, 0.1, {"loss-of-learning": "numerical instability and learning"}, quick=True, judges_runs=True
    ),
    Measurement(learning.exponential, 0.5, {"exponential-convergence": "exponential convergence of the estimates"}, quick=True),
    Measurement(output_feedback.l1_is_linear, 0.6, {"l1-output-is-lti": "the L1 output-feedback controller is linear"}),
    Measurement(output_feedback.rohrs, 1.0, {"rohrs": "Rohrs' example"}),
    Measurement(
        output_feedback.any_relative_degree, 2.0, {"siso-any-relative-degree": "the robust MRAC for any relative degree"}
    ),
)  # fmt: skip


class Measured(NamedTuple):
    """Rows, and how many seconds they took where ``expected`` were forecast."""

    claims: list[Claim]
    seconds: float
    expected: float


Told: TypeAlias = Callable[[Measured], None]


@dataclass(frozen=True)
class UnderWay:
    """What other processes are at: rows by their place in ``LEDGER``, and the certificates of Section V."""

    rows: dict[int, Future[Measured]]
    certified: Future[Certified]


@contextmanager
def under_way(processes: int, *, quick: bool = False, told: Told | None = None) -> Iterator[UnderWay]:
    """Measure what stands alone in so many processes of its own, the longest first; to be given to ``measure``.

    A quick row for each process comes before them all: somebody is looking. ``told`` is called of each as soon as it is
    measured, from another thread. The program that calls this must be one that a new process may import: started by
    ``if __name__ == "__main__"``.
    """
    alone = [i for i in _chosen(quick) if not LEDGER[i].judges_runs]
    first = [i for i in alone if LEDGER[i].quick][:processes]
    others = active_children()
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    try:
        with _deaf_children():
            ahead = {i: _submitted(pool, i, told) for i in first}
            certified = pool.submit(certified_paper)
            ahead |= {i: _submitted(pool, i, told) for i in sorted(set(alone) - set(first), key=lambda i: -LEDGER[i].seconds)}
        yield UnderWay(ahead, certified)
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()  # nobody waits for what it measures
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _submitted(pool: ProcessPoolExecutor, place: int, told: Told | None) -> Future[Measured]:
    future = pool.submit(_rows, place)

    def done(finished: Future[Measured]) -> None:
        if told is not None and not finished.cancelled() and finished.exception() is None:
            told(finished.result())

    future.add_done_callback(done)
    return future


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


def _rows(place: int, *runs: Runs) -> Measured:
    started = time.perf_counter()
    claims = LEDGER[place].rows(*runs)
    return Measured(claims, time.perf_counter() - started, LEDGER[place].seconds)


def _chosen(quick: bool) -> list[int]:
    return [i for i, measurement in enumerate(LEDGER) if measurement.quick or not quick]


def measure(
    runs: Runs,
    *,
    quick: bool = False,
    progress: Progress | None = None,
    ahead: UnderWay | None = None,
    told: Told | None = None,
    taken: Callable[[list[Claim]], None] | None = None,
) -> list[Claim]:
    """The ledger; ``quick`` leaves out what takes longer than the figures themselves, ``ahead`` is already under way.

    told   is called of the rows that are measured here
    taken  is called with all rows, in the order in which they are done
    """
    chosen, rows = _chosen(quick), {} if ahead is None else ahead.rows
    found: dict[int, list[Claim]] = {}

    def take(place: int, measured: Measured) -> None:
        found[place] = measured.claims
        if taken is not None:
            taken(measured.claims)
        if progress is not None:
            progress(sum(LEDGER[i].seconds for i in found) / sum(LEDGER[i].seconds for i in chosen))

    for i in chosen:
        if i not in rows:
            here = _rows(i, *([runs] if LEDGER[i].judges_runs else []))
            if told is not None:
                told(here)
            take(i, here)
    places = {future: i for i, future in rows.items()}
    for future in as_completed(places):
        take(places[future], future.result())
    return [row for i in chosen for row in found[i]]


def part_with(name: str) -> Measurement:
    """What measures a row. InputError for a name that is none."""
    names = {own: part for part in LEDGER for own in part.names}
    if name not in names:
        near = get_close_matches(name, names, n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        raise InputError(f"no row of the ledger is called {name!r}{meant} (barbalat claims lists them)")
    return names[name]


def row(name: str) -> Claim:
    """One row, measured with those of its subject, and with the runs of Section V where it judges them."""
    part = part_with(name)
    return next(claim for claim in part.rows(*([section_v.run()] if part.judges_runs else [])) if claim.id == name)
