"""The output-feedback tracking problem: a SISO plant and a model given by transfer functions; only y is measured."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.actuation import PlantInput
from barbalat.linear import StateSpace, TransferFunction
from barbalat.measurement import Sensor
from barbalat.protocols import Signal, Value
from barbalat.regressors import Terms, formula
from barbalat.signals import Constant
from barbalat.tracking_problem import Disturbance, TrackingProblem, require_signal
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False)
class Nonlinearity:
    """f(t, y), a formula in y and t with + - * / **, abs, exp, sin, cos, sqrt, tanh. Raises InputError for anything else."""

    formula: str

    def __post_init__(self) -> None:
        self._terms  # noqa: B018  # refuses what is no formula

    @cached_property
    def _names(self) -> frozenset[str]:
        if not isinstance(self.formula, str):
            raise self._refusal()
        try:
            tree = ast.parse(self.formula.strip(), mode="eval")
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise self._refusal() from None
        return frozenset(node.id for node in ast.walk(tree) if isinstance(node, ast.Name))

    @cached_property
    def _terms(self) -> Terms:
        given = {"y": "x1", "t": "x2"}
        if any(name[0] == "x" for name in self._names):
            raise self._refusal()
        spelled = re.sub(r"\b[yt]\b", lambda name: given[name[0]], self.formula)
        try:
            return Terms(terms=(spelled,))
        except InputError:
            raise self._refusal() from None

    def _refusal(self) -> InputError:
        return InputError(
            "plant.nonlinear must be a formula in y and t, numbers, + - * / ** and abs, exp, sin, cos, sqrt, tanh, such as "
            f"'0.5*sin(y)', got {validate.show(self.formula)}"
        )

    @property
    def depends_on_time(self) -> bool:
        return "t" in self._names

    @property
    def function(self) -> Callable[[Any], Any]:
        """f of the sequence (y, t), by whatever arithmetic its two entries have."""
        return formula(self._terms.terms[0])

    def __call__(self, y: Value, *t: Value) -> Value:
        """f, a scalar; t is given where the formula contains it."""
        return self._terms(np.concatenate([value.reshape(1) for value in (y, *t)]))[0]


@dataclass(frozen=True, eq=False)
class OutputDynamics:
    """x' = A x + B (v + f(t, y)), y = C x, from rest: what a loop integrates of the plant or of the model."""

    system: StateSpace
    x0: Array
    nonlinear: Nonlinearity | None = None

    outputs: ClassVar[int] = 1
    """Measured quantities."""

    def derivative(self, x: Value, v: Value, *t: Value) -> Value:
        """x' for the input v: u as it reaches the plant, and d; or the command. t [s] where f contains it."""
        if self.nonlinear is not None:
            v = v + self.nonlinear(self.output(x), *t)
        return self.system.derivative(x, v)

    def output(self, x: Value) -> Value:
        """y, a scalar."""
        return self.system.C @ x


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputPlant:
    """y = G(s)[u + d + f(t, y)], from rest: (18).

    transfer_function  G(s), strictly proper: what is simulated, its unmodelled part included
    nonlinear          f, a formula in y and t such as "(0.5 + 0.1*cos(t))*sin(y)"; none by default
    input              limits, further unmodelled dynamics and delay before G; none by default

    Raises InputError.
    """

    transfer_function: TransferFunction
    nonlinear: str | None = None
    input: PlantInput | None = None

    def __post_init__(self) -> None:
        freeze(self, transfer_function=strictly_proper("plant.transfer_function", self.transfer_function))
        if self.input is not None:
            validate.instance("plant.input", self.input, PlantInput)
        self.dynamics  # noqa: B018  # refuses what has no realisation or is no formula

    @property
    def dynamics(self) -> OutputDynamics:
        return _at_rest(self.transfer_function, self.f)

    @property
    def f(self) -> Nonlinearity | None:
        """What ``nonlinear`` spells."""
        return None if self.nonlinear is None else Nonlinearity(self.nonlinear)

    @property
    def paths(self) -> tuple[PlantInput, ...]:
        """What lies before the input."""
        return (PlantInput() if self.input is None else self.input,)


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputReferenceModel:
    """y_m = W_m(s)[r], from rest: (19). W_m stable, strictly proper, minimum phase. Raises InputError."""

    transfer_function: TransferFunction

    def __post_init__(self) -> None:
        W_m = strictly_proper("reference_model.transfer_function", self.transfer_function)
        shown = f"num = {validate.show(W_m.num)}, den = {validate.show(W_m.den)}"
        if not W_m.is_stable:
            raise InputError(f"reference_model.transfer_function must be stable, got {shown}")
        if not W_m.is_minimum_phase:
            raise InputError(f"reference_model.transfer_function must be minimum phase, got {shown}")
        freeze(self, transfer_function=W_m)

    @property
    def dynamics(self) -> OutputDynamics:
        return _at_rest(self.transfer_function)


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputKnown:
    """What a designer has: the reference model. The plant stands here only to refuse assumptions that it contradicts."""

    W_m: TransferFunction
    plant: TransferFunction
    saturation: Array | None = None  # (2,) lower and upper limit of the actuator; None where it has none


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputProblem(TrackingProblem):
    """Plant, model, command r(t), input disturbance d(t), output disturbance, and how y is measured.

    What ``output_disturbance`` adds to G's output belongs to y: it is in e = y - y_m and in what is measured, not in f(t, y).
    """

    plant: OutputPlant
    reference_model: OutputReferenceModel
    reference: Signal = field(default_factory=Constant)
    disturbance: Signal | None = None
    output_disturbance: Signal | None = None  # type: ignore[misc]
    sensor: Sensor | None = None
    name: str = "problem"

    feedback: ClassVar[str] = "output"
    unmatched: ClassVar[tuple[Disturbance, ...]] = ()  # type: ignore[misc]
    """Disturbances elsewhere than at the input: none."""
    uncertainty: ClassVar[None] = None
    """The known set is the controller's: it depends on the parametrisation."""

    def __post_init__(self) -> None:
        validate.instance("plant", self.plant, OutputPlant)
        validate.instance("reference_model", self.reference_model, OutputReferenceModel)
        require_signal("reference", self.reference)
        for name in ("disturbance", "output_disturbance"):
            if getattr(self, name) is not None:
                require_signal(name, getattr(self, name))
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
            if self.sensor.noise is not None:
                validate.vector("sensor.noise.std", self.sensor.noise.std, 1)

    @property
    def dynamics(self) -> OutputDynamics:
        return self.plant.dynamics

    @property
    def model(self) -> OutputDynamics:
        return self.reference_model.dynamics

    @property
    def depends_on_time(self) -> bool:  # type: ignore[override]
        f = self.plant.f
        return f is not None and f.depends_on_time

    @property
    def known(self) -> OutputKnown:
        return OutputKnown(
            W_m=self.reference_model.transfer_function,
            plant=self.plant.transfer_function,
            saturation=self.plant.paths[0].saturation,
        )


def strictly_proper(name: str, given: Any) -> TransferFunction:
    """A transfer function that is zero at infinite frequency and not zero everywhere; InputError names the field."""
    system = TransferFunction.accept(name, given)
    if system.relative_degree < 1 or not system.num.any():
        shown = f"num = {validate.show(system.num)}, den = {validate.show(system.den)}"
        raise InputError(f"{name} must be strictly proper and not zero, got {shown}")
    return system


def _at_rest(system: TransferFunction, nonlinear: Nonlinearity | None = None) -> OutputDynamics:
    realised = system.realise()
    return OutputDynamics(realised, np.zeros(realised.order), nonlinear)
