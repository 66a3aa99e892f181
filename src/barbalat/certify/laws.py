"""What a law's gain and modifications make of Theorem 1: its proof rests on V = e'P e + theta_tilde'Gamma^-1 theta_tilde."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barbalat.adaptation import gain
from barbalat.adaptation.epsilon_modification import EpsilonModification
from barbalat.adaptation.fixed_sigma import FixedSigma
from barbalat.adaptation.forgetting import LeastSquaresForgetting
from barbalat.adaptation.laws import AdaptiveLaw
from barbalat.adaptation.switching_sigma import SwitchingSigma
from barbalat.certify.l1 import float_above
from barbalat.certify.theorem1 import OUTWARD, mrac_bound, nu_0, smallest_eigenvalue
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.problem import Problem
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
    if controller.dead_zone is not None:
        return "inside the dead zone nothing is learnt, so the bounds (9) and (10) don't hold"
    if isinstance(controller.leakage, SwitchingSigma):
        known_set, theta = problem.uncertainty, problem.plant.theta
        reach = math.hypot(*theta) if known_set is None else max(math.hypot(*theta), known_set.farthest(np.zeros(known_set.size)))
        if reach * OUTWARD <= controller.leakage.M_0:
            return None
        return f"the switching sigma's M_0 = {controller.leakage.M_0:g} is below the largest |theta| = {reach:.4g} to be covered"
    if controller.leakage is not None:
        return f"{type(controller.leakage).__name__} pulls the estimates to zero, so the bounds (9) and (10) don't hold"
    return None


def convergence(law: AdaptiveLaw) -> str:
    """What is guaranteed of a normalised scheme with this law, on the plant without modelling error."""
    settings: Any = law
    if isinstance(settings.leakage, (FixedSigma, EpsilonModification)):
        kind = type(settings.leakage).__name__
        return f"theta_hat and epsilon m_s stay bounded; with {kind} the tracking error converges to a set, not to zero"
    if getattr(settings, "dead_zone", None) is not None:
        return "theta_hat and epsilon m_s stay bounded; with a dead zone the tracking error converges to a set, not to zero"
    if isinstance(law, LeastSquaresForgetting):
        return "with unbounded forgetting nothing is guaranteed unless phi/m_s is persistently exciting"
    bound = f" (|theta| <= M_0 = {settings.leakage.M_0:g} provided)" if settings.leakage is not None else ""
    return f"the tracking error converges to zero and theta_hat, epsilon m_s stay bounded (Lemma 1, Theorem 2){bound}"
