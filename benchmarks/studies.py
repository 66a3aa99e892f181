"""Sweeps of Section V's L1 loop: threads, Dask's workers, stores, from a thousand members to a million, from 10 s to 1,000 s.

Costs are the processor time of all processes that take part, in ns for one solver step of one member with all metrics. Other
programs hardly affect it. Rates use elapsed time and are lower on a busy machine.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from barbalat.cases.load import CaseText
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps.chunks import Chunk, chunks_of
from barbalat.sweeps.cluster import Scheduler, Workers, connected
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.settling import Settling, Work
from barbalat.sweeps.store import opened
from barbalat.sweeps.study import Study
from benchmarks.house import Section
from benchmarks.table import Row

STEP = 1e-3
L1 = """
[[controller]]
name = "L1"
scheme = "l1"
gamma = 1e3
filter = { kappa = 0.02 }
"""
SAMPLED = [("plant.theta", "known-set"), ("controller[0].gamma", "loguniform:100:1000")]
MILLION, HORIZON = 1_000_000, 60.0
MINUTES = 10.0
"""Target time for a million members of one minute."""
TIMED_STEPS = 1e9
"""Number of member steps after which nothing is timed again. They take some seconds; shorter runs have to be repeated."""
CHUNK = 5_000
"""Number of members of one minute that together take about a second."""


@dataclass(frozen=True)
class Cost:
    """Processor time and elapsed time [s] of a number of member steps."""

    busy: float
    wall: float
    member_steps: float

    @property
    def each(self) -> float:
        """The cost of one step of one member [ns]."""
        return self.busy / self.member_steps * 1e9

    def without(self, once: float) -> Cost:
        """The cost without this number of seconds of one-time costs."""
        return replace(self, busy=self.busy - once)

    def __str__(self) -> str:
        return f"{self.each:.3g} ns, {self.member_steps / self.wall:.3g} steps/s"


def study(members: int, t_end: float) -> Study:
    """The compiled study, after a run of one member."""
    head, _, _ = CaseText.read("paper").text.partition("[[controller]]")
    text = CaseText(head.replace("t_end = 60.0", f"t_end = {t_end}").replace("dt = 1e-4", f"dt = {STEP}") + L1)
    plan = Plan({}, sampled(text, SAMPLED), members)
    return Study(VariedCase(text, plan.paths), plan)


def prepared(members: int, t_end: float) -> Study:
    """The study with its kernel, after a run of one member."""
    found = study(members, t_end)
    found.run(0, 1, threads=1)
    return found


def measured(given: Study, call: Callable[[], object], repeats: int) -> Cost:
    """The best of several calls that run all members, each timed separately. Short calls are repeated more often."""
    costs, steps = [], float(len(given)) * given.steps
    for _ in range(max(repeats, min(int(TIMED_STEPS / steps), 20))):
        busy, wall = time.process_time(), time.perf_counter()
        call()
        costs.append(Cost(time.process_time() - busy, time.perf_counter() - wall, steps))
    return min(costs, key=lambda cost: cost.busy)


def in_threads(given: Study, threads: int | None, repeats: int = 1) -> Cost:
    def call() -> None:
        for chunk in chunks_of(len(given), CHUNK):
            given.run(*chunk, threads=threads)

    return measured(given, call, repeats)


def scaling(*, quick: bool) -> Section:
    """The cost of a member's step for several numbers of members and lengths of runs. One-time costs are listed separately."""
    begun = time.process_time()
    first = study(1, 10.0)
    asked, begun = time.process_time() - begun, time.process_time()
    first.run(0, 1, threads=1)
    compiled = time.process_time() - begun
    numbers = (1_000, 4_000) if quick else (1_000, 10_000, 100_000, MILLION)
    lengths = (10.0, 100.0) if quick else (10.0, 100.0, 1000.0)
    half, whole = (in_threads(prepared(CHUNK, t_end), 1, 5).busy / CHUNK for t_end in (0.5, 1.0))
    set_up = 2 * half - whole
    by_number = {number: in_threads(prepared(number, 10.0), 1, 2).without(number * set_up) for number in numbers}
    by_length = {t_end: in_threads(prepared(1_000, t_end), 1, 2).without(1_000 * set_up) for t_end in lengths}
    rows = [
        *_against_the_first(by_number, "{:,.0f} members of 10 s"),
        *_against_the_first(by_length, "1,000 members of {:,.0f} s"),
    ]
    once = f"{asked:.2f} s to find out how each number varies, {compiled:.2f} s to compile"
    return rows, [f"beside that, once: {once}; once for each member: {1e6 * set_up:.1f} us"]


