"""Observers, which estimate a state that is not measured from y = C x and u. State feedback uses the estimate x_hat as x.

An observer is designed for the nominal plant x' = A x + b u and is part of the controller. In continuous time it is

    z' = F z + G y + B v,    x_hat = H z + D y,

where v is the control within the limits that the design knows. For a Luenberger observer and a Kalman filter z is x_hat itself,
x_hat' = A x_hat + b v + L (y - C x_hat). In sampled form the same plant is predicted exactly with the held v, and the new sample
corrects the prediction (the current estimator of Franklin, Powell and Workman, Digital Control, section 8.2):

    x_bar[k] = Phi x_hat[k-1] + Gamma v[k-1],    x_hat[k] = x_bar[k] + M (y[k] - C x_bar[k]).

After a lost sample nothing is corrected, and x_hat[k] = x_bar[k]. Filtered derivatives then keep their value, and the measured
states continue at that rate. The sampled prediction contains the delay of the plant's input: z consists of x_hat and of those
v[k-1], v[k-2], ... that have not arrived yet. The continuous observer ignores the delay.

Like every baseline that acts only on the error of a measured state, a PI controller does not depend on the observer. Rows of H
and D then put the measured value of this state into x_hat. In sampled form z[k] contains y[k], or its prediction at a lost
sample.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.linear import riccati
from barbalat.linear.conditions import unobservable_mode
from barbalat.linear.pole_placement import observer_gain, wanted_poles
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.protocols import Value
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, Matrix, Vector, freeze

FIELD = "observer"


@dataclass(frozen=True, eq=False, kw_only=True)
class ObserverEquations:
    """The equations of z from y and v, and of x_hat from z and y. F, G and B give increments per sample in sampled form,
    otherwise rates.

    Shapes: F (l, l), G (l, p), B (l, m), H (n, l), D (n, p).

    H, D        None if z is x_hat itself; D is also None in sampled form
    Phi, Gamma  (l, l), (l, m) matrices that replace F and B at a lost sample; None in continuous time
    start       (l,) z before the first measurement
    limits      (2, m) limits of u, which the observer knows; None if it knows none
    """

    F: Array
    G: Array
    B: Array
    start: Array
    H: Array | None = None
    D: Array | None = None
    Phi: Array | None = None
    Gamma: Array | None = None
    limits: Array | None = None

    def derivative(self, z: Value, y: Value, u: Value) -> Value:
        """z'."""
        return self.F @ z + self.G @ y + self.B @ self._within_limits(u)

    def advance(self, z: Value, u: Value, y: Value, lost: Value = None) -> Value:
        """Return z at the sample y, from z at the previous sample, with u held in between. y is not used if ``lost`` is true."""
        v = self._within_limits(u)
        corrected = self.F @ z + self.B @ v + self.G @ y
        return corrected if lost is None else np.where(lost, self.Phi @ z + self.Gamma @ v, corrected)

    def estimate(self, z: Value, y: Value) -> Value:
        """x_hat, (n,)."""
        if self.H is None:
            return z
        return self.H @ z if self.D is None else self.H @ z + self.D @ y

    def _within_limits(self, u: Value) -> Value:
        v = u.reshape(-1)
        return v if self.limits is None else np.clip(v, self.limits[0], self.limits[1])


