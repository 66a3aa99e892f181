"""What a law's gain and modifications make of Theorem 1: its proof rests on V = e'P e + theta_tilde'Gamma^-1 theta_tilde."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from barbalat.adaptation import gain
from barbalat.adaptation.laws import AdaptiveLaw, Gradient
from barbalat.adaptation.laws.forgetting import LeastSquaresForgetting
from barbalat.adaptation.laws.integral_cost import IntegralCost
from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.adaptation.modifications.switching_sigma import SwitchingSigma
from barbalat.adaptation.output_lyapunov import LyapunovLaw
from barbalat.adaptation.projection import EXACTLY
from barbalat.certificates.bounds.theorem_1 import mrac_bound, nu_0
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.definite import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD, float_above
from barbalat.problem.known_set import EstimateSet, ParameterBall, ParameterBox, ParameterProduct
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array


def least_gain(gamma: float | Array) -> float:
    """A guaranteed lower bound of the gain's smallest eigenvalue; a scalar gain itself."""
    if gain.is_matrix(gamma):
        return smallest_eigenvalue(gamma)
    return float(np.min(gamma))


def largest_gain(gamma: float | Array) -> float:
    """The gain's largest eigenvalue, to rounding; a scalar gain itself."""
    return float(np.linalg.eigvalsh(gamma)[-1]) if gain.is_matrix(gamma) else float(np.max(gamma))


def weighted_error(theta_tilde: Array, gamma: Array) -> float:
    """sqrt(theta_tilde'Gamma^-1 theta_tilde), rounded up, for a diagonal or a matrix gain."""
    from flint import arb_mat

    column = arb_mat(theta_tilde[:, None].tolist())
    matrix = arb_mat(gain.as_matrix(gamma, len(theta_tilde)).tolist())
    return float_above((column.transpose() * matrix.inv() * column)[0, 0].sqrt()) * OUTWARD


def error_level(problem: Problem, controller: Mrac | L1Adaptive, nu: float) -> float:
    """nu_0/sqrt(Gamma) of (9), for a matrix sqrt(theta_tilde'Gamma^-1 theta_tilde/lambda_min(P)), rounded up."""
    known, gamma = problem.known, controller.gamma
    if np.ndim(gamma) == 0:
        return mrac_bound(nu, float(gamma))
    return nu_0(weighted_error(controller.bind(known).theta_hat0 - problem.parameters, gamma), known)


def why_no_bound(controller: Mrac | L1Adaptive, problem: Problem) -> str | None:
    """Why (9) and (10) don't hold with the law's modifications, as a sentence; None where V decreases as without them.

    It does with composite learning, which adds -2 gamma_c theta_tilde'R theta_tilde to V', and with a switching sigma that
    bounds every theta in question.
    """
    known_set, gamma = controller.bind(problem.known).box, controller.gamma
    full = gain.is_matrix(gamma) and bool((gamma - np.diag(np.diag(gamma))).any())
    if full and cut_in_corners(known_set):
        return (
            f"with a gain matrix and a box of more than {EXACTLY} parameters, or input gains beside a ball, what the projection "
            "cuts off in a corner may make V grow, so the bounds (9) and (10) don't hold; they do with a ball, a diagonal "
            "gain or without projection"
        )
    if controller.dead_zone is not None:
        return "inside the dead zone nothing is learnt, so the bounds (9) and (10) don't hold"
    if isinstance(controller.leakage, SwitchingSigma):
        M_0 = controller.leakage.M_0
        if _all_within(M_0, problem):
            return None
        return f"the switching sigma's M_0 = {M_0:g} does not bound |theta| over the known set and the case's theta"
    if controller.leakage is not None:
        return f"{type(controller.leakage).__name__} pulls the estimates to zero, so the bounds (9) and (10) don't hold"
    return None


def cut_in_corners(known_set: EstimateSet | None) -> bool:
    """Whether with a gain matrix, or least squares, the limit may cut off in a corner what does not keep the proof.

    The projection is exact for a ball and for a box with up to ``EXACTLY`` faces in reach; one or two intervals of input gains
    that follow a ball are projected after it.
    """
    if isinstance(known_set, ParameterProduct):
        return len(known_set.gains.faces) > EXACTLY or known_set.theta is not None
    return isinstance(known_set, ParameterBox) and len(known_set.faces) > EXACTLY


def _all_within(M_0: float, problem: Problem) -> bool:
    """Whether |theta|_2 <= M_0 for the case's parameters and for all of the known set, in exact arithmetic; with input gains
    beside a ball it is asked for a little more: |theta|_2 + |omega|_1 <= M_0.
    """

    def squares(values: Array) -> Fraction:
        return sum((Fraction(value) ** 2 for value in values.ravel().tolist()), Fraction(0))

    known_set, bound = problem.known.box, Fraction(M_0)
    if squares(problem.parameters) > bound**2:
        return False
    if isinstance(known_set, ParameterProduct):
        bound -= sum((Fraction(value) for value in known_set.gains.upper.tolist()), Fraction(0))
        known_set = known_set.theta
        if bound < 0:
            return False
    if isinstance(known_set, ParameterBox):
        return squares(np.maximum(np.abs(known_set.lower), np.abs(known_set.upper))) <= bound**2
    if isinstance(known_set, ParameterBall):
        room = bound - Fraction(known_set.radius)
        return room >= 0 and squares(known_set.center) <= room**2
    return True


def convergence(law: AdaptiveLaw, known_set: EstimateSet | None) -> str:
    """What is guaranteed of a normalised scheme with this law and projection, on the plant without modelling error."""
    settings: Any = law
    if (not isinstance(law, (Gradient, IntegralCost)) or gain.is_matrix(law.gamma)) and cut_in_corners(known_set):
        return (
            f"nothing is guaranteed where the projection cuts corners: a gain matrix in a box of more than {EXACTLY} parameters"
        )
    if isinstance(settings.leakage, (FixedSigma, EpsilonModification)):
        kind = type(settings.leakage).__name__
        return f"theta_hat and epsilon m_s stay bounded; with {kind} the tracking error converges to a set, not to zero"
    if getattr(settings, "dead_zone", None) is not None:
        return "theta_hat and epsilon m_s stay bounded; with a dead zone the tracking error converges to a set, not to zero"
    if isinstance(law, LeastSquaresForgetting):
        return "with unbounded forgetting nothing is guaranteed unless phi/m_s is persistently exciting"
    bound = f" (|theta| <= M_0 = {settings.leakage.M_0:g} provided)" if settings.leakage is not None else ""
    return f"the tracking error converges to zero and theta_hat, epsilon m_s stay bounded (Lemma 1, Theorem 2){bound}"


def output_convergence(law: AdaptiveLaw | LyapunovLaw, known_set: EstimateSet | None) -> str:
    """What is guaranteed of an output-feedback scheme with this law on a plant of the assumed class."""
    if isinstance(law, LyapunovLaw):
        if gain.is_matrix(law.gamma) and cut_in_corners(known_set):
            return "nothing is guaranteed where the projection cuts corners"
        if law.leakage is None and law.dead_zone is None:
            return "all signals bounded, e -> 0"
        if isinstance(law.leakage, SwitchingSigma):
            return f"all signals bounded, e -> 0 (|theta*| <= M_0 = {law.leakage.M_0:g} provided)"
        return "all signals bounded; with the modification e converges to a set, not to zero"
    found = convergence(law, known_set)
    return found if "nothing is guaranteed" in found else f"all signals bounded; {found}"
