"""The tried tunings and their results. The cheapest quantity is evaluated first, and each tuning is evaluated only as far as
necessary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from barbalat.cases.build import Case
from barbalat.certificates.certify import certify
from barbalat.comparison.ranges import Space
from barbalat.comparison.search.aim import Aim, Plants, StepCheck, Trial
from barbalat.comparison.search.probing import Probing
from barbalat.comparison.search.quantity import PROBES, Constraint, Origin, TunedQuantity
from barbalat.comparison.search.search import BROKEN_CONSTRAINT_SCORE, Judged
from barbalat.open_numbers.probe import Tried, kinds_of
from barbalat.open_numbers.varied import Varied
from barbalat.problem.modelling_error import ModellingError
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.solvers.simulation import Simulation
from barbalat.study.finer_step import PlainRun, different, finer, refined
from barbalat.study.ideal_benchmark import Judging, Undelayed
from barbalat.study.verdicts import Member
from barbalat.validate import Array, InputError


@dataclass(frozen=True, kw_only=True)
class Looking:
    """How completely tunings are evaluated.

    fully   whether modelling errors larger than required are also tried
    graded  whether the tolerated size of a tuning that does not tolerate the requirement is found
    below   whether tunings that tolerate the requirement are also tried with smaller errors
    each    whether every plant is evaluated, whatever the results for the others
    """

    fully: bool = False
    graded: bool = True
    below: bool = True
    each: bool = False


def in_one_kernel(varied: Varied, space: Space) -> bool:
    """Return whether tunings differ only in numbers of the kernel and can therefore run together."""
    ends = tuple(np.array([one.low, one.high]) for one in space.ranges.values())
    middle = space.rows(np.full((1, len(space)), 0.5))[0]
    return all(kind.is_number for kind in kinds_of(varied, Tried(middle, ends)))


@dataclass(eq=False)
class Trials:
    """The tried tunings of one controller of a case.

    together  whether the tunings run together
    shared    the plants, if the tuned settings change none of them
    check     the simulation with which a chosen tuning is repeated; by default the ``refined`` one of its case
    """

    varied: Varied
    controller: int
    aim: Aim
    together: bool
    shared: Plants | None
    threads: int | None = None
    check: Simulation | None = None
    all: list[Trial] = field(default_factory=list)
    runs: int = 0

    def scoring(self, space: Space) -> Judged:
        """Return a function that scores tunings at points of the space, from 0 to 1 in each number."""
        return lambda points, to_beat: np.array([trial.score for trial in self.judged(space.rows(points), to_beat)])

    def judged(self, rows: Array, to_beat: float) -> list[Trial]:
        """Return the trials of these tunings. A tuning whose quantity is above ``to_beat`` is not evaluated further."""
        trials = [self._made(row) for row in rows]
        open_ones = [trial for trial in trials if trial.case is not None]
        for stage, origin in enumerate(Origin):
            if open_ones and self._asked(origin):
                self._look(open_ones, origin, Looking(graded=to_beat >= BROKEN_CONSTRAINT_SCORE, below=False))
                open_ones = [trial for trial in open_ones if self._goes_on(trial, stage, to_beat)]
        open_ones = self._verified(open_ones, to_beat)
        for trial in open_ones:
            assert trial.value is not None
            trial.complete, trial.score = True, self.aim.signed(trial.value)
        self.all += trials
        return trials

    def _verified(self, trials: Sequence[Trial], to_beat: float) -> list[Trial]:
        """Return the trials without those that would be the best so far but are lost with smaller errors than they must
        tolerate."""
        scores = [trial.score for trial in self.all if trial.complete]
        least = min(scores, default=np.inf)
        better = [trial for trial in trials if trial.value is not None and self.aim.signed(trial.value) < least]
        if better and self._asked(Origin.PROBE):
            self._look(better, Origin.PROBE, Looking(graded=False))
        return [trial for trial in trials if trial not in better or self._goes_on(trial, len(Origin) - 1, to_beat)]

    def whole(self, row: Array, case: Case | None = None) -> Trial:
        """Evaluate one tuning completely, whatever it violates. Its case may be given."""
        trial = self._made(row) if case is None else Trial(row, case)
        if trial.case is not None:
            for origin in Origin:
                if self._asked(origin):
                    self._look([trial], origin, Looking(fully=True))
            trial.complete = True
        return trial

    def measure(self, trials: Sequence[Trial], constraint: Constraint) -> None:
        """Evaluate the quantity of a constraint completely for earlier trials, including certificates and delays beyond the
        required one."""
        if constraint.quantity.origin is Origin.CERTIFICATE:
            for trial in trials:
                self._certify(trial)
            return
        for group in self._groups(trials):
            values = self._values(constraint.quantity, group, constraint.requirement.limit, Looking(fully=True))
            for trial, value in zip(group, constraint.quantity.over_plants(values, self.aim.quantile), strict=True):
                trial.found[constraint] = float(value)

    def measured_delay(self, trial: Trial) -> float:
        """Return the delay [s] that a tuning tolerates in simulation, on the plant that tolerates the least."""
        quantity = TunedQuantity("delay_margin_measured", larger_is_worse=False)
        return float(self._values(quantity, [trial], None, Looking(fully=True)).min())

    def on_other_plants(self, case: Case, plants: Plants, quantity: TunedQuantity, limit: float | None) -> Array:
        """Return a quantity of a case on these plants (P,)."""
        others = replace(self, shared=plants, all=[], runs=0)
        trial = Trial(np.zeros(0), case)
        others._run([trial])
        found = others._values(quantity, [trial], limit, Looking(each=True))[0]
        self.runs += others.runs
        return np.asarray(found)

    def at_finer_step(self, trial: Trial) -> StepCheck:
        """Return the metrics and requirements of a fully evaluated tuning with the ``refined`` simulation, or with ``check``.

        If ``check`` cannot be used with the controller, the refined simulation is used, and the result says why.
        """
        own = _case(trial).simulation
        if self.check is None:
            return self._checked(trial, refined(own), finer(own))
        try:
            return self._checked(trial, self.check, self.check.step)
        except InputError as error:
            found = self._checked(trial, refined(own), finer(own))
            return replace(found, instead=f"it is not repeated at {self.check.step}: {error}")

    def _checked(self, trial: Trial, simulation: Simulation, how: str) -> StepCheck:
        """Re-evaluate a candidate tuning with this simulation. Certificates involve no simulation and stay the same."""
        given = _case(trial)
        case, aim = replace(given, simulation=simulation), self.aim
        asked: list[Asked] = [(one.quantity, one, one.requirement.limit, SAME_SHARE) for one in aim.constraints]
        if aim.quantity.origin is Origin.PROBE and trial.value is not None and trial.value > PROBES[aim.quantity.name].none:
            asked.append((aim.quantity, None, trial.value, EQUAL_FIGURES_SHARE))
        sizes: dict[ModellingError, list[float]] = {}
        for quantity, _, limit, less in asked:
            for error in quantity.errors:
                sizes.setdefault(error, []).append((1 - less) * (limit - PROBES[quantity.name].none))
        tried = {error: np.unique(found) for error, found in sizes.items()}
        problems = self.shared.problems if self.shared else aim.family(given)
        others = replace(self, shared=Plants.of(case, aim, problems, tried), all=[], runs=0)
        found = others._again(Trial(trial.row, case), trial, asked)
        self.runs += others.runs
        plain = PlainRun.of(problems[0], given.controllers[self.controller], given.simulation, given.judge)
        return StepCheck(
            simulation=simulation, how=how, value=found.value, broken=tuple(found.broken), changed=tuple(found.changed),
            plain=plain,
        )  # fmt: skip

    def _again(self, finer: Trial, trial: Trial, asked: Sequence[Asked]) -> _Again:
        """Return the runs of ``finer``, a tuning at a finer step, and their consequences for ``trial``."""
        found, at = _Again(None, [], []), f"at {_case(finer).simulation.step}"
        self._run([finer])
        if self.aim.quantity.origin is Origin.RUN:
            found.value = self._over_plants(self.aim.quantity, finer, None)
            if trial.value is not None and different(trial.value, found.value):
                found.changed.append(f"{at} {self.aim.quantity.name} is {found.value:.4g} instead of {trial.value:.4g}")
        for quantity, one, limit, less in asked:
            if quantity.origin is Origin.RUN:
                value = self._over_plants(quantity, finer, limit)
                if one is not None and not one.holds(value) and not abs(value - limit) <= less * abs(limit):
                    found.broken.append(f"{at} {quantity.name} is {value:.4g}, which violates {one.requirement}")
            elif quantity.origin is Origin.PROBE:
                none = PROBES[quantity.name].none
                size = none + (1 - less) * (limit - none)
                if self._over_plants(quantity, finer, size) < size:
                    said = f"{at} {quantity.name} is less than {size:.4g}"
                    found.changed += [said] if one is None else []
                    found.broken += [] if one is None else [f"{said}, which violates {one.requirement}"]
        return found

    def _over_plants(self, quantity: TunedQuantity, trial: Trial, asked: float | None) -> float:
        """Return a quantity of one tuning from runs; for a modelling error, only whether the requirement is tolerated."""
        values = self._values(quantity, [trial], asked, Looking(graded=False, below=False))
        return float(quantity.over_plants(values, self.aim.quantile)[0])

    def _groups(self, trials: Sequence[Trial]) -> list[Sequence[Trial]]:
        """Return the trials in groups that run together."""
        return [trials] if self.together else [[trial] for trial in trials]

    def _asked(self, origin: Origin) -> bool:
        """Return whether quantities of this origin are required. Delays are judged relative to the run without a delay."""
        return self.aim.asks(origin) or (origin is Origin.RUN and self.aim.asks(Origin.PROBE))

    def _made(self, row: Array) -> Trial:
        try:
            return Trial(row, self.varied.at(row))
        except InputError as error:
            return Trial(row, score=BROKEN_CONSTRAINT_SCORE * (len(Origin) + 1), refused=str(error))

    def _goes_on(self, trial: Trial, stage: int, to_beat: float) -> bool:
        """Return whether the trial can still be the best. Otherwise it has its final score."""
        broken = [one.violation(trial.found[one]) for one in self.aim.constraints if one in trial.found]
        missed = trial.value is not None and not np.isfinite(trial.value)
        if any(broken) or missed:
            trial.score = BROKEN_CONSTRAINT_SCORE * (len(Origin) - stage + min(max([*broken, float(missed)]), 1.0))
            return False
        if trial.value is not None and self.aim.signed(trial.value) > to_beat:
            trial.score = self.aim.signed(trial.value)
            return False
        return True

    def _look(self, trials: Sequence[Trial], origin: Origin, looking: Looking) -> None:
        """Evaluate all quantities of one origin. A trial that violates a constraint is not evaluated further unless ``fully``."""
        if origin is Origin.CERTIFICATE:
            for trial in trials:
                self._certify(trial)
            return
        for group in self._groups(trials):
            if origin is Origin.RUN:
                self._run(group)
            left: Sequence[Trial] = group
            for one in self.aim.constraints:
                if one.quantity.origin is not origin or not left:
                    continue
                values = self._values(one.quantity, left, one.requirement.limit, looking)
                found = one.quantity.over_plants(values, self.aim.quantile)
                for trial, value in zip(left, found, strict=True):
                    trial.found[one] = float(value)
                if not looking.fully and origin is Origin.PROBE:
                    left = [trial for trial in left if one.holds(trial.found[one])]
            if self.aim.quantity.origin is origin:
                values = self._values(self.aim.quantity, group, None, looking)
                for trial, value in zip(group, self.aim.quantity.over_plants(values, self.aim.quantile), strict=True):
                    trial.value = float(value)

    def _members(self, group: Sequence[Trial]) -> tuple[Plants, list[Member]]:
        """Return the members for every tuning on every plant, grouped by tuning."""
        members: list[Member] = []
        plants = self.shared or Plants.of(_case(group[0]), self.aim)
        for i, trial in enumerate(group):
            own = plants if self.shared or i == 0 else Plants.of(_case(trial), self.aim)
            members += [(problem, _case(trial).controllers[self.controller]) for problem in own.problems]
        return plants, members

    def _run(self, group: Sequence[Trial]) -> None:
        """Run the trials without a modelling error."""
        plants, members = self._members(group)
        count, case, streams = len(plants.problems), _case(group[0]), _streams(members, plants)
        twin = self.aim.asks(Origin.PROBE)
        found = Undelayed.run(members, case.simulation, case.judge, streams, self.threads, twin=twin)
        self.runs += len(members)
        for i, trial in enumerate(group):
            trial.undelayed = found.of(slice(i * count, (i + 1) * count))

    def _values(self, quantity: TunedQuantity, group: Sequence[Trial], asked: float | None, looking: Looking) -> Array:
        """Return a quantity (K, P). For probes the quantity is found up to the requirement, or completely."""
        plants, members = self._members(group)
        known = [trial.undelayed for trial in group if trial.undelayed is not None]
        if quantity.origin is Origin.RUN:
            return np.asarray(quantity.of_runs(Undelayed.together(known).noisy.metrics).reshape(len(group), -1))
        case = _case(group[0])
        probing = Probing(members, case.simulation, _streams(members, plants), plants, Judging(case.judge), self.threads)
        probe = PROBES[quantity.name]
        size = None if asked is None else asked - probe.none
        if looking.fully or size is None:
            values = probing.margins(probe, size)
        else:
            alone = np.arange(len(members))
            together = alone // len(plants.problems) if self.aim.quantile == 1 and not looking.each else alone
            values = probing.tolerates(
                probe, Undelayed.together(known), size, together, graded=looking.graded, below=looking.below
            )
        self.runs += probing.runs
        return np.asarray((probe.none + values).reshape(len(group), -1))

    def _certify(self, trial: Trial) -> None:
        assert trial.case is not None
        controller = trial.case.controllers[self.controller]
        certificate = certify(trial.case.problem, controller, trial.case.simulation, keys=self.aim.keys)[controller.name]
        for one in self.aim.constraints:
            if one.quantity.origin is Origin.CERTIFICATE:
                trial.found[one] = one.quantity.of_certificate(certificate)
        if self.aim.quantity.origin is Origin.CERTIFICATE:
            found = self.aim.quantity.of_certificate(certificate)
            trial.value = self.aim.quantity.worst if found is None else found


@dataclass
class _Again:
    """The results of a tuning's runs at a finer step: the aim's metric, and sentences on violations and differences."""

    value: float | None
    broken: list[str]
    changed: list[str]


Asked = tuple[TunedQuantity, Constraint | None, float, float]
"""A quantity, its constraint, the required or found value, and the fraction by which a finer step may fall short."""
SAME_SHARE = 0.02
"""Fraction of a constraint's limit by which a finer step may fall short. The search resolves delays to this accuracy."""


def _case(trial: Trial) -> Case:
    assert trial.case is not None
    return trial.case


def _streams(members: Sequence[Member], plants: Plants) -> Array:
    """Return the streams of noise. On a given plant, every tuning has the same noise."""
    return np.arange(len(members)) % len(plants.problems)