@dataclass(frozen=True, eq=False, kw_only=True)
class FixedObserver(Settings):
    """An observer together with the nominal plant of its design. It does not change when the plant is varied.

    design  the observer's settings
    A, b    the nominal plant, (n, n) and (n,) or (n, m)
    C       (p, n) matrix of the measurement
    direct  the measured quantities that are states on whose errors a baseline acts; x_hat contains their measured values, and
            after a lost sample their predictions
    delay   delay of the plant's input [s], included in a sampled observer
    """

    design: Observer
    A: Matrix = field(repr=False)
    b: Array = field(repr=False)
    C: Matrix = field(repr=False)
    delay: float = field(default=0.0, repr=False)
    direct: tuple[int, ...] = field(default=(), repr=False)
    __repr__ = one_line

    def __post_init__(self) -> None:
        self.design.require(self.A, self.C)

    @classmethod
    def of(
        cls, design: Observer, A: Array, b: Array, names: Sequence[str], delay: float = 0.0, compared: Array | None = None
    ) -> FixedObserver:
        """Return the observer for x' = A x + b u(t - delay) with states called ``names``. Raises InputError if the two do not
        fit.

        compared  (n,) whether a baseline compares this state with the command and uses no other state; None without a baseline
        """
        found = cls(design=design, A=A, b=b, C=measured_rows(design.measured, names), delay=delay)
        if compared is None or not set(np.flatnonzero(compared)) <= set(found.places):
            return found
        return replace(found, direct=tuple(j for j, at in enumerate(found.places) if at is not None and compared[at]))

    @property
    def outputs(self) -> int:
        """The number of measured quantities."""
        return len(self.C)

    def names(self, states: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the measured quantities, which are those of the states or y_1, y_2, ..."""
        return tuple(f"y_{i + 1}" if at is None else states[at] for i, at in enumerate(self.places))

    @property
    def places(self) -> tuple[int | None, ...]:
        """The index of the state that each measured quantity equals; None for a quantity that is not a single state."""
        return tuple(int(np.argmax(row)) if np.count_nonzero(row) == 1 and row.max() == 1 else None for row in self.C)

    def first(self, x0: Array) -> Array:
        """Return x_hat(0) (n,), the smallest state that agrees with the measurement of x0."""
        return np.asarray(self.from_measured(self.C @ x0))

    def from_measured(self, y: Array) -> Array:
        """Return the smallest state whose measurement is y (p,)."""
        return np.asarray(np.linalg.pinv(self.C) @ y)

    def equations(self, x0: Array, limits: Array | None, T: float | None) -> ObserverEquations:
        """Return the equations in continuous time, or for samples of length T [s]. x_hat starts at x0 (n,)."""
        bounds = None if limits is None else np.asarray(limits, dtype=float).reshape(2, -1)
        made = dict(_designed(self, T))
        of_x = made.pop("of_x", None)
        return ObserverEquations(**made, start=x0 if of_x is None else of_x @ x0, limits=bounds)


@lru_cache(maxsize=16)  # the members of an ensemble share the design, and a Riccati equation takes longer than a short run
def _designed(plant: FixedObserver, T: float | None) -> Mapping[str, Any]:
    """Return the matrices of a design in continuous time, or for samples of length T [s]."""
    made = plant.design.continuous(plant) if T is None else plant.design.sampled(plant, T)
    return _with_measured(plant, made) if plant.direct and plant.design.filters else made


def _with_measured(plant: FixedObserver, made: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same observer with x_hat (and z, in sampled form) holding the measured values of the ``direct`` states."""
    n, held = len(plant.A), len(made["F"])
    rows, y = np.argmax(plant.C[list(plant.direct)], axis=1), np.eye(plant.outputs)[list(plant.direct)]
    H = np.array(made.get("H", np.eye(n, held)))
    own = H[rows]
    H[rows] = 0.0
    if "Phi" not in made:
        D = np.zeros((n, plant.outputs))
        D[rows] = y
        return {**made, "H": H, "D": D}
    k, beside = len(rows), np.zeros((held, len(rows)))
    return {
        "F": np.block([[made["F"], beside], [np.zeros((k, held + k))]]),
        "G": np.vstack([made["G"], y]),
        "B": np.vstack([made["B"], np.zeros((k, made["B"].shape[1]))]),
        "Phi": np.block([[made["Phi"], beside], [own @ made["Phi"], np.zeros((k, k))]]),
        "Gamma": np.vstack([made["Gamma"], own @ made["Gamma"]]),
        "H": np.hstack([H, np.eye(n)[:, rows]]),
        "of_x": np.vstack([made.get("of_x", np.eye(n)), np.eye(n)[rows]]),
    }


class Observer(ABC, Settings):
    """Base of all observers. The equations follow from the nominal plant and the measurement."""

    measured: Any
    filters: ClassVar[bool] = True
    """Whether x_hat contains filtered values of measured states instead of the measured values."""

    @abstractmethod
    def require(self, A: Array, C: Array) -> None:
        """Raise InputError if there is no such observer for the plant x' = A x with y = C x."""

    @abstractmethod
    def continuous(self, plant: FixedObserver) -> dict[str, Any]:
        """Return the matrices of ``ObserverEquations`` in continuous time."""

    @abstractmethod
    def sampled(self, plant: FixedObserver, T: float) -> dict[str, Any]:
        """Return the matrices of ``ObserverEquations`` in sampled form."""


def measured_rows(given: Any, names: Sequence[str]) -> Array:
    """Return C (p, n) from labels of states or from a matrix. Raises InputError for unknown labels or a wrong number of
    columns."""
    field, n = f"{FIELD}.measured", len(names)
    if given is None:
        raise InputError.of(field, "is missing: give plant.C, or the labels of the states that are measured")
    if not isinstance(given, (list, tuple, np.ndarray)) or len(given) == 0:
        raise InputError.of(
            field, f"must be labels of states or a matrix of {validate.counted(n, 'column')}, got {validate.show(given)}"
        )
    if all(isinstance(one, str) for one in given):
        for one in given:
            if one not in names:
                there = f"the states are {', '.join(names)}{validate.hint(one, names)}"
                raise InputError.of(field, f"names no state, got {validate.show(one)}; {there}")
        rows = [[float(name == one) for name in names] for one in given]
    else:
        rows = given  # type: ignore[assignment]
    if validate.dimensions(rows) == 2 and len(rows[0]) != n:
        raise InputError.of(field, f"must have {validate.counted(n, 'column')}, one for each state, got {len(rows[0])}")
    C = validate.array(field, rows, (None, n))
    if np.linalg.matrix_rank(C) < len(C):
        raise InputError.of(field, f"must have independent rows, got {validate.show(given)}")
    return C


def _covariance(name: str, given: Any, size: int, what: str) -> Array:
    """Return a covariance matrix from one number for all entries of its diagonal, from its diagonal, or from a symmetric
    matrix."""
    field = f"{FIELD}.{name}"
    if validate.dimensions(given) == 2:
        matrix = validate.square_matrix(field, given, size)
        if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0):
            raise InputError.of(field, f"must be symmetric, got {validate.show(given)}")
        return matrix
    if validate.dimensions(given) == 0:
        return np.eye(size) * validate.number(field, given)
    if len(given) != size:
        raise InputError.of(field, f"must have {validate.counted(size, 'entry')}, one for each {what}, got {len(given)}")
    return np.diag(validate.vector(field, given, size))


