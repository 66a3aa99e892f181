"""Campaigns of flights: every controller flies through every failure on randomly drawn vehicles.

A vehicle's ``Drawing`` defines what is drawn. Results are kept in a store like that of a sweep, in Parquet with a row for each
draw. The same call resumes a campaign, however the last one ended.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib import metadata
from itertools import combinations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, Progress
from barbalat.sweeps.chunks import Chunk, Columns, Rows, UnstoredChunks, chunks_of, in_order
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.statistics import Median, Share, beyond_chance
from barbalat.sweeps.store import Store, opened, require_place
from barbalat.validate import Array, counted
from barbalat.vehicles.flight import Failing
from barbalat.vehicles.flying import AnyVehicle, aboard, chosen_failures, chosen_schemes
from barbalat.vehicles.isolated import SECONDS_PER_FLIGHT, STARTING_SECONDS, isolated
from barbalat.vehicles.vehicle import SEED, Aboard, Draw, draws_of, vehicle_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

KEPT = ("lost_at", "rms_e", "max_abs_e", "travel")
"""The metrics that are kept of each flight."""
MEMBERS, PROCESSES = 200, 2
"""Default numbers of draws and of processes."""
MOST_DRAWS = 25
"""Largest fraction of the draws that one process takes, so that all processes have work."""
CHUNK_SECONDS, FLIGHT_BYTES = 30.0, 1000.0
"""Duration of the flights of a drawing's ``chunk`` in seconds, and size of the metrics of one flight in bytes."""
DIFFERENCES = {
    "case": "a different flight, or different --schemes or --failures",
    "plan": "more --dispersions, or a different --seed",
    "equations": "different equations",
}
"""Words for the differences from another store, by the keys of ``Campaign.identity``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """A campaign of schemes through failures, on the draws of a plan. It is pickled into the processes that fly.

    models  the vehicle at each of its conditions
    aboard  the controllers at each condition
    """

    vehicle: AnyVehicle
    failures: tuple[Failing, ...]
    models: tuple[Any, ...]
    aboard: tuple[tuple[Aboard, ...], ...]
    plan: Plan

    @property
    def name(self) -> str:
        return self.vehicle.name

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.aboard[0])

    @property
    def conditions(self) -> tuple[str, ...]:
        """The flight conditions, which the draws use in turn."""
        return tuple(self.vehicle.drawing.conditions)

    @property
    def chunk(self) -> int:
        """The number of draws that a process flies."""
        return min(max(self.vehicle.drawing.chunk // (len(self.controllers) * len(self.failures)), 1), MOST_DRAWS)

    def cost(self, members: float, processes: int) -> Estimate:
        """Return the cost of flying this number of draws in parallel processes."""
        flights = members * len(self.controllers) * len(self.failures)
        return Estimate(memory=FLIGHT_BYTES * flights, seconds=CHUNK_SECONDS / self.vehicle.drawing.chunk * flights / processes)

    def require(self, members: int, processes: int) -> None:
        """Raise InputError if this number of draws exceeds the budget."""
        drawn = counted(members, "draw")
        budget.require(
            "the campaign", members, lambda count: self.cost(count, processes), given=f"of {drawn}",
            fits=lambda most: f"at most {counted(most, 'draw')}", what=f"the flights of {drawn}",
        )  # fmt: skip

    def identity(self) -> dict[str, object]:
        """Return the data with which a store must agree in order to be continued."""
        case = {
            "flight": self.name,
            "conditions": list(self.conditions),
            "controllers": list(self.controllers),
            "failures": [asdict(cast("DataclassInstance", one)) for one in self.failures],
            "timing": asdict(self.vehicle.drawing.timing),
        }
        return {"case": json.dumps(case), "plan": self.plan.as_json(), "equations": self._equations()}

    def _equations(self) -> str:
        """Return the SHA-256 of the controllers' operations, the linear models and the simulator's version."""
        digest = hashlib.sha256(metadata.version(self.vehicle.simulator).encode())
        for model, several in zip(self.models, self.aboard, strict=True):
            for part in self.vehicle.contents(model, several):
                digest.update(part)
        return digest.hexdigest()


@dataclass(frozen=True, eq=False, kw_only=True)
class DispersedComparison:
    """The results of a campaign.

    rows     a row for each draw, with the drawn numbers, and the metrics ``KEPT`` for each controller and failure
    resumed  number of draws that were already stored
    """

    campaign: Campaign
    rows: Rows
    resumed: int

    @property
    def members(self) -> int:
        return len(self.campaign.plan)

    def column(self, controller: str, failure: str, figure: str) -> Array:
        """Return a metric of a controller's flights through a failure, for each draw (members,). Raises KeyError if there is
        none."""
        name = column_name(controller, failure, figure)
        if name not in self.rows.names:
            raise validate.unknown_name("column", name, self.rows.names)
        return self.rows.column(name)

    @cached_property
    def evidence(self) -> Evidence:
        """The losses, errors and comparisons of controllers, with intervals."""
        failures = tuple(one.name for one in self.campaign.failures)
        return evidence_of(self.column, self.campaign.controllers, failures)


def column_name(controller: str, failure: str, figure: str) -> str:
    """Return the store's column name for a controller, a failure and a metric."""
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
    """Fly schemes through failures on randomly drawn vehicles. This requires ``barbalat[flight]`` and, for a store,
    ``barbalat[study]``.

    name, schemes, failures  as in ``fly``
    members    number of draws; every scheme flies each of them through every failure, and several conditions alternate
    seed       seed of the draws and of their gusts
    store      a folder that keeps every row; the same call, or one for more draws, continues from it
    processes  number of processes that fly in parallel

    Raises InputError for anything that cannot be flown, and SimulatorFailed if the simulator fails. Stored rows remain.
    """
    validate.whole("processes", processes, least=1)
    vehicle = vehicle_of(name)
    plan = vehicle.drawing.plan(members, seed)
    folder = None if store is None else validate.local_path("store", store)
    if folder is not None:
        require_place(folder)
    wanted, chosen = chosen_schemes(vehicle, schemes), chosen_failures(vehicle, failures)
    models = tuple(vehicle.nominal(condition) for condition in vehicle.drawing.conditions.values())
    flying = tuple(tuple(aboard(vehicle, model, wanted)) for model in models)
    campaign = Campaign(vehicle=vehicle, failures=chosen, models=models, aboard=flying, plan=plan)
    campaign.require(members, processes)
    with _sink(campaign, folder) as sink:
        resumed = done = sink.stored
        made = _made(campaign, sink.missing, processes)
        for chunk, columns in in_order(made) if sink.in_order else made:
            sink.add(chunk, columns)
            done += chunk.size
            if progress is not None:
                progress(done / members)
        return DispersedComparison(campaign=campaign, rows=sink.rows(), resumed=resumed)


