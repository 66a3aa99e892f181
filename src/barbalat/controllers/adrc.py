"""Active disturbance rejection: an observer estimates the disturbance at the input, and the control cancels it. It is linear
and does not adapt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme, require_taken
from barbalat.controllers.steps import LinearStep, Tustin
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError, Vector, show

PLACEMENT_TOLERANCE = 1e-6
"""Relative tolerance of the observer's characteristic polynomial; a larger error means that a state or the disturbance is hardly
observable."""


@dataclass(frozen=True, eq=False)
class Observer:
    """xi' = F xi + G x + H v with (x_hat, f_hat) = M xi + N x; n states, m inputs."""

    F: Array
    G: Array
    H: Array
    M: Array
    N: Array

    @classmethod
    def of_state(cls, A: Array, b: Array, bandwidth: float) -> Observer:
        """f_hat = bandwidth/(s + bandwidth) [f] from the whole state: f_hat = xi + bandwidth b^+ x, which needs no x'; x_hat = x.

        Raises InputError if the columns of b are linearly dependent.
        """
        n, m = b.shape
        if np.linalg.matrix_rank(b) < m:
            raise InputError(f"adrc needs independent columns of plant.b, got {show(b)}")
        measured = bandwidth * np.linalg.pinv(b)
        return cls(
            F=-bandwidth * np.eye(m),
            G=-measured @ A - bandwidth * measured,
            H=-bandwidth * np.eye(m),
            M=np.vstack([np.zeros((n, m)), np.eye(m)]),
            N=np.vstack([np.eye(n), measured]),
        )

    @classmethod
    def of_output(cls, A: Array, b: Array, c: Array, bandwidth: float) -> Observer:
        """The extended-state observer: xi = (x_hat, f_hat), from c'x, with all n + 1 poles at -bandwidth, for one input.

        Raises InputError if a state or the disturbance is not observable from c'x: c'(sI - A)^-1 b must not vanish at s = 0.
        """
        n, m = b.shape
        if m > 1:
            raise InputError(f"output needs a plant with one input, got {m}: omit it; then the whole state is measured")
        extended, seen = np.block([[A, b], [np.zeros((1, n + 1))]]), np.append(c, 0.0)
        try:
            with np.errstate(all="ignore"):
                gain = _ackermann(extended, seen, bandwidth)
                F = extended - np.outer(gain, seen)
                off = np.abs(np.poly(F) / np.poly(np.full(n + 1, -bandwidth)) - 1).max()
        except np.linalg.LinAlgError:
            off = np.inf
        if not off <= PLACEMENT_TOLERANCE:
            raise InputError(
                f"the output must make every state and a constant disturbance observable, but {show(c)} does not, or not within "
                f"rounding for the bandwidth {bandwidth:g}"
            )
        return cls(
            F=F,
            G=np.outer(gain, c),
            H=np.vstack([b, np.zeros((1, 1))]),
            M=np.eye(n + 1),
            N=np.zeros((n + 1, n)),
        )

    def started(self, x: Value) -> Value:
        """xi for the measured state and no disturbance, x_hat = x and f_hat = 0: M'M = I in both forms."""
        wanted = np.concatenate([x, np.zeros(self.N.shape[0] - x.shape[0])]) - self.N @ x
        return self.M.T @ wanted

    def derivative(self, xi: Value, x: Value, v: Value) -> Value:
        """The derivative of the observer's state xi."""
        return self.F @ xi + self.G @ x + self.H @ v

    def estimates(self, xi: Value, x: Value) -> tuple[Value, Value]:
        """x_hat (n,) and f_hat (m,)."""
        both, n = self.M @ xi + self.N @ x, self.N.shape[1]
        return both[:n], both[n:]


def _ackermann(A: Array, c: Array, bandwidth: float) -> Array:
    """g with all eigenvalues of A - g c' at -bandwidth: (A + bandwidth I)^N O^-1 [0 ... 0 1]', O the observability matrix."""
    size, rows = len(A), [c]
    for _ in range(size - 1):
        rows.append(rows[-1] @ A / bandwidth)  # scaled to give the rows similar magnitudes
    last = np.zeros(size)
    last[-1] = np.float64(bandwidth) ** -(size - 1)
    column = np.linalg.solve(np.array(rows), last)
    return np.asarray(np.linalg.matrix_power(A + bandwidth * np.eye(size), size) @ column)


