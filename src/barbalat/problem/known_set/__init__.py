"""The known convex set of the unknown parameters: a box or a ball, with intervals for unknown input gains.

A projection onto a set keeps the estimate inside, and the Lyapunov function still decreases. Every projection subtracts Gamma g
lambda from the rate, with the outward normal g of a face or sphere and lambda >= 0. Since theta_tilde'Gamma^-1 Gamma g =
(theta_hat - theta)'g >= 0 for every theta in a convex set, a projection never increases V = theta_tilde'Gamma^-1 theta_tilde. An
implicit step (``implicit_step``) is theta_next = proj(theta + Gamma phi s) with s = error - K phi'(theta_next - theta). The
proofs are in docs/sampled.md, "The known set".

Source: Ioannou and Fidan, Adaptive Control Tutorial, section 3.10; Ioannou and Sun, Robust Adaptive Control, section 4.4.
"""

from __future__ import annotations

from typing import Protocol, TypeAlias, runtime_checkable

from barbalat.problem.known_set.ball import ParameterBall, ParameterProduct
from barbalat.problem.known_set.box import UNREACHED_BOUND, ParameterBox
from barbalat.problem.known_set.gain import UNIT_GAIN, Gain
from barbalat.protocols import Value

__all__ = [
    "UNREACHED_BOUND", "EstimateSet", "Gain", "KnownSet", "ParameterBall", "ParameterBox", "ParameterProduct", "Projecting",
    "limit", "project", "with_gains",
]  # fmt: skip

KnownSet: TypeAlias = ParameterBox | ParameterBall
"""A set onto which theta can be projected."""

EstimateSet: TypeAlias = KnownSet | ParameterProduct
"""A set onto which an estimate of theta, or of theta and the input gains, can be projected."""


def with_gains(theta: KnownSet | None, gains: ParameterBox | None) -> EstimateSet | None:
    """Return the set of everything that is estimated; ``None`` if there is no set and all gains are known."""
    if gains is None:
        return theta
    return ParameterProduct(None, gains) if theta is None else theta.with_gains(gains)


@runtime_checkable
class Projecting(Protocol):
    """Equations that may keep their estimates in a set."""

    @property
    def estimate_set(self) -> EstimateSet | None: ...


def project(rate: Value, theta_hat: Value, known_set: EstimateSet | None, gain: Gain = UNIT_GAIN) -> Value:
    """Return proj(.) of (4), (7) and (15). ``None`` for the set means no projection."""
    return rate if known_set is None else known_set.project(rate, theta_hat, gain)


def limit(theta_hat: Value, known_set: EstimateSet | None) -> Value:
    """Return the estimate at a stage, limited to the set (a limited integrator). ``None`` for the set means no limit."""
    return theta_hat if known_set is None else known_set.limit(theta_hat)
