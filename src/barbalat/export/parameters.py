"""Numbers of a case that stay open in an export: gains, limits, initial estimates that enter the operations as they are.

A setting is tried with another value. Where the numbers of the loop and of its initial state that follow it are that value, to
the last bit, and no other number moves, it is a parameter; where more follows from it, as P from A_m or a filter's matrices from
its poles, it is compiled in. The lists are those of an ensemble whose members differ in these numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.export.limits import estimate_limits
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import comes_from_outside, parts_of
from barbalat.open_numbers.settings import Rebuild, numbers, settable
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run import breaks
from barbalat.run.columns import Columns, StructureError
from barbalat.run.members import Members, Reader
from barbalat.run.template import Member, Template
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

Case = tuple[TrackingProblem, Controller]

BUMPS: tuple[Callable[[float], float], ...] = (
    lambda value: 1.125 * value + 0.0625 * (value == 0),
    lambda value: 0.875 * value - 0.0625 * (value == 0),
)
"""Other values that a setting is tried with, up or else down; never the value itself."""
NOT_OFFERED = frozenset({"sample_time", "delay", "history"})
"""Settings that more follows from than a loop's numbers: how often a controller is called, what a delay remembers."""


@dataclass(frozen=True)
class Parameter:
    """One open number.

    name     in the structured names of FMI: "gamma", "theta_hat0[1]", "u_max"
    value    in this case
    limit    (input, side) of a limit of u, side 0 for the lower one
    """

    name: str
    value: float
    meaning: str
    limit: tuple[int, int] | None = None


@dataclass(frozen=True)
class Candidate:
    """A setting, and the case with another value of it; ``InputError`` from ``changed`` where that can't be."""

    parameter: Parameter
    changed: Callable[[float], Case]


@dataclass(frozen=True, eq=False)
class Opened:
    """The loop's lists with parameters in them.

    cases   this case, then for each parameter the case with another value of it, ``tried``: an ensemble with these lists
    feeds   by entries of the lists' third argument, which parameter each is; None for a number that is none
    starts  by entries of the loop's flat state, which parameter it begins with
    """

    parameters: tuple[Parameter, ...]
    tried: tuple[float, ...]
    cases: tuple[Case, ...]
    members: Members
    template: Template
    feeds: tuple[int | None, ...]
    starts: dict[int, int]

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, tunable: bool) -> Opened:
        """InputError where the controller does not fit the problem; without ``tunable`` every number is compiled in."""
        controller = _explicit_estimates(problem, controller)
        reader = Reader.of((problem, controller), simulation, adjustable=False)
        candidates = _candidates(problem, controller) if tunable else ()
        every = ((one, _tried(problem, controller, one)) for one in candidates)
        found = [(one.parameter, *other) for one, other in every if other is not None]
        for _, _, case in found:
            reader.add(*case)
        members = reader.members(0)
        return cls(
            tuple(one for one, _, _ in found),
            tuple(value for _, value, _ in found),
            ((problem, controller), *(case for _, _, case in found)),
            members,
            Template.of(reader.columns, opened=not simulation.fused),
            tuple(_followed(row) for row in members.parameters),
            {row: k for row, values in enumerate(members.states) if (k := _followed(values)) is not None},
        )

    @cached_property
    def open_limits(self) -> Array:
        """(2, p) which of the estimates' limits, as of ``estimate_limits``, follow a parameter."""
        every = (estimate_limits(ClosedLoop.of(*case)) for case in self.cases)
        given = np.array([limits for limits in every if limits is not None])  # all have some, or none
        return np.asarray((given != given[0]).any(axis=0)) if len(given) else np.zeros((2, 0), dtype=bool)

    @property
    def values(self) -> Array:
        """(p,) what the lists' third argument is in this case."""
        return np.asarray(self.members.parameters[:, 0])

    def whole_samples(self, samples: int) -> int:
        """How many samples, of so many, pass before a signal breaks inside of a solver step: exports take whole ones."""
        simulation, signals = self.members.simulation, self.members.signals
        if not breaks.can_be_split(signals, simulation):
            return samples
        every = self.members.rhythm.sample_every
        found = breaks.breaks_inside(signals, simulation, 0, samples * every)
        return min(samples, int(found.min() / (every * simulation.dt))) if len(found) else samples


def _followed(row: Array) -> int | None:
    """Member k + 1 is the case with another value of parameter k."""
    moved = np.flatnonzero(row != row[0])
    return int(moved[0]) - 1 if len(moved) else None


