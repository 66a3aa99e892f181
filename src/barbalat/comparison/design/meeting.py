"""Measures how well a controller meets a specification on one plant, by steps of the command, with and without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.judge.settings import Judge
from barbalat.judge.specification import Specification
from barbalat.judge.verdict import FOLLOWS_SHARE
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import Disturbance
from barbalat.protocols import BreakingSignal, Controller, Signal
from barbalat.run.engine.simulate import simulate
from barbalat.signals.piecewise import Steps, between
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

INSTANTS = 4096
"""Number of instants at which the size of the command is evaluated, and of the record of each step response."""
SETTLINGS, DECAYS = 4.0, 8.0
"""Duration of a simulated step, as multiples of the required settling time and of the model's slowest time constant."""
FIGURES = ("settling", "overshoot", "u_max", "noise", "error")
OF_A_STEP = FIGURES[:2]
"""The metrics of single steps, of which the worst counts."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One step of the judged state between two states of rest of the model, from ``begin`` to ``finish`` [s]."""

    begin: float
    finish: float
    start: float
    end: float
    text: str

    def of(self, t: Array, y: Array) -> tuple[Array, Array]:
        """Return the times since the step, and the values."""
        first, last = np.searchsorted(t, [self.begin * (1 - 1e-12), self.finish * (1 - 1e-12)])
        return t[first:last] - self.begin, y[first:last]

    def settled_after(self, t: Array, y: Array, band: float) -> float:
        """Return the time [s] from which y stays in the band until the end; infinite if it leaves the band."""
        t, y = self.of(t, y)
        outside = np.flatnonzero(~(np.abs(y - self.end) <= band))
        if not len(outside):
            return 0.0
        return float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else np.inf

    def overshoot(self, t: Array, y: Array) -> float:
        way = self.end - self.start
        return max(float(np.max((self.of(t, y)[1] - self.end) * np.sign(way))), 0.0) / abs(way)


@dataclass(frozen=True, eq=False, kw_only=True)
class StepTest:
    """The judged steps of the command: the first step, from rest, and the largest step. Each is held until the model is at rest.

    own        the simulation with the command of the case
    commands   the commands with these steps
    component  the judged state, with ``name`` as its label; ``band`` is the band that the judge uses
    stages     the judged steps of that state
    """

    simulation: Simulation
    own: Simulation
    commands: tuple[Steps, ...]
    component: int
    name: str
    band: float
    stages: tuple[Stage, ...]

    @classmethod
    def of(cls, problem: Problem, simulation: Simulation, judge: Judge, asked: Specification) -> StepTest:
        """Return the test. Raises InputError if the command does not move the model."""
        A, B, _ = problem.model.matrices
        slowest = 1 / float(np.abs(np.linalg.eigvals(A).real).min())
        steps = max(int(np.ceil(max(SETTLINGS * (asked.settling or 0.0), DECAYS * slowest) / simulation.dt)), 1)
        each = [_levels(one, simulation.t_end) for one in problem.commands]
        count = max(map(len, each))
        levels = np.array([[*one, *[one[-1]] * (count - len(one))] for one in each]).T  # (count, q), each held to the end
        rests = np.vstack([np.zeros(len(A)), *(-np.linalg.solve(A, B @ r) for r in levels)])
        moves = np.abs(np.diff(rests, axis=0))
        names, follow = problem.followed_names, problem.reference_model.follow
        component = names.index(follow) if isinstance(follow, str) and follow in names else int(np.argmax(moves[-1]))
        if not moves[:, component].any():
            raise InputError(
                "a design needs a command that moves the model, because the specification concerns its step response"
            )
        times = [k * steps * simulation.dt for k in range(count + 1)]
        y, name = rests[:, component], names[component]
        stages = [
            Stage(
                begin=times[k], finish=times[k + 1], start=float(y[k]), end=float(y[k + 1]),
                text=f"from {y[k]:.4g} to {y[k + 1]:.4g}",
            )
            for k in sorted({0, count - 1}) if y[k + 1] != y[k]
        ]  # fmt: skip
        return cls(
            simulation=replace(simulation, t_end=times[-1], record_points=INSTANTS * count), own=simulation,
            commands=tuple(Steps(times=tuple(times[:-1]), values=tuple(one)) for one in levels.T.tolist()),
            component=component, name=name, band=float(judge.follows.get(name, FOLLOWS_SHARE * np.abs(y).max())),
            stages=tuple(stages),
        )  # fmt: skip

    def at(self, problem: Problem) -> Problem:
        """Return the problem with the steps as its command. Disturbances act during the first step and are held constant from its
        end on."""
        found = replace(problem, reference=self.commands if isinstance(problem.reference, tuple) else self.commands[0])
        if len(self.commands[0].times) == 1:
            return found
        at = self.commands[0].times[1]

        def held(signal: Signal | None) -> Signal | None:
            return None if signal is None else HeldFrom(signal, at)

        def each(several: Sequence[Disturbance]) -> tuple[Disturbance, ...]:
            return tuple(replace(one, signal=HeldFrom(one.signal, at)) for one in several)

        truth = problem.truth
        if truth is not None:
            own = None if truth.unmatched is None else each(truth.unmatched)
            truth = replace(truth, disturbance=held(truth.disturbance), unmatched=own)
        return replace(found, disturbance=held(problem.disturbance), unmatched=each(problem.unmatched), truth=truth)

    @property
    def sentence(self) -> str:
        """A sentence on the judged steps."""
        if len(self.stages) == 1:
            return f"settling and overshoot are judged on the step of {self.name} {self.stages[0].text}"
        first, largest = (one.text for one in self.stages)
        return (
            f"settling and overshoot are judged on two steps of the command, the first of {self.name}, {first}, and the "
            f"largest, {largest}; the worse result counts"
        )

    def worst(self, t: Array, y: Array) -> dict[str, tuple[float, str]]:
        """Return the metrics of the worst of the steps, and a text that identifies this step."""
        settling = max(((one.settled_after(t, y, self.band), one.text) for one in self.stages), key=lambda one: one[0])
        overshoot = max(((one.overshoot(t, y), one.text) for one in self.stages), key=lambda one: one[0])
        return dict(zip(OF_A_STEP, (settling, overshoot), strict=True))


