"""Chunks on Dask's workers, on this machine or on others: workers may join and die, and lost work is repeated.

The workers' results do not depend on the processor or its C library. Numbers that LAPACK or the C library computes (P, inverses,
matrix exponentials, a delay's weights, samples of a sine) are computed once, on the computer that started the sweep, and sent
with the operation lists. A worker translates the lists and runs them.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import multiprocessing
import re
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata, resources
from importlib.resources.abc import Traversable
from threading import Event, Thread
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np

import barbalat
from barbalat import validate
from barbalat.open_numbers.members import Setting
from barbalat.run.engine.engine import Batch, advance
from barbalat.run.engine.judging import Terms
from barbalat.run.kernel.grid import final_row, segments_of, signal_table
from barbalat.run.kernel.members import Members
from barbalat.solvers.simulation import Simulation
from barbalat.sweeps.chunks import Chunk, Columns
from barbalat.sweeps.settling import Work
from barbalat.sweeps.study import Figured, StudyPart, figured
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster, as_completed

COMPARED_PACKAGES = ("numpy", "scipy", "casadi", "llvmlite")
"""Packages on which a worker's bits may depend, in addition to Barbalat's version and the minor version of Python."""
SOURCES = "barbalat's sources"
"""The name of the digest of this package's sources: two states of the sources may have the same version number."""


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Signals given by their samples."""

    samples: dict[int, Array]
    final: Array

    @classmethod
    def of(cls, part: StudyPart) -> Tabulated:
        simulation = part.setting.simulation
        (in_pieces,) = {one.program.shape.in_pieces for one in part.members}
        signals, found = part.setting.signals, {}
        for one in segments_of(simulation, recorded=False):
            found[one.start] = signal_table(signals, simulation, one.start, one.steps, in_pieces=in_pieces)
        return cls(found, final_row(signals, simulation, in_pieces=in_pieces))


@dataclass(frozen=True, eq=False)
class WorkerTask:
    """A part of a chunk, without its signals; ``made_by`` contains the ``versions`` of the client."""

    members: tuple[Members, ...]
    simulation: Simulation
    terms: Terms
    made_by: dict[str, str]

    @classmethod
    def of(cls, part: StudyPart) -> WorkerTask:
        plain = tuple(replace(one, signals=(), problem=None) for one in part.members)
        return cls(plain, part.setting.simulation, part.setting.terms, versions())


@cache
def versions() -> dict[str, str]:
    """The versions in this process; they are read from files, which takes as long as simulating hundreds of members."""
    found = {"barbalat": barbalat.__version__, "python": ".".join(map(str, sys.version_info[:2]))}
    found |= {name: metadata.version(name) for name in COMPARED_PACKAGES}
    return found | {SOURCES: digest_of(resources.files(barbalat))}


def digest_of(package: Traversable) -> str:
    """The first digits of the SHA-256 of all Python files of a package, independent of line endings."""
    found = hashlib.sha256()
    for name, file in sorted(_sources(package, "")):
        found.update(f"{name}\n".encode() + file.read_bytes().replace(b"\r\n", b"\n") + b"\0")
    return found.hexdigest()[:16]


def _sources(folder: Traversable, place: str) -> Iterator[tuple[str, Traversable]]:
    """Python files by their paths in the package."""
    for one in folder.iterdir():
        name = f"{place}/{one.name}"
        if one.is_dir():
            yield from _sources(one, name)
        elif one.name.endswith(".py"):
            yield name, one


@dataclass(frozen=True, eq=False)
class Canary:
    """A few members of the study that every worker's process runs first. The results must equal the client's bit for bit. Hashes
    of the sources do not reveal a patched package, the library of a different compiler or a defective processor."""

    task: WorkerTask
    tables: Tabulated
    name: str

    @classmethod
    def of(cls, part: StudyPart) -> Canary:
        task = WorkerTask.of(part)
        few = tuple(one.some(slice(0, CANARY_MEMBERS)) for one in task.members)
        return cls(replace(task, members=few), Tabulated.of(part), uuid4().hex)

    def digest(self) -> str:
        """The SHA-256 of all metrics of these members, computed in this process once."""
        if self.name not in _DIGESTS:
            found = hashlib.sha256()
            for one in figures(self.task, self.tables):
                named = [*vars(one.metrics).items(), ("kinds", one.kinds), ("finer_by", one.finer_by)]
                for name, values in named:
                    found.update(name.encode() + (b"" if values is None else np.ascontiguousarray(values).tobytes()))
            _DIGESTS[self.name] = found.hexdigest()
        return _DIGESTS[self.name]


CANARY_MEMBERS = 4
_DIGESTS: dict[str, str] = {}
"""The digests of the canaries that ran in this process, keyed by name."""


def kept(tables: Tabulated) -> Tabulated:
    """Data that a cluster keeps for many chunks; the scheduler recreates them if a worker is lost."""
    return tables


def checked_figures(sent: WorkerTask, tables: Tabulated, canary: Canary) -> tuple[str, str, list[Figured]]:
    """The worker's address, the digest of the canary on that worker, and ``figures``."""
    from distributed import get_worker

    return get_worker().address, canary.digest(), figures(sent, tables)


