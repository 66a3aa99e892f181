"""The existing fixed controller, u_baseline = k_r r - K z. An adaptive law adds to it, and its closed loop is the reference
model.

z = [x; xi] contains the plant's state and the controller's state, xi' = F xi + G (r - H x). This may be the integral of the error
or the states of a PID or of any linear system. On the nominal plant x' = A x + b u the loop is

    z' = A_m z + B_m r,    A_m = A_z - b_z K,    A_z = [A 0; -G H F],    b_z = [b; 0],    B_m = [0; G] + b_z k_r,

and on a different plant z' = A_m z + b_z (theta'z + u) + [0; G] r, where theta = K' for the nominal plant. Therefore every
statement about the plant (1) holds for z. Source: Lavretsky and Wise, Robust and Adaptive Control, chapters 9 and 10.

If the input is limited, v = sat(u), anti-windup by back-calculation is available (Astrom and Murray, Feedback Systems, section
11.4). It adds the term W (v - u) to xi'. With K = [.., K_i] on the integrals and W = -inv(K_i)/T_t, the part -K_i xi of
the control changes at the rate (v - u)/T_t, so the excess beyond the limits decays with the time constant T_t.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear import riccati
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import KnownSet, ParameterBall, ParameterBox
from barbalat.problem.physical import PhysicalPlant
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, freeze

RESTS_AT_ZERO = 1e-12
"""Fraction of the largest steady-state gain of a state below which the gain of an output is rounding error, so the output settles
at 0."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FixedController:
    """A baseline's matrices for n states and m inputs: u = k_r r - K z, xi' = F xi + G (r - H x) + W (v - u), xi(0) = 0.

    Shapes: K (m, n + l), k_r (m, q), F (l, l), G (l, q), H (q, n).

    W         (l, m) back-calculation gain of the integrals at the limits; None without anti-windup
    limits    (2, m) limits of v, infinite for an input without limits; None if no input has limits
    external  whether external code computes its u, which a sampled controller then receives in addition to the measurements
    on_error  whether it acts only on r - H x, as a PID controller does
    """

    K: Array
    k_r: Array
    F: Array
    G: Array
    H: Array
    W: Array | None = None
    limits: Array | None = None
    external: bool = False
    on_error: bool = False

    def within(self, limits: Sequence[Array | None]) -> FixedController:
        """Return the same controller for an input with these limits, (2,) each, which matter only for anti-windup."""
        if self.W is None or all(one is None for one in limits):
            return self
        return replace(self, limits=np.array([(-np.inf, np.inf) if one is None else one for one in limits]).T)

    @property
    def order(self) -> int:
        """The number l of its states."""
        return len(self.F)

    @property
    def feedforward(self) -> Array | float:
        """k_r in the form of the model's k_0: a number for one input."""
        return float(self.k_r[0, 0]) if len(self.K) == 1 else self.k_r

    @property
    def enters(self) -> Array:
        """[0; G], the matrix by which the command enters the state directly: (n + l,), with m inputs (n + l, q)."""
        whole = np.vstack([np.zeros((self.H.shape[1], self.G.shape[1])), self.G])
        return whole[:, 0] if len(self.K) == 1 else whole

    @property
    def theta(self) -> Array:
        """theta, ((n + l) m,), of the nominal plant, row by row. The baseline is u = k_r r - theta'z."""
        return self.K.T.reshape(-1)

    def around(self, A: Array, b: Array) -> tuple[Array, Array]:
        """Return A_z and b_z of the state z on a plant with A and b."""
        own = self.order
        A_z = np.block([[A, np.zeros((len(A), own))], [-self.G @ self.H, self.F]])
        return A_z, np.concatenate([b, np.zeros((own, *b.shape[1:]))])

    def around_formulas(self, physical: PhysicalPlant) -> PhysicalPlant:
        """Return A_z and b_z of a plant whose entries are formulas."""
        count, beside = self.order, (-self.G @ self.H).tolist()
        A = [[*row, *[0.0] * count] for row in physical.A] + [
            [*row, *own] for row, own in zip(beside, self.F.tolist(), strict=True)
        ]
        zero = [0.0] * len(physical.b[0]) if isinstance(physical.b[0], (list, tuple)) else 0.0
        return PhysicalPlant(A=A, b=[*physical.b, *[zero] * count], parameters=physical.parameters, input=physical.input)

    def control(self, z: Value, r: Value) -> Value:
        """Return u = k_r r - K z (m,)."""
        return self.k_r @ r.reshape(-1) - self.K @ z

    def derivative(self, xi: Value, x: Value, r: Value, u: Value) -> Value:
        """Return xi' under the total control u."""
        rate = self.F @ xi + self.G @ (r.reshape(-1) - self.H @ x)
        return rate if self.limits is None else rate + self.W @ self._cut(u)

    def advance(self, xi: Value, x_before: Value, x: Value, r: Value, u: Value, T: float) -> Value:
        """Return xi one sample of length T [s] later, by the trapezoidal rule, with the command r and the control u held."""
        half = np.eye(self.order) - T / 2 * self.F
        ahead, driven = np.linalg.solve(half, np.eye(self.order) + T / 2 * self.F), np.linalg.solve(half, T * self.G)
        advanced = ahead @ xi + driven @ (r.reshape(-1) - self.H @ ((x_before + x) / 2))
        if self.limits is None or self.W is None:
            return advanced
        return advanced + np.linalg.solve(half, T * self.W) @ self._cut(u)

    def require_sampled(self, T: float) -> None:
        """Raise InputError if, at samples of T [s], anti-windup would remove more than the excess beyond the limits."""
        if self.W is None:
            return
        fastest = float(np.abs(self.K @ np.vstack([np.zeros((self.H.shape[1], len(self.K))), self.W])).max())
        if fastest * T > 1 + 1e-9:
            raise InputError.of("baseline.anti_windup", f"must be at least the sample time of {T:g} s, got {1 / fastest:.6g}")

    def _cut(self, u: Value) -> Value:
        """Return v - u, the part of u that the limits remove."""
        assert self.limits is not None
        return np.clip(u.reshape(-1), self.limits[0], self.limits[1]) - u.reshape(-1)

    def around_nominal(self, departure: KnownSet) -> KnownSet:
        """Return the known set of theta from the known set of the plant's deviation from nominal, x' = A x + b (deviation'x +
        u)."""
        zeros = np.zeros(self.order * len(self.K))
        if isinstance(departure, ParameterBall):
            if self.order:
                raise InputError.of("uncertainty", "must be a box if the baseline is dynamic: give lower and upper")
            return ParameterBall(center=departure.center + self.theta, radius=departure.radius)
        lower, upper = (np.concatenate([np.asarray(end), zeros]) for end in (departure.lower, departure.upper))
        return ParameterBox(lower=lower + self.theta, upper=upper + self.theta)


