"""Linear time-invariant SISO systems: transfer functions, their realisation, frequency responses and filters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.linear.conditions import balance
from barbalat.protocols import Value
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, Vector


def is_scipy(system: Any) -> bool:
    """Whether it is a continuous system of SciPy; discrete ones are not accepted."""
    if not type(system).__module__.startswith("scipy."):
        return False
    from scipy.signal import lti

    return isinstance(system, lti)


def foreign_state_space(system: Any) -> tuple[Array, Array, Array, Array] | None:
    """A, B, C, D of a continuous state space of a different package; ``None`` for anything else."""
    if not all(hasattr(system, name) for name in ("A", "B", "C", "D")) or getattr(system, "dt", None) not in (0, None):
        return None
    A, B, C, D = (np.asarray(getattr(system, name), dtype=float) for name in "ABCD")
    return A, B, C, D


def foreign_coefficients(field: str, system: Any) -> tuple[Array, Array]:
    """num and den of a continuous SISO system, highest power first; InputError names the field."""
    if is_scipy(system):
        found = system.to_tf()
        num, den = np.squeeze(found.num), found.den
        if np.ndim(num) > 1:
            raise InputError.of(field, f"must have one input and one output, got {validate.show(system)}")
        return np.atleast_1d(num), den
    if not all(hasattr(system, name) for name in ("ninputs", "noutputs", "dt")):
        raise InputError.of(
            field,
            "must be a TransferFunction, (num, den), matrices (A, B, C, D), or a system of python-control or SciPy, "
            f"got {validate.show(system)}",
        )
    import control

    if (system.ninputs, system.noutputs) != (1, 1):
        raise InputError.of(field, f"must have one input and one output, got {system.ninputs} and {system.noutputs}")
    if system.dt not in (0, None):
        raise InputError.of(field, f"must be a continuous-time system, got one with the sample time {system.dt}")
    if not isinstance(system, (control.TransferFunction, control.StateSpace)):
        raise InputError.of(field, f"must be a transfer function or state space, got {type(system).__name__}")
    converted = control.tf(system)
    return np.asarray(converted.num[0][0], float), np.asarray(converted.den[0][0], float)


@dataclass(frozen=True, eq=False)
class StateSpace(Settings):
    """x' = A x + B u, y = C x + D u with one input and one output; A (n, n), B (n,), C (n,), D scalar, n may be 0.

    Two systems are equal, and have the same hash, if all their numbers are.
    """

    A: Array
    B: Array
    C: Array
    D: float

    __repr__ = one_line

    def __post_init__(self) -> None:
        if any(isinstance(given, (list, tuple)) for given in (self.A, self.B, self.C)):
            validate.freeze(self, **vars(self._of_matrices("system", self.A, self.B, self.C, self.D)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StateSpace) and self._numbers() == other._numbers()

    def __hash__(self) -> int:
        return hash(self._numbers())

    def _numbers(self) -> tuple[bytes, ...]:
        return tuple(np.asarray(value, dtype=float).tobytes() for value in (self.A, self.B, self.C, self.D))

    @classmethod
    def gain(cls, D: float) -> StateSpace:
        """A static gain."""
        return cls(np.zeros((0, 0)), np.zeros(0), np.zeros(0), D)

    def transfer_function(self) -> TransferFunction:
        """C (sI - A)^-1 B + D."""
        strictly_proper = transfer_function(self.C, self.A, self.B)
        return TransferFunction(np.polyadd(strictly_proper.num, self.D * strictly_proper.den), strictly_proper.den)

    @classmethod
    def _of_matrices(cls, field: str, A: Any, B: Any, C: Any, D: Any) -> StateSpace:
        """From A (n, n), B (n,) or (n, 1), C (n,) or (1, n) and D, a number or (1, 1)."""
        matrix = validate.square_matrix(f"{field}.A", A)
        b, c = (validate.by_rows(f"{field}.{name}", given, len(matrix)) for name, given in (("B", B), ("C", C)))
        (d,) = validate.by_rows(f"{field}.D", np.reshape(D, -1) if validate.dimensions(D) == 0 else D, 1)
        return cls(matrix, b, c, float(d))

    def derivative(self, state: Value, u: Value) -> Value:
        """The derivative x'; a state (n, m) with u (m,) stands for m copies of the system."""
        return self.A @ state + (self.B * u if state.ndim == 1 else np.outer(self.B, u))

    def output(self, state: Value, u: Value) -> Value:
        return self.C @ state + self.D * u

    def response(self, w: Array) -> Array:
        """C (j w I - A)^-1 B + D at frequencies (K,) in rad/s."""
        # a sum instead of a matrix product, because BLAS would use threads, which wait for each other on a busy machine
        return np.asarray((states_response(self.A, self.B, w) * self.C).sum(axis=1) + self.D)

    @property
    def order(self) -> int:
        return len(self.B)

    @classmethod
    def accept(cls, field: str, system: Any) -> StateSpace:
        """A proper system from one of the package's systems, matrices (A, B, C, D), or anything that ``TransferFunction.accept``
        accepts; InputError names the field.

        A foreign state space is used directly: conversion to polynomials would lose digits if it has both slow and fast poles.
        """
        if isinstance(system, cls):
            return system
        if isinstance(system, (tuple, list)) and len(system) == 4:
            return cls._of_matrices(field, *system)
        matrices = foreign_state_space(system)
        if matrices is not None and matrices[3].shape == (1, 1):
            A, B, C, D = matrices
            return cls(A, B[:, 0], C[0], float(D[0, 0]))
        found = TransferFunction.accept(field, system)
        if found.relative_degree < 0:
            raise InputError.of(
                field, f"must be proper, got num = {validate.show(found.num)} over den = {validate.show(found.den)}"
            )
        return found.realise()


