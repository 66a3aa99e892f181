"""Tracking against robustness: what each scheme's own knobs buy, with the Pareto front of each scheme in one plane."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from barbalat import validate
from barbalat.controllers.knobs import Knobs
from barbalat.pictures.plotted import Plotted
from barbalat.problem.known_set import KnownSet
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.progress import Progress
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import Lost, Onset
from barbalat.study.delay_margin import DelayMargins, delay_margins_ensemble
from barbalat.study.forecast import Forecast
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS
from barbalat.study.knobs import default_knobs
from barbalat.study.motion import REST_SENTENCE, ModelMotion
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, kw_only=True)
class Cloud:
    """One scheme's tunings with what they reach.

    tunings  K settings by name
    error    (K, P) RMS of |e| over the run without delay, relative to the RMS of |x_m|; NaN where the loop does not follow its
             model without a delay: its tail's error is above the model's motion, or it diverged
    onset    (K, P) the largest added delay before the loop oscillates [s], see ``Onset``; 0 where that is none, or too short to
             be simulated
    loss     (K, P) the largest added delay before the loop is lost [s], see ``Lost``
    The P plants are the case's own first, then those of the seeded sample of the known set.
    """

    scheme: str
    tunings: tuple[dict[str, float], ...]
    error: Array
    onset: Array
    loss: Array

    def at(self, which: str, criterion: str) -> tuple[Array, Array]:
        """(error, margin), (K,) each: of the case's "plant", or of the "worst" plant, each on its own; "onset" or "loss"."""
        margin = {"onset": self.onset, "loss": self.loss}[criterion]
        if which == "plant":
            return self.error[:, 0], margin[:, 0]
        return self.error.max(axis=1), margin.min(axis=1)  # a NaN among the errors stays one

    def front(self, which: str, criterion: str) -> Array:
        """Indices of the Pareto front, by growing margin: no other tuning has as much margin and less error."""
        return pareto_front(*self.at(which, criterion))

    def bears(self, which: str, criterion: str, error: float) -> float:
        """The largest margin among the tunings with at most this error [s]; NaN where none is as good."""
        errors, margins = self.at(which, criterion)
        good = errors <= error  # not where the error is NaN
        return float(margins[good].max()) if good.any() else float("nan")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TradeOff(Plotted):
    """The clouds of all schemes on one problem; ``notes`` are sentences on what was left out and what was not seen."""

    problem: Problem
    simulation: Simulation
    thetas: Array  # (P, p)
    clouds: tuple[Cloud, ...]
    criteria: tuple[Onset, Lost]
    notes: tuple[str, ...]
    runs: int
    seconds: float

    @property
    def shortest(self) -> float:
        """The shortest delay that was tried [s]."""
        return SHORTEST_DELAY_STEPS * self.simulation.dt

    def __repr__(self) -> str:
        schemes = ", ".join(f"{len(cloud.tunings)} of {cloud.scheme}" for cloud in self.clouds)
        return f"<TradeOff of {self.problem.name!r}: {schemes} on {len(self.thetas)} plants, {self.runs} runs>"

    def plot(self, *, shown: bool = True) -> Figure:
        """The clouds and the front of each scheme, by both criteria, as a Matplotlib figure.

        shown  to a person at once, by pyplot where that is in use
        """
        from barbalat.study.tradeoff_picture import draw

        return draw(self, shown=shown)


def pareto_front(error: Array, margin: Array) -> Array:
    """Indices of the tunings that no other one beats in both, by growing margin; a lost tuning is on no front."""
    usable = np.flatnonzero(np.isfinite(error) & (margin > 0))
    order = usable[np.lexsort((-margin[usable], error[usable]))]  # least error first, of equal ones the larger margin
    kept: list[int] = []
    for i in order:
        if not kept or margin[i] > margin[kept[-1]]:
            kept.append(int(i))
    return np.array(kept, dtype=int)


