"""Builds the objects of the Python API from the checked tables of a case file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, is_dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from barbalat.cases.findings import several
from barbalat.cases.keys import Context, Given
from barbalat.cases.scheme_keys import sampling_of
from barbalat.cases.table_models import Table
from barbalat.cases.typed_numbers import in_the_files_words
from barbalat.controllers import BaselineAlone, Sampled
from barbalat.controllers.settings import PLANT_FEATURES
from barbalat.judge.settings import Judge
from barbalat.judge.specification import Specification
from barbalat.loop.binding import bound, require_controllers
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import identical
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel import delay
from barbalat.run.kernel.pieces import require_known_instants
from barbalat.run.kernel.step import Rhythm, whole_steps
from barbalat.settings import given_of, one_line
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError, printable, show


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """A problem, the controllers to compare on it, and the settings of the simulation.

    equations  equations of each controller for the problem, if they are already known
    judge      the criteria for the verdicts
    specification  the requirements of ``design``
    """

    problem: TrackingProblem
    controllers: tuple[Controller, ...]
    simulation: Simulation
    equations: tuple[Any, ...] = ()
    judge: Judge = field(default_factory=Judge)
    specification: Specification | None = None

    @property
    def name(self) -> str:
        return self.problem.name

    def member(self, i: int) -> tuple[Any, ...]:
        """The i-th controller on the problem, with its equations if known, in the form that ensembles read."""
        return self.problem, self.controllers[i], *self.equations[i : i + 1]

    def __repr__(self) -> str:
        names = ", ".join(controller.name for controller in self.controllers)
        return f"<Case {self.name!r}: {names}; {self.simulation.t_end:g} s {self.simulation.in_brief}>"

    def _repr_html_(self) -> str:
        """For notebooks: the problem, the controllers with their settings, the simulation."""
        from barbalat.problem.tracking import table_of

        rows = {one.name: one_line(one) if is_dataclass(one) else show(one) for one in self.controllers}  # type: ignore[redundant-expr]
        return "".join(
            [self.problem._repr_html_(), table_of("Controllers", rows), table_of("Simulation", given_of(self.simulation))]
        )


@contextmanager
def within(place: str) -> Iterator[None]:
    """Prefixes the message of an InputError with ``place``, unless the message begins with ``place`` or with a field in it."""
    try:
        yield
    except InputError as error:
        named = error.field == place or error.field.startswith(f"{place}.")
        raise error if named else InputError(f"{place}: {error}", field=place) from None


Bound = tuple[Controller, Any]
"""A controller and its equations for the problem."""


@dataclass(eq=False)
class Parts:
    """The parts of the first of several cases that are built together; a later case with some changed tables reuses the other
    parts.

    Parts are identified by the tables from which they were made; the tables are kept with them.
    """

    objects: Mapping[int, tuple[Any, Any]] = field(default_factory=dict)
    problem: tuple[list[Any], TrackingProblem] | None = None
    controllers: dict[int, tuple[Table, Bound]] = field(default_factory=dict)
    fitting: dict[int, tuple[TrackingProblem, Controller, Simulation]] = field(default_factory=dict)
    complete: bool = False

    def problem_of(self, posed: list[Any], make: Callable[[], TrackingProblem]) -> TrackingProblem:
        """The problem for these values of the case's keys."""
        if self.problem is not None and all(one is other for one, other in zip(posed, self.problem[0], strict=True)):
            return self.problem[1]
        problem = make()
        if not self.complete:
            self.problem = posed, problem
        return problem


def build(
    case: Table,
    folder: Path,
    joining: Sequence[Controller] = (),
    parts: Parts | None = None,
    raw: dict[str, Any] | None = None,
) -> Case:
    """Validate and build everything, binding each controller once; ``folder`` is the base of relative paths.

    joining  controllers in addition to the case's own
    parts    parts of the first case that was built from these tables; they are not built again
    raw      tables of the file, if they have parameters or a [truth]
    """
    parts = Parts() if parts is None else parts
    base = Context(folder, objects=parts.objects)
    posed = [value for key, value in vars(case).items() if key not in ("controller", "simulation", "judge", "specification")]

    given = _given(case, base, "")
    simulation, judge = given.pop("simulation"), given.pop("judge", Judge())
    specification = given.pop("specification", None)

    def pose() -> TrackingProblem:
        with in_the_files_words(given):
            problem: TrackingProblem = case.recipe.make(given, base._replace(raw=raw, judge=judge, t_end=simulation.t_end))
        return problem

    problem = parts.problem_of(posed, pose)
    judge = judge.named(problem)
    found = _controllers(case, base._replace(known=problem.known), problem, parts)
    found += [(controller, _joined(problem, controller, case)) for controller in joining]
    if (alone := _baseline_alone(problem, [controller for controller, _ in found])) is not None:
        found.append((alone, bound(problem, alone)))
    made = replace(_assembled(problem, found, simulation, parts), judge=judge, specification=specification)
    if not parts.complete:
        parts.objects, parts.complete = MappingProxyType(parts.objects), True
    return made


def _joined(problem: TrackingProblem, controller: Controller, case: Table) -> Any:
    """Return the equations of a controller that joins the case. If the controller rejects the plant, the message says which
    controller and case, and what is special about the plant."""
    try:
        return bound(problem, controller)
    except InputError as error:
        if error.controller or error.field or not isinstance(controller, Controller):  # not an error about the plant
            raise
        has = [name for name, feature in PLANT_FEATURES.items() if isinstance(problem, Problem) and feature.found(problem.known)]
        of_plant = f", whose plant has {' and '.join(has)}" if has else ""
        whole = f"{error}. {controller.name} therefore cannot be used in the case {show(vars(case)['name'])}{of_plant}"
        raise InputError(whole, controller=controller.name) from error


