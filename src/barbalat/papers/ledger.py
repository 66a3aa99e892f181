"""Measures a paper's claims in as many processes as there are cores, and finds the rows of all papers by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from barbalat.budget import Progress
from barbalat.certificates.certify import Certified
from barbalat.papers.claim import Claim, Measurement
from barbalat.papers.paper import Paper, paper_of, papers
from barbalat.processes import deaf_children
from barbalat.processes import processes as own_processes
from barbalat.validate import InputError, hint


class Measured(NamedTuple):
    """Measured rows, with the seconds that they took and the seconds that were ``expected``."""

    claims: list[Claim]
    seconds: float
    expected: float


Told: TypeAlias = Callable[[Measured], None]


@dataclass(frozen=True)
class UnderWay:
    """The work of other processes: rows by their positions in the paper's ledger, its certificates, and other tasks by name.

    pool  the processes; tasks that are submitted later start after these
    """

    rows: dict[tuple[int, ...], Future[list[Measured]]]
    certified: Future[Certified]
    others: dict[str, Future[Any]]
    pool: ProcessPoolExecutor


class Other(NamedTuple):
    """Tasks to be done in addition to the rows, with their estimated seconds."""

    make: Callable[[], Any]
    seconds: float


@contextmanager
def under_way(
    paper: Paper,
    processes: int,
    *,
    quick: bool = False,
    full: bool = False,
    told: Told | None = None,
    others: Mapping[str, Other] | None = None,
) -> Iterator[UnderWay]:
    """Start the measurement of a paper's independent rows in ``processes`` processes. The result is for ``measure``.

    Each process begins with a quick row, so results appear soon. Then the longest tasks, including ``others``, start first, so
    all processes finish at about the same time. ``told`` is called from a different thread with each row as soon as it is
    measured. New processes import the program that calls this, so it must start its work below ``if __name__ == "__main__"``.
    """
    others, rows = others or {}, paper.ledger
    alone = [i for i in _chosen(paper, quick) if not rows[i].judges_runs]
    first = [i for i in alone if rows[i].quick and rows[i].duration(full=full) < 1][:processes]
    jobs = _together(paper, [i for i in alone if i not in first])
    waiting: list[tuple[float, tuple[int, ...] | str]] = [(other.seconds, name) for name, other in others.items()]
    waiting += [(sum(rows[i].duration(full=full) for i in job), job) for job in jobs]
    with own_processes(processes) as pool:
        with deaf_children():
            quick_ones: list[tuple[int, ...]] = [(i,) for i in first]
            ahead = {job: _submitted(pool, paper, job, full, told) for job in quick_ones}
            certified, made = pool.submit(_certified, paper.name), {}
            for _, job in sorted(waiting, key=lambda one: -one[0]):
                if isinstance(job, str):
                    made[job] = pool.submit(others[job].make)
                else:
                    ahead[job] = _submitted(pool, paper, job, full, told)
        yield UnderWay(ahead, certified, made, pool)


def _together(paper: Paper, places: list[int]) -> list[tuple[int, ...]]:
    """Return the groups of rows that one process measures in sequence: rows that share runs together, the others alone."""
    found: dict[str, tuple[int, ...]] = {}
    for i in places:
        shared = paper.ledger[i].shares or f"alone {i}"
        found[shared] = (*found.get(shared, ()), i)
    return list(found.values())


def _submitted(
    pool: ProcessPoolExecutor, paper: Paper, places: tuple[int, ...], full: bool, told: Told | None
) -> Future[list[Measured]]:
    future = pool.submit(_several, paper.name, places, full)

    def done(finished: Future[list[Measured]]) -> None:
        if told is not None and not finished.cancelled() and finished.exception() is None:
            for measured in finished.result():
                told(measured)

    future.add_done_callback(done)
    return future


def _certified(paper: str) -> Certified:
    return paper_of(paper).certified()


def _several(paper: str, places: tuple[int, ...], full: bool) -> list[Measured]:
    """Measure several rows in a different process, which finds the paper by its name."""
    return [_rows(paper_of(paper).ledger[place], full) for place in places]


def _rows(measurement: Measurement, full: bool, *runs: Any) -> Measured:
    started = time.perf_counter()
    claims = measurement.rows(*runs, full=full)
    return Measured(claims, time.perf_counter() - started, measurement.duration(full=full))


def _chosen(paper: Paper, quick: bool) -> list[int]:
    return [i for i, measurement in enumerate(paper.ledger) if measurement.quick or not quick]


def measure(
    paper: Paper,
    runs: Any,
    *,
    quick: bool = False,
    full: bool = False,
    progress: Progress | None = None,
    ahead: UnderWay | None = None,
    told: Told | None = None,
    taken: Callable[[list[Claim]], None] | None = None,
) -> list[Claim]:
    """Measure a paper's ledger.

    runs   the results of ``paper.run``
    quick  omit rows that take longer than the figures
    full   sharpen rows
    ahead  work that is already running
    told   called with the rows that are measured in this process
    taken  called with all rows, in the order in which they are finished
    """
    chosen, rows = _chosen(paper, quick), {} if ahead is None else ahead.rows
    seconds = {i: paper.ledger[i].duration(full=full) for i in chosen}
    found: dict[int, list[Claim]] = {}

    def take(place: int, measured: Measured) -> None:
        found[place] = measured.claims
        if taken is not None:
            taken(measured.claims)
        if progress is not None:
            progress(sum(seconds[i] for i in found) / sum(seconds.values()))

    elsewhere = {i for job in rows for i in job}
    for i in chosen:
        if i not in elsewhere:
            here = _rows(paper.ledger[i], full, *([runs] if paper.ledger[i].judges_runs else []))
            if told is not None:
                told(here)
            take(i, here)
    jobs = {future: job for job, future in rows.items()}
    for future in as_completed(jobs):
        for i, measured in zip(jobs[future], future.result(), strict=True):
            take(i, measured)
    return [row for i in chosen for row in found[i]]


def part_with(name: str) -> tuple[Paper, Measurement]:
    """Return the paper and the measurement of a row. Raises InputError if no row, or rows of several papers, have the name."""
    found = [(paper, part) for paper in papers().values() for part in paper.ledger if name in part.names]
    if not found:
        names = [own for paper in papers().values() for part in paper.ledger for own in part.names]
        raise InputError(f"the ledger has no row named {name!r}{hint(name, names)} (barbalat claims lists the rows)")
    if len(found) > 1:
        raise InputError(f"several papers have a row named {name!r}: {', '.join(paper.name for paper, _ in found)}")
    return found[0]


def row(name: str) -> Claim:
    """Measure one row, together with the other rows of its measurement, and with the paper's runs if it judges them."""
    paper, part = part_with(name)
    return next(claim for claim in part.rows(*([paper.run(None)] if part.judges_runs else [])) if claim.id == name)