@dataclass(frozen=True, eq=False)
class TransferFunction(Settings):
    """num(s)/den(s); leading zeros are dropped, den is made monic.

    num, den  coefficients, highest power first
    """

    num: Vector
    den: Vector

    __repr__ = one_line

    def __post_init__(self) -> None:
        num, den = (np.trim_zeros(validate.vector(name, getattr(self, name)), "f") for name in ("num", "den"))
        for name, polynomial in (("num", num), ("den", den)):
            budget.require(
                name,
                len(polynomial),
                of_polynomial,
                given=f"has {len(polynomial)} coefficients and",
                what=f"a polynomial of {len(polynomial)} coefficients",
            )
        if len(den) == 0:
            raise InputError(f"den must not be zero, got {validate.show(self.den)}")
        num = num if len(num) else np.zeros(1)
        with np.errstate(over="ignore"):  # rejected below, where the message quotes the coefficients
            object.__setattr__(self, "num", num / den[0])
            object.__setattr__(self, "den", den / den[0])
        if not (np.isfinite(self.num).all() and np.isfinite(self.den).all()):
            raise InputError(f"num/den must stay finite when den is made monic, got den = {validate.show(den)}")

    @classmethod
    def accept(cls, field: str, system: Any) -> TransferFunction:
        """A transfer function from one of the package's systems, (num, den), matrices (A, B, C, D), or a continuous SISO system
        of python-control or SciPy.

        InputError names the field.
        """
        if isinstance(system, cls):
            return system
        if isinstance(system, (tuple, list)) and len(system) == 2:
            num, den = (validate.vector(f"{field}.{name}", given) for name, given in zip(("num", "den"), system, strict=True))
            return cls(num, den)
        if isinstance(system, (tuple, list)) and len(system) == 4:
            system = StateSpace.accept(field, system)
        if isinstance(system, StateSpace):
            return system.transfer_function()
        matrices = foreign_state_space(system) if is_scipy(system) else None
        if matrices is not None and matrices[3].shape == (1, 1):
            A, B, C, D = matrices
            return StateSpace(A, B[:, 0], C[0], float(D[0, 0])).transfer_function()
        return cls(*foreign_coefficients(field, system))

    def __mul__(self, other: TransferFunction) -> TransferFunction:
        return TransferFunction(np.polymul(self.num, other.num), np.polymul(self.den, other.den))

    def at(self, s: Array) -> Array:
        """The value at complex numbers s."""
        return np.polyval(self.num, s) / np.polyval(self.den, s)

    @property
    def poles(self) -> Array:
        return np.roots(self.den)

    @property
    def zeros(self) -> Array:
        return np.roots(self.num)

    @property
    def relative_degree(self) -> int:
        return len(self.den) - len(self.num)

    @property
    def dc_gain(self) -> float:
        return float(self.num[-1] / self.den[-1]) if self.den[-1] != 0 else float("inf")

    @property
    def is_stable(self) -> bool:
        return bool((self.poles.real < 0).all())

    @cached_property
    def is_minimum_phase(self) -> bool:
        """Whether every zero is in the open left half plane, beyond rounding; with a zero on the axis there is no stable
        inverse."""
        if len(self.num) == 1:
            return True
        size = max(float(np.abs(self.poles).max(initial=0)), float(np.abs(self.zeros).max()))
        return bool(self.zeros.real.max() < -100 * len(self.den) * np.finfo(float).eps * size)

    def realise(self) -> StateSpace:
        """Controllable canonical form, states scaled by powers of two so that no rounding is added."""
        return self._realisation

    @cached_property
    def _realisation(self) -> StateSpace:
        order = len(self.den) - 1
        if self.relative_degree < 0:
            raise InputError(f"only a proper system has a realisation, got num {self.num} over den {self.den}")
        num = np.concatenate([np.zeros(order + 1 - len(self.num)), self.num])
        D = float(num[0])
        if order == 0:
            return StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros(0), D)
        with np.errstate(over="ignore", invalid="ignore"):  # values beyond the range of floats are rejected below
            A, scale = balance(np.vstack([-self.den[1:], np.eye(order)[:-1]]))
            B, C = np.eye(order)[0] / scale, (num[1:] - D * self.den[1:]) * scale
        if not all(np.isfinite(part).all() for part in (A, B, C, D)):
            raise InputError(f"the system's coefficients are too far apart to be realised: num {self.num}, den {self.den}")
        return StateSpace(A, B, C, D)