def figures(sent: WorkerTask, tables: Tabulated) -> list[Figured]:
    """The metrics of each controller, computed by one thread; raises InputError on a worker whose bits would differ."""
    own = versions()
    clients = sent.made_by
    names = [*clients, *(own.keys() - clients.keys())]
    if different := [f"{n} {own.get(n)}, not {clients.get(n)}" for n in names if own.get(n) != clients.get(n)]:
        raise InputError(
            f"a worker's versions differ from the client's: {', '.join(different)}; install the client's versions there"
        )
    batches = [Batch.part(one, slice(0, len(one))) for one in sent.members]
    advance(batches, lambda segment: tables.samples[segment.start], lambda: tables.final, sent.simulation, threads=1)
    return [figured(batch, sent.simulation, sent.terms, 1) for batch in batches]


ANSWER_SECONDS = 10.0
"""Seconds after which the client gives up on a scheduler that does not answer."""
CLOSING_SECONDS = 0.5
"""Seconds for the final messages to a cluster: Ctrl-C must finish within two."""
CHUNKS_AHEAD = 2
"""Chunks per thread of the workers that run or wait there, so that no thread is idle while its next chunk is sent."""
MOST_TABLES = 8
"""Number of signal tables that a cluster holds for later chunks: some 10 MB each."""
MOST_DEATHS = 5
"""Number of times that a chunk is sent again after the scheduler has given it up, which happens after three workers died while
running it."""


class SchedulerLostError(Exception):
    """The scheduler no longer answers; stored rows are kept."""


@dataclass(frozen=True)
class Scheduler:
    """Where a cluster is: the ``address`` of a running scheduler, or a number of ``workers`` started on this machine."""

    address: str | None = None
    workers: int | None = None

    @classmethod
    def parse(cls, text: str) -> Scheduler:
        """tcp://HOST:PORT, tls://HOST:PORT or local:N."""
        if local := re.fullmatch(r"local:(\d+)", text):
            return cls(workers=validate.whole("--scheduler local:N", int(local[1]), least=1, most=1024))
        if not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", text):
            raise InputError(f"--scheduler must be tcp://HOST:PORT of a Dask scheduler or local:N, got {validate.show(text)}")
        return cls(address=text)


