"""Many runs at once: members that differ in any number of the plant, the settings or the quantities that follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, Progress, part_of
from barbalat.judge.judged import Judged
from barbalat.judge.settings import Judge
from barbalat.pictures.plotted import Plotted
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import Terms, judged, watched_in_sweeps
from barbalat.run.engine.side_by_side import expected_attempts, run_members
from barbalat.run.kernel import costs, delay
from barbalat.run.kernel.breaks import LostOrder, lost_along, lost_order
from barbalat.run.kernel.grid import CHUNK_STEPS
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MEMBERS_AT_ONCE = 2**16
"""Members that run in parallel: enough for all cores, and few enough for their working data to fit into memory."""
READING_STEPS = 1000
"""Number of steps of a member's run that take about as long as reading the member."""

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class EnsembleResult(Plotted):
    """Metrics of M members, in the given order; ``varied`` is how many numbers differ between them.

    quarters  (M, 4, n) the largest |e| in each quarter of the run, without t_end, if requested; NaN for a member that diverged
    lost      the effect of jumps and corners inside steps on all members, as in the ``Result`` of a single run
    judged    the verdicts, if the call had a judge
    stalled   (M,) with a tolerance: whether no step was short enough for the member. The metrics of such members are NaN, and
              they count as lost
    """

    simulation: Simulation
    metrics: Metrics
    varied: int
    quarters: Array | None = None
    lost: LostOrder | None = None
    judged: Judged | None = None
    stalled: Array | None = None

    def __repr__(self) -> str:
        diverged, M = int(np.isfinite(self.metrics.diverged_at).sum()), len(self)
        e = self.metrics.tail_max_abs_e
        worst = ", ".join(f"{value:.4g}" for value in np.nanmax(e, axis=0)) if np.isfinite(e).any() else "-"
        size = f"{validate.counted(M, 'member')}, {validate.counted(self.varied, 'number')} varied"
        stalled = 0 if self.stalled is None else int(self.stalled.sum())
        lost = f"{diverged} diverged" + (f", {stalled} stalled" if stalled else "")
        return f"<EnsembleResult: {size}, {lost}; worst |e| in the tail {worst}>"

    def plot(self, *, shown: bool = True) -> Figure:
        """The fraction of the members with at most a given error, for the whole run and for the tail, as a Matplotlib figure.

        shown  whether to display the figure at once, if pyplot is in use
        """
        from barbalat.pictures.shares import Shares, draw

        found, M = self.metrics, len(self)
        panels = [
            Shares(title=title, axis=title, values={f"$e_{i + 1}$": np.abs(e[:, i]) for i in range(e.shape[1])})
            for title, e in (("largest |e|", found.max_abs_e), ("largest |e| in the tail", found.tail_max_abs_e))
        ]
        diverged = int(np.isfinite(found.diverged_at).sum())
        without = int(np.isnan(found.max_abs_e).any(axis=1).sum())
        why = "diverged" if without == diverged else "diverged or stalled"
        note = validate.counted(M, "run") + (
            f"; {without} {why} and have no error, so the fraction stays below 1" if without else ""
        )
        return draw(panels, note, shown=shown)

    def __len__(self) -> int:
        return len(self.metrics.diverged_at)


