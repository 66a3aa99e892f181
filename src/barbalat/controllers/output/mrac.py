"""Direct MRAC for SISO plants of any relative degree with output feedback; with normalisation and an auxiliary input for
robustness.

Source: Section IV of the paper, first sentence; Ioannou and Sun, sections 6.4, 6.5 and 9.3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.adaptation.law import AdaptiveLaw, Normalization, OutputErrorLaw, require_law
from barbalat.controllers.output import mrac_normalized, mrac_unnormalized
from barbalat.controllers.output.matching import filter_polynomial, input_filter, is_strictly_positive_real, refuse_contradiction
from barbalat.controllers.parametric_model import auxiliary_filter
from barbalat.controllers.settings import Scheme
from barbalat.controllers.windup import limits_of_predictor
from barbalat.problem.known_set import UNREACHED_BOUND, ParameterBox
from barbalat.problem.output_feedback import OutputKnown
from barbalat.validate import Array, InputError, Vector

LARGEST_ORDER = 100
"""Largest order of the design plant: the coefficients of Lambda = (s + a)^99 span 29 decades, and doubles have 16 digits."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MracOutput(Scheme):
    """u = theta_hat'omega + u_a for a plant of assumed order, relative degree and sign of the high-frequency gain.

    order            n, the plant order for which the scheme is designed
    relative_degree  n*, equal to that of the reference model
    sign             of the high-frequency gain, 1 or -1
    law              LyapunovLaw (n* = 1 with a strictly positive real W_m; unnormalised) or a law of the family
    theta_hat0       (2 n,): theta_1, theta_2, theta_3, c_0; zero by default, c_0 at its bound
    tau              time constant of the auxiliary input [s], only with a law of the family; none by default
    normalization    m_s^2 = 1 + phi'phi + alpha_0 n_d, n_d' = -delta_0 n_d + u^2 + y^2
    filter_poles     the roots of Lambda_0, order - 1 minus the number of the model's zeros; all at -max |pole of W_m| by default
    lower, upper     (2 n,) each, the known set; none by default
    c_0_min          |c_0| >= c_0_min > 0, with the sign of ``sign`` times k_m; a law of the family needs this bound, or a known
                     set that implies it
    saturated_predictor  against windup: omega_1, the parametric model and n_d receive sat(u); only with a law of the family

    Identity behind u_a (zero initial conditions, no modelling error; c_0 is the estimate, the last entry of theta_hat):
        c_0 (y - y_m) = -epsilon m^2 + W_c[(W_b[omega'] theta')] + W_m[u_a].
    If u is limited and omega_1 and z = W_m[sat(u)] receive sat(u), it holds with u_a + sat(u) - u in place of u_a.

    Source: Ioannou and Sun, sections 6.4, 6.5 and 9.3; equations of the auxiliary input: Section IV of the paper.
    """

    order: int
    relative_degree: int
    sign: int
    law: AdaptiveLaw | OutputErrorLaw
    theta_hat0: Vector | None = None
    tau: float | None = None
    normalization: Normalization = field(default_factory=Normalization)
    filter_poles: Vector | None = None
    lower: Vector | None = None
    upper: Vector | None = None
    c_0_min: float | None = None
    saturated_predictor: bool = False
    name: str = "MRAC output"

    feedback: ClassVar[str] = "output"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(
            self,
            order=validate.whole("order", self.order, least=1, most=LARGEST_ORDER),
            relative_degree=validate.whole("relative_degree", self.relative_degree, least=1),
        )
        if self.relative_degree > self.order:
            raise InputError(f"relative_degree must not exceed order = {self.order}, got {self.relative_degree}")
        if isinstance(self.sign, bool) or self.sign not in (1, -1):
            raise InputError(f"sign must be 1 or -1, got {validate.show(self.sign)}")
        if isinstance(self.law, type) or not isinstance(self.law, OutputErrorLaw):
            require_law(self.law)
        validate.instance("normalization", self.normalization, Normalization)
        if (self.lower is None) != (self.upper is None):
            raise InputError("give both lower and upper, or neither")
        for name in ("tau", "c_0_min"):
            if getattr(self, name) is not None:
                validate.freeze(self, **{name: validate.positive(name, getattr(self, name))})
        for name in ("theta_hat0", "lower", "upper"):
            if getattr(self, name) is not None:
                validate.freeze(self, **{name: validate.vector(name, getattr(self, name), 2 * self.order)})
        if self.filter_poles is not None:
            poles = np.zeros(0) if len(self.filter_poles) == 0 else validate.vector("filter_poles", self.filter_poles)
            validate.freeze(self, filter_poles=poles)
        if self.unnormalized and (self.tau is not None or self.saturated_predictor):
            raise InputError("tau and saturated_predictor need a law on the parametric model; the Lyapunov law has no epsilon")

    @property
    def unnormalized(self) -> bool:
        """Whether the law is driven by the error y - y_m and not by the error of a parametric model."""
        return isinstance(self.law, OutputErrorLaw)

    def bind(self, known: OutputKnown) -> mrac_unnormalized.Equations | mrac_normalized.Equations:
        W_m = known.W_m
        if W_m.relative_degree != self.relative_degree:
            raise InputError(f"relative_degree is {self.relative_degree}, but the reference model has {W_m.relative_degree}")
        if self.unnormalized and not is_strictly_positive_real(W_m):
            raise InputError(
                "the Lyapunov law needs relative_degree = 1 and a strictly positive real reference model; "
                "a law on the parametric model does not"
            )
        refuse_contradiction(known.plant, self.order, self.relative_degree, self.sign)
        filters = input_filter(filter_polynomial(self.order, W_m, self.filter_poles))
        model_sign = float(np.sign(W_m.num[0]))
        estimate_set = self._box(model_sign)
        theta_hat0 = self._initial(estimate_set)
        if isinstance(self.law, OutputErrorLaw):
            self.law.require_size(len(theta_hat0))
            return mrac_unnormalized.Equations(filters, self.sign * model_sign, self.law, theta_hat0, estimate_set)
        return mrac_normalized.Equations(
            regressor_filter=filters,
            W_m=W_m.realise(),
            law=self.law,
            normalization=self.normalization,
            Q=None if self.tau is None else auxiliary_filter(W_m, self.tau),
            theta_hat0=theta_hat0,
            estimate_set=estimate_set,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )

    def _box(self, model_sign: float) -> ParameterBox | None:
        """The known set, in which c_0 = k_m/k_p stays on its side of zero."""
        sign = self.sign * model_sign
        if self.lower is None and self.c_0_min is None:
            if self.unnormalized:
                return None
            raise InputError("give c_0_min, or lower and upper: projection must keep c_0 away from zero")
        lower = np.full(2 * self.order, -UNREACHED_BOUND) if self.lower is None else self.lower.copy()
        upper = np.full(2 * self.order, UNREACHED_BOUND) if self.upper is None else self.upper.copy()
        if self.c_0_min is not None:
            if sign > 0:
                lower[-1] = max(lower[-1], self.c_0_min)
            else:
                upper[-1] = min(upper[-1], -self.c_0_min)
        if not self.unnormalized and not (lower[-1] > 0 if sign > 0 else upper[-1] < 0):
            raise InputError(f"the known set must keep c_0 {'above' if sign > 0 else 'below'} zero; give c_0_min")
        return ParameterBox(lower=lower, upper=upper)

    def _initial(self, estimate_set: ParameterBox | None) -> Array:
        zero = np.zeros(2 * self.order)
        if self.theta_hat0 is None:
            return zero if estimate_set is None else np.clip(zero, estimate_set.lower, estimate_set.upper)
        if estimate_set is not None and not estimate_set.contains(self.theta_hat0):
            raise InputError(f"theta_hat0 must lie in the known set, {estimate_set}, got {validate.show(self.theta_hat0)}")
        return self.theta_hat0
