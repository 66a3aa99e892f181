"""The tracking problem with state feedback: plant and model, known set, commands, disturbances and measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, lru_cache
from typing import ClassVar, Self

import numpy as np

from barbalat import validate
from barbalat.problem.actuation import InputPath, PlantInput
from barbalat.problem.baseline import FixedController
from barbalat.problem.faults import Fault
from barbalat.problem.from_ranges import FromRanges
from barbalat.problem.known_set import EstimateSet, KnownSet, ParameterBall, ParameterBox, with_gains
from barbalat.problem.labels import UNLABELLED, Labels
from barbalat.problem.measurement import Sensor
from barbalat.problem.observer import FixedObserver, Observer
from barbalat.problem.plant import Model, Plant, ReferenceModel
from barbalat.problem.regressors import Linear, MatchedTerm
from barbalat.problem.shell import Shell
from barbalat.problem.tracking import Disturbance, MeasuredDynamics, Surroundings, TrackingProblem, require_signal
from barbalat.problem.truth import TruePlant, Truth, own_states, true_inputs, true_plant, true_sensor, true_unmatched
from barbalat.protocols import Signal, Value
from barbalat.settings import Settings
from barbalat.signals import Constant
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """The knowledge about the problem that a controller may use: everything except theta and d."""

    A_m: Array  # (n, n)
    b: Array  # (n,), or (n, m)
    k_0: Array | float
    x0: Array  # (n,) the initial state, which is measured; with an observer, the observer's initial state
    estimate_set: EstimateSet | None  # known set of all estimates: theta, and the input gains if they are unknown
    matched: MatchedTerm = MatchedTerm(Linear(), inputs=1)  # noqa: RUF009  # immutable; Phi(x)
    saturation: Array | None = None  # (2,) lower and upper limit of the actuator, (2, m) with m inputs; None without limits
    enters: Array | None = None  # (n,), or (n, q): the matrix by which the command enters the state directly, if it does
    nominal: Array | None = None  # theta at the declared values of the parameters; None without any
    theta_0: Array | None = None  # the baseline is u = k_0 r - theta_0'x, to which the adaptive part is added; None without one

    @property
    def inputs(self) -> int:
        return self.matched.inputs

    @property
    def parameters(self) -> int:
        """The number of estimates."""
        theta = self.matched.regressor.size(self.n) * self.inputs
        return theta + self.inputs if self.matched.gain_unknown else theta

    def commanded(self, r: Value) -> Value:
        """Return the part of the rate of a predictor's or a model's state that the command causes directly, not through the
        input; 0 if there is none."""
        return 0.0 if self.enters is None else np.dot(self.enters, r)

    @property
    def theta_set(self) -> KnownSet | None:
        """The known set of theta alone."""
        return (
            None if self.estimate_set is None else self.estimate_set.of_theta(self.matched.regressor.size(self.n) * self.inputs)
        )

    @property
    def departures(self) -> KnownSet | None:
        """The known set of theta - theta_0, which the adaptive part estimates, or of theta without a baseline."""
        theta = self.theta_set
        if theta is None or self.theta_0 is None:
            return theta
        if isinstance(theta, ParameterBall):
            center = theta.center - self.theta_0
            beside = 2 * np.finfo(float).eps * (theta.radius + float(np.abs(center).sum()))
            return ParameterBall(center=center, radius=theta.radius + beside)
        lower, upper = theta.lower - self.theta_0, theta.upper - self.theta_0
        down, up = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)  # a difference of zero is exact
        return ParameterBox(lower=np.where(lower == 0, 0.0, down), upper=np.where(upper == 0, 0.0, up))

    @property
    def adapted_command(self) -> Array | float:
        """The command's gain in the adaptive part: k_0, or 0 with a baseline, which contains the command."""
        return self.k_0 if self.theta_0 is None else 0.0 * np.asarray(self.k_0)

    @property
    def gains(self) -> ParameterBox | None:
        """The intervals of the unknown input gains, (m,); ``None`` if they are known."""
        if not self.matched.gain_unknown or self.estimate_set is None or self.estimate_set.intervals is None:
            return None
        return self.estimate_set.intervals.last(self.inputs)

    @property
    def n(self) -> int:
        return len(self.b)

    @property
    def P(self) -> Array:
        """The solution of P A_m + A_m'P = -I, (n, n)."""
        return _lyapunov_solution(self.A_m.tobytes(), self.n)


