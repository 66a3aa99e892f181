"""The delay, or the error of the gain, that a loop bears, found by simulation: a scan, then bisection, for many loops and two
criteria at once.

Beside the exact margin of a linear loop this one holds for the adaptive loop in motion, but for the run that was made only:
it is measured, not guaranteed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barbalat import validate
from barbalat.linear.largest import halvings
from barbalat.loop.binding import bound, numbered
from barbalat.loop.blame import named
from barbalat.pictures.plotted import Plotted
from barbalat.problem.modelling_error import ModellingError
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.metrics import Metrics
from barbalat.run.progress import Progress, part_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import Lost, Onset
from barbalat.study.delay_search import LONGEST_DELAY, SCANNED_DELAYS, DelaySearch, scanned
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS, Benchmark, Ideals, Member, with_errors
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Bracket:
    """The delay [s], or the size of another modelling error, at which each of M loops is lost, (M,) each.

    bears  the largest that was tried below the first losing one; 0 where the first that was tried loses already
    loses  the smallest that was tried and lost; infinite where none was, 0 where the loop is lost without any
    """

    bears: Array
    loses: Array


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DelayMargins(Plotted):
    """For M members; what is said of a delay holds of whatever modelling error was tried.

    onset, loss  by the two criteria, ``Onset`` and ``Lost``; the onset is never later than the loss
    tracks       (M,) whether the loop follows its model without a delay; one that does not bears nothing: 0 and 0
    swings       (M,) whether its estimates oscillate without a delay already; the onset of such a one is 0 and 0. Not judged
                 where the measurement is noisy
    undelayed    figures without an added delay
    runs         simulations made
    """

    onset: Bracket
    loss: Bracket
    tracks: Array
    swings: Array
    undelayed: Metrics
    runs: int

    def __repr__(self) -> str:
        least = ", ".join(
            f"{name} from {found.bears.min():.4g} s" for name, found in (("onset", self.onset), ("loss", self.loss))
        )
        return f"<DelayMargins of {len(self.tracks)} loops: {least}; {self.runs} runs>"

    def plot(self, *, shown: bool = True) -> Figure:
        """Which share of the loops bears at least a delay, by both criteria, as a Matplotlib figure.

        shown  to a person at once, by pyplot where that is in use
        """
        from barbalat.pictures.shares import Shares, draw

        values = {"until it oscillates": self.onset.bears, "until it is lost": self.loss.bears}
        panel = Shares(title="Delay borne", axis="delay at the plant's input [s]", values=values, at_least=True)
        return draw([panel], "", shown=shown)


def delay_margins(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    longest: float = LONGEST_DELAY,
    scan: int = SCANNED_DELAYS,
    resolution: float = 0.02,
    onset: Onset | None = None,
    lost: Lost | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, DelayMargins]:
    """The delay margins of each controller on the problem, by its name; its arrays have one entry.

    The rest as of ``delay_margins_ensemble``.
    """
    controllers, found = numbered(controllers), validate.Named[DelayMargins].of("controller", {})
    for i, controller in enumerate(controllers):
        with named(controller.name):
            bound(problem, controller)
        found[controller.name] = delay_margins_ensemble(
            [(problem, controller)], simulation, longest=longest, scan=scan, resolution=resolution, onset=onset, lost=lost,
            threads=threads, progress=part_of(progress, i / len(controllers), 1 / len(controllers)),
        )  # fmt: skip
    return found


def delay_margins_ensemble(
    members: Sequence[Member],
    simulation: Simulation,
    *,
    longest: float = LONGEST_DELAY,
    scan: int = SCANNED_DELAYS,
    resolution: float = 0.02,
    onset: Onset | None = None,
    lost: Lost | None = None,
    numbers: Sequence[int] | Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DelayMargins:
    """The delay, beside the one that the plant has, at which each loop begins to oscillate and at which it is lost.

    longest     largest delay tried [s]
    scan        delays tried first, geometrically from two solver steps (the shortest that can be simulated) to ``longest``:
                a loop that is lost, saved and lost again as the delay grows is caught where the scan resolves it
    resolution  relative distance of ``bears`` and ``loses`` at which bisection ends
    numbers     as for ``simulate_ensemble``: a member has one noise in all its runs, whoever runs beside it

    Members have one structure, as for ``simulate_ensemble``; they advance together, and every run is judged by both criteria.
    Raises InputError.
    """
    if not longest > SHORTEST_DELAY_STEPS * simulation.dt:
        raise InputError(f"longest must exceed two solver steps, {SHORTEST_DELAY_STEPS * simulation.dt:g} s, got {longest:g} s")
    validate.whole("scan", scan, least=2)
    return margins_ensemble(
        members, simulation, scanned(simulation, longest, scan), Ideals.over(simulation, longest),
        resolution=resolution, criteria=(onset or Onset(), lost or Lost()), numbers=numbers, threads=threads, progress=progress,
    )  # fmt: skip


def margins_ensemble(
    members: Sequence[Member],
    simulation: Simulation,
    sizes: Array,
    ideals: Ideals,
    *,
    resolution: float = 0.02,
    criteria: tuple[Onset, Lost] | None = None,
    numbers: Sequence[int] | Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DelayMargins:
    """The same for the modelling error of ``ideals``, whose ``sizes`` are tried first."""
    resolution = validate.positive("resolution", resolution)
    streams = np.arange(len(members)) if numbers is None else np.asarray(numbers)
    undelayed = simulate_ensemble(members, simulation, numbers=streams, threads=threads).metrics
    benchmark = Benchmark.of(members, undelayed, streams, ideals)
    search = DelaySearch(
        benchmark, criteria or (Onset(), Lost()), len(sizes), halvings(float((sizes[1:] / sizes[:-1]).max()), resolution)
    )
    if members[0][0].noise is None:  # noise moves the estimates too: then nothing is said of the undelayed run
        search.find_swinging(undelayed)

    _advance(search, members, simulation, sizes, ideals.error, streams, threads, progress)
    brackets = [Bracket(search.bears[c], search.loses[c]) for c in range(2)]
    return DelayMargins(
        onset=brackets[0],
        loss=brackets[1],
        tracks=search.tracks,
        swings=search.swings,
        undelayed=undelayed,
        runs=search.runs + len(members),
    )


RUNS_AT_ONCE = 64
"""Runs that are made at once rather than one size after the other: they fill the kernel's lanes."""