def of_polynomial(count: float) -> Estimate:
    """The cost of a polynomial with this number of coefficients: its roots, 1.1 s for 1,000, and the matrix of its
    realisation."""
    return Estimate(memory=40.0 * count**2, seconds=1e-9 * count**3)


def open_loop(field: str, system: Any) -> tuple[Array, Array]:
    """(A, B) of x' = A x + B u; InputError names the field."""
    if isinstance(system, (tuple, list)) and len(system) in (2, 4):  # C and D are not used
        return system[0], system[1]
    found = (system.A, system.B, system.C, system.D) if isinstance(system, StateSpace) else foreign_state_space(system)
    if found is None:
        wanted = "a continuous state-space model with a measured state, or a pair (A, B)"
        remedy = "if only an output is measured, use OutputPlant(transfer_function=...)"
        raise InputError.of(field, f"must be {wanted}; {remedy}; got {validate.show(system)}")
    return found[0], found[1]


POLE_OFFSET_SHARE = 1e-13
"""Relative distance by which a frequency is moved off a pole that it hits exactly: a few hundred rounding errors."""


SOLVED_AT_ONCE = 2**22
"""Entries of all matrices that are solved together, 64 MB."""


def of_response(states: float, frequencies: int) -> Estimate:
    """The cost of frequency responses, with one linear system solved at each frequency: 3.6 s in total for the 165 states of a
    network's loop."""
    return Estimate(memory=64.0 * max(states**2, SOLVED_AT_ONCE), seconds=2e-9 * frequencies * states**3)


