"""L1 adaptive control with the piecewise-constant law, which is used in flight: always sampled, without an adaptive gain.

The law estimates no parameters; at every sample it estimates sigma, the uncertainty that acts on the plant. Because it is linear
and has no memory beyond a sample, the whole controller is linear, time-invariant and sampled: see ``realisation``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.l1 import require_low_pass
from barbalat.controllers.piecewise_filter import FilterStep, filter_step
from barbalat.controllers.piecewise_predictor import SPAN, AsFlown, PredictorStep, next_span
from barbalat.controllers.settings import Scheme, require_taken
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.linear.systems import TransferFunction, two_slopes
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Sample, Value, kept
from barbalat.roles import Role
from barbalat.validate import Array, InputError

PATENT_NOTE = (
    "This is the piecewise-constant L1 law of published papers; it does not use the flight code L1Quad. That code\n"
    "names US patent 8,712,559 for the law: ask whether it covers your use before you fly it."
)


class State(NamedTuple):
    """The discrete-time states; no parameter is estimated."""

    theta_hat: Value  # (0,)
    x_hat: Value  # (n,) predictor
    sigma_hat: Value  # (n,) estimated uncertainty: the first m entries at the input, the others unmatched
    filter: Value  # (N,) states of C(s), and of the inverse of the model if the unmatched part is compensated
    span: Value  # () samples over which x_hat - x accumulates: 1 unless measurements are missed


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The discrete-time equations."""

    sample_time: float
    predictor: PredictorStep
    filter: FilterStep
    matched: MatchedTerm
    k_0: Array  # (m, q)
    direct: Array | None  # theta_0 (p m,) of a baseline that acts unfiltered; None: the command passes the filter
    x0: Array
    limits: Array | None = None  # limits of the input, if the predictor receives sat(u)
    frozen: Value = None  # where it is true, sigma_hat is held; None: never

    roles: ClassVar[Mapping[str, Role]] = {
        "sigma_hat": Role.estimates("sigma", meaning="sigma_hat, the total disturbance of the plant"),
        "span": SPAN,
    }

    def initial(self) -> State:
        return State(np.zeros(0), self.x0, np.zeros(len(self.x0)), np.zeros(len(self.filter.A)), np.ones(()))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u = self.filter.output(state.filter, self._filtered(state.sigma_hat, r))
        if self.direct is not None:
            u = u + self._commanded(r) - self._nominal(x)
        return u[0] if self.matched.inputs == 1 else u

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        reaches = applied(u, self.limits).reshape(-1)
        known = reaches if self.direct is None else reaches + self._nominal(before.x)
        x_hat = self.predictor.following(state.x_hat, before.x, known, state.sigma_hat)
        if self.frozen is not None:
            corrected = self.predictor.measured_again(x_hat, now.x, state.sigma_hat, state.span)
            x_hat = kept(self.frozen, x_hat, kept(state.span > 1, corrected, x_hat))
        sigma_hat = kept(self.frozen, state.sigma_hat, self.predictor.estimate(x_hat - now.x))
        wanted = self._filtered(state.sigma_hat, before.r), self._filtered(sigma_hat, now.r)
        span = next_span(self.frozen, state.span, self.predictor.memory)
        return State(state.theta_hat, x_hat, sigma_hat, self.filter.end(state.filter, *wanted), span)

    def freezing(self, frozen: Value) -> Equations:
        return replace(self, frozen=frozen)

    def _filtered(self, sigma_hat: Value, r: Value) -> Value:
        """The signals that pass through C(s): k_0 r - sigma_hat at the inputs, and the unmatched sigma_hat."""
        m = self.matched.inputs
        wanted = -sigma_hat[:m] if self.direct is not None else self._commanded(r) - sigma_hat[:m]
        return np.concatenate([wanted, sigma_hat[m:]])

    def _commanded(self, r: Value) -> Value:
        return self.k_0 @ r.reshape(-1)

    def _nominal(self, x: Value) -> Value:
        return (self.matched.phi(x).T @ self.direct).reshape(-1)


