"""The fixed controller that is already there, u_baseline = k_r r - K z: an adaptive law adds to it, and its loop is the model.

z = [x; xi] holds the plant's state and the controller's own, xi' = F xi + G (r - H x): the integral of the error, the states of a
PID or of any linear system. On the nominal plant x' = A x + b u the loop is

    z' = A_m z + B_m r,    A_m = A_z - b_z K,    A_z = [A 0; -G H F],    b_z = [b; 0],    B_m = [0; G] + b_z k_r,

and on another plant z' = A_m z + b_z (theta'z + u) + [0; G] r, where theta = K' is the nominal one: all that is said of the plant
(1) holds for z. Source: Lavretsky and Wise, Robust and Adaptive Control, chapters 9 and 10.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import KnownSet, ParameterBall, ParameterBox
from barbalat.problem.physical import PhysicalPlant
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False, kw_only=True)
class FixedController:
    """u = k_r r - K z, xi' = F xi + G (r - H x), xi(0) = 0: a baseline's numbers on a plant of n states with m inputs.

    Shapes: K (m, n + l), k_r (m, q), F (l, l), G (l, q), H (q, n).
    """

    K: Array
    k_r: Array
    F: Array
    G: Array
    H: Array

    @property
    def order(self) -> int:
        """The number l of its states."""
        return len(self.F)

    @property
    def feedforward(self) -> Array | float:
        """k_r as the model's k_0: a number for one input."""
        return float(self.k_r[0, 0]) if len(self.K) == 1 else self.k_r

    @property
    def enters(self) -> Array:
        """[0; G], by which the command enters beside the input: (n + l,), with m inputs (n + l, q)."""
        whole = np.vstack([np.zeros((self.H.shape[1], self.G.shape[1])), self.G])
        return whole[:, 0] if len(self.K) == 1 else whole

    @property
    def theta(self) -> Array:
        """((n + l) m,) the nominal plant's theta, row by row: u = k_r r - theta'z is the baseline."""
        return self.K.T.reshape(-1)

    def around(self, A: Array, b: Array) -> tuple[Array, Array]:
        """A_z and b_z of z on a plant with A and b."""
        own = self.order
        A_z = np.block([[A, np.zeros((len(A), own))], [-self.G @ self.H, self.F]])
        return A_z, np.concatenate([b, np.zeros((own, *b.shape[1:]))])

    def around_formulas(self, physical: PhysicalPlant) -> PhysicalPlant:
        """A_z and b_z of a plant whose entries are formulas."""
        count, beside = self.order, (-self.G @ self.H).tolist()
        A = [[*row, *[0.0] * count] for row in physical.A] + [
            [*row, *own] for row, own in zip(beside, self.F.tolist(), strict=True)
        ]
        zero = [0.0] * len(physical.b[0]) if isinstance(physical.b[0], (list, tuple)) else 0.0
        return PhysicalPlant(A=A, b=[*physical.b, *[zero] * count], parameters=physical.parameters, input=physical.input)

    def derivative(self, xi: Value, x: Value, r: Value) -> Value:
        """xi'."""
        return self.F @ xi + self.G @ (r.reshape(-1) - self.H @ x)

    def advance(self, xi: Value, x_before: Value, x: Value, r: Value, T: float) -> Value:
        """xi one sample of length T [s] later, by the trapezoidal rule, under the command r that was held since."""
        half = np.eye(self.order) - T / 2 * self.F
        ahead, driven = np.linalg.solve(half, np.eye(self.order) + T / 2 * self.F), np.linalg.solve(half, T * self.G)
        return ahead @ xi + driven @ (r.reshape(-1) - self.H @ ((x_before + x) / 2))

    def around_nominal(self, departure: KnownSet) -> KnownSet:
        """The known set of theta from that of the plant's departure from the nominal one, x' = A x + b (departure'x + u)."""
        zeros = np.zeros(self.order * len(self.K))
        if isinstance(departure, ParameterBall):
            if self.order:
                raise InputError.of("uncertainty", "must be a box beside a baseline with states of its own: give lower and upper")
            return ParameterBall(center=departure.center + self.theta, radius=departure.radius)
        lower, upper = (np.concatenate([np.asarray(end), zeros]) for end in (departure.lower, departure.upper))
        return ParameterBox(lower=lower + self.theta, upper=upper + self.theta)


