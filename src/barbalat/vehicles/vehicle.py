"""The declaration of a vehicle, by which the engine flies it, draws random variations of it, and shows the results."""

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
"""The random numbers of one vehicle, by name."""
Model = TypeVar("Model")
"""A trimmed vehicle with its linear model."""
Pilot = TypeVar("Pilot")
"""A whole controller in the process in which it flies."""
Flew = TypeVar("Flew", bound=Flight)


@dataclass(frozen=True, eq=False, kw_only=True)
class Aboard:
    """A scheme on a vehicle: the controllers that close the vehicle's loops, in their order."""

    name: str
    loops: tuple[Flyable, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """How a campaign draws variations of a vehicle, how long they fly, and the words for the results.

    drawn       the distribution of each number, by its name
    units       the units of these; the others are factors on nominal values
    conditions  the flight conditions of the draws, in turn: in words, and as ``Vehicle.nominal`` takes them
    travel      the figure for how far something moves in a second, and its name in a word
    beside      the scheme with which all are compared if it flies, and a short name for it
    set_by      the rule by which the schemes' numbers were found
    chunk       number of flights of a process before their rows are stored: half a minute's
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
        """Independent draws, so that the intervals of shares are exact."""
        draws = {FieldPath(("dispersion", name)): one for name, one in self.drawn.items()}
        return Plan(draws=draws, members=members, design=Design.RANDOM, seed=seed)


def draws_of(plan: Plan, first: int, count: int) -> Iterator[tuple[int, Draw]]:
    """Members from number ``first`` on, each with its number."""
    names = [str(path.keys[1]) for path in plan.paths]
    for number, row in enumerate(plan.values(first, count).tolist(), start=first):
        yield number, dict(zip(names, row, strict=True))


@dataclass(frozen=True)
class DelaySearch:
    """How the largest added delay is found: to ``step`` [s], by trials ``stride`` steps apart up to ``most`` steps."""

    step: float
    stride: int
    most: int


@dataclass(frozen=True)
class Shown(Generic[Flew]):
    """A panel of the picture of flights: a quantity of each, and columns of the longest record beside it.

    beside  (column, label, colour, dash) of each line that is the same for all flights, such as a command
    """

    title: str
    unit: str
    value: Callable[[Flew], Array]
    beside: tuple[tuple[str, str, str, int], ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Vehicle(ABC, Generic[Model, Pilot, Flew]):
    """A simulated vehicle with one task that sampled controllers fly: a package's module ``vehicle`` lists its own as
    ``VEHICLES``.

    It is pickled into the processes that fly.

    name       its name on the command line
    meaning    what flies, in words
    failures   what can fail, "none" first
    schemes    the schemes that can fly it, by their names on the command line
    numbers    the schemes' numbers, by ``Loop.like`` and schemes
    timing     of its flights
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
    """The package that simulates it."""
    dispersion: ClassVar[Callable[..., Any]]
    """A function from a draw's values, by name, and its ``number`` to the arguments of ``fly``; without arguments it gives the
    nominal vehicle."""
    delays: ClassVar[DelaySearch]
    own_loops: ClassVar[int | None] = None
    """Number of loops, the first ones, that a user's own controller closes; the scheme ``own_rest`` closes the others. None:
    all."""
    own_rest: ClassVar[str] = ""
    headings: ClassVar[tuple[str, ...]]
    """The heads of a table of figures, after the controller's name."""
    length: ClassVar[str]
    """The unit of ``Flight.path``."""
    equal_lengths: ClassVar[bool] = True
    """Whether lengths have the same scale on all axes, which is impossible for a flight of miles at one height."""
    wire: ClassVar[tuple[Array, ...]]
    """Lines (P, 3) in the body's axes forward, left, up, of size 1: its frame in films."""
    shown: ClassVar[str]
    """The contents of its picture, in words."""
    notes: ClassVar[tuple[str, ...]]
    """Notes for readers of the tables of figures."""

    def condition(self, given: Mapping[str, float]) -> Any:
        """The argument of ``require`` and ``nominal``, from the given options ``--altitude`` and ``--mach``."""
        return given

    @abstractmethod
    def require(self, condition: Any, equipment: Any) -> None:
        """InputError if it can't fly at this condition, or with this equipment; None stands for its own."""

    @abstractmethod
    def nominal(self, condition: Any = None, equipment: Any = None) -> Model:
        """Trimmed and linearised, by the simulator in its own process; InputError if it is not installed."""

    @abstractmethod
    def loops(self, model: Model) -> Sequence[Loop]:
        """The loops that schemes close."""

    @abstractmethod
    def pilot(self, model: Model, aboard: Aboard) -> Pilot:
        """A scheme's whole controller, made once in each process."""

    @abstractmethod
    def fly(self, model: Model, pilot: Pilot, failures: Sequence[Any], dispersion: Any, timing: Timing) -> list[Flew]:
        """A flight through each of the failures, with the vehicle that a dispersion gives."""

    @abstractmethod
    def delayed(self, seconds: float) -> Failing:
        """The failure by which commands arrive this much later."""

    @abstractmethod
    def broken(self, controller: str, failure: Any, why: str) -> Flew:
        """The record of a flight in which the simulator failed: one row of zeros."""

    @abstractmethod
    def contents(self, model: Model, aboard: Sequence[Aboard]) -> Iterator[bytes]:
        """Everything that determines its flights, other than the draws, the failures and the simulator."""

    @property
    @abstractmethod
    def columns(self) -> dict[str, str]:
        """What a flight's record holds, as ``Flight.columns``."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """A flight's figures, as ``Flight.units``."""

    @property
    @abstractmethod
    def panels(self) -> Sequence[Shown[Flew]]:
        """What the picture of its flights shows."""

    @abstractmethod
    def headline(self, model: Model) -> str:
        """What flies, and by which error flights are ranked."""

    @abstractmethod
    def cells(self, figures: Mapping[str, float | None]) -> list[str]:
        """A row of the table of figures, for a flight that kept control."""

    @abstractmethod
    def facts(self, model: Model, version: str) -> list[tuple[str, str]]:
        """The flight condition, the linear model, and how this version of the simulator computes it."""

    @abstractmethod
    def details(self, model: Model, version: str) -> dict[str, Any]:
        """The flight condition, the linear model and the simulator, for the document of ``--json``."""


GROUP = "barbalat.vehicles"
"""The group of entry points for vehicles from outside this package."""


@cache
def vehicles() -> dict[str, Vehicle[Any, Any, Any]]:
    """All vehicles by their names on the command line; InputError if two have the same name, or an entry point can't be
    imported."""
    found: dict[str, Vehicle[Any, Any, Any]] = {}
    for module in slices(__package__, GROUP, "vehicle"):
        for vehicle in module.VEHICLES:
            if vehicle.name in found:
                raise InputError(f"two vehicles have the name {vehicle.name!r}, the second in {module.__name__}")
            found[vehicle.name] = vehicle
    return found


def vehicle_of(name: str) -> Vehicle[Any, Any, Any]:
    """The vehicle of this name; InputError for an unknown one."""
    if name not in vehicles():
        raise InputError(f"NAME must be one of {', '.join(vehicles())}, got {show(name)}")
    return vehicles()[name]
