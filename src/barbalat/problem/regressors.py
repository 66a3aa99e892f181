"""Regressors phi(x) of the matched uncertainty theta'phi(x): the state itself, monomials, Gaussian functions, and formulas."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from itertools import combinations_with_replacement
from typing import Protocol, runtime_checkable

import numpy as np

from barbalat import validate
from barbalat.problem.formulas import BEND_OF_ABS, Formula, FormulaNames, formula
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import InputError, Matrix


@runtime_checkable
class Regressor(Protocol):
    """phi(x), which the designer knows. It is written with NumPy functions, so that it can also be evaluated with symbols."""

    def size(self, n: int) -> int:
        """Return the number of components of phi for n states. Raises InputError if it does not fit them."""
        ...

    def __call__(self, x: Value) -> Value:
        """Return phi(x) (p,) from x (n,)."""
        ...


@dataclass(frozen=True)
class Linear:
    """phi(x) = x, as in the paper."""

    def size(self, n: int) -> int:
        return n

    def __call__(self, x: Value) -> Value:
        return x


@dataclass(frozen=True)
class Polynomial(Settings):
    """All monomials of the states of degree 1 ... ``degree``, after a 1 if ``constant``; ordered by degree, then lexically.

    degree    the highest degree, >= 1
    constant  whether the first component is 1
    """

    degree: int
    _: KW_ONLY
    constant: bool = False

    def __post_init__(self) -> None:
        validate.freeze(self, degree=validate.whole("plant.regressor.degree", self.degree, least=1))

    def powers(self, n: int) -> list[tuple[int, ...]]:
        """Return the states that are multiplied in each component."""
        degrees = range(0 if self.constant else 1, self.degree + 1)
        return [factors for degree in degrees for factors in combinations_with_replacement(range(n), degree)]

    def size(self, n: int) -> int:
        """Return the number of components. They are counted without being listed, because a typing error in ``degree`` would
        otherwise fill the memory before it is rejected."""
        return math.comb(n + self.degree, n) - (0 if self.constant else 1)

    def __call__(self, x: Value) -> Value:
        terms = []
        for factors in self.powers(x.shape[0]):
            term = 0 * x[0] + 1
            for i in factors:
                term = term * x[i]
            terms.append(term.reshape(1))
        return np.concatenate(terms)


@dataclass(frozen=True, eq=False)
class GaussianRBF(Settings):
    """phi_i(x) = exp(-|x - c_i|^2/(2 width^2)).

    centers  (p, n), one row for each function
    width    > 0, in the states' units
    """

    centers: Matrix
    width: float

    def __post_init__(self) -> None:
        validate.freeze(
            self,
            centers=validate.array("plant.regressor.centers", self.centers, (None, None)),
            width=validate.positive("plant.regressor.width", self.width),
        )

    def size(self, n: int) -> int:
        if self.centers.shape[1] != n:
            raise InputError.of(
                "plant.regressor.centers",
                f"must have {validate.counted(n, 'column')}, one for each state, got {self.centers.shape[1]}",
            )
        return len(self.centers)

    def __call__(self, x: Value) -> Value:
        distance = x.reshape(1, x.shape[0]) - self.centers
        return np.exp(-np.sum(distance * distance, axis=1) / (2 * self.width * self.width))


STATES = FormulaNames(r"x[1-9][0-9]*", "x1, x2, ...")


@dataclass(frozen=True, eq=False)
class Terms(Settings):
    """Terms given as formulas in x1 ... xn with + - * / **, and abs, exp, sin, cos, sqrt, tanh.

    terms  the formulas, such as ["x1", "x2", "abs(x1)*x2"]

    Raises InputError if a formula contains anything else.
    """

    terms: tuple[str, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.terms, (list, tuple)) or not self.terms or not all(isinstance(term, str) for term in self.terms):  # type: ignore[redundant-expr]
            raise InputError.of(
                "plant.regressor.terms", f"must be a list of formulas such as 'abs(x1)*x2', got {validate.show(self.terms)}"
            )
        validate.freeze(self, terms=tuple(self.terms))
        self._formulas()  # raises InputError for anything that is not a formula

    def _formulas(self) -> list[Formula]:
        return [formula("plant.regressor.terms", term, STATES) for term in self.terms]

    @property
    def bend(self) -> str | None:
        """The place where a term has a corner."""
        return BEND_OF_ABS if any(found.bends for found in self._formulas()) else None

    def size(self, n: int) -> int:
        largest = max((int(name[1:]) for found in self._formulas() for name in found.names), default=0)
        if largest > n:
            raise InputError.of("plant.regressor.terms", f"use x{largest}, but the plant has {validate.counted(n, 'state')}")
        return len(self.terms)

    def __call__(self, x: Value) -> Value:
        given = {f"x{i + 1}": x[i] for i in range(x.shape[0])}
        return np.concatenate([(found.evaluate(given) + 0 * x[0]).reshape(1) for found in self._formulas()])


REGRESSORS = {
    "polynomial": Polynomial,
    "gaussian": GaussianRBF,
    "terms": Terms,
}
"""The regressors by their names in case files. The default is the state itself."""


@dataclass(frozen=True, eq=False)
class MatchedTerm:
    """How theta enters the input channels: u_j + theta_j'phi(x), with theta = (theta_1, ..., theta_m) stored row by row of (p,
    m).

    With one input Phi(x) is the vector phi(x) (p,), as in the paper. With m inputs it is (p m, m), so Phi'theta is (m,). If the
    input gain omega is unknown too, it is estimated together with theta, and u enters in the same way as Phi.
    """

    regressor: Regressor
    inputs: int
    gain_unknown: bool = False

    def phi(self, x: Value) -> Value:
        """Return the regressor Phi(x), with a block for each of several inputs."""
        phi = self.regressor(x)
        if self.inputs == 1:
            return phi
        m = self.inputs
        return np.outer(phi, np.eye(m).reshape(-1)).reshape(phi.shape[0] * m, m)

    def with_input(self, x: Value, u: Value) -> Value:
        """Return the factor of all estimates, which is Phi(x), followed by u if its gain is unknown."""
        if not self.gain_unknown:
            return self.phi(x)
        return np.concatenate([self.phi(x), u.reshape(1) if self.inputs == 1 else np.eye(self.inputs) * u])

    def known_input(self, u: Value) -> Value:
        """Return the part of u that enters the predictor without an estimate."""
        return 0 * u if self.gain_unknown else u

    def split(self, theta_hat: Value) -> tuple[Value, Value]:
        """Return the estimates of theta and of omega, which is 1 if it is known."""
        if not self.gain_unknown:
            return theta_hat, 1.0
        return theta_hat[: -self.inputs], theta_hat[-1] if self.inputs == 1 else theta_hat[-self.inputs :]
