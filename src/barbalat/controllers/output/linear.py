"""A linear output-feedback controller, u = F(s)[r] - K(s)[y]: a benchmark, a robust design, or the equivalent of a different
scheme."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme
from barbalat.controllers.steps import LinearStep, Tustin
from barbalat.linear.conditions import balance
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.output_feedback import OutputKnown
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError


class State(NamedTuple):
    """The controller's states."""

    x: Value  # (order,)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """One realisation for both inputs: x' = A x + B_1 first + B_2 y, u = C x + D_1 first + D_2 y.

    ``first`` is r; without a feedforward it is y_m, and the controller acts on y_m - y.
    """

    A: Array
    B: Array  # (order, 2)
    C: Array
    D: Array  # (2,)
    follows_model: bool

    roles: ClassVar[Mapping[str, Role]] = {"x": Role.other("state of the linear controller")}

    def initial(self) -> State:
        return State(np.zeros(len(self.C)))

    def control(self, state: State, y: Value, y_m: Value, r: Value) -> Value:
        first = y_m if self.follows_model else r
        return self.C @ state.x + self.D[0] * first + self.D[1] * y

    def derivative(self, state: State, y: Value, y_m: Value, r: Value, u: Value) -> State:
        first = y_m if self.follows_model else r
        return State(self.A @ state.x + self.B[:, 0] * first + self.B[:, 1] * y)

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Tustin:
        return Tustin(self, T, LinearStep.of(self.A, T))


@dataclass(frozen=True, eq=False)
class LinearOutput(Scheme):
    """u = K(s)[y_m - y], or u = F(s)[r] - K(s)[y] if a feedforward is given; both are proper and start at rest.

    loop         K(s)
    feedforward  F(s); none by default

    An unstable F must have the denominator of K, with which it then shares its states; otherwise the loop could not stabilise
    them.
    """

    loop: TransferFunction
    _: KW_ONLY
    feedforward: TransferFunction | None = None
    name: str = "Linear"

    feedback: ClassVar[str] = "output"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        for field in ("loop", "feedforward"):
            if getattr(self, field) is None:
                continue
            system = TransferFunction.accept(field, getattr(self, field))
            if system.relative_degree < 0:
                raise InputError.of(
                    field, f"must be proper, got num = {validate.show(system.num)}, den = {validate.show(system.den)}"
                )
            validate.freeze(self, **{field: system})
        F, K = self.feedforward, self.loop
        if F is not None and not F.is_stable and not self._shared:
            raise InputError(f"feedforward must be stable or have the denominator of loop, got den = {validate.show(F.den)}")
        if F is None and K.num.any() == 0:
            raise InputError("loop must not be zero")

    @property
    def _shared(self) -> bool:
        F = self.feedforward
        return F is None or np.array_equal(F.den, self.loop.den)

    def bind(self, known: OutputKnown) -> Equations:
        K, F = self.loop, self.loop if self.feedforward is None else self.feedforward
        first, second, den = F.num, -K.num, K.den
        if not self._shared:
            first, second, den = np.polymul(F.num, K.den), -np.polymul(K.num, F.den), np.polymul(F.den, K.den)
        A, columns = observable_form([first, second], den)
        return Equations(
            A=A,
            B=np.column_stack([column.B for column in columns]),
            C=columns[0].C,
            D=np.array([column.D for column in columns]),
            follows_model=self.feedforward is None,
        )


def observable_form(numerators: list[Array], den: Array) -> tuple[Array, list[StateSpace]]:
    """Transfer functions with a common denominator as one system, in the transposed canonical form: they share A and C, and each
    has its own B and D."""
    order = len(den) - 1
    columns = []
    for numerator in numerators:
        num = np.concatenate([np.zeros(order + 1 - len(numerator)), numerator])
        columns.append((num[1:] - num[0] * den[1:], float(num[0])))
    companion = np.vstack([-den[1:], np.eye(order)[:-1]]) if order else np.zeros((0, 0))
    A, scale = balance(companion) if order else (companion, np.zeros(0))
    C = np.eye(order)[0] / scale if order else np.zeros(0)
    return A.T, [StateSpace(A.T, B * scale, C, D) for B, D in columns]
