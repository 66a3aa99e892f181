"""Many runs at once: members that differ in any number of the plant, the settings or what follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import validate
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run import delay
from barbalat.run.batch import Batch
from barbalat.run.breaks import LostOrder, lost_order
from barbalat.run.engine import run
from barbalat.run.grid import CHUNK_STEPS
from barbalat.run.metrics import Metrics
from barbalat.run.progress import Progress
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class EnsembleResult:
    """Figures of M members, in the order given; ``varied`` counts the numbers in which they differ.

    quarters  (M, 4, n) the largest |e| in each quarter of the run, t_end left out, where they were asked for; NaN for a member
              that diverged
    lost      what jumps and corners inside of steps cost all members, as of a single run's ``Result``
    """

    simulation: Simulation
    metrics: Metrics
    varied: int
    quarters: Array | None = None
    lost: LostOrder | None = None

    def __repr__(self) -> str:
        diverged, M = int(np.isfinite(self.metrics.diverged_at).sum()), len(self)
        e = self.metrics.tail_max_abs_e
        worst = ", ".join(f"{value:.4g}" for value in np.nanmax(e, axis=0)) if diverged < M else "-"
        return f"<EnsembleResult: {M} members, {self.varied} numbers varied, {diverged} diverged; worst |e| in the tail {worst}>"

    def plot(self) -> Figure:
        """Which share of the members has at most an error, in all and in the tail, as a Matplotlib figure."""
        from barbalat.pictures.shares import Shares, draw

        found, M = self.metrics, len(self)
        panels = [
            Shares(title=title, axis=title, values={f"$e_{i + 1}$": np.abs(e[:, i]) for i in range(e.shape[1])})
            for title, e in (("largest |e|", found.max_abs_e), ("largest |e| in the tail", found.tail_max_abs_e))
        ]
        diverged = int(np.isfinite(found.diverged_at).sum())
        note = f"{M} runs" + (f"; {diverged} diverged and have no error, so that the share stays below 1" if diverged else "")
        return draw(panels, note, shown=True)

    def __len__(self) -> int:
        return len(self.metrics.diverged_at)


def simulate_ensemble(
    members: Sequence[tuple[TrackingProblem, Controller]],
    simulation: Simulation,
    *,
    numbers: Sequence[int] | Array | None = None,
    quarters: bool = False,
    threads: int | None = None,
    lanes: int | None = None,
    progress: Progress | None = None,
) -> EnsembleResult:
    """Run every (problem, controller) and return the figures over all steps; no trajectory is kept.

    All members have one structure (scheme, dimensions, projection or not, signals) and may differ in every number:
    theta, x0, gamma, kappa, the box, A_m and with it P, ... Numbers that are the same for all are compiled in.

    numbers         with the seed they fix each member's measurement noise; by default 0, 1, ... in the order given. Members
                    with one number and one seed have the same noise
    quarters        keep the largest |e| of each quarter of the run too; at least eight steps
    threads, lanes  only speed depends on them, not a single bit of the results
    """
    _require(members, simulation, quarters, lanes)
    streams = _numbers_of(members, numbers)
    signals = members[0][0].signals
    for i, (problem, _) in enumerate(members):
        if problem.signals != signals:
            raise InputError(f"all members must share their signals, but member {i + 1} has {validate.show(problem.signals)}")
    delay.require_memory([problem for problem, _ in members], simulation.dt)
    batch = Batch.of(members, simulation, numbers=streams, record=quarters, lanes=lanes)
    blocks = replace(simulation, record_points=_points(simulation)) if quarters else simulation
    run([batch], signals, blocks, threads=threads, progress=progress)
    return EnsembleResult(
        simulation=simulation,
        metrics=batch.metrics(simulation),
        varied=len(batch.parameters),
        quarters=_quarters(batch, blocks) if quarters else None,
        lost=lost_order(signals, simulation, delayed=batch.loop.delayed),
    )


def _numbers_of(members: Sequence[Any], numbers: Sequence[int] | Array | None) -> Array:
    """(M,) the members' numbers, checked."""
    if numbers is None:
        return np.arange(len(members))
    if len(numbers) != len(members):
        raise InputError(f"numbers must have {len(members)} entries, one for each member, got {len(numbers)}")
    return np.array([validate.whole("numbers", number, least=0) for number in numbers])


def _require(members: Sequence[Any], simulation: Simulation, quarters: bool, lanes: int | None) -> None:
    """InputError for what no ensemble can be made of."""
    if lanes is not None and (validate.whole("lanes", lanes, least=1) & (lanes - 1)):
        raise InputError(f"lanes must be a power of two, got {lanes}")
    if not isinstance(members, (list, tuple)):
        raise InputError(f"members must be a list of pairs (problem, controller), got {validate.show(members)}")
    if not members:
        raise InputError("an ensemble needs at least one member, got none")
    validate.instance("simulation", simulation, Simulation)
    if quarters and simulation.steps < 8:
        raise InputError(f"quarters need at least eight solver steps, got {simulation.steps}")
    for i, member in enumerate(members, start=1):
        if not (isinstance(member, tuple) and len(member) == 2 and isinstance(member[0], TrackingProblem)):
            raise InputError(f"member {i} must be a pair (problem, controller), got {validate.show(member)}")


def _points(simulation: Simulation) -> int:
    """Recorded blocks with a whole number of them in each quarter, as far as the steps can be divided so."""
    return 4 * int(np.ceil(simulation.steps / (4 * CHUNK_STEPS)))


def _quarters(batch: Batch, simulation: Simulation) -> Array:
    """(M, 4, n) from the recorded blocks: each belongs to the quarter in which its middle lies."""
    blocks = batch.blocks(simulation)
    quarter = (4 * (blocks.starts + 0.5 * blocks.lengths) / simulation.steps).astype(int)
    e = np.maximum(-blocks.figure("e", "min"), blocks.figure("e", "max"))
    found = np.full((4, *e.shape[1:]), -np.inf)
    np.maximum.at(found, quarter, e)
    found[:, :, ~np.isnan(batch.diverged_step)] = np.nan
    return np.moveaxis(found, 2, 0)