def simulate_ensemble(
    members: Iterable[tuple[TrackingProblem, Controller]],
    simulation: Simulation,
    *,
    numbers: Sequence[int] | Array | None = None,
    quarters: bool = False,
    judge: Judge | None = None,
    frequencies: bool = True,
    threads: int | None = None,
    lanes: int | None = None,
    progress: Progress | None = None,
    estimated: bool = False,
) -> EnsembleResult:
    """Run every (problem, controller) and return the metrics over all steps; no trajectory is kept.

    All members have one structure (scheme, dimensions, projection or not, signals) and may differ in every number: theta, x0,
    gamma, kappa, the box, A_m and therefore P, ... Numbers that are equal for all members are compiled in.

    members         read once, in order, and not stored. A generator is accepted, with which a million members take little memory
    numbers         determine each member's measurement noise, together with the seed; by default 0, 1, ... in the given order.
                    Members with the same number and seed have the same noise
    quarters        also keep the largest |e| in each quarter of the run; needs at least eight steps
    judge           judges every member; None (default) for no verdicts. Model, signals and labels are those of the first member
    frequencies     whether to measure the frequencies of limit cycles, which doubles the time if members are in limit cycles
    threads, lanes  affect only the speed; the results are the same bit for bit
    progress        reading members counts as part of the work if their number is known beforehand
    estimated       whether the budget is known to allow all steps: with a tolerance, this saves a trial run of the first member

    With a tolerance, each member has its own steps, and the errors of members are not measured, because there is no second run. A
    member whose steps become too short to advance it stalls, without effect on the others (see ``EnsembleResult.stalled``).
    """
    count = _require(members, simulation, quarters, lanes)
    reading = 0.0 if count is None else READING_STEPS / (READING_STEPS + simulation.steps)

    def taken(i: int) -> None:
        if progress is not None:
            progress(reading * min(i / (count or i), 1.0))

    watched = None if judge is None else watched_in_sweeps(judge)
    read = Members.read(_checked(members), simulation, watched=watched, first="member 1: ", taken=taken)
    if numbers is not None:
        if len(numbers) != len(read):
            raise InputError(f"numbers must have {validate.counted(len(read), 'entry')}, one for each member, got {len(numbers)}")
        read = replace(read, numbers=np.array([validate.whole("numbers", number, least=0) for number in numbers]))

    def cost(count: float) -> Estimate:
        kept = Estimate() if judge is None else costs.of_judging([read.loop], count)
        return costs.of_members([read.loop], steps, count) + kept

    steps: float = simulation.steps
    if simulation.tolerance is not None:
        steps = 0.0 if estimated else costs.steps_like(expected_attempts(read))
    budget.require("members", len(read), cost, what="an ensemble")
    by_tolerance, grid = simulation.tolerance is not None, simulation if simulation.tolerance is None else simulation.grid
    if not by_tolerance:
        delay.require_memory(read.longest_delay, read.loop.inputs, min(len(read), MEMBERS_AT_ONCE), simulation.dt)
    points = 4 * int(
        np.ceil(simulation.steps / (4 * CHUNK_STEPS))
    )  # each quarter has a whole number of blocks if there are enough steps
    blocks = replace(simulation, record_points=points) if quarters else simulation
    found, verdicts, stalled = [], [], []
    for first in range(0, len(read), MEMBERS_AT_ONCE):
        which = slice(first, min(first + MEMBERS_AT_ONCE, len(read)))
        done, width = (reading + (1 - reading) * first / len(read), (1 - reading) * (which.stop - first) / len(read))
        told = part_of(progress, done, width)
        if by_tolerance:
            batch: Batch = (observed := run_members(read, which, threads=threads, lanes=lanes, progress=told))
            stalled.append(observed.stalled)  # the judge adds to it
        else:
            batch = Batch.part(read, which, record=quarters, lanes=lanes)
            run([batch], read.signals, blocks, threads=threads, progress=told)
        found.append((batch.metrics(grid), _quarters(batch, blocks) if quarters else None))
        if judge is not None and read.problem is not None:
            terms = Terms.of(read.problem, grid, judge)
            verdicts.append(judged(batch, grid, terms, frequencies=frequencies, excused=True, threads=threads))
    metrics, by_quarters = zip(*found, strict=True)
    largest = np.concatenate([part.max_abs_u.reshape(len(part.max_abs_u), -1) for part in metrics])
    return EnsembleResult(
        simulation=simulation,
        metrics=Metrics.together(metrics),
        varied=len(read.parameters),
        quarters=np.concatenate(by_quarters) if quarters else None,
        lost=None if by_tolerance else _lost(read, simulation, None if len(read.parameters) else largest),
        judged=Judged.together(verdicts) if verdicts else None,
        stalled=np.concatenate(stalled) if stalled else None,
    )


def _lost(read: Members, simulation: Simulation, largest: Array | None) -> LostOrder | None:
    """The effect of jumps and corners inside steps; ``largest`` as in ``lost_along``."""
    lost = lost_order(read.signals, simulation, delayed=read.loop.delayed, bends=delay.brings_bends(read.loop))
    return lost_along(lost, read.loop, simulation, largest)


def _require(members: Any, simulation: Simulation, quarters: bool, lanes: int | None) -> int | None:
    """Raise InputError for input that can't form an ensemble; returns the number of members if it is known beforehand."""
    if lanes is not None and (validate.whole("lanes", lanes, least=1) & (lanes - 1)):
        raise InputError(f"lanes must be a power of two, got {lanes}")
    if not isinstance(members, Iterable) or isinstance(members, (str, bytes, Mapping)):
        raise InputError(f"members must be a list of pairs (problem, controller), got {validate.show(members)}")
    validate.instance("simulation", simulation, Simulation)
    if quarters:
        simulation.require_steps("the error in each quarter")
    if quarters and simulation.steps < 8:
        raise InputError(f"quarters need at least eight solver steps, got {simulation.steps}")
    return len(members) if isinstance(members, Sized) else None


def _checked(members: Iterable[Any]) -> Iterator[tuple[TrackingProblem, Controller]]:
    """The members in order; raises InputError for an invalid one, and if there is none."""
    i = 0
    for i, member in enumerate(members, start=1):
        if not (isinstance(member, tuple) and len(member) == 2 and isinstance(member[0], TrackingProblem)):
            raise InputError(f"member {i} must be a pair (problem, controller), got {validate.show(member)}")
        yield member
    if not i:
        raise InputError("an ensemble needs at least one member, got none")


def _quarters(batch: Batch, simulation: Simulation) -> Array:
    """(M, 4, n) from the recorded blocks; a block belongs to the quarter that contains its middle."""
    blocks = batch.blocks(simulation)
    quarter = (4 * (blocks.starts + 0.5 * blocks.lengths) / simulation.steps).astype(int)
    e = np.maximum(-blocks.figure("e", "min"), blocks.figure("e", "max"))
    found = np.full((4, *e.shape[1:]), -np.inf)
    np.maximum.at(found, quarter, e)
    found[:, :, ~np.isnan(batch.diverged_step)] = np.nan
    return np.moveaxis(found, 2, 0)
