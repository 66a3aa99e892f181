"""What is given: a plant and its model, the known set of the unknown parameters, commands, disturbances, measurement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.known_set import EstimateSet, KnownSet, ParameterBall, ParameterBox, ParameterProduct, with_gains
from barbalat.measurement import Noise, Sensor
from barbalat.plant import Model, Plant, ReferenceModel
from barbalat.protocols import Signal
from barbalat.regressors import Linear, Uncertainty
from barbalat.signals import Clock, Constant
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What a designer knows of the problem and a controller may therefore use: everything but theta and d."""

    A_m: Array  # (n, n)
    b: Array  # (n,), or (n, m)
    k_0: Array | float
    x0: Array  # (n,) the state is measured, so is its initial value
    box: EstimateSet | None  # of all that is estimated: theta, and the input gains where they are unknown
    uncertainty: Uncertainty = Uncertainty(Linear(), inputs=1)  # noqa: RUF009  # immutable; Phi(x)
    saturation: Array | None = None  # (2,) lower and upper limit of the actuator, (2, m) with m inputs; None where one has none

    @property
    def inputs(self) -> int:
        return self.uncertainty.inputs

    @property
    def parameters(self) -> int:
        """How many are estimated."""
        theta = self.uncertainty.regressor.size(self.n) * self.inputs
        return theta + self.inputs if self.uncertainty.gain_unknown else theta

    @property
    def theta_set(self) -> KnownSet | None:
        """The known set of theta, for schemes that take the input gain as known."""
        assert not self.uncertainty.gain_unknown and not isinstance(self.box, ParameterProduct)
        return self.box

    @property
    def gains(self) -> ParameterBox | None:
        """The intervals of the unknown input gains, (m,); ``None`` where they are known."""
        if not self.uncertainty.gain_unknown or self.box is None:
            return None
        if isinstance(self.box, ParameterBox):
            return ParameterBox(lower=self.box.lower[-self.inputs :], upper=self.box.upper[-self.inputs :])
        assert isinstance(self.box, ParameterProduct)
        return self.box.gains

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


