"""What is sent to workers on any machine, and what they do with it: nothing there depends on the processor or its C library.

Numbers that LAPACK or the C library makes (P, inverses, matrix exponentials, a delay's weights, a sine's samples) are made once,
where the sweep was started, and sent with the operation lists. A worker translates the lists and runs them.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata, resources
from importlib.resources.abc import Traversable

import barbalat
from barbalat.run.engine.engine import Batch, Evaluated, advance
from barbalat.run.kernel.grid import Segment, segments_of
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.sweeps.study import StudyPart
from barbalat.validate import Array, InputError

COMPARED_PACKAGES = ("numpy", "scipy", "casadi", "llvmlite")
"""Packages on which a worker's bits may depend, beside Python's minor version and Barbalat's own."""
SOURCES = "barbalat's sources"
"""What the digest of this package's own sources is called: two states of it may have one version number."""


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Signals by their samples."""

    samples: dict[int, Array]
    final: Array

    @classmethod
    def of(cls, part: StudyPart) -> Tabulated:
        simulation = part.setting.simulation
        (in_pieces,) = {one.program.shape.in_pieces for one in part.members}
        made = Evaluated(part.setting.signals, simulation, in_pieces)
        return cls({one.start: made.rows(one) for one in segments_of(simulation, recorded=False)}, made.last())

    def rows(self, segment: Segment) -> Array:
        return self.samples[segment.start]

    def last(self) -> Array:
        return self.final


@dataclass(frozen=True, eq=False)
class WorkerTask:
    """One part of a chunk, without its signals; ``made_by`` are the ``versions`` of the client."""

    members: tuple[Members, ...]
    simulation: Simulation
    made_by: dict[str, str]

    @classmethod
    def of(cls, part: StudyPart) -> WorkerTask:
        plain = tuple(replace(one, signals=()) for one in part.members)
        return cls(plain, part.setting.simulation, versions())


@cache
def versions() -> dict[str, str]:
    """Of this process; they are read from files, which takes as long as simulating hundreds of members."""
    found = {"barbalat": barbalat.__version__, "python": ".".join(map(str, sys.version_info[:2]))}
    found |= {name: metadata.version(name) for name in COMPARED_PACKAGES}
    return found | {SOURCES: digest_of(resources.files(barbalat))}


def digest_of(package: Traversable) -> str:
    """The first digits of the SHA-256 of all Python files of a package, whatever the ends of their lines are."""
    found = hashlib.sha256()
    for name, file in sorted(_sources(package, "")):
        found.update(f"{name}\n".encode() + file.read_bytes().replace(b"\r\n", b"\n") + b"\0")
    return found.hexdigest()[:16]


def _sources(folder: Traversable, place: str) -> Iterator[tuple[str, Traversable]]:
    """Python files by their places in the package."""
    for one in folder.iterdir():
        name = f"{place}/{one.name}"
        if one.is_dir():
            yield from _sources(one, name)
        elif one.name.endswith(".py"):
            yield name, one


def kept(tables: Tabulated) -> Tabulated:
    """What a cluster holds for many chunks; made again from what its scheduler knows where a worker that held it is gone."""
    return tables


def figures(sent: WorkerTask, tables: Tabulated) -> list[Metrics]:
    """Of each controller, by one thread; InputError on a worker that would make other bits."""
    own = versions()
    clients = sent.made_by
    names = [*clients, *(own.keys() - clients.keys())]
    if different := [f"{n} {own.get(n)}, not {clients.get(n)}" for n in names if own.get(n) != clients.get(n)]:
        raise InputError(f"a worker has other versions than the client: {', '.join(different)}; install the client's there")
    batches = [Batch.part(one, slice(0, len(one))) for one in sent.members]
    advance(batches, tables, sent.simulation, threads=1)
    return [batch.metrics(sent.simulation) for batch in batches]
