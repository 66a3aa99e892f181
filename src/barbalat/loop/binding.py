"""Controllers and problems brought together: what is refused, and a controller's equations for a problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from barbalat import validate
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Equations, SampledEquations, feedback_of
from barbalat.validate import InputError


def bound(problem: TrackingProblem, controller: Controller) -> Equations | SampledEquations:
    """The controller's equations for this problem; InputError for what is no controller, or one for another measurement."""
    require_controllers([controller])
    feedback = feedback_of(controller)
    if feedback != problem.feedback:
        raise InputError(f"{controller.name} feeds back the {feedback}, but the problem measures the {problem.feedback}")
    return controller.bind(problem.known)


def require_controllers(controllers: Sequence[Any]) -> None:
    """InputError for what is no controller, and for two that share a name."""
    for controller in controllers:
        if not isinstance(controller, Controller) or isinstance(controller, type):
            raise InputError(f"a controller must have a name and a method bind, got {validate.show(controller)}")
        validate.label("a controller's name", controller.name)
    names = [controller.name for controller in controllers]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"every controller needs a name of its own, but {twice[0]!r} stands {names.count(twice[0])} times")