@contextlib.contextmanager
def _sink(campaign: Campaign, store: Path | None) -> Iterator[Store | UnstoredChunks]:
    if store is None:
        yield UnstoredChunks(None, list(chunks_of(len(campaign.plan), campaign.chunk)))
        return
    plan = campaign.plan
    with opened(store, campaign.identity(), len(plan), campaign.chunk, DIFFERENCES, grows=plan.keeps_its_first) as found:
        yield found


def _made(campaign: Campaign, chunks: Sequence[Chunk], processes: int) -> Iterator[tuple[Chunk, Columns]]:
    """Yield each chunk when it is finished. Each chunk runs in its own process; ``processes`` of them run in parallel."""
    seconds = STARTING_SECONDS + campaign.chunk * SECONDS_PER_FLIGHT * len(campaign.failures) * len(campaign.controllers)
    pool = ThreadPoolExecutor(processes)
    try:
        flying = {pool.submit(isolated, seconds, flown_members, campaign, chunk): chunk for chunk in chunks}
        for future in as_completed(flying):
            yield flying[future], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _flying(campaign: Campaign) -> Callable[[Draw, int], Iterator[tuple[str, str, Mapping[str, float | None]]]]:
    """Return the function that flies a numbered draw with every controller through every failure.

    The function is made once in a process. It yields controller, failure and at least the metrics ``KEPT`` of each flight.
    """
    vehicle = campaign.vehicle
    pilots = [
        [vehicle.pilot(model, one) for one in several] for model, several in zip(campaign.models, campaign.aboard, strict=True)
    ]
    travel, _ = vehicle.drawing.travel

    def fly(draw: Draw, number: int) -> Iterator[tuple[str, str, Mapping[str, float | None]]]:
        dispersion, which = vehicle.dispersion(**draw, number=number), number % len(campaign.models)
        for pilot in pilots[which]:
            for flight in vehicle.fly(campaign.models[which], pilot, campaign.failures, dispersion, vehicle.drawing.timing):
                figures = flight.figures
                yield flight.controller, flight.failure.name, figures | {"travel": figures[travel]}

    return fly


