"""The results of M runs of a study: their metrics, and the judge's verdicts. A run with a modelling error is evaluated by two
criteria: whether the loop begins to oscillate, and whether its motion is lost.

The ranking of adaptive schemes depends on the criterion (see docs/robustness.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from barbalat import validate
from barbalat.budget import Progress
from barbalat.judge.judged import CLASSES, Judged
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class, Verdict
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.by_tolerance import Observation
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.judging import watched_in_runs
from barbalat.run.engine.motion import StalledError
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.metrics import Metrics
from barbalat.settings import Settings
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, hint, show

Member = tuple[TrackingProblem, Controller]


class Criterion(Enum):
    """What ends a margin: the start of oscillation, or the loss of the commanded motion."""

    ONSET = "onset"
    LOSS = "loss"

    @classmethod
    def accept(cls, field: str, given: Criterion | str) -> Criterion:
        """Return the criterion for an object or a name; the InputError names the field."""
        known = [one.value for one in cls]
        if not isinstance(given, cls) and given not in known:
            raise InputError.of(field, f"must be {' or '.join(known)}, got {show(given)}{hint(given, known)}")
        return cls(given)


def verdict_of(problem: TrackingProblem, controller: Controller, simulation: Simulation, judge: Judge) -> Verdict:
    """The judge's verdict on a single run, whose error is not measured. With a tolerance, a run that stalls has the verdict
    *lost*."""
    if simulation.tolerance is None:
        (run,) = simulate(problem, [controller], simulation, judge=judge).values()
        assert run.verdict is not None
        return run.verdict
    judge = judge.named(problem)
    try:
        observed = Observation.of(problem, controller, simulation, watched_in_runs(judge, problem))
        observed.run()
        found = observed.result(judge, measured=False).verdict
    except StalledError:
        members = simulate_ensemble([(problem, controller)], simulation, judge=judge, estimated=True)
        return _only(members.judged)
    assert found is not None
    return found


def _only(judged: Judged | None) -> Verdict:
    assert judged is not None
    return judged.verdict(0)


@dataclass(frozen=True, eq=False)
class Verdicts:
    """M runs of n components.

    metrics     the metrics over every solver step
    lost        (M,) whether the judge's class is *lost*
    oscillates  (M,) whether it is *lost* or *limit cycle*, or an oscillation is still growing at the end of the judge's search
    error       (M, n) the tail's largest |e|; infinite if the run is lost
    rms         (M, n) the root mean square of e over the run; infinite if the run is lost
    band        (M, n) the judge's band for the tail's error
    scale       (M, n) the judge's scale of each component: the model's largest motion, if it moves
    """

    metrics: Metrics
    lost: Array
    oscillates: Array
    error: Array
    rms: Array
    band: Array
    scale: Array

    @classmethod
    def run(
        cls,
        members: Sequence[Member],
        simulation: Simulation,
        judge: Judge,
        *,
        numbers: Sequence[int] | Array | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Verdicts:
        """Simulate and judge these members, as ``simulate_ensemble`` does, each with a close search for limit cycles.

        The caller has estimated the cost."""
        closely = replace(judge, closely=True)
        found = simulate_ensemble(
            members, simulation, numbers=numbers, judge=closely, frequencies=False, threads=threads, progress=progress,
            estimated=True,
        )  # fmt: skip
        judged = found.judged
        assert judged is not None
        lost = judged.kinds == CLASSES.index(Class.LOST)
        cycles = judged.kinds == CLASSES.index(Class.CYCLE)
        return cls(
            metrics=found.metrics,
            lost=lost,
            oscillates=lost | cycles | judged.cycles.growing,
            error=np.where(lost[:, None], np.inf, judged.error),
            rms=np.where(lost[:, None], np.inf, found.metrics.rms_e),
            band=judged.bands.follows,
            scale=judged.bands.scale,
        )

    def of(self, chosen: Array | slice) -> Verdicts:
        """The results of the runs ``chosen``."""
        rest = {name: values[chosen] for name, values in vars(self).items() if name != "metrics"}
        return Verdicts(metrics=self.metrics.of(chosen), **rest)

    @classmethod
    def together(cls, parts: Sequence[Verdicts]) -> Verdicts:
        """All these runs together."""
        names = [name for name in vars(parts[0]) if name != "metrics"]
        rest = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(metrics=Metrics.together([part.metrics for part in parts]), **rest)

    def __len__(self) -> int:
        return len(self.lost)

    @property
    def tracks(self) -> Array:
        """(M,) whether a run follows its model at all: in the tail the error of some component is at most the model's own
        motion."""
        return np.asarray((self.error <= self.scale).any(axis=1))


@dataclass(frozen=True)
class Lost(Settings):
    """The loss of the commanded motion: the judge calls the run *lost*, or its error grew by ``share`` of the model's motion.

    share  limit on the increase of the tail's largest |e| due to the modelling error, as a fraction of the largest |x_m| of the
           run. 1 by default: the increase is then as large as the commanded motion. This is not a stability boundary: an
           oscillation that projection or saturation keeps smaller than this is tolerated
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        validate.freeze(self, share=validate.positive("share", self.share))

    def judge(self, runs: Verdicts, without: Verdicts) -> Array:
        """(M,) whether a run's motion is lost; ``without`` contains the same members without the modelling error."""
        usual = without.error.max(axis=1) + self.share * without.scale.max(axis=1)
        return np.asarray(runs.lost | ~(runs.error.max(axis=1) <= usual))
