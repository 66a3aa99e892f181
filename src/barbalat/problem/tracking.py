"""The common base of tracking problems, whatever is measured: commands, disturbances, sensor, and the signals that drive the
loop."""

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
from barbalat.problem.faults import COMMAND, Fault, FaultSignal
from barbalat.problem.labels import UNLABELLED, Labels
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.observer import FixedObserver
from barbalat.problem.shell import Shell
from barbalat.protocols import Dynamics, Signal
from barbalat.settings import Settings, given_of
from barbalat.signals.smooth import Clock
from barbalat.validate import Array, InputError, Vector, freeze


@dataclass(frozen=True, eq=False)
class Disturbance(Settings):
    """A disturbance that no control can cancel: direction * signal(t) is added to x'.

    direction  (n,)
    signal     a signal of any kind
    """

    direction: Vector
    signal: Signal

    def __post_init__(self) -> None:
        freeze(self, direction=validate.vector("unmatched.direction", self.direction))
        require_signal("unmatched.signal", self.signal)


class Actuated(Protocol):
    """A plant with paths before its inputs."""

    @property
    def paths(self) -> tuple[PlantInput, ...]: ...


class MeasuredDynamics(Dynamics, Protocol):
    """A plant in the form that a loop integrates."""

    @property
    def outputs(self) -> int:
        """The number of measured quantities."""
        ...


class ModelDynamics(Dynamics, Protocol):
    """A reference model in the form that a loop integrates."""

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C from the commands to the output that the plant's output should follow."""
        ...

    def remedy(self, gain: float) -> str | None:
        """Return a change with which the model would settle at the command, if it now settles at ``gain`` times the command; None
        if no such change is known."""
        ...


class Surroundings(NamedTuple):
    """The surroundings of the simulated plant."""

    paths: tuple[PlantInput, ...]  # before each input
    disturbance: Signal | None  # matched
    unmatched: tuple[Disturbance, ...]
    sensor: Sensor | None


