"""The output-feedback tracking problem, with a SISO plant and a model given by transfer functions. Only y is measured."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction, strictly_proper
from barbalat.problem.actuation import PlantInput
from barbalat.problem.faults import Fault
from barbalat.problem.formulas import BEND_OF_ABS, Formula, FormulaNames, formula
from barbalat.problem.labels import Labels
from barbalat.problem.measurement import Sensor
from barbalat.problem.shell import Shell
from barbalat.problem.tracking import TrackingProblem, require_signal
from barbalat.protocols import Signal, Value
from barbalat.settings import Settings, one_line
from barbalat.signals import Constant
from barbalat.validate import Array, InputError, freeze

OUTPUT_AND_TIME = FormulaNames("y|t", "y and t")


@dataclass(frozen=True, eq=False)
class Nonlinearity:
    """f(t, y), a formula in y and t with + - * / **, abs, exp, sin, cos, sqrt, tanh. Raises InputError for anything else."""

    formula: str

    def __post_init__(self) -> None:
        self._parsed  # noqa: B018  # raises InputError for anything but a formula

    @property
    def _parsed(self) -> Formula:
        return formula("plant.nonlinear", self.formula, OUTPUT_AND_TIME)

    @property
    def depends_on_time(self) -> bool:
        return "t" in self._parsed.names

    @property
    def bend(self) -> str | None:
        """The place where f has a corner."""
        return BEND_OF_ABS if self._parsed.bends else None

    def at(self, y: Any, t: Any) -> Any:
        """Return f, evaluated in the arithmetic of y and t."""
        return self._parsed.evaluate({"y": y, "t": t})

    def __call__(self, y: Value, *t: Value) -> Value:
        """Return f, a scalar. t must be given if the formula contains it."""
        return self.at(y, *(t or (None,))) + 0 * y


@dataclass(frozen=True, eq=False)
class OutputDynamics:
    """The part of a plant or of a model that a loop integrates: x' = A x + B (v + f(t, y)), y = C x, from rest."""

    system: StateSpace
    x0: Array
    nonlinear: Nonlinearity | None = None

    outputs: ClassVar[int] = 1
    """The number of measured quantities."""

    def derivative(self, x: Value, v: Value, *t: Value) -> Value:
        """Return x' for the input v, which is the plant's actual input plus d, or the model's command; t [s] is needed if f
        contains it."""
        if self.nonlinear is not None:
            v = v + self.nonlinear(self.output(x), *t)
        return self.system.derivative(x, v)

    def output(self, x: Value) -> Value:
        """Return the output y, a scalar."""
        return self.system.C @ x

    def remedy(self, _: float) -> str:
        """Return the change with which a model would settle at its command."""
        return "W_m(0) = 1"

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C of the linear part."""
        return self.system.A, self.system.B[:, None], self.system.C[None]


@dataclass(frozen=True, eq=False)
class OutputPlant(Settings):
    """y = G(s)[u + d + f(t, y)], from rest: (18).

    transfer_function  G(s), strictly proper: the simulated system, including unmodelled dynamics; a system of python-control or
                       SciPy is accepted too
    nonlinear          f, a formula in y and t such as "(0.5 + 0.1*cos(t))*sin(y)"; none by default
    input              limits, further unmodelled dynamics and delay before G; none by default

    Raises InputError.
    """

    transfer_function: TransferFunction
    _: KW_ONLY
    nonlinear: str | None = None
    input: PlantInput | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        freeze(self, transfer_function=strictly_proper("plant.transfer_function", self.transfer_function))
        if self.input is not None:
            validate.instance("plant.input", self.input, PlantInput)
        self.dynamics  # noqa: B018  # raises InputError without a realisation or a formula

    @property
    def dynamics(self) -> OutputDynamics:
        return _at_rest(self.transfer_function, self.f)

    @property
    def f(self) -> Nonlinearity | None:
        """The nonlinearity that ``nonlinear`` describes; None without one."""
        return None if self.nonlinear is None else Nonlinearity(self.nonlinear)

    @property
    def paths(self) -> tuple[PlantInput, ...]:
        """The input path, as a tuple."""
        return (PlantInput() if self.input is None else self.input,)


@dataclass(frozen=True, eq=False)
class OutputReferenceModel(Settings):
    """y_m = W_m(s)[r], from rest: (19).

    transfer_function  W_m(s): stable, strictly proper, minimum phase

    Raises InputError.
    """

    transfer_function: TransferFunction

    def __post_init__(self) -> None:
        W_m = strictly_proper("reference_model.transfer_function", self.transfer_function)
        shown = f"num = {validate.show(W_m.num)}, den = {validate.show(W_m.den)}"
        if not W_m.is_stable:
            raise InputError.of("reference_model.transfer_function", f"must be stable, got {shown}")
        if not W_m.is_minimum_phase:
            raise InputError.of("reference_model.transfer_function", f"must be minimum phase, got {shown}")
        freeze(self, transfer_function=W_m)

    @property
    def dynamics(self) -> OutputDynamics:
        return _at_rest(self.transfer_function)


def _at_rest(system: TransferFunction, nonlinear: Nonlinearity | None = None) -> OutputDynamics:
    realised = system.realise()
    return OutputDynamics(realised, np.zeros(realised.order), nonlinear)


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputKnown:
    """The designer's knowledge, which is the reference model. The plant is included only to reject assumptions that contradict
    it."""

    W_m: TransferFunction
    plant: TransferFunction
    saturation: Array | None = None  # (2,) lower and upper limit of the actuator; None without limits


@dataclass(frozen=True, eq=False, repr=False)
class OutputProblem(TrackingProblem, Settings):
    """Plant, model, command r(t), input disturbance d(t), output disturbance, and the measurement of y.

    plant, reference_model  as transfer functions
    reference               the command r(t)
    disturbance             enters with u; none by default
    output_disturbance      added to the output; none by default
    sensor                  the path from y to the measurement; exact by default
    labels                  name and unit of the output, unit of the input, for pictures; none by default
    shell                   code around sampled controllers: it decides which samples are used and what acts without a sample
    faults                  faults between the plant and sampled controllers; none by default

    ``output_disturbance`` is part of y, and so of e = y - y_m and of the measurement, but not of f(t, y).
    """

    plant: OutputPlant
    reference_model: OutputReferenceModel
    reference: Signal = field(default_factory=Constant)
    _: KW_ONLY
    disturbance: Signal | None = None
    output_disturbance: Signal | None = None
    sensor: Sensor | None = None
    labels: Labels | None = None
    shell: Shell | None = None
    faults: tuple[Fault, ...] = ()
    name: str = "problem"

    feedback: ClassVar[str] = "output"
    uncertainty: ClassVar[None] = None
    """None. The known set belongs to the controller, because the set depends on the parametrisation."""

    def __post_init__(self) -> None:
        validate.line("name", self.name)
        validate.instance("plant", self.plant, OutputPlant)
        validate.instance("reference_model", self.reference_model, OutputReferenceModel)
        require_signal("reference", self.reference)
        for name in ("disturbance", "output_disturbance"):
            if getattr(self, name) is not None:
                require_signal(name, getattr(self, name))
        if self.labels is not None:
            validate.instance("labels", self.labels, Labels)
            self.labels.require(1, 1)
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
            self.sensor.require(1)
        self.require_surroundings()

    @property
    def in_brief(self) -> str:
        order, of_model = (len(system.den) - 1 for system in (self.known.plant, self.known.W_m))
        return f"output feedback, a plant of order {order}, a model of order {of_model}"

    @property
    def dynamics(self) -> OutputDynamics:
        return self.plant.dynamics

    @property
    def model(self) -> OutputDynamics:
        return self.reference_model.dynamics

    @property
    def depends_on_time(self) -> bool:
        f = self.plant.f
        return f is not None and f.depends_on_time

    @property
    def known(self) -> OutputKnown:
        return OutputKnown(
            W_m=self.reference_model.transfer_function,
            plant=self.plant.transfer_function,
            saturation=self.plant.paths[0].saturation,
        )
