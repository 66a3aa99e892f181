"""How well a controller meets a specification on one plant: a step of the command's size, with and without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.judge.settings import Judge
from barbalat.judge.specification import Specification
from barbalat.judge.verdict import FOLLOWS_SHARE
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.signals.smooth import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

INSTANTS = 4096
"""Number of instants at which the size of the command is evaluated, and of a recorded step response."""
SETTLINGS, DECAYS = 4.0, 8.0
"""Duration of a simulated step, as multiples of the required settling time and of the model's slowest time constant."""
FIGURES = ("settling", "overshoot", "u_max", "noise")


@dataclass(frozen=True, eq=False, kw_only=True)
class Step:
    """A step of the command, and the criteria by which it is judged.

    own        how the case's own command is simulated
    component  the state that is judged, ``name`` its label; rest, band  where the model comes to rest, and the judge's band
    """

    simulation: Simulation
    own: Simulation
    commands: tuple[Constant, ...]
    component: int
    name: str
    rest: float
    band: float

    @classmethod
    def of(cls, problem: Problem, simulation: Simulation, judge: Judge, asked: Specification) -> Step:
        """A step of the size of the case's command; InputError if the model's steady state is zero."""
        t = np.linspace(0.0, simulation.t_end, INSTANTS)
        commands = tuple(Constant(float(np.abs(np.asarray(one(t), dtype=float)).max())) for one in problem.commands)
        A, B, _ = problem.model.matrices
        rest = -np.linalg.solve(A, B @ np.array([one.amplitude for one in commands]))
        if not rest.any():
            raise InputError("a design needs a command that moves the model: the specification concerns its step response")
        names, follow = problem.followed_names, problem.reference_model.follow
        component = names.index(follow) if isinstance(follow, str) and follow in names else int(np.argmax(np.abs(rest)))
        name, size = names[component], abs(float(rest[component]))
        slowest = 1 / float(np.abs(np.linalg.eigvals(A).real).min())
        horizon = max(SETTLINGS * (asked.settling or 0.0), DECAYS * slowest)
        steps = max(int(np.ceil(horizon / simulation.dt)), 1)
        return cls(
            simulation=replace(simulation, t_end=steps * simulation.dt, record_points=INSTANTS), own=simulation,
            commands=commands, component=component, name=name, rest=float(rest[component]),
            band=float(judge.follows.get(name, FOLLOWS_SHARE * size)),
        )  # fmt: skip

    def at(self, problem: Problem) -> Problem:
        """The problem with the step as its command."""
        return replace(problem, reference=self.commands if isinstance(problem.reference, tuple) else self.commands[0])

    def settled_after(self, t: Array, y: Array) -> float:
        """The time [s] from which y stays in the band to the end; infinite if it does not."""
        outside = np.flatnonzero(~(np.abs(y - self.rest) <= self.band))
        if not len(outside):
            return 0.0
        return float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else np.inf

    def overshoot(self, y: Array) -> float:
        return max(float(np.max((y - self.rest) * np.sign(self.rest))), 0.0) / abs(self.rest)


def measured(problems: Sequence[Problem], controller: Controller, step: Step, judge: Judge) -> dict[str, Array]:
    """The figures on each plant, (K,) by name, ``u_max`` under its own command too; infinite if a run diverged."""
    found: dict[str, list[float]] = {name: [] for name in FIGURES}
    for problem in problems:
        (own,) = simulate(problem, [controller], step.own, judge=judge).values()
        for name, value in _on_one(step.at(problem), controller, step, judge).items():
            found[name].append(value)
        diverged = np.isfinite(own.metrics.diverged_at[0])
        found["u_max"][-1] = np.inf if diverged else max(found["u_max"][-1], float(own.metrics.max_abs_u.max()))
    return {name: np.array(values) for name, values in found.items()}


def _on_one(problem: Problem, controller: Controller, step: Step, judge: Judge) -> dict[str, float]:
    quiet = problem.with_sensor(lambda own: None if own is None else replace(own, noise=None))
    runs = [next(iter(simulate(one, [controller], step.simulation, judge=judge).values())) for one in (problem, quiet)]
    if any(np.isfinite(run.metrics.diverged_at[0]) for run in runs):
        return dict.fromkeys(FIGURES, np.inf)
    noisy, clean = runs
    y = noisy.x[:, step.component]
    largest = float(clean.metrics.max_abs_u.max())
    shaken = float(np.sqrt(np.mean((noisy.u - clean.u) ** 2)))
    return {
        "settling": step.settled_after(noisy.t, y),
        "overshoot": step.overshoot(y),
        "u_max": float(noisy.metrics.max_abs_u.max()),
        "noise": shaken / largest if largest > 0 else np.inf if shaken > 0 else 0.0,
    }


def model_settling(problem: Problem, step: Step) -> float:
    """The settling time of the reference model itself [s]; a controller that follows it can be faster only by the effect of the
    band."""
    A, B, _ = problem.model.matrices
    h = step.simulation.t_end / INSTANTS
    held = HeldSystem.of(A, B, h)
    r = np.array([one.amplitude for one in step.commands])
    x = [np.zeros(len(A))]
    for _ in range(INSTANTS):
        x.append(held.following(x[-1], r))
    return step.settled_after(h * np.arange(INSTANTS + 1), np.array(x)[:, step.component])
