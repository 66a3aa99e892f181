"""What is given: the plant (1), the reference model (2), the known set of the unknown parameters, the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.actuation import PlantInput
from barbalat.conditions import require_controllable, require_hurwitz
from barbalat.known_set import KnownSet, ParameterBall, ParameterBox
from barbalat.measurement import Noise, Sensor
from barbalat.protocols import Signal, Value
from barbalat.signals import Constant
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """Plant with matched linear uncertainty, x' = A_m x + b (theta'x + u + d), x(0) = x0: eq. (1).

    A_m    (n, n)  known, Hurwitz, [1/s]
    b      (n,)    known; (A_m, b) controllable
    theta  (n,)    the true parameters; no controller sees them
    x0     (n,)    initial state, measured; zero by default
    input          unmodelled dynamics and delay at the input, eq. (11); none by default

    Raises InputError for wrong shapes, a non-Hurwitz A_m, an uncontrollable pair.
    """

    A_m: Array
    b: Array
    theta: Array
    x0: Array | None = None
    input: PlantInput | None = None

    def __post_init__(self) -> None:
        A_m = validate.square_matrix("plant.A_m", self.A_m)
        n = A_m.shape[0]
        freeze(
            self,
            A_m=A_m,
            b=validate.vector("plant.b", self.b, n),
            theta=validate.vector("plant.theta", self.theta, n),
            x0=validate.vector("plant.x0", np.zeros(n) if self.x0 is None else self.x0, n),
        )
        if self.input is not None:
            validate.instance("plant.input", self.input, PlantInput)
        require_hurwitz("plant.A_m", A_m)
        require_controllable("(plant.A_m, plant.b)", A_m, self.b)

    @classmethod
    def matched(cls, *, A: Any, A_m: Any, b: Any, x0: Any = None, input: PlantInput | None = None) -> Plant:
        """The same plant given as x' = A x + b u: theta solves the matching condition A = A_m + b theta'.

        Raises InputError, with the unmatched rest, when no theta does.
        """
        A_m = validate.square_matrix("reference_model.A_m", A_m)
        n = A_m.shape[0]
        A = validate.square_matrix("plant.A", A, n)
        b = validate.vector("plant.b", b, n)
        if not b.any():
            raise InputError("plant.b must not be zero")
        difference = A - A_m
        direction = b / np.abs(b).max()  # squares of very large or small entries would leave the range of floats
        along = direction @ difference / (direction @ direction)
        rest = difference - np.outer(direction, along)
        if np.abs(rest).max() > 1e-9 * max(1.0, float(np.abs(A).max()), float(np.abs(A_m).max())):
            raise InputError(
                "plant.A - reference_model.A_m must be matched (equal to b theta' for some theta), "
                f"but the part {validate.show(rest)} is out of the reach of b = {validate.show(b)}"
            )
        with np.errstate(over="ignore"):  # an infinite theta is refused by the constructor
            theta = along / np.abs(b).max()
        return cls(A_m=A_m, b=b, theta=theta, x0=x0, input=input)

    @property
    def n(self) -> int:
        """State dimension."""
        return len(self.b)

    @property
    def outputs(self) -> int:
        """Measured quantities."""
        return self.n

    def derivative(self, x: Value, v: Value) -> Value:
        """x' for the matched input v: what reaches the plant of u, and d."""
        return self.A_m @ x + self.b * (self.theta @ x + v)  # (1)

    def output(self, x: Value) -> Value:
        """What is measured: the state."""
        return x


@dataclass(frozen=True, eq=False)
class Model:
    """The reference model as a system of its own, which the loop integrates beside the plant."""

    A_m: Array
    b: Array
    k_0: float
    x0: Array

    def derivative(self, x_m: Value, r: Value) -> Value:
        return self.A_m @ x_m + self.b * (self.k_0 * r)  # (2)

    def output(self, x_m: Value) -> Value:
        """What the plant's output is to follow."""
        return x_m


