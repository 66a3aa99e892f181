"""The effect of a law's gain and modifications on Theorem 1, whose proof uses V = e'P e + theta_tilde'Gamma^-1 theta_tilde."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, Protocol

import numpy as np
from flint import arb_mat

from barbalat.adaptation.guarantee import Guarantee, nothing
from barbalat.adaptation.law import AdaptiveLaw, GuaranteedLaw, OutputErrorLaw
from barbalat.adaptation.lyapunov import ModifiedSettings
from barbalat.certificates import theorems
from barbalat.certificates.bounds.theorem_1 import mrac_bound, nu_0
from barbalat.certificates.entry import Assumption
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR, float_above
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.problem.known_set.cone import EXACT_FACES
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Equations
from barbalat.validate import Array


class Bound(Equations, Protocol):
    """The equations of a scheme with a Lyapunov law on a plant."""

    @property
    def theta_hat0(self) -> Array: ...

    @property
    def estimate_set(self) -> EstimateSet | None: ...


class LyapunovScheme(Protocol):
    """Settings of a scheme whose law follows from V = e'P e + theta_tilde'Gamma^-1 theta_tilde."""

    @property
    def gamma(self) -> float | Array: ...

    @property
    def name(self) -> str: ...

    def bind(self, known: Any) -> Bound: ...


class ModifiedScheme(LyapunovScheme, ModifiedSettings, Protocol):
    """Settings of a scheme with this V whose law may be modified."""


def least_gain(gamma: float | Array) -> float:
    """A guaranteed lower bound on the smallest eigenvalue of the gain; for a scalar gain, the gain itself."""
    return smallest_eigenvalue(gamma) if Gain(gamma).is_matrix else float(np.min(gamma))


def weighted_error(theta_tilde: Array, gamma: Array) -> float:
    """sqrt(theta_tilde'Gamma^-1 theta_tilde), rounded up, for a diagonal or a matrix gain."""
    column = arb_mat(theta_tilde[:, None].tolist())
    matrix = arb_mat(Gain(gamma).as_matrix(len(theta_tilde)).tolist())
    return float_above((column.transpose() * matrix.inv() * column)[0, 0].sqrt()) * OUTWARD_FACTOR


def error_level(problem: Problem, controller: LyapunovScheme, nu: float, closed: Known | None = None) -> float:
    """nu_0/sqrt(Gamma) of (9), or for a matrix sqrt(theta_tilde'Gamma^-1 theta_tilde/lambda_min(P)), rounded up, with the P of
    ``closed``."""
    known, gamma = problem.known, controller.gamma
    if np.ndim(gamma) == 0:
        return mrac_bound(nu, float(gamma))
    theta_tilde = controller.bind(known).theta_hat0 - problem.parameters
    return nu_0(weighted_error(theta_tilde, np.asarray(gamma)), closed or known)


def is_modified(controller: ModifiedScheme) -> bool:
    """Whether the law is modified: a leakage or a memory makes the estimates decay, and a dead zone scales the error."""
    return not (controller.leakage is None and controller.dead_zone is None and controller.learning is None)


def keeps_V_in_corners(gamma: float | Array, known_set: EstimateSet | None) -> Assumption:
    """The assumption that the projection keeps V' <= 0. It may fail for a gain that couples the parameters, if the projection
    cuts corners."""
    cut = Gain(gamma).couples and known_set is not None and known_set.cuts_corners
    why = "a gain matrix in corners of the known set" if cut else ""
    return Assumption("the projection never makes V grow", why, theorems.CORNERS)


def why_no_bound(controller: ModifiedScheme, problem: Problem) -> str | None:
    """Why (9) and (10) do not hold with the law's modifications, as a sentence; None if V decreases as it does without
    modifications.

    V decreases with composite learning, which adds -2 gamma_c theta_tilde'R theta_tilde to V', and with a switching sigma whose
    M_0 bounds every relevant theta.
    """
    known_set, gamma = controller.bind(problem.known).estimate_set, controller.gamma
    if keeps_V_in_corners(gamma, known_set).broken:
        return (
            f"the bounds (9) and (10) do not hold with a gain matrix and a box of more than {EXACT_FACES} parameters, or input "
            f"gains in addition to a ball, because the projection in a corner may make V grow. They hold with a ball, with a "
            f"diagonal gain or without projection"
        )
    if controller.dead_zone is not None:
        return "the law is inactive inside the dead zone, so the bounds (9) and (10) do not hold"
    if controller.leakage is None:
        return None
    M_0 = controller.leakage.harmless_within
    if M_0 is None:
        return f"{type(controller.leakage).__name__} pulls the estimates towards zero, so the bounds (9) and (10) do not hold"
    of_theta = sum((Fraction(value) ** 2 for value in problem.parameters.ravel().tolist()), Fraction(0))
    if of_theta <= Fraction(M_0) ** 2 and (
        problem.known.estimate_set is None or problem.known.estimate_set.within(Fraction(M_0))
    ):
        return None
    return f"the switching sigma's M_0 = {M_0:g} does not bound |theta| over the known set and the case's theta"


def theorem_of_modified(controller: ModifiedScheme, problem: Problem) -> str:
    """The name of the missing theorem if ``why_no_bound`` gives a reason; otherwise empty."""
    if why_no_bound(controller, problem) is None:
        return ""
    if keeps_V_in_corners(controller.gamma, controller.bind(problem.known).estimate_set).broken:
        return theorems.CORNERS
    return theorems.LEAKAGE if controller.dead_zone is None else theorems.DEAD_ZONE


def guarantee_of(law: AdaptiveLaw | OutputErrorLaw, known_set: EstimateSet | None) -> Guarantee:
    """The guarantee that a law declares; nothing is guaranteed for a law that declares no guarantee."""
    if isinstance(law, GuaranteedLaw):
        return law.guarantee(known_set)
    return nothing(f"nothing is guaranteed: no guarantee is known for {type(law).__name__}")


def bounds_the_parameters(found: Guarantee, parameters: Array | None) -> Assumption:
    """The assumption that a switching leakage's M_0 bounds the true parameters."""
    if found.M_0 is None:
        return Assumption("no bound M_0 of the parameters is needed")
    above = parameters is None or float(np.linalg.norm(parameters)) * OUTWARD_FACTOR > found.M_0
    return Assumption(f"|theta| <= M_0 = {found.M_0:g}", f"M_0 = {found.M_0:g} does not bound |theta|" if above else "")


def kept_from_zero(found: Guarantee) -> str:
    """Why the tracking error does not converge to zero, or why convergence is unknown."""
    return f"with {found.why}, the tracking error converges to a set, not to zero" if found.bounded else found.why