def states_response(A: Array, b: Array, w: Array) -> Array:
    """(j w I - A)^-1 b at frequencies (K,) in rad/s, (K, n).

    Raises InputError if this number of states and frequencies exceeds the budget.
    """
    w, n = np.atleast_1d(np.asarray(w, dtype=float)), len(b)
    budget.require(
        "the linear loop",
        n,
        lambda states: of_response(states, len(w)),
        given=f"has {validate.counted(n, 'state')}, and {len(w)} frequency responses",
        fits=lambda states: f"at most {validate.counted(states, 'state')}",
        what=f"{len(w)} frequency responses of {validate.counted(n, 'state')}",
    )
    column, unit, together = b[:, None], np.eye(n), max(SOLVED_AT_ONCE // max(n * n, 1), 1)

    def solved(at: Array) -> Array:
        if len(at) <= together:
            return np.asarray(np.linalg.solve(1j * at[:, None, None] * unit - A, column)[..., 0])
        return np.concatenate([solved(at[first : first + together]) for first in range(0, len(at), together)])

    try:
        return solved(w)
    except np.linalg.LinAlgError:  # the frequency is a pole; at a neighbouring frequency the response is as large as floats allow
        return solved(w * (1 + POLE_OFFSET_SHARE) + POLE_OFFSET_SHARE * float(np.abs(A).max(initial=0.0)))


LARGEST_ORDER = 100
"""Largest order of the input filter: from about 103 on, rounding moves roots of (kappa s + 1)^order into the right half plane."""


def input_filter(kappa: float, order: int = 1) -> TransferFunction:
    """C(s) = 1/(kappa s + 1)^order, eq. (6); kappa > 0 in s."""
    kappa = validate.positive("filter.kappa", kappa)
    order = validate.whole("filter.order", order, least=1, most=LARGEST_ORDER)
    den = np.ones(1)
    for _ in range(order):
        den = np.convolve(den, [kappa, 1.0])
    return TransferFunction(np.array([1.0]), den)


def two_slopes(kappa: float, ratio: float = 1.0) -> TransferFunction:
    """C(s) with 1 - C = kappa s/(kappa s + 1) kappa_2 s/(kappa_2 s + 1), kappa_2 = ratio kappa; both positive, kappa in s.

    With a ratio so large that 1/kappa_2 is slower than everything else, it equals (6).
    """
    kappa, ratio = validate.positive("kappa", kappa), validate.positive("ratio", ratio)
    first, second = kappa, ratio * kappa
    return TransferFunction(np.array([first + second, 1.0]), np.array([first * second, first + second, 1.0]))


def transfer_function(c: Array, A: Array, b: Array) -> TransferFunction:
    """c'(sI - A)^-1 b, by the Faddeev-LeVerrier recursion (Gantmacher, The Theory of Matrices, ch. IV).

    Leading coefficients of the numerator that are zero up to rounding are dropped, because they determine the relative degree.
    """
    n = len(b)
    A, scale = balance(A)
    size = float(np.abs(c).max(initial=0.0)) or 1.0  # squares of very large entries would exceed the range of floats
    b, c = b / scale, c / size * scale
    den, num = [1.0], []
    adjugate = np.eye(n)  # coefficient of s^(n-1-k) in adj(sI - A)
    for k in range(n):
        num.append(float(c @ adjugate @ b))
        product = A @ adjugate
        den.append(-float(np.trace(product)) / (k + 1))
        adjugate = product + den[-1] * np.eye(n)
    # Markov parameters c'A^k b are bounded by |c| |A|^k |b|; values below n rounding errors of this bound are treated as zero
    bound = np.linalg.norm(c) * np.linalg.norm(b) * np.linalg.norm(A, 2) ** np.arange(n)
    leading = 0
    while leading < n and abs(num[leading]) <= 10 * n * np.finfo(float).eps * bound[leading]:
        leading += 1
    return TransferFunction(np.array(num[leading:] or [0.0]) * size, np.array(den))


def strictly_proper(name: str, given: Any) -> TransferFunction:
    """A transfer function that is zero at infinite frequency and not zero everywhere; InputError names the field."""
    system = TransferFunction.accept(name, given)
    if system.relative_degree < 1 or not system.num.any():
        shown = f"num = {validate.show(system.num)}, den = {validate.show(system.den)}"
        raise InputError.of(name, f"must be strictly proper and not zero, got {shown}")
    return system


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """The series connection second(s) first(s)."""
    n, m = first.order, second.order
    A = np.block([[first.A, np.zeros((n, m))], [np.outer(second.B, first.C), second.A]])
    B = np.concatenate([first.B, second.B * first.D])
    C = np.concatenate([second.D * first.C, second.C])
    return StateSpace(A, B, C, second.D * first.D)


def sensitivity(loop: StateSpace) -> StateSpace:
    """S = 1/(1 + L); raises InputError if 1 + L(infinity) = 0."""
    return_difference = 1 + loop.D
    if abs(return_difference) < 1e-12:
        raise InputError(f"the closed loop is not well posed: 1 + L(infinity) = {return_difference:.3g}")
    closed = loop.A - np.outer(loop.B, loop.C) / return_difference
    return StateSpace(closed, loop.B / return_difference, -loop.C / return_difference, 1 / return_difference)


def complementary_sensitivity(loop: StateSpace) -> StateSpace:
    """T = 1 - S = L/(1 + L)."""
    S = sensitivity(loop)
    return StateSpace(S.A, S.B, -S.C, 1 - S.D)
