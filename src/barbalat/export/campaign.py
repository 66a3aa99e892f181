"""Runs the compiled C with random faults, to find how the error grows and the longest tolerated outage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from barbalat.budget import Progress
from barbalat.export.in_the_loop import Exported
from barbalat.judge.settings import Judge, component_names
from barbalat.judge.verdict import Class, Verdict
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.faults import LARGEST_SEED, Dropout, Fault
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BreakingSignal, Controller, Signal
from barbalat.run.engine.engine import Batch
from barbalat.run.engine.judging import Terms, judged, watched_in_sweeps
from barbalat.run.engine.simulate import result_of
from barbalat.solvers.simulation import Simulation
from barbalat.targets import require_sampled
from barbalat.validate import Array, InputError

DRAWS = 8
"""Number of draws for each kind of random faults, and largest number of phases of regular outages."""
STARTS = 13
"""Number of instants at which outages are tried before the neighbours of the worst one: at peaks of the run, at and after jumps,
and evenly spread."""
JUMPS = 3
"""Largest number of jumps and corners of commands and disturbances at and after which outages are tried."""
TOLERATED = 2.0
"""An outage is tolerated if the largest error of every component is below this multiple of its largest error without faults."""
LOST_SHARES = (0.01, 0.1, 0.5)
BURST_SHARE, BURST_SAMPLES = 0.1, 10


@dataclass(frozen=True, kw_only=True)
class Degradation:
    """The effect of one kind of faults over all their draws.

    faults   in words
    draws    number of runs, each with different draws
    missed   the mean fraction of samples that the C missed or rejected, of those until the run ended or diverged
    beyond   the largest fraction of the time for which any |e_i| exceeded its fault-free maximum
    worst    the largest |e| of each component over all runs; None if a run diverged
    lost     number of runs that diverged
    classes  number of runs in each class of the judge: lost, limit cycle, off, follows; empty classes are omitted
    """

    faults: str
    draws: int
    missed: float
    beyond: float
    worst: tuple[float, ...] | None
    lost: int
    classes: dict[str, int] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The verdicts of the runs: "follows" if all agree, otherwise "limit cycle 2, follows 6"."""
        if len(self.classes) == 1:
            return next(iter(self.classes))
        return ", ".join(f"{kind} {count}" for kind, count in self.classes.items())


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The results of the C code of a controller with faults; errors are components of x - x_m or y - y_m.

    nominal  the largest |e| of each component without faults
    verdict  the judge's class of the run without faults; ``sentence`` puts it in words
    missed   the fraction of samples in that run that the shell rejected
    starts   the instants [s] at which outages were tried, each at a sample
    longest  the longest outage, in samples, that was tolerated from all ``starts``; an estimate: from another instant a shorter
             outage may do harm
    most     the longest outage that was tried, in samples
    worst    the instant at which one more sample did harm; None if the longest outage tried was tolerated
    allowed  the longest outage that the shell accepts, in samples; None without a limit
    """

    controller: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    sample_time: float
    nominal: tuple[float, ...]
    rows: tuple[Degradation, ...]
    starts: tuple[float, ...]
    longest: int
    most: int
    verdict: str = ""
    sentence: str = ""
    missed: float = 0.0
    worst: float | None = None
    allowed: int | None = None

    def as_json(self) -> dict[str, Any]:
        """The fields of the document of ``export --json``."""
        return {**asdict(self), "longest_outage": self.longest * self.sample_time, "tolerated_factor": TOLERATED}

    def factor(self, row: Degradation) -> float:
        """The largest ratio of a component's error to its nominal error; infinite if a run diverged."""
        return max(self._ratios(row), default=float("inf"))

    def worst_component(self, row: Degradation) -> int | None:
        """The index of the component with the largest ratio; None if a run diverged."""
        ratios = self._ratios(row)
        return ratios.index(max(ratios)) if ratios else None

    def _ratios(self, row: Degradation) -> list[float]:
        pairs = zip(row.worst or (), self.nominal, strict=row.worst is not None)
        return [worst / nominal if nominal else float("inf") if worst else 1.0 for worst, nominal in pairs]


