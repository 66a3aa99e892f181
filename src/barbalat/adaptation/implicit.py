"""Steps of laws over one sample, in which the Lyapunov function of the estimate never grows; docs/sampled.md has the proofs.

Each step is solved for the end of the sample, in closed form, with the regressor and the normalising signal taken at the middle
of the sample. Each law has its own ``sampled_step``; this file contains what they share.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.adaptation.law import AdaptiveLaw, SampleData, SampledLaw
from barbalat.adaptation.modifications import DeadZone, Leakage
from barbalat.problem.known_set import EstimateSet, Gain, KnownSet
from barbalat.problem.known_set.gain import quadratic
from barbalat.protocols import Value
from barbalat.validate import InputError

NO_FORGETTING_RATE = 1e-150
"""A rate of forgetting [1/s] that replaces zero in a division."""


def require_sampled(law: AdaptiveLaw, known_set: EstimateSet | None) -> SampledLaw:
    """Return the law if it has a step over a sample; raises InputError if it has no such step, or none that respects this set."""
    if not isinstance(law, SampledLaw):
        raise InputError(
            f"discretization = 'midpoint' needs a law with a sampled_step (adaptation.law), but {type(law).__name__} has none; "
            f"use 'euler'"
        )
    require_projectable(law.metric, known_set)
    return law


def require_projectable(gain: Gain, known_set: EstimateSet | None) -> None:
    """Raise InputError for a set that has no implicit step with such a gain."""
    if known_set is not None and (why := known_set.why_no_step(gain)) is not None:
        raise InputError(why)


def forgotten(beta: Value, T: float) -> tuple[Value, Value]:
    """exp(-beta T), the fraction kept after T, and its integral over [0, T], which is the weight of the data in between; beta >=
    0."""
    half = np.tanh(
        np.maximum(beta, NO_FORGETTING_RATE) * T / 2
    )  # 1 - exp(-a) = 2 tanh(a/2)/(1 + tanh(a/2)), without cancellation
    return np.exp(-beta * T), 2 * half / (1 + half) / np.maximum(beta, NO_FORGETTING_RATE)


def correct(
    gain: Gain, weight: Value, theta_hat: Value, data: SampleData, leakage: Leakage | None, dead_zone: DeadZone | None
) -> tuple[Value, Value]:
    """Return theta_next that solves Gamma^-1 (theta_next - theta_hat) = T (a epsilon_next phi - w theta_next), and the dead
    zone's factor a.

    ``weight`` replaces T; it equals T without forgetting.
    """
    _, z, phi, m_s_squared = data

    def solve(w: Value) -> tuple[Value, Value]:
        gain_w, rest = at_rest(gain, theta_hat, weight, w)
        gain_phi = gain_w.times(phi)
        innovation = z - rest @ phi
        speed = weight * quadratic(phi, gain_phi) / m_s_squared
        a = 1.0 if dead_zone is None else dead_zone.share(innovation * innovation / m_s_squared, speed)
        return rest + gain_phi * (weight * a * innovation / (m_s_squared * (1 + a * speed))), a

    if leakage is None:
        return solve(0.0)
    error = (z - theta_hat @ phi) / np.sqrt(m_s_squared)
    return solve(leakage.over_sample(theta_hat, error, lambda w: solve(w)[0]))


def with_leakage(leakage: Leakage | None, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
    """The estimate at the end of the sample."""
    return solve(0.0 if leakage is None else leakage.over_sample(theta_hat, error, solve))


def at_rest(
    gain: Gain, theta_hat: Value, T: Value, w: Value, R: Value | None = None, Q: Value | None = None
) -> tuple[Gain, Value]:
    """G = (Gamma^-1 + T (w I + R))^-1 and G (Gamma^-1 theta_hat + T Q).

    The second expression is the estimate after T due to leakage and memory alone; any other term acts on the estimate with the
    gain G.
    """
    if R is None and not gain.is_matrix:
        shrink = 1 / (1 + T * w * gain.value)
        return Gain(gain.value * shrink), theta_hat * shrink
    if R is None and isinstance(w, float) and w == 0:
        return gain, theta_hat
    p = theta_hat.shape[0]
    Gamma = gain.as_matrix(p)
    if R is None:
        system, start = np.eye(p) + T * w * Gamma, theta_hat
    else:
        system, start = np.eye(p) + T * (Gamma @ (w * np.eye(p) + R)), theta_hat + T * (Gamma @ Q)
    solved = np.linalg.solve(system, np.concatenate([Gamma, start.reshape(p, 1)], axis=1))
    return Gain(solved[:, :p]), solved[:, p]


def into(theta_hat: Value, known_set: EstimateSet | None, gain: Gain) -> Value:
    """The estimate brought into the set without an increase of V = theta_tilde'Gamma^-1 theta_tilde."""
    return theta_hat if known_set is None else known_set.nearest(theta_hat, gain)


def step_within(theta: Value, gain: Gain, phi: Value, coupling: Value, error: Value, known_set: KnownSet | None) -> Value:
    """Return theta_next = proj(theta + Gamma phi s) with s = error - K phi'(theta_next - theta), the step of a law whose error
    depends on the estimates within the same step.

    ``error`` is the error for fixed estimates; ``coupling`` K > 0 is its decrease per unit of change of the estimates. With a
    gain matrix, for which no closed form is known, the step ignores the set.

    theta, phi  (p,), theta in the set; with m inputs phi is (p, m), coupling (m, m) and error (m,)
    gain        the adaptive gain times the sample time
    known_set   the set that the step respects
    """
    if gain.is_matrix or known_set is None:
        return gain.implicit_step(theta, phi, coupling, error)
    return known_set.implicit_step(theta, gain, phi, coupling, error)
