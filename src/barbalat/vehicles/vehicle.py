"""What a vehicle says of itself, so that the engine flies it, draws others like it, and shows what came out."""

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
"""What is drawn of one vehicle, by names."""
Model = TypeVar("Model")
"""A vehicle where it is trimmed, with its linear model."""
Pilot = TypeVar("Pilot")
"""A whole controller in the process in which it flies."""
Flew = TypeVar("Flew", bound=Flight)


@dataclass(frozen=True, eq=False, kw_only=True)
class Aboard:
    """A scheme on a vehicle: what closes each of the vehicle's loops, in their order."""

    name: str
    loops: tuple[Flyable, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """How a campaign draws vehicles like this one, how long it flies them, and its words for what comes out.

    drawn       from what each number is drawn, by its name
    units       the units of these; the others are factors of what is nominal
    conditions  where the draws fly, in turns: in words, and as ``Vehicle.nominal`` takes it
    travel      the figure that says how far something moves in a second, and what that is, in a word
    beside      the scheme with which all are compared where it flies, and a short name for it
    set_by      the rule that set the schemes' numbers
    chunk       flights that a process flies before their rows are kept: half a minute's
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

    beside  (column, label, colour, dash) of each line that is the same for all flights: what is commanded
    """

    title: str
    unit: str
    value: Callable[[Flew], Array]
    beside: tuple[tuple[str, str, str, int], ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Vehicle(ABC, Generic[Model, Pilot, Flew]):
    """Something that sampled controllers fly, doing one thing: a package's module ``vehicle`` lists its own as ``VEHICLES``.

    It is pickled into the processes that fly.

    name       by which the command line knows it
    meaning    what flies, in words
    failures   what can fail, "none" first
    schemes    what can fly it, by the names of the command line
    numbers    the schemes' numbers, by ``Loop.like`` and schemes
    timing     of its flights
    drawing    how a campaign draws others like it
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
    """From what a draw has, by names, and its ``number``, to what ``fly`` takes; without arguments the nominal vehicle."""
    delays: ClassVar[DelaySearch]
    own_loops: ClassVar[int | None] = None
    """How many loops, the first ones, a controller of one's own closes; the scheme ``own_rest`` closes the others. None: all."""
    own_rest: ClassVar[str] = ""
    headings: ClassVar[tuple[str, ...]]
    """The heads of a table of figures, after the controller's name."""
    length: ClassVar[str]
    """The unit of ``Flight.path``."""
    equal_lengths: ClassVar[bool] = True
    """Whether a length is drawn as long on all axes: of a flight of miles at one height it can't be."""
    wire: ClassVar[tuple[Array, ...]]
    """Lines (P, 3) in the body's axes forward, left, up, of size 1: its frame in films."""
    shown: ClassVar[str]
    """What its picture shows, in words."""
    notes: ClassVar[tuple[str, ...]]
    """What a reader of the tables of figures has to know."""

    def condition(self, given: Mapping[str, float]) -> Any:
        """What ``require`` and ``nominal`` take, from the options ``--altitude`` and ``--mach`` that were given."""
        return given

    @abstractmethod
    def require(self, condition: Any, equipment: Any) -> None:
        """InputError where it flies at no such condition, or with no such equipment; None stands for its own."""

    @abstractmethod
    def nominal(self, condition: Any = None, equipment: Any = None) -> Model:
        """Trimmed and linearised, by the simulator in a process of its own; InputError where that is not installed."""

    @abstractmethod
    def loops(self, model: Model) -> Sequence[Loop]:
        """The loops that schemes close."""

    @abstractmethod
    def pilot(self, model: Model, aboard: Aboard) -> Pilot:
        """A scheme's whole controller, made once in a process."""

    @abstractmethod
    def fly(self, model: Model, pilot: Pilot, failures: Sequence[Any], dispersion: Any, timing: Timing) -> list[Flew]:
        """A flight through each of the failures, of the vehicle that a dispersion makes."""

    @abstractmethod
    def delayed(self, seconds: float) -> Failing:
        """What fails where commands arrive so much later."""

    @abstractmethod
    def broken(self, controller: str, failure: Any, why: str) -> Flew:
        """The flight in which the simulator broke: one row of zeros."""

    @abstractmethod
    def contents(self, model: Model, aboard: Sequence[Aboard]) -> Iterator[bytes]:
        """All that its flights follow from beside the draws, the failures and the simulator."""

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
        """What flies, and which error is ranked."""

    @abstractmethod
    def cells(self, figures: Mapping[str, float | None]) -> list[str]:
        """A row of the table of figures, of a flight that kept control."""

    @abstractmethod
    def facts(self, model: Model, version: str) -> list[tuple[str, str]]:
        """Where it flies, what its linear model is, how this version of its simulator computes it."""

    @abstractmethod
    def details(self, model: Model, version: str) -> dict[str, Any]:
        """Where it flies, its linear model and its simulator, for the document of ``--json``."""


GROUP = "barbalat.vehicles"
"""The entry points by which vehicles from outside this package are found."""


@cache
def vehicles() -> dict[str, Vehicle[Any, Any, Any]]:
    """All by the names of the command line; InputError where two have one name, or an entry point can't be imported."""
    found: dict[str, Vehicle[Any, Any, Any]] = {}
    for module in slices(__package__, GROUP, "vehicle"):
        for vehicle in module.VEHICLES:
            if vehicle.name in found:
                raise InputError(f"two vehicles are called {vehicle.name!r}, the second in {module.__name__}")
            found[vehicle.name] = vehicle
    return found


def vehicle_of(name: str) -> Vehicle[Any, Any, Any]:
    """InputError for a name that is none."""
    if name not in vehicles():
        raise InputError(f"NAME must be one of {', '.join(vehicles())}, got {show(name)}")
    return vehicles()[name]
