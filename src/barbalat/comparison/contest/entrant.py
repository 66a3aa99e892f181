"""Entrants of a contest, which are schemes with tuned settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.comparison.grids import reach_of, unresolved
from barbalat.comparison.ranges import BEYOND_GRID, Range, Space
from barbalat.controllers import SCHEMES, BaselineAlone, Sampled
from barbalat.controllers.sampled import DISCRETIZATIONS
from barbalat.controllers.tuning_grid import Tunable, TuningGrid
from barbalat.judge.settings import Judge
from barbalat.loop.binding import bound
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import Varied
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Discretizable, SampledEquations
from barbalat.settings import Settings
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

SAMPLED_GAINS_BEYOND = 100.0
"""Factor by which the range of a sampled law's gain extends, because the solver step does not limit it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrant(Settings):
    """A scheme in a contest.

    knobs  the tuned settings, each searched over its range on a logarithmic scale; ``make`` builds the controller. Without knobs
           the controller is not tuned
    reads  the form in which the scheme reads the contest's problem: the same plant with a different regressor; by default
           unchanged
    """

    knobs: TuningGrid
    reads: Callable[[Problem], Problem] = lambda problem: problem

    def __post_init__(self) -> None:
        validate.instance("knobs", self.knobs, TuningGrid)

    @property
    def name(self) -> str:
        return self.knobs.scheme

    @property
    def space(self) -> Space:
        """The ranges of the search for the entrant's numbers."""
        found = {}
        for name, values in self.knobs.values.items():
            beyond = BEYOND_GRID if name in self.knobs.open else 1.0
            found[FieldPath((name,))] = Range(float(min(values)) / beyond, float(max(values)) * beyond, logarithmic=True)
        return Space(found)

    def controller(self, row: Sequence[float] | Array) -> Controller:
        """Return the controller with these numbers for the knobs."""
        return self.knobs.make(**dict(zip(self.knobs.values, map(float, row), strict=True)))

    def starting_at(self, theta_hat0: Array) -> Entrant:
        """Return the entrant with estimates that start at ``theta_hat0`` (p,), if its class has a field of that name.

        If ``knobs`` has set a value other than the default of the field, that value is kept.
        """
        make = self.knobs.make

        def made(**tuning: float) -> Controller:
            controller: Controller = _with_start(make(**tuning), theta_hat0)
            return controller

        return replace(self, knobs=replace(self.knobs, make=made))

    @classmethod
    def as_set(cls, controller: Controller) -> Entrant:
        """Return an entrant for a controller that is not tuned."""
        return cls(knobs=TuningGrid(scheme=controller.name, values={}, make=lambda: controller))

    def sampled(self, sample_time: float, discretization: str = DISCRETIZATIONS[0]) -> Entrant:
        """Return the entrant in the form that a flight computer runs."""
        make = self.knobs.make

        def made(**tuning: float) -> Controller:
            return Sampled(make(**tuning), sample_time, discretization=discretization)

        return replace(self, knobs=replace(self.knobs, make=made))


@dataclass(frozen=True, eq=False)
class VariedEntrant(Varied):
    """The tunings of an entrant as cases that contain only its controller."""

    entrant: Entrant
    problem: Problem
    simulation: Simulation
    paths: tuple[FieldPath, ...]
    judge: Judge

    @property
    def source(self) -> str:
        return f"{self.entrant.knobs!r}"

    def at(self, values: Sequence[float] | Array) -> Case:
        controller = self.entrant.controller(values)
        bound(self.problem, controller)
        return Case(self.problem, (controller,), self.simulation, judge=self.judge)


