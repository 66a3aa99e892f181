"""The predictor and the estimate of the piecewise-constant law in discrete time, in the exact form or in the form of flight
codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.protocols import Value, kept
from barbalat.roles import Role
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, Vector

SPAN = Role.other("samples over which the prediction error accumulates: 1 unless measurements are missed")
"""The role of the sample counter (see ``next_span``)."""


@dataclass(frozen=True, eq=False)
class PredictorStep:
    """x_hat[k+1] from x_hat, x and the inputs through B, which are sigma_hat and, through the first columns, the known input v
    (m,).

    sigma_hat = -G x_tilde, x_tilde = x_hat - x.
    """

    of_x_hat: Array  # (n, n)
    of_x: Array  # (n, n)
    of_acting: Array  # (n, n)
    G: Array  # (n, n)
    answered: Array  # (n, n) G^-1
    memory: float  # decay of x_hat per sample: the spectral radius of of_x_hat

    @classmethod
    def exact(cls, A_m: Array, B: Array, T: float) -> PredictorStep:
        """x_hat' = A_m x_hat + b v + B sigma_hat with v and sigma_hat held: B^-1 Phi^-1 inverts the effect of B over a sample."""
        held = HeldSystem.of(A_m, B, T)
        G = np.linalg.solve(held.Gamma, held.Phi)
        return cls(held.Phi, np.zeros_like(A_m), held.Gamma, G, inverse(G), memory_of(A_m, T))

    def following(self, x_hat: Value, x: Value, v: Value, sigma_hat: Value) -> Value:
        """The predictor one sample later."""
        acting = np.concatenate([v + sigma_hat[: v.shape[0]], sigma_hat[v.shape[0] :]])
        return self.of_x_hat @ x_hat + self.of_x @ x + self.of_acting @ acting

    def estimate(self, x_tilde: Value) -> Value:
        return -(self.G @ x_tilde)

    def measured_again(self, x_hat: Value, x: Value, sigma_hat: Value, span: Value) -> Value:
        """x_hat at a measurement ``span`` samples after the last one, from ``shared``; sigma_hat was held in between."""
        return x + shared(x_hat - x, -(self.answered @ sigma_hat), span)


def inverse(G: Array) -> Array:
    """G^-1, or the pseudo-inverse if G is numerically singular, as for sample times far longer than the time scale of the
    loop."""
    return np.linalg.pinv(G) if np.isfinite(G).all() else np.full_like(G, np.nan)


LONGEST_SPAN = 1e4
"""The sample count saturates at this number, so during a long freeze no number leaves the range of an export, which is at least
1e6."""


def memory_of(A_m: Array, T: float) -> float:
    """The spectral radius of e^(A_m T)."""
    return float(np.exp(np.linalg.eigvals(A_m).real.max() * T))


def shared(error: Value, answered: Value, span: Value) -> Value:
    """One sample's fraction of a prediction error that accumulated over ``span`` samples without a measurement.

    The law treats the whole error as the effect of one sample. If the error accumulated over m samples, the law would compensate
    m times the uncertainty for several samples until the next measurement, and a loop that misses two of three samples would
    diverge. Therefore the part of the error that sigma_hat does not yet explain is divided by the number of samples.
    """
    return answered + (error - answered) / np.maximum(span, 1.0)


def next_span(frozen: Value, span: Value, memory: float) -> Value:
    """The sum to which a constant error accumulates: 1 after a measurement, and 1 + memory + memory^2 + ... during a gap."""
    return kept(frozen, np.minimum(1 + memory * span, LONGEST_SPAN), 1 + 0 * span)


@dataclass(frozen=True, eq=False)
class AsFlown(Settings):
    """x_hat[k+1] = x_hat + T [A_m x + b (theta_0'phi(x) + u) + B sigma_hat + A_s x_tilde], A_s = diag(a): an Euler step.

    sigma_hat = -B^-1 diag(a e^(aT)/(e^(aT) - 1)) x_tilde, each state separately, and u = k_0 r - theta_0'phi(x) +
    C(s)[-sigma_hat_m - ...]: the baseline is not filtered.

    predictor_poles      a [1/s], a number for all states or (n,), at most 0; with 0 the factor is 1/T
    nominal              theta_0, (p,) or (p m,): the baseline's parameters, which the predictor knows; zero by default
    assumed_sample_time  T in these formulas [s], if it differs from the real sample time of the loop; sample_time by default

    Source: Wu et al., L1Quad, arXiv 2302.07208, section III.
    """

    predictor_poles: float | Vector = -5.0
    nominal: Vector | None = None
    assumed_sample_time: float | None = None

    def __post_init__(self) -> None:
        single = validate.dimensions(self.predictor_poles) == 0
        poles = validate.vector("as_flown.predictor_poles", [self.predictor_poles] if single else self.predictor_poles)
        if (poles > 0).any():
            raise InputError.of("as_flown.predictor_poles", f"must be at most 0, got {validate.show(self.predictor_poles)}")
        validate.freeze(self, predictor_poles=float(poles[0]) if single else poles)
        if self.nominal is not None:
            validate.freeze(self, nominal=validate.vector("as_flown.nominal", self.nominal))
        if self.assumed_sample_time is not None:
            assumed = validate.positive("as_flown.assumed_sample_time", self.assumed_sample_time)
            validate.freeze(self, assumed_sample_time=assumed)

    def poles(self, n: int) -> Array:
        """a of each state, (n,)."""
        if np.ndim(self.predictor_poles) == 0:
            return np.full(n, self.predictor_poles)
        return validate.vector("as_flown.predictor_poles", self.predictor_poles, n)

    def baseline(self, parameters: int) -> Array:
        """(p,) the parameters theta_0 that the predictor assumes; zero by default."""
        if self.nominal is None:
            return np.zeros(parameters)
        return validate.vector("as_flown.nominal", self.nominal, parameters)

    def step(self, A_m: Array, B: Array, T: float) -> PredictorStep:
        """The step over a sample, with the assumed T [s]."""
        a = self.poles(len(A_m))
        with np.errstate(over="ignore"):  # for T far longer than the time scale of the loop, the factor tends to 0
            decay = -np.expm1(-a * T)  # a e^(aT)/(e^(aT) - 1) = a/(1 - e^(-aT)), which is 1/T for a = 0
        factor = np.where(a == 0, 1 / T, a / np.where(a == 0, 1.0, decay))
        A_s, memory = np.diag(a), float(np.abs(1 + T * a).max())
        G = np.linalg.solve(B, np.diag(factor))
        return PredictorStep(np.eye(len(a)) + T * A_s, T * (A_m - A_s), T * B, G, inverse(G), memory)