@dataclass(frozen=True, eq=False)
class L1PiecewiseConstant(Scheme):
    """u = C(s)[k_0 r - sigma_hat_m - H_m(s)^-1 H_um(s) sigma_hat_um], sigma_hat = -B^-1 Phi^-1 e^(A_m T) x_tilde at each sample.

    B = [b, b_um] with b'b_um = 0, Phi = A_m^-1 (e^(A_m T) - I), predictor x_hat' = A_m x_hat + b u + B sigma_hat, exact at the
    samples, x_tilde = x_hat - x. The scheme is always sampled: it has no alternative discretization, no adaptive gain and no
    known set.

    sample_time  T [s]; a whole number of solver steps if these are fixed
    filter       C(s): stable, strictly proper, C(0) = 1, discretised by the trapezoidal rule; starts at rest. ``None`` means C =
                 1
    output       c, (n,), or (m, n) with m inputs: the effect of the unmatched sigma_hat_um on c'x is cancelled, by C H_m^-1 H_um
                 with H = c'(sI - A_m)^-1 [b, b_um]. By default it is only estimated
    as_flown     the form used in flight codes, with the baseline unfiltered; by default the exact form
    saturated_predictor  against windup: the predictor receives sat(u); off by default

    Source: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 3.3; the flown form: Wu et al., L1Quad (2023), whose
    code is not used here. That project refers to US patent 8,712,559, so clarify the licence before you fly this law.
    """

    sample_time: float
    filter: TransferFunction | None
    _: KW_ONLY
    output: Array | None = None
    as_flown: AsFlown | None = None
    saturated_predictor: bool = False
    name: str = "L1, piecewise constant"

    beyond: ClassVar[tuple[str, ...]] = ("an unknown input gain", "a baseline")

    patent: ClassVar[str] = PATENT_NOTE

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(self, sample_time=validate.positive("sample_time", self.sample_time))
        if self.filter is not None:
            validate.freeze(self, filter=require_low_pass(TransferFunction.accept("filter", self.filter)))
        if self.output is not None:
            rows = (None,) if validate.dimensions(self.output) == 1 else (None, None)
            validate.freeze(self, output=validate.array("output", self.output, rows))
        if self.as_flown is not None:
            validate.instance("as_flown", self.as_flown, AsFlown)

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        T = reach.sample_time
        return TuningGrid(
            scheme="L1 piecewise",
            values={"kappa": reach.times, "slope_ratio": reach.slope_ratios},
            make=lambda kappa, slope_ratio: cls(
                sample_time=T,
                filter=two_slopes(kappa, slope_ratio),
                saturated_predictor=reach.saturated,
                name="L1 piecewise",
            ),
            traded=False,
            whole=("slope_ratio",),
            aims=("reference_distance",),
        )

    @property
    def assumed_sample_time(self) -> float:
        """The sample time in the controller's own coefficients [s]."""
        assumed = None if self.as_flown is None else self.as_flown.assumed_sample_time
        return self.sample_time if assumed is None else assumed

    def bind(self, known: Known) -> Equations:
        require_taken(L1PiecewiseConstant, known)
        B, T, flown, output = input_directions(known.b), self.assumed_sample_time, self.as_flown, self.output
        if output is not None:  # c', (m, n)
            output = validate.array("output", np.atleast_2d(output), (known.inputs, known.n))
        return Equations(
            sample_time=self.sample_time,
            predictor=PredictorStep.exact(known.A_m, B, T) if flown is None else flown.step(known.A_m, B, T),
            filter=filter_step(known.A_m, B, known.inputs, self.filter, output, T),
            matched=known.matched,
            k_0=np.reshape(known.k_0, (known.inputs, -1)),
            direct=None if flown is None else flown.baseline(known.parameters),
            x0=known.x0,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )


def input_directions(b: Array) -> Array:
    """B = [b, b_um], (n, n), with an orthonormal basis of the complement of b; raises InputError if b's columns are linearly
    dependent."""
    columns = b.reshape(len(b), -1)
    m = columns.shape[1]
    left, sizes, _ = np.linalg.svd(columns)
    if not sizes[-1] > np.finfo(float).eps * len(b) * sizes[0]:
        raise InputError(f"l1-piecewise needs independent columns of plant.b, got {validate.show(b)}")
    return np.column_stack([columns, left[:, m:]])


class Realisation(NamedTuple):
    """s[k+1] = A s[k] + B y[k], u[k] = C s[k] + D y[k] with y = (x, r), the measurement at sample k.

    s = (x_hat, the filter's states before their sample). In the exact form, x_hat is e^(A_m T) x + Phi b u from the last sample,
    so the predictor does not depend on its previous state.
    """

    A: Array
    B: Array
    C: Array
    D: Array


def realisation(equations: Equations) -> Realisation:
    """The controller as a linear time-invariant system, for phi(x) = x and without limits."""
    p, f = equations.predictor, equations.filter
    m, n = len(equations.k_0), len(equations.x0)
    K = np.zeros((m, n)) if equations.direct is None else equations.direct.reshape(n, m).T
    zero, k_0 = np.zeros((n, equations.k_0.shape[1])), equations.k_0
    sign = np.diag([-1.0] * m + [1.0] * (n - m))  # sigma_hat in the filter's input
    command = np.vstack([k_0, zero[m:]]) * (equations.direct is None)
    # the filter's input: w = sign sigma_hat + command r with sigma_hat = -G (x_hat - x)
    w_s, w_y = np.hstack([-sign @ p.G, np.zeros((n, len(f.A)))]), np.hstack([sign @ p.G, command])
    z_s, z_y = np.hstack([np.zeros((len(f.A), n)), np.eye(len(f.A))]) + f.B @ w_s, f.B @ w_y
    u_s, u_y = f.C @ z_s + f.D @ w_s, f.C @ z_y + f.D @ w_y
    if equations.direct is not None:
        u_y = u_y + np.hstack([-K, k_0])
    of_input = p.of_acting[:, :m]
    forgets, measured = p.of_x_hat - p.of_acting @ p.G, p.of_x + p.of_acting @ p.G + of_input @ K
    x_s = np.hstack([forgets, np.zeros((n, len(f.A)))]) + of_input @ u_s
    x_y = np.hstack([measured, zero]) + of_input @ u_y
    return Realisation(np.vstack([x_s, f.A @ z_s + f.B @ w_s]), np.vstack([x_y, f.A @ z_y + f.B @ w_y]), u_s, u_y)


def started(equations: Equations, x: Array, r: Any) -> Array:
    """s[0] of the realisation, with the predictor at the measured x and the filter at rest."""
    first = equations._filtered(np.zeros(len(x)), r)
    return np.concatenate([x, -equations.filter.B @ first])