class Baseline(ABC, Settings):
    """What every kind has: its numbers follow from the nominal plant and from what is to follow the command."""

    output: Any

    @abstractmethod
    def controller(self, A: Array, b: Array) -> FixedController:
        """On the nominal plant x' = A x + b u; InputError where the two don't fit."""

    def followed(self, A: Array, b: Array) -> tuple[Array, Array]:
        """b as (n, m) and H (m, n)."""
        n, B = len(A), np.asarray(b, dtype=float).reshape(len(A), -1)
        if self.output is None:
            raise InputError.of("baseline.output", "is missing: give the row of C of what is to follow the command")
        H = np.atleast_2d(np.asarray(validate.array("baseline.output", self.output, (None,) * validate.dimensions(self.output))))
        if H.shape != (B.shape[1], n):
            raise InputError.of(
                "baseline.output",
                f"must be {B.shape[1]} x {n}, one row for each input, got {' x '.join(map(str, H.shape))}",
            )
        return B, H


def _at_rest(A: Array, B: Array, H: Array, K: Array) -> Array:
    """k_r with which H x comes to rest at a constant command."""
    gains = H @ np.linalg.solve(B @ K - A, B)
    if np.linalg.svd(gains, compute_uv=False).min() <= 1e-9 * np.abs(gains).max(initial=0.0) or not gains.any():
        raise InputError.of(
            "baseline", "can't bring what it follows to rest at every constant command; give feedforward, or an integral"
        )
    return np.asarray(np.linalg.inv(gains))


def _without_states(A: Array, B: Array, H: Array, K: Array, k_r: Array | None) -> FixedController:
    k_r = _at_rest(A, B, H, K) if k_r is None else k_r
    return FixedController(K=K, k_r=k_r, F=np.zeros((0, 0)), G=np.zeros((0, len(H))), H=H)


def _matrix(field: str, given: Any, rows: int, columns: int) -> Array:
    """A matrix, or a list where there is one row, or a number where there is one entry."""
    if validate.dimensions(given) == 0:
        return (
            np.array([[validate.number(field, given)]]) if rows == columns == 1 else validate.array(field, given, (rows, columns))
        )
    if validate.dimensions(given) == 1 and rows == 1:
        return validate.vector(field, given, columns)[None]
    return validate.array(field, given, (rows, columns))


@dataclass(frozen=True, eq=False)
class StateBaseline(Baseline):
    """u = feedforward r - K x: gains that are flown already.

    K            (n,), with m inputs (m, n)
    feedforward  a number, with m inputs (m, m); by default so that what follows the command comes to rest there
    output       (n,), with m inputs (m, n): what is to follow the command
    """

    K: Array
    _: KW_ONLY
    feedforward: float | Array | None = None
    output: Array | None = None

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        m = B.shape[1]
        k_r = None if self.feedforward is None else _matrix("baseline.feedforward", self.feedforward, m, m)
        return _without_states(A, B, H, _matrix("baseline.K", self.K, m, len(A)), k_r)


@dataclass(frozen=True, eq=False)
class LqrBaseline(Baseline):
    """u = k_r r - K x, K minimises the integral of x'Q x + u'R u; what follows the command comes to rest there.

    Q       weights of the states, (n,), or a matrix
    R       of the inputs: a number, (m,), or a matrix
    output  (n,), with m inputs (m, n): what is to follow the command
    """

    Q: Array
    R: float | Array
    _: KW_ONLY
    output: Array | None = None

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        return _without_states(A, B, H, _optimal(A, B, self.Q, self.R), None)


@dataclass(frozen=True, eq=False)
class LqiBaseline(Baseline):
    """u = -K [x; xi], xi the integral of r - H x: K minimises the integral of z'Q z + u'R u.

    Q       weights of the states and, last, of the errors' integrals, (n + m,), or a matrix
    R       of the inputs: a number, (m,), or a matrix
    output  (n,), with m inputs (m, n): H, what is to follow the command
    """

    Q: Array
    R: float | Array
    _: KW_ONLY
    output: Array | None = None

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        n, m = B.shape
        integral = FixedController(K=np.zeros((m, n + m)), k_r=np.zeros((m, m)), F=np.zeros((m, m)), G=np.eye(m), H=H)
        K = _optimal(*integral.around(A, B), self.Q, self.R)
        return FixedController(K=K, k_r=integral.k_r, F=integral.F, G=integral.G, H=H)