def entrants_of(
    problem: Problem,
    simulation: Simulation,
    *,
    schemes: Sequence[str] = (),
    own: Sequence[Controller] = (),
    sample_time: float | None = None,
    ours: bool = True,
) -> tuple[list[Entrant], list[str]]:
    """Return the registered schemes that declare tuned settings and support the problem, and sentences on the omitted schemes.

    schemes      names in case files; by default all
    own          user-defined controllers; those that declare tuned settings take part too
    sample_time  sample time of all [s], in midpoint form, or with Euler steps if a scheme has no such form; by default,
                 continuous controllers stay continuous
    ours         whether the registered schemes take part

    All entrants start with the same knowledge. Their estimates start in the middle of the known set, or at a baseline's
    parameters, which linear designs assume as well. A baseline also takes part without adaptation. If the input saturates, each
    scheme uses its windup remedy. A user-defined controller starts at the same estimates if its class has a field ``theta_hat0``,
    or if its ``knobs`` pass on ``reach.theta_hat0``. For any other controller, ``starts.start_of`` reports the start.
    """
    if unknown := [name for name in schemes if name not in SCHEMES]:
        raise InputError(f"--schemes must be one of {', '.join(SCHEMES)}, got {validate.show(unknown[0])}")
    reach, how = reach_of(problem, simulation)
    theta_set, theta_0 = problem.known.theta_set, problem.known.theta_0
    if sample_time is None:
        left_out = [f"{unresolved(reach.highest_gain, how, simulation)}, are not tried"]
    else:
        reach = reach.sampled(sample_time, SAMPLED_GAINS_BEYOND)
        left_out = [f"adaptive gains above {reach.highest_gain:.2g} and time constants below {reach.times[0]:g} s are not tried"]
    reach = replace(
        reach,
        theta_hat0=theta_0 if theta_0 is not None or theta_set is None else theta_set.middle,
        saturated=problem.known.saturation is not None,
    )
    asked = schemes or [name for name, kind in SCHEMES.items() if kind is not BaselineAlone or theta_0 is not None]
    candidates = [(name, SCHEMES[name]) for name in (asked if ours else ())]
    found, outside = [], {id(one) for one in own}
    for name, one in [*candidates, *((one.name, one) for one in own)]:
        if not isinstance(one, Tunable):
            left_out.append(f"{name} is omitted: it declares no tunable setting")
            continue
        entrant = Entrant(knobs=one.knobs(reach))
        if id(one) in outside and reach.theta_hat0 is not None:
            entrant = _from_the_middle(entrant, problem, reach.theta_hat0)
        try:
            by_nature = isinstance(bound(problem, _first(entrant)), SampledEquations)
            if not by_nature and sample_time is not None:
                entrant = _sampled(entrant, problem, sample_time)
            found.append(entrant)
        except InputError as error:
            left_out.append(f"{entrant.name} is omitted: {error}")
    return found, left_out


def _sampled(entrant: Entrant, problem: Problem, sample_time: float) -> Entrant:
    """Return the entrant's midpoint form, or its form with Euler steps if it has no midpoint form."""
    of_its_own = isinstance(bound(problem, _first(entrant)), Discretizable)
    found = entrant.sampled(sample_time, DISCRETIZATIONS[0 if of_its_own else 1])
    bound(problem, _first(found))
    return found


def _from_the_middle(entrant: Entrant, problem: Problem, middle: Array) -> Entrant:
    """Return the user-defined entrant with its estimates in the middle, or unchanged if its ``theta_hat0`` means something
    else."""
    moved = entrant.starting_at(middle)
    try:
        bound(problem, _first(moved))
    except InputError:
        return entrant  # it is rejected for a different reason, or has a separate start, which ``starts`` reports
    return moved


def _with_start(controller: Any, theta_hat0: Array) -> Any:
    """Return the controller with this field changed, if its class has the field and its value is the default."""
    if not is_dataclass(controller) or isinstance(controller, type):
        return controller
    found = next((one for one in fields(controller) if one.name == "theta_hat0" and one.init), None)
    if found is None:
        return controller
    default = found.default_factory() if found.default_factory is not MISSING else found.default
    given = getattr(controller, found.name)
    left_alone = default is not MISSING and (given is default or np.array_equal(given, default))
    return replace(controller, **{found.name: theta_hat0}) if left_alone else controller


def _first(entrant: Entrant) -> Controller:
    """Return the controller with the smallest value of each knob."""
    return entrant.controller([values[0] for values in entrant.knobs.values.values()])