class Baseline(ABC, Settings):
    """Base of all baselines. The gains follow from the nominal plant and from the outputs that should follow the command."""

    output: Any
    external: bool
    anti_windup: float | None = None

    @abstractmethod
    def controller(self, A: Array, b: Array) -> FixedController:
        """Return the controller for the nominal plant x' = A x + b u. Raises InputError if the two do not fit."""

    def on(self, A: Array, b: Array) -> FixedController:
        """Return the controller with its external flag and its anti-windup."""
        validate.instance("baseline.external", self.external, bool)
        found = replace(self.controller(A, b), external=self.external)
        if self.anti_windup is None:
            return found
        return replace(found, W=_tracking(found, validate.positive("baseline.anti_windup", self.anti_windup)))

    def followed(self, A: Array, b: Array) -> tuple[Array, Array]:
        """Return b as (n, m), and H (m, n)."""
        n, B = len(A), np.asarray(b, dtype=float).reshape(len(A), -1)
        if self.output is None:
            raise InputError.of("baseline.output", "is missing: give the row of C for the output that tracks the command")
        H = np.atleast_2d(np.asarray(validate.array("baseline.output", self.output, (None,) * validate.dimensions(self.output))))
        if H.shape != (B.shape[1], n):
            raise InputError.of(
                "baseline.output",
                f"must be {B.shape[1]} x {n}, one row for each input, got {' x '.join(map(str, H.shape))}",
            )
        return B, H


def _tracking(fixed: FixedController, T_t: float) -> Array:
    """Return W, which is -inv(K_i)/T_t on the states that integrate, one for each input, and 0 on the others."""
    integrals = np.flatnonzero(~fixed.F.any(axis=1))
    K_i = fixed.K[:, fixed.H.shape[1] + integrals]
    if np.linalg.svd(K_i, compute_uv=False).min() <= 1e-9 * np.abs(fixed.K).max():
        raise InputError.of(
            "baseline.anti_windup", "needs an integral that acts on each input, but one of them has almost no gain"
        )
    W = np.zeros((fixed.order, len(fixed.K)))
    W[integrals] = -np.linalg.inv(K_i) / T_t
    return W


