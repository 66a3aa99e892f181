"""Binds controllers to problems: checks that they fit, and returns a controller's equations for a problem."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import chain, count
from typing import Any, TypeGuard

import numpy as np

from barbalat import validate
from barbalat.loop.checking import Ports, check_equations
from barbalat.loop.structure import comes_from_outside, identical, parts_of, structure
from barbalat.loop.user_errors import Subject, telling_user_errors
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Equations, SampledEquations, feedback_of
from barbalat.validate import InputError

_sampled: dict[type, bool] = {}


def is_sampled(equations: Equations | SampledEquations) -> TypeGuard[SampledEquations]:
    """Whether equations act at samples; cached by class, because the check is slow and every member needs it."""
    kind = type(equations)
    if kind not in _sampled:
        _sampled[kind] = isinstance(equations, SampledEquations)
    return _sampled[kind]


_checked: set[Hashable] = set()
"""The structures of equations that passed the check."""


def bound(problem: TrackingProblem, controller: Controller) -> Equations | SampledEquations:
    """The controller's equations for this problem; raises InputError for an object that is not a controller, or for a controller
    that needs a different measurement.

    Equations that involve a user-defined class are checked once for each structure (see ``check_controller``). The tests of the
    package apply the same checks to its equations.
    """
    outside = comes_from_outside(controller)
    equations = _equations(problem, controller, outside=outside)
    if outside or comes_from_outside(equations):
        ports = ports_of(problem)
        key = tuple(port.shape for port in ports), *structure(equations)
        if key not in _checked:
            check_equations(equations, ports, subject_of(controller))
            _checked.add(key)
    return equations


Bind = Callable[[TrackingProblem, Controller], Equations | SampledEquations]
"""A function that returns a controller's equations for a problem."""


class Bindings:
    """``bound`` for many members of one structure. The caller compares the structures, so only the first member is checked.

    Members with the same controller and the same known part of the plant, which is all that ``bind`` receives, share their
    equations; of members that differ only in theta, only the first is bound.
    """

    def __init__(self) -> None:
        self._last: tuple[Controller, Any, Equations | SampledEquations] | None = None
        self._outside = False  # whether the first member, and therefore every member, involves a user-defined class

    def __call__(self, problem: TrackingProblem, controller: Controller) -> Equations | SampledEquations:
        known = problem.known
        if self._last is None:
            found = bound(problem, controller)
            self._outside = comes_from_outside(controller)
        elif identical(controller, self._last[0]) and identical(known, self._last[1]):
            return self._last[2]
        elif type(controller) is type(self._last[0]) and not self._outside:
            found = controller.bind(known)
        else:
            found = _equations(problem, controller, outside=comes_from_outside(controller))
        self._last = controller, known, found
        return found


def check_controller(controller: Controller, problem: TrackingProblem) -> None:
    """Try a controller's equations on a problem as a run does; useful for testing your own classes.

    Each equation is evaluated on numbers and on symbols at a few states, and the two are compared, so that the traced equations
    are known to agree with the code. Raises InputError with the class, the equation, its shape and the required shape.
    """
    validate.instance("problem", problem, TrackingProblem)
    equations = _equations(problem, controller, outside=comes_from_outside(controller))
    check_equations(equations, ports_of(problem), subject_of(controller))


def _equations(problem: TrackingProblem, controller: Controller, *, outside: bool) -> Equations | SampledEquations:
    require_controllers([controller])
    feedback = feedback_of(controller)
    if feedback != problem.feedback:
        raise Subject(controller.name, controller.name).error(
            f" feeds back the {feedback}, but the problem measures the {problem.feedback}"
        )
    if not outside:
        return controller.bind(problem.known)
    with telling_user_errors(subject_of(controller).part(": bind")):
        return controller.bind(problem.known)


def subject_of(controller: Controller) -> Subject:
    """The name of a controller in a message: its class and its name."""
    return Subject(f"{type(controller).__name__} {validate.show(controller.name)}", controller.name)


def ports_of(problem: TrackingProblem) -> Ports:
    """The values that the problem passes to equations."""
    commands = len(problem.commands) if isinstance(problem.reference, tuple) else None
    found = Ports.of(problem.dynamics, problem.model, commands, len(problem.plant.paths))
    if problem.fixed is None:
        return found
    whole = np.concatenate([found.y, np.zeros(problem.fixed.order)])
    return found._replace(y=whole, y_m=np.asarray(problem.model.x0, dtype=float))


def require_controllers(controllers: Sequence[Any]) -> None:
    """Raise InputError for an object that is not a controller, and for two controllers with the same name."""
    for controller in controllers:
        if not validate.is_instance(controller, Controller) or isinstance(controller, type):
            raise InputError(f"a controller must have a name and a method bind, got {validate.show(controller)}")
        validate.label(f"the name of a {type(controller).__name__}", controller.name)
    names = [controller.name for controller in controllers]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"every controller needs a different name, but {twice[0]!r} occurs {names.count(twice[0])} times")


def numbered(controllers: Controller | Iterable[Controller]) -> tuple[Controller, ...]:
    """Return any collection of controllers, or a single one, as a tuple. If several have the same name, all but the first get a
    number: MRAC, MRAC 2.

    Raises InputError for an object that is not a controller, and for a duplicate name if the class has no field for it.
    """
    given: Any = (controllers,) if isinstance(controllers, Controller) else controllers
    if isinstance(given, (str, bytes, Mapping)) or not isinstance(given, Iterable):
        raise InputError(f"controllers must be a list of controllers, got {validate.show(controllers)}")
    found: list[Controller] = []
    for controller in given:
        require_controllers([controller])
        taken = {other.name for other in found}
        names = (f"{controller.name} {i}" for i in count(2))
        free = next(name for name in chain([controller.name], names) if name not in taken)
        found.append(controller if free == controller.name else _renamed(controller, free))
    if not found:
        raise InputError("at least one controller is needed, got none")
    require_controllers(found)
    return tuple(found)


def _renamed(controller: Any, name: str) -> Any:
    """A copy with a different name; the controller itself if its class does not allow this, which is then rejected as a
    duplicate."""
    own = tuple(one.name for one in fields(controller) if one.init) if is_dataclass(controller) else ()
    if "name" in own:
        return replace(controller, name=name)
    for field, part in (parts_of(controller) or {}).items():
        # its name is that of the inner controller
        if field in own and isinstance(part, Controller) and part.name == controller.name:
            return replace(controller, **{field: _renamed(part, name)})
    return controller