def flown_members(campaign: Campaign, chunk: Chunk) -> Columns:
    """Fly these draws in this process and return all their columns."""
    fly, turns = _flying(campaign), len(campaign.models)
    found: Columns = {"member": np.arange(chunk.first, chunk.first + chunk.size)}
    values = campaign.plan.values(*chunk)
    found |= {str(path): values[:, i] for i, path in enumerate(campaign.plan.paths)}
    found["condition"] = found["member"] % turns
    pairs = product(campaign.controllers, campaign.failures)
    names = [column_name(one, failure.name, figure) for one, failure in pairs for figure in KEPT]
    found |= {name: np.full(chunk.size, np.nan) for name in names}
    for number, draw in draws_of(campaign.plan, *chunk):
        for controller, failure, figures in fly(draw, number):
            for figure in KEPT:
                value = figures[figure]
                found[column_name(controller, failure, figure)][number - chunk.first] = np.nan if value is None else value
    return found


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """The comparison of two controllers through the same failure on the same draws.

    A lost flight is worse than any other, and draws on which both are lost are not counted.

    better   fraction of draws on which the controller has the smaller error, among those on which the two differ; None without
             such draws
    spared   fraction of draws on which only the other was lost, among those on which one of them was lost; None without such
             draws
    follows  1 if its error is significantly smaller, -1 if it is significantly larger, otherwise 0, at a joint level over all
             comparisons
    keeps    the same for its losses, with 1 if there are fewer
    """

    other: str
    better: Share | None
    spared: Share | None
    follows: int
    keeps: int


@dataclass(frozen=True, kw_only=True)
class Flown:
    """The results of one controller with one failure on all draws."""

    controller: str
    lost: Share
    error: Median
    travel: Median
    pairings: tuple[Pairing, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """The evaluation of the flights for each failure, with the controllers ordered by losses and then by error, and for all
    failures together.

    lost         number of lost flights of each controller, the fewest first; these numbers have no interval, because flights on
                 the same draw are not independent
    comparisons  number of comparisons of two controllers through one failure, by error or by losses, that at least one draw
                 decides; they share one confidence level
    """

    by_failure: dict[str, tuple[Flown, ...]]
    lost: dict[str, tuple[int, int]]
    comparisons: int


ERROR, LOSS = "error", "loss"


def evidence_of(column: Callable[[str, str, str], Array], controllers: Sequence[str], failures: Sequence[str]) -> Evidence:
    """Evaluate the flights from ``column(controller, failure, figure)``."""
    errors = {(failure, one): column(one, failure, "rms_e") for failure in failures for one in controllers}
    gone = {(failure, one): int(np.isfinite(column(one, failure, "lost_at")).sum()) for failure, one in errors}
    shares = {
        (failure, *pair, by): share
        for failure in failures
        for pair in combinations(controllers, 2)
        for by, share in _shares(*(errors[failure, one] for one in pair)).items()
        if share is not None
    }
    signs = beyond_chance(shares)
    signs |= {(failure, other, one, by): -sign for (failure, one, other, by), sign in signs.items()}

    def paired(failure: str, one: str, other: str) -> Pairing:
        found = _shares(errors[failure, one], errors[failure, other])
        follows, keeps = (signs.get((failure, one, other, by), 0) for by in (ERROR, LOSS))
        return Pairing(other=other, better=found[ERROR], spared=found[LOSS], follows=follows, keeps=keeps)

    members = len(next(iter(errors.values())))
    by_failure = {}
    for failure in failures:
        found = [
            Flown(
                controller=one,
                lost=Share(count=gone[failure, one], judged=members),
                error=Median.of(errors[failure, one]),
                travel=Median.of(column(one, failure, "travel")),
                pairings=tuple(paired(failure, one, other) for other in controllers if other != one),
            )
            for one in controllers
        ]
        by_failure[failure] = tuple(sorted(found, key=lambda flown: (flown.lost.count, flown.error.value)))
    lost = {one: sum(gone[failure, one] for failure in failures) for one in controllers}
    ranked = sorted(lost.items(), key=lambda item: item[1])
    flights = members * len(failures)
    counted = {name: (count, flights) for name, count in ranked}
    return Evidence(by_failure=by_failure, lost=counted, comparisons=len(shares))


def _shares(own: Array, errors: Array) -> dict[str, Share | None]:
    own, errors = (np.where(np.isnan(one), np.inf, one) for one in (own, errors))
    lost, gone = np.isinf(own), np.isinf(errors)
    return {ERROR: _share(own < errors, own != errors), LOSS: _share(gone & ~lost, gone != lost)}


def _share(counted: Array, judged: Array) -> Share | None:
    return Share.of(counted, judged) if judged.any() else None
