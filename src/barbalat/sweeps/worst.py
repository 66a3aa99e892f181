"""The least and the largest value of a metric over a set of numbers, searched by gradients from many starts.

Every value belongs to a run of a member of the set. It is not proven that no other member is worse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.gradients.neighbourhood import Movable, Neighbourhood, NoSlope, in_steps, varied_of
from barbalat.gradients.sensitivity import TANGENT_MEMBERS, chosen, require_figures
from barbalat.open_numbers.members import Setting
from barbalat.open_numbers.path import FieldPath, by_index
from barbalat.open_numbers.truth_paths import is_of_the_design
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.tangent_run import TangentRun, run_tangents
from barbalat.run.kernel import costs
from barbalat.run.kernel.members import Members
from barbalat.sweeps.bounds import Bounds
from barbalat.sweeps.known_set_draws import BETWEEN, KNOWN_SET, sampled
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.spread import Axis, CutNormal, Distribution, InBall, LogUniform, Normal, Uniform
from barbalat.sweeps.study import Study
from barbalat.validate import Array, InputError

STARTS = 64
"""Default number of points from which the search chooses its starts, in addition to vertices and the middle."""
MOST_VERTICES = 64
"""Largest number of vertices that are tried; if there are more, this many are drawn."""
FOLLOWED = 4
"""Number of starts from which each search follows gradients: the best points so far."""
APART = 0.15
"""Smallest distance between starts in at least one coordinate, as a fraction of its range, so that they lie in different
valleys."""
ROUNDS = 12
"""Largest number of gradients from each start."""
REFINED, PATIENCE, ELITES, DRAWN = 16, 2, 12, 5
"""Number of rounds in which each search then draws points, and number of rounds without a gain after which it ends. It draws them
(DRAWN for each number) from the normal distribution of the ELITES best points so far. These rounds need no slopes and can follow
narrow valleys that gradients cross."""
MOVES = (2.0, 0.3, 0.05, 0.005)
"""Steps along a gradient, as fractions of the width of the set in the steepest direction; all are tried at once."""
GAIN = 1e-4
"""Relative gain below which the steps are shortened."""
WIDE = 4.0
"""Ratio of the ends of a range of positive numbers above which the steps of differences are relative to each value."""
SHORTENED, SHORTEST = 0.05, 1e-3
"""The factor by which steps are shortened, and the factor below which a search has ended."""
NO_PROOF = "the worst that was found; no proof"


@dataclass(frozen=True, eq=False)
class SearchedSet:
    """A box, or a product of intervals and balls, in coordinates z from 0 to 1.

    low, high    (d,) ends of each number
    logarithmic  (d,) whether z is uniform in the logarithm
    balls        columns whose coordinates z are limited to the ball in the unit cube
    """

    low: Array
    high: Array
    logarithmic: Array
    balls: tuple[tuple[int, ...], ...] = ()

    @classmethod
    def of(cls, given: Sequence[tuple[FieldPath, Axis | Distribution]]) -> SearchedSet:
        """Raise InputError for a distribution without ends."""
        ends, log, balls = [], [], dict[tuple[Any, ...], list[int]]()
        for i, (path, one) in enumerate(given):
            if isinstance(one, Axis):
                ends.append((min(one.start, one.stop), max(one.start, one.stop)))
            elif isinstance(one, (Uniform, LogUniform, CutNormal)):
                ends.append((one.low, one.high))
            elif isinstance(one, InBall):
                middle = one.center[one.place]
                ends.append((middle - one.radius, middle + one.radius))
                balls.setdefault((path.vector, one.center, one.radius), []).append(i)
            else:
                what = "a normal distribution" if isinstance(one, Normal) else "this distribution"
                raise InputError(f"{path}: a search for the worst member needs a range, but {what} has no ends")
            if ends[-1][0] == ends[-1][1]:
                raise InputError(f"{path}: a search for the worst member needs a range, got {ends[-1][0]:g} alone")
            log.append(isinstance(one, LogUniform) or (isinstance(one, Axis) and one.logarithmic))
        low, high = np.array(ends).T
        return cls(low, high, np.array(log), tuple(map(tuple, balls.values())))

    @property
    def decades(self) -> Array:
        """(d,) whether a number varies over so wide a range that steps are relative to its value."""
        return self.logarithmic | ((self.low > 0) & (self.high > WIDE * self.low))

    def numbers(self, z: Array) -> Array:
        """(M, d) the numbers at coordinates (M, d)."""
        linear = self.low + (self.high - self.low) * z
        with np.errstate(divide="ignore", invalid="ignore"):
            log = np.exp(np.log(self.low) + (np.log(self.high) - np.log(self.low)) * z)
        return np.asarray(np.clip(np.where(self.logarithmic, log, linear), self.low, self.high))

    def slopes(self, z: Array) -> Array:
        """(M, d) derivatives of the numbers with respect to the coordinates."""
        with np.errstate(divide="ignore", invalid="ignore"):
            log = self.numbers(z) * np.log(self.high / self.low)
        return np.asarray(np.where(self.logarithmic, log, self.high - self.low))

    def inside(self, z: Array) -> Array:
        """The nearest coordinates in the set."""
        z = np.clip(z, 0.0, 1.0)
        for ball in self.balls:
            part = z[:, ball] - 0.5
            size = np.linalg.norm(part, axis=1, keepdims=True)
            z[:, ball] = 0.5 + part * np.minimum(1.0, IN_A_BALL * 0.5 / np.maximum(size, 1e-300))
        return z

    def first(self, starts: int, seed: int) -> Array:
        """(M, d) the middle, vertices, and points of a Sobol sequence."""
        from scipy.stats.qmc import Sobol

        d, rng = len(self.low), np.random.default_rng(seed)
        vertices = (
            np.array(list(product((0.0, 1.0), repeat=d))) if 2**d <= MOST_VERTICES else rng.integers(0, 2, (MOST_VERTICES, d))
        )
        spread = Sobol(d, rng=rng).random_base2(max(starts - 1, 0).bit_length())[:starts]
        return self.inside(np.vstack([np.full((1, d), 0.5), vertices.astype(float), spread]))


IN_A_BALL = 1 - 2.0**-40
"""Fraction of the radius of a ball to which points are limited, so that they stay inside despite rounding."""


@dataclass(frozen=True, kw_only=True)
class Member:
    """A member of the set with the value of a metric.

    value      None if the run diverges
    numbers    by path
    half_step  the value with half the solver step, which shows whether the step resolves it
    """

    value: float | None
    numbers: Mapping[str, float]
    half_step: float | None

    def as_json(self) -> dict[str, Any]:
        return dict(vars(self))


@dataclass(frozen=True, kw_only=True)
class Extremes:
    """The least and the largest value of a metric of a controller that a search has found over the set.

    bound  the guaranteed bound on |e| for the member with the largest value; None without a bound, or for a different metric
    """

    controller: str
    figure: str
    least: Member
    largest: Member
    bound: float | None

    def as_json(self) -> dict[str, Any]:
        return {**vars(self), "least": self.least.as_json(), "largest": self.largest.as_json()}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstFound:
    """What a search over a set has found, which is no proof that nothing worse exists.

    ranges     the ends of each number, by path
    runs       numbers of runs without and with gradients, over all controllers
    undefined  number of gradients that do not exist or overflow, as at a corner or where the run is too sensitive
    steps      for a case with a tolerance, how the fixed steps of the runs were found
    """

    case: str
    controllers: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    extremes: tuple[Extremes, ...]
    runs: int
    gradients: int
    undefined: int
    steps: str | None = None

    def __repr__(self) -> str:
        return f"<WorstFound {self.case!r}: {validate.counted(len(self.extremes), 'figure')} over {', '.join(self.ranges)}>"

    def as_json(self) -> dict[str, Any]:
        """The document of ``sweep --worst --json``."""
        return {
            "case": self.case,
            "controllers": list(self.controllers),
            "claim": NO_PROOF,
            "ranges": {path: list(ends) for path, ends in self.ranges.items()},
            "worst": [one.as_json() for one in self.extremes],
            "runs": self.runs,
            "gradients": self.gradients,
            "undefined_gradients": self.undefined,
            "steps": self.steps,
        }


def find_worst(
    case: str | Path | Case,
    figures: Sequence[str],
    *,
    vary: Mapping[str, str | Axis] | None = None,
    sample: Mapping[str, str | Distribution] | None = None,
    starts: int = STARTS,
    seed: int = 0,
    redesign: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> WorstFound:
    """Search for the least and the largest value of metrics over a set, by gradients from many starts and from vertices.

    case     as in ``sweep``. ``vary`` and ``sample`` give the ranges; their counts and densities have no effect. By default the
             search covers the known set of the case: the ranges of its parameters, or else those of theta and of the input gain
    figures  as in ``sensitivity``
    starts   number of points from which the best starts are chosen

    Raises InputError, among others for a number that changes a signal or the structure; vary such a number in a sweep.
    """
    source = case if isinstance(case, Case) else CaseText.read(case)
    labels = (source if isinstance(source, Case) else source.case()).problem.labels
    axes = [
        (FieldPath.parse(by_index(path, labels)), one if isinstance(one, Axis) else Axis.parse(one))
        for path, one in (vary or {}).items()
    ]
    draws = sampled(source, list((sample or {}).items()))
    return search_worst(
        source, figures, [*axes, *draws.items()], starts=starts, seed=seed, redesign=redesign, threads=threads, progress=progress
    )


def search_worst(
    source: CaseText | Case,
    figures: Sequence[str],
    given: Sequence[tuple[FieldPath, Axis | Distribution]],
    *,
    starts: int = STARTS,
    seed: int = 0,
    redesign: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> WorstFound:
    """Run the search for a case that has been read (see ``find_worst``)."""
    validate.whole("starts", starts, least=1, most=2**16)
    given = list(given) or known_set_of(source, redesign=redesign)
    region = SearchedSet.of(given)
    axes = {
        path: Axis(float(low), float(high), 3, bool(log))
        for (path, _), low, high, log in zip(given, region.low, region.high, region.logarithmic, strict=True)
    }
    paths = [path for path, _ in given]
    source, steps = in_steps(source, (source if isinstance(source, Case) else source.case()).controllers)
    draws: dict[FieldPath, Distribution] = {path: Uniform(one.start, one.stop) for path, one in axes.items()}
    study = Study(varied_of(source, paths, redesign=redesign), Plan({}, draws, 1, Design.RANDOM, seed))
    for path, kind in zip(paths, study.kinds, strict=True):
        if not kind.is_number:
            raise InputError(f"{path} changes a signal or the structure, which a search does not cover: vary it in a sweep")
    named = [by_index(one, study.example.problem.labels) for one in figures]
    require_figures(named, study.example)
    search = _Search(study, region, named, threads)
    search.require(starts)
    names, found = study.controllers, list[Extremes]()
    bounds = Bounds(study)
    for i in range(len(names)):
        told = part_of(progress, i / len(names), 1 / len(names))
        found += search.extremes(i, bounds, region.first(starts, seed), told)
    return WorstFound(
        case=study.example.name,
        controllers=names,
        ranges={str(path): (float(a), float(b)) for path, a, b in zip(paths, region.low, region.high, strict=True)},
        extremes=tuple(found),
        runs=search.runs,
        gradients=search.gradients,
        undefined=search.undefined,
        steps=steps,
    )


def known_set_of(source: CaseText | Case, *, redesign: bool) -> list[tuple[FieldPath, Axis | Distribution]]:
    """The ranges of the case's parameters, or else its known set of theta and of the input gain, as far as the simulated plant
    depends on them; raises InputError if there are none."""
    case = source if isinstance(source, Case) else source.case()
    problem = case.problem
    found: dict[FieldPath, Distribution] = {}
    why = "the case has neither a known set nor parameters with ranges: give --sample or --vary"
    if isinstance(problem, Problem):
        physical, own = problem.plant.physical, "numbers of [truth], such as --sample truth.A[0][0]=uniform:-2:-1"
        if physical is not None and any(not one.is_exact for one in physical.parameters):
            ranges = sampled(source, [("parameters", BETWEEN)])
            found |= {path: one for path, one in ranges.items() if redesign or not is_of_the_design(problem, path)}
            names = " or ".join(str(path.keys[-1]) for path in ranges)
            why = f"no formula of the simulated plant contains {names}: give --redesign to vary the design, or ranges for {own}"
        elif problem.uncertainty is not None and problem.truth is not None and problem.truth.A is not None:
            why = (
                f"the known set of theta does not describe the simulated plant, whose A is that of [truth]: give ranges for {own}"
            )
        elif problem.uncertainty is not None:
            found |= sampled(source, [("plant.theta", KNOWN_SET)])
        gains = problem.known.gains
        if gains is not None and gains.size == 1 and gains.lower[0] < gains.upper[0]:
            found |= sampled(source, [("plant.input.gain", KNOWN_SET)])
    if not found:
        raise InputError(why)
    return list(found.items())


class _Search:
    """Searches over one set; ``runs``, ``gradients`` and ``undefined`` are counters."""

    def __init__(self, study: Study, region: SearchedSet, figures: Sequence[str], threads: int | None) -> None:
        self.study, self.region, self.given, self.threads = study, region, figures, threads
        self.runs = self.gradients = self.undefined = 0
        self.seen: list[tuple[Array, dict[str, Array]]] = []
        setting = Setting.of(study.varied, study.kinds, study.tried, study.tried.middle)
        middle = region.numbers(np.full((1, len(region.low)), 0.5))[0]
        moved = [
            Movable(path=path, value=float(value), scale=float(width), kind=kind, relative=bool(log))
            for path, value, width, kind, log in zip(
                study.varied.paths, middle, region.high - region.low, study.kinds, region.decades, strict=True
            )
        ]
        self.near = Neighbourhood(study.varied, tuple(moved), setting, study.tried.middle)

    def require(self, starts: int) -> None:
        """Raise InputError for a search that exceeds the budget."""
        loops = [family.reader.loop for family in self.near.setting.families]
        width, steps = len(self.region.low), self.near.setting.simulation.steps

        def cost(numbers: float) -> budget.Estimate:
            each = 2 * len(self.given) * (FOLLOWED * ROUNDS * (len(MOVES) + TANGENT_MEMBERS * width) + REFINED * DRAWN * width)
            return costs.of_members(loops, steps, numbers + MOST_VERTICES + each)

        budget.require("starts", starts, cost, what="a search for the worst member")

    def _members(self, place: int, z: Array) -> tuple[Members, Array]:
        rows = self.region.numbers(z)
        numbers = self.near.setting.numbers(rows)[place]
        return self.near.setting.families[place].given(numbers, np.zeros(len(rows), dtype=int)), rows

    def _run(self, place: int, z: Array) -> TangentRun:
        """The runs at coordinates (M, d)."""
        self.runs += len(z)
        found = run_tangents(self._members(place, z)[0], self.near.setting.signals, threads=self.threads)
        self.seen.append((z, found.values))
        return found

    def _slopes(self, place: int, z: Array, figures: Sequence[str], rng: np.random.Generator) -> Array:
        """(M, d) the derivative of each member's metric with respect to the coordinates; a random direction where there is
        none."""
        members, rows = self._members(place, z)
        try:
            directions = self.near.directions(rows, np.array([self.region.low, self.region.high]))[place]
        except NoSlope:
            if len(z) == 1:
                self.undefined += 1
                return rng.normal(size=z.shape)
            return np.vstack([self._slopes(place, one[None], [figure], rng) for one, figure in zip(z, figures, strict=True)])
        self.gradients += len(z)
        run = run_tangents(members, self.near.setting.signals, directions, threads=self.threads)
        found = np.array([run.tangents[figure][:, m] for m, figure in enumerate(figures)]) * self.region.slopes(z)
        lost = ~np.isfinite(found).all(axis=1)
        self.undefined += int(lost.sum())
        found[lost] = rng.normal(size=(int(lost.sum()), z.shape[1]))
        return np.asarray(found)

    def extremes(self, place: int, bounds: Bounds, first: Array, progress: Progress | None) -> Iterator[Extremes]:
        """The least and the largest value of each metric."""
        rng = np.random.default_rng(place)
        self.seen = []
        begun = self._run(place, first)
        figures = chosen(self.given, begun.values)
        searches = [(figure, sign) for figure in figures for sign in (-1.0, 1.0)]
        z, worth, of = [], [], []
        for figure, sign in searches:
            value = _worth(begun.values[figure], sign)
            best = _apart(first, np.argsort(-value, kind="stable"))
            z.append(first[best])
            worth.append(value[best])
            of += [(figure, sign)] * len(best)
        points, values = np.vstack(z), np.concatenate(worth)
        scales = np.where(np.isfinite(values), 1.0, 0.0)  # factor of the steps; 0 for a search that has ended
        for k in range(ROUNDS):
            if progress is not None:
                progress((k + 1) / (ROUNDS + REFINED + 1))
            if not scales.any():
                break
            self._advance(place, points, values, scales, of, rng)
        self._refine(
            place, searches, rng, part_of(progress, (ROUNDS + 1) / (ROUNDS + REFINED + 1), REFINED / (ROUNDS + REFINED + 1))
        )
        for i in range(0, len(searches), 2):
            least, largest = (self._best(place, *searches[j]) for j in (i, i + 1))
            yield self._found(place, searches[i][0], least, largest, bounds)

    def _advance(
        self, place: int, points: Array, values: Array, scales: Array, of: Sequence[tuple[str, float]], rng: np.random.Generator
    ) -> None:
        """Move each point along its gradient to the best of several steps; the arrays are modified."""
        which = np.flatnonzero(scales).tolist()
        signs = np.array([of[i][1] for i in which])[:, None]
        slopes = signs * self._slopes(place, points[which], [of[i][0] for i in which], rng)
        blocked = ((points[which] <= 0) & (slopes < 0)) | ((points[which] >= 1) & (slopes > 0))
        slopes = np.where(blocked, 0.0, slopes)
        size = np.abs(slopes).max(axis=1, keepdims=True)
        unit = scales[which, None] * slopes / np.where(size > 0, size, 1.0)
        tried = np.array([self.region.inside(points[which] + move * unit) for move in MOVES])  # (moves, points, d)
        run = self._run(place, tried.reshape(-1, points.shape[1]))
        for k, i in enumerate(which):
            figure, sign = of[i]
            found = _worth(run.values[figure].reshape(len(MOVES), -1)[:, k], sign)
            best = int(found.argmax())
            if not found[best] > values[i] + GAIN * abs(values[i]):
                scales[i] = SHORTENED * scales[i] if scales[i] * SHORTENED >= SHORTEST and unit[k].any() else 0.0
            if found[best] > values[i]:
                points[i], values[i] = tried[best, k], found[best]
            if not isfinite(values[i]):
                scales[i] = 0.0

    def _ranked(self, figure: str, sign: float) -> tuple[Array, Array]:
        """The points so far, the best first, and their worth."""
        points = np.vstack([z for z, _ in self.seen])
        worth = _worth(np.concatenate([values[figure] for _, values in self.seen]), sign)
        best = np.argsort(-worth, kind="stable")
        return points[best], worth[best]

    def _refine(
        self, place: int, searches: Sequence[tuple[str, float]], rng: np.random.Generator, progress: Progress | None
    ) -> None:
        """Draw further points for each search, until PATIENCE rounds in succession gain nothing."""
        left = dict.fromkeys(searches, PATIENCE)
        for k in range(REFINED):
            going = [one for one in searches if left[one] > 0]
            if not going:
                return
            if progress is not None:
                progress((k + 1) / (REFINED + 1))
            before = {one: float(self._ranked(*one)[1][0]) for one in going}
            self._run(place, np.vstack([self._drawn(*one, rng) for one in going]))
            for one in going:
                gained = float(self._ranked(*one)[1][0]) > before[one] + GAIN * abs(before[one])
                left[one] = PATIENCE if gained else left[one] - 1

    def _drawn(self, figure: str, sign: float, rng: np.random.Generator) -> Array:
        """(DRAWN d, d) points of the normal distribution of the best points so far, around the best one."""
        points, _ = self._ranked(figure, sign)
        best, rest = points[0], points[:ELITES] - points[0]
        factors = rng.normal(size=(DRAWN * rest.shape[1], len(rest))) / np.sqrt(
            len(rest)
        )  # their products have the covariance of the elites
        return self.region.inside(best + factors @ rest)

    def _best(self, place: int, figure: str, sign: float) -> tuple[Array, Member]:
        points, worth = self._ranked(figure, sign)
        row = self.region.numbers(points[:1])[0]
        value = float(sign * worth[0])
        return row, Member(
            value=value if isfinite(value) else None,
            numbers={str(path): float(one) for path, one in zip(self.study.varied.paths, row, strict=True)},
            half_step=self._with_half_step(place, row, figure),
        )

    def _with_half_step(self, place: int, row: Array, figure: str) -> float | None:
        case = self.study.varied.at(row)
        simulation = replace(case.simulation, dt=case.simulation.dt / 2)
        batch = Batch.of([(case.problem, case.controllers[place])], simulation)
        run([batch], case.problem.signals, simulation, threads=self.threads)
        value = float(batch.metrics(simulation).columns()[figure][0])
        return value if isfinite(value) else None

    def _found(
        self, place: int, figure: str, least: tuple[Array, Member], largest: tuple[Array, Member], bounds: Bounds
    ) -> Extremes:
        name, bound = self.study.controllers[place], float("nan")
        if figure.startswith("max_abs_e"):
            bound = float(bounds.of(largest[0][None])[name][0])
        return Extremes(
            controller=name, figure=figure, least=least[1], largest=largest[1], bound=bound if isfinite(bound) else None
        )


def _apart(points: Array, order: Array) -> list[int]:
    """The first points, in this order, that are apart from each other, followed by the first of the others if they are too
    few."""
    chosen: list[int] = []
    for i in order.tolist():
        if len(chosen) < FOLLOWED and all(np.abs(points[i] - points[j]).max() >= APART for j in chosen):
            chosen.append(i)
    return (chosen + [i for i in order.tolist() if i not in chosen])[:FOLLOWED]


def _worth(values: Array, sign: float) -> Array:
    """The values for a search of a maximum. A diverging run counts as the largest value and never as the least."""
    return np.where(np.isnan(values), sign * inf, sign * values) if sign > 0 else np.where(np.isnan(values), -inf, -values)
