"""What every tracking problem has, whatever is measured: commands, disturbances, sensor, and the signals that drive the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, is_dataclass, replace
from html import escape
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.actuation import InputPath, PlantInput
from barbalat.problem.baseline import FixedController
from barbalat.problem.faults import Fault, FaultSignal
from barbalat.problem.labels import Labels
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.shell import Shell
from barbalat.protocols import Dynamics, Signal
from barbalat.settings import Settings, given_of
from barbalat.signals.smooth import Clock
from barbalat.validate import Array, InputError, Vector, freeze


@dataclass(frozen=True, eq=False)
class Disturbance(Settings):
    """direction * signal(t), added to x': for what no control can cancel.

    direction  (n,)
    signal     of any kind
    """

    direction: Vector
    signal: Signal

    def __post_init__(self) -> None:
        freeze(self, direction=validate.vector("unmatched.direction", self.direction))
        require_signal("unmatched.signal", self.signal)


class Actuated(Protocol):
    """A plant, by what lies before its inputs."""

    @property
    def paths(self) -> tuple[PlantInput, ...]: ...


class MeasuredDynamics(Dynamics, Protocol):
    """A plant as a loop integrates it."""

    @property
    def outputs(self) -> int:
        """The number of measured quantities."""
        ...


class ModelDynamics(Dynamics, Protocol):
    """A reference model as a loop integrates it."""

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C from the commands to what the plant's output is to follow."""
        ...

    def remedy(self, gain: float) -> str | None:
        """A change that would make it settle at a command of which it settles at ``gain`` times; None where none is known."""
        ...


class Surroundings(NamedTuple):
    """What stands around the plant that is simulated."""

    paths: tuple[PlantInput, ...]  # before each input
    disturbance: Signal | None  # matched
    unmatched: tuple[Disturbance, ...]
    sensor: Sensor | None