def export_campaign(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    draws: int = DRAWS,
    float32: bool = False,
    judge: Judge | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Run the export of a sampled controller with faults: the faults of the case, drawn again for each run, and lost
    measurements.

    Every run has the compiled C in the loop, with the case's shell; with ``float32`` its numbers have 32 bits. Each run is judged
    by ``judge``, as ``simulate`` does. Raises InputError as ``simulate_export`` does, and if the run without faults diverges.
    """
    judge = (Judge() if judge is None else judge).named(problem)
    quiet = replace(problem, faults=())  # type: ignore[type-var]
    loop = ClosedLoop.of(quiet, controller)
    require_sampled(controller.name, sampled=loop.sampled)
    T = loop.sample_time
    assert T is not None
    flights = _Flights(quiet, Exported.of(quiet, controller, simulation, float32=float32, windows=0), T, judge)
    kinds = _kinds(problem.faults, T)
    done = 0

    def told(flown: int) -> None:
        nonlocal done
        done += flown
        if progress is not None:
            progress(min(1.0, done / (draws * (len(kinds) + 1) + EXPECTED_FLIGHTS)))

    rows = []
    for words, faults in kinds.items():
        rows.append(flights.through(words, [_drawn(faults, k) for k in range(draws)]))
        told(draws)
    most = int(simulation.t_end / 4 / T)

    def tolerates(k: int, samples: int) -> bool:
        told(1)
        return flights.tolerates(k, samples)

    search = Search(most, tolerates)
    longest = search.longest(flights.instants(controller))
    allowed = None if loop.around is None or loop.around.longest is None else int(loop.around.longest)
    if lost := longest if allowed is None else allowed:
        phases = sorted({k * (lost + 1) // draws for k in range(draws)})
        regular = [(Regular(T=T, lost=lost, first=first),) for first in phases]
        rows.append(flights.through(f"{lost} of every {lost + 1} samples lost", regular))
        told(draws)
    labels = problem.labels
    return Campaign(
        controller=controller.name,
        names=component_names(problem),
        units=() if labels is None else labels.units,
        sample_time=T,
        nominal=tuple(flights.nominal.tolist()),
        rows=tuple(rows),
        starts=tuple(k * T for k in sorted(search.tried)),
        longest=longest,
        most=most,
        worst=None if longest == most else search.worst * T,
        allowed=allowed,
        verdict=str(flights.verdict.kind),
        sentence=str(flights.verdict),
        missed=flights.missed,
    )


EXPECTED_SECONDS = 5.0
"""Seconds of a campaign on one core, for a run of some 10,000 steps."""
EXPECTED_FLIGHTS = 70
"""Runs of the search for the longest outage: a dozen for the first instant, and some for those that shorten it."""


def _kinds(own: Sequence[Fault], T: float) -> dict[str, tuple[Fault, ...]]:
    """Faults keyed by name: the faults of the case, and lost measurements, which every controller eventually encounters."""
    found: dict[str, tuple[Fault, ...]] = {"the case's own": tuple(own)} if own else {}
    found |= {f"{100 * share:g} % of the measurements lost": (Dropout(share=share),) for share in LOST_SHARES}
    words = f"{100 * BURST_SHARE:g} % lost, in bursts of {BURST_SAMPLES}"
    return found | {words: (Dropout(share=BURST_SHARE, burst=BURST_SAMPLES * T),)}


@dataclass(frozen=True, kw_only=True)
class Regular(Dropout):
    """Outages in a regular sequence: one of every ``lost`` + 1 samples is measured, beginning with sample ``first``."""

    T: float
    lost: int
    first: int
    always: ClassVar[bool] = True

    def there(self, t: Array, place: int) -> Array:
        """Whether the measurements at times t [s] are lost."""
        return np.asarray((np.round(np.asarray(t) / self.T) - self.first) % (self.lost + 1) != 0)


def _drawn(faults: tuple[Fault, ...], k: int) -> tuple[Fault, ...]:
    return tuple(replace(fault, seed=(fault.seed + k) % (LARGEST_SEED + 1)) for fault in faults)


class _Flights:
    """Flights of one export; flights with the same kinds of faults share a kernel and a library."""

    def __init__(self, problem: TrackingProblem, exported: Exported, T: float, judge: Judge) -> None:
        self.problem, self.exported, self.simulation, self.T, self.judge = problem, exported, exported.simulation, T, judge
        self.compiled: dict[tuple[tuple[str, str], ...], Exported] = {}
        batch, refused = self._fly(())
        self.missed = self._missed(batch, refused)
        self.quiet = batch
        found = self._errors(batch)
        if found is None:
            raise InputError(
                f"{exported.controller.name} diverges on this case without any fault, so a campaign would show nothing"
            )
        self.nominal: Array = found
        self.verdict = self._judged(batch, problem)

    def _fly(self, faults: tuple[Fault, ...]) -> tuple[Batch, Array]:
        kind = tuple((fault.kind, fault.channels) for fault in faults)
        if kind not in self.compiled:
            self.compiled[kind] = replace(self.exported, library=None)
        watched = watched_in_sweeps(self.judge)
        return self.compiled[kind].fly(replace(self.problem, faults=faults), watched=watched)  # type: ignore[type-var]

    def _samples(self, batch: Batch) -> float:
        """The number of samples until the run ended or diverged."""
        end = batch.metrics(self.simulation).diverged_at[0]
        end = self.simulation.t_end if np.isnan(end) else max(end, self.T)
        return float(np.ceil(end / self.T * (1 - 1e-9)))

    def _missed(self, batch: Batch, refused: Array) -> float:
        """The fraction of the samples until the run ended or diverged at which the C ``refused`` something."""
        samples = self._samples(batch)
        return float(refused[: int(samples)].sum() / samples)

    def _judged(self, batch: Batch, problem: TrackingProblem) -> Verdict:
        return judged(batch, self.simulation, Terms.of(problem, self.simulation, self.judge)).verdict(0)

    def _errors(self, batch: Batch) -> Array | None:
        """(n,) the largest |e|; None for a run that diverged."""
        found = batch.metrics(self.simulation).max_abs_e[0]
        return None if np.isnan(found).any() else found

    def through(self, words: str, drawn: Sequence[tuple[Fault, ...]]) -> Degradation:
        """The effect of faults over their draws."""
        worst, lost, missed, beyond = np.zeros(len(self.nominal)), 0, 0.0, 0.0
        kinds, draws = [], len(drawn)
        for faults in drawn:
            batch, refused = self._fly(faults)
            kinds.append(self._judged(batch, replace(self.problem, faults=faults)).kind)  # type: ignore[type-var]
            missed += self._missed(batch, refused) / draws
            beyond = max(beyond, self._beyond(batch))
            errors = self._errors(batch)
            lost += errors is None
            worst = worst if errors is None else np.maximum(worst, errors)
        ends = None if lost else tuple(worst.tolist())
        classes = {str(kind): kinds.count(kind) for kind in Class if kind in kinds}
        return Degradation(faults=words, draws=draws, missed=missed, beyond=beyond, worst=ends, lost=lost, classes=classes)

    def _beyond(self, batch: Batch) -> float:
        """The fraction of the recorded intervals in which any |e_i| was larger than without faults, or missing."""
        blocks = batch.blocks(self.simulation)
        low, high = (blocks.figure("e", side)[:, :, 0] for side in ("min", "max"))
        within = (np.maximum(-low, high) <= self.nominal).all(axis=1)
        return 1.0 - float(blocks.lengths[: len(within)][within].sum()) / self.simulation.steps

    def instants(self, controller: Controller) -> list[int]:
        """Samples from which an outage probably does harm, the likeliest first. They lie after jumps and corners of commands and
        disturbances, at the largest rate before the next one, and at the largest |e|, |u| and rate of the run without faults;
        further samples are evenly spread."""
        run = result_of(self.problem, controller, self.simulation, self.quiet)
        t, last = run.t, int(self._samples(self.quiet)) - 1
        rate = _sized(np.gradient(run.x.reshape(len(t), -1), t, axis=0))
        jumps = _jumps(self.problem.signals, self.simulation.t_end)
        ends = [*jumps, self.simulation.t_end][1:]
        after = [within[int(rate[within].argmax())] for a, b in zip(jumps, ends, strict=True) if len(within := _inside(t, a, b))]
        peaks = [int(size.argmax()) for size in (rate, _sized(run.e), _sized(run.u))]
        found = [*jumps, *t[after], *t[peaks]]
        count = max(STARTS - len(found), 1)
        found += [self.simulation.t_end * (k + 0.5) / count for k in range(count)]
        return list(dict.fromkeys(min(max(int(np.ceil(one / self.T - 1e-6)), 1), last) for one in found))

    def tolerates(self, k: int, samples: int) -> bool:
        """Whether no component's largest error exceeds its limit if the measurements from number ``k`` on are lost."""
        batch, _ = self._fly((Dropout(times=(((k - 0.5) * self.T, (k + samples - 0.5) * self.T),)),))
        errors = self._errors(batch)
        return errors is not None and bool((errors <= TOLERATED * self.nominal).all())


def _inside(t: Array, start: float, stop: float) -> Array:
    return np.flatnonzero((t >= start) & (t < stop))


def _sized(signal: Array) -> Array:
    """(K,) the size of a signal whose components are each divided by their largest value."""
    sizes = np.abs(signal.reshape(len(signal), -1))
    return np.asarray((sizes / np.fmax(sizes.max(axis=0), np.finfo(float).tiny)).sum(axis=1))


def _jumps(signals: Sequence[Signal], t_end: float) -> list[float]:
    """At most JUMPS instants of jumps or, without any jump, of corners. They are chosen evenly, beginning with the first, among
    those whose size is at least half the largest size for their signal."""
    jumps, corners = set[float](), set[float]()
    for signal in (one for one in signals if isinstance(one, BreakingSignal)):
        at = np.asarray(signal.breaks(0.0, t_end), dtype=float)
        size = np.abs(signal(at) - signal.before(at))
        corners |= set(at.tolist())
        jumps |= set(at[(size > 0) & (size >= size.max(initial=0.0) / 2)].tolist())
    found = sorted(jumps or corners)
    return [found[k * len(found) // JUMPS] for k in range(JUMPS)] if len(found) > JUMPS else found


class Search:
    """The longest outage that is tolerated from every instant tried, in samples.

    most       the longest outage to try
    tolerates  whether an outage from sample ``k`` on over some ``samples`` is tolerated
    tried      for each k the longest outage that was found to be tolerated
    worst      the instant at which one more sample did harm
    """

    def __init__(self, most: int, tolerates: Callable[[int, int], bool]) -> None:
        self.most, self.tolerates = most, tolerates
        self.tried: dict[int, int] = {}
        self.worst = 0
        self.found = most

    def longest(self, instants: Sequence[int]) -> int:
        """Shorten the outage at each of the ``instants``, then at neighbours of the worst, until all of them tolerate it."""
        for k in instants:
            self._shorten(k)
        reach = self.found // 2 if self.found < self.most else 0
        while reach:
            near = [k for k in (self.worst - reach, self.worst + reach) if k >= 1 and k not in self.tried]
            shorter = [self._shorten(k) for k in near]
            reach = reach if any(shorter) else reach // 2
        while open_ones := [k for k, samples in self.tried.items() if samples != self.found]:  # not tried at this length
            for k in open_ones:
                self._shorten(k)
        return self.found

    def _shorten(self, k: int) -> bool:
        """Whether the longest outage so far does harm from sample ``k`` on, where it is then shortened: by doubling if nothing is
        known of its length, and by bisection."""
        self.tried[k] = self.found
        if not self.found or self.tolerates(k, self.found):
            return False
        low, high = 0, self.found
        trial = 1 if high == self.most else high
        while trial < high:
            if not self.tolerates(k, trial):
                high = trial
            else:
                low, trial = trial, 2 * trial
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.tolerates(k, middle) else (low, middle)
        self.tried[k] = self.found = low
        self.worst = k
        return True
