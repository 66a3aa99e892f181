"""What the certificates of all schemes share: their assumptions as sentences, parameter errors, what a case takes away."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.certificate import Certificate
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem

MATCHED = "the plant is (1): matched uncertainty, no unmodelled dynamics, continuous time"
NO_DISTURBANCE = "no disturbance acts"
EXACT_START = "x_m(0) = x(0), and the predictor starts there too"
IN_THE_SET = "theta and theta_hat(0) lie in the known set, and the estimates are projected onto it"
TRIED = "mu is exact at the frequencies that were tried: a grid, the critical ones, and each peak refined; not between them"
CONTINUOUS = "bounds and margins are of the continuous controller: estimates for the sampled one"
OUTSIDE = "the true theta lies outside the known set: with projection, none of the bounds holds"
BEYOND = "conditions and margins are known for one input with phi(x) = x and a known gain: not for this plant"
ON_THE_BOX = "|phi(x)| is bounded where every |x_i| is at most the model's bound plus that of e"
ASSUMED = "there |e| <= nu_0/sqrt(Gamma) is assumed: it is not proven for this scheme"
FROZEN = "gamma_max and step_max freeze the state or the regressor in the plain adaptive law: estimates, no guarantee"
LINEAR = "margins are exact for the linear loop named, not for the adaptive loop in motion"

OF_THE_PROBLEM = frozenset({"lambda_min", "theta_max", "bounds"})
"""Guaranteed values that no controller and no theta changes."""


def finish(
    problem: Problem, values: dict[str, Any], guaranteed: set[str], assumptions: list[str], findings: list[str]
) -> Certificate:
    """The certificate, less the guarantees that what acts on the plant takes away."""
    found = departures(problem)
    for departure in found:
        findings.append(f"{departure}: the bounds (9) and (10) don't cover it")
    if found:
        guaranteed = guaranteed - {"error_bound", "error_bound_worst"}
    if problem.disturbance is None and not problem.unmatched:
        assumptions.append(NO_DISTURBANCE)
    if any("outside the known set" in finding for finding in findings):
        guaranteed = guaranteed & ({"norms", "condition", "kappa_admissible", "kappa_max"} | OF_THE_PROBLEM)
    return Certificate(values, frozenset(guaranteed), tuple(assumptions), tuple(findings))


def departures(problem: TrackingProblem) -> list[str]:
    """What the case's plant has that (1) has not."""
    found = []
    if problem.disturbance is not None or problem.unmatched or problem.output_disturbance is not None:
        found.append("a disturbance acts")
    gain_known = getattr(problem, "input_gain", None) is None
    unmodelled_gain = gain_known and any(path.gain != 1 for path in problem.plant.paths)
    if unmodelled_gain or problem.delay > 0 or not all(path.is_static_gain for path in problem.plant.paths):
        found.append("the plant has unmodelled dynamics, a delay or limits at its input")
    if problem.sensor is not None:
        found.append("the state is measured with lag or noise, which margins don't cover either")
    return found