def _explicit_estimates(problem: TrackingProblem, controller: Controller) -> Controller:
    """With the initial estimates written out, where the settings have none."""
    loop = ClosedLoop.of(problem, controller)
    initial = loop.initial()[loop.theta_hat_rows]

    def written(part: Any) -> Any:
        if not is_dataclass(part) or isinstance(part, type):
            return part
        found = parts_of(part) or {}
        changed = {name: written(value) for name, value in found.items() if is_dataclass(value) and settable(part, name)}
        changed = {name: value for name, value in changed.items() if value is not found[name]}
        if "theta_hat0" in found and found["theta_hat0"] is None and initial.size:
            changed["theta_hat0"] = initial
        return replace(part, **changed) if changed else part

    explicit = written(controller)
    same = Columns(loop)
    try:
        same.add(ClosedLoop.of(problem, explicit))
    except (StructureError, InputError):
        return controller
    return controller if same.differing()[0].any() else explicit


def _tried(problem: TrackingProblem, controller: Controller, candidate: Candidate) -> tuple[float, Case] | None:
    """Another value of the setting, and the case with it, if the setting is a parameter."""
    loop = ClosedLoop.of(problem, controller)
    for bump in BUMPS:
        value = bump(candidate.parameter.value)
        columns, initial = Columns(loop), Columns(loop.initial())
        try:
            other = candidate.changed(value)
            changed = ClosedLoop.of(*other)
            columns.add(changed)
            initial.add(changed.initial())
        except (InputError, StructureError):
            continue
        moved = [found.differing()[1] for found in (columns, initial)]
        direct = all((rows[:, 1] == value).all() for rows in moved) and any(len(rows) for rows in moved)
        return (value, other) if direct and _bears_symbols(loop, changed) else None
    return None


def _bears_symbols(loop: ClosedLoop, other: ClosedLoop) -> bool:
    """Whether equations from outside the package compute with a symbol what they do with a number: none branches on it."""
    if not comes_from_outside(loop.equations):
        return True
    columns = Columns(Member(loop, None))
    columns.add(Member(other, None))
    try:
        Template.of(columns)
    except InputError:
        return False
    return True


def _candidates(problem: TrackingProblem, controller: Controller) -> Iterator[Candidate]:
    """Settings of the controller, the known set's bounds, limits of u, then settings of the plant."""
    for name, value, rebuilt in numbers(controller):
        plain = name.removeprefix("controller.")
        if plain not in NOT_OFFERED:
            meaning = "initial estimate" if "theta_hat0" in plain else "setting of the controller"

            def changed(v: float, rebuilt: Rebuild = rebuilt) -> Case:
                return problem, rebuilt(v)

            yield Candidate(Parameter(plain, value, meaning), changed)
    case: Any = problem
    yield from _bounds(case, controller)
    for name, value, rebuilt in numbers(problem.plant):
        if name.rpartition(".")[2] in NOT_OFFERED:
            continue

        def other(v: float, rebuilt: Rebuild = rebuilt) -> Case:
            return replace(case, plant=rebuilt(v)), controller

        limit = _limit(name)
        if limit is None:
            yield Candidate(Parameter(f"plant.{name}", value, "setting of the plant"), other)
        else:
            which = f"[{limit[0] + 1}]" if len(problem.plant.paths) > 1 else ""
            yield Candidate(Parameter(f"{('u_min', 'u_max')[limit[1]]}{which}", value, "limit of the control", limit), other)


def _bounds(case: Any, controller: Controller) -> Iterator[Candidate]:
    """Numbers of the known set, of a problem that has one."""
    if not isinstance(case, Problem) or case.uncertainty is None:
        return
    for name, value, rebuilt in numbers(case.uncertainty):

        def changed(v: float, rebuilt: Rebuild = rebuilt) -> Case:
            return replace(case, uncertainty=rebuilt(v)), controller

        yield Candidate(Parameter(f"uncertainty.{name}", value, "of the known set"), changed)


def _limit(name: str) -> tuple[int, int] | None:
    """(input, side) for a plant's setting that is a limit of u."""
    first, _, last = name.partition(".")
    if not first.startswith("input") or not last.startswith("saturation["):
        return None
    which = 0 if first == "input" else int(first.removeprefix("input[").removesuffix("]")) - 1
    return which, int(last.removeprefix("saturation[").removesuffix("]")) - 1