def _advance(
    search: DelaySearch,
    members: Sequence[Member],
    simulation: Simulation,
    sizes: Array,
    error: ModellingError,
    streams: Array,
    threads: int | None,
    progress: Progress | None,
) -> None:
    """The scan over ``sizes`` and the halvings, round by round, every round one ensemble."""

    def run(chosen: Array, added: Array) -> None:
        """One round: these members with errors of these sizes."""
        changed = with_errors([members[i] for i in chosen], error, added)
        before, total = search.runs, search.runs + search.to_come()

        def advanced(fraction: float) -> None:
            if progress is not None:
                progress(min(1.0, (before + fraction * len(chosen)) / total))

        found = simulate_ensemble(changed, simulation, numbers=streams[chosen], threads=threads, progress=advanced)
        search.take(chosen, added, found.metrics)

    at_once = len(sizes) if len(members) * len(sizes) <= RUNS_AT_ONCE else 1
    for first in range(0, len(sizes), at_once):  # from small to large; a member that both criteria call lost is not run again
        chosen, some = search.open_members(), sizes[first : first + at_once]
        search.scans_left -= len(some)
        if len(chosen):
            run(np.tile(chosen, len(some)), np.repeat(some, len(chosen)))
    while search.halvings_left:
        chosen, middles = search.between()
        if len(chosen):
            run(chosen, middles)
        search.halvings_left -= 1
    if progress is not None:
        progress(1.0)
