"""Tracking and robustness over the knobs of each scheme, with the Pareto fronts of all schemes in one plane."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, Progress, part_of
from barbalat.comparison.grids import default_knobs
from barbalat.comparison.plants import parameters_of, plants_of
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.judge.settings import Judge
from barbalat.pictures.plotted import Plotted
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.kernel.costs import steps_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import DelayMargins, delay_margins_ensemble, longest_delay
from barbalat.study.finer_step import PlainRun, delays_confirmed, refined
from barbalat.study.ideal_benchmark import NOISE_SENTENCE, SHORTEST_DELAY_STEPS, Judging
from barbalat.study.reference_motion import REST_SENTENCE, ReferenceMotion
from barbalat.study.resolved import resolved
from barbalat.study.verdicts import Lost
from barbalat.targets import TRADE_OFF, require_continuous_reading
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, kw_only=True)
class Cloud:
    """The tunings of a scheme, with their results.

    tunings  values of K tunings, by setting
    error    (K, P) RMS of |e| over the run without delay, relative to the RMS of |x_m|. It is NaN if the loop does not follow its
             model without a delay: its tail error exceeds the model's motion in every component, or it is lost
    onset    (K, P) the largest added delay before the judge calls the run lost or a limit cycle [s]; 0 if there is none, or if it
             is too short to be simulated
    loss     (K, P) the largest added delay before the loop is lost [s] (see ``Lost``)

    The first of the P plants is the plant of the case. The others are a seeded sample of the known set.
    """

    scheme: str
    tunings: tuple[dict[str, float], ...]
    error: Array
    onset: Array
    loss: Array

    def at(self, which: str, criterion: str) -> tuple[Array, Array]:
        """Return error and margin, each (K,), for the "plant" of the case or for the "worst" plant (which may differ for error
        and margin), by the "onset" or the "loss"."""
        margin = {"onset": self.onset, "loss": self.loss}[criterion]
        if which == "plant":
            return self.error[:, 0], margin[:, 0]
        return self.error.max(axis=1), margin.min(axis=1)  # a NaN among the errors gives NaN

    def front(self, which: str, criterion: str) -> Array:
        """Return the indices of the Pareto front by increasing margin. No other tuning has at least as much margin and less
        error."""
        return pareto_front(*self.at(which, criterion))

    def tolerates(self, which: str, criterion: str, error: float) -> float:
        """Return the largest margin [s] among the tunings with at most this error; NaN if there is no such tuning."""
        errors, margins = self.at(which, criterion)
        good = errors <= error  # false where the error is NaN
        return float(margins[good].max()) if good.any() else float("nan")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TradeOff(Plotted):
    """The clouds of all schemes on one problem.

    by      the judge, and the criterion for losing the commanded motion
    notes   sentences on omissions and on what was not examined
    checks  results of a finer step for some tunings on the fronts of each scheme
    """

    problem: Problem
    simulation: Simulation
    thetas: Array  # (P, p)
    clouds: tuple[Cloud, ...]
    by: Judging
    notes: tuple[str, ...]
    runs: int
    seconds: float
    checks: tuple[FrontCheck, ...] = ()

    @property
    def shortest(self) -> float:
        """The shortest delay tried [s]."""
        return SHORTEST_DELAY_STEPS * self.simulation.resolution

    def __repr__(self) -> str:
        schemes = ", ".join(f"{len(cloud.tunings)} of {cloud.scheme}" for cloud in self.clouds)
        return f"<TradeOff of {self.problem.name!r}: {schemes} on {len(self.thetas)} plants, {self.runs} runs>"

    def plot(self, *, shown: bool = True) -> Figure:
        """Draw the clouds and the front of each scheme, by both criteria, as a Matplotlib figure.

        shown  whether to display the figure at once, if pyplot is in use
        """
        from barbalat.comparison.tradeoff.picture import draw

        return draw(self, shown=shown)


def pareto_front(error: Array, margin: Array) -> Array:
    """Return the indices of the tunings that no other tuning beats in both error and margin, in order of increasing margin. A
    lost tuning is on no front."""
    usable = np.flatnonzero(np.isfinite(error) & (margin > 0))
    order = usable[np.lexsort((-margin[usable], error[usable]))]  # smallest error first; if equal, the larger margin first
    kept: list[int] = []
    for i in order:
        if not kept or margin[i] > margin[kept[-1]]:
            kept.append(int(i))
    return np.array(kept, dtype=int)


def trade_off(
    problem: Problem,
    simulation: Simulation,
    *,
    knobs: tuple[TuningGrid, ...] | None = None,
    density: int = 6,
    own: Sequence[Controller] = (),
    plants: int = 4,
    seed: int = 0,
    longest: float | None = None,
    judge: Judge | None = None,
    lost: Lost | None = None,
    progress: Progress | None = None,
) -> TradeOff:
    """Run every tuning of every scheme on the plant of the case and on ``plants`` - 1 others drawn from the known set.

    knobs     by default the result of ``default_knobs`` with this ``density`` and the controllers of your ``own``
    longest   largest delay tried [s]; by default as in ``delay_margins``
    judge     the criteria for being lost and for a limit cycle; by default derived from the model's motion
    lost      the criterion for losing the commanded motion
    progress  called with the completed fraction of the work

    Raises InputError for a problem without a known set.
    """
    started = time.perf_counter()
    TRADE_OFF.require(problem)
    require_continuous_reading(problem, "use contest with --sample-time S")
    simulation = resolved(problem, own, simulation)
    longest = longest_delay(simulation) if longest is None else longest
    assert problem.uncertainty is not None
    _require_budget(simulation, density, knobs, plants)
    chosen, left_out = default_knobs(problem, simulation, density=density, own=own) if knobs is None else (knobs, ())
    family = plants_of(problem, problem.uncertainty, plants, seed)
    members = {k.scheme: [(p, k.make(**tuning)) for tuning in k.tunings() for p in family] for k in chosen}
    motion, by = ReferenceMotion.of(problem, simulation), Judging(judge or Judge(), lost or Lost())
    found, done, whole = [], 0, sum(map(len, members.values()))
    for k in chosen:
        group = members[k.scheme]
        part = part_of(progress, done / whole, len(group) / whole)
        found.append(_delay_margins(group, plants, simulation, longest=longest, by=by, progress=part))
        done += len(group)
    clouds = tuple(_cloud(k, of_scheme, motion.rms, plants) for k, of_scheme in zip(chosen, found, strict=True))
    _require_motion(clouds)
    checks = _at_finer_step(chosen, clouds, found, problem, simulation, longest, by)
    return TradeOff(
        problem=problem,
        simulation=simulation,
        thetas=np.stack([p.plant.theta if p.simulated is None else parameters_of(p) for p in family]),
        clouds=clouds,
        by=by,
        notes=(*left_out, *_notes(problem, clouds, motion), *(one.sentence for one in checks)),
        checks=checks,
        runs=sum(of_scheme.runs for of_scheme in found),
        seconds=time.perf_counter() - started,
    )


FRONT_CHECKED = 4
"""Number of tunings of each front that are repeated, evenly spread from end to end."""


@dataclass(frozen=True, kw_only=True)
class FrontCheck:
    """Some tunings on the fronts of a scheme for the plant of the case, repeated with the ``refined`` simulation.

    tunings    their indices in the cloud
    changed    tunings whose results change with the finer step, and the changes
    unsettled  tunings that leave the stability region of the solver even with the finer step, so nothing is decided
    """

    scheme: str
    simulation: Simulation
    tunings: tuple[int, ...]
    changed: dict[int, tuple[str, ...]]
    unsettled: tuple[int, ...]

    @property
    def sentence(self) -> str:
        """The finding as a sentence."""
        count = validate.counted(len(self.tunings), "tuning")
        again = f"{self.scheme}: repeating {count} on the fronts of the plant of the case at {self.simulation.step}"
        if not self.tunings:
            return f"{self.scheme}: no tuning lies on a front of the plant of the case, and none was repeated at a finer step"
        said = f"{again} changes no result"
        if self.changed:
            first = next(iter(self.changed.values()))
            change = f"{again} changes {validate.counted(len(self.changed), 'result')}"
            said = f"{change} (such as: {first[0]}); make {self.simulation.refined_by} smaller"
        if self.unsettled:
            said += (
                f"; for {len(self.unsettled)} of them the finer run also leaves the solver's region of stability and settles "
                f"nothing"
            )
        return said

    def as_json(self) -> dict[str, Any]:
        return {
            **self.simulation.step_as_json(),
            "tunings": list(self.tunings),
            "changed": {str(i): list(said) for i, said in self.changed.items()},
            "unsettled": list(self.unsettled),
            "sentence": self.sentence,
        }


def _at_finer_step(
    chosen: tuple[TuningGrid, ...],
    clouds: tuple[Cloud, ...],
    found: list[DelayMargins],
    problem: Problem,
    simulation: Simulation,
    longest: float,
    by: Judging,
) -> tuple[FrontCheck, ...]:
    """Repeat a few tunings from the fronts of each scheme with a finer step, for the tolerated delays and the behaviour without a
    delay."""
    checks = []
    for k, cloud, of_scheme in zip(chosen, clouds, found, strict=True):
        which = _spread_over_fronts(cloud)
        members = [(problem, k.make(**cloud.tunings[i])) for i in which]
        changed: dict[int, tuple[str, ...]] = {}
        plain = [PlainRun.of(*member, simulation, by.judge) for member in members]
        if members:
            plants = len(of_scheme.tracks) // len(cloud.tunings)
            own = of_scheme.of(np.array(which) * plants)
            numbers = np.zeros(len(members), dtype=int)
            said = delays_confirmed(members, simulation, own, numbers=numbers, longest=longest, by=by)
            changed = {i: one.changes for i, one, run in zip(which, said, plain, strict=True) if one.changes and run.settles}
        checks.append(
            FrontCheck(
                scheme=cloud.scheme,
                simulation=refined(simulation),
                tunings=tuple(which),
                changed=changed,
                unsettled=tuple(i for i, run in zip(which, plain, strict=True) if not run.settles),
            )
        )
    return tuple(checks)


def _spread_over_fronts(cloud: Cloud) -> list[int]:
    """Return the indices of a few tunings of both fronts on the plant of the case."""
    kept: set[int] = set()
    for criterion in ("onset", "loss"):
        front = cloud.front("plant", criterion)
        if len(front):
            places = np.linspace(0, len(front) - 1, min(FRONT_CHECKED, len(front))).round().astype(int)
            kept |= {int(front[i]) for i in places}
    return sorted(kept)


def _require_motion(clouds: tuple[Cloud, ...]) -> None:
    """Raise InputError if the command causes no motion to show."""
    if not any(np.isfinite(cloud.error).any() for cloud in clouds):
        tried = ", ".join(f"{len(cloud.tunings)} of {cloud.scheme}" for cloud in clouds)
        raise InputError(
            f"none of the tunings that were tried ({tried}) tracks the model even without a delay: in the last quarter |e| "
            f"stays above the largest |x_m|, or the run diverges"
        )


def _notes(problem: Problem, clouds: tuple[Cloud, ...], motion: ReferenceMotion) -> list[str]:
    """Return sentences on what the plot does not show."""
    said = [
        f"no tuning of {cloud.scheme} tracks its model without a delay on the plant of the case"
        for cloud in clouds
        if not np.isfinite(cloud.error[:, 0]).any()
    ]
    if problem.noise is not None:
        said.append(NOISE_SENTENCE)
    if motion.comes_to_rest:
        said.append(REST_SENTENCE)
    return said


RUNS_EACH = 16.5
"""Number of simulations per member, measured on Section V. Many members are lost early in the scan, and bisections follow."""
TUNINGS_EACH_DENSITY = 6.5
"""Number of tunings of all schemes, divided by the square of the density. Section V has 932 tunings with a density of 12."""
STEP_SECONDS = 1e-8
"""Seconds per step of a member; 3 ns for a small loop."""
TUNING = Estimate(memory=2000.0, seconds=3e-4)
"""Seconds for a tuning on a plant, in addition to its runs."""


def _require_budget(simulation: Simulation, density: int, knobs: tuple[TuningGrid, ...] | None, plants: int) -> None:
    """Raise InputError if the tunings, or the plants on which they run, exceed the budget, before either is generated."""
    each = TUNING + Estimate(seconds=RUNS_EACH * steps_of(simulation) * STEP_SECONDS)
    given = None if knobs is None else sum(prod(len(values) for values in one.values.values()) for one in knobs)

    def cost(count: float, values: float) -> Estimate:
        return each.times(count * (TUNINGS_EACH_DENSITY * values**2 if given is None else given))

    validate.whole("plants", plants, least=1)
    validate.whole("density", density, least=2)
    budget.require("plants", plants, lambda n: cost(n, 2))
    budget.require("density", density, lambda n: cost(plants, n), least=2, what="the trade-off")


def _delay_margins(
    members: list[tuple[Problem, Controller]],
    plants: int,
    simulation: Simulation,
    *,
    longest: float,
    by: Judging,
    progress: Progress | None,
) -> DelayMargins:
    """Return the margins of tunings on several plants each. On a given plant, every tuning has the same noise."""
    numbers = np.tile(np.arange(plants), len(members) // plants)
    return delay_margins_ensemble(
        members, simulation, longest=longest, judge=by.judge, lost=by.lost, numbers=numbers, progress=progress
    )


def _cloud(k: TuningGrid, found: DelayMargins, scale: float, plants: int) -> Cloud:
    error = np.linalg.norm(found.undelayed.rms_e, axis=1) / scale
    error, onset, loss = (
        values.reshape(-1, plants)
        for values in (np.where(found.tracks, error, np.nan), found.onset.tolerates, found.loss.tolerates)
    )
    return Cloud(scheme=k.scheme, tunings=tuple(k.tunings()), error=error, onset=onset, loss=loss)
