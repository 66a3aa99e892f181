"""Mixed-sensitivity H-infinity design: the fastest loop that the unmodelled dynamics allow.

||[W_S S; W_KS K S; W_T T]||_inf <= 1 where W_T is the size of the unmodelled dynamics, so |W_T T| <= 1 guarantees stability. W_S
= (s/sqrt(M) + w_B)^2/(s + w_B sqrt(A))^2 requires the bandwidth w_B; below it |S| must be proportional to the square of the
frequency, as with a PI controller on this plant. The largest feasible w_B is found by bisection. Source: Skogestad and
Postlethwaite, Multivariable Feedback Control, sections 2.8 and 9.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.controllers.linear_feedback import require_linear_plant
from barbalat.linear.largest import largest
from barbalat.linear.systems import StateSpace, TransferFunction, transfer_function
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array, InputError


def design_model(known: Known, output: Array | None = None) -> tuple[Array, TransferFunction]:
    """(c, c'(sI - A_m)^-1 b): the plant between u and c'x once the nominal theta'x is cancelled; c is P b by default.

    P b makes the model strictly positive real and therefore minimum phase with relative degree one. This choice limits a linear
    loop least. Raises InputError for c = 0, and for a plant with several inputs or a regressor other than x.
    """
    require_linear_plant(known)
    c = known.P @ known.b if output is None else validate.vector("output", output, known.n)
    model = transfer_function(c, known.A_m, known.b)
    if not model.num.any():
        raise InputError(f"output must not be zero, got {validate.show(c)}")
    return c, model


def delay_weight(delay: float) -> TransferFunction:
    """W(s) with |e^(-j w d) - 1| <= |W(j w)| for all w and all d <= delay [s]: s delay/(1 + s delay/sqrt(12)).

    2 sin(x/2) <= x/sqrt(1 + x^2/12): both sides agree up to x^3, and the right side tends to sqrt(12) > 2. The form is that of
    Wang, Lundstrom and Skogestad (1994), with 3.465.
    """
    delay = validate.positive("unmodelled_delay", delay)
    return TransferFunction([delay, 0.0], [delay / math.sqrt(12), 1.0])


def default_delay(known: Known) -> float:
    """A tenth of the fastest time constant in the family [s]: 0.1/max |eigenvalue of A_m + b theta'| over the corners of the set.

    The unmodelled dynamics are then assumed to begin a decade above the dynamics of the model.
    """
    require_linear_plant(known)
    corners = [np.zeros(known.n)] if known.theta_set is None else product(*zip(*known.theta_set.extent, strict=True))
    fastest = max(float(np.abs(np.linalg.eigvals(known.A_m + np.outer(known.b, corner))).max()) for corner in corners)
    return 0.1 / fastest


SENSITIVITY_PEAK = 2.0
"""M, the largest |S| that W_S allows. It gives a gain margin of at least 2 and a phase margin of at least 29 degrees (ibid.,
2.4)."""
STEADY_SENSITIVITY = 1e-6
"""A, |S| at zero frequency. An exact integrator would put a pole of W_S on the imaginary axis, which the synthesis does not
allow."""
BANDWIDTH_SHARE = 0.9
"""Fraction of the largest bandwidth: at the limit, the fast pole of the controller goes to infinity and the controller becomes
improper."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MixedSensitivity:
    """A design: controller on the error, the weights, the requested bandwidth [rad/s], and the achieved norm (at most 1)."""

    controller: StateSpace
    W_S: TransferFunction
    W_KS: float
    W_T: TransferFunction
    bandwidth: float
    norm: float


def mixed_sensitivity(model: TransferFunction, delay: float, bandwidth: float | None = None) -> MixedSensitivity:
    """Design a controller K(s), acting on the error, for the model, such that the loop tolerates the unmodelled delay [s] at the
    model's input.

    bandwidth  w_B of W_S [rad/s]; by default 0.9 times the largest bandwidth for which the norm is at most 1

    Raises InputError without the package slycot (extra ``robust``), for a model with poles on the imaginary axis, and if the
    weights cannot be met.
    """
    delay = validate.positive("unmodelled_delay", delay)
    if abs(model.poles.real).min(initial=np.inf) < 1e-9 * max(1.0, float(np.abs(model.poles).max(initial=0.0))):
        raise InputError("the H-infinity design needs a model without poles on the imaginary axis; add a little damping to them")
    scaled = in_time_unit(model, delay)
    if bandwidth is None:
        bandwidth = BANDWIDTH_SHARE * _largest_bandwidth(scaled) / delay
    bandwidth = validate.positive("bandwidth", bandwidth)
    found = _suboptimal(_plant(scaled, bandwidth * delay))
    if found is None:
        raise InputError(f"no controller reaches the bandwidth {bandwidth:.4g} rad/s with an unmodelled delay of {delay:.4g} s")
    K, norm = found
    return MixedSensitivity(
        controller=StateSpace(K.A / delay, K.B / delay, K.C, K.D),
        W_S=performance_weight(bandwidth),
        W_KS=_effort(scaled),
        W_T=delay_weight(delay),
        bandwidth=bandwidth,
        norm=norm,
    )


def in_time_unit(model: TransferFunction, unit: float) -> TransferFunction:
    """The model with time in units of ``unit`` s: the synthesis is best conditioned in units of the delay."""
    return TransferFunction(*(c * unit ** -np.arange(len(c) - 1.0, -1.0, -1.0) for c in (model.num, model.den)))


def performance_weight(bandwidth: float) -> TransferFunction:
    """W_S(s) = (s/sqrt(M) + w_B)^2/(s + w_B sqrt(A))^2."""
    num, den = [SENSITIVITY_PEAK**-0.5, bandwidth], [1.0, bandwidth * STEADY_SENSITIVITY**0.5]
    return TransferFunction(np.polymul(num, num), np.polymul(den, den))


def generalised_plant(G: StateSpace, W_S: StateSpace, W_KS: float, W_T: StateSpace) -> tuple[Array, Array, Array, Array]:
    """The generalised plant from (w, u) to (W_S (w - G u), W_KS u, W_T G u, w - G u); G strictly proper."""
    g, s, t = G.order, W_S.order, W_T.order
    A = np.block([
        [G.A, np.zeros((g, s + t))],
        [-np.outer(W_S.B, G.C), W_S.A, np.zeros((s, t))],
        [np.outer(W_T.B, G.C), np.zeros((t, s)), W_T.A],
    ])  # fmt: skip
    B = np.column_stack([np.concatenate([np.zeros(g), W_S.B, np.zeros(t)]), np.concatenate([G.B, np.zeros(s + t)])])
    C = np.vstack([
        np.concatenate([-W_S.D * G.C, W_S.C, np.zeros(t)]),
        np.zeros(g + s + t),
        np.concatenate([W_T.D * G.C, np.zeros(s), W_T.C]),
        np.concatenate([-G.C, np.zeros(s + t)]),
    ])  # fmt: skip
    D = np.array([[W_S.D, 0.0], [0.0, W_KS], [0.0, 0.0], [1.0, 0.0]])
    return A, B, C, D


def _effort(scaled: TransferFunction) -> float:
    """W_KS: K S may be as large as the inverse of the model at the frequency 10/delay, so that K rolls off above that
    frequency."""
    return float(abs(scaled.at(10j)))


def _plant(scaled: TransferFunction, bandwidth: float) -> tuple[Array, Array, Array, Array]:
    """The generalised plant in units of the delay."""
    W_S, W_T = performance_weight(bandwidth), delay_weight(1.0)
    return generalised_plant(scaled.realise(), W_S.realise(), _effort(scaled), W_T.realise())


def _largest_bandwidth(scaled: TransferFunction) -> float:
    """Find the largest bandwidth for which a controller with norm below 1 exists, by bisection between 0.001/delay and 10/delay,
    to within 1 %."""

    def is_met(bandwidth: float) -> bool:
        return _suboptimal(_plant(scaled, bandwidth)) is not None

    least = 1e-3
    if not is_met(least):
        raise InputError(
            "no controller meets the weights even at a bandwidth of 0.001 divided by the unmodelled delay: the delay is too long"
        )
    return largest(is_met, least, 10.0, within=0.01)


def _suboptimal(plant: tuple[Array, Array, Array, Array]) -> tuple[StateSpace, float] | None:
    """The central controller of norm below 1 and its norm; ``None`` if there is none."""
    slycot = _slycot()
    A, B, C, D = plant
    try:
        *K, _ = slycot.sb10fd(len(A), B.shape[1], C.shape[0], 1, 1, 1.0, A, B, C, D)
    except slycot.exceptions.SlycotArithmeticError:  # no admissible controller at this norm
        return None
    controller = StateSpace(K[0], K[1][:, 0], K[2][0], K[3][0, 0])
    closed = _closed(plant, controller)
    if np.linalg.eigvals(closed[0]).real.max() >= 0:
        return None
    states, outputs = closed[0].shape[0], closed[2].shape[0]
    norm = float(slycot.ab13dd("C", "I", "S", "D", states, 1, outputs, closed[0], np.eye(states), *closed[1:])[0])
    return None if norm > 1 else (controller, norm)


def _closed(plant: tuple[Array, Array, Array, Array], K: StateSpace) -> tuple[Array, Array, Array, Array]:
    """The closed loop from w to the weighted outputs, with u = K v, for a generalised plant whose v doesn't contain u
    directly."""
    A, B, C, D = plant
    w, u = B[:, [0]], B[:, [1]]
    weighted, v = C[:-1], C[[-1]]
    of_u = D[:-1, [1]]
    inner = np.block([
        [A + K.D * u @ v, np.outer(u, K.C)],
        [np.outer(K.B, v), K.A],
    ])  # fmt: skip
    driven = np.vstack([w + K.D * D[-1, 0] * u, K.B[:, None] * D[-1, 0]])
    seen = np.hstack([weighted + K.D * of_u @ v, np.outer(of_u, K.C)])
    return inner, driven, seen, D[:-1, [0]] + K.D * D[-1, 0] * of_u


def _slycot() -> Any:
    try:
        import slycot
    except ImportError:
        raise InputError("the H-infinity design needs the package slycot: pip install 'barbalat[robust]'") from None
    return slycot
