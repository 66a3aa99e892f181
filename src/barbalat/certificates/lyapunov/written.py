"""The proof for an author's Lyapunov function as the numbers of a proof file; docs/proofs.md has the rule of the checker."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from flint import fmpq_mat, fmpq_mpoly

from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.lyapunov.entries import of_lines
from barbalat.certificates.lyapunov.rational import Rational, Ring
from barbalat.certificates.lyapunov.squares import Squares
from barbalat.certificates.lyapunov.theorem import Cell, Nonnegative, Share, Shown, declared_zero, is_positive
from barbalat.problem.regressors import Linear
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller

SCHEME = "own V"
Poly = dict[str, str]
"""A polynomial in a file: its coefficients by the monomials, such as "3/10" by "e_1 x_2^2"."""


@dataclass(frozen=True)
class Written:
    """The facts of the law and of V, and the witnesses of the lines by key."""

    facts: dict[str, Any]
    witnesses: dict[str, dict[str, Any]]


def written(problem: Problem, controller: Controller) -> Written | NotApplicable:
    """The facts and witnesses of what the certificate claims of V; otherwise the reason why there are none."""
    found = of_lines(problem, controller)
    if isinstance(found, NotApplicable):
        return found
    if not found.reading.phi and not isinstance(problem.plant.regressor, Linear):
        return NotApplicable("no rule covers a V that falls for this phi(x), but is not shown to fall for every value of phi(x)")
    if not found.places or not found.reading.theta:
        return NotApplicable("no rule covers a V without estimates")
    return _File(found).written(problem)


class _File:
    """The names of the variables, and what is written with them."""

    def __init__(self, found: Shown) -> None:
        self.found, self.reading = found, found.reading
        self.ring: Ring = found.reading.ring
        self.names: list[str] = []
        for name in self.ring.names:
            given = name.replace(" ", "_").replace("^", "_")
            while given in self.names:
                given += "_"
            self.names.append(given)

    def named(self, places: Iterable[int]) -> list[str]:
        return [self.names[i] for i in places]

    def poly(self, poly: fmpq_mpoly) -> Poly:
        return {
            " ".join(f"{self.names[i]}^{k}" if k > 1 else self.names[i] for i, k in enumerate(powers) if k) or "1": str(factor)
            for powers, factor in poly.to_dict().items()
        }

    def fraction(self, one: Rational) -> dict[str, Poly]:
        below = {} if one.den.is_constant() else {"below": self.poly(one.den)}
        return {"above": self.poly(one.num)} | below

    def squares(self, squares: Squares) -> dict[str, Any]:
        basis = []
        for powers in squares.monomials:
            one = self.ring.context.constant(1)
            for i, power in enumerate(powers):
                one *= self._with_beside(squares, i) ** power if power else 1
            basis.append(self.poly(one))
        return {"basis": basis, "G": [list(map(str, row)) for row in squares.G]}

    def _with_beside(self, squares: Squares, i: int) -> fmpq_mpoly:
        gens = self.ring.context.gens()
        return sum((gens[j] * factor for j, factor in squares.beside.get(i, {}).items()), gens[i])

    def cells(self, cell: Cell) -> dict[str, Any]:
        if not cell.halves:
            return {"squares": list(map(self.squares, cell.squares))}
        return {"side": cell.side, "at": str(cell.at), "low": self.cells(cell.halves[0]), "high": self.cells(cell.halves[1])}

    def proof(self, proof: Nonnegative) -> dict[str, Any]:
        return self.squares(proof.found) if isinstance(proof.found, Squares) else {"cells": self.cells(proof.found)}

    def share(self, share: Share) -> dict[str, Any]:
        return {"share": str(share.share)} | self.proof(share.proof)

    def written(self, problem: Problem) -> Written | NotApplicable:
        """The facts and witnesses of the whole proof, or the reason why the checker has no rule for it."""
        reading, found = self.reading, self.found
        W = self.ring.exact(reading.declared.W)
        zero = declared_zero(reading)
        if not is_positive(self._denominator()) or not all(one.den.is_constant() for one in (W, *zero)):
            return NotApplicable("no rule covers its denominators")
        facts = {
            "scheme": SCHEME,
            "P": problem.known.P.tolist(),
            "law": {
                "state": dict(zip(self.named(reading.state), map(str, reading.start), strict=True)),
                "estimates": self._estimates(),
                "phi": self.named(reading.phi),
                "functions": self._functions(W),
                "normals": [
                    {"of": self.named(one.of), "n": self.named(one.places), "gain": _rows(one.gain)} for one in reading.normals
                ],
                "limited": self.named(sorted(reading.limited)),
                "control": [self.fraction(one) for one in reading.control],
                "rates": {self.names[i]: self.fraction(reading.rates[i]) for i in reading.state},
            },
            "V": {"of": self.named(found.places), "M": _rows(found.M), "L": _rows(found.L), "W": self.poly(W.num)},
            "zero": [self.poly(one.num) for one in zero],
            "nonnegative": [
                {"R": list(map(self.named, one.R)), "v": self.named(one.v), "F": list(map(self.named, one.F))}
                for one in found.steps.recorded
            ],
        }
        decay = {
            "W": self.proof(found.steps.W),
            "nonnegative": [self.squares(one.squares) for one in found.steps.recorded],
            "decay": None if found.steps.decay is None else self.share(found.steps.decay),
        }
        limit = {} if found.steps.limit is None else {"error_limit": self.share(found.steps.limit)}
        return Written(facts, {"lyapunov_decay": decay} | limit)

    def _functions(self, W: Rational) -> dict[str, list[str]]:
        """The variables on which each function depends that the law or W contains."""
        left = set().union(*(one.used for one in (*self.reading.rates.values(), *self.reading.control, W)))
        found: dict[str, list[str]] = {}
        while left:
            i = left.pop()
            if i in self.ring.functions and self.names[i] not in found:
                of = self.ring.functions[i][1].used
                found[self.names[i]] = self.named(sorted(of))
                left |= of
        return found

    def _denominator(self) -> fmpq_mpoly:
        """A common denominator of the law's rates and of u."""
        over = self.ring.context.constant(1)
        for one in (*self.reading.control, *(self.reading.rates[i] for i in self.reading.state)):
            over *= one.den // one.den.gcd(over)
        return over

    def _estimates(self) -> list[str]:
        first = self.reading.state.start
        parts = [part for part in self.reading.parts if part.role.kind == "estimates"]
        return self.named(first + i for part in parts for i in range(part.start, part.start + part.size))


def _rows(matrix: fmpq_mat) -> list[list[str]]:
    return [list(map(str, row)) for row in matrix.tolist()]