def trade_off(
    problem: Problem,
    simulation: Simulation,
    *,
    knobs: tuple[Knobs, ...] | None = None,
    density: int = 6,
    own: Sequence[Controller] = (),
    plants: int = 4,
    seed: int = 0,
    longest: float = 2.0,
    onset: Onset | None = None,
    lost: Lost | None = None,
    estimate: Callable[[float], None] | None = None,
    progress: Progress | None = None,
) -> TradeOff:
    """Run every tuning of every scheme on the case's plant and on ``plants`` - 1 others, drawn from the known set.

    knobs     by default those of ``default_knobs`` with this ``density`` and these controllers of one's ``own``
    longest   largest delay tried [s]
    estimate  called once with the seconds that are expected in all, measured on a part of the work
    progress  its fractions are of the time, by a forecast that is refined with every round
    Raises InputError for a problem without a known set.
    """
    started = time.perf_counter()
    if problem.uncertainty is None:
        raise InputError("the trade-off needs the known set: give uncertainty.lower and .upper, or .center and .radius")
    validate.whole("plants", plants, least=1)
    chosen, left_out = default_knobs(problem, simulation, density=density, own=own) if knobs is None else (knobs, ())
    family = plants_of(problem, problem.uncertainty, plants, seed)
    members = {k.scheme: [(p, k.make(**tuning)) for tuning in k.tunings() for p in family] for k in chosen}
    forecast = Forecast.of(members, plants, simulation)
    if estimate is not None:
        estimate(time.perf_counter() - started + sum(forecast.expected.values()))
    motion, criteria = ModelMotion.of(problem, simulation), (onset or Onset(), lost or Lost())
    found = []
    for k in chosen:
        with forecast.timed(k.scheme):
            group, part = members[k.scheme], _in_time(progress, forecast, k.scheme)
            found.append(_delay_margins(group, plants, simulation, longest=longest, criteria=criteria, progress=part))
    return TradeOff(
        problem=problem,
        simulation=simulation,
        thetas=np.stack([p.plant.theta for p in family]),
        clouds=tuple(_cloud(k, of_scheme, motion.rms, plants) for k, of_scheme in zip(chosen, found, strict=True)),
        criteria=criteria,
        notes=(*left_out, *([REST_SENTENCE] if motion.comes_to_rest else [])),
        runs=sum(of_scheme.runs for of_scheme in found),
        seconds=time.perf_counter() - started,
    )


def _delay_margins(
    members: list[tuple[Problem, Controller]],
    plants: int,
    simulation: Simulation,
    *,
    longest: float,
    criteria: tuple[Onset, Lost],
    progress: Progress | None,
) -> DelayMargins:
    """Of tunings on so many plants each; every tuning has the same noise on a plant."""
    numbers, (onset, lost) = np.tile(np.arange(plants), len(members) // plants), criteria
    return delay_margins_ensemble(
        members, simulation, longest=longest, onset=onset, lost=lost, numbers=numbers, progress=progress
    )


def plants_of(problem: Problem, known_set: KnownSet, plants: int, seed: int) -> list[Problem]:
    """The case's plant, and others, drawn from its known set and, where the input's gain is unknown, from its interval."""
    random = np.random.default_rng(seed)
    thetas = known_set.drawn(random, plants - 1)
    others = [replace(problem.plant, theta=theta) for theta in thetas]
    if problem.known.gains is not None:
        gains = problem.known.gains.drawn(random, plants - 1)
        others = [_with_gains(plant, gain) for plant, gain in zip(others, gains, strict=True)]
    return [problem, *(replace(problem, plant=plant) for plant in others)]


def _with_gains(plant: Plant, gains: Array) -> Plant:
    paths = tuple(replace(path, gain=float(gain)) for path, gain in zip(plant.paths, gains, strict=True))
    return replace(plant, input=paths if len(paths) > 1 else paths[0])


def _cloud(k: Knobs, found: DelayMargins, scale: float, plants: int) -> Cloud:
    error = np.linalg.norm(found.undelayed.rms_e, axis=1) / scale
    error, onset, loss = (
        values.reshape(-1, plants) for values in (np.where(found.tracks, error, np.nan), found.onset.bears, found.loss.bears)
    )
    return Cloud(scheme=k.scheme, tunings=tuple(k.tunings()), error=error, onset=onset, loss=loss)


def _in_time(progress: Progress | None, forecast: Forecast, part: str) -> Progress | None:
    """Progress of a part, told as the fraction of the time that is over; it never goes back."""
    if progress is None:
        return None
    begun, before, told = time.perf_counter(), sum(forecast.finished.values()), 0.0

    def advanced(fraction: float) -> None:
        nonlocal told
        seconds = time.perf_counter() - begun
        told = max(told, min(1.0, (before + seconds) / forecast.total(part, fraction, seconds)))
        progress(told)

    return advanced
