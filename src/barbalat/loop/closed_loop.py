"""Plant, reference model and controller as one system of differential equations; the only file that packs state vectors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.loop import input_paths
from barbalat.loop.around import Around
from barbalat.loop.binding import Bind, bound, is_sampled
from barbalat.loop.packing import LoopState, Outputs, Signals, SignalSizes, as_array, flatten, map_arrays, together, unflatten
from barbalat.loop.sampling import Acting, SampledController, held_model
from barbalat.problem.baseline import FixedController
from barbalat.problem.measurement import Sensor, nearest_multiple
from barbalat.problem.observer import ObserverEquations
from barbalat.problem.tracking import TrackingProblem
from barbalat.problem.truth import TruePlant
from barbalat.protocols import Controller, DiscretizedEquations, Dynamics, Equations, SampledEquations, Value
from barbalat.roles import StatePart, main_estimates, state_parts, taken_from
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """One controller on one problem. Flat states are vectors of length ``size``."""

    plant: Dynamics
    model: Dynamics
    equations: Equations | SampledEquations
    paths: input_paths.Paths = (None,)  # for each input
    commands: int | None = None  # None for a single scalar command
    lag: Sensor | None = None  # of the sensor
    noise_std: Array | None = None
    noise_bound: Array | None = None  # (p,) the largest |noise|
    resolutions: tuple[float | None, ...] | None = None  # of the sensor, for each measured quantity; a sampled controller's
    disturbed: bool = False
    directions: tuple[Array, ...] = ()  # directions of the unmatched disturbances
    output_disturbed: bool = False
    clocked: bool = False
    delayed: bool = False
    discrete_model: HeldSystem | None = None  # of a sampled controller
    around: Around | None = None  # its shell and its faults
    baseline: FixedController | None = None  # equations receive its states after the measurement
    external: FixedController | None = None  # external code computes its control and passes it to a sampled controller at samples
    reads: Array | None = None  # (p, n) C of the measurement; None if that is the plant's output
    true_reads: Array | None = None  # (p, N) C of the measurement of a truth's states, in place of ``reads``
    observer: ObserverEquations | None = None  # equations receive its estimate in place of the measurement
    begins: Any = None  # the equations' state at t = 0, in numbers, if the equations contain symbols

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller, *, bind: Bind = bound) -> ClosedLoop:
        """The loop; raises InputError if the controller does not fit the problem."""
        validate.instance("problem", problem, TrackingProblem)
        equations = bind(problem, controller)
        around, noise, fixed = problem.surroundings, problem.noise, problem.fixed_observer
        commands = len(problem.commands) if isinstance(problem.reference, tuple) else None
        if problem.faults and not is_sampled(equations):
            raise InputError(
                f"faults reach a controller at its samples, but {controller.name} is continuous: give it a sample_time",
                controller=controller.name,
            )
        resolutions = None if around.sensor is None else around.sensor.resolutions(problem.measured)
        return cls(
            problem.dynamics,
            problem.model,
            equations,
            paths=problem.input_paths,
            commands=commands,
            lag=around.sensor if around.sensor is not None and around.sensor.lag > 0 else None,
            noise_std=None if noise is None else noise.std * np.ones(problem.measured),
            noise_bound=None if noise is None or noise.bound is None else noise.bound * np.ones(problem.measured),
            resolutions=resolutions,
            disturbed=around.disturbance is not None,
            directions=tuple(disturbance.direction for disturbance in around.unmatched),
            output_disturbed=problem.output_disturbance is not None,
            clocked=problem.depends_on_time,
            delayed=problem.delay > 0,
            discrete_model=held_model(problem.model, equations.sample_time, commands) if is_sampled(equations) else None,
            around=Around.of(problem, equations.sample_time) if is_sampled(equations) else None,
            baseline=problem.fixed if problem.fixed is not None and problem.fixed.order else None,
            external=problem.fixed if problem.handed_controls and is_sampled(equations) else None,
            reads=None if fixed is None else fixed.C,
            true_reads=problem.dynamics.C if isinstance(problem.dynamics, TruePlant) else None,
            observer=_observing(problem, equations.sample_time if is_sampled(equations) else None),
        )

    def require_run(self) -> None:
        """Raise InputError for loops that can be analysed but not simulated: with a continuous controller on a quantised
        measurement, or with a sample time too long for a baseline's anti-windup."""
        for fixed in (self.baseline, self.external):
            if fixed is not None and self.sample_time is not None:
                fixed.require_sampled(self.sample_time)
        if self.resolutions is not None and not self.sampled:
            raise InputError.of(
                "sensor.quantization", "applies only to controllers that sample the sensor: give the controller a sample_time"
            )

    def initial(self) -> Array:
        """The flat state at t = 0; the model starts at the plant's state."""
        return np.asarray(flatten(self._initial))

    @cached_property
    def _initial(self) -> LoopState:
        y = self.reading(self.plant.x0)
        controller: Any = self.equations.initial() if self.begins is None else self.begins
        acting = None if self.computer is None else self.computer.initial(self.at_first, controller)
        return LoopState(
            x=self.plant.x0,
            x_m=self.model.x0,
            input=input_paths.initial(self.paths),
            sensor=np.zeros(0) if self.lag is None else y,
            baseline=np.zeros(0 if self.baseline is None or self.sampled else self.baseline.order),
            observer=np.zeros(0) if self.observer is None or self.sampled else self.observer.start,
            controller=controller,
            held=() if acting is None else acting.held,
        )

    @cached_property
    def computer(self) -> SampledController | None:
        """A sampled controller with its own reference model."""
        if not is_sampled(self.equations) or self.discrete_model is None:
            return None
        return SampledController(
            self.equations,
            self.model,
            self.discrete_model,
            self.inputs,
            self.commands,
            self.around,
            self.baseline,
            self.observer,
            self.external,
        )

    @property
    def at_first(self) -> Array:
        """The input of a sampled controller at t = 0, in numbers: the measurement, followed by an entry for each external
        control."""
        y = self.reading(self.plant.x0)
        return y if self.external is None else np.concatenate([y, np.zeros(self.inputs)])

    @cached_property
    def sampled(self) -> bool:
        """Whether the controller acts at samples."""
        return is_sampled(self.equations)

    @cached_property
    def sample_time(self) -> float | None:
        """The sample time of a sampled controller [s]."""
        return self.equations.sample_time if is_sampled(self.equations) else None

    @cached_property
    def continuous(self) -> Equations | SampledEquations:
        """The continuous equations behind a sampled controller; otherwise the equations themselves."""
        return self.equations.continuous if isinstance(self.equations, DiscretizedEquations) else self.equations

    @cached_property
    def inputs(self) -> int:
        """The number of control inputs."""
        return len(self.paths)

    @cached_property
    def signals(self) -> SignalSizes:
        """The signals that drive the loop: functions of time, noise of measured quantities, inputs after a delay."""
        return SignalSizes(
            commands=self.commands,
            matched=int(self.disturbed),
            unmatched=len(self.directions),
            at_output=int(self.output_disturbed),
            clock=int(self.clocked),
            noise=0 if self.noise_std is None else len(self.noise_std),
            delayed=self.inputs if self.delayed else 0,
            faults=0 if self.around is None else len(self.around.faults),
        )

    @cached_property
    def signal_count(self) -> int:
        """The number of values in ``signals``."""
        return self.signals.total

    @cached_property
    def size(self) -> int:
        return len(flatten(self._initial))

    @cached_property
    def errors(self) -> int:
        """Components of the tracking error e."""
        return int(self.model.output(self.model.x0).size)

    @cached_property
    def measured_outputs(self) -> int:
        """The number of outputs that are measured instead of the state."""
        return 0 if self.plant.output(self.plant.x0).ndim else 1

    @cached_property
    def parts(self) -> tuple[StatePart, ...]:
        """The arrays of the controller state with their roles and their positions in a flat state."""
        own = flatten((self._initial.controller, self._initial.held, np.zeros(0)))  # they come last in a flat state
        return state_parts(self.equations, self._initial.controller, self.size - len(own))

    @cached_property
    def estimates(self) -> StatePart | None:
        """The estimates that results call theta_hat (see ``main_estimates``); None for a controller without estimates."""
        return main_estimates(self.parts)

    @cached_property
    def other_estimates(self) -> tuple[StatePart, ...]:
        """The further estimates, which results list separately by name."""
        return tuple(part for part in self.parts if part.role.kind == "estimates" and part is not self.estimates)

    @cached_property
    def parameters(self) -> int:
        """The number of entries of theta_hat."""
        return 0 if self.estimates is None else self.estimates.size

    @cached_property
    def theta_hat_rows(self) -> slice:
        """The rows of theta_hat in a flat state."""
        return slice(0, 0) if self.estimates is None or not self.parameters else self.estimates.rows

    def theta_hat(self, controller: Any) -> Value:
        """The estimates in the controller state, (p,)."""
        return taken_from(controller, self.estimates)

    def unpack(self, flat: Value) -> LoopState:
        """The named parts of a flat state, numbers or symbols."""
        state, used = unflatten(self._initial, flat, 0)
        if used != len(flat):
            raise ValueError(f"a flat state of this loop has {used} entries, got {len(flat)}")
        return state  # type: ignore[no-any-return]

    def following_within(self, time: Value) -> ClosedLoop:
        """The loop for a solver whose step is ``time`` [s], within which its rate limiters, if any, follow their demand."""
        following = input_paths.following_within(self.paths, time)
        return self if following is self.paths else replace(self, paths=following)

    def derivative(self, flat: Value, signals: Value) -> Value:
        """The derivative of the flat state; ``signals`` (signal_count,) are in the order of ``Signals``."""
        state, given = self.unpack(flat), self.signals.named(signals)
        u = self._control(state, given)
        v = given.delayed.reshape(u.shape) if self.delayed else input_paths.output(self.paths, state.input, u)
        return flatten(self._rates(state, given, u, v))

    def derivative_given_input(self, flat: Value, signals: Value, v: Value) -> tuple[Value, Value]:
        """The derivative of the flat state, and the control u, of the loop broken at the plant's input, where v acts instead of
        u."""
        state, given = self.unpack(flat), self.signals.named(signals)
        u = self._control(state, given)
        return flatten(self._rates(state, given, u, v)), u

    def _rates(self, state: LoopState, given: Signals, u: Value, v: Value) -> LoopState:
        t = [given.clock[0]] if self.clocked else []
        x_dot = self.plant.derivative(state.x, v + given.matched[0] if self.disturbed else v, *t)  # (1), with (11)'s input
        for i, direction in enumerate(self.directions):
            x_dot = x_dot + direction * given.unmatched[i]
        y = self._measured(state, given)
        controller, held = state.controller, state.held
        if isinstance(self.equations, SampledEquations):
            controller, held = (map_arrays(lambda value: 0 * value, part) for part in (controller, held))
        else:
            controller = self.equations.derivative(controller, *self._handed(state, y), given.r, u)
        seen = self._seen(state, y)
        return LoopState(
            x=x_dot,
            x_m=self.model.derivative(state.x_m, given.r),  # (2)
            input=input_paths.derivative(self.paths, state.input, u),
            sensor=state.sensor if self.lag is None else self.lag.derivative(state.sensor, self._read(state, given)),
            baseline=self._of_the_baseline(state, seen, given.r, u),
            observer=state.observer if self.observer is None or self.sampled else self.observer.derivative(state.observer, y, u),
            controller=controller,
            held=held,
        )

    def sampled_at(self, flat: Value, signals: Value) -> tuple[Value, Value]:
        """The input of a sampled controller: the measurement, followed by the control of an external baseline; and the
        command."""
        state, given = self.unpack(flat), self.signals.named(signals)
        y = self._measured(state, given)
        if self.computer is None or self.external is None:
            return y, given.r
        return np.concatenate([y, self.computer.external_control(state.held, y, given.r)]), given.r

    def sample(self, flat: Value, signals: Value, freeze: Value = None) -> Value:
        """The flat state after a sampled controller has acted: it advances from the last sample to this one and sets u.

        Without a shell and faults, if ``freeze`` is above 0, the estimates and the law's memory are held.
        """
        assert self.computer is not None
        state, (y, r) = self.unpack(flat), self.sampled_at(flat, signals)
        before = Acting(state.controller, state.held)
        if self.around is None:
            return flatten(state._replace(**self.computer.act(before, y, r, freeze)._asdict()))
        taken = self.around.take(state.held, y, r, self.signals.named(signals).faults)
        acted = self.computer.act(before, taken.y, taken.r, taken.freeze)
        return flatten(state._replace(**self.around.put_out(taken, before, acted)._asdict()))

    def undelayed_input(self, flat: Value, signals: Value) -> Value:
        """The signal that enters the delay."""
        state = self.unpack(flat)
        return input_paths.output(self.paths, state.input, self._control(state, self.signals.named(signals)))

    @cached_property
    def rate_limited(self) -> tuple[int, ...]:
        """The inputs with a rate limit, and so with a limiter that has a state."""
        return tuple(i for i, path in enumerate(self.paths) if path is not None and path.rate_limit is not None)

    @cached_property
    def limiter_rows(self) -> tuple[int, ...]:
        """The positions of the limiter outputs in a flat state."""
        places = self.unpack(np.arange(self.size)).input
        return tuple(int(places[i].limited[0]) for i in self.rate_limited)

    @property
    def rate_limits(self) -> Value:
        """The largest rates of the limiters, (L,)."""
        return together([path.rate_limit for path in self.paths if path is not None and path.rate_limit is not None])

    def demands(self, flat: Value, signals: Value) -> Value:
        """The demand that each rate limiter follows, (L,)."""
        state = self.unpack(flat)
        u = self._control(state, self.signals.named(signals)).reshape(-1)
        return together(
            [path.asked(u[i]) for i, path in enumerate(self.paths) if path is not None and path.rate_limit is not None]
        )

    def _output(self, state: LoopState, given: Signals) -> Value:
        y = self.plant.output(state.x)
        return y + given.at_output[0] if self.output_disturbed else y

    def followed(self, state: LoopState, given: Signals) -> Value:
        """The output that should follow the model, without sensor lag and noise, (n,)."""
        return self._output(state, given).reshape(-1)

    def reading(self, x: Value) -> Value:
        """The measurement of the plant's state x without lag and noise: (p,), or a scalar."""
        if self.true_reads is not None:
            return self.true_reads @ x
        y = self.plant.output(x)
        return y if self.reads is None else self.reads @ y

    def _read(self, state: LoopState, given: Signals) -> Value:
        return self._output(state, given) if self.reads is None else self.reading(state.x)

    def _measured(self, state: LoopState, given: Signals) -> Value:
        y = self._read(state, given) if self.lag is None else state.sensor
        if self.noise_std is not None:
            noise = self.noise_std * given.noise
            y = y + (noise if self.noise_bound is None else _limited(noise, self.noise_bound)).reshape(y.shape)
        return y if self.resolutions is None else _quantised(y, self.resolutions)

    def _control(self, state: LoopState, given: Signals) -> Value:
        if self.sampled:
            return state.held.u
        return as_array(self.equations.control(state.controller, *self._handed(state, self._measured(state, given)), given.r))

    def _seen(self, state: LoopState, y: Value) -> Value:
        """The plant's state as known to the controller: the measurement, or an observer's estimate."""
        return y if self.observer is None or self.sampled else self.observer.estimate(state.observer, y)

    def _handed(self, state: LoopState, y: Value) -> tuple[Value, Value]:
        """The states of plant and model that equations receive, including the states of a baseline."""
        seen = self._seen(state, y)
        if self.baseline is None:
            return seen, self.model.output(state.x_m)
        return np.concatenate([seen, state.baseline]), state.x_m

    def received(self, state: LoopState, x: Value) -> Value:
        """The input of the equations, without noise, if x is the state or output of the plant: x or an observer's estimate of it,
        followed by the states of a baseline."""
        own: Any = state.held if self.sampled else state
        if self.observer is not None and self.reads is not None:
            y = self.reading(state.x) if self.lag is None else state.sensor
            x = self.observer.estimate(own.observer, own.measured[: y.size] if self.sampled else y)
        return x if self.baseline is None else np.concatenate([x, own.baseline])

    def _of_the_baseline(self, state: LoopState, seen: Value, r: Value, u: Value) -> Value:
        """The derivatives of the baseline's states; a sampled controller advances these states itself."""
        if self.baseline is None or self.sampled:
            return state.baseline
        return self.baseline.derivative(state.baseline, seen, r, u)

    def limit(self, flat: Value) -> Value:
        """The state with the estimates limited to the known set; it is applied at every stage and at the end of a step."""
        state = self.unpack(flat)
        if isinstance(self.equations, SampledEquations):  # after the estimates have moved
            return flatten(state._replace(held=state.held._replace(theta_hat=self.theta_hat(state.controller))))
        return flatten(state._replace(controller=self.equations.limit(state.controller)))

    def estimates_moved(self, flat: Value, following: Value) -> Value:
        """|change of theta_hat| by a step from ``flat`` to ``following``, including a sample at its start, (n,)."""
        state = self.unpack(flat)
        now = self.theta_hat(state.controller)
        moved = now - state.held.theta_hat if self.sampled else self.theta_hat(self.unpack(following).controller) - now
        return np.abs(moved)

    def outputs(self, flat: Value, signals: Value) -> Outputs:
        state, given = self.unpack(flat), self.signals.named(signals)
        u, y = self._control(state, given), self._output(state, given)
        e = (y - self.model.output(state.x_m)).reshape(-1)
        x = state.x if self.measured_outputs else y  # for a truth model with more states, the states of the design plant
        y = y.reshape(-1)[: self.measured_outputs]
        x_m = state.x_m if self.baseline is None else self.model.output(state.x_m)
        return Outputs(e, u.reshape(-1), self.theta_hat(state.controller), x, x_m, y)


def _limited(noise: Value, bound: Array) -> Value:
    return np.concatenate([np.clip(one, -most, most).reshape(1) for one, most in zip(noise, bound, strict=True)])


def _quantised(y: Value, resolutions: tuple[float | None, ...]) -> Value:
    """The nearest multiple of each quantity's resolution, in the shape of y."""
    read = [one if q is None else nearest_multiple(one, q) for one, q in zip(y.reshape(-1), resolutions, strict=True)]
    return np.concatenate([one.reshape(1) for one in read]).reshape(y.shape)


def _observing(problem: TrackingProblem, T: float | None) -> ObserverEquations | None:
    """The observer of a problem, continuous or for samples of length T [s]; None if there is none."""
    if problem.fixed_observer is None:
        return None
    known: Any = problem.known
    n = problem.fixed_observer.C.shape[1]
    return problem.fixed_observer.equations(np.asarray(known.x0)[:n], known.saturation, T)