@contextlib.contextmanager
def connected(scheduler: Scheduler) -> Iterator[Client]:
    """A client; raises InputError if no scheduler answers."""
    validate.require_extra("distributed", "study", "--scheduler")
    import logging

    from distributed import Client

    for name in ("distributed", "distributed.client"):  # lost workers are reported by the state of their chunks
        logging.getLogger(name).setLevel(logging.CRITICAL)
    cluster = None
    if scheduler.address is not None:
        _require_answer(scheduler.address)
    else:
        cluster = _local(scheduler.workers)
    client = Client(scheduler.address or cluster, timeout=ANSWER_SECONDS, set_as_default=False)
    try:
        yield client
    finally:
        with contextlib.suppress(TimeoutError, OSError):
            client.close(timeout=CLOSING_SECONDS)
        if cluster is not None:
            _close(cluster)


def _local(workers: int | None) -> LocalCluster:
    """Switches off Dask's profiler, which samples every thread a hundred times a second."""
    import logging

    import dask.config
    from distributed import LocalCluster

    with dask.config.set({"distributed.worker.profile.enabled": False}):
        return LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
        )


def _close(cluster: LocalCluster) -> None:
    """Kills workers that are in the middle of a chunk, because Dask would wait for them for ten more seconds at the end of this
    process."""
    workers = [nanny.pid for nanny in cluster.workers.values()]
    with contextlib.suppress(TimeoutError, OSError):
        cluster.close(timeout=CLOSING_SECONDS)
        return
    cluster.shutdown_on_close = False  # prevents a second close at the end of this process, which would fail
    for process in multiprocessing.active_children():
        if process.pid in workers:
            process.kill()


def _require_answer(address: str) -> None:
    """Raise InputError if no scheduler identifies itself. A client would wait forever for a port that is open but does not
    answer."""
    from distributed.core import connect
    from distributed.security import Security

    known = Security().get_connection_args("client")
    if address.startswith("tls:") and known.get("ssl_context") is None:
        raise InputError(f"the scheduler {address!r} needs certificates: name them in Dask's configuration, distributed.comm.tls")

    async def ask() -> None:
        comm = await connect(address, timeout=ANSWER_SECONDS, **known)
        try:
            await comm.write({"op": "identity", "reply": True})
            await comm.read()
        finally:
            comm.abort()

    async def within() -> None:
        await asyncio.wait_for(ask(), ANSWER_SECONDS)

    answered = Event()

    def wait() -> None:
        with contextlib.suppress(
            Exception
        ):  # another kind of server may answer anything: the text of a web server would be read as a request for 3 EB of memory
            asyncio.run(within())
            answered.set()

    asking = Thread(target=wait, daemon=True)  # the thread of a notebook already has a running loop
    asking.start()
    asking.join()  # Ctrl-C ends this without waiting
    if not answered.is_set():
        raise InputError(
            f"the scheduler {address!r} does not answer within {ANSWER_SECONDS:g} s: start a scheduler there with 'dask "
            f"scheduler', "
            "or omit --scheduler"
        )


@dataclass(eq=False)
class _Given:
    """A chunk in progress: its work, the requested parts, and the metrics of the parts that have run."""

    chunk: Chunk
    work: Work
    parts: list[StudyPart] = field(default_factory=list)
    found: dict[int, list[Figured]] = field(default_factory=dict)
    deaths: int = 0

    def further(self) -> Columns | None:
        """Pass the metrics to the work that waits for them. Return the columns when the work is finished, None if it requests
        more."""
        figures = [self.found[i] for i in range(len(self.parts))]
        try:
            self.parts, self.found = (self.work.send(figures) if figures else next(self.work)), {}
        except StopIteration as done:
            columns: Columns = done.value
            return columns
        return None