def _at_rest(A: Array, B: Array, H: Array, K: Array) -> Array:
    """Return the k_r with which H x settles at a constant command."""
    states = np.linalg.solve(B @ K - A, B)  # steady-state x for a constant 1 added to each input
    gains = H @ states
    if np.linalg.svd(gains, compute_uv=False).min() <= RESTS_AT_ZERO * np.abs(H).max() * np.abs(states).max():
        raise InputError.of(
            "baseline",
            "cannot hold the followed output at every constant command: it comes to rest at 0, or outputs depend on each other; "
            "choose a different state to track the command, or give feedforward",
        )
    return np.asarray(np.linalg.inv(gains))


def _without_states(A: Array, B: Array, H: Array, K: Array, k_r: Array | None) -> FixedController:
    k_r = _at_rest(A, B, H, K) if k_r is None else k_r
    return FixedController(K=K, k_r=k_r, F=np.zeros((0, 0)), G=np.zeros((0, len(H))), H=H)


def _matrix(field: str, given: Any, rows: int, columns: int) -> Array:
    """Return a matrix from a matrix, from a list if it has one row, or from a number if it has one entry."""
    if validate.dimensions(given) == 0:
        return (
            np.array([[validate.number(field, given)]]) if rows == columns == 1 else validate.array(field, given, (rows, columns))
        )
    if validate.dimensions(given) == 1 and rows == 1:
        return validate.vector(field, given, columns)[None]
    return validate.array(field, given, (rows, columns))


@dataclass(frozen=True, eq=False)
class StateBaseline(Baseline):
    """u = feedforward r - K x with existing gains.

    K            (n,), with m inputs (m, n)
    feedforward  a number, with m inputs (m, m); by default such that the output settles at a constant command
    output       (n,), with m inputs (m, n): the output that is to follow the command
    external     whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    K: Array
    _: KW_ONLY
    feedforward: float | Array | None = None
    output: Array | None = None
    external: bool = False

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        m = B.shape[1]
        k_r = None if self.feedforward is None else _matrix("baseline.feedforward", self.feedforward, m, m)
        return _without_states(A, B, H, _matrix("baseline.K", self.K, m, len(A)), k_r)


@dataclass(frozen=True, eq=False)
class LqrBaseline(Baseline):
    """u = k_r r - K x, where K minimises the integral of x'Q x + u'R u; the output settles at a constant command.

    Q       weights of the states, (n,), or a matrix
    R       weights of the inputs: a number, (m,), or a matrix
    output  (n,), with m inputs (m, n): the output that is to follow the command
    external  whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    Q: Array
    R: float | Array
    _: KW_ONLY
    output: Array | None = None
    external: bool = False

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        return _without_states(A, B, H, _optimal(A, B, self.Q, self.R), None)


