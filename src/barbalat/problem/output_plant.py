"""The plant and the reference model of an output-feedback problem, as transfer functions."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction, strictly_proper
from barbalat.problem.actuation import PlantInput
from barbalat.problem.formulas import BEND_OF_ABS, Formula, FormulaNames, formula
from barbalat.protocols import Value
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, freeze

OUTPUT_AND_TIME = FormulaNames("y|t", "y and t")


@dataclass(frozen=True, eq=False)
class Nonlinearity:
    """f(t, y), a formula in y and t with + - * / **, abs, exp, sin, cos, sqrt, tanh. Raises InputError for anything else."""

    formula: str

    def __post_init__(self) -> None:
        self._parsed  # noqa: B018  # refuses what is no formula

    @property
    def _parsed(self) -> Formula:
        return formula("plant.nonlinear", self.formula, OUTPUT_AND_TIME)

    @property
    def depends_on_time(self) -> bool:
        return "t" in self._parsed.names

    @property
    def bend(self) -> str | None:
        """Where f has a corner."""
        return BEND_OF_ABS if self._parsed.bends else None

    def at(self, y: Any, t: Any) -> Any:
        """f by whatever arithmetic y and t have."""
        return self._parsed.evaluate({"y": y, "t": t})

    def __call__(self, y: Value, *t: Value) -> Value:
        """f, a scalar; t is given where the formula contains it."""
        return self.at(y, *(t or (None,))) + 0 * y


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
        """The output y, a scalar."""
        return self.system.C @ x

    def remedy(self, _: float) -> str:
        """What a model needs to settle at its command."""
        return "W_m(0) = 1"

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C of the linear part."""
        return self.system.A, self.system.B[:, None], self.system.C[None]


@dataclass(frozen=True, eq=False)
class OutputPlant(Settings):
    """y = G(s)[u + d + f(t, y)], from rest: (18).

    transfer_function  G(s), strictly proper: what is simulated, its unmodelled part included; also a system of
                       python-control or SciPy
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
        self.dynamics  # noqa: B018  # refuses what has no realisation or is no formula

    @property
    def dynamics(self) -> OutputDynamics:
        return _at_rest(self.transfer_function, self.f)

    @property
    def f(self) -> Nonlinearity | None:
        """The nonlinearity that ``nonlinear`` spells; None without one."""
        return None if self.nonlinear is None else Nonlinearity(self.nonlinear)

    @property
    def paths(self) -> tuple[PlantInput, ...]:
        """What lies before the input."""
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