def _controllers(case: Table, context: Context, problem: TrackingProblem, parts: Parts) -> list[Bound]:
    tables: list[Table] = vars(case)["controller"]
    asked = False

    def others(settings: type) -> dict[str, Callable[[], Any]]:
        """The case's controllers of a class, by name, each with a function that makes it."""
        nonlocal asked
        asked = True
        chosen = [table for table in tables if table.recipe.settings is settings]
        return {_name(table): partial(_controller, table, context) for table in chosen}

    context = context._replace(others=others)
    same = parts.problem is not None and identical(problem.known, parts.problem[1].known)
    controllers: list[Bound] = []
    refused: list[str] = []
    for i, table in enumerate(tables, start=1):
        if same and id(table) in parts.controllers:
            controllers.append(parts.controllers[id(table)][1])
            continue
        asked = False
        try:
            called = vars(table)["name"] if "name" in table.model_fields_set else table.recipe.choice
            with within(f"controller {i} ({printable(called)})"):
                controllers.append(_bound(table, context, problem))
        except InputError as error:
            refused += error.sentences
        else:
            if not asked and not parts.complete:
                parts.controllers[id(table)] = table, controllers[-1]
    if refused:
        raise several(refused)
    return controllers


def _baseline_alone(problem: TrackingProblem, controllers: Sequence[Controller]) -> Controller | None:
    """The baseline without adaptation, sampled like the first sampled controller; None without a baseline, or if the case lists
    it."""
    inner = [one.controller if isinstance(one, Sampled) else one for one in controllers]
    if problem.fixed is None or any(isinstance(one, BaselineAlone) for one in inner):
        return None
    taken = {one.name for one in controllers}
    alone = BaselineAlone(name=next(name for name in ("Baseline", "Baseline alone", "Baseline 2") if name not in taken))
    times = [one.sample_time for one in controllers if isinstance(one, Sampled)]
    return Sampled(controller=alone, sample_time=times[0]) if times else alone


def _name(table: Table) -> str:
    """The name of a controller: the given name or the default of its settings."""
    return str(vars(table)["name"])


def made(table: Table, context: Context, place: str) -> Any:
    """The object that a table describes; ``place`` is the position of the table, for messages."""
    given = _given(table, context, place)
    with in_the_files_words(given):
        return table.recipe.make(given, context)


def _given(table: Table, context: Context, place: str) -> Given:
    """The values of a table's keys, with inner tables built; missing keys are absent."""
    found = {key: value for key, value in table if key in table.model_fields_set and key in table.recipe.keys}
    return {key: _value(value, context, f"{place}.{key}" if place else key) for key, value in found.items()}


def _value(value: Any, context: Context, place: str) -> Any:
    if isinstance(value, list) and value and isinstance(value[0], Table):
        return tuple(_value(one, context, f"{place} {i}") for i, one in enumerate(value, start=1))
    if isinstance(value, dict):
        return {key: _value(one, context, f"{place}.{key}") for key, one in value.items()}
    if not isinstance(value, Table):
        return value
    if (known := context.objects.get(id(value))) is not None:
        found = known[1]
    else:
        with within(place):  # only about its keys, whatever the problem is
            found = made(value, Context(context.folder, objects=context.objects), place)
        if isinstance(context.objects, dict):
            context.objects[id(value)] = value, found
    return dict(found) if isinstance(found, dict) else found  # the tables of a problem are kept as they are and combined later


def _controller(table: Table, context: Context) -> Controller:
    """The controller in continuous time, or the sampled controller if the scheme is always sampled."""
    given, sampling = _given(table, context, ""), sampling_of(table.recipe.keys)
    controller: Controller = table.recipe.make({key: value for key, value in given.items() if key not in sampling}, context)
    return controller


def _bound(table: Table, context: Context, problem: TrackingProblem) -> Bound:
    """The controller and its equations, sampled if requested, after a first binding, which checks that problem and controller
    fit."""
    with in_the_files_words({key: vars(table)[key] for key in table.model_fields_set}):
        controller = _controller(table, context)
        sampling = {key: vars(table)[key] for key in sampling_of(table.recipe.keys) if key in table.model_fields_set}
        if "sample_time" in sampling:
            controller = Sampled(controller=controller, **sampling)
        elif sampling:
            raise InputError("discretization needs sample_time, which is missing")
        return controller, bound(problem, controller)


def _already_bound(equations: Any, _problem: TrackingProblem, _controller: Controller) -> Any:
    """Equations that were bound before, instead of binding the controller again."""
    return equations


def _assembled(problem: TrackingProblem, found: Sequence[Bound], simulation: Simulation, parts: Parts) -> Case:
    """The case, once its parts have been checked for agreement."""
    controllers = tuple(controller for controller, _ in found)
    require_controllers(controllers)
    by_tolerance = simulation.tolerance is not None
    if problem.delay > 0 and not by_tolerance:
        delay.lag(problem.delay, simulation.dt)  # rejects a delay that this step can't represent
    if problem.noise is not None and not by_tolerance:
        whole_steps("sensor.noise.sample_time", problem.noise.sample_time, simulation)
    for controller, equations in found:
        fits = problem, controller, simulation
        if all(one is other for one, other in zip(fits, parts.fitting.get(id(controller), (None,) * 3), strict=True)):
            continue
        with within(controller.name):
            loop = ClosedLoop.of(problem, controller, bind=partial(_already_bound, equations))
            if by_tolerance:
                require_known_instants(loop, problem, simulation)
            else:
                Rhythm.of(loop, None, simulation)  # rejects events between steps
        if not parts.complete:
            parts.fitting[id(controller)] = fits
    return Case(problem, controllers, simulation, tuple(equations for _, equations in found))