class TrackingProblem:
    """What a loop, a simulation and an ensemble read of a problem, whatever is measured."""

    plant: Actuated
    reference: Signal | tuple[Signal, ...]
    disturbance: Signal | None
    sensor: Sensor | None
    labels: Labels | None
    name: str
    shell: Shell | None = None
    faults: tuple[Fault, ...] = ()
    feedback: ClassVar[str]
    """What is measured: "state" or "output"."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """After ``copy.deepcopy`` and unpickling."""
        vars(self).update(state)
        validate.read_only(self)

    def __repr__(self) -> str:
        commands = ", ".join(type(command).__name__ for command in self.commands)
        return f"<{type(self).__name__} {self.name!r}: {self.in_brief}; command {commands}>"

    def _repr_html_(self) -> str:
        """For notebooks: all that is given, a row for each."""
        return table_of(f"Problem: {self.name}", rows_of(self))

    @property
    def in_brief(self) -> str:
        """The plant, and what is known of it, in a few words."""
        return f"{len(self.plant.paths)} inputs"

    @property
    def unmatched(self) -> tuple[Disturbance, ...]:
        """Disturbances elsewhere than at the input."""
        return ()

    @property
    def output_disturbance(self) -> Signal | None:
        """What is added to the output, where one is fed back."""
        return None

    @property
    def depends_on_time(self) -> bool:
        """Whether the plant's equations contain t."""
        return False

    @property
    def known(self) -> object:
        """What the designer has."""
        raise AssertionError("a problem says what is known of it")

    @property
    def dynamics(self) -> MeasuredDynamics:
        """The plant as a loop integrates it."""
        raise AssertionError("a problem has a plant")

    @property
    def model(self) -> ModelDynamics:
        """The reference model as a loop integrates it."""
        raise AssertionError("a problem has a model")

    @property
    def fixed(self) -> FixedController | None:
        """The baseline that is already there, with states of its own; None without one."""
        return None

    @property
    def parameters(self) -> Array | None:
        """The true values of what is estimated, where the problem knows them."""
        return None

    @property
    def design(self) -> TrackingProblem:
        """The problem as controllers and certificates know it, where what is simulated is another."""
        return self

    @property
    def true_parameters(self) -> Array | None:
        """The values that estimates are compared with: of what is simulated, where it has such parameters."""
        return self.parameters

    @property
    def outside_known_set(self) -> str | None:
        """A sentence where the true values are not in the set that is known of them."""
        return None

    @property
    def surroundings(self) -> Surroundings:
        """What acts on the plant that is simulated, and how that is measured."""
        return Surroundings(self.plant.paths, self.disturbance, self.unmatched, self.sensor)

    def with_inputs(self, change: Callable[[PlantInput], PlantInput]) -> Self:
        """The problem with another path before each input."""
        paths = tuple(map(change, self.plant.paths))
        plant = replace(self.plant, input=paths[0] if len(paths) == 1 else paths)  # type: ignore[type-var]
        return replace(self, plant=plant)  # type: ignore[type-var]

    def with_sensor(self, change: Callable[[Sensor | None], Sensor | None]) -> Self:
        """The problem with another sensor."""
        return replace(self, sensor=change(self.sensor))  # type: ignore[type-var]

    @property
    def commands(self) -> tuple[Signal, ...]:
        """The reference signals, always as a tuple."""
        return self.reference if isinstance(self.reference, tuple) else (self.reference,)

    @property
    def input_paths(self) -> tuple[InputPath | None, ...]:
        """The equations of what lies before each input, without delays; None where u reaches the plant as it is."""
        return tuple(path.path for path in self.surroundings.paths)

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s]."""
        return float(self.surroundings.paths[0].delay)

    @property
    def history(self) -> Array:
        """The signal that leaves the delay before anything of the run does, for each input, (m,)."""
        return np.array([path.history for path in self.surroundings.paths])

    @property
    def sensor_lag(self) -> StateSpace | None:
        """1/(lag s + 1), through which each measured quantity comes; None without a lag."""
        sensor = self.surroundings.sensor
        if sensor is None or sensor.lag == 0:
            return None
        return TransferFunction(np.ones(1), np.array([sensor.lag, 1.0])).realise()

    @property
    def noise(self) -> Noise | None:
        """The measurement's noise; None where it has none."""
        sensor = self.surroundings.sensor
        return None if sensor is None else sensor.noise

    @property
    def measured_names(self) -> tuple[str, ...]:
        """What the measured quantities are called: by the labels, else x_1, x_2, ..., or y."""
        labels = self.labels or Labels()
        return (
            labels.of_states(int(np.size(self.model.output(self.model.x0))))
            if self.feedback == "state"
            else labels.names or ("y",)
        )

    @property
    def nominal(self) -> Self:
        """The same problem with nothing going wrong, and nothing that would be refused."""
        if self.shell is None and not self.faults:
            return self
        return replace(self, shell=None, faults=())  # type: ignore[type-var]

    def require_surroundings(self) -> None:
        """InputError where the shell or a fault names a channel that is not measured."""
        if self.shell is not None:
            validate.instance("shell", self.shell, Shell)
            self.shell.require(self.measured_names)
        if not isinstance(self.faults, (list, tuple)):
            raise InputError(f"faults must be a list of faults, got {validate.show(self.faults)}")
        for i, fault in enumerate(self.faults, start=1):
            validate.instance(f"faults {i}", fault, Fault)
            try:
                fault.require(self.measured_names)
            except InputError as error:
                raise InputError(f"faults {i} ({fault.kind}): {error}", field="faults") from None
        freeze(self, faults=tuple(self.faults))

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The time functions that drive the loop, in the order in which ``ClosedLoop`` takes them."""
        acting = self.surroundings
        matched = () if acting.disturbance is None else (acting.disturbance,)
        at_output = () if self.output_disturbance is None else (self.output_disturbance,)
        clock = (Clock(),) if self.depends_on_time else ()
        unmatched = (disturbance.signal for disturbance in acting.unmatched)
        faults = (FaultSignal(fault, place) for place, fault in enumerate(self.faults))
        return (*self.commands, *matched, *unmatched, *at_output, *clock, *faults)


def require_signal(field: str, signal: Any) -> None:
    """InputError, naming the field, for what is no signal."""
    if not validate.is_instance(signal, Signal) or isinstance(signal, type):
        raise InputError.of(field, f"must be a signal such as Sine(amplitude=1, frequency=2), got {validate.show(signal)}")


def rows_of(problem: TrackingProblem) -> dict[str, str]:
    """What is given of a problem beside its name, its plant's numbers each by itself."""
    found: dict[str, str] = {}
    given: dict[str, str] = given_of(problem) if is_dataclass(problem) else {}  # type: ignore[redundant-expr]
    for name, text in given.items():
        plant = problem.plant if name == "plant" else None
        found |= {f"plant.{inner}": value for inner, value in given_of(plant).items()} if is_dataclass(plant) else {name: text}  # type: ignore[redundant-expr]
    found.pop("name", None)
    return found


def table_of(title: str, rows: dict[str, str]) -> str:
    """Names and values as HTML."""
    cells = (f'<tr><th scope="row" style="text-align: left">{escape(name)}</th>' for name in rows)
    values = (f'<td style="text-align: left"><code>{escape(text)}</code></td></tr>' for text in rows.values())
    body = "".join(cell + value for cell, value in zip(cells, values, strict=True))
    return f"<table><caption>{escape(title)}</caption>{body}</table>"