def _levels(command: Signal, t_end: float) -> list[float]:
    """Return the values of a command from rest to the end of its largest jump, or its largest value if it has no jumps.

    Values between the first and those of the largest jump are approached in steps that are not larger than this jump.
    """
    instants = [0.0, *(command.breaks(0.0, t_end) if isinstance(command, BreakingSignal) else ())]
    after, before = (np.asarray(side(np.array(instants)), dtype=float) for side in (command, command.before))
    before[0] = 0.0
    jumps = np.abs(after - before)
    if not (jumps[1:] > 1e-9 * np.abs(after).max()).any():
        values = np.asarray(command(np.linspace(0.0, t_end, INSTANTS)), dtype=float)
        return [float(np.abs(values).max())]
    first, largest = int(np.flatnonzero(jumps > 1e-9 * jumps.max())[0]), int(jumps.argmax())
    if first == largest:
        return [float(after[first])]
    between_them = np.linspace(
        after[first], before[largest], int(np.ceil(abs(before[largest] - after[first]) / jumps[largest])) + 1
    )
    return [*between_them.tolist(), float(after[largest])]


@dataclass(frozen=True)
class HeldFrom:
    """A signal that is held, from t = ``at`` [s] on, at its value before that instant."""

    signal: Signal
    at: float

    def __call__(self, t: Array) -> Array:
        t = np.asarray(t, dtype=float)
        return np.where(t < self.at, self.signal(np.minimum(t, self.at)), self._last)

    def before(self, t: Array) -> Array:
        return self.signal.before(np.minimum(np.asarray(t, dtype=float), self.at))

    def breaks(self, start: float, stop: float) -> Array:
        own = self.signal.breaks(start, min(stop, self.at)) if isinstance(self.signal, BreakingSignal) else np.zeros(0)
        return np.concatenate([own, between(start, stop, np.array([self.at]))])

    @property
    def _last(self) -> Array:
        return self.signal.before(np.array(self.at))


def measured(
    problems: Sequence[Problem], controller: Controller, test: StepTest, judge: Judge
) -> tuple[dict[str, Array], dict[str, list[str]]]:
    """Return the metrics on each plant (K,), by name, and the worst step for metrics of single steps.

    ``u_max`` also covers the command of the case, and ``error`` covers this command only. Metrics are infinite if a run diverged.
    """
    found: dict[str, list[float]] = {name: [] for name in FIGURES}
    steps: dict[str, list[str]] = {name: [] for name in OF_A_STEP}
    for problem in problems:
        (own,) = simulate(problem, [controller], test.own, judge=judge).values()
        values, worst = _on_one(test.at(problem), controller, test, judge)
        diverged = np.isfinite(own.metrics.diverged_at[0])
        values["error"] = float(own.metrics.max_abs_e[0, test.component])
        values["u_max"] = max(values["u_max"], float(own.metrics.max_abs_u.max()))
        for name in FIGURES:
            found[name].append(np.inf if diverged and name in ("u_max", "error") else values[name])
        for name in OF_A_STEP:
            steps[name].append(worst[name])
    return {name: np.array(values) for name, values in found.items()}, steps


def _on_one(problem: Problem, controller: Controller, test: StepTest, judge: Judge) -> tuple[dict[str, float], dict[str, str]]:
    quiet = problem.with_sensor(lambda own: None if own is None else replace(own, noise=None))
    runs = [next(iter(simulate(one, [controller], test.simulation, judge=judge).values())) for one in (problem, quiet)]
    if any(np.isfinite(run.metrics.diverged_at[0]) for run in runs):
        return dict.fromkeys(FIGURES, np.inf), dict.fromkeys(OF_A_STEP, "")
    noisy, clean = runs
    worst = test.worst(noisy.t, noisy.x[:, test.component])
    largest = float(clean.metrics.max_abs_u.max())
    shaken = float(np.sqrt(np.mean((noisy.u - clean.u) ** 2)))
    values = {name: value for name, (value, _) in worst.items()} | {
        "u_max": float(noisy.metrics.max_abs_u.max()),
        "noise": shaken / largest if largest > 0 else np.inf if shaken > 0 else 0.0,
    }
    return values, {name: text for name, (_, text) in worst.items()}


def model_settling(problem: Problem, test: StepTest) -> float:
    """Return the settling time of the reference model [s]. A controller that follows it can be faster only by the effect of the
    band."""
    A, B, _ = problem.model.matrices
    count = test.simulation.record_points
    t = test.simulation.t_end / count * np.arange(count + 1)
    held = HeldSystem.of(A, B, float(t[1]))
    commands = np.array([one(t) for one in test.commands]).T
    x = [np.zeros(len(A))]
    for r in commands[:-1]:
        x.append(held.following(x[-1], r))
    return test.worst(t, np.array(x)[:, test.component])["settling"][0]