class TrackingProblem:
    """What a loop, a simulation and an ensemble read of a problem, whatever is measured."""

    plant: Any
    reference: Signal | tuple[Signal, ...]
    disturbance: Signal | None
    unmatched: tuple[Disturbance, ...]
    sensor: Sensor | None
    name: str
    feedback: ClassVar[str]
    """What is measured: "state" or "output"."""
    output_disturbance: ClassVar[Signal | None] = None
    """What is added to the output, where one is fed back."""
    depends_on_time: ClassVar[bool] = False
    """Whether the plant's equations contain t."""

    @property
    def known(self) -> Any:
        """What the designer has."""
        raise AssertionError("a problem says what is known of it")

    @property
    def dynamics(self) -> Any:
        """The plant as a loop integrates it: x0, outputs, derivative, output."""
        raise AssertionError("a problem has a plant")

    @property
    def model(self) -> Any:
        """The reference model as a loop integrates it."""
        raise AssertionError("a problem has a model")

    @property
    def parameters(self) -> Array | None:
        """The true values of what is estimated, where the problem knows them."""
        return None

    @property
    def commands(self) -> tuple[Signal, ...]:
        """The reference signals."""
        return self.reference if isinstance(self.reference, tuple) else (self.reference,)

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s]."""
        return float(self.plant.paths[0].delay)

    @property
    def history(self) -> Array:
        """What left the delay before anything of the run did, for each input, (m,)."""
        return np.array([path.history for path in self.plant.paths])

    @property
    def noise(self) -> Noise | None:
        """The measurement's noise."""
        return None if self.sensor is None else self.sensor.noise

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The time functions that drive the loop, in the order in which ``ClosedLoop`` takes them."""
        matched = () if self.disturbance is None else (self.disturbance,)
        at_output = () if self.output_disturbance is None else (self.output_disturbance,)
        clock = (Clock(),) if self.depends_on_time else ()
        return (*self.commands, *matched, *(disturbance.signal for disturbance in self.unmatched), *at_output, *clock)


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(TrackingProblem):
    """The tracking problem of Section II.

    plant, reference_model, reference  eqs (1) and (2), and the command r(t); a list of commands where k_0 is a matrix
    uncertainty                        the known set Omega
    disturbance                        matched: d(t) in x' = A_m x + b (theta'x + u + d)
    unmatched                          others, each along a direction of its own
    input_gain                         (lower, upper) > 0: the input's gain omega is unknown and estimated with theta; a list of
                                       pairs for several inputs that differ. Goes with a box, a ball or no known set
    sensor                             how the plant's state is measured; exactly by default
    """

    plant: Plant
    reference_model: ReferenceModel = field(default_factory=ReferenceModel)
    reference: Signal | tuple[Signal, ...] = field(default_factory=Constant)
    uncertainty: KnownSet | None = None
    input_gain: tuple[float, float] | tuple[tuple[float, float], ...] | None = None
    disturbance: Signal | None = None
    unmatched: tuple[Disturbance, ...] = ()
    sensor: Sensor | None = None
    name: str = "problem"

    feedback: ClassVar[str] = "state"

    def __post_init__(self) -> None:
        validate.instance("plant", self.plant, Plant)
        validate.instance("reference_model", self.reference_model, ReferenceModel)
        if self.uncertainty is not None:
            validate.instance("uncertainty", self.uncertainty, (ParameterBox, ParameterBall))
            size, wanted = self.uncertainty.size, len(self.plant.theta)
            if size != wanted:
                first = "lower" if isinstance(self.uncertainty, ParameterBox) else "center"
                raise InputError(f"uncertainty.{first} must have {wanted} entries, one for each parameter, got {size}")
        if self.input_gain is not None:
            self._check_input_gain()
        self._check_commands()
        if self.disturbance is not None:
            require_signal("disturbance", self.disturbance)
            if self.plant.inputs > 1:
                raise InputError("disturbance needs a plant with one input; give unmatched with a direction instead")
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
            _one_for_each_state("sensor.noise.std", () if self.sensor.noise is None else self.sensor.noise.std, self.plant.n)
        if not isinstance(self.unmatched, (list, tuple)):
            raise InputError(f"unmatched must be a list of Disturbance, got {validate.show(self.unmatched)}")
        for disturbance in self.unmatched:
            validate.instance("unmatched", disturbance, Disturbance)
            validate.vector("unmatched.direction", disturbance.direction, self.plant.n)
        freeze(self, unmatched=tuple(self.unmatched))

    def _check_input_gain(self) -> None:
        name, m = "uncertainty.input_gain", self.plant.inputs
        several = validate.dimensions(self.input_gain) == 2
        pairs = validate.array(name, self.input_gain, (m, 2)) if several else validate.vector(name, self.input_gain, 2)[None]
        for low, high in pairs:
            if not 0 < low <= high:
                raise InputError(f"{name} must be [lower, upper] with 0 < lower <= upper, got [{low:g}, {high:g}]")
        given = tuple((float(low), float(high)) for low, high in pairs)
        freeze(self, input_gain=given if several else given[0])

    def _check_commands(self) -> None:
        several = isinstance(self.reference, (list, tuple))
        commands = tuple(self.reference) if several else (self.reference,)  # type: ignore[arg-type]
        for command in commands:
            require_signal("reference", command)
        shape = np.shape(self.reference_model.k_0)
        wanted = (self.plant.inputs, len(commands)) if several or self.plant.inputs > 1 else ()
        if shape != wanted:
            asked = f"a matrix {wanted[0]} x {wanted[1]} (inputs x commands)" if wanted else "a number"
            raise InputError(f"reference_model.k_0 must be {asked}, got {validate.show(self.reference_model.k_0)}")
        freeze(self, reference=commands if several else self.reference)

    @property
    def known(self) -> Known:
        p, gains = self.plant, None
        if self.input_gain is not None:
            low, high = np.broadcast_to(self.input_gain, (p.inputs, 2)).T
            gains = ParameterBox(lower=low, upper=high)
        return Known(
            A_m=p.A_m,
            b=p.b,
            k_0=self.reference_model.k_0,
            x0=p.x0,
            box=with_gains(self.uncertainty, gains),
            uncertainty=Uncertainty(p.regressor, p.inputs, self.input_gain is not None),
            saturation=_limits(p),
        )

    @property
    def parameters(self) -> Array:
        """The true values of all that is estimated: theta, and the input gains where they are unknown."""
        if self.input_gain is None:
            return self.plant.theta
        return np.concatenate([self.plant.theta, [path.gain for path in self.plant.paths]])

    @property
    def dynamics(self) -> Plant:
        return self.plant

    @property
    def model(self) -> Model:
        """The reference model (2), which starts where the plant does."""
        p = self.plant
        return Model(p.A_m, p.b, self.reference_model.k_0, p.x0)


def _limits(plant: Plant) -> Array | None:
    limits = [path.saturation for path in plant.paths if path.saturation is not None]
    if len(limits) < plant.inputs:
        return None
    return limits[0] if plant.inputs == 1 else np.column_stack(limits)


def require_signal(field: str, signal: Any) -> None:
    """InputError, naming the field, for what is no signal."""
    if not isinstance(signal, Signal) or isinstance(signal, type):
        raise InputError(f"{field} must be a signal such as Sine(amplitude=1, frequency=2), got {validate.show(signal)}")


def _one_for_each_state(field: str, values: Any, n: int) -> None:
    if len(values) > 1:
        validate.vector(field, values, n)