def _full_order(plant: FixedObserver, L: Array) -> dict[str, Any]:
    """Return the matrices of x_hat' = A x_hat + b v + L (y - C x_hat)."""
    return {"F": plant.A - L @ plant.C, "G": L, "B": plant.b.reshape(len(plant.A), -1)}


def _current(plant: FixedObserver, M: Array, T: float) -> dict[str, Any]:
    """Return the matrices of x_bar = Phi x_hat + Gamma v, corrected by M (y - C x_bar). z consists of x_hat and of each v that
    has not arrived yet."""
    n, p = len(plant.A), plant.outputs
    Phi, Gamma = _predicted(plant, T)
    kept = len(Phi) - n
    left = np.eye(n + kept)
    left[:n, :n] -= M @ plant.C
    made = {"F": left @ Phi, "G": np.vstack([M, np.zeros((kept, p))]), "B": left @ Gamma, "Phi": Phi, "Gamma": Gamma}
    x_hat = np.eye(n, n + kept)
    return made | ({"H": x_hat, "of_x": x_hat.T} if kept else {})


MOST_ON_THEIR_WAY = 1000
"""Largest delay in samples. The observer stores one control value for each sample of delay."""


def _predicted(plant: FixedObserver, T: float) -> tuple[Array, Array]:
    """Return Phi and Gamma, with which z = (x, v[k-2], ..., v[k-1-L]) is Phi z + Gamma v[k-1] one sample later.

    With a delay (q + f) T, 0 <= f < 1, the plant's input is v[k-2-q] for f T and v[k-1-q] for the rest of a sample.
    """
    n = len(plant.A)
    b = plant.b.reshape(n, -1)
    m, whole = b.shape[1], plant.delay / T
    q = int(whole + 1e-9)
    f = max(whole - q, 0.0) if whole - q > 1e-9 * max(whole, 1.0) else 0.0
    if q >= MOST_ON_THEIR_WAY:
        most = f"below {MOST_ON_THEIR_WAY} sample times of {T:g} s with an observer, which keeps a control for each of them"
        raise InputError.of("plant.input.delay", f"must be {most}, got {plant.delay:g} s")
    late = HeldSystem.of(plant.A, b, (1 - f) * T)
    kept = q + (f > 0)
    z, v = np.zeros((n + kept * m, n + kept * m)), np.zeros((n + kept * m, m))

    def acts(j: int, Gamma: Array) -> None:
        """Record that v[k-1-j] moves the state by Gamma."""
        (v if j == 0 else z[:, n + (j - 1) * m : n + j * m])[:n] += Gamma

    z[:n, :n] = HeldSystem.of(plant.A, b, T).Phi
    acts(q, late.Gamma)
    if f:
        acts(q + 1, late.Phi @ HeldSystem.of(plant.A, b, f * T).Gamma)
    z[n + m :, n : n + (kept - 1) * m] = np.eye(max(kept - 1, 0) * m)
    v[n : n + m] = np.eye(m)[: len(v) - n]
    return z, v