@lru_cache(maxsize=64)  # the members of an ensemble mostly share A_m
def _lyapunov_solution(A_m: bytes, n: int) -> Array:
    from scipy.linalg import solve_continuous_lyapunov

    P = solve_continuous_lyapunov(np.frombuffer(A_m).reshape(n, n).T, -np.eye(n))
    P = np.asarray((P + P.T) / 2)
    P.flags.writeable = False
    return P


@dataclass(frozen=True, eq=False, repr=False)
class Problem(TrackingProblem, Settings):
    """The tracking problem of Section II.

    plant, reference_model             equations (1) and (2)
    reference                          the command r(t); a list of commands if k_0 is a matrix
    uncertainty                        the known set Omega. For a plant with physical parameters, it follows from their ranges
                                       unless it is given; input_gain does too, unless it or the set is given
    disturbance                        matched: d(t) in x' = A_m x + b (theta'x + u + d)
    unmatched                          other disturbances, each with its own direction
    input_gain                         (lower, upper) > 0: the input's gain omega is unknown and estimated with theta; a list of
                                       pairs for several inputs with different intervals. Can be combined with a box, a ball or no
                                       known set
    sensor                             the path from the plant's state to the measurement; exact by default
    labels                             names and units of states and inputs, for pictures; none by default
    shell                              code around sampled controllers: it decides which samples are used and what acts without a
                                       sample
    faults                             faults between the plant and sampled controllers; none by default
    truth                              the simulated plant, if it differs from the plant for which controllers are designed
    observer                           estimates a state that is not measured, such as a ``KalmanObserver``. It is part of the
                                       controller and designed for the nominal plant; none by default
    """

    plant: Plant
    reference_model: ReferenceModel = field(default_factory=ReferenceModel)
    reference: Signal | tuple[Signal, ...] = field(default_factory=Constant)
    _: KW_ONLY
    uncertainty: KnownSet | None = None
    input_gain: tuple[float, float] | tuple[tuple[float, float], ...] | None = None
    disturbance: Signal | None = None
    unmatched: tuple[Disturbance, ...] = ()
    sensor: Sensor | None = None
    labels: Labels | None = None
    shell: Shell | None = None
    faults: tuple[Fault, ...] = ()
    truth: Truth | None = None
    observer: Observer | FixedObserver | None = None
    name: str = "problem"

    feedback: ClassVar[str] = "state"

    def __post_init__(self) -> None:
        validate.line("name", self.name)
        validate.instance("plant", self.plant, Plant)
        validate.instance("reference_model", self.reference_model, ReferenceModel)
        self._take_derived_set()
        if self.uncertainty is not None:
            validate.instance("uncertainty", self.uncertainty, (ParameterBox, ParameterBall))
            size, wanted = self.uncertainty.size, len(self.plant.theta)
            if size != wanted:
                field = f"uncertainty.{self.uncertainty.first_field}"
                raise InputError.of(field, f"must have {validate.counted(wanted, 'entry')}, one for each parameter, got {size}")
        if self.input_gain is not None:
            self._check_input_gain()
        if self.labels is not None:
            validate.instance("labels", self.labels, Labels)
            self.labels.require(self.plant.states, self.plant.inputs)
        self._check_commands()
        if self.disturbance is not None:
            require_signal("disturbance", self.disturbance)
            if self.plant.inputs > 1:
                raise InputError("disturbance needs a plant with one input; give unmatched with a direction instead")
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
        if self.observer is not None:
            self._check_observer()
        if self.sensor is not None:
            self.sensor.require(self.measured)
        if not isinstance(self.unmatched, (list, tuple)):
            raise InputError(f"unmatched must be a list of Disturbance, got {validate.show(self.unmatched)}")
        for disturbance in self.unmatched:
            validate.instance("unmatched", disturbance, Disturbance)
            validate.vector("unmatched.direction", disturbance.direction, self.plant.states)
        freeze(self, unmatched=tuple(self.unmatched))
        self.require_surroundings()
        self._check_truth()

    def _take_derived_set(self) -> None:
        if self.derived is not None and self.derived.used:
            gains = self.derived.input_gain
            freeze(self, uncertainty=self.derived.theta, input_gain=gains[0] if gains and self.plant.inputs == 1 else gains)
        elif self.derived is not None and self.uncertainty is None:
            freeze(self, uncertainty=self.derived.theta)

    def _check_truth(self) -> None:
        if self.truth is not None:
            validate.instance("truth", self.truth, Truth)
            if self.truth.disturbance is not None and self.plant.inputs > 1:
                raise InputError("truth.disturbance needs a plant with one input; give truth.unmatched with a direction instead")
        if self.simulated is not None:
            around = self.surroundings  # rejects what does not fit
            if around.sensor is not None:
                around.sensor.require(self.measured)
            if self.simulated.C is not None:
                self._check_true_measurement(self.simulated.C)

    def _check_true_measurement(self, C: Array) -> None:
        if self.fixed_observer is None:
            raise InputError.of("truth.C", "needs [observer], which estimates the state from the measurement y = C x")
        if len(C) != self.fixed_observer.outputs:
            outputs = validate.counted(self.fixed_observer.outputs, "row")
            raise InputError.of("truth.C", f"must have {outputs}, one for each quantity that the observer measures, got {len(C)}")

    def _check_observer(self) -> None:
        """Design the observer once. It does not change when the plant is replaced."""
        validate.instance("observer", self.observer, (Observer, FixedObserver))
        names = (self.labels or UNLABELLED).of_states(self.plant.states)
        if isinstance(self.observer, Observer):
            if not self.plant.is_linear:
                raise InputError("observer needs a plant with the regressor phi(x) = x, because it is a linear system")
            baseline, delay = self.plant.baseline, self.plant.paths[0].delay
            compared = baseline.H.any(axis=0) if baseline is not None and baseline.on_error else None
            freeze(self, observer=FixedObserver.of(self.observer, *self.nominal_matrices, names, delay, compared))
        fixed = self.fixed_observer
        assert fixed is not None
        if fixed.C.shape[1] != self.plant.states:
            raise InputError(
                f"observer is designed for a plant with {validate.counted(fixed.C.shape[1], 'state')}, but this plant has "
                f"{self.plant.states}: give new settings"
            )

    @property
    def nominal_matrices(self) -> tuple[Array, Array]:
        """A and b of the plant (without a baseline) as a designer knows them: plant.A as given, or A_m + b theta' at the middle
        of the known set.

        The true theta is not used, because controllers do not know it. Without a known set A is A_m.
        """
        plant = self.plant
        if plant.nominal_A is not None:
            return plant.nominal_A, plant.b[: plant.states]
        if self.uncertainty is None:
            return plant.A_m, plant.b
        return plant.A_m + plant.b.reshape(plant.n, -1) @ self.uncertainty.middle.reshape(plant.n, -1).T, plant.b

    @property
    def fixed_observer(self) -> FixedObserver | None:
        """The designed observer; None if the state is measured."""
        return self.observer if isinstance(self.observer, FixedObserver) else None

    @property
    def measured(self) -> int:
        return self.plant.states if self.fixed_observer is None else self.fixed_observer.outputs

    @property
    def measured_names(self) -> tuple[str, ...]:
        found = self.followed_names
        return found if self.fixed_observer is None else self.fixed_observer.names(found)

    @property
    def measured_labels(self) -> Labels | None:
        labels, observer = self.labels, self.fixed_observer
        if labels is None or observer is None:
            return labels
        given = labels.units  # a quantity that is not a single state has no unit
        units = tuple("" if at is None else given[at] for at in observer.places) if given else ()
        names = observer.names(labels.names) if labels.names else ()
        return replace(labels, names=names, units=units)

    @cached_property
    def starts_at(self) -> Array:
        """The state (n,) from which controllers start, which is x0, or with an observer its estimate from the measurement of
        x0."""
        p = self.plant
        if self.fixed_observer is None:
            return np.asarray(p.x0)
        own = self.fixed_observer.first(np.asarray(p.x0)[: p.states])
        return np.concatenate([own, np.asarray(p.x0)[p.states :]])

    def _check_input_gain(self) -> None:
        name, m = "uncertainty.input_gain", self.plant.inputs
        several = validate.dimensions(self.input_gain) == 2
        pairs = validate.array(name, self.input_gain, (m, 2)) if several else validate.vector(name, self.input_gain, 2)[None]
        for low, high in pairs:
            if not 0 < low <= high:
                raise InputError.of(name, f"must be [lower, upper] with 0 < lower <= upper, got [{low:g}, {high:g}]")
        given = tuple((float(low), float(high)) for low, high in pairs)
        freeze(self, input_gain=given if several else given[0])

    def _check_commands(self) -> None:
        given = self.reference
        commands = tuple(given) if isinstance(given, (list, tuple)) else (given,)
        for command in commands:
            require_signal("reference", command)
        self.reference_model.require_commands(self.plant, self.k_0, len(commands))
        freeze(self, reference=commands if self.plant.inputs > 1 else commands[0])  # several inputs: a list with one command

    @cached_property
    def k_0(self) -> Array | float:
        """The command's gain, (m, q) with m inputs. It comes from the model, the baseline, or the state that is to
        follow the command."""
        if self.plant.baseline is not None:
            return self.plant.baseline.feedforward
        return self.reference_model.gain(self.plant, (self.labels or UNLABELLED).of_states(self.plant.n))

    @property
    def declared_followers(self) -> tuple[int | None, ...]:
        baseline, follow = self.plant.baseline, self.reference_model.follow
        if baseline is not None:
            return tuple(int(np.argmax(row)) if np.count_nonzero(row) == 1 and row.max() == 1 else None for row in baseline.H)
        names = (self.labels or UNLABELLED).of_states(self.plant.n)
        followed = (follow,) if isinstance(follow, str) else follow or ()
        return tuple(names.index(name) for name in followed)

    @property
    def in_brief(self) -> str:
        n, m, p = self.plant.states, self.plant.inputs, len(self.parameters)
        known_set = "" if self.known.estimate_set is None else " in a known set"
        parts = f"{validate.counted(n, 'state')}, {validate.counted(m, 'input')}"
        return f"{parts}; {validate.counted(p, 'unknown parameter')}{known_set}"

    @property
    def input_paths(self) -> tuple[InputPath | None, ...]:
        """The equations of the path before each input. They contain an unknown gain even if it is 1, so all plants have the same
        structure."""
        known = self.input_gain is None
        return tuple(path.path if known else path.path_of_unknown_gain for path in self.surroundings.paths)

    @cached_property
    def derived(self) -> FromRanges | None:
        """The bounds from ranges of physical parameters; None for a plant without ranges."""
        found = self.plant.from_ranges
        if found is None:
            return None
        if self.uncertainty is None and self.input_gain is None:
            return found
        own, gains = self.uncertainty, self.input_gain
        is_set = isinstance(own, (ParameterBox, ParameterBall))  # other types are rejected later
        fits = own is None or (is_set and own.size == found.theta.size)
        pairs = None if gains is None else np.broadcast_to(gains, (self.plant.inputs, 2)).tolist()
        return replace(found, used=self._has(found), outside=found.beyond(own, pairs) if fits else "")

    def _has(self, found: FromRanges) -> bool:
        """Return whether the known set is the derived set, as in a copy in which other fields changed."""
        gains = None if self.input_gain is None else np.broadcast_to(self.input_gain, (self.plant.inputs, 2)).tolist()
        own, derived = self.uncertainty, None if found.input_gain is None else [list(pair) for pair in found.input_gain]
        if not isinstance(own, ParameterBox) or own.size != found.theta.size or gains != derived:
            return False
        return bool((own.lower == found.theta.lower).all() and (own.upper == found.theta.upper).all())

    @cached_property
    def simulated(self) -> TruePlant | None:
        """The plant that is simulated instead of the design plant; None if it is the same."""
        if self.truth is None and self.plant.physical is None:
            return None
        return true_plant(self.truth or Truth(), self.plant, (self.labels or UNLABELLED).of_states(self.plant.states))

    @property
    def design(self) -> Problem:
        """The problem for controllers and certificates: the plant and the declared sets, without a truth."""
        if self.simulated is None:
            return self
        plant = replace(self.plant, physical=None)
        found = replace(self, plant=plant, truth=None, uncertainty=self.uncertainty, input_gain=self.input_gain)
        vars(found)["derived"] = self.derived
        return found

    @property
    def nominal(self) -> Self:
        found = super().nominal
        if found is not self:
            vars(found)["derived"] = self.derived
        return found

    @cached_property
    def surroundings(self) -> Surroundings:
        """The paths and disturbances of the simulated plant, and its measurement."""
        if self.simulated is None:
            return super().surroundings
        truth = self.truth or Truth()
        paths, sensor = true_inputs(truth, self.plant), true_sensor(truth, self.plant, self.sensor)
        disturbance = self.disturbance if truth.disturbance is None else truth.disturbance
        return Surroundings(paths, disturbance, true_unmatched(truth, self.simulated, self.unmatched), sensor)

    def with_inputs(self, change: Callable[[PlantInput], PlantInput]) -> Self:
        """Return the problem with a changed path before each input, of both the plant and the truth."""
        found = super().with_inputs(change)
        if self.simulated is None:
            return found
        return replace(found, truth=replace(self.truth or Truth(), input=tuple(map(change, self.surroundings.paths))))

    def with_sensor(self, change: Callable[[Sensor | None], Sensor | None]) -> Self:
        """Return the problem with a changed sensor, of both the plant and the truth."""
        found, own = super().with_sensor(change), self.surroundings.sensor
        if self.simulated is None:
            return found
        return replace(found, truth=replace(self.truth or Truth(), sensor=change(own) or Sensor()))

    @cached_property
    def known(self) -> Known:
        p, gains = self.plant, None
        if self.input_gain is not None:
            low, high = np.broadcast_to(self.input_gain, (p.inputs, 2)).T
            gains = ParameterBox(lower=low, upper=high)
        return Known(
            A_m=p.A_m,
            b=p.b,
            k_0=self.k_0,
            x0=self.starts_at,
            estimate_set=with_gains(self.uncertainty, gains),
            matched=MatchedTerm(p.regressor, p.inputs, self.input_gain is not None),
            saturation=_limits(p),
            enters=p.enters,
            nominal=p.nominal_theta,
            theta_0=None if p.baseline is None else p.baseline.theta,
        )

    @property
    def parameters(self) -> Array:
        """The true values of all estimates: theta, and the input gains if they are unknown."""
        if self.input_gain is None:
            return self.plant.theta
        return np.concatenate([self.plant.theta, [path.gain for path in self.plant.paths]])

    @property
    def true_parameters(self) -> Array | None:
        """The true values for the simulated plant, by the weighted projection; None if its states differ."""
        from barbalat.problem.departures import true_parameters

        return self.parameters if self.simulated is None else true_parameters(self)

    @property
    def outside_known_set(self) -> str | None:
        """A sentence that the true values of the plant are outside the known set; otherwise None.

        If a truth has different values, its departures contain the sentence.
        """
        from barbalat.problem.departures import contains_up_to_rounding, same_values

        known_set, values, true = self.known.estimate_set, self.parameters, self.true_parameters
        if known_set is None or (true is not None and not same_values(true, values)):
            return None
        if known_set.contains(values) or (self.simulated is not None and contains_up_to_rounding(known_set, values)):
            return None
        name = "theta" if self.simulated is None else "the plant's theta"
        gains = "" if self.input_gain is None else " with the input gain,"
        return (
            f"{name}{gains} {validate.show([float(f'{value:.6g}') for value in values])} lies outside the known set, {known_set}"
            ": projected estimates cannot reach it, and no guarantee that depends on the set holds"
        )

    @property
    def dynamics(self) -> MeasuredDynamics:
        if self.simulated is not None:
            return self.simulated
        return self.plant if self.plant.baseline is None else own_states(self.plant)

    @property
    def fixed(self) -> FixedController | None:
        baseline = self.plant.baseline
        return None if baseline is None else baseline.within([path.saturation for path in self.plant.paths])

    @cached_property
    def model(self) -> Model:
        """The reference model (2), which starts at the initial state of the plant or of its observer."""
        p = self.plant
        return Model(p.A_m, p.b, self.k_0, self.starts_at, p.enters, None if p.baseline is None else p.states)


def _limits(plant: Plant) -> Array | None:
    limits = [path.saturation for path in plant.paths if path.saturation is not None]
    if len(limits) < plant.inputs:
        return None
    return limits[0] if plant.inputs == 1 else np.column_stack(limits)
