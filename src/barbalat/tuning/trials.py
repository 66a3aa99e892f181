"""Tunings tried: what each reaches, looked at from what costs least to what costs most, and no further than it matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from barbalat.cases.build import Case
from barbalat.certificates.certify import certify
from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_borne import Question
from barbalat.study.delay_margin import delay_margins_ensemble
from barbalat.study.delay_search import Criterion
from barbalat.study.ideal_benchmark import Member
from barbalat.sweeps.varied import Varied
from barbalat.tuning.aim import Aim
from barbalat.tuning.quantity import DELAYS, Constraint, Origin, Quantity
from barbalat.tuning.search import FAR
from barbalat.tuning.trial import Plants, Trial
from barbalat.validate import Array, InputError


@dataclass(eq=False)
class Trials:
    """Of one controller of a case.

    together  whether the tunings differ in numbers of the kernel alone, so that they run side by side
    shared    the plants, where what is tuned changes none of them
    """

    varied: Varied
    controller: int
    aim: Aim
    together: bool
    shared: Plants | None
    threads: int | None = None
    all: list[Trial] = field(default_factory=list)
    runs: int = 0
    best: float = np.inf

    def judged(self, rows: Array, to_beat: float) -> list[Trial]:
        """These tunings; one whose quantity is above ``to_beat`` is not looked at further.

        One that is not better than the best so far counts as bearing a delay without a look at shorter ones: that takes most of
        the runs and decides of the best tuning alone.
        """
        trials = [self._made(row) for row in rows]
        open_ones = [trial for trial in trials if trial.case is not None]
        for stage, origin in enumerate(Origin):
            if open_ones and self._asked(origin):
                self._look(open_ones, origin, graded=to_beat >= FAR, best=self.best)
                open_ones = [trial for trial in open_ones if self._goes_on(trial, stage, to_beat)]
        for trial in open_ones:
            assert trial.value is not None
            trial.complete, trial.score = True, self.aim.signed(trial.value)
        self.best = min([self.best, *(trial.score for trial in open_ones)])
        self.all += trials
        return trials

    def whole(self, row: Array, case: Case | None = None) -> Trial:
        """One tuning, everything looked at, whatever it breaks; the case may be given."""
        trial = self._made(row) if case is None else Trial(row, case)
        if trial.case is not None:
            for origin in Origin:
                if self._asked(origin):
                    self._look([trial], origin, fully=True)
            trial.complete = True
        return trial

    def measure(self, trials: Sequence[Trial], constraint: Constraint) -> None:
        """A constraint's quantity in full of tunings that were looked at before: certificates, delays beyond what is required."""
        if constraint.quantity.origin is Origin.CERTIFICATE:
            for trial in trials:
                self._certify(trial)
            return
        for group in self._groups(trials):
            plants, members = self._members(group)
            values = self._values(constraint.quantity, group, plants, members, None)
            self._put(group, constraint.quantity.over_plants(values, self.aim.quantile), constraint.quantity)

    def on_other_plants(self, case: Case, plants: Plants, quantity: Quantity, limit: float | None) -> Array:
        """(P,) a quantity of one case on these."""
        others = replace(self, shared=plants, all=[], runs=0)
        trial = Trial(np.zeros(0), case)
        members = others._members([trial])[1]
        others._run([trial], plants, members)
        found = others._values(quantity, [trial], plants, members, limit, each=True)[0]
        self.runs += others.runs
        return np.asarray(found)

    def _groups(self, trials: Sequence[Trial]) -> list[Sequence[Trial]]:
        """Those that run side by side."""
        return [trials] if self.together else [[trial] for trial in trials]

    def _asked(self, origin: Origin) -> bool:
        """Delays are judged against the run without one."""
        return self.aim.asks(origin) or (origin is Origin.RUN and self.aim.asks(Origin.DELAY))

    def _made(self, row: Array) -> Trial:
        try:
            return Trial(row, self.varied.at(row))
        except InputError as error:
            return Trial(row, score=FAR * (len(Origin) + 1), refused=str(error))

    def _goes_on(self, trial: Trial, stage: int, to_beat: float) -> bool:
        """Whether it can still be the best; else it has its score."""
        broken = [one.violation(trial.found[one]) for one in self.aim.constraints if one in trial.found]
        missed = trial.value is not None and not np.isfinite(trial.value)
        if any(broken) or missed:
            trial.score = FAR * (len(Origin) - stage + min(max([*broken, float(missed)]), 1.0))
            return False
        if trial.value is not None and self.aim.signed(trial.value) > to_beat:
            trial.score = self.aim.signed(trial.value)
            return False
        return True

    def _look(
        self, trials: Sequence[Trial], origin: Origin, *, fully: bool = False, graded: bool = True, best: float = np.inf
    ) -> None:
        """Find all quantities of one origin.

        fully   delays beyond what is required too
        graded  how far those are from what is required that do not bear it
        best    a tuning whose quantity is not below it is not asked about delays shorter than the required one
        """
        if origin is Origin.CERTIFICATE:
            for trial in trials:
                self._certify(trial)
            return
        for group in self._groups(trials):
            plants, members = self._members(group)
            if origin is Origin.RUN:
                self._run(group, plants, members)
            wanted = {one.quantity: one.requirement.limit for one in self.aim.constraints if one.quantity.origin is origin}
            below = np.array([trial.value is None or self.aim.signed(trial.value) < best for trial in group])
            for quantity, limit in wanted.items():
                values = self._values(quantity, group, plants, members, None if fully else limit, graded=graded, below=below)
                self._put(group, quantity.over_plants(values, self.aim.quantile), quantity)
            if self.aim.quantity.origin is origin:
                values = self._values(self.aim.quantity, group, plants, members, None)
                for trial, value in zip(group, self.aim.quantity.over_plants(values, self.aim.quantile), strict=True):
                    trial.value = float(value)

    def _members(self, group: Sequence[Trial]) -> tuple[Plants, list[Member]]:
        """Every tuning on every plant, those of one tuning together."""
        members: list[Member] = []
        plants = self.shared or Plants.of(_case(group[0]), self.aim)
        for i, trial in enumerate(group):
            own = plants if self.shared or i == 0 else Plants.of(_case(trial), self.aim)
            members += [(problem, _case(trial).controllers[self.controller]) for problem in own.problems]
        return plants, members

    def _run(self, group: Sequence[Trial], plants: Plants, members: list[Member]) -> None:
        """Without a delay."""
        count = len(plants.problems)
        found = simulate_ensemble(members, _case(group[0]).simulation, numbers=_streams(members, plants), threads=self.threads)
        self.runs += len(members)
        for i, trial in enumerate(group):
            trial.undelayed = found.metrics.of(slice(i * count, (i + 1) * count))

    def _values(
        self,
        quantity: Quantity,
        group: Sequence[Trial],
        plants: Plants,
        members: list[Member],
        limit: float | None,
        *,
        graded: bool = True,
        below: Array | None = None,
        each: bool = False,
    ) -> Array:
        """(K, P); delays up to a limit, or all of them; ``below`` (K,) as of ``Question``; ``each``: of every plant, alone."""
        undelayed = Metrics.together([trial.undelayed for trial in group if trial.undelayed is not None])
        if quantity.origin is Origin.RUN:
            values = quantity.of_runs(undelayed)
        else:
            simulation, streams = _case(group[0]).simulation, _streams(members, plants)
            if limit is None:
                return self._margins(DELAYS[quantity.name], simulation, plants, members).reshape(len(group), -1)
            asked = Question(
                members,
                simulation,
                undelayed,
                limit,
                DELAYS[quantity.name],
                streams,
                plants.ideals,
                self.aim.longest,
                self.threads,
            )
            alone = np.arange(len(members))
            together = alone // len(plants.problems)
            values = asked.bears(
                together if self.aim.quantile == 1 and not each else alone,
                graded=graded,
                below=None if below is None else below[together],
            )
            self.runs += asked.runs
        return np.asarray(values.reshape(len(group), -1))

    def _margins(self, criterion: Criterion, simulation: Simulation, plants: Plants, members: list[Member]) -> Array:
        """(M,) borne, however much that is [s]."""
        found = delay_margins_ensemble(
            members, simulation, longest=self.aim.longest, numbers=_streams(members, plants), ideals=plants.ideals,
            threads=self.threads,
        )  # fmt: skip
        self.runs += found.runs
        return (found.onset if criterion is Criterion.ONSET else found.loss).bears

    def _put(self, group: Sequence[Trial], values: Array, quantity: Quantity) -> None:
        for trial, value in zip(group, values, strict=True):
            trial.found |= {one: float(value) for one in self.aim.constraints if one.quantity == quantity}

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


def _case(trial: Trial) -> Case:
    assert trial.case is not None
    return trial.case


def _streams(members: Sequence[Member], plants: Plants) -> Array:
    """Every tuning has the same noise on a plant."""
    return np.arange(len(members)) % len(plants.problems)