@dataclass(frozen=True, eq=False)
class LuenbergerObserver(Observer):
    """x_hat' = A x_hat + b u + L (y - C x_hat), where L places the poles of A - L C.

    poles     one for each state of the plant, in Re s < 0 [1/s]; a complex pole is given once, as [real, imaginary]. In the
              observer of a sampled controller the poles are at exp(pole T)
    measured  y = C x: the labels of the states that are measured, or C, (p, n), which a case file may give as `plant.C`
    """

    poles: tuple[float | Vector, ...]
    _: KW_ONLY
    measured: tuple[str, ...] | Matrix | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.poles, (list, tuple, np.ndarray)):
            raise InputError.of(f"{FIELD}.poles", f"must be a list of poles, got {validate.show(self.poles)}")
        freeze(self, poles=tuple(self.poles))

    def _wanted(self, n: int) -> list[complex]:
        return wanted_poles(self.poles, n, f"{FIELD}.poles")

    def require(self, A: Array, C: Array) -> None:
        self._wanted(len(A))
        mode = unobservable_mode(A, C)
        if mode is not None:
            raise InputError.of(
                f"{FIELD}.measured",
                f"must make the plant observable, but the mode at {_mode(mode)} is not visible in C = {_rows(C)}",
            )

    def continuous(self, plant: FixedObserver) -> dict[str, Any]:
        return _full_order(plant, observer_gain(plant.A, plant.C, self._wanted(len(plant.A)), f"{FIELD}.poles"))

    def sampled(self, plant: FixedObserver, T: float) -> dict[str, Any]:
        held = HeldSystem.of(plant.A, plant.b, T)
        wanted = [complex(np.exp(pole * T)) for pole in self._wanted(len(plant.A))]
        if unobservable_mode(held.Phi, plant.C) is not None:
            raise InputError.of(
                FIELD,
                f"cannot see a mode that is visible only between the samples: with samples every {T:g} s it is not observable",
            )
        # (I - M C) Phi = Phi - M (C Phi)
        return _current(plant, observer_gain(held.Phi, plant.C @ held.Phi, wanted, f"{FIELD}.poles"), T)