@dataclass(eq=False)
class Workers:
    """The work of a study's chunks on a cluster."""

    work: Callable[[Chunk], Work]
    client: Client
    tables: dict[int, tuple[Setting, Future]] = field(default_factory=dict)
    under_way: dict[Future, tuple[_Given, int, str | None]] = field(default_factory=dict)
    canary: tuple[str, Future] | None = None

    def run(self, chunks: Iterable[Chunk]) -> Iterator[tuple[Chunk, Columns]]:
        """Yield each chunk with its columns when complete, in any order. Raises SchedulerLostError."""
        from distributed import as_completed

        waiting, done = iter(chunks), as_completed(loop=self.client.loop)
        self._give_more(waiting, done)
        for future in done:
            given, place, _ = self.under_way.pop(future)
            result = self._result(future, given)
            if result is None:
                self._give(given, place, done)
                continue
            given.found[place] = result
            if len(given.found) == len(given.parts) and (columns := self._further(given, done)) is not None:
                yield given.chunk, columns
            self._give_more(waiting, done)

    def _give_more(self, waiting: Iterator[Chunk], done: as_completed) -> None:
        """Start work until every thread is busy and more is waiting."""
        room = CHUNKS_AHEAD * max(sum(self._threads().values()), 1)
        while len(self.under_way) < room:
            chunk = next(waiting, None)
            if chunk is None:
                return
            self._further(_Given(chunk, self.work(chunk)), done)

    def _further(self, given: _Given, done: as_completed) -> Columns | None:
        """Submit what the work of a chunk requests; return its columns when it is finished."""
        columns = given.further()
        if columns is None:
            for place in range(len(given.parts)):
                self._give(given, place, done)
        return columns

    def _give(self, given: _Given, place: int, done: as_completed) -> None:
        part, worker = given.parts[place], self._least_busy()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # the tables of signals, sent once for all chunks
            future = self.client.submit(
                checked_figures,
                WorkerTask.of(part),
                self._table(part),
                self._canary_there(part),
                pure=False,
                workers=worker,
                allow_other_workers=worker is not None,
            )
        self.under_way[future] = given, place, worker
        done.add(future)

    def _table(self, part: StudyPart) -> Future:
        key = id(part.setting)
        if key not in self.tables:
            if len(self.tables) >= MOST_TABLES:
                del self.tables[next(iter(self.tables))]
            self.tables[key] = part.setting, self.client.submit(kept, Tabulated.of(part), pure=False)
        return self.tables[key][1]

    def _canary_there(self, part: StudyPart) -> Future:
        """The canary on the cluster, made from the first part that is given."""
        if self.canary is None:
            canary = Canary.of(part)
            there = self.client.submit(Canary, canary.task, self._table(part), canary.name, pure=False)
            self.canary = canary.digest(), there
        return self.canary[1]

    def _least_busy(self) -> str | None:
        """The least busy worker, to be used if it is alive. Dask prefers a worker that already has the signals."""
        busy = Counter(worker for _, _, worker in self.under_way.values())
        return min(threads := self._threads(), key=lambda one: busy[one] / threads[one], default=None)

    def _threads(self) -> dict[str, int]:
        """The number of threads of each worker, by address."""
        try:
            return dict(self.client.nthreads())
        except (OSError, TimeoutError) as error:
            raise SchedulerLostError from error

    def _result(self, future: Future, given: _Given) -> list[Figured] | None:
        """A part's metrics; None if its workers died. Raises InputError for a worker whose results are not bit-identical to those
        of this computer."""
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            worker, digest, found = future.result()
        except KilledWorker as error:
            given.deaths += 1
            if given.deaths > MOST_DEATHS:
                first, size = given.chunk
                raise InputError(
                    f"members {first} to {first + size - 1} ended every worker that ran them, most recently "
                    f"{error.last_worker}; perhaps the workers ran out of memory"
                ) from None
            return None
        except CancelledError as error:
            raise SchedulerLostError from error
        except (ImportError, AttributeError) as error:
            raise InputError(f"a worker lacks the client's version of barbalat: {error}; install it there") from None
        assert self.canary is not None
        if digest != self.canary[0]:
            raise InputError(
                f"the worker {worker} does not reproduce this computer's results bit for bit for the same {CANARY_MEMBERS} "
                f"members, although its versions and sources are the same. None of its results is kept: stop it, then repeat "
                f"the command"
            )
        figures: list[Figured] = found
        return figures
