"""The delay or gain error that a loop tolerates in simulation, found by a scan and bisection for many loops and two criteria at
once.

Unlike the exact margin of a linear loop, this margin applies to the loop while it adapts, but only for the simulated run: it is
measured, not guaranteed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Progress, part_of
from barbalat.judge.settings import Judge
from barbalat.linear.largest import halvings
from barbalat.loop.binding import bound, numbered
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.user_errors import named
from barbalat.pictures.plotted import Plotted
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.costs import of_members, steps_of
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import (
    SHORTEST_DELAY_STEPS,
    SIZES_TRIED,
    Ideals,
    JudgedRuns,
    Judging,
    Undelayed,
    shortest_delay,
)
from barbalat.study.resolved import resolved
from barbalat.study.verdicts import Lost, Member
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST_DELAY, LONGEST_IN_STEPS = 2.0, 200
"""The default of the largest delay to try [s], and its minimum in solver steps, which is needed because two seconds are
negligible for a slow plant."""
SCANNED_DELAYS = 12
"""Number of delays from the shortest up to the largest, with a factor of 2 to 3 between successive delays."""


LARGEST_GAIN_ERROR = 15.0
"""The largest factor on the input effectiveness to try is 16, and the smallest 1/16: 24 dB."""
GAINS_SCANNED = 6
"""Number of sizes up to the largest, with a factor of 3 between successive sizes."""
SMALLEST_GAIN_ERROR = 0.05
"""A loop that tolerates less than half a decibel tolerates nothing that can be resolved."""


def gains_scanned() -> Array:
    """The sizes of ``GainError`` that are tried first."""
    return np.asarray(np.geomspace(SMALLEST_GAIN_ERROR, LARGEST_GAIN_ERROR, GAINS_SCANNED))


def longest_delay(simulation: Simulation) -> float:
    """The largest delay that is tried by default [s]."""
    return max(LONGEST_DELAY, LONGEST_IN_STEPS * simulation.resolution)


def scanned(simulation: Simulation, longest: float, count: int) -> Array:
    """The delays that are tried first, in geometric progression [s]."""
    return np.asarray(np.geomspace(SHORTEST_DELAY_STEPS * simulation.resolution, longest, count))


class DelaySearch:
    """The brackets of M members, (2, M): one row for the onset of oscillation and one for loss."""

    def __init__(self, tracks: Array, begun: Array, scan: int, halvings: int) -> None:
        """``tracks`` (M,) is whether a member follows the model, and ``begun`` (M,) whether it oscillates without any modelling
        error."""
        self.scans_left, self.halvings_left, self.runs = scan, halvings, 0
        self.tolerates = np.zeros((2, len(tracks)))
        self.loses = np.tile(np.where(tracks, np.inf, 0.0), (2, 1))
        self.loses[0, begun] = 0.0

    def open_members(self) -> Array:
        """The members for which no delay that loses them has yet been found by one of the criteria."""
        return np.flatnonzero(np.isinf(self.loses).any(axis=0))

    def between(self) -> tuple[Array, Array]:
        """(members, sizes) the middle of every bracket, listed once if both criteria have the same bracket."""
        middles = np.sqrt(self.tolerates * self.loses)
        asked = [(i, middles[c, i]) for c, i in np.argwhere((self.tolerates > 0) & np.isfinite(self.loses))]
        pairs = sorted(set(asked))
        return np.array([i for i, _ in pairs], dtype=int), np.array([size for _, size in pairs])

    def take(self, chosen: Array, added: Array, verdicts: tuple[Array, Array]) -> None:
        """Narrow the brackets of the ``chosen`` members from the verdicts (onset, loss) at the sizes ``added``."""
        for size in np.unique(added):  # from short to long, because a member may have run with several sizes
            for c, lost in enumerate(verdicts):
                within = (added == size) & (self.tolerates[c, chosen] < size) & (size < self.loses[c, chosen])
                self.loses[c, chosen[within & lost]] = size
                self.tolerates[c, chosen[within & ~lost]] = size
        self.runs += len(chosen)

    def to_come(self) -> float:
        """Expected number of further runs, assuming that the open members are lost at a constant rate over the rest of the
        scan."""
        scans = len(self.open_members()) * (1 + self.scans_left / 2)
        inside = (self.loses > 0) & ~((self.tolerates == 0) & np.isfinite(self.loses))
        both = inside.all(axis=0) & (self.loses[0] == self.loses[1])
        return float(scans + self.halvings_left * (inside.sum() - 0.5 * both.sum()))


@dataclass(frozen=True, eq=False)
class Bracket:
    """The delay [s], or the size of a different modelling error, at which each of M loops is lost; each field is (M,).

    tolerates  the largest size tried below the first at which the loop is lost; 0 if it is lost at the first size tried
    loses      the smallest size tried at which the loop is lost; infinite if it is never lost, 0 if it is lost without any error
    """

    tolerates: Array
    loses: Array


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DelayMargins(Plotted):
    """The margins of M members. Statements about a delay apply to any kind of modelling error that was tried.

    onset, loss  the sizes at which each loop begins to oscillate and at which it is lost (see ``Lost``); either may be smaller
    tracks       (M,) whether the loop follows its model without a delay, with and without its noise; for a loop that does not,
                 the margins are 0 and 0
    oscillates   (M,) whether it already oscillates without a delay, judged without noise; the onset is then 0 and 0
    fills        (M,) whether its estimates already fill their known range without a delay, with the noise
    noisy        whether the members have measurement noise
    undelayed    metrics without an added delay, with the noise
    runs         number of simulations
    ends         for each loop, why its margin ends at the onset, in words; empty if no tried size ends it
    """

    onset: Bracket
    loss: Bracket
    tracks: Array
    oscillates: Array
    fills: Array
    noisy: bool
    undelayed: Metrics
    runs: int
    ends: tuple[str, ...] = ()

    def of(self, chosen: Array) -> DelayMargins:
        """The margins of the members ``chosen``, (J,). ``runs`` remains the total over all members."""
        return DelayMargins(
            onset=Bracket(self.onset.tolerates[chosen], self.onset.loses[chosen]),
            loss=Bracket(self.loss.tolerates[chosen], self.loss.loses[chosen]),
            tracks=self.tracks[chosen],
            oscillates=self.oscillates[chosen],
            fills=self.fills[chosen],
            noisy=self.noisy,
            undelayed=self.undelayed.of(chosen),
            runs=self.runs,
            ends=tuple(np.array(self.ends, dtype=object)[chosen]) if self.ends else (),
        )

    def __repr__(self) -> str:
        least = ", ".join(
            f"{name} from {found.tolerates.min():.4g} s" for name, found in (("onset", self.onset), ("loss", self.loss))
        )
        return f"<DelayMargins of {len(self.tracks)} loops: {least}; {self.runs} runs>"

    def plot(self, *, shown: bool = True) -> Figure:
        """The fraction of the loops that tolerate at least a given delay, by both criteria, as a Matplotlib figure.

        shown  whether to display the figure at once, if pyplot is in use
        """
        from barbalat.pictures.shares import Shares, draw

        values = {"until it oscillates": self.onset.tolerates, "until it is lost": self.loss.tolerates}
        panel = Shares(title="Delay tolerated", axis="delay at the plant's input [s]", values=values, at_least=True)
        return draw([panel], "", shown=shown)


def delay_margins(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    longest: float | None = None,
    scan: int = SCANNED_DELAYS,
    resolution: float = 0.02,
    judge: Judge | None = None,
    lost: Lost | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, DelayMargins]:
    """Return the delay margins of each controller on the problem, keyed by name; the arrays have one entry.

    Further arguments as in ``delay_margins_ensemble``.
    """
    controllers, found = numbered(controllers), validate.Named[DelayMargins].of("controller", {})
    for controller in controllers:
        with named(controller.name):
            bound(problem, controller)
    simulation = resolved(problem, controllers, simulation)
    for i, controller in enumerate(controllers):
        found[controller.name] = delay_margins_ensemble(
            [(problem, controller)], simulation, longest=longest, scan=scan, resolution=resolution, judge=judge, lost=lost,
            threads=threads, progress=part_of(progress, i / len(controllers), 1 / len(controllers)),
        )  # fmt: skip
    return found


def delay_margins_ensemble(
    members: Sequence[Member],
    simulation: Simulation,
    *,
    longest: float | None = None,
    scan: int = SCANNED_DELAYS,
    resolution: float = 0.02,
    judge: Judge | None = None,
    lost: Lost | None = None,
    numbers: Sequence[int] | Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DelayMargins:
    """Return the delay, in addition to the delay of the plant, at which each loop begins to oscillate, and the delay at which it
    is lost.

    longest     largest delay tried [s]; by default the value of ``longest_delay``
    scan        number of delays tried first, geometrically from two solver steps (the shortest that can be simulated; with a
                tolerance at most 1/10,000 of the run) to ``longest``. A loop that is lost, recovers and is lost again as the
                delay grows is detected if the scan resolves this
    resolution  relative distance of ``tolerates`` and ``loses`` at which bisection ends
    judge       the criteria for being lost and for a limit cycle; by default derived from the model's motion
    lost        the criterion for losing the commanded motion
    numbers     as in ``simulate_ensemble``: a member has the same noise in all its runs, whatever the other members are.
                Everything is judged first without noise and then with noise (see ``ideal_benchmark``)

    Members have one structure, as in ``simulate_ensemble``; they advance together, and every run is judged by both criteria.
    Raises InputError.
    """
    longest = longest_delay(simulation) if longest is None else longest
    if not longest > SHORTEST_DELAY_STEPS * simulation.resolution:
        raise InputError(f"longest must exceed {shortest_delay(simulation)}, got {longest:g} s")
    validate.whole("scan", scan, least=2)
    loop = ClosedLoop.of(*members[0])
    budget.require(
        "scan", scan, lambda count: of_members([loop], steps_of(simulation), len(members) * (count + BESIDE_SCAN)), least=2,
        given=f"= {scan} delays for {validate.counted(len(members), 'member')}", what="simulated delay margins",
    )  # fmt: skip
    return margins_ensemble(
        members, simulation, scanned(simulation, longest, scan), Ideals.over(simulation, longest),
        resolution=resolution, by=Judging(judge or Judge(), lost or Lost()), numbers=numbers, threads=threads, progress=progress,
    )  # fmt: skip


def margins_ensemble(
    members: Sequence[Member],
    simulation: Simulation,
    sizes: Array,
    ideals: Ideals,
    *,
    resolution: float = 0.02,
    by: Judging | None = None,
    numbers: Sequence[int] | Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DelayMargins:
    """Return the margins of each loop for the modelling error of ``ideals``, whose ``sizes`` are tried first."""
    resolution = validate.positive("resolution", resolution)
    streams = np.arange(len(members)) if numbers is None else np.asarray(numbers)
    by = by or Judging()
    undelayed = Undelayed.run(members, simulation, by.judge, streams, threads)
    judged = JudgedRuns(members, simulation, undelayed, streams, ideals, by, threads)
    search = DelaySearch(
        judged.tracks, judged.oscillates, len(sizes), halvings(float((sizes[1:] / sizes[:-1]).max()), resolution)
    )
    _advance(search, judged, sizes, progress)
    brackets = [Bracket(search.tolerates[c], search.loses[c]) for c in range(2)]
    return DelayMargins(
        onset=brackets[0],
        loss=brackets[1],
        tracks=judged.tracks,
        oscillates=judged.oscillates,
        fills=judged.fills,
        noisy=judged.noisy,
        undelayed=undelayed.noisy.metrics,
        runs=judged.runs + (1 + judged.noisy) * len(members),
        ends=tuple(judged.ends.get((i, float(size)), "") for i, size in enumerate(brackets[0].loses)),
    )


BESIDE_SCAN = 20 + 2 * SIZES_TRIED
"""Largest number of a member's runs in addition to the scan: bisections between two delays by two criteria, and runs of loops
with known theta."""
RUNS_AT_ONCE = 64
"""Number of runs that are made together instead of one size after another, to fill the lanes of the kernel."""


def _advance(search: DelaySearch, judged: JudgedRuns, sizes: Array, progress: Progress | None) -> None:
    """Scan over ``sizes`` and bisect, round by round; every round is one ensemble."""

    def run(chosen: Array, added: Array) -> None:
        """Run one round of the search: these members with errors of these sizes."""
        before, total = search.runs, search.runs + search.to_come()

        def advanced(fraction: float) -> None:
            if progress is not None:
                progress(min(1.0, (before + fraction * len(chosen)) / total))

        search.take(chosen, added, judged.lost(chosen, added, progress=advanced))

    at_once = len(sizes) if len(judged.members) * len(sizes) <= RUNS_AT_ONCE else 1
    for first in range(0, len(sizes), at_once):  # from small to large; a member that is lost by both criteria is not run again
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
