"""Plant, reference model and controller as one system of differential equations: the only place that packs a state vector."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.linear import StateSpace
from barbalat.problem import Model, Plant, Problem
from barbalat.protocols import Controller, Equations, Value
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi


class LoopState(NamedTuple):
    """The loop's state; ``controller`` is the scheme's own NamedTuple."""

    x: Value  # (n,) plant
    x_m: Value  # (n,) reference model
    input: Value  # (order of 1 + Delta_m,) unmodelled dynamics at the plant's input
    controller: Any


class Outputs(NamedTuple):
    """What is measured at every solver step and recorded."""

    e: Value  # (n,) tracking error x - x_m, or y - y_m where the output is fed back
    u: Value  # (1,) control
    theta_hat: Value  # (n,) estimates
    x: Value  # (n,)
    x_m: Value  # (n,)


class Controlled(NamedTuple):
    """What stands around the controller at one instant."""

    r: Value  # command
    u: Value  # control
    y: Value  # what is measured: x, or the output of an output-feedback problem
    y_m: Value  # what it is to follow


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """One controller on one problem. Flat states are vectors of length ``size``."""

    plant: Plant
    model: Model
    equations: Equations
    input: StateSpace | None = None  # 1 + Delta_m
    disturbed: bool = False
    delayed: bool = False

    @classmethod
    def of(cls, problem: Problem, controller: Controller) -> ClosedLoop:
        validate.instance("problem", problem, Problem)
        if not isinstance(controller, Controller) or isinstance(controller, type):
            raise validate.InputError(f"a controller must have a name and a method bind, got {validate.show(controller)}")
        equations = controller.bind(problem.known)
        dynamics = None if problem.plant.input is None else problem.plant.input.dynamics
        return cls(
            problem.plant,
            problem.model,
            equations,
            input=None if dynamics is None else dynamics.realise(),
            disturbed=problem.disturbance is not None,
            delayed=problem.delay > 0,
        )

    def initial(self) -> Array:
        """The flat state at t = 0; the model starts where the plant does."""
        return np.asarray(flatten(self._initial))

    @property
    def _initial(self) -> LoopState:
        at_rest = np.zeros(0 if self.input is None else self.input.order)
        return LoopState(self.plant.x0, self.model.x0, at_rest, self.equations.initial())

    @property
    def signal_count(self) -> int:
        """Entries of ``signals``: r, the disturbance if any, the delayed plant input if any."""
        return 1 + self.disturbed + self.delayed

    @property
    def size(self) -> int:
        return len(flatten(self._initial))

    @property
    def theta_hat_rows(self) -> slice:
        """Where the estimates stand in a flat state."""
        marked = self.unpack(np.arange(self.size)).controller.theta_hat
        return slice(int(marked[0]), int(marked[-1]) + 1)

    def unpack(self, flat: Value) -> LoopState:
        """The named parts of a flat state, numbers or symbols."""
        state, used = _unflatten(self._initial, flat, 0)
        if used != len(flat):
            raise ValueError(f"a flat state of this loop has {used} entries, got {len(flat)}")
        return state  # type: ignore[no-any-return]

    @property
    def errors(self) -> int:
        """Components of the tracking error e."""
        return int(self.model.output(self.model.x0).size)

    @property
    def parameters(self) -> int:
        """Components of the estimate theta_hat."""
        return int(self._initial.controller.theta_hat.size)

    def derivative(self, flat: Value, signals: Value) -> Value:
        """d/dt of the flat state; ``signals`` is r, then d if there is one, then the delayed plant input if there is one."""
        state = self.unpack(flat)
        r, u, y, y_m = self._controlled(state, signals)
        v = signals[-1] if self.delayed else self._through_dynamics(state.input, u)
        return flatten(
            LoopState(
                x=self.plant.derivative(state.x, v + signals[1] if self.disturbed else v),  # (1), with (11)'s input
                x_m=self.model.derivative(state.x_m, r),  # (2)
                input=state.input if self.input is None else self.input.derivative(state.input, u),
                controller=self.equations.derivative(state.controller, y, y_m, r, u),
            )
        )

    def undelayed_input(self, flat: Value, signals: Value) -> Value:
        """What enters the delay: (1 + Delta_m)[u]."""
        state = self.unpack(flat)
        return self._through_dynamics(state.input, self._controlled(state, signals).u)

    def _controlled(self, state: LoopState, signals: Value) -> Controlled:
        y, y_m, r = self.plant.output(state.x), self.model.output(state.x_m), signals[0]
        return Controlled(r, self.equations.control(state.controller, y, y_m, r), y, y_m)

    def _through_dynamics(self, input_state: Value, u: Value) -> Value:
        return u if self.input is None else self.input.output(input_state, u)

    def limit(self, flat: Value) -> Value:
        state = self.unpack(flat)
        return flatten(state._replace(controller=self.equations.limit(state.controller)))

    def outputs(self, flat: Value, signals: Value) -> Outputs:
        state = self.unpack(flat)
        _, u, y, y_m = self._controlled(state, signals)
        return Outputs((y - y_m).reshape(-1), u.reshape(1), state.controller.theta_hat, state.x, state.x_m)


def flatten(state: Any) -> Value:
    """All arrays of a nested NamedTuple, one after another, row by row."""
    return np.concatenate([leaf.reshape(-1) for leaf in _leaves(state)])


def _leaves(state: Any) -> list[Value]:
    if isinstance(state, tuple):
        return [leaf for part in state for leaf in _leaves(part)]
    return [np.asarray(state) if isinstance(state, (int, float)) else state]


def _unflatten(template: Any, flat: Value, start: int) -> tuple[Any, int]:
    """The inverse of ``flatten`` for the shapes of ``template``; also where the next part starts."""
    if isinstance(template, tuple):
        parts = []
        for part in template:
            value, start = _unflatten(part, flat, start)
            parts.append(value)
        return type(template)(*parts), start
    shape = template.shape
    size = int(np.prod(shape))
    return flat[start : start + size].reshape(shape), start + size


def symbols(name: str, size: int) -> tuple[casadi.SX, Value]:
    """A column of symbols, as CasADi's matrix and as the array (size,) that equations compute with."""
    import casadi as ca

    matrix = ca.SX.sym(name, size)
    return matrix, ca.array(matrix).reshape(-1)


def column(value: Value) -> casadi.SX:
    """An array of expressions as a CasADi column."""
    import casadi as ca

    return ca.SX(value.reshape(-1))
