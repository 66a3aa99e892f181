"""Who takes part: schemes with the settings that are tuned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.comparison.grids import reach_of
from barbalat.comparison.ranges import Range, Space
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrant(Settings):
    """A scheme in a contest.

    knobs  what is tuned, each from its least to its largest value in the logarithm; ``make`` builds the controller. Without any
           the controller takes part as it is
    reads  the contest's problem as the scheme reads it, the same plant with another regressor; by default as it stands
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
        """The ranges in which the entrant's numbers are searched."""
        found = {}
        for name, values in self.knobs.values.items():
            found[FieldPath((name,))] = Range(float(min(values)), float(max(values)), logarithmic=True)
        return Space(found)

    def controller(self, row: Sequence[float] | Array) -> Controller:
        """With these numbers for the knobs."""
        return self.knobs.make(**dict(zip(self.knobs.values, map(float, row), strict=True)))

    def starting_at(self, theta_hat0: Array) -> Entrant:
        """The entrant with its estimates at ``theta_hat0`` (p,) at the start, where its class has a field of that name.

        What ``knobs`` has set to something else than the field's default stays.
        """
        make = self.knobs.make

        def made(**tuning: float) -> Controller:
            controller: Controller = _with_start(make(**tuning), theta_hat0)
            return controller

        return replace(self, knobs=replace(self.knobs, make=made))

    @classmethod
    def as_set(cls, controller: Controller) -> Entrant:
        """A controller that takes part as it is."""
        return cls(knobs=TuningGrid(scheme=controller.name, values={}, make=lambda: controller))

    def sampled(self, sample_time: float, discretization: str = DISCRETIZATIONS[0]) -> Entrant:
        """The entrant as a flight computer runs it."""
        make = self.knobs.make

        def made(**tuning: float) -> Controller:
            return Sampled(make(**tuning), sample_time, discretization=discretization)

        return replace(self, knobs=replace(self.knobs, make=made))


@dataclass(frozen=True, eq=False)
class VariedEntrant(Varied):
    """An entrant's tunings, as cases with its controller alone."""

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
    """The registered schemes that say what is tuned of them and take the problem; and, as sentences, who is left out.

    schemes      their names in case files; by default all
    own          controllers from outside: those that say what is tuned of them take part too
    sample_time  all run sampled [s], by midpoint forms, or by Euler steps where a scheme has none; by default what is
                 continuous stays so
    ours         whether the registered schemes take part

    All start from the same knowledge: estimates in the middle of the known set, or at a baseline's, which linear designs assume
    as well; a baseline takes part alone. Where
    the input saturates each with what it has against windup. One from outside starts there where its class has a field
    ``theta_hat0``, or its ``knobs`` pass on ``reach.theta_hat0``; of another one ``starts.start_of`` says where it starts.
    """
    if unknown := [name for name in schemes if name not in SCHEMES]:
        raise InputError(f"--schemes must be of {', '.join(SCHEMES)}, got {validate.show(unknown[0])}")
    reach, how = reach_of(problem, simulation)
    theta_set, theta_0 = problem.known.theta_set, problem.known.theta_0
    reach = replace(
        reach,
        theta_hat0=theta_0 if theta_0 is not None or theta_set is None else theta_set.middle,
        saturated=problem.known.saturation is not None,
        sample_time=sample_time or reach.sample_time,
    )
    unresolved = f"gains above {reach.highest_gain:.3g}, which h = {simulation.dt:g} s does not resolve ({how}: an estimate)"
    left_out = [f"{unresolved}, are not tried"]
    asked = schemes or [name for name, kind in SCHEMES.items() if kind is not BaselineAlone or theta_0 is not None]
    candidates = [(name, SCHEMES[name]) for name in (asked if ours else ())]
    found, outside = [], {id(one) for one in own}
    for name, one in [*candidates, *((one.name, one) for one in own)]:
        if not isinstance(one, Tunable):
            left_out.append(f"{name} is left out: nothing says which of its settings are tuned")
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
            left_out.append(f"{entrant.name} is left out: {error}")
    return found, left_out


def _sampled(entrant: Entrant, problem: Problem, sample_time: float) -> Entrant:
    """By its midpoint form, or by Euler steps where it has none."""
    of_its_own = isinstance(bound(problem, _first(entrant)), Discretizable)
    found = entrant.sampled(sample_time, DISCRETIZATIONS[0 if of_its_own else 1])
    bound(problem, _first(found))
    return found


def _from_the_middle(entrant: Entrant, problem: Problem, middle: Array) -> Entrant:
    """The entrant from outside with its estimates there, or as it is where its class means something else by ``theta_hat0``."""
    moved = entrant.starting_at(middle)
    try:
        bound(problem, _first(moved))
    except InputError:
        return entrant  # it is refused for itself, or starts where it starts, which ``starts`` tells
    return moved


def _with_start(controller: Any, theta_hat0: Array) -> Any:
    """The controller with this field, if its class has it and its value is the default."""
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
    """With the least of each knob."""
    return entrant.controller([values[0] for values in entrant.knobs.values.values()])
