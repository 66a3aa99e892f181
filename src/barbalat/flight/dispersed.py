"""Many flights: every controller through every failure on aircraft that are drawn, at three conditions, kept in a store.

A store is that of a sweep: Parquet, a row for each draw, resumed by the same call after whatever ended the last one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib import metadata
from itertools import product
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.flight.airframe import CONDITIONS
from barbalat.flight.axis import Axis
from barbalat.flight.comparison import SECONDS_PER_FLIGHT, STARTING_SECONDS, axis_of, chosen_failures, lists_of
from barbalat.flight.dispersions import SEED, condition_of, drawn, plan_of
from barbalat.flight.evidence import Evidence, evidence_of
from barbalat.flight.failures import Failure
from barbalat.flight.flight import Timing
from barbalat.flight.flying import fly_once
from barbalat.flight.isolated import isolated
from barbalat.flight.schemes import available, require_known
from barbalat.run.progress import Progress
from barbalat.run.sampled_step import SampledList, SampledStep
from barbalat.sweeps.chunks import Chunk, chunks_of
from barbalat.sweeps.kept import Kept, in_order
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.rows import Rows
from barbalat.sweeps.store import Store, opened
from barbalat.sweeps.stored import require_parquet
from barbalat.sweeps.study import Columns
from barbalat.validate import Array

TIMING = Timing(duration=15.0, fails_at=5.0)
"""Of such a flight [s]: what fails does so as the first command is reversed; another command follows."""
MEMBERS, PROCESSES = 200, 2
"""Draws by default, and processes."""
CHUNK_FLIGHTS, MOST_DRAWS = 256, 25
"""Flights that a process flies before their rows are kept, half a minute's; and draws at most, so that all have some."""
KEPT = ("lost_at", "rms_e", "max_abs_e", "travel")
"""Figures of each flight."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """What is flown: axes and the controllers' operations at each of ``CONDITIONS``, through failures."""

    name: str
    axes: tuple[Axis, ...]
    lists: tuple[tuple[SampledList, ...], ...]
    failures: tuple[Failure, ...]
    plan: Plan

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.lists[0])

    @property
    def chunk(self) -> int:
        """Draws that one process flies."""
        return min(max(CHUNK_FLIGHTS // (len(self.controllers) * len(self.failures)), 1), MOST_DRAWS)

    def identity(self) -> dict[str, object]:
        """What a store must have been made with to be gone on with."""
        case = {
            "flight": self.name,
            "conditions": [str(axis.trim.condition) for axis in self.axes],
            "controllers": list(self.controllers),
            "failures": [asdict(failure) for failure in self.failures],
            "timing": asdict(TIMING),
        }
        return {"case": json.dumps(case), "plan": self.plan.as_json(), "equations": self._equations()}

    def _equations(self) -> str:
        """SHA-256 of the controllers' operations, the linear models, and the simulator's version."""
        digest = hashlib.sha256(metadata.version("jsbsim").encode())
        for axis, lists in zip(self.axes, self.lists, strict=True):
            digest.update(repr([(one.name, one.program, one.initial.tolist()) for one in lists]).encode())
            digest.update(axis.trim.A.tobytes() + axis.trim.B.tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False, kw_only=True)
class DispersedComparison:
    """What all of them came to.

    rows     a row for each draw: what was drawn, and ``KEPT`` for each controller and failure
    resumed  draws that the store held already
    """

    campaign: Campaign
    rows: Rows
    resumed: int

    @property
    def members(self) -> int:
        return len(self.campaign.plan)

    def column(self, controller: str, failure: str, figure: str) -> Array:
        """(members,)."""
        return self.rows.column(column_name(controller, failure, figure))

    @cached_property
    def evidence(self) -> Evidence:
        """Losses, errors and who is better than whom, with intervals."""
        failures = tuple(one.name for one in self.campaign.failures)
        return evidence_of(self.column, self.campaign.controllers, failures)


def column_name(controller: str, failure: str, figure: str) -> str:
    """In a store."""
    return f"{controller}, {failure}/{figure}"


def fly_dispersed(
    name: str = "f16-pitch",
    *,
    schemes: Sequence[str] | None = None,
    failures: Sequence[str] | None = None,
    members: int = MEMBERS,
    seed: int = SEED,
    store: str | Path | None = None,
    processes: int = PROCESSES,
    progress: Progress | None = None,
) -> DispersedComparison:
    """Fly schemes through failures on aircraft that are drawn; the extras ``flight`` and, for a store, ``study``.

    name, schemes, failures  as of ``fly``
    members    draws, each flown by every scheme through every failure; the three conditions take turns
    seed       of the draws, and each draw's number of its gusts
    store      a folder that keeps every row and from which the same call goes on
    processes  that fly side by side

    Raises InputError for what can't be flown, SimulatorFailed where the simulator breaks; what was stored before stays.
    """
    validate.whole("processes", processes, least=1)
    campaign = _campaign(name, schemes, failures, plan_of(members, seed), stored=store is not None)
    with _sink(campaign, store) as sink:
        resumed = done = sink.stored
        made = _made(campaign, sink.missing, processes)
        for chunk, columns in in_order(made) if sink.in_order else made:
            sink.add(chunk, columns)
            done += chunk.size
            if progress is not None:
                progress(done / members)
        return DispersedComparison(campaign=campaign, rows=sink.rows(), resumed=resumed)


def _campaign(name: str, schemes: Sequence[str] | None, failures: Sequence[str] | None, plan: Plan, *, stored: bool) -> Campaign:
    """What is asked for, trimmed and traced at each condition; what can't be flown or kept is refused before that."""
    wanted = available() if schemes is None else list(schemes)
    chosen = chosen_failures(name, failures)
    require_known(wanted)
    if stored:
        require_parquet()
    axes = tuple(axis_of(name, condition) for condition in CONDITIONS)
    lists = tuple(tuple(lists_of(axis, wanted)) for axis in axes)
    return Campaign(name=name, axes=axes, lists=lists, failures=chosen, plan=plan)


@contextlib.contextmanager
def _sink(campaign: Campaign, store: str | Path | None) -> Iterator[Store | Kept]:
    if store is None:
        yield Kept(None, list(chunks_of(len(campaign.plan), campaign.chunk)))
        return
    with opened(Path(store), campaign.identity(), len(campaign.plan), campaign.chunk) as found:
        yield found


def _made(campaign: Campaign, chunks: Sequence[Chunk], processes: int) -> Iterator[tuple[Chunk, Columns]]:
    """Each chunk in a process of its own, so many at a time, as they are done."""
    seconds = STARTING_SECONDS + campaign.chunk * SECONDS_PER_FLIGHT * len(campaign.failures) * len(campaign.controllers)
    pool = ThreadPoolExecutor(processes)
    try:
        flying = {pool.submit(isolated, seconds, flown_members, campaign, chunk): chunk for chunk in chunks}
        for future in as_completed(flying):
            yield flying[future], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def flown_members(campaign: Campaign, chunk: Chunk) -> Columns:
    """All columns of these draws, in this process."""
    steps = [[SampledStep(one) for one in lists] for lists in campaign.lists]
    found: Columns = {"member": np.arange(chunk.first, chunk.first + chunk.size)}
    values = campaign.plan.values(*chunk)
    found |= {str(path): values[:, i] for i, path in enumerate(campaign.plan.paths)}
    found["condition"] = found["member"] % len(CONDITIONS)
    pairs = product(campaign.controllers, campaign.failures)
    names = [column_name(one, failure.name, figure) for one, failure in pairs for figure in KEPT]
    found |= {name: np.full(chunk.size, np.nan) for name in names}
    for place, dispersion in enumerate(drawn(campaign.plan, *chunk)):
        which = CONDITIONS.index(condition_of(dispersion.number))
        axis = campaign.axes[which]
        for step in steps[which]:
            for failure in campaign.failures:
                flight = fly_once(axis, step, failure, dispersion, TIMING)
                figures = flight.figures | {"travel": flight.figures[f"{axis.followed.surface}_travel"]}
                for figure in KEPT:
                    value = figures[figure]
                    name = column_name(flight.controller, failure.name, figure)
                    found[name][place] = np.nan if value is None else value
    return found