def _optimal(A: Array, B: Array, Q: Any, R: Any) -> Array:
    """K of the linear quadratic regulator; InputError for weights of another size, and where nothing stabilises."""
    from scipy.linalg import solve_continuous_are

    n, m = B.shape
    weights, costs = _weights("baseline.Q", Q, n), _weights("baseline.R", R, m)
    if np.linalg.eigvalsh(weights).min() < -1e-12 * np.abs(weights).max(initial=1.0):
        raise InputError.of("baseline.Q", f"must be positive semi-definite, got {validate.show(Q)}")
    if not np.linalg.eigvalsh(costs).min() > 0:
        raise InputError.of("baseline.R", f"must be positive definite, got {validate.show(R)}")
    try:
        P = solve_continuous_are(A, B, weights, costs)
    except (np.linalg.LinAlgError, ValueError):
        raise InputError.of(
            "baseline",
            "has no optimal gain on the nominal plant: what is unstable, or integrated, must be within the input's reach and "
            "weighted by Q",
        ) from None
    return np.asarray(np.linalg.solve(costs, B.T @ P))


def _weights(field: str, given: Any, size: int) -> Array:
    """A number for one entry, a diagonal, or a symmetric matrix."""
    if validate.dimensions(given) == 2:
        matrix = validate.square_matrix(field, given, size)
        if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0):
            raise InputError.of(field, f"must be symmetric, got {validate.show(given)}")
        return matrix
    entries = [validate.number(field, given)] if validate.dimensions(given) == 0 else given
    return np.diag(validate.vector(field, entries, size))


class OnTheError(Baseline):
    """A linear system K(s) of one output's error: u = K(s)[r - H x]."""

    @abstractmethod
    def realised(self) -> StateSpace:
        """K(s)."""

    def controller(self, A: Array, b: Array) -> FixedController:
        B, H = self.followed(A, b)
        if B.shape[1] > 1:
            raise InputError.of("baseline.kind", f"is for plants with one input, got {B.shape[1]}; lqi and state take several")
        K = self.realised()
        return FixedController(
            K=np.concatenate([K.D * H[0], -K.C])[None], k_r=np.array([[K.D]]), F=K.A, G=K.B.reshape(-1, 1), H=H
        )


@dataclass(frozen=True, eq=False)
class PiBaseline(OnTheError):
    """u = k_p (r - y) + k_i int (r - y) dt, y = H x.

    k_p     proportional gain [u per unit of y]
    k_i     integral gain [u per unit of y and s]
    output  (n,): H, what is to follow the command
    """

    k_p: float
    k_i: float
    _: KW_ONLY
    output: Array | None = None

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
    output  (n,): H, what is to follow the command
    """

    k_p: float
    k_i: float
    k_d: float
    T_f: float
    _: KW_ONLY
    output: Array | None = None

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
    """u = K(s)[r - y], y = H x: any proper linear system of one input and one output.

    system  a TransferFunction or StateSpace, or one of python-control or SciPy
    output  (n,): H, what is to follow the command
    """

    system: Any
    _: KW_ONLY
    output: Array | None = None

    def __post_init__(self) -> None:
        freeze(self, system=StateSpace.accept("baseline", self.system))

    def realised(self) -> StateSpace:
        found: StateSpace = self.system
        return found


def _not_zero(field: str, given: Any) -> float:
    found = validate.number(field, given)
    if found == 0:
        raise InputError.of(field, "must not be zero: what it multiplies would be a state that nothing feels")
    return found


BASELINES: Mapping[str, type[Baseline]] = {
    "state": StateBaseline,
    "lqr": LqrBaseline,
    "lqi": LqiBaseline,
    "pi": PiBaseline,
    "pid": PidBaseline,
    "system": SystemBaseline,
}
"""By the names of case files."""