def _against_the_first(costs: Mapping[int, Cost] | Mapping[float, Cost], what: str) -> list[Row]:
    """The relative difference of each from the first, in either direction."""
    (least, base), *others = costs.items()
    beside = f"{what.format(least)}: {base}"
    return [
        Row(what.format(size), str(cost), beside, max(cost.each / base.each, base.each / cost.each), at_most=1.1)
        for size, cost in others
    ]


def spread(*, quick: bool) -> Section:
    """Compare one thread, two threads, a store and two Dask workers on the same members, in chunks of one second or less with
    --quick."""
    if find_spec("distributed") is None or find_spec("pyarrow") is None:
        return [], ["skipped: the extra study is not installed"]
    t_end, repeats = (HORIZON / 4, 1) if quick else (HORIZON, 3)
    given = prepared(4 * CHUNK, t_end)
    most = None if quick else 1.05
    one, two = in_threads(given, 1, repeats), in_threads(given, 2, repeats)
    stored, opening = _stored(given)
    dask, starting = _on_workers(given, repeats)
    return [
        Row("two threads, by the clock", str(two), f"one: {one}", one.wall / two.wall, at_least=1.8),
        Row("one thread and a store", f"{stored:.3g} ns more", str(one), 1 + stored / one.each, at_most=most),
        Row("two Dask workers, all processes", str(dask), f"one thread: {one}", dask.each / one.each, at_most=most),
        Row("two Dask workers, by the clock", str(dask), f"two threads: {two}", two.wall / dask.wall),
    ], [opening, starting]


def million(*, quick: bool) -> Section:
    """Run a million members, each for one simulated minute."""
    if quick:
        return [], ["skipped: a million members, which --quick leaves out"]
    cost, limit = in_threads(prepared(MILLION, HORIZON), None), 60 * MINUTES
    what = f"{MILLION:,} members of {HORIZON:g} s"
    return [Row(what, f"{cost.wall:.0f} s, {cost}", f"{limit:g} s", limit / cost.wall, at_least=1.0)], []


def _stored(given: Study) -> tuple[float, str]:
    """Processor time for writing whole chunks, in ns for a step of a member, and the time in which a store opens."""
    chunks = list(chunks_of(len(given), CHUNK))
    columns = given.run(*chunks[0])
    with tempfile.TemporaryDirectory() as folder:
        begun = time.process_time()
        with opened(Path(folder) / "store", given.identity(), len(given), CHUNK) as store:
            store.add(chunks[0], columns)
            opening, begun = time.process_time() - begun, time.process_time()
            for chunk in chunks[1:]:
                store.add(chunk, columns)
            busy = time.process_time() - begun
    member_steps = CHUNK * (len(chunks) - 1) * given.steps
    return busy / member_steps * 1e9, f"beside that, once: {opening:.2f} s to open a store and write its first chunk"


def _on_workers(given: Study, repeats: int) -> tuple[Cost, str]:
    """The cost of chunks on a cluster whose workers have each run one chunk before, and the time of these first chunks."""
    chunks, begun = list(chunks_of(len(given), CHUNK)), time.perf_counter()
    settling = Settling(given)

    def work(chunk: Chunk) -> Work:
        return settling.work(np.arange(chunk.first, chunk.first + chunk.size))

    with connected(Scheduler(workers=2)) as client:

        def elsewhere() -> float:
            return sum(client.run(time.process_time).values())

        started, begun = time.perf_counter() - begun, time.perf_counter()
        all(Workers(work, client).run(chunks[:2]))
        first, costs = time.perf_counter() - begun, []
        for _ in range(repeats):
            before = elsewhere()
            cost = measured(given, lambda: all(Workers(work, client).run(chunks)), 1)
            costs.append(replace(cost, busy=cost.busy + elsewhere() - before))
    once = (
        f"beside that, once: {started:.1f} s until two processes are there, {first:.1f} s until each has compiled and run a chunk"
    )
    return min(costs, key=lambda cost: cost.busy), once


def sections(*, quick: bool) -> Iterator[tuple[str, Section]]:
    yield "Sweeps: the cost of a member's step", scaling(quick=quick)
    yield "Sweeps: threads, a store, Dask", spread(quick=quick)
    yield "Sweeps: a million members", million(quick=quick)