class State(NamedTuple):
    """The controller's states; it estimates no parameters."""

    xi: Value  # the observer's


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """u = (k_0 r - theta_0'x_hat - f_hat)/b_0."""

    observer: Observer
    theta_0: Array  # (n, m)
    b_0: float
    k_0: Array | float
    x0: Array
    limits: Array | None = None  # limits of the input, if the observer receives sat(u)

    roles: ClassVar[Mapping[str, Role]] = {"xi": Role.predictor("state of the observer")}

    def initial(self) -> State:
        return State(self.observer.started(self.x0))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        x_hat, f_hat = self.observer.estimates(state.xi, x)
        u = (np.dot(self.k_0, r).reshape(-1) - self.theta_0.T @ x_hat - f_hat) / self.b_0
        return u[0] if self.theta_0.shape[1] == 1 else u

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        return State(self.observer.derivative(state.xi, x, self.b_0 * applied(u, self.limits).reshape(-1)))

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Tustin:
        return Tustin(self, T, LinearStep.of(self.observer.F, T))


@dataclass(frozen=True, eq=False)
class Adrc(Scheme):
    """u = (k_0 r - theta_0'x_hat - f_hat)/b_0, with f_hat from an observer of x' = A x + b (b_0 u + f), f' = 0; A = A_m + b
    theta_0'.

    bandwidth  omega_o [rad/s]: every pole of the observer is at -omega_o
    output     c, (n,): the extended-state observer of order n + 1 then measures only c'x, as in the textbooks. By default the
               whole state is measured, and only the disturbance is observed: f_hat = omega_o/(s + omega_o) [f]
    nominal    theta_0, (n,), or (n m,) with m inputs: the parameters that the observer assumes; zero by default, so it uses the
               model's A_m. For the textbook chain of integrators, give the theta_0 with which A is such a chain
    b_0        the assumed effectiveness of the input, > 0; 1 by default
    saturated_predictor  against windup: the observer receives sat(u); off by default

    The textbook bandwidth of the state feedback, omega_c, is that of the reference model.

    Source: Gao, Scaling and bandwidth-parameterization based controller tuning, ACC 2003; Han, From PID to active disturbance
    rejection control, IEEE Trans. Industrial Electronics 56(3), 2009.
    """

    bandwidth: float
    _: KW_ONLY
    output: Vector | None = None
    nominal: Vector | None = None
    b_0: float = 1.0
    saturated_predictor: bool = False
    name: str = "ADRC"

    beyond: ClassVar[tuple[str, ...]] = ("a baseline",)

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(self, bandwidth=validate.positive("bandwidth", self.bandwidth), b_0=validate.positive("b_0", self.b_0))
        for field, value in (("output", self.output), ("nominal", self.nominal)):
            if value is not None:
                validate.freeze(self, **{field: validate.vector(field, value)})

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        return TuningGrid(
            scheme="ADRC",
            values={"bandwidth": reach.frequencies},
            make=lambda bandwidth: cls(bandwidth=bandwidth, nominal=reach.nominal, saturated_predictor=reach.saturated),
            traded=False,
            aims=("complementary_sensitivity_peak", "condition"),
        )

    def bind(self, known: Known) -> Equations:
        require_taken(Adrc, known)
        n, m = known.n, known.inputs
        nominal = np.zeros(n * m) if self.nominal is None else validate.vector("nominal", self.nominal, n * m)
        theta_0, b = nominal.reshape(n, m), known.b.reshape(n, m)
        A = known.A_m + b @ theta_0.T
        return Equations(
            observer=Observer.of_state(A, b, self.bandwidth)
            if self.output is None
            else Observer.of_output(A, b, validate.vector("output", self.output, n), self.bandwidth),
            theta_0=theta_0,
            b_0=self.b_0,
            k_0=known.k_0,
            x0=known.x0,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )
