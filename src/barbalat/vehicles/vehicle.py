"""The declaration of a vehicle. From it, the engine flies the vehicle, draws random variations of it, and shows the results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar

from barbalat.discovery import slices
from barbalat.open_numbers.path import FieldPath
from barbalat.run.kernel.sampled_controller import Flyable
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.spread import Uniform
from barbalat.validate import Array, InputError, show
from barbalat.vehicles.flight import Failing, Flight, Timing
from barbalat.vehicles.schemes import Loop, Numbers, Scheme

SEED = 2013
Draw = Mapping[str, float]
"""The random numbers of one vehicle, keyed by name."""
Model = TypeVar("Model")
"""A trimmed vehicle with its linear model."""
Pilot = TypeVar("Pilot")
"""A whole controller in the process in which it flies."""
Flew = TypeVar("Flew", bound=Flight)


@dataclass(frozen=True, eq=False, kw_only=True)
class Aboard:
    """A scheme on a vehicle: the controllers that close the vehicle's loops, in the order of the loops."""

    name: str
    loops: tuple[Flyable, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """How a campaign draws variations of a vehicle, the timing of its flights, and the words for its results.

    drawn       the distribution of each number, by name
    units       the units of numbers; a number without a unit is a factor of its nominal value
    conditions  the flight conditions, which the draws use in turn, in words and in the form for ``Vehicle.nominal``
    travel      the metric for the distance that something moves per second, and a word for it
    beside      the scheme with which all others are compared, if it flies, and a short name for it
    set_by      the rule by which the parameters of the schemes were found
    chunk       number of flights of a process before their rows are stored; these take about half a minute
    """

    drawn: Mapping[str, Uniform]
    units: Mapping[str, str]
    conditions: Mapping[str, Any]
    timing: Timing
    travel: tuple[str, str]
    beside: tuple[str, str]
    set_by: str
    chunk: int

    def plan(self, members: int, seed: int = SEED) -> Plan:
        """Return a plan of independent draws, so the intervals of fractions are exact."""
        draws = {FieldPath(("dispersion", name)): one for name, one in self.drawn.items()}
        return Plan(draws=draws, members=members, design=Design.RANDOM, seed=seed)


def draws_of(plan: Plan, first: int, count: int) -> Iterator[tuple[int, Draw]]:
    """Yield members from number ``first`` on, each with its number."""
    names = [str(path.keys[1]) for path in plan.paths]
    for number, row in enumerate(plan.values(first, count).tolist(), start=first):
        yield number, dict(zip(names, row, strict=True))


@dataclass(frozen=True)
class DelaySearch:
    """How the largest added delay is found: with a resolution of ``step`` [s], by trials ``stride`` steps apart up to ``most``
    steps."""

    step: float
    stride: int
    most: int


@dataclass(frozen=True)
class Shown(Generic[Flew]):
    """A panel of the picture of flights, with a quantity of each flight and columns of the longest record.

    beside  (column, label, colour, dash) of each line that is the same for all flights, such as a command
    """

    title: str
    unit: str
    value: Callable[[Flew], Array]
    beside: tuple[tuple[str, str, str, int], ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Vehicle(ABC, Generic[Model, Pilot, Flew]):
    """A simulated vehicle with one task for sampled controllers. A package lists its vehicles as ``VEHICLES`` in its module
    ``vehicle``.

    A vehicle is pickled into the processes that fly.

    name       name on the command line
    meaning    what flies, in words
    failures   what can fail, "none" first
    schemes    the schemes that can fly it, by their names on the command line
    numbers    parameters of the schemes, by ``Loop.like`` and scheme
    timing     the timing of its flights
    drawing    how a campaign draws variations of it
    """

    name: str
    meaning: str
    failures: tuple[Failing, ...]
    schemes: Mapping[str, Scheme]
    numbers: Mapping[str, Mapping[str, Numbers]]
    timing: Timing
    drawing: Drawing

    simulator: ClassVar[str]
    """The package that simulates the vehicle."""
    dispersion: ClassVar[Callable[..., Any]]
    """A function from a draw's values, by name, and its ``number`` to the dispersion for ``fly``. Without arguments it returns
    the dispersion of the nominal vehicle."""
    delays: ClassVar[DelaySearch]
    own_loops: ClassVar[int | None] = None
    """How many loops, counted from the first, a user's controller closes; the scheme ``own_rest`` closes the others. None means
    all loops."""
    own_rest: ClassVar[str] = ""
    headings: ClassVar[tuple[str, ...]]
    """The headings of a table of metrics, after the controller's name."""
    length: ClassVar[str]
    """The unit of ``Flight.path``."""
    equal_lengths: ClassVar[bool] = True
    """Whether lengths have the same scale on all axes, which is impossible for a flight of miles at one height."""
    wire: ClassVar[tuple[Array, ...]]
    """The vehicle's frame in films: lines (P, 3) in the body's axes forward, left and up, of size 1."""
    shown: ClassVar[str]
    """The contents of the picture, in words."""
    notes: ClassVar[tuple[str, ...]]
    """Notes for readers of the tables of metrics."""

    def condition(self, given: Mapping[str, float]) -> Any:
        """Return the argument of ``require`` and ``nominal`` for the options ``--altitude`` and ``--mach``."""
        return given

    @abstractmethod
    def require(self, condition: Any, equipment: Any) -> None:
        """Raise InputError if the vehicle cannot fly at this condition or with this equipment. None means the vehicle's own
        condition or equipment."""

    @abstractmethod
    def nominal(self, condition: Any = None, equipment: Any = None) -> Model:
        """Return the trimmed vehicle with its linear model, computed by the simulator in a separate process. Raises InputError if
        the simulator is not installed."""

    @abstractmethod
    def loops(self, model: Model) -> Sequence[Loop]:
        """Return the loops that schemes close."""

    @abstractmethod
    def pilot(self, model: Model, aboard: Aboard) -> Pilot:
        """Return the whole controller of a scheme. It is made once in each process."""

    @abstractmethod
    def fly(self, model: Model, pilot: Pilot, failures: Sequence[Any], dispersion: Any, timing: Timing) -> list[Flew]:
        """Fly through each of the failures with the vehicle of a dispersion."""

    @abstractmethod
    def delayed(self, seconds: float) -> Failing:
        """Return the failure that delays commands by this much."""

    @abstractmethod
    def broken(self, controller: str, failure: Any, why: str) -> Flew:
        """Return the record of a flight in which the simulator failed, a single row of zeros."""

    @abstractmethod
    def contents(self, model: Model, aboard: Sequence[Aboard]) -> Iterator[bytes]:
        """Yield everything that determines the flights, except the draws, the failures and the simulator."""

    @property
    @abstractmethod
    def columns(self) -> dict[str, str]:
        """The columns of a flight's record, as in ``Flight.columns``."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """The metrics of a flight with their units, as in ``Flight.units``."""

    @property
    @abstractmethod
    def panels(self) -> Sequence[Shown[Flew]]:
        """The panels of the picture of its flights."""

    @abstractmethod
    def headline(self, model: Model) -> str:
        """Return a title: what flies, and the error by which flights are ranked."""

    @abstractmethod
    def cells(self, figures: Mapping[str, float | None]) -> list[str]:
        """Return a row of the table of metrics for a flight that kept control."""

    @abstractmethod
    def facts(self, model: Model, version: str) -> list[tuple[str, str]]:
        """Return labelled facts on the flight condition, the linear model, and the computation by this version of the
        simulator."""

    @abstractmethod
    def details(self, model: Model, version: str) -> dict[str, Any]:
        """Return the flight condition, the linear model and the simulator for the document of ``--json``."""


GROUP = "barbalat.vehicles"
"""The group of entry points for vehicles from outside this package."""


@cache
def vehicles() -> dict[str, Vehicle[Any, Any, Any]]:
    """Return all vehicles by their names on the command line. Raises InputError if two have the same name, or if an entry point
    cannot be imported."""
    found: dict[str, Vehicle[Any, Any, Any]] = {}
    for module in slices(__package__, GROUP, "vehicle"):
        for vehicle in module.VEHICLES:
            if vehicle.name in found:
                raise InputError(f"two vehicles have the name {vehicle.name!r}, the second in {module.__name__}")
            found[vehicle.name] = vehicle
    return found


def vehicle_of(name: str) -> Vehicle[Any, Any, Any]:
    """Return the vehicle with this name. Raises InputError for an unknown name."""
    if name not in vehicles():
        raise InputError(f"NAME must be one of {', '.join(vehicles())}, got {show(name)}")
    return vehicles()[name]
