"""One implicit step of a law whose error answers to the estimates within that very step, kept inside the known set.

theta_next = proj(theta + Gamma Phi s) with s = error - K Phi'(theta_next - theta): ``error`` is what would remain were the
estimates to rest, K > 0 says how much of it their motion takes away. For a set that is no box or ball, and for a gain or several
inputs for which no closed form is known, the step is that without a set. docs/sampled.md, "The known set", has the proofs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barbalat.adaptation.gain import as_matrix, is_matrix, times
from barbalat.adaptation.projection import limit
from barbalat.problem.known_set import UNBOUNDED, EstimateSet, KnownSet, ParameterBall, ParameterBox
from barbalat.protocols import Value

PASSES = 4
"""Guesses, with several inputs, of which components end on a face. The step is taken where one of them proves right."""

AGREEMENT = 2.0**-36
"""Of a guess with the equations, relatively: a few thousand roundings."""

SPHERE_STEPS = 6
"""Newton steps for the ball; the step is proven after any number of them. Seen: less than 1e-9 of the radius is left 999 times
in 1000, and never more than 2e-3."""


def step(theta: Value, gamma: Value, phi: Value, coupling: Any, error: Value, known_set: KnownSet | None) -> Value:
    """theta_next.

    theta, phi  (p,), theta in the set; with m inputs phi is (p, m), coupling (m, m) and error (m,)
    gamma       a number, a diagonal (p,) or a matrix (p, p), times the sample time
    """
    if len(phi.shape) == 2:
        return _for_several_inputs(theta, gamma, phi, coupling, error, known_set)
    gamma_phi = times(gamma, phi)
    free = error / (1 + coupling * (phi @ gamma_phi))
    if is_matrix(gamma) or known_set is None:
        return theta + gamma_phi * free
    if isinstance(known_set, ParameterBall):
        return _in_the_ball(theta, gamma, phi, coupling, error, known_set)
    return limit(theta + gamma_phi * _in_the_box(theta, gamma, phi, coupling, error, known_set), known_set)


def _in_the_box(theta: Value, gamma: Value, phi: Value, coupling: Any, error: Value, box: ParameterBox) -> Value:
    """s, for a number or a diagonal.

    As |s| grows from zero, component i of the estimate moves at gamma_i |phi_i| until its room is used up:
    |error| = |s| + K sum_i |phi_i| min(gamma_i |phi_i| |s|, room_i). The right side is concave and piecewise linear in |s|, so
    it is the least of its lines, and |s| the largest of their roots. The lines differ in the components that have arrived;
    these arrive one after another.
    """
    p = box.size
    size = np.abs(phi)
    rate = gamma * size
    room = np.where(error * phi > 0, box.upper - theta, theta - box.lower)
    largest = np.abs(error) / (1 + coupling * (rate @ size))
    for j in range(p):
        arrived = np.where(room * rate[j] <= room[j] * rate, 1.0, 0.0)
        line = np.abs(error) - coupling * ((arrived * room) @ size)
        largest = np.maximum(largest, line / (1 + coupling * (((1 - arrived) * rate) @ size)))
    return np.where(error > 0, largest, -largest)


def _in_the_ball(theta: Value, gamma: Value, phi: Value, coupling: Any, error: Value, ball: ParameterBall) -> Value:
    """theta_next, for a number. Along phi and across it the distance from the centre is a/(mu + k) and b/mu with mu >= 1.

    mu = 1 is the step without a set. Beyond the sphere mu solves distance = radius: Newton's method on 1/distance, which is
    concave in mu, comes from below and never passes the root. Each mu on the way is the exact step for a larger ball.
    Source: More and Sorensen (1983), SIAM J. Sci. Stat. Comput. 4(3).
    """
    from_centre = theta - ball.center
    squared = phi @ phi
    direction = phi / np.where(squared > 0, squared, 1.0)
    share = phi @ from_centre
    across = from_centre - direction * share
    along = direction * share + gamma * phi * (error + coupling * share)
    k = gamma * coupling * squared
    a, b = along @ along, across @ across
    mu = np.maximum(1.0, np.sqrt(a) / ball.radius - k)  # one of the two alone would fill the radius
    for _ in range(SPHERE_STEPS):
        distance = a / (mu + k) ** 2 + b / mu**2
        slope = a / (mu + k) ** 3 + b / mu**3
        missing = np.maximum(np.sqrt(distance) / ball.radius - 1, 0.0)
        mu = mu + missing * distance / np.where(slope > 0, slope, 1.0)
    return ball.center + along / (mu + k) + across / mu


def _for_several_inputs(theta: Value, gamma: Value, phi: Value, coupling: Any, error: Value, known_set: KnownSet | None) -> Value:
    """theta_next. In a box, for a number or a diagonal: with the components on a face guessed, s solves a linear system."""
    inputs = phi.shape[1]
    gamma_phi = as_matrix(gamma, phi.shape[0]) @ phi
    s = np.linalg.solve(np.eye(inputs) + coupling @ (phi.T @ gamma_phi), error)
    free = theta + gamma_phi @ s
    if is_matrix(gamma) or not isinstance(known_set, ParameterBox):
        return free
    for _ in range(PASSES):
        wanted = theta + gamma_phi @ s
        inside = np.where(limit(wanted, known_set) == wanted, 1.0, 0.0)
        moved = (1 - inside) * (limit(wanted, known_set) - theta)
        system = np.eye(inputs) + coupling @ ((phi * inside.reshape(-1, 1)).T @ gamma_phi)
        s = np.linalg.solve(system, error - coupling @ (phi.T @ moved))
    found = limit(theta + gamma_phi @ s, known_set)
    left = error - coupling @ (phi.T @ (found - theta)) - s
    solved = left @ left <= AGREEMENT**2 * (s @ s + error @ error)
    return np.where(solved, found, free)


def kept_to(known_set: EstimateSet | None, size: int, *, leaking: bool) -> KnownSet | None:
    """What a step of ``size`` estimates keeps to: the known set, of a product the intervals of the input gains.

    With a leakage the least box, or concentric ball, that also holds zero, to which the estimates are drawn.
    """
    if known_set is None:
        return None
    if isinstance(known_set, ParameterBall):
        away = math.hypot(*known_set.center) if leaking else 0.0
        return ParameterBall(center=known_set.center, radius=max(known_set.radius, away))
    lower, upper = (np.full(size, -UNBOUNDED), np.full(size, UNBOUNDED))
    if isinstance(known_set, ParameterBox):
        lower, upper = known_set.extent
    else:
        lower[-known_set.gains.size :], upper[-known_set.gains.size :] = known_set.gains.extent
    if leaking:
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    return ParameterBox(lower=lower, upper=upper)