@dataclass(frozen=True, eq=False, kw_only=True)
class ReferenceModel:
    """x_m' = A_m x_m + k_0 b r, x_m(0) = x(0): eq. (2). ``k_0`` is a scalar; A_m and b are the plant's."""

    k_0: float = 1.0

    def __post_init__(self) -> None:
        freeze(self, k_0=validate.number("reference_model.k_0", self.k_0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What a designer knows of the problem and a controller may therefore use: everything but theta and d."""

    A_m: Array  # (n, n)
    b: Array  # (n,)
    k_0: float
    x0: Array  # (n,) the state is measured, so is its initial value
    box: KnownSet | None

    @property
    def n(self) -> int:
        return len(self.b)

    @property
    def P(self) -> Array:
        """The solution of P A_m + A_m'P = -I, (n, n)."""
        from scipy.linalg import solve_continuous_lyapunov

        P = solve_continuous_lyapunov(self.A_m.T, -np.eye(self.n))
        return np.asarray((P + P.T) / 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Disturbance:
    """direction * signal(t), added to x': for what no control can cancel. ``direction`` is (n,)."""

    direction: Array
    signal: Signal

    def __post_init__(self) -> None:
        freeze(self, direction=validate.vector("unmatched.direction", self.direction))
        require_signal("unmatched.signal", self.signal)


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """The tracking problem of Section II.

    plant, reference_model, reference  eqs (1) and (2), and the command r(t)
    uncertainty                        the known set Omega
    disturbance                        matched: d(t) in x' = A_m x + b (theta'x + u + d)
    unmatched                          others, each along a direction of its own
    sensor                             how the plant's state is measured; exactly by default
    """

    plant: Plant
    reference_model: ReferenceModel = field(default_factory=ReferenceModel)
    reference: Signal = field(default_factory=Constant)
    uncertainty: KnownSet | None = None
    disturbance: Signal | None = None
    unmatched: tuple[Disturbance, ...] = ()
    sensor: Sensor | None = None
    name: str = "problem"

    def __post_init__(self) -> None:
        validate.instance("plant", self.plant, Plant)
        validate.instance("reference_model", self.reference_model, ReferenceModel)
        if self.uncertainty is not None:
            validate.instance("uncertainty", self.uncertainty, (ParameterBox, ParameterBall))
            size, n = self.uncertainty.size, self.plant.n
            if size != n:
                first = "lower" if isinstance(self.uncertainty, ParameterBox) else "center"
                raise InputError(f"uncertainty.{first} must have {n} entries, one for each state, got {size}")
        require_signal("reference", self.reference)
        if self.disturbance is not None:
            require_signal("disturbance", self.disturbance)
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
            _one_for_each_state("sensor.noise.std", () if self.sensor.noise is None else self.sensor.noise.std, self.plant.n)
        if not isinstance(self.unmatched, (list, tuple)):
            raise InputError(f"unmatched must be a list of Disturbance, got {validate.show(self.unmatched)}")
        for disturbance in self.unmatched:
            validate.instance("unmatched", disturbance, Disturbance)
            validate.vector("unmatched.direction", disturbance.direction, self.plant.n)
        freeze(self, unmatched=tuple(self.unmatched))

    @property
    def known(self) -> Known:
        p = self.plant
        return Known(A_m=p.A_m, b=p.b, k_0=self.reference_model.k_0, x0=p.x0, box=self.uncertainty)

    @property
    def model(self) -> Model:
        """The reference model (2), which starts where the plant does."""
        p = self.plant
        return Model(p.A_m, p.b, self.reference_model.k_0, p.x0)

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s]."""
        return 0.0 if self.plant.input is None else self.plant.input.delay

    @property
    def noise(self) -> Noise | None:
        """The measurement's noise."""
        return None if self.sensor is None else self.sensor.noise

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The time functions that drive the loop, in the order in which ``ClosedLoop`` takes them."""
        matched = () if self.disturbance is None else (self.disturbance,)
        return (self.reference, *matched, *(disturbance.signal for disturbance in self.unmatched))


def require_signal(field: str, signal: Any) -> None:
    """InputError, naming the field, for what is no signal."""
    if not isinstance(signal, Signal) or isinstance(signal, type):
        raise InputError(f"{field} must be a signal such as Sine(amplitude=1, frequency=2), got {validate.show(signal)}")


def _one_for_each_state(field: str, values: Any, n: int) -> None:
    if len(values) > 1:
        validate.vector(field, values, n)
