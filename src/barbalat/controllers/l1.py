"""L1 adaptive control for measured states: eqs (5)-(8), MRAC with a low-pass filter C(s) on the control."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.lyapunov import Modifications
from barbalat.adaptation.modifications import DeadZone, Leakage
from barbalat.controllers.settings import Scheme, bound_with_lyapunov_law, check_common
from barbalat.controllers.steps import Filter, Unmoved, half_step
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.controllers.windup import ModifiedError, applied, limits_of_predictor
from barbalat.linear.systems import StateSpace, TransferFunction, two_slopes
from barbalat.problem.known_set import EstimateSet, Gain, KnownSet, gain, limit
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Sample, Value, kept
from barbalat.roles import Role, resting, within
from barbalat.validate import Array, InputError, Vector


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictor (8) and law (7) in one implicit step; with C = 1 this is MRAC.

    V = x_tilde'P x_tilde + theta_tilde'Gamma^-1 theta_tilde decreases by at least T |x_tilde|^2 per sample, for every Gamma and
    T. The predictor uses the estimate after projection onto the known set, so with C = 1 it follows the reference model.
    """

    continuous: Equations
    sample_time: float
    known_set: KnownSet | None  # the set that the step respects; with a leakage it also contains the origin
    end: Array  # (I - T A_m)^-1
    filter: Filter
    coupling: Array | float  # T b'P (I - T A_m)^-1 b > 0; (m, m) with m inputs
    windup: ModifiedError | None = None
    frozen: Value = None  # where it is true, estimates and memory are held; None: never

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: Equations, T: float, windup: ModifiedError | None = None) -> Predictor:
        modifications, estimate_set = equations.modifications, equations.estimate_set
        if modifications.dead_zone is not None:
            raise InputError(
                "discretization = 'midpoint' cannot be combined with a dead zone on sqrt(e'P e), because its implicit step has "
                "no closed form; use "
                "'euler', or a dead zone in a law on the parametric model"
            )
        implicit.require_projectable(equations.gamma, estimate_set)
        size, leaking = len(equations.theta_hat0), modifications.leakage is not None
        end = half_step(equations.A_m, 2 * T)
        coupling = T * (equations.b.T @ equations.P @ end @ equations.b)
        return cls(
            equations,
            T,
            None if estimate_set is None else estimate_set.kept_by_steps(size, leaking=leaking),
            end,
            Filter.of(equations.C, T),
            float(coupling) if np.ndim(coupling) == 0 else coupling,
            windup,
        )

    def initial(self) -> State:
        return self.continuous.initial()

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u = self.continuous.control(state, x, x_m, r)
        return u if self.windup is None else self.windup.control(u, self.continuous.limits)

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        c, T, u = self.continuous, self.sample_time, self.continuous.applied(u)
        unmoved = self._unmoved(state, before, u, now)
        memory = self._memory(state, before, u, now)
        moved = implicit.with_leakage(
            c.modifications.leakage, state.theta_hat, unmoved.error, lambda w: self._moved(state, memory, unmoved, w)
        )
        theta_hat, memory = kept(self.frozen, state.theta_hat, moved), self._remembered(state.memory, memory)
        x_hat = unmoved.x_hat + T * (self.end @ np.dot(c.b, unmoved.phi.T @ theta_hat))
        inside = kept(self.frozen, theta_hat, implicit.into(theta_hat, c.estimate_set, c.gamma))
        following = state._replace(theta_hat=inside, x_hat=x_hat, memory=memory)
        wanted = c.filter_input(state, before.x, before.r), c.filter_input(following, now.x, now.r)
        return following._replace(filter=self.filter.end(state.filter, *wanted))

    def freezing(self, frozen: Value) -> Predictor:
        return replace(self, frozen=frozen)

    def _remembered(self, before: Any, memory: Any) -> Any:
        """The memory with new data; if the memory is held, only the filters of the measurements continue."""
        learning = self.continuous.modifications.learning
        return memory if self.frozen is None or learning is None else resting(self.frozen, learning.roles, before, memory)

    def _unmoved(self, state: State, before: Sample, u: Value, now: Sample) -> Unmoved:
        c, T = self.continuous, self.sample_time
        phi = (c.matched.with_input(before.x, u) + c.matched.with_input(now.x, u)) / 2
        # A_m acts on x_mid - x_tilde: measurements enter as in the midpoint rule, estimates at the end of the sample
        measured = np.dot(c.b, c.matched.known_input(u)) - c.A_m @ ((now.x - before.x) / 2)
        if c.enters is not None:
            measured = measured + np.dot(c.enters, before.r)  # held over the sample, as in the sampled model
        x_hat = self.end @ (state.x_hat + T * measured)
        error = (now.x - x_hat) @ (c.P @ c.b) - np.dot(self.coupling, phi.T @ state.theta_hat)
        return Unmoved(x_hat, error, phi)

    def _moved(self, state: State, memory: Any, unmoved: Unmoved, w: Value) -> Value:
        """The estimate at the end of the sample under the leakage w."""
        c, T, learning = self.continuous, self.sample_time, self.continuous.modifications.learning
        pull = () if learning is None else (learning.gamma_c * memory.R, learning.gamma_c * memory.Q)
        gain, rest = implicit.at_rest(c.gamma, state.theta_hat, T, w, *pull)
        error = unmoved.error - np.dot(self.coupling, unmoved.phi.T @ (rest - state.theta_hat))
        return implicit.step_within(rest, gain.over(T), unmoved.phi, self.coupling, error, self.known_set)

    def _memory(self, state: State, before: Sample, u: Value, now: Sample) -> Any:
        c, learning = self.continuous, self.continuous.modifications.learning
        if learning is None:
            return state.memory
        phi = (c.matched.with_input(before.x, u) + c.matched.with_input(now.x, u)) / 2
        known = c.matched.known_input(u)
        return learning.advance(state.memory, self.sample_time, c.A_m, c.b, (before.x + now.x) / 2, phi, known)


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) estimate of theta, and of omega if the input gain is unknown
    x_hat: Value  # (n,) predictor
    filter: Value  # (order of C,) state of the filter C(s); (order of C, m) with m inputs
    memory: Any = ()  # of composite learning


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the prediction error."""

    A_m: Array
    b: Array
    k_0: Array | float
    P: Array
    matched: MatchedTerm
    gamma: Gain
    C: StateSpace
    theta_hat0: Array
    x0: Array
    estimate_set: EstimateSet | None
    modifications: Modifications = field(default_factory=Modifications)
    enters: Array | None = None  # the matrix by which the command enters the state directly
    theta_0: Array | None = None  # parameters of a baseline, which is not filtered
    limits: Array | None = None  # limits of the input, if the predictor receives sat(u)

    @property
    def roles(self) -> dict[str, Role]:
        return within("memory", self.modifications)

    def initial(self) -> State:
        inputs = self.matched.inputs
        at_rest = np.zeros(self.C.order if inputs == 1 else (self.C.order, inputs))
        return State(self.theta_hat0, self.x0, at_rest, self.modifications.initial(self.b, self.x0, len(self.theta_hat0)))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u = self.C.output(state.filter, self.filter_input(state, x, r))  # (5)
        return u if self.theta_0 is None else u + self.baseline(x, r)

    def baseline(self, x: Value, r: Value) -> Value:
        """The part of the control without adaptation, which is not filtered."""
        return np.dot(self.k_0, r) - self.matched.phi(x).T @ self.theta_0

    def filter_input(self, state: State, x: Value, r: Value) -> Value:
        """The input of C(s). With an unknown gain, (5) becomes u = C/(1 - C)[-theta_hat'phi - omega_hat u + k_0 r]."""
        theta_hat, omega_hat = self.matched.split(state.theta_hat)
        wanted = -self.matched.phi(x).T @ theta_hat + np.dot(self.k_0, r)
        beside = 0.0 if self.theta_0 is None else self.baseline(x, r)
        if not self.matched.gain_unknown:
            return wanted - beside
        if self.C.order == 0:
            return wanted / omega_hat - beside  # C = 1
        return wanted - omega_hat * (self.C.output(state.filter, 0 * wanted) + beside)

    def applied(self, u: Value) -> Value:
        """The control that the predictor receives."""
        return applied(u, self.limits)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        return self.matched.with_input(x, self.applied(u))

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        x_tilde = x - state.x_hat
        law, u = self.modifications, self.applied(u)
        phi, known = self.matched.with_input(x, u), self.matched.known_input(u)
        theta_hat_dot = law.rate(
            self.gamma, x_tilde, self.P, self.b, phi, state.theta_hat, state.memory, self.estimate_set
        )  # (7)
        x_hat_dot = self.A_m @ state.x_hat + np.dot(self.b, phi.T @ state.theta_hat + known)  # (8)
        if self.enters is not None:
            x_hat_dot = x_hat_dot + np.dot(self.enters, r)
        filter_dot = self.C.derivative(state.filter, self.filter_input(state, x, r))
        return State(theta_hat_dot, x_hat_dot, filter_dot, law.memory_rates(state.memory, self.A_m, self.b, x, phi, known))

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set))

    def sampled(self, T: float) -> Predictor:
        return Predictor.of(self, T)