@dataclass(frozen=True, eq=False)
class KalmanObserver(Observer):
    """The steady-state Kalman filter of x' = A x + b u + w, y = C x + v, for white noises w and v with intensities Q and R.

    Q         intensity of w [state^2/s]: one number for all states, (n,), or a symmetric matrix (n, n)
    R         intensity of v [unit^2 s]: one number, (p,), or a matrix (p, p). A sensor with standard deviation sigma and a new
              value every T_n s has R = sigma^2 T_n. The filter of a sampled controller uses R/T and the integral of Q over T
    measured  y = C x: the labels of the states that are measured, or C, (p, n), which a case file may give as `plant.C`
    """

    Q: float | Array
    R: float | Array
    _: KW_ONLY
    measured: tuple[str, ...] | Matrix | None = None

    def require(self, A: Array, C: Array) -> None:
        Q, R = self._covariances(len(A), len(C))
        if np.linalg.eigvalsh(Q).min() < -1e-12 * np.abs(Q).max(initial=1.0):
            raise InputError.of(f"{FIELD}.Q", f"must be positive semi-definite, got {validate.show(self.Q)}")
        if not np.linalg.eigvalsh(R).min() > 0:
            raise InputError.of(f"{FIELD}.R", f"must be positive definite, got {validate.show(self.R)}")
        mode = unobservable_mode(A, C, stable_too=False)
        if mode is not None:
            raise InputError.of(
                f"{FIELD}.measured",
                f"must make unstable modes observable, but the mode at {_mode(mode)} is not visible in C = {_rows(C)}",
            )

    def _covariances(self, n: int, p: int) -> tuple[Array, Array]:
        return _covariance("Q", self.Q, n, "state"), _covariance("R", self.R, p, "measured quantity")

    def continuous(self, plant: FixedObserver) -> dict[str, Any]:
        Q, R = self._covariances(len(plant.A), plant.outputs)
        try:
            P = riccati.continuous(plant.A.T, plant.C.T, Q, R)
        except np.linalg.LinAlgError:
            raise _no_filter(plant, Q) from None
        return _full_order(plant, np.linalg.solve(R, plant.C @ P).T)

    def sampled(self, plant: FixedObserver, T: float) -> dict[str, Any]:
        Q, R = self._covariances(len(plant.A), plant.outputs)
        held = HeldSystem.of(plant.A, plant.b, T)
        Q_d, R_d = _over_a_sample(plant.A, Q, T), R / T
        try:
            P = riccati.discrete(held.Phi.T, plant.C.T, Q_d, R_d)  # of x_bar
        except np.linalg.LinAlgError:
            raise _no_filter(plant, Q) from None
        return _current(plant, np.linalg.solve(plant.C @ P @ plant.C.T + R_d, plant.C @ P).T, T)


def _no_filter(plant: FixedObserver, Q: Array) -> InputError:
    """Return why the Riccati equation was not solved: a mode that Q does not drive, or rounding."""
    mode = unobservable_mode(plant.A.T, Q, stable_too=False)  # (Q, A') is observable if (A, Q) is controllable
    if mode is not None:
        return InputError.of(
            f"{FIELD}.Q",
            f"does not give a steady-state filter: it does not drive the mode at {_mode(mode)}, which does not decay by itself",
        )
    return InputError.of(
        FIELD,
        "has a Riccati equation that is too badly conditioned to be solved: Q and R make the filter extremely slow or fast "
        "compared with the plant; bring them closer together",
    )


def _over_a_sample(A: Array, Q: Array, T: float) -> Array:
    """Return the covariance that w adds in a sample, by one exponential (Van Loan 1978, IEEE TAC 23(3))."""
    from scipy.linalg import expm

    n = len(A)
    whole = expm(T * np.block([[-A, Q], [np.zeros((n, n)), A.T]]))
    found = whole[n:, n:].T @ whole[:n, n:]
    return np.asarray((found + found.T) / 2)