class TrackingProblem:
    """The attributes of a problem that loops, simulations and ensembles use, whatever is measured."""

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
        """Restore after ``copy.deepcopy`` and unpickling."""
        vars(self).update(state)
        validate.read_only(self)

    def __repr__(self) -> str:
        commands = ", ".join(type(command).__name__ for command in self.commands)
        return f"<{type(self).__name__} {self.name!r}: {self.in_brief}; command {commands}>"

    def _repr_html_(self) -> str:
        """Return a table for notebooks, with a row for each input of the problem."""
        return table_of(f"Problem: {self.name}", rows_of(self))

    @property
    def in_brief(self) -> str:
        """The plant and its uncertainty in a few words."""
        return f"{len(self.plant.paths)} inputs"

    @property
    def unmatched(self) -> tuple[Disturbance, ...]:
        """The disturbances that do not act at the input."""
        return ()

    @property
    def output_disturbance(self) -> Signal | None:
        """The signal that is added to the output, with output feedback."""
        return None

    @property
    def depends_on_time(self) -> bool:
        """Whether the plant's equations contain t."""
        return False

    @property
    def known(self) -> object:
        """The part of the problem that the designer knows."""
        raise AssertionError("a problem must declare what is known about it")

    @property
    def dynamics(self) -> MeasuredDynamics:
        """The plant in the form that a loop integrates."""
        raise AssertionError("a problem has a plant")

    @property
    def model(self) -> ModelDynamics:
        """The reference model in the form that a loop integrates."""
        raise AssertionError("a problem has a model")

    @property
    def fixed(self) -> FixedController | None:
        """The existing baseline with its states; None without a baseline."""
        return None

    @property
    def parameters(self) -> Array | None:
        """The true values of the estimates, if the problem knows them."""
        return None

    @property
    def design(self) -> TrackingProblem:
        """The problem for controllers and certificates, without the truth."""
        return self

    @property
    def true_parameters(self) -> Array | None:
        """The values with which estimates are compared, which are those of the simulated plant if it has such parameters."""
        return self.parameters

    @property
    def outside_known_set(self) -> str | None:
        """A sentence that the true values are outside the known set; otherwise None."""
        return None

    @property
    def surroundings(self) -> Surroundings:
        """The paths and disturbances of the simulated plant, and its measurement."""
        return Surroundings(self.plant.paths, self.disturbance, self.unmatched, self.sensor)

    def with_inputs(self, change: Callable[[PlantInput], PlantInput]) -> Self:
        """Return the problem with a changed path before each input."""
        paths = tuple(map(change, self.plant.paths))
        plant = replace(self.plant, input=paths[0] if len(paths) == 1 else paths)  # type: ignore[type-var]
        return replace(self, plant=plant)  # type: ignore[type-var]

    def with_sensor(self, change: Callable[[Sensor | None], Sensor | None]) -> Self:
        """Return the problem with a changed sensor."""
        return replace(self, sensor=change(self.sensor))  # type: ignore[type-var]

    @property
    def commands(self) -> tuple[Signal, ...]:
        """The reference signals as a tuple."""
        return self.reference if isinstance(self.reference, tuple) else (self.reference,)

    @property
    def input_paths(self) -> tuple[InputPath | None, ...]:
        """The equations of the path before each input, without delays; None if u reaches the plant unchanged."""
        return tuple(path.path for path in self.surroundings.paths)

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s]."""
        return float(self.surroundings.paths[0].delay)

    @property
    def history(self) -> Array:
        """The constant control (m,) applied before the run, which leaves the delay of each input first."""
        return np.array([path.history for path in self.surroundings.paths])

    @property
    def sensor_lag(self) -> StateSpace | None:
        """The filter 1/(lag s + 1) of each measured quantity; None without a lag."""
        sensor = self.surroundings.sensor
        if sensor is None or sensor.lag == 0:
            return None
        return TransferFunction(np.ones(1), np.array([sensor.lag, 1.0])).realise()

    @property
    def noise(self) -> Noise | None:
        """The measurement noise; None without noise."""
        sensor = self.surroundings.sensor
        return None if sensor is None else sensor.noise

    @property
    def fixed_observer(self) -> FixedObserver | None:
        """The observer of a state that is not measured; None without one."""
        return None

    @property
    def measured(self) -> int:
        """The number of measured quantities."""
        return self.dynamics.outputs

    @property
    def measured_names(self) -> tuple[str, ...]:
        """The names of the measured quantities."""
        return self.followed_names

    @property
    def measured_labels(self) -> Labels | None:
        """Names and units of the measured quantities, if the case gives them."""
        return self.labels

    @property
    def handed_controls(self) -> tuple[str, ...]:
        """The names of an external baseline's controls, which a sampled controller receives after the measurements."""
        if self.fixed is None or not self.fixed.external:
            return ()
        m = len(self.fixed.K)
        return ("u_baseline",) if m == 1 else tuple(f"u_baseline_{i + 1}" for i in range(m))

    @property
    def handed_names(self) -> tuple[str, ...]:
        """The names of all channels that a sampled controller receives."""
        return (*self.measured_names, *self.handed_controls)

    @property
    def command_names(self) -> tuple[str, ...]:
        """The names of the commands in a shell. A measured channel of the same name takes precedence."""
        q = len(self.commands)
        return (COMMAND,) if q == 1 else tuple(f"{COMMAND}_{i + 1}" for i in range(q))

    @property
    def declared_followers(self) -> tuple[int | None, ...]:
        """For each command the index of the state that is declared to follow it; None, or no entry, if no state is declared."""
        return ()

    @property
    def followed_names(self) -> tuple[str, ...]:
        """The names of the quantities that follow the model, which are their labels, or x_1, x_2, ..., or y."""
        labels = self.labels or UNLABELLED
        return (
            labels.of_states(int(np.size(self.model.output(self.model.x0))))
            if self.feedback == "state"
            else labels.names or ("y",)
        )

    @property
    def nominal(self) -> Self:
        """This problem without faults and without a shell that could reject a sample."""
        if self.shell is None and not self.faults:
            return self
        return replace(self, shell=None, faults=())  # type: ignore[type-var]

    def require_surroundings(self) -> None:
        """Raise InputError if the shell or a fault names a channel that is not measured."""
        if self.shell is not None:
            validate.instance("shell", self.shell, Shell)
            self.shell.require(self.handed_names, self.command_names, without_baseline=self._without_fallback)
        if not isinstance(self.faults, (list, tuple)):
            raise InputError(f"faults must be a list of faults, got {validate.show(self.faults)}")
        for i, fault in enumerate(self.faults, start=1):
            validate.instance(f"faults {i}", fault, Fault)
            try:
                fault.require(self.handed_names)
            except InputError as error:
                raise InputError(f"faults {i} ({fault.kind}): {error}", field="faults") from None
        freeze(self, faults=tuple(self.faults))

    @property
    def _without_fallback(self) -> str | None:
        """The reason why no baseline can act after an outage; None if a baseline can act."""
        if self.fixed is None:
            return "needs a case with a baseline controller, but this case has none"
        if self.fixed.external:
            return "needs a baseline that the export computes, but baseline.external = true leaves it to other code"
        if self.fixed_observer is not None:
            return "needs the state itself, but the case has an observer, which predicts it during an outage"
        return None

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The functions of time that drive the loop, in the order that ``ClosedLoop`` expects."""
        acting = self.surroundings
        matched = () if acting.disturbance is None else (acting.disturbance,)
        at_output = () if self.output_disturbance is None else (self.output_disturbance,)
        clock = (Clock(),) if self.depends_on_time else ()
        unmatched = (disturbance.signal for disturbance in acting.unmatched)
        faults = (FaultSignal(fault, place) for place, fault in enumerate(self.faults))
        return (*self.commands, *matched, *unmatched, *at_output, *clock, *faults)


def require_signal(field: str, signal: Any) -> None:
    """Raise InputError, with the field, for an object that is not a signal."""
    if not validate.is_instance(signal, Signal) or isinstance(signal, type):
        raise InputError.of(field, f"must be a signal such as Sine(amplitude=1, frequency=2), got {validate.show(signal)}")


def rows_of(problem: TrackingProblem) -> dict[str, str]:
    """Return the inputs of a problem by name, with each of the plant's numbers separately."""
    found: dict[str, str] = {}
    given: dict[str, str] = given_of(problem) if is_dataclass(problem) else {}  # type: ignore[redundant-expr]
    for name, text in given.items():
        plant = problem.plant if name == "plant" else None
        found |= {f"plant.{inner}": value for inner, value in given_of(plant).items()} if is_dataclass(plant) else {name: text}  # type: ignore[redundant-expr]
    found.pop("name", None)
    return found


def table_of(title: str, rows: dict[str, str]) -> str:
    """Return names and values as HTML."""
    cells = (f'<tr><th scope="row" style="text-align: left">{escape(name)}</th>' for name in rows)
    values = (f'<td style="text-align: left"><code>{escape(text)}</code></td></tr>' for text in rows.values())
    body = "".join(cell + value for cell, value in zip(cells, values, strict=True))
    return f"<table><caption>{escape(title)}</caption>{body}</table>"