@dataclass(frozen=True, eq=False)
class L1Adaptive(Scheme):
    """u = C(s)[-theta_hat'x + k_0 r], with the predictor x_hat and the law theta_hat' = proj(Gamma (x_tilde'P b) x).

    gamma       adaptive gain Gamma > 0: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    filter      C(s): stable, strictly proper, C(0) = 1; starts at rest. ``None`` means C = 1, which is the standard MRAC
    theta_hat0  (p,), zero by default; inside the known set
    projection  onto the known set; on by default if there is one. The estimate of an unknown input gain is always projected
    leakage, dead_zone  modifications of the law, none by default: see ``adaptation.lyapunov``
    learning    a memory of past data; none by default
    saturated_predictor  against windup: the predictor receives sat(u), times omega_hat if the input gain is unknown, so the limit
                         does not affect x_tilde; off by default

    Source: eqs (5)-(8); Hovakimyan and Cao, L1 Adaptive Control Theory, section 2.1.
    """

    gamma: float | Array
    filter: TransferFunction | None
    _: KW_ONLY
    theta_hat0: Vector | None = None
    projection: bool | None = None
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None
    learning: CompositeLearning | None = None
    saturated_predictor: bool = False
    name: str = "L1"

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", gain.accept("gamma", self.gamma))
        Modifications.of(self)  # rejects parts that can't be combined
        if self.filter is not None:
            object.__setattr__(self, "filter", require_low_pass(TransferFunction.accept("filter", self.filter)))

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        return TuningGrid(
            scheme="L1-AC",
            values={"kappa": reach.times, "slope_ratio": reach.slope_ratios, "gamma": reach.gains(1e-7, reach.density)},
            make=lambda kappa, slope_ratio, gamma: cls(
                gamma=gamma,
                filter=two_slopes(kappa, slope_ratio),
                theta_hat0=reach.theta_hat0,
                saturated_predictor=reach.saturated,
                name="L1-AC",
            ),
            whole=("slope_ratio",),
            aims=("condition", "error_bound"),
        )

    def bind(self, known: Known) -> Equations:
        return Equations(
            **bound_with_lyapunov_law(self, known),
            C=self._filter(unknown_gain=known.matched.gain_unknown),
            theta_0=known.theta_0,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )

    def _filter(self, *, unknown_gain: bool) -> StateSpace:
        """C(s), or with an unknown gain C/(1 - C), which is C with positive feedback of its output."""
        if self.filter is None:
            return StateSpace.gain(1.0)
        C = self.filter.realise()
        return StateSpace(C.A + np.outer(C.B, C.C), C.B, C.C, 0.0) if unknown_gain else C


def require_low_pass(C: TransferFunction) -> TransferFunction:
    """Return C(s) if it is strictly proper and stable with C(0) = 1; raise InputError otherwise."""
    shown = f"num = {validate.show(C.num)}, den = {validate.show(C.den)}"
    if C.relative_degree < 1:
        raise InputError(f"filter must be strictly proper (degree of num below that of den), got {shown}")
    if not C.is_stable:
        raise InputError(f"filter must be stable, but a pole has real part {C.poles.real.max():.6g}: {shown}")
    if abs(C.dc_gain - 1) > 1e-9:  # coefficients are entered as decimals, and a ratio of two of them has this error
        raise InputError(f"filter must have unit DC gain, C(0) = 1, got {C.dc_gain:.9g}: {shown}")
    return C