@dataclass(frozen=True, eq=False)
class DerivativeObserver(Observer):
    """Filtered derivatives of the measurements. The filter cutoff s/(s + cutoff) estimates a state that is the derivative of a
    measured state.

    The measured quantities are single states, as with encoders, and the others must be their rates in the nominal plant,
    x_i' = x_j. The sampled form is Tustin's.

    cutoff    > 0, of the filter [rad/s]
    measured  labels of the states that are measured, or C, (p, n), whose rows have one nonzero entry each, a 1; a case file may
              give `plant.C`
    """

    cutoff: float
    _: KW_ONLY
    measured: tuple[str, ...] | Matrix | None = None
    filters: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze(self, cutoff=validate.positive(f"{FIELD}.cutoff", self.cutoff))

    def require(self, A: Array, C: Array) -> None:
        self._sources(A, C)

    def _sources(self, A: Array, C: Array) -> list[tuple[int, int, bool]]:
        """Return for each state the index of the measured quantity that determines it, and whether by its derivative."""
        if not (np.count_nonzero(C, axis=1) == 1).all() or not (C.max(axis=1) == 1).all():
            raise InputError.of(f"{FIELD}.measured", f"must have a single 1 in each row for derivatives, got {_rows(C)}")
        places, found = np.argmax(C, axis=1), []
        for j, unit in enumerate(np.eye(len(A))):
            direct = np.flatnonzero(places == j)
            rates = [k for k, i in enumerate(places) if (A[i] == unit).all()]
            if not len(direct) and not rates:
                raise InputError.of(
                    FIELD,
                    f"kind derivative does not give state {j + 1}, which is neither measured nor the rate of a measured state; "
                    f"luenberger or kalman estimates it",
                )
            found.append((j, int(direct[0]), False) if len(direct) else (j, rates[0], True))
        if not any(rate for _, _, rate in found):
            raise InputError.of(FIELD, "kind derivative has nothing to differentiate, because all states are measured")
        return found

    def _picked(self, plant: FixedObserver) -> tuple[Array, Array, Array]:
        """Return the rows (d, p) of the differentiated measurements, and H and D of x_hat = H r + D y with the derivatives r
        (d,)."""
        n, p = len(plant.A), plant.outputs
        sources = self._sources(plant.A, plant.C)
        differentiated = list(dict.fromkeys(k for _, k, rate in sources if rate))
        H, D = np.zeros((n, len(differentiated))), np.zeros((n, p))
        for j, k, rate in sources:
            if rate:
                H[j, differentiated.index(k)] = 1.0
            else:
                D[j, k] = 1.0
        return np.eye(p)[differentiated], H, D

    def continuous(self, plant: FixedObserver) -> dict[str, Any]:
        """Return the matrices of z' = cutoff (y - z), whose right side is the derivative."""
        picked, H, D = self._picked(plant)
        d, c = len(picked), self.cutoff
        made = {"F": -c * np.eye(d), "G": c * picked, "B": _undriven(plant, d)}
        return made | {"H": -c * H, "D": D + c * H @ picked, "of_x": picked @ plant.C}

    def sampled(self, plant: FixedObserver, T: float) -> dict[str, Any]:
        """Return the matrices for z = (y, w) with the filter's state w. At a lost sample both continue at the rate
        r = cutoff (y - w)."""
        picked, H, D = self._picked(plant)
        d, p, half = len(picked), plant.outputs, self.cutoff * T / 2
        keeps, gets = (1 - half) / (1 + half), half / (1 + half)
        rates = self.cutoff * np.hstack([picked, -np.eye(d)])
        F = np.block([[np.zeros((p, p + d))], [gets * picked, keeps * np.eye(d)]])
        made = {"F": F, "G": np.vstack([np.eye(p), gets * picked]), "B": _undriven(plant, p + d)}
        made |= {"Phi": np.eye(p + d) + T * np.vstack([picked.T, np.eye(d)]) @ rates, "Gamma": _undriven(plant, p + d)}
        return made | {"H": np.hstack([D, np.zeros((len(D), d))]) + H @ rates, "of_x": np.vstack([plant.C, picked @ plant.C])}


def _undriven(plant: FixedObserver, states: int) -> Array:
    return np.zeros((states, 1 if plant.b.ndim == 1 else plant.b.shape[1]))


def _mode(mode: complex) -> str:
    return f"{mode.real:.6g}" if mode.imag == 0 else f"{mode:.6g}"


def _rows(C: Array) -> str:
    return validate.show(C.tolist())


OBSERVERS: Mapping[str, type[Observer]] = {
    "luenberger": LuenbergerObserver,
    "kalman": KalmanObserver,
    "derivative": DerivativeObserver,
}
"""The package's observers by their names in case files."""
