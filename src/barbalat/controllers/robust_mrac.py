"""Robust MRAC with normalisation and an auxiliary input for the transient: eqs (13)-(16).

Without the auxiliary input, the same equations are the normalised MRAC mentioned in Section II.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.law import AdaptiveLaw, Estimation, Normalization, require_law
from barbalat.adaptation.laws.gradient import Gradient
from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.controllers import robust_mrac_several as several
from barbalat.controllers.parametric_model import Estimator, OnParametricModel, State, auxiliary_filter, minimum_phase_model
from barbalat.controllers.settings import (
    Scheme,
    check_common,
    initial_estimate,
    projection_set,
    require_taken,
)
from barbalat.controllers.steps import Filter, LinearStep
from barbalat.controllers.tuning_grid import SLOWNESS_RATIO, TuningGrid, TuningScale
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import EstimateSet
from barbalat.problem.regressors import Regressor
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Sample, Value
from barbalat.validate import Array, Vector


@dataclass(frozen=True, eq=False)
class StateEstimator(Estimator):
    """The normalised laws on the parametric model (13)."""

    continuous: Equations

    @classmethod
    def of(cls, equations: Equations, T: float) -> StateEstimator:
        law = implicit.require_sampled(equations.law, equations.estimate_set)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        return cls(equations, T, law, LinearStep.of(equations.A_m, T), Q)

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        c = self.continuous
        u = applied(u, c.limits)
        x_mid = (before.x + now.x) / 2
        known = c.b * u if c.enters is None else c.b * u + np.dot(c.enters, before.r)
        xi_mid = self.model.middle(state.xi, known)
        Xi_mid = self.model.middle(state.Xi, np.outer(c.b, (c.regressor(before.x) + c.regressor(now.x)) / 2))
        learnt = self.learnt(state, z=c.c_0 @ (x_mid - xi_mid), phi=c.c_0 @ Xi_mid, driven=u * u)  # (13)
        following = state._replace(**learnt._asdict(), xi=2 * xi_mid - state.xi, Xi=2 * Xi_mid - state.Xi)
        following = following._replace(swapping=self.swapped(state, following, Xi_mid))
        return following._replace(filter=self.filtered(state, following, before, now))


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations(OnParametricModel):
    """The law is driven by the estimation error of the parametric model (13)."""

    A_m: Array
    b: Array
    k_0: float
    regressor: Regressor
    c_0: Array
    Q: StateSpace | None
    law: AdaptiveLaw
    normalization: Normalization
    theta_hat0: Array
    x0: Array
    estimate_set: EstimateSet | None
    limits: Array | None = None  # limits of the input, if the parametric model receives sat(u)
    enters: Array | None = None  # the matrix by which the command enters the state directly

    def estimation(self, state: State, x: Value) -> Estimation:
        z = self.c_0 @ (x - state.xi)  # (13)
        phi = self.c_0 @ state.Xi  # (13)
        m_s_squared = self.normalization.m_s_squared(phi, state.n_d)  # (16)
        return Estimation(phi, m_s_squared, (z - state.theta_hat @ phi) / m_s_squared)

    def auxiliary_input_argument(self, state: State, x: Value) -> Value:
        """The input of -Q(s); its second term has the opposite sign in the paper, which is an erratum (see RobustMrac)."""
        estimation = self.estimation(state, x)
        return estimation.epsilon * estimation.m_s_squared + self.c_0 @ state.swapping

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u = -state.theta_hat @ self.regressor(x) + self.k_0 * r
        if self.Q is None:
            return u
        return u - self.Q.output(state.filter, self.auxiliary_input_argument(state, x))  # (14)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        u = applied(u, self.limits)
        rates = self.law.rates(state.theta_hat, state.memory, self.estimation(state, x), self.estimate_set)  # (15)
        swapping_dot, filter_dot = self.auxiliary_rates(state, x, rates.theta_hat)
        xi_dot = self.A_m @ state.xi + self.b * u
        return State(
            theta_hat=rates.theta_hat,
            memory=rates.memory,
            xi=xi_dot if self.enters is None else xi_dot + np.dot(self.enters, r),
            Xi=self.A_m @ state.Xi + np.outer(self.b, self.regressor(x)),
            n_d=self.normalization.n_d_dot(state.n_d, u),
            swapping=swapping_dot,
            filter=filter_dot,
        )

    def sampled(self, T: float) -> StateEstimator:
        return StateEstimator.of(self, T)


@dataclass(frozen=True, eq=False)
class RobustMrac(Scheme):
    """u = -theta_hat'x + k_0 r + u_a with a law on the linear parametric model and the auxiliary input u_a.

    tau            time constant of the auxiliary input [s], > 0
    law            LeastSquares, as in the paper, or another law of ``adaptation.laws``
    c_0            (n,), P b by default; with m inputs (m, n), b'P by default. W_m(s) = c_0'(sI - A_m)^-1 b must be minimum phase
    normalization  normalisation of the estimation error: eq. (16)
    theta_hat0     (n,), zero by default; inside the known set
    projection     onto the known set; on by default if there is one
    saturated_predictor  against windup: the parametric model and n_d receive sat(u); off by default

    Erratum of (14). By the swapping lemma, without modelling error and with x_m(0) = x(0),
        c_0'e = epsilon m_s^2 + c_0'(sI - A_m)^-1 [Xi theta_hat'] + W_m(s)[u_a],
    so u_a = -Q(s)[epsilon m_s^2 + c_0'(sI - A_m)^-1 [Xi theta_hat']] leaves the fraction 1 - 1/(tau s + 1)^n* of it.
    The paper's W_c0 = -c_0'(sI - A_m)^-1 with a plus in front contradicts that identity.

    Windup. With xi' = A_m xi + b sat(u) the model z = theta'phi is exact for every limit, and so is
        c_0'e = epsilon m_s^2 + c_0'(sI - A_m)^-1 [Xi theta_hat'] + W_m(s)[u_a + sat(u) - u].
    The part of u beyond the limit affects e but not learning. With u instead, epsilon would contain W_m(s)[sat(u) - u], which
    no theta explains.

    Source: eqs (13)-(16); Ioannou and Sun, section 9.4; Datta and Ioannou (1994). The treatment of windup is derived here from
    (13).
    """

    tau: float
    law: AdaptiveLaw
    _: KW_ONLY
    c_0: Array | None = None
    normalization: Normalization = field(default_factory=Normalization)
    theta_hat0: Vector | None = None
    projection: bool | None = None
    saturated_predictor: bool = False
    name: str = "Robust MRAC"

    beyond: ClassVar[tuple[str, ...]] = ("an unknown input gain",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tau", validate.positive("tau", self.tau))
        _check_model_and_law(self)

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        slowest = max(reach.times[-1], 1 / Normalization().delta_0)  # tau < 1/delta_0
        return TuningGrid(
            scheme="Robust MRAC",
            values={
                "tau": np.geomspace(reach.times[0], slowest, len(reach.times)),
                "covariance0": np.geomspace(1e-2, 1e4, reach.density),
            },
            make=lambda tau, covariance0: cls(
                tau=tau,
                law=LeastSquares(covariance0=covariance0),
                theta_hat0=reach.theta_hat0,
                saturated_predictor=reach.saturated,
            ),
            open=("covariance0",),  # the effect of covariance0 depends on the size of c_0
            aims=("tau_below", "complementary_sensitivity_peak"),
        )

    def bind(self, known: Known) -> Equations | several.Equations:
        return _bound(self, known)


@dataclass(frozen=True, eq=False)
class NormalizedMrac(Scheme):
    """u = -theta_hat'x + k_0 r with a law driven by the normalised estimation error: RobustMrac without an auxiliary input.

    law            a law of ``adaptation.laws``
    c_0            (n,), P b by default; with m inputs (m, n), b'P by default. W_m(s) = c_0'(sI - A_m)^-1 b must be minimum phase
    normalization  normalisation of the estimation error: eq. (16)
    theta_hat0     (n,), zero by default; inside the known set
    projection     onto the known set; on by default if there is one
    saturated_predictor  against windup: the parametric model and n_d receive sat(u); off by default

    Source: Section II; Ioannou and Sun, section 6.5.
    """

    law: AdaptiveLaw
    _: KW_ONLY
    c_0: Array | None = None
    normalization: Normalization = field(default_factory=Normalization)
    theta_hat0: Vector | None = None
    projection: bool | None = None
    saturated_predictor: bool = False
    name: str = "Normalised MRAC"

    beyond: ClassVar[tuple[str, ...]] = ("an unknown input gain",)

    tau: ClassVar[None] = None  # no auxiliary input

    def __post_init__(self) -> None:
        _check_model_and_law(self)

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        # the rate of the normalised law is at most Gamma for every phi(x)
        slow = reach.frequencies / SLOWNESS_RATIO
        return TuningGrid(
            scheme="Normalised MRAC",
            values={"gamma": np.concatenate([slow[:1], reach.frequencies])},
            make=lambda gamma: cls(law=Gradient(gamma=gamma), theta_hat0=reach.theta_hat0, saturated_predictor=reach.saturated),
            traded=False,
            aims=("complementary_sensitivity_peak",),
        )

    def bind(self, known: Known) -> Equations | several.Equations:
        return _bound(self, known)


def _check_model_and_law(settings: RobustMrac | NormalizedMrac) -> None:
    check_common(settings)
    if settings.c_0 is not None:
        rows = (None,) if validate.dimensions(settings.c_0) == 1 else (None, None)
        validate.freeze(settings, c_0=validate.array("c_0", settings.c_0, rows))
    require_law(settings.law)
    validate.instance("normalization", settings.normalization, Normalization)


def _bound(settings: RobustMrac | NormalizedMrac, known: Known) -> Equations | several.Equations:
    """The equations of both schemes for a plant. c_0 is P b by default.

    W_m is then strictly positive real (Kalman-Yakubovich), and therefore minimum phase with relative degree 1.
    """
    require_taken(type(settings), known)
    if known.inputs > 1:
        return several.equations(
            known,
            c_0=settings.c_0,
            tau=settings.tau,
            law=settings.law,
            normalization=settings.normalization,
            theta_hat0=settings.theta_hat0,
            estimate_set=projection_set(settings.projection, known),
            limits=limits_of_predictor(settings.saturated_predictor, known),
        )
    c_0 = known.P @ known.b if settings.c_0 is None else validate.vector("c_0", settings.c_0, known.n)
    W_m = minimum_phase_model(c_0, known)
    settings.law.initial(known.n)  # rejects settings of a different size
    estimate_set = projection_set(settings.projection, known)
    return Equations(
        A_m=known.A_m,
        b=known.b,
        k_0=known.k_0,
        regressor=known.matched.regressor,
        c_0=c_0,
        Q=None if settings.tau is None else auxiliary_filter(W_m, settings.tau),
        law=settings.law,
        normalization=settings.normalization,
        theta_hat0=initial_estimate(settings.theta_hat0, estimate_set, known),
        x0=known.x0,
        estimate_set=estimate_set,
        limits=limits_of_predictor(settings.saturated_predictor, known),
        enters=known.enters,
    )