@dataclass(frozen=True, eq=False)
class LqiBaseline(Baseline):
    """u = -K [x; xi] with the integral xi of r - H x; K minimises the integral of z'Q z + u'R u.

    Q       weights of the states, followed by those of the integrated errors, (n + m,), or a matrix
    R       weights of the inputs: a number, (m,), or a matrix
    output  (n,), with m inputs (m, n): H, the output that is to follow the command
    anti_windup  > 0, T_t: time constant with which the integral unwinds the excess beyond the input's limits [s]
    external  whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    Q: Array
    R: float | Array
    _: KW_ONLY
    output: Array | None = None
    anti_windup: float | None = None
    external: bool = False

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        n, m = B.shape
        integral = FixedController(K=np.zeros((m, n + m)), k_r=np.zeros((m, m)), F=np.zeros((m, m)), G=np.eye(m), H=H)
        K = _optimal(*integral.around(A, B), self.Q, self.R)
        return FixedController(K=K, k_r=integral.k_r, F=integral.F, G=integral.G, H=H)


def _optimal(A: Array, B: Array, Q: Any, R: Any) -> Array:
    """Return K of the linear quadratic regulator. Raises InputError for weights of a different size, or if the plant cannot be
    stabilised."""
    n, m = B.shape
    weights, costs = _weights("baseline.Q", Q, n), _weights("baseline.R", R, m)
    if np.linalg.eigvalsh(weights).min() < -1e-12 * np.abs(weights).max(initial=1.0):
        raise InputError.of("baseline.Q", f"must be positive semi-definite, got {validate.show(Q)}")
    if not np.linalg.eigvalsh(costs).min() > 0:
        raise InputError.of("baseline.R", f"must be positive definite, got {validate.show(R)}")
    try:
        P = riccati.continuous(A, B, weights, costs)
    except np.linalg.LinAlgError:
        raise InputError.of(
            "baseline",
            "has no optimal gain on the nominal plant: unstable and integrated modes must be controllable and weighted by Q",
        ) from None
    return np.asarray(np.linalg.solve(costs, B.T @ P))


def _weights(field: str, given: Any, size: int) -> Array:
    """Return a symmetric matrix of weights from a matrix, from its diagonal, or from a number if it has one entry."""
    if validate.dimensions(given) == 2:
        matrix = validate.square_matrix(field, given, size)
        if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0):
            raise InputError.of(field, f"must be symmetric, got {validate.show(given)}")
        return matrix
    entries = [validate.number(field, given)] if validate.dimensions(given) == 0 else given
    return np.diag(validate.vector(field, entries, size))


class OnTheError(Baseline):
    """A linear system K(s) that acts on the error of one output, u = K(s)[r - H x]."""

    @abstractmethod
    def realised(self) -> StateSpace:
        """Return a realisation of K(s)."""

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        if B.shape[1] > 1:
            raise InputError.of(
                "baseline.kind", f"supports only plants with one input, got {B.shape[1]}; lqi and state support several"
            )
        K = self.realised()
        return FixedController(
            K=np.concatenate([K.D * H[0], -K.C])[None], k_r=np.array([[K.D]]), F=K.A, G=K.B.reshape(-1, 1), H=H, on_error=True
        )


@dataclass(frozen=True, eq=False)
class PiBaseline(OnTheError):
    """u = k_p (r - y) + k_i int (r - y) dt, y = H x.

    k_p     proportional gain [u per unit of y]
    k_i     integral gain [u per unit of y and s]
    output  (n,): H, the output that is to follow the command
    anti_windup  > 0, T_t: time constant with which the integral unwinds the excess beyond the input's limits [s]
    external  whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    k_p: float
    k_i: float
    _: KW_ONLY
    output: Array | None = None
    anti_windup: float | None = None
    external: bool = False

    def __post_init__(self) -> None:
        freeze(self, k_p=validate.number("baseline.k_p", self.k_p), k_i=_not_zero("baseline.k_i", self.k_i))

    def realised(self) -> StateSpace:
        return StateSpace(np.zeros((1, 1)), np.ones(1), np.array([self.k_i]), self.k_p)


@dataclass(frozen=True, eq=False)
class PidBaseline(OnTheError):
    """u = [k_p + k_i/s + k_d s/(T_f s + 1)] (r - y), y = H x.

    k_p     proportional gain [u per unit of y]
    k_i     integral gain [u per unit of y and s]
    k_d     derivative gain [u s per unit of y]
    T_f     > 0, time constant of the derivative's filter [s]
    output  (n,): H, the output that is to follow the command
    anti_windup  > 0, T_t: time constant with which the integral unwinds the excess beyond the input's limits [s]
    external  whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    k_p: float
    k_i: float
    k_d: float
    T_f: float
    _: KW_ONLY
    output: Array | None = None
    anti_windup: float | None = None
    external: bool = False

    def __post_init__(self) -> None:
        freeze(self, k_p=validate.number("baseline.k_p", self.k_p), k_i=_not_zero("baseline.k_i", self.k_i))
        freeze(self, k_d=_not_zero("baseline.k_d", self.k_d), T_f=validate.positive("baseline.T_f", self.T_f))

    def realised(self) -> StateSpace:
        fast = 1 / self.T_f
        return StateSpace(
            np.diag([0.0, -fast]), np.array([1.0, fast]), np.array([self.k_i, -self.k_d * fast]), self.k_p + self.k_d * fast
        )


@dataclass(frozen=True, eq=False)
class SystemBaseline(OnTheError):
    """u = K(s)[r - y], y = H x: any proper linear system with one input and one output.

    system  a TransferFunction or StateSpace, or one of python-control or SciPy
    output  (n,): H, the output that is to follow the command
    external  whether external code computes it: an exported controller then receives its u at each sample; false by default
    """

    system: Any
    _: KW_ONLY
    output: Array | None = None
    external: bool = False

    def __post_init__(self) -> None:
        freeze(self, system=StateSpace.accept("baseline", self.system))

    def realised(self) -> StateSpace:
        found: StateSpace = self.system
        return found


def _not_zero(field: str, given: Any) -> float:
    found = validate.number(field, given)
    if found == 0:
        raise InputError.of(field, "must not be zero: it multiplies a state that would have no effect")
    return found


BASELINES: Mapping[str, type[Baseline]] = {
    "state": StateBaseline,
    "lqr": LqrBaseline,
    "lqi": LqiBaseline,
    "pi": PiBaseline,
    "pid": PidBaseline,
    "system": SystemBaseline,
}
"""The baselines by their names in case files."""
