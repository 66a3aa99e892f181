# /// script
# requires-python = ">=3.11"
# dependencies = ["python-flint>=0.7"]
# ///
"""``barbalat-check FILE``: verifies that every guaranteed number of a proof follows from the numbers of the case in the same
file.

This is a separate program that imports nothing from Barbalat. The numbers in the file are binary64 numbers or dyadic ones ("5p-3"
is 5 * 2**-3), and both are read exactly. Rational quantities are computed exactly; roots and integrals are enclosed in ball
arithmetic (python-flint, Arb). Each line of a proof is a number with a witness. Its rule is the theorem of the same name in
docs/proofs.md, which states the conditions that must hold. If a line fails, the program names the first such line and exits with
code 1. Exit code 0 means that all lines hold.
"""

from __future__ import annotations

import ast
import json
import os
import re
import sys
from collections.abc import Callable, Iterable
from functools import cache
from itertools import pairwise, product
from math import comb
from pathlib import Path
from typing import Any

from flint import Ordering, arb, arb_mat, ctx, fmpq, fmpq_mat, fmpq_mpoly, fmpq_mpoly_ctx

FORMAT = "barbalat proof 1"
DEGREE = 24
"""Degree of the Taylor polynomials for impulse responses."""
LEAST_BITS, MOST_BITS = 128, 8192
Rule = Callable[["Controller", Any, dict[str, Any]], None]
RULES: dict[str, Rule] = {}


class Refused(Exception):
    """Raised if a line does not hold or the file is not a proof."""


def require(holds: Any, why: str) -> None:
    if holds is not True:
        raise Refused(why)


def number(value: Any) -> fmpq:
    """The exact value of a binary64 number, an integer, a dyadic number such as "5p-3", or a fraction such as "3/10"."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise Refused(f"expected a number, got {value!r}")
    if isinstance(value, float):
        require(value - value == 0, f"expected a finite number, got {value}")
        return fmpq(*value.as_integer_ratio())
    if isinstance(value, int):
        return fmpq(value)
    found = re.fullmatch(r"(-?\d{1,4000})(?:p(-?\d{1,5})|/0*([1-9]\d{0,3999}))?", value)
    if found is None:
        raise Refused(f"a number is written as 5p-3 or as 3/10, got {value!r}")
    return fmpq(int(found[1]), int(found[3] or 1)) * fmpq(2) ** int(found[2] or 0)


def vector(value: Any, size: int | None = None) -> list[fmpq]:
    require(isinstance(value, list) and (size is None or len(value) == size), f"a list of {size} numbers is needed")
    return [number(one) for one in value]


def matrix(value: Any, rows: int | None = None, columns: int | None = None) -> fmpq_mat:
    """The exact matrix with these rows."""
    require(isinstance(value, list) and len(value) > 0, "a matrix is a list of rows")
    found = [vector(row, columns) for row in value]
    require(len({len(row) for row in found}) == 1 and rows in (None, len(found)), "the matrix has the wrong shape")
    return fmpq_mat(found)


def column(values: list[fmpq]) -> fmpq_mat:
    return fmpq_mat([[one] for one in values])


def identity(n: int) -> fmpq_mat:
    return fmpq_mat([[fmpq(int(i == j)) for j in range(n)] for i in range(n)])


def zeros(rows: int, columns: int) -> fmpq_mat:
    return fmpq_mat([[fmpq(0)] * columns for _ in range(rows)])


def blocks(parts: list[list[fmpq_mat]]) -> fmpq_mat:
    """A block matrix. Callers omit empty blocks."""
    rows: list[list[Any]] = []
    for line in parts:
        tables = [part.tolist() for part in line]
        rows += [[entry for table in tables for entry in table[i]] for i in range(len(tables[0]))]
    return fmpq_mat(rows)


def quadratic(x: fmpq_mat, M: fmpq_mat) -> fmpq:
    return (x.transpose() * M * x)[0, 0]


def positive_definite(M: fmpq_mat) -> bool:
    """Whether the matrix is symmetric and has positive pivots in exact elimination."""
    return M.transpose() == M and has_positive_pivots(M)


def has_positive_pivots(M: fmpq_mat | arb_mat) -> bool:
    rows: list[list[Any]] = M.tolist()
    for k in range(len(rows)):
        if not rows[k][k] > 0:
            return False
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True


def positive_semidefinite(M: fmpq_mat) -> bool:
    """Whether the matrix is symmetric, no pivot in exact elimination is negative, and the row of a zero pivot is zero."""
    rows: list[list[fmpq]] = M.tolist()
    for k in range(len(rows)):
        if rows[k][k] < 0 or (rows[k][k] == 0 and any(one != 0 for one in rows[k][k:])):
            return False
        for i in range(k + 1, len(rows)) if rows[k][k] > 0 else ():
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return bool(M.transpose() == M)


def root(value: fmpq | arb) -> arb:
    return arb(value).sqrt()


def at_least(claimed: Any, needed: fmpq | arb, what: str) -> None:
    """Require that the claimed number is provably at least as large as the needed number."""
    value = number(claimed)
    holds = value >= needed if isinstance(needed, fmpq) else bool(arb(value) >= needed)
    require(holds, f"{what} must be at least {text(needed)}, and {text(value)} is claimed")


def text(value: fmpq | arb) -> str:
    return arb(value).str(10, radius=False)


# --- L1 norms: docs/proofs.md, "The L1 norm" ------------------------------------------------------------------------------------


class Norms:
    """Enclosures of |D_ij| + integral |c_i e^(At) b_j| dt for every output i and input j of an exact system."""

    def __init__(self, A: fmpq_mat, B: fmpq_mat, C: fmpq_mat, D: fmpq_mat, witness: dict[str, Any]) -> None:
        self.C, self.D, bits = C, D, witness.get("bits", LEAST_BITS)
        require(isinstance(bits, int) and LEAST_BITS <= bits <= MOST_BITS, "bits must be a whole number of a working precision")
        n = A.nrows()
        P, self.rate = matrix(witness.get("P"), n, n), number(witness.get("rate"))
        require(self.rate > 0 and positive_definite(P), "P must be positive definite, and its rate positive")
        product = A.transpose() * P
        gap = -(product + product.transpose() + P * (2 * self.rate) + C.transpose() * C)
        require(positive_definite(gap), "A'P + PA + 2 rate P + C'C must be negative definite")
        steps = witness.get("steps")
        if not (isinstance(steps, list) and len(steps) == B.ncols()):
            raise Refused("steps must be one list per input")
        self._transitions = dict[fmpq, arb_mat]()
        with ctx.workprec(bits):
            self.A, self.P = arb_mat(A), arb_mat(P)
            found = [self._channel(B, j, vector(steps[j])) for j in range(B.ncols())]
        self.lower = [[ends[0] for ends in row] for row in zip(*found, strict=True)]
        self.upper = [[ends[1] for ends in row] for row in zip(*found, strict=True)]

    def _size(self, x: arb_mat) -> arb:
        """An upper bound on sqrt(x'Px)."""
        return arb(max((x.transpose() * self.P * x)[0, 0].upper(), arb(0))).sqrt().upper()

    def _transition(self, step: fmpq) -> arb_mat:
        """e^(A step), by repeated squaring, starting from a part of the step so short that |A| times its length is below 1."""
        if step not in self._transitions:
            halvings, size = 0, max(sum((abs(entry) for entry in row), arb(0)).upper() for row in self.A.tolist()) * arb(step)
            while not size * arb(2) ** -halvings < 1:
                halvings += 1
            found = (self.A * (arb(step) * arb(2) ** -halvings)).exp()
            for _ in range(halvings):
                found = found * found
            self._transitions[step] = found
        return self._transitions[step]

    def _channel(self, B: fmpq_mat, j: int, steps: list[fmpq]) -> list[tuple[arb, arb]]:
        """Integrate step by step from the state b_j. The state is an exact x plus an error e with |e|_P <= error."""
        exact = column_of([arb(B[i, j]) for i in range(B.nrows())])
        x, C, p = exact.mid(), arb_mat(self.C), self.C.nrows()
        error = self._size(exact - x)
        lower = [abs(arb(self.D[i, j])) for i in range(p)]
        upper = list(lower)
        for step in steps:
            require(step > 0, "a step must be positive")
            d = arb(step)
            terms = [x]
            for k in range(1, DEGREE + 2):
                terms.append(self.A * terms[-1] * (d / k))
            # the integrals of |c e| and of the Taylor polynomial's remainder over the step
            beyond = self._size(terms.pop())  # |A^25 x|_P d^25/25!
            spread = d.sqrt() * (error + beyond * (DEGREE + 1) / ((2 * arb(DEGREE) + 1).sqrt() * (DEGREE + arb(3) / 2)))
            outputs = [C * term for term in terms]
            for i in range(p):
                controls = bernstein([out[i, 0] for out in outputs])
                lower[i] += abs(sum(controls, arb(0))) * d / (DEGREE + 1) - spread
                upper[i] += sum((abs(one) for one in controls), arb(0)) * d / (DEGREE + 1) + spread
            moved = self._transition(step) * x
            x = moved.mid()
            error = (error + self._size(moved - x)).upper()
        rest = (self._size(x) + error) / (2 * arb(self.rate)).sqrt()
        return [(low.lower(), (high + rest).upper()) for low, high in zip(lower, upper, strict=True)]

    @property
    def norm(self) -> tuple[arb, arb]:
        """A lower and an upper bound on the largest row sum."""
        below, above = arb(0), arb(0)
        for low, high in zip(self.lower, self.upper, strict=True):
            below, above = below.max(sum(low, arb(0))), above.max(sum(high, arb(0)))
        return below.lower(), above.upper()


def bernstein(taylor: list[arb]) -> list[arb]:
    """The Bernstein coefficients of a polynomial on [0, 1]: b_i = sum_k binomial(i, k)/binomial(d, k) a_k."""
    return (bernstein_matrix(ctx.prec) * column_of(taylor)).entries()


@cache
def bernstein_matrix(_: int) -> arb_mat:
    """The matrix of ``bernstein`` at the present precision, which is the argument."""
    size = range(DEGREE + 1)
    return arb_mat([[arb(fmpq(comb(i, k), comb(DEGREE, k))) for k in size] for i in size])


# --- The given data: the case's numbers and the assumptions that follow from them -----------------------------------------------


PLANT_FACTS = {
    "A_m", "b", "k_0", "theta", "x0", "gain", "input_gain", "regressor", "uncertainty", "inputs", "disturbance", "unmatched",
    "unmatched_ranges", "sensor", "noise", "baseline", "reference", "states",
}  # fmt: skip
OUTPUT_FACTS = {"kind", "inputs", "reference", "noise", "disturbance", "output_disturbance"}


class Case:
    """The plant x' = A_m x + b (diag(gain) u + d + Phi(x)'theta) as the designer knows it, with the signals that act on it."""

    def __init__(self, facts: dict[str, Any]) -> None:
        self.facts, self.assumed = facts, dict[str, None]()
        known = OUTPUT_FACTS if facts.get("kind") == "output" else PLANT_FACTS
        unknown = ", ".join(sorted(facts.keys() ^ known))
        require(not unknown, f"plant must contain each of its numbers and nothing else, but these differ: {unknown}")
        if facts.get("kind") == "output":
            return
        self.A_m = matrix(facts["A_m"])
        self.n = self.A_m.nrows()
        require(self.A_m.ncols() == self.n, "A_m must be square")
        self.b, self.k_0 = matrix(facts["b"], self.n), matrix(facts["k_0"])
        self.m = self.b.ncols()
        require(self.k_0.nrows() == self.m, "k_0 needs a row for each input")
        self.theta, self.x0 = vector(facts["theta"]), column(vector(facts["x0"], self.n))
        self.gain = vector(facts["gain"], self.m)
        self.interval = None if facts["input_gain"] is None else Box(facts["input_gain"], self.m)
        require(self.interval is None or all(one > 0 for one in self.interval.lower), "an unknown input gain must be positive")
        fixed = facts["baseline"]  # u = k_0 r - theta_0'x, to which adaptation is added; the command also enters x' as enters r
        self.theta_0 = None if fixed is None else vector(fixed["theta_0"], len(facts["theta"]))
        self.enters = zeros(self.n, self.k_0.ncols()) if fixed is None else matrix(fixed["enters"], self.n, self.k_0.ncols())
        self.linear = facts["regressor"] == {"kind": "x"}
        require(
            not self.linear or len(self.theta) == self.n * self.m, "phi(x) = x needs an entry of theta for each state and input"
        )

    @property
    def parameters(self) -> list[fmpq]:
        """All estimated quantities: theta, and the input gains if they are unknown."""
        return self.theta if self.interval is None else self.theta + self.gain

    def command_bounds(self) -> list[arb]:
        """sup |r_q| of each command, computed from the command's parameters."""
        commands = self.facts["reference"]
        require(len(commands) == self.k_0.ncols(), "k_0 needs a column for each command")
        return [arb(self.bound_of_signal(one)) for one in commands]

    def bound_of_signal(self, signal: dict[str, Any]) -> fmpq:
        kind = signal["kind"]
        if kind in ("constant", "square", "chirp", "sine", "sines"):
            return abs(number(signal.get("constant", 0))) + sum((abs(one) for one in vector(signal["amplitudes"])), fmpq(0))
        if kind in ("levels", "recorded"):  # constant, or linear, between these
            return max(abs(one) for one in vector(signal["values"]))
        require(kind == "bounded", "the command has no bound")
        self.assumed[f"the command {signal.get('name', '')} stays within {text(number(signal['bound']))}"] = None
        return number(signal["bound"])

    @property
    def b_r(self) -> fmpq_mat:
        """The matrix by which commands act on the model."""
        return self.b * self.k_0 + self.enters

    @property
    def origin(self) -> list[fmpq]:
        """theta_0 of a baseline, from which the adaptive part of L1-AC departs; 0 without a baseline."""
        return [fmpq(0)] * len(self.theta) if self.theta_0 is None else self.theta_0

    def adapted(self) -> arb:
        """sup |k_0 r| of the command in the adaptive part of L1-AC: a baseline contains the command."""
        return self.pushed()[0] if self.theta_0 is None else arb(0)

    def pushed(self) -> list[arb]:
        """sup |(k_0 r)_j| of each input."""
        bounds = self.command_bounds()
        return [sum((arb(abs(self.k_0[j, q])) * r for q, r in enumerate(bounds)), arb(0)) for j in range(self.m)]

    @property
    def is_disturbed(self) -> bool:
        return self.facts["disturbance"] is not None or bool(self.facts["unmatched"])

    def push(self, P: fmpq_mat) -> arb:
        """An upper bound on |P w|, where w = b d + sum of E_j d_j is the contribution of the disturbances to x'."""
        total = arb(0)
        for direction, signal in self.acting():
            pushed = P * column(direction)
            total += root((pushed.transpose() * pushed)[0, 0]) * arb(self.bound_of_signal(signal))
        return total

    def acting(self) -> list[tuple[list[fmpq], dict[str, Any]]]:
        """The directions in which disturbances enter x', and their signals: the matched one first."""
        found = [(vector(one["direction"], None), one["signal"]) for one in self.facts["unmatched"]]
        if self.facts["disturbance"] is not None:
            require(self.m == 1, "a matched disturbance needs one input")
            found.insert(0, (self.b.entries(), self.facts["disturbance"]))
        require(all(len(one) <= self.n for one, _ in found), "a disturbance needs a direction with an entry for each state")
        return [(one + [fmpq(0)] * (self.n - len(one)), signal) for one, signal in found]  # none on a baseline's states

    def require_linear(self) -> None:
        require(self.linear and not self.facts["unmatched_ranges"], "a linear plant is needed")

    def require_unlimited(self, u: arb) -> None:
        """Require that a bound on |u| is within the inputs' limits."""
        for path in self.facts["inputs"]:
            limits = path["saturation"]
            require(limits is None or bool(u <= arb(min(-number(limits[0]), number(limits[1])))), "u may reach its limits")

    def require_nominal(self, *, any_gain: bool = False, disturbed: bool = False) -> None:
        """Require that the plant is (1): nothing else acts on it, there are no further dynamics before or around it, its state is
        measured, and the command is bounded.

        With ``disturbed``, disturbances are allowed here and checked elsewhere.
        """
        self.require_no("quantization", "saturation", "rate_limit", "actuator", "multiplicative")
        require(len(self.facts["inputs"]) == self.m, "there must be a path for each input")
        known = self.interval is None and not any_gain
        require(not known or all(one == 1 for one in self.gain), "the plant must be (1), but its input has a gain other than 1")
        require(all(one > 0 for one in self.gain), "the input's gain must be positive")
        carried = disturbed and self.theta_0 is None
        for name in ("sensor", "noise", "unmatched_ranges", *(() if carried else ("disturbance", "unmatched"))):
            require(self.facts[name] in (None, [], ""), f"the plant must be (1), but the case has: {name}")
        self.command_bounds()

    def require_no(self, *names: str) -> None:
        """Require that inputs have neither a delay nor one of these before them."""
        for path in self.facts["inputs"]:
            for name in names:
                require(path[name] is None, f"the plant must be (1), but its input has {name}")
            require(number(path["delay"]) == 0, "the plant must be (1), but its input has a delay")

    def bound_of(self, name: str) -> arb:
        """The bound of a signal that may be absent."""
        signal = self.facts[name]
        return arb(0) if signal is None else arb(self.bound_of_signal(signal))

    def measurement_errors(self) -> list[fmpq]:
        """Half a step plus the bound on the noise of each measured quantity; empty if all are zero."""
        sensor, noise = self.facts["sensor"], self.facts["noise"]
        require(noise is None or isinstance(noise, list), "noise needs a bound")
        steps = vector([] if sensor is None else sensor["quantization"])
        found = [abs(q) / 2 + abs(w) for q, w in zip(steps, vector(noise or [0] * len(steps)), strict=True)]
        return found if any(found) else []

    def require_regular(self) -> None:
        """Require that phi(x) is finite for every finite x. For a formula with a quotient or a root this is assumed and
        reported."""
        regressor = self.facts["regressor"]
        kind = regressor["kind"]
        if kind in ("x", "polynomial", "gaussian"):
            return
        if kind == "terms" and all(total(ast.parse(term, mode="eval").body) for term in regressor["terms"]):
            return
        self.assumed["phi(x) is finite wherever x may go"] = None


def total(node: ast.expr) -> bool:
    """Whether a formula is defined for all x because it contains only sums, products, integer powers and entire functions."""
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Pow):
            exponent = node.right
            whole = isinstance(exponent, ast.Constant) and isinstance(exponent.value, int) and exponent.value >= 0
            return whole and total(node.left)
        return isinstance(node.op, (ast.Add, ast.Sub, ast.Mult)) and total(node.left) and total(node.right)
    if isinstance(node, ast.UnaryOp):
        return total(node.operand)
    if isinstance(node, ast.Call):
        entire = isinstance(node.func, ast.Name) and node.func.id in ("abs", "exp", "sin", "cos", "tanh")
        return entire and all(map(total, node.args))
    return isinstance(node, (ast.Name, ast.Constant))


class Box:
    """lower <= theta <= upper."""

    def __init__(self, facts: dict[str, Any], size: int | None = None) -> None:
        self.lower = vector(facts["lower"], size)
        self.upper = vector(facts["upper"], len(self.lower))
        require(all(a <= b for a, b in zip(self.lower, self.upper, strict=True)), "the known set is empty")

    def holds(self, theta: list[fmpq]) -> bool:
        ends = zip(self.lower, theta, self.upper, strict=True)
        return len(theta) == len(self.lower) and all(a <= one <= b for a, one, b in ends)

    def farthest(self, theta: list[fmpq], weights: list[fmpq] | None = None) -> arb:
        """The largest weighted Euclidean distance from theta to a point of the set, attained at a vertex."""
        each = [max(abs(a - one), abs(b - one)) for a, one, b in zip(self.lower, theta, self.upper, strict=True)]
        return root(sum((w * one * one for w, one in zip(weights or [fmpq(1)] * len(each), each, strict=True)), fmpq(0)))

    def farthest_1(self, theta: list[fmpq]) -> arb:
        """The largest sum of absolute differences."""
        ends = zip(self.lower, theta, self.upper, strict=True)
        return arb(sum((max(abs(a - one), abs(b - one)) for a, one, b in ends), fmpq(0)))

    @property
    def faces(self) -> int:
        """The components that have an end within 1e150. Runs do not reach the other ends."""
        ends = zip(self.lower, self.upper, strict=True)
        return sum(min(abs(a), abs(b)) < fmpq(10) ** 150 for a, b in ends)


class Ball:
    """|theta - center| <= radius."""

    faces = 0

    def __init__(self, facts: dict[str, Any], size: int | None = None) -> None:
        self.center, self.radius = vector(facts["center"], size), number(facts["radius"])
        require(self.radius >= 0, "a radius must not be negative")

    def holds(self, theta: list[fmpq]) -> bool:
        away = sum(((a - b) ** 2 for a, b in zip(theta, self.center, strict=True)), fmpq(0))
        return bool(away <= self.radius**2)

    def farthest(self, theta: list[fmpq], weights: list[fmpq] | None = None) -> arb:
        each = weights or [fmpq(1)] * len(theta)
        away = sum((w * (a - b) ** 2 for w, a, b in zip(each, theta, self.center, strict=True)), fmpq(0))
        return root(away) + arb(self.radius) * root(max(each))

    def around(self) -> Box:
        """The smallest box around it."""
        found = Box({"lower": [], "upper": []})
        found.lower, found.upper = [one - self.radius for one in self.center], [one + self.radius for one in self.center]
        return found

    def farthest_1(self, theta: list[fmpq]) -> arb:
        away = sum((abs(a - b) for a, b in zip(theta, self.center, strict=True)), fmpq(0))
        return arb(away) + arb(self.radius) * root(fmpq(len(theta)))


def known_set(facts: dict[str, Any] | None) -> Box | Ball | None:
    return None if facts is None else Ball(facts) if "center" in facts else Box(facts)


class Controller:
    """A controller's numbers, and the lines about it and its loop that have been proven so far."""

    def __init__(self, case: Case, facts: dict[str, Any]) -> None:
        self.case, self.facts, self.proven = case, facts, dict[str, Any]()
        has_L = self.scheme == "mrac-closed-loop"
        require(("L" in facts) is has_L, f"{self.scheme} {'needs' if has_L else 'has no'} L")
        self.norms = dict[str, Norms]()

    @property
    def scheme(self) -> str:
        return str(self.facts["scheme"])

    def fact(self, name: str) -> Any:
        require(name in self.facts, f"the controller's {name} is missing")
        return self.facts[name]

    def earlier(self, name: str) -> Any:
        """The number proven by an earlier line."""
        require(name in self.proven, f"it needs an earlier line on {name}")
        return self.proven[name]

    def norm(self, name: str) -> Norms:
        require(name in self.norms, f"it needs an earlier line on the L1 norm of {name}")
        return self.norms[name]

    @property
    def P(self) -> fmpq_mat:
        return matrix(self.fact("P"), self.case.n, self.case.n)

    @property
    def A(self) -> fmpq_mat:
        """The matrix whose Lyapunov matrix is P: A_m, or A_m + L for a closed-loop model."""
        found = self.case.A_m
        return found + matrix(self.facts["L"], self.case.n, self.case.n) if "L" in self.facts else found

    @property
    def theta_hat0(self) -> list[fmpq]:
        return vector(self.fact("theta_hat0"))

    def error(self) -> list[fmpq]:
        """theta_tilde(0)."""
        return [a - b for a, b in zip(self.theta_hat0, self.case.parameters, strict=True)]

    @property
    def of_theta(self) -> Box | Ball | None:
        """The known set of theta."""
        return known_set(self.case.facts["uncertainty"])

    def require_theta_known(self) -> Box | Ball:
        found = self.of_theta
        if found is None or not found.holds(self.case.theta):
            raise Refused("theta must lie in the known set")
        return found

    def require_inside(self) -> None:
        """If the law projects, require that theta and theta_hat(0) are in the set."""
        theta, p = self.of_theta, len(self.case.theta)
        for values in (self.theta_hat0, self.case.parameters) if self.fact("projection") is True else ():
            require(theta is None or theta.holds(values[:p]), "theta and theta_hat(0) must lie in the set that is projected onto")
            gains = self.case.interval
            require(gains is None or gains.holds(values[p:]), "the input's gains must lie in their intervals")

    def require_no_corners(self) -> None:
        """Require that projection with a gain matrix keeps V' <= 0, as in a ball or a box with at most four reachable faces."""
        theta, gains = self.of_theta, self.case.interval
        faces = sum(one.faces for one in (theta, gains) if one is not None)
        cut = faces > 4 or (isinstance(theta, Ball) and gains is not None)
        keeps = self.fact("projection") is not True or not (cut and couples(self.fact("gamma")))
        require(keeps, "with a gain matrix the projection may make V grow in corners")

    def require_plain_law(self) -> None:
        """Require V' <= -|e|^2 with no modification, composite learning, or a switching sigma whose M_0 bounds theta."""
        require(self.fact("dead_zone") is None, "the law must not have a dead zone")
        leakage = self.fact("leakage")
        if leakage is None:
            return
        require(leakage.get("kind") == "switching", "a leakage must be a switching one")
        M_0, origin = number(leakage["M_0"]), [fmpq(0)] * len(self.case.theta)
        require(M_0 > 0, "M_0 must be positive")
        of_theta = sum((one**2 for one in self.case.parameters), fmpq(0))
        require(of_theta <= M_0**2, "M_0 must bound theta")
        theta, gains = self.of_theta, [] if self.case.interval is None else self.case.interval.upper
        if isinstance(theta, Box):
            squares = [max(a**2, b**2) for a, b in zip(theta.lower, theta.upper, strict=True)] + [one**2 for one in gains]
            require(sum(squares, fmpq(0)) <= M_0**2, "M_0 must bound theta over the known set")
        elif theta is not None:
            reach = theta.farthest(origin) + arb(sum(gains, fmpq(0)))
            require(bool(reach <= arb(M_0)), "M_0 must bound theta over the known set")

    def require_theorem_1(self, *, disturbed: bool = False) -> None:
        """Require the assumptions of V = e'Pe + theta_tilde'Gamma^-1 theta_tilde."""
        self.case.require_nominal(disturbed=disturbed)
        self.case.require_regular()
        require("sample_time" not in self.facts, "the controller must act continuously")
        self.earlier("lyapunov")
        gain_stays_positive = self.case.interval is None or self.fact("projection") is True
        require(gain_stays_positive, "the estimate of an unknown input gain must be projected")
        self.require_inside()
        self.require_no_corners()
        self.require_plain_law()

    def weighted_square(self) -> fmpq:
        """theta_tilde(0)'Gamma^-1 theta_tilde(0), where Gamma is a number, a diagonal or a matrix."""
        return weighted(self.error(), self.fact("gamma"))

    def level(self) -> arb:
        """nu_0/sqrt(Gamma). For disturbances see docs/proofs.md, "With bounded disturbances"."""
        if not self.case.is_disturbed:
            return root(self.weighted_square() / self.earlier("lambda_min"))
        theta, gains = self.require_theta_known(), self.case.interval
        require(self.fact("projection") is True, "with disturbances the estimates must be projected")
        require(self.fact("learning") is None, "with disturbances the law must not learn from a memory")
        p = len(self.case.theta)
        square = theta.farthest(self.case.theta) ** 2
        square += arb(0) if gains is None else gains.farthest(self.case.parameters[p:]) ** 2
        return ((square / self.carried_gain() + self.pushed_V()) / arb(self.earlier("lambda_min"))).sqrt()

    def carried_gain(self) -> fmpq:
        gain = least_gain(self, {"witness": self.fact("carried")})
        require(gain > 0, "Gamma must be positive")
        return gain

    def pushed_V(self) -> arb:
        """The contribution of disturbances to V; see docs/proofs.md, "With bounded disturbances"."""
        facts = self.fact("carried")
        q, largest = number(facts["decay"]), number(facts["largest"])
        product, one = self.P * self.A, identity(self.case.n)
        require(q > 0 and positive_definite(-(product + product.transpose()) - one * q), "-(PA + A'P) - q I must be definite")
        require(positive_definite(one * largest - self.P), "lambda I - P must be positive definite")
        return arb(largest) * (2 * self.case.push(self.P) / q) ** 2


def couples(gamma: Any) -> bool:
    """Whether Gamma is a matrix with nonzero entries off its diagonal."""
    if not (isinstance(gamma, list) and isinstance(gamma[0], list)):
        return False
    return any(number(entry) != 0 for i, row in enumerate(gamma) for j, entry in enumerate(row) if i != j)


def weighted(off: list[fmpq], gamma: Any) -> fmpq:
    if not isinstance(gamma, list):
        require(number(gamma) > 0, "Gamma must be positive")
        return sum((one**2 for one in off), fmpq(0)) / number(gamma)
    if not isinstance(gamma[0], list):
        each = vector(gamma, len(off))
        require(all(one > 0 for one in each), "Gamma must be positive")
        return sum((a**2 / g for a, g in zip(off, each, strict=True)), fmpq(0))
    Gamma = matrix(gamma, len(off), len(off))
    require(positive_definite(Gamma), "Gamma must be positive definite")
    return quadratic(column(off), Gamma.inv())


def least_gain(controller: Controller, line: dict[str, Any]) -> fmpq:
    """A lower bound on the smallest eigenvalue of Gamma. For a matrix, this is the witness of the line."""
    gamma = controller.fact("gamma")
    if not isinstance(gamma, list):
        return number(gamma)
    if not isinstance(gamma[0], list):
        return min(vector(gamma))
    Gamma, least = matrix(gamma), number(line["witness"]["least_gain"])
    require(least > 0 and positive_definite(Gamma - identity(Gamma.nrows()) * least), "Gamma - g I must be positive definite")
    return least


# --- Exact systems by name ----------------------------------------------------------------------------------------------


def system(c: Controller, name: str, line: dict[str, Any]) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat, fmpq_mat]:
    """A, B, C, D of the system whose norm a line states."""
    if c.scheme == "output":
        return around_y(c, name)
    case, n = c.case, c.case.n
    A_m, b, nothing = case.A_m, case.b, zeros(n, case.m)
    if name == "W_b":
        return A_m, b, identity(n), nothing
    if name == "sW_b":
        return A_m, b, A_m, b
    if name in ("W_r", "sW_r"):
        b_r = matrix(c.fact("sampled")["b_r"], n) if c.scheme == "sampled" else case.b_r
        return (A_m, b_r, identity(n), zeros(n, b_r.ncols())) if name == "W_r" else (A_m, b_r, A_m, b_r)
    if name == "C":
        return state_space(c.fact("filter"))
    if name in ("W_b(1-C)", "W_b(1-C) at kappa"):
        require(case.m == 1, "C(s) is known for one input")
        if name == "W_b(1-C)":
            A, B, C, D = state_space(c.fact("filter"))
        else:
            pole = 1 / number(line["kappa"])
            A, B, C, D = fmpq_mat([[-pole]]), fmpq_mat([[pole]]), fmpq_mat([[fmpq(1)]]), fmpq_mat([[fmpq(0)]])
        k = A.nrows()
        whole = blocks([[A_m, -(b * C)], [zeros(k, n), A]])
        return whole, blocks([[b * (1 - D[0, 0])], [B]]), blocks([[identity(n), zeros(n, k)]]), nothing
    if name == "1-L":
        return A_m, -matrix(c.fact("L"), n, n), identity(n), identity(n)
    require(name in ("T", "W_b S"), f"there is no rule for the norm of a system {name}")
    return disturbed(c)


def around_y(c: Controller, name: str) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat, fmpq_mat]:
    """One of three systems: the loop from r, d + f and d_y to y_G, e and sigma; its channel from d + f to y_G; or H (1 - C) of
    condition (20)."""
    if name == "H(1-C)":
        return state_space(c.fact("H(1-C)"))
    A, B, C, D = (matrix(c.fact("loop")[key]) for key in "ABCD")
    require(B.ncols() == 3 and name in ("loop", "y/(d+f)"), "there is no rule for the norm of this system")
    if name == "loop":
        return A, B, C, D
    return A, column([B[i, 1] for i in range(A.nrows())]), fmpq_mat(C.tolist()[:1]), fmpq_mat([[D[0, 1]]])


def state_space(facts: dict[str, Any]) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat, fmpq_mat]:
    A = matrix(facts["A"])
    return A, column(vector(facts["B"], A.nrows())), matrix([facts["C"]], 1, A.nrows()), fmpq_mat([[number(facts["D"])]])


def disturbed(c: Controller) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat, fmpq_mat]:
    """The system from a matched disturbance to x in the loop of a baseline, a linear controller or an ADRC, with theta_0."""
    n, b, theta_0 = c.case.n, c.case.b, matrix([c.fact("theta_0")], 1, c.case.n)
    require(c.case.m == 1 and c.case.linear, "this loop is known for one input and phi(x) = x")
    plant = c.case.A_m + b * theta_0
    measured = matrix([c.fact("c")], 1, n) if c.scheme == "linear" else zeros(1, n)
    if c.scheme == "baseline" or (c.scheme == "linear" and not c.fact("K")["A"]):  # K(s) is a gain, which for a baseline is 0
        gain = number(c.fact("K")["D"]) if c.scheme == "linear" else fmpq(0)
        return c.case.A_m - b * measured * gain, b, identity(n), zeros(n, 1)
    if c.scheme == "linear":
        A, B, C, D = state_space(c.fact("K"))
        feedback = blocks([[theta_0 + measured * D[0, 0], C]])
        inner = [B * measured, A]
    else:
        o = {key: matrix(value) for key, value in c.fact("observer").items()}
        of_estimates = blocks([[theta_0, fmpq_mat([[fmpq(1)]])]])
        of_x, of_xi = of_estimates * o["N"], of_estimates * o["M"]
        feedback = blocks([[of_x, of_xi]])
        inner = [o["G"] - o["H"] * of_x, o["F"] - o["H"] * of_xi]
    k = inner[1].nrows()
    A, B = blocks([[plant, zeros(n, k)], inner]), blocks([[b], [zeros(k, 1)]])
    return A - B * feedback, B, blocks([[identity(n), zeros(n, k)]]), zeros(n, 1)


# --- The rules ------------------------------------------------------------------------------------------------------------------


def rule(*keys: str) -> Callable[[Rule], Rule]:
    def named(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(keys, function))
        return function

    return named


@rule("lyapunov")
def _lyapunov(c: Controller, _: Any, line: dict[str, Any]) -> None:
    product = c.P * c.A
    require(positive_definite(c.P), "P must be positive definite")
    require(positive_definite(-(product + product.transpose())), "PA + A'P must be negative definite")
    c.proven["lyapunov"] = True


@rule("lambda_min")
def _lambda_min(c: Controller, value: Any, line: dict[str, Any]) -> None:
    least = number(value)
    require(least > 0 and positive_definite(c.P - identity(c.case.n) * least), "P - lambda_min I must be positive definite")
    c.proven["lambda_min"] = least


@rule("theta_max")
def _theta_max(c: Controller, value: Any, line: dict[str, Any]) -> None:
    theta = c.of_theta
    if theta is None:
        raise Refused("there is no known set")
    at_least(value, theta.farthest_1(c.case.origin if c.scheme == "l1" else [fmpq(0)] * len(c.case.theta)), "theta_max")
    c.proven["theta_max"] = arb(number(value))


@rule("L1 norm")
def _l1_norm(c: Controller, value: Any, line: dict[str, Any]) -> None:
    c.norms[line["of"]] = Norms(*system(c, line["of"], line), line["witness"])
    c.proven[f"kappa of {line['of']}"] = line.get("kappa")


@rule("norms")
def _norms(c: Controller, value: Any, line: dict[str, Any]) -> None:
    for name, ends in value.items():
        low, high = c.norm(name).norm
        require(bool(arb(number(ends["lower"])) <= low), f"||{name}||_1 is only known to be at least {text(low)}")
        at_least(ends["upper"], high, f"||{name}||_1's upper end")


@rule("bounds")
def _bounds(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """|x_m,i| <= sum_j ||e_i'W_b,j|| sup |(k_0 r)_j| + sqrt(x0'P x0 (P^-1)_ii), or W_r and r if commands also enter directly."""
    c.earlier("lyapunov")
    require("L" not in c.facts, "P must be a Lyapunov matrix of A_m")
    start, inverse, r = quadratic(c.case.x0, c.P), c.P.inv(), c.case.command_bounds()
    directly = any(one != 0 for one in c.case.enters.entries())
    each, pushed = (c.norm("W_r").upper, r) if directly else (c.norm("W_b").upper, c.case.pushed())
    for i in range(c.case.n):
        forced = sum((norm * push for norm, push in zip(each[i], pushed, strict=True)), arb(0))
        at_least(value["x_m"], forced + root(start * inverse[i, i]), "sup |x_m|")
    if "r" in value:
        at_least(value["r"], r[0], "sup |r|")
    c.proven["r"], c.proven["x_m"] = r, arb(number(value["x_m"]))


@rule("initial_parameter_error", "nu_0")
def _nu_0(c: Controller, value: Any, line: dict[str, Any]) -> None:
    c.require_inside()
    size = sum((one**2 for one in c.error()), fmpq(0))
    at_least(value, root(size if line["key"] != "nu_0" else size / c.earlier("lambda_min")), line["key"])
    c.proven[line["key"]] = arb(number(value))


@rule("nu_0_worst")
def _nu_0_worst(c: Controller, value: Any, line: dict[str, Any]) -> None:
    require(c.case.interval is None, "nu_0_worst requires a known input gain")
    at_least(value, c.require_theta_known().farthest(c.theta_hat0) / root(c.earlier("lambda_min")), "nu_0_worst")


def gain_and_size(c: Controller) -> tuple[arb, arb]:
    """N and the factor by which the small-gain condition multiplies it."""
    if c.scheme == "l1":
        return c.norm("W_b(1-C)").norm[1], c.earlier("theta_max")
    name = {"baseline": "W_b", "linear": "W_b S"}.get(c.scheme, "T")
    theta = c.of_theta
    if theta is None:
        raise Refused("there is no known set")
    return c.norm(name).norm[1], theta.farthest_1(vector(c.fact("theta_0")))


@rule("condition")
def _condition(c: Controller, value: Any, line: dict[str, Any]) -> None:
    norm, size = (c.norm("H(1-C)").norm[1], lipschitz(c)) if c.scheme == "output" else gain_and_size(c)
    at_least(value["value_upper"], norm * size, "the norm times the size")
    require(
        number(value["limit"]) == 1 and value["holds"] is (number(value["value_upper"]) < 1),
        "the condition holds if and only if the value is below 1",
    )


def contraction(c: Controller) -> arb:
    """1 - N times the factor, provably positive."""
    norm, size = gain_and_size(c)
    require(bool(norm * size < 1), "the small-gain condition must hold")
    return 1 - norm * size


@rule("kappa_max", "kappa_admissible")
def _kappas(c: Controller, value: Any, line: dict[str, Any]) -> None:
    kappa, theta_max = arb(number(value)), c.earlier("theta_max")
    if line["key"] == "kappa_max":
        require(bool(kappa * theta_max * c.norm("sW_b").norm[1] <= 1), "kappa_max must not exceed 1/(theta_max ||sW_b||_1)")
        return
    name = "W_b(1-C) at kappa"
    norm = c.norm(name).norm[1]
    require(number(c.proven[f"kappa of {name}"]) == number(value), "the norm must be that at kappa_admissible")
    require(bool(norm * theta_max < 1), "the condition must hold at kappa_admissible")


@rule("nu_1", "nu_2")
def _nu_1(c: Controller, value: Any, line: dict[str, Any]) -> None:
    c.require_theorem_1()
    require_known_gain(c)
    require_projected(c)
    A, B, C, D = state_space(c.fact("filter"))
    pole = -A[0, 0]
    first_order = A.nrows() == 1 and D[0, 0] == 0 and pole > 0 and B[0, 0] * C[0, 0] == pole
    require(first_order and not isinstance(c.fact("gamma"), list), "C must be 1/(kappa s + 1), and Gamma a number")
    slope, theta_max = c.norm("sW_b").norm[1], c.earlier("theta_max")
    left = 1 - arb(1 / pole) * slope * theta_max
    require(bool(left > 0), "kappa must be below kappa_max")
    if line["key"] == "nu_2":
        at_least(value, root(sum((one**2 for one in c.error()), fmpq(0)) / c.earlier("lambda_min")) / left, "nu_2")
    else:
        at_least(value, slope * (theta_max * c.earlier("x_m") + c.case.adapted()) / left, "nu_1")


@rule("reference_error_bound")
def _reference(c: Controller, value: Any, line: dict[str, Any]) -> None:
    c.require_theorem_1()
    require_known_gain(c)
    require_projected(c)
    at_least(value, c.norm("C").norm[1] * c.level() / contraction(c), "the bound of |x - x_ref|")


@rule("error_bound")
def _error_bound(c: Controller, value: Any, line: dict[str, Any]) -> None:
    if line.get("witness", {}).get("follows_from") == "linear response":
        at_least(value, c.earlier("linear response")["error_bound"], "the bound of |e|")
        return
    at_least(value, ERROR_BOUNDS[c.scheme](c), "the bound of |e|")


def of_mrac(c: Controller) -> arb:
    """Theorem 1 (i)."""
    c.require_theorem_1(disturbed=True)
    return c.level()


def require_projected(c: Controller) -> None:
    require(c.fact("projection") is True and c.case.linear and c.case.m == 1, "theta_hat must be projected onto the known set")


def require_known_gain(c: Controller) -> None:
    """Require a known gain. With an unknown gain the filter acts in a loop with that gain, and W_b(1 - C) is not the G of that
    loop."""
    require(c.case.interval is None, "the input's gain must be known")


def of_l1(c: Controller) -> arb:
    """Theorem 1 (ii)."""
    c.require_theorem_1(disturbed=True)
    require_known_gain(c)
    require_projected(c)
    norm, theta_max = gain_and_size(c)
    bias: arb = norm * (theta_max * c.earlier("x_m") + c.case.adapted())
    return (c.level() + bias) / contraction(c)


def of_closed_loop_model(c: Controller) -> arb:
    c.require_theorem_1(disturbed=True)
    return c.norm("1-L").norm[1] * c.level()


def require_fixed_loop(c: Controller) -> None:
    """Require the premises of e = T[(theta - theta_0)'x]."""
    c.case.require_nominal(any_gain=True)
    gain = number(c.fact("b_0")) if c.scheme == "adrc" else fmpq(1)
    require(c.scheme != "adrc" or c.case.theta_0 is None, "an ADRC has no baseline")
    require(c.case.gain == [gain], "the input must have the gain that the controller takes it to have")
    theta_0 = vector(c.fact("theta_0"), c.case.n)
    require(c.case.theta_0 in (None, theta_0), "theta_0 must be that of the baseline")
    if c.scheme == "adrc":
        require_exact_observer(c, c.case.A_m + c.case.b * fmpq_mat([theta_0]))
    c.require_theta_known()
    require("sample_time" not in c.facts, "the controller must act continuously")


def require_exact_observer(c: Controller, A: fmpq_mat) -> None:
    """Require, up to rounding, that with theta_0 the observer reproduces x and a zero disturbance.

    This holds if there is a V with V A = F V + G, V b = H and N + M V = (I, 0), so that xi = V x for every u.
    """
    F, G, H, M, N = (matrix(c.fact("observer")[name]) for name in "FGHMN")
    n, k = A.nrows(), F.nrows()
    rows = [[fmpq(0)] * (n * k) for _ in range(n * k)]
    for i, j, at in product(range(k), range(n), range(max(k, n))):
        if at < k:
            rows[i * n + j][at * n + j] += F[i, at]
        if at < n:
            rows[i * n + j][i * n + at] -= A[at, j]
    try:
        found = fmpq_mat(rows).solve(column([-G[i, j] for i in range(k) for j in range(n)]))
    except ZeroDivisionError:
        c.case.assumed["the observer reproduces x and a zero disturbance if theta = theta_0"] = None
        return
    V = fmpq_mat([[found[i * n + j, 0] for j in range(n)] for i in range(k)])
    size = fmpq(1) + largest_entry(V) * (largest_entry(M) + largest_entry(c.case.b))
    near("the observer", V * c.case.b, range(k), range(H.ncols()), H, size)
    exact = fmpq_mat([*identity(n).tolist(), *zeros(N.nrows() - n, n).tolist()])
    near("the observer", N + M * V, range(N.nrows()), range(n), exact, size)


def of_fixed_loop(c: Controller) -> arb:
    require_fixed_loop(c)
    norm, size = gain_and_size(c)
    bias: arb = norm * size * c.earlier("x_m")
    return bias / contraction(c)


def ideal_V(c: Controller, omega: list[fmpq], of_x: fmpq | arb) -> arb:
    """V(0) of the direct MRAC, which is the contribution of k_x plus omega_i (k_r - k_0/omega)^2/gamma_r."""
    k_r, k_0 = vector(c.fact("k_r0")), [one for row in c.case.k_0.tolist() for one in row]
    each = [omega[j // (len(k_0) // len(omega))] for j in range(len(k_0))]
    of_r = sum((w * (a - b / w) ** 2 for w, a, b in zip(each, k_r, k_0, strict=True)), fmpq(0)) / number(c.fact("gamma_r"))
    return arb(of_x) + arb(of_r)


def require_direct(c: Controller, *, disturbed: bool = False) -> None:
    c.case.require_nominal(any_gain=True, disturbed=disturbed)
    c.case.require_regular()
    require("sample_time" not in c.facts, "the controller must act continuously")
    c.earlier("lyapunov")
    gamma, theta, intervals = c.fact("gamma"), c.of_theta, c.case.interval
    one_input = c.case.m == 1 or not (isinstance(gamma, list) and isinstance(gamma[0], list))
    require(number(c.fact("gamma_r")) > 0 and one_input, "a gain matrix is allowed for one input only")
    if c.fact("projection") is not True:
        return
    corners = theta is not None and theta.faces > 4 and couples(gamma)
    require(not corners, "with a gain matrix the projection may make V grow in corners")
    omega = c.case.gain
    require(intervals is None or intervals.holds(omega), "omega must lie in its interval")
    ideal = [one / omega[k % c.case.m] for k, one in enumerate(c.case.theta)]
    if intervals is None:
        require(theta is None or theta.holds(ideal), "theta/omega must lie in the set that is projected onto")
    else:
        require(theta is None or theta.holds(c.case.theta), "theta must lie in the known set")


def of_direct(c: Controller) -> arb:
    """The bound from V = e'Pe plus omega_i times the terms of the adapted gains of each input i."""
    require_direct(c, disturbed=True)
    omega = [c.case.gain[k % c.case.m] for k in range(len(c.theta_hat0))]
    if c.case.is_disturbed:
        return ((of_projected_gains(c, omega) + c.pushed_V()) / arb(c.earlier("lambda_min"))).sqrt()
    off = [a - b / w for a, b, w in zip(c.theta_hat0, c.case.theta, omega, strict=True)]
    gamma = c.fact("gamma")
    if c.case.m == 1:
        of_x = weighted(off, gamma) * omega[0]
    else:
        gammas = vector(gamma) if isinstance(gamma, list) else [number(gamma)] * len(off)
        of_x = sum((w * a**2 / g for w, a, g in zip(omega, off, gammas, strict=True)), fmpq(0))
    return (ideal_V(c, c.case.gain, of_x) / arb(c.earlier("lambda_min"))).sqrt()


def of_projected_gains(c: Controller, omega: list[fmpq]) -> arb:
    """The largest contribution of the gains to V if k_x and k_r are anywhere in the sets theta/omega and k_0/omega onto which
    they are projected."""
    theta, intervals, gamma = c.require_theta_known(), c.case.interval, c.fact("gamma")
    if intervals is None or c.fact("projection") is not True:
        raise Refused("with disturbances both gains must be projected")
    ideal = [one / w for one, w in zip(c.case.theta, omega, strict=True)]
    diagonal = isinstance(gamma, list) and not isinstance(gamma[0], list)
    gammas = vector(gamma) if diagonal else [c.carried_gain()] * len(omega)
    weights = [w / g for w, g in zip(omega, gammas, strict=True)]
    if isinstance(theta, Box):
        each = [k % c.case.m for k in range(len(omega))]
        of_x = quotients(theta.lower, theta.upper, intervals, each).farthest(ideal, weights)
    else:
        low, high = min(1 / one for one in intervals.upper), max(1 / one for one in intervals.lower)
        far = sum(
            (w * (a - one * (low + high) / 2) ** 2 for w, a, one in zip(weights, ideal, theta.center, strict=True)), fmpq(0)
        )
        reach = arb(theta.radius * high) + root(sum((one**2 for one in theta.center), fmpq(0))) * (high - low) / 2
        of_x = root(far) + reach * root(max(weights))
    k_0 = [one for row in c.case.k_0.tolist() for one in row]
    each = [j // (len(k_0) // c.case.m) for j in range(len(k_0))]
    k_r = [one / c.case.gain[i] for one, i in zip(k_0, each, strict=True)]
    of_r = quotients(k_0, k_0, intervals, each).farthest(k_r, [c.case.gain[i] / number(c.fact("gamma_r")) for i in each])
    return of_x**2 + of_r**2


def quotients(lower: list[fmpq], upper: list[fmpq], omega: Box, each: list[int]) -> Box:
    """The box of value/omega_i for every value between its ends and every omega_i > 0 in its interval."""
    ends = [
        [value / w for value in (a, b) for w in (omega.lower[i], omega.upper[i])]
        for a, b, i in zip(lower, upper, each, strict=True)
    ]
    found = Box({"lower": [], "upper": []})
    found.lower, found.upper = [min(one) for one in ends], [max(one) for one in ends]
    return found


def of_the_model(c: Controller) -> arb:
    """With the plant's parameters the loop is the model."""
    c.case.require_nominal()
    c.case.require_regular()
    require("sample_time" not in c.facts, "the controller must act continuously")
    require(vector(c.fact("theta")) == c.case.parameters, "the parameters must be the plant's")
    return arb(0)


ERROR_BOUNDS: dict[str, Callable[[Controller], arb]] = {
    "mrac": of_mrac, "l1": of_l1, "mrac-closed-loop": of_closed_loop_model, "mrac-direct": of_direct, "baseline": of_fixed_loop,
    "linear": of_fixed_loop, "adrc": of_fixed_loop, "output": lambda c: small_gain(c)[1][0], "known-parameters": of_the_model,
}  # fmt: skip


def widest(P: fmpq_mat) -> fmpq:
    """The largest (P^-1)_ii. e_i^2 is at most this number times e'Pe."""
    inverse = P.inv()
    return max(inverse[i, i] for i in range(P.nrows()))


def worst_V(c: Controller, line: dict[str, Any]) -> arb:
    """The largest theta_tilde'Gamma^-1 theta_tilde at t = 0, at a vertex of the known set or the farthest point of a ball."""
    theta, gains, start, gamma = c.require_theta_known(), c.case.interval, c.theta_hat0, c.fact("gamma")
    diagonal, p = isinstance(gamma, list) and not isinstance(gamma[0], list), len(c.case.theta)
    gammas = vector(gamma, len(start)) if diagonal else [least_gain(c, line)] * len(start)
    require(all(one > 0 for one in gammas), "Gamma must be positive")
    weights = [1 / one for one in gammas]
    of_gains = arb(0) if gains is None else gains.farthest(start[p:], weights[p:]) ** 2
    return theta.farthest(start[:p], weights[:p]) ** 2 + of_gains


@rule("error_bound_worst", "error_bound_command")
def _error_bound_worst(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """|e|^2 <= V/lambda_min and e_i^2 <= V (P^-1)_ii. The bound under the command uses the second inequality.

    V(0) of the direct MRAC is largest at the ends of the intervals of omega. A bound for every command is also a bound for the
    command of the case.
    """
    of_command = line["key"] == "error_bound_command"
    if of_command and line.get("witness", {}).get("follows_from") == "error_bound_worst":
        at_least(value, c.earlier("error_bound_worst"), "the bound for this command")
        return
    if c.scheme in ("l1", "baseline", "linear", "adrc"):
        at_least(value, along_the_command(c, line) if of_command else for_all_commands(c, line), "the bound of |e|")
        c.proven[line["key"]] = arb(number(value))
        return
    if c.scheme == "own V":
        at_least(value, c.earlier("lyapunov_decay").bound_of_e(c.earlier("lyapunov_decay").largest_level()), "the bound of |e_i|")
        return
    theta, least = c.require_theta_known(), 1 / widest(c.P) if of_command else c.earlier("lambda_min")
    if c.scheme != "mrac-direct":
        require(c.scheme in ("mrac", "mrac-closed-loop"), "there is no rule for this scheme")
        c.require_theorem_1()
        carried = c.norm("1-L").norm[1] if "L" in c.facts else arb(1)
        at_least(value, carried * (worst_V(c, line) / arb(least)).sqrt(), "the bound of |e|")
        return
    require_direct(c)
    intervals, gamma = c.case.interval, c.fact("gamma")
    one = intervals is None and c.fact("projection") is True
    require(not one or all(w == 1 for w in c.case.gain), "theta/omega must lie in the set of the projection for every theta")
    corners = [tuple(c.case.gain)] if intervals is None else product(*zip(intervals.lower, intervals.upper, strict=True))
    matrix_gain = not isinstance(gamma, list) or isinstance(gamma[0], list)
    gammas = [least_gain(c, line)] * len(c.theta_hat0) if matrix_gain else vector(gamma)
    for omega in corners:
        each = [omega[k % c.case.m] for k in range(len(c.theta_hat0))]
        scaled = [w * a for w, a in zip(each, c.theta_hat0, strict=True)]
        of_x = theta.farthest(scaled, [1 / (w * g) for w, g in zip(each, gammas, strict=True)]) ** 2
        at_least(value, (ideal_V(c, list(omega), of_x) / arb(least)).sqrt(), "the bound of |e|")


def slope_of_f(c: Controller) -> arb:
    """L, which is assumed. It is 0 without f."""
    f = c.fact("f")
    if f is None:
        return arb(0)
    slope, rest = number(f["slope"]), number(f["at_zero"])
    bounds = f"|f(t, 0)| <= {text(rest)}, and the slope of f is at most {text(slope)} for |y| up to output_bound"
    c.case.assumed[bounds] = None
    return arb(slope)


def lipschitz(c: Controller) -> arb:
    """L of condition (20): the given value, which is assumed, or else the slope of f."""
    given = c.fact("lipschitz")
    if given is None:
        return slope_of_f(c)
    c.case.assumed[f"f has the Lipschitz constant {text(number(given))} of condition (20)"] = None
    return arb(number(given))


@rule("slope")
def _slope(c: Controller, value: Any, line: dict[str, Any]) -> None:
    require(c.scheme == "output", "there is no rule for this scheme")
    at_least(value, slope_of_f(c), "the slope of f")


def small_gain(c: Controller) -> tuple[arb, list[arb]]:
    """The bounds on |y_G| and then on e and sigma, by the small-gain theorem."""
    case, f = c.case, c.fact("f")
    case.require_no("quantization", "saturation", "rate_limit")
    require(case.facts["noise"] is None and "sample_time" not in c.facts, "a continuous loop without noise is needed")
    sizes = [case.bound_of(name) for name in ("reference", "disturbance", "output_disturbance")]
    slope, rest = slope_of_f(c), arb(0) if f is None else arb(number(f["at_zero"]))
    case.assumed["the matrices of the loop around y are those of the case"] = None
    each = c.norm("loop").upper
    gain = each[0][1]
    require(bool(gain * slope < 1), "the small gain must be below 1")
    y = (each[0][0] * sizes[0] + each[0][2] * sizes[2] + gain * (sizes[1] + rest)) / (1 - gain * slope)
    w = sizes[1] + rest + slope * y
    return y, [row[0] * sizes[0] + row[1] * w + row[2] * sizes[2] for row in each[1:]]


@rule("output_bound", "sigma_needed")
def _output_bound(c: Controller, value: Any, line: dict[str, Any]) -> None:
    y, others = small_gain(c)
    at_least(value, y if line["key"] == "output_bound" else others[1], line["key"])


@rule("W_hat_bound", "V_hat_bound", "control_bound")
def _network(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """The bound due to the e-modification, which holds whatever else acts on the loop. For a sampled loop it is part of the
    response."""
    of_loop = c.proven.get("sampled") or c.proven.get("linear response")
    if of_loop is not None:
        at_least(value, of_loop[line["key"]], "the bound of |u|")
        return
    require("sample_time" not in c.facts and c.case.theta_0 is None, "the controller must act continuously, without a baseline")
    nu, gamma, gamma_v = (number(c.fact(name)) for name in ("nu", "gamma", "gamma_v"))
    rows = 1 + c.fact("neurons")
    require(isinstance(rows, int) and rows > 1 and nu > 0 and gamma > 0 and gamma_v > 0, "gains must be positive")
    if line["key"] == "W_hat_bound":
        at_least(value, 1 / nu, "the bound of an outer weight")
    elif line["key"] == "control_bound":
        for push in c.case.pushed():
            at_least(value, rows / arb(nu) + push, "the bound of |u|")
    else:
        far, bend = root(fmpq(rows)) / arb(nu), arb(1 / gamma - 1 / gamma_v)
        levels = [
            bend * far**2 + far**2 / arb(gamma_v),
            arb(sum((one**2 for one in vector(c.fact("V_hat0"))), fmpq(0)) / gamma_v),
        ]
        peak = -far / (2 * arb(gamma_v) * bend) if bend < 0 else far
        levels += [bend * peak**2 + far * peak / arb(gamma_v)] if bend < 0 else []
        for level in levels:
            at_least(value, (arb(gamma_v) * level.max(arb(0))).sqrt(), "the bound of the inner weights")


# --- A loop over cells of the known set: docs/proofs.md, "Along the command" and "For all commands" ----------------------------


def over_cells(box: Box, tree: dict[str, Any], bound: Callable[[Box, dict[str, Any]], arb]) -> arb:
    """The largest bound over the cells into which a tree of cuts divides a box."""
    if "side" not in tree:
        return bound(box, tree).upper()
    side, at, found = tree["side"], number(tree["at"]), list[arb]()
    for part, end in (("low", "upper"), ("high", "lower")):
        ends = {"lower": list(box.lower), "upper": list(box.upper)}
        require(ends["lower"][side] <= at <= ends["upper"][side], "a cell must be cut between its ends")
        ends[end][side] = at
        half = Box({"lower": [], "upper": []})
        half.lower, half.upper = ends["lower"], ends["upper"]
        found.append(over_cells(half, tree[part], bound))
    return found[0].max(found[1])


def varied(A: fmpq_mat, B: fmpq_mat, case: Case, off: list[fmpq], passes: fmpq) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat]:
    """(x_m, e_c, s_1 ... s_n)' = M (...) + b r, with the outputs e_c, s_1 ... s_n: A, B and the first n states are those of G."""
    n, m = case.n, A.nrows()
    size, b_r = n + (n + 1) * m, case.b_r
    rows, outputs = [[fmpq(0)] * size for _ in range(size)], [[fmpq(0)] * size for _ in range((n + 1) * n)]
    for i, row in enumerate(case.A_m.tolist()):
        rows[i][:n] = row
    for j in range(n + 1):
        at = n + j * m
        for i in range(n):
            outputs[j * n + i][at + i] = fmpq(1)
        for i in range(m):
            rows[at + i][at : at + m] = A.tolist()[i]
            for k in range(n):  # the contributions of e_c or s_j itself, of x_m, and of x_c,j = x_m,j + e_c,j
                rows[at + i][at + k] += B[i, 0] * off[k]
                rows[at + i][k] += B[i, 0] * (off[k] if j == 0 else fmpq(int(k == j - 1)))
            if j:
                rows[at + i][n + j - 1] += B[i, 0]
    drive = [b_r[i, 0] for i in range(n)] + [-passes * B[i, 0] for i in range(m)] + [fmpq(0)] * (n * m)
    return fmpq_mat(rows), column(drive), fmpq_mat(outputs)


def generator(signal: dict[str, Any], t_end: fmpq, count: int) -> tuple[fmpq_mat, list[fmpq], list[tuple[arb, list[arb]]]]:
    """S, c and the (duration, w) of each piece, on which w' = S w and r = c w."""
    kind, constant = signal["kind"], number(signal.get("constant", 0))
    amplitudes = vector(signal.get("amplitudes", []))
    if kind in ("sine", "sines"):
        size, w, out = len(amplitudes), [arb(1)], [constant]
        S = zeros(2 * size + 1, 2 * size + 1)
        for i, (frequency, phase) in enumerate(
            zip(vector(signal["frequencies"], size), vector(signal["phases"], size), strict=True)
        ):
            S[2 * i + 1, 2 * i + 2], S[2 * i + 2, 2 * i + 1] = frequency, -frequency
            w += [arb(phase).sin(), arb(phase).cos()]
            out += [amplitudes[i], fmpq(0)]
        return S, out, [(arb(t_end), w)]
    starts, levels = [arb(0)], amplitudes
    if kind == "square":
        frequency, at_start = number(signal["frequencies"][0]), arb(number(signal["phases"][0]))
        half = (at_start / arb.pi()).floor().unique_fmpz()
        if half is None or not frequency > 0:
            raise Refused("the sign of the square wave at t = 0 must be certain")
        jumps = [((half + k) * arb.pi() - at_start) / arb(frequency) for k in range(1, count + 1)]
        require(bool(jumps.pop() >= arb(t_end)), "the square wave jumps again before t_end")
        starts, levels = starts + jumps, [constant + (-1) ** ((int(half) + k) % 2) * amplitudes[0] for k in range(count)]
    elif kind == "levels":
        times, values = vector(signal["times"]), vector(signal["values"])
        require(
            len(values) == len(times) + 1 and all(a < b for a, b in pairwise(times)),
            "levels must be one more than their instants, which must increase",
        )
        past = sum(time <= 0 for time in times)
        until = past + sum(0 < time < t_end for time in times)
        starts, levels = starts + [arb(time) for time in times[past:until]], values[past : until + 1]
    else:
        require(kind == "constant", "the response to a command of this kind can't be checked")
    ends = [*starts[1:], arb(t_end)]
    return zeros(1, 1), [fmpq(1)], [(b - a, [arb(one)]) for a, b, one in zip(starts, ends, levels, strict=True)]


class LinearPart:
    """e = G[(theta - origin)'x - passes r] + w, |w| <= added, with G = (A, B, the first n states)."""

    def __init__(self, c: Controller, line: dict[str, Any]) -> None:
        self.case, self.line, self.added, self.passes = c.case, line, arb(0), fmpq(0)
        if c.scheme == "l1":
            c.require_theorem_1()
            require_known_gain(c)
            require_projected(c)
            self.A, self.B, _, _ = system(c, "W_b(1-C)", line)
            self.origin, self.passes = c.case.origin, c.case.k_0[0, 0] if c.case.theta_0 is None else fmpq(0)
            self.added = c.norm("C").norm[1] * (arb(widest(c.P)) * worst_V(c, line)).sqrt()
        else:
            require_fixed_loop(c)
            self.A, self.B, _, _ = disturbed(c)
            self.origin = vector(c.fact("theta_0"), c.case.n)
        theta = c.require_theta_known()
        if not (isinstance(theta, Box) and len(c.case.facts["reference"]) == 1 == c.case.k_0.ncols()):
            raise Refused("the proof needs a box and one command")
        self.theta = theta

    def largest(self, bound: Callable[[list[fmpq], list[fmpq], dict[str, Any]], arb]) -> arb:
        """The largest bound(c - origin, rho, leaf) over the cells."""

        def of_cell(cell: Box, leaf: dict[str, Any]) -> arb:
            ends = list(zip(cell.lower, cell.upper, strict=True))
            center = vector(leaf["center"], len(ends)) if "center" in leaf else [(a + b) / 2 for a, b in ends]
            rho = [max(b - c, c - a) for (a, b), c in zip(ends, center, strict=True)]  # whatever the point
            return bound([c - one for c, one in zip(center, self.origin, strict=True)], rho, leaf)

        return over_cells(self.theta, self.line["witness"]["cells"], of_cell)

    def varied(self, off: list[fmpq]) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat]:
        return varied(self.A, self.B, self.case, off, self.passes)


def size_1(values: list[fmpq]) -> arb:
    return arb(sum((abs(one) for one in values), fmpq(0)))


def along_the_command(c: Controller, line: dict[str, Any]) -> arb:
    """The bound on |e_i| up to t_end for the command of the case and every theta in the known set."""
    part, (N, _), t_end = LinearPart(c, line), gain_and_size(c), number(line["witness"]["t_end"])

    def bound(off: list[fmpq], rho: list[fmpq], leaf: dict[str, Any]) -> arb:
        left = 1 - N * (size_1(off) + size_1(rho))
        require(bool(left > 0), "the small gain over a cell must be below 1")
        first, spread = followed(part.varied(off), c.case, rho, t_end, leaf)
        return first + (N * size_1(rho) * spread + part.added) / left

    c.case.assumed[f"error_bound_command is a bound up to t = {text(t_end)} s"] = None
    return part.largest(bound)


def for_all_commands(c: Controller, line: dict[str, Any]) -> arb:
    """The bound on |e_i| for every command of the case's size and every theta in the known set, by norms for each cell."""
    part, [r], n, x0 = LinearPart(c, line), c.case.command_bounds(), c.case.n, c.case.x0.entries()

    def bound(off: list[fmpq], rho: list[fmpq], leaf: dict[str, Any]) -> arb:
        M, of_r, outputs = part.varied(off)
        nothing, m = zeros(outputs.nrows(), 1), part.A.nrows()
        sizes = [row[0] * r for row in Norms(M, of_r, outputs, nothing, leaf["forced"]).upper]
        if any(one != 0 for one in x0):
            start = column([*x0, *([fmpq(0)] * (M.nrows() - n))])
            free = Norms(M, start, outputs * M, nothing, leaf["free"]).upper
            sizes = [a + row[0] / 2 for a, row in zip(sizes, free, strict=True)]
        seen = fmpq_mat([[fmpq(int(i == j)) for j in range(m)] for i in range(n)])
        looped = part.A + part.B * fmpq_mat([off]) * seen
        N = Norms(looped, part.B, seen, zeros(n, 1), leaf["loop"]).norm[1]
        q = N * size_1(rho)
        require(bool(q < 1), "the small gain over a cell must be below 1")
        varies = [sum((arb(one) * sizes[(j + 1) * n + i] for j, one in enumerate(rho)), arb(0)) for i in range(n)]
        first = largest_of([sizes[i] + varies[i] for i in range(n)])
        return first + (q * largest_of(varies) + (1 + N * size_1(off)) * part.added) / (1 - q)

    return part.largest(bound)


def followed(
    loop: tuple[fmpq_mat, fmpq_mat, fmpq_mat], case: Case, rho: list[fmpq], t_end: fmpq, leaf: dict[str, Any]
) -> tuple[arb, arb]:
    """The largest |e_c,i| + sum_j rho_j |s_j,i| along the command, and the largest sum without |e_c,i|."""
    bits, A, n = leaf["bits"], loop[0], case.n
    require(isinstance(bits, int) and LEAST_BITS <= bits <= MOST_BITS, "bits must be a whole number of a working precision")
    with ctx.workprec(bits):
        S, out, pieces = generator(case.facts["reference"][0], t_end, len(leaf["steps"]))
        k, outputs = S.nrows(), loop[2].nrows()
        exact = blocks([[S, zeros(k, A.nrows())], [loop[1] * fmpq_mat([out]), A]])
        v, M, ways = vector(leaf["weights"], exact.nrows()), arb_mat(exact), arb_mat(blocks([[zeros(outputs, k), loop[2]]]))
        require(all(one > 0 for one in v), "weights must be positive")
        sized = fmpq_mat([[one if i == j else abs(one) for j, one in enumerate(row)] for i, row in enumerate(exact.tolist())])
        rate = arb(max(fmpq(0), *(one / w for one, w in zip((sized * column(v)).entries(), v, strict=True))))
        gains = [sum((abs(one) * arb(w) for one, w in zip(row, v, strict=True)), arb(0)) for row in ways.tolist()]
        powers, rest = [ways], [arb(one) for one in case.x0.entries()] + [arb(0)] * (A.nrows() - n)
        for order in range(1, DEGREE + 1):
            powers.append(powers[-1] * M * (arb(1) / order))
        beyond, transitions = M ** (DEGREE + 1) * (1 / arb(DEGREE + 1).fac()), dict[Any, arb_mat]()
        first = spread = arb(0)
        for (length, w), steps in zip(pieces, leaf["steps"], strict=True):
            z, durations = column_of(w + rest), vector(steps)
            last = length - sum(durations, fmpq(0))
            require(all(one > 0 for one in durations) and bool(last > 0), "steps must be positive and end with the piece")
            for name in (*durations, None):
                d = last if name is None else arb(name)
                missed = max((abs(one) / arb(w)).upper() for one, w in zip((beyond * z).entries(), v, strict=True))
                missed = missed * d ** (DEGREE + 1) * (rate * d).exp()
                terms = [(power * z * d**order).entries() for order, power in enumerate(powers)]
                sizes = [
                    [abs(one) + missed * gain for one in bernstein(list(each))]
                    for each, gain in zip(zip(*terms, strict=True), gains, strict=True)
                ]
                for i in range(n):
                    for beta in range(DEGREE + 1):
                        varies = sum((arb(one) * sizes[(j + 1) * n + i][beta] for j, one in enumerate(rho)), arb(0))
                        first, spread = first.max(sizes[i][beta] + varies), spread.max(varies)
                if name not in transitions or name is None:
                    transitions[name] = (M * d).exp()
                z = transitions[name] * z
            rest = z.entries()[k:]
        return first, spread


# --- A loop that is linear from sample to sample: docs/proofs.md, "A sampled linear loop" ---------------------------------------

SAMPLES_BETWEEN_ROUNDINGS = 8
ROUNDING = fmpq(1, 2**36)
"""Largest relative difference of a matrix in a file from its value, which was computed in double precision."""
PARTS, TRAPEZOIDS = 16, 4
"""Numbers of parts of a sample, for its motion and for the effect of disturbances."""


class SampledLoop:
    """A loop with X' = A X + E v between samples. X becomes J X at a sample, and u = C X acts whole + part samples later. z
    contains X and the delayed u."""

    reached: arb_mat

    def __init__(self, c: Controller) -> None:
        facts, case = c.fact("sampled"), c.case
        self.A, s = arb_mat(matrix(facts["A"])), len(facts["A"])
        self.E, self.J, self.C = (arb_mat(matrix(facts[name])) for name in "EJC")
        self.T, self.s, self.m = number(facts["T"]), s, self.E.ncols()
        self.whole, self.part = facts["whole"], number(facts["part"])
        whole = isinstance(self.whole, int) and self.whole >= 0
        require(self.T > 0 and whole and 0 <= self.part < 1, "a sample time and a delay are needed")
        self.A_m, self.b_r, self.n = arb_mat(case.A_m), arb_mat(matrix(facts["b_r"], case.n)), case.n
        self.depth = self.whole + (1 if self.part > 0 else 0)
        self.size = s + self.m * self.depth
        self.x, self.x_m, self.r = (facts["rows"][name] for name in ("x", "x_m", "r"))
        self.N, self.first, self.free = (arb_mat(matrix(facts[name], s)) for name in ("N", "first", "free"))
        self.B = arb_mat(matrix(facts["B"], s)) if facts["B"][0] else None
        self.W, self.first_W = (matrix(facts[name], s) for name in ("W", "first_W"))
        (moved, pushed), (_, early) = self.over((1 - self.part) * self.T), self.over(self.part * self.T)
        u = [self.wide(self.C), *(self.unit(range(s + age * self.m, s + (age + 1) * self.m)) for age in range(self.depth))]
        self.now, self.before = u[self.whole], u[self.whole + 1] if self.part > 0 else u[self.whole]
        top = self.J * (self.over(self.T)[0] * self.unit(range(s)) + pushed * self.now)
        top = top + self.J * (moved * early) * self.before if self.part > 0 else top
        self.M = arb_mat([*top.tolist(), *(row for one in u[: self.depth] for row in one.tolist())])

    def require_plant(self, c: Controller) -> None:
        """Require that plant, disturbances, delay and model in these matrices are those of the case, up to rounding. Controller
        and actuator are not checked."""
        facts, case, x, x_m, r = c.fact("sampled"), c.case, self.x, self.x_m, self.r
        A, E, J, N, first, free = (matrix(facts[name]) for name in ("A", "E", "J", "N", "first", "free"))
        rows, inputs, commands = [*x, *x_m, *r], range(self.m), range(len(r))
        placed = all(isinstance(row, int) and 0 <= row < self.s for row in rows) and len({*rows}) == len(rows)
        sizes = len(x) == len(x_m) == self.n and len(r) == case.k_0.ncols() and self.m == case.m
        require(placed and sizes, "x, x_m and r need rows of their own")
        theta = fmpq_mat([[case.theta[i * case.m + j] for i in range(self.n)] for j in inputs])
        gain = fmpq_mat([[case.gain[i] if i == j else fmpq(0) for j in inputs] for i in inputs])
        pulled, one, model, of_r = case.b * theta, identity(self.s), *self.over(self.T, model=True)
        near("x'", A, x, x, case.A_m + pulled, largest_entry(case.A_m) + largest_entry(pulled))
        if all(path["actuator"] is None and path["multiplicative"] is None for path in case.facts["inputs"]):
            near("x'", E, x, inputs, case.b * gain)
            near("x'", A, x, [k for k in range(self.s) if k not in x])
        near("the jump of x at a sample", J, x, range(self.s), fmpq_mat([one.tolist()[row] for row in x]))
        near("the jump of x at a sample", N, x, commands)
        near("x(0)", free, x, [0], case.x0)
        if case.facts["sensor"] is None or matrix(case.facts["sensor"]["reads"]) == identity(self.n):
            near("x(0)", free, x_m, [0], case.x0)  # with an observer, the model starts at its estimate
        near("the first sample of r", first, [*x, *x_m], commands)
        near("the model", matrix(facts["b_r"]), range(self.n), commands, case.b_r)
        near("the model", J, x_m, x_m, model, arb(1))
        near("the model", J, x_m, r, of_r)
        near("the model", J, x_m, [k for k in range(self.s) if k not in (*x_m, *r)])
        near("the model", N, x_m, commands)
        for part in (N, first):
            near("the held command", part, r, commands, identity(len(r)))
        wanted = [dict(zip(x, direction, strict=True)) for direction, _ in case.acting()]
        converted = [i for i in inputs if case.facts["inputs"][i]["quantization"] is not None]
        for k, entry in enumerate([*wanted, *({row: E[row, i] for row in range(self.s)} for i in converted)]):
            entries = fmpq_mat([[entry.get(row, fmpq(0))] for row in range(self.s)])
            near("a disturbance or a converter", matrix(facts["B"]), range(self.s), [k], entries)
        sensor, lagged = case.facts["sensor"], facts["rows"]["sensor"]
        C = identity(self.n) if sensor is None else matrix(sensor["reads"], None, self.n)
        lag, seen = fmpq(0) if sensor is None else number(sensor["lag"]), lagged or x
        require(len(lagged) == (C.nrows() if lag > 0 else 0), "a lag needs a state for each measured quantity")
        if lag > 0:
            away = [k for k in range(self.s) if k not in (*x, *lagged)]
            near("the sensor", A, lagged, [*x, *lagged], blocks([[C, -identity(C.nrows())]]) * (1 / lag))
            near("the sensor", A, lagged, away)
            near("the sensor", J, lagged, range(self.s), fmpq_mat([one.tolist()[row] for row in lagged]))
            near("the sensor", free, lagged, [0], C * case.x0)
            near("the sensor", E, lagged, inputs)
        if count := len(case.measurement_errors()):
            require(count == C.nrows(), "each measured quantity has an error")
            own = [*x, *x_m, *r, *lagged]
            others = [row for row in range(self.s) if row not in own]
            jump = fmpq_mat([[J[row, at] for at in seen] for row in others])
            near("the sensor", self.W * (identity(count) if lag > 0 else C), others, range(len(seen)), jump)
            for part in (self.W, self.first_W):
                near("the sensor", part, own, range(count))
        for path in case.facts["inputs"]:
            late = abs(number(path["delay"]) - (self.whole + self.part) * self.T)
            require(late <= ROUNDING * (self.T + number(path["delay"])), "the delay of the loop must be that of the input")

    def over(self, t: fmpq, model: bool = False) -> tuple[arb_mat, arb_mat]:
        """e^(A t) and its integral times E. With ``model``, the same for A_m and b_r."""
        A, E = (self.A_m, self.b_r) if model else (self.A, self.E)
        rows = [[*a, *e] for a, e in zip(A.tolist(), E.tolist(), strict=True)]
        whole = (arb_mat([*rows, *([arb(0)] * len(rows[0]) for _ in range(E.ncols()))]) * arb(t)).exp().tolist()
        k = A.nrows()
        return arb_mat([row[:k] for row in whole[:k]]), arb_mat([row[k:] for row in whole[:k]])

    def unit(self, rows: Any) -> arb_mat:
        """The rows of z with these indices."""
        return arb_mat([[arb(int(i == j)) for j in range(self.size)] for i in rows])

    def wide(self, part: arb_mat) -> arb_mat:
        return arb_mat([row + [arb(0)] * (self.size - len(row)) for row in part.tolist()])

    def tall(self, part: arb_mat) -> arb_mat:
        return arb_mat([*part.tolist(), *([arb(0)] * part.ncols() for _ in range(self.size - self.s))])

    def bounds(self, r: list[arb], d: list[arb], w: list[arb], witness: dict[str, Any]) -> tuple[arb, arb, arb]:
        """Bounds on x - x_m under the sampled command, on x and on u."""
        shared, switch = witness["bends"], self.part * self.T
        require(isinstance(shared, int) and shared > 0, "the witness must give the number of parts that share a bound on x''")
        times = sorted({fmpq(k, PARTS) * self.T for k in range(PARTS + 1)} | {switch})
        X, model, R = self.unit(range(self.s)), self.unit(self.x_m), self.unit(self.r)
        blocks, parts = [[X, model]], list[tuple[fmpq, fmpq, bool]]()
        for k, (begin, end) in enumerate(pairwise(times)):
            v, h = self.before if end <= switch else self.now, end - begin
            if starts := k % shared == 0 or begin == switch:  # x'' grows by at most e^(|A| t) while v is constant
                since, bends = begin, (self.A * (self.A * X + self.E * v), self.A_m * (self.A_m * model + self.b_r * R))
            (moved, pushed), (of_model, of_r) = self.over(h), self.over(h, model=True)
            X, model = moved * X + pushed * v, of_model * model + of_r * R
            blocks.append([X, model, *(bends if starts else ())])
            parts.append((h, end - since, starts))
        rows = list[list[arb]]()
        for state, follows, *curving in blocks:
            ends = arb_mat([state.tolist()[i] for i in self.x])
            rows += [*(ends - follows).tolist(), *ends.tolist(), *(row for one in curving for row in one.tolist())]
        sizes = iter(self.sizes(arb_mat([*rows, *self.wide(self.C).tolist()]), r, d, w, witness))

        def take(count: int) -> list[arb]:
            return [next(sizes) for _ in range(count)]

        away, far = [take(self.n)], [take(self.n)]
        held, x = list(away[0]), list(far[0])
        for h, time, starts in parts:
            away.append(take(self.n))
            far.append(take(self.n))
            if starts:
                bent, bent_model = column_of(take(self.s)), column_of(take(self.n))
            curve = grown(self.A, time) * bent * (arb(h) ** 2 / 8)
            curve_model = grown(self.A_m, time) * bent_model * (arb(h) ** 2 / 8)
            for i, row in enumerate(self.x):
                bend = curve[row, 0]
                held[i] = held[i].max(away[-2][i].max(away[-1][i]) + bend + curve_model[i, 0])
                x[i] = x[i].max(far[-2][i].max(far[-1][i]) + bend)
        weights = self.weights(d) if d else []
        for i, row in enumerate(self.x) if d else ():
            within = sum((abs(self.reached[row, k]) * weight for k, weight in enumerate(weights)), arb(0))
            held[i], x[i] = held[i] + within, x[i] + within
        u = largest_of(take(self.m))
        return largest_of(held), largest_of(x), u

    def weights(self, d: list[arb]) -> list[arb]:
        """Weights of the columns of ``reached`` for disturbances of these sizes, by the trapezoidal rule."""
        assert self.B is not None
        off = grown(self.A, self.T) * absolute(self.A * self.A * self.B) * (arb(self.T) ** 3 / (12 * TRAPEZOIDS**2))
        each = [one * arb(self.T) / TRAPEZOIDS / (2 if k in (0, TRAPEZOIDS) else 1) for k in range(TRAPEZOIDS + 1) for one in d]
        return each + [sum((off[i, j] * one for j, one in enumerate(d)), arb(0)) for i in range(self.s)]

    def sizes(self, rows: arb_mat, r: list[arb], d: list[arb], w: list[arb], witness: dict[str, Any]) -> list[arb]:
        """The bound on every row of z by the theorem."""
        peaks, sums = [self.tall(self.free), self.tall(self.first - self.N)], [self.tall(self.N)]
        of_peaks, of_sums = [arb(1), *r, *w], [*r, *w]
        if w:
            apart = self.first_W - self.W if any(self.first_W.entries()) else self.first_W
            peaks, sums = [*peaks, self.tall(arb_mat(apart))], [*sums, self.tall(arb_mat(self.W))]
        if d:
            assert self.B is not None
            reached = [self.over(fmpq(k, TRAPEZOIDS) * self.T)[0] * self.B for k in range(TRAPEZOIDS + 1)]
            self.reached, weights = side_by_side([*reached, arb_mat(identity(self.s))]), self.weights(d)
            used = [k for k, weight in enumerate(weights) if k == 0 or weight.upper() > 0]
            sums.append(self.tall(self.J * arb_mat([[row[k] for k in used] for row in self.reached.tolist()])))
            of_sums += [weights[k] for k in used]
        P, share, samples = matrix(witness["P"], self.size, self.size), number(witness["share"]), witness["samples"]
        fits = isinstance(samples, int) and samples > 0 and 0 < share < 1 and positive_definite(P)
        require(fits, "the witness must give P > 0, a share between 0 and 1, and a number of samples")
        form = arb_mat(P)
        gap = form * arb(1 - share) - self.M.transpose() * form * self.M
        require(has_positive_pivots((gap + gap.transpose()) * (arb(1) / 2)), "M'PM must be below (1 - share) P")
        left, inverse = 1 - (1 - arb(share)).sqrt(), arb_mat(P.inv())  # 1 - beta
        reach = [((arb_mat([row]) * inverse * column_of(row))[0, 0]).sqrt() / left for row in rows.tolist()]
        with ctx.workprec(LEAST_BITS):
            largest, of_largest = self.followed(rows, side_by_side(peaks), form, samples, arb.max)
            summed, of_summed = self.followed(rows, side_by_side(sums), form, samples, arb.__add__)
        return [
            sum((w * (one + reach[i] * tail) for w, one, tail in zip(of_peaks, largest[i], of_largest, strict=True)), arb(0))
            + sum((w * (one + reach[i] * tail) for w, one, tail in zip(of_sums, summed[i], of_summed, strict=True)), arb(0))
            for i in range(rows.nrows())
        ]

    def followed(
        self, rows: arb_mat, s: arb_mat, form: arb_mat, samples: int, joined: Callable[[arb, arb], arb]
    ) -> tuple[list[list[arb]], list[arb]]:
        """|row M^k s| for k < samples, joined column by column, and the remainder of each column with its errors in |.|_P."""
        found = [[arb(0)] * s.ncols() for _ in range(rows.nrows())]
        error = [arb(0)] * s.ncols()
        for k in range(samples):
            if k % SAMPLES_BETWEEN_ROUNDINGS == 0:
                exact = s.mid()
                error = [(old + one).upper() for old, one in zip(error, sizes_of(s - exact, form), strict=True)]
                s = exact
            seen, s = (rows * s).tolist(), self.M * s
            found = [[joined(a, abs(b)) for a, b in zip(old, new, strict=True)] for old, new in zip(found, seen, strict=True)]
        return found, [old + one for old, one in zip(error, sizes_of(s, form), strict=True)]


def near(
    what: str, M: fmpq_mat, rows: Iterable[int], columns: Iterable[int], wanted: Any = None, scale: fmpq | arb | None = None
) -> None:
    """Require that these entries of M are the wanted ones, or zero, up to rounding relative to ``scale``."""
    size = arb(largest_entry(wanted) if wanted is not None and scale is None else scale or 0)
    for i, row in enumerate(rows):
        for j, at in enumerate(columns):
            off = arb(M[row, at]) - (arb(0) if wanted is None else arb(wanted[i, j]))
            require(bool(abs(off) <= size * arb(ROUNDING)), f"the matrices of the loop must agree with the case: {what}")


def largest_entry(M: Any) -> Any:
    return max(map(abs, M.entries()), default=fmpq(0))


def side_by_side(parts: list[arb_mat]) -> arb_mat:
    """Matrices with the same number of rows, side by side."""
    return arb_mat([[one for row in rows for one in row] for rows in zip(*(part.tolist() for part in parts), strict=True)])


def sizes_of(columns: arb_mat, P: arb_mat) -> list[arb]:
    """An upper bound on sqrt(s'Ps) for each column."""
    moved = (P * columns).tolist()
    squares = [sum((a[j] * b[j] for a, b in zip(columns.tolist(), moved, strict=True)), arb(0)) for j in range(columns.ncols())]
    return [arb(max(one.upper(), arb(0))).sqrt().upper() for one in squares]


def absolute(M: arb_mat) -> arb_mat:
    return arb_mat([[abs(one).upper() for one in row] for row in M.tolist()])


def grown(A: arb_mat, t: fmpq) -> arb_mat:
    """e^(|A| t)."""
    return (absolute(A) * arb(t)).exp()


def column_of(values: list[arb]) -> arb_mat:
    return arb_mat([[one] for one in values])


def largest_of(values: list[arb]) -> arb:
    return max((one.upper() for one in values), default=arb(0))


# --- A continuous linear loop: docs/proofs.md, "A continuous linear loop" -------------------------------------------------------


def linear_loop(c: Controller) -> tuple[fmpq_mat, fmpq_mat, fmpq_mat, dict[str, tuple[fmpq_mat, fmpq_mat]]]:
    """A, B for all signals at their sizes, z(0), and C and D of each bound. The rows of x and x_m are derived from the plant."""
    f, case, n, acting = c.fact("linear loop"), c.case, c.case.n, c.case.acting()
    sizes = [case.bound_of_signal(one) for one in (*case.facts["reference"], *(signal for _, signal in acting))]
    N, w, rows, k, start = len(f["A"]), len(sizes), [*f["x"], *f["x_m"]], f["states"], vector(f["start"], len(f["A"]))
    z, u, v = (
        blocks([[matrix(f[a], count, N), matrix(f[b], count, w)]]).tolist()
        for a, b, count in (("A", "B", N), ("C", "D", case.m), ("V", "V_w", case.m))
    )
    placed = all(isinstance(row, int) and 0 <= row < N for row in rows) and len({*rows}) == 2 * n == 2 * len(f["x"])
    whole = k == n or (case.facts["baseline"] is not None and 1 <= k < n)
    require(placed and whole, "x and x_m need rows of their own")
    for j, path in enumerate(case.facts["inputs"]):
        direct = [case.gain[j] * one for one in u[j]]
        if path["actuator"] is None and path["multiplicative"] is None:
            v[j] = direct
        require(path["actuator"] is None or v[j] != direct, "an actuator of the input must be in the loop")
    x, x_m = (fmpq_mat([[fmpq(int(i == j)) for j in range(N + w)] for i in f[name]]) for name in ("x", "x_m"))
    pulled = fmpq_mat(v) + fmpq_mat([case.theta[j :: case.m] for j in range(case.m)]) * x
    on_x = blocks([[zeros(n, N), case.enters, *(column(one) for one, _ in acting)]])
    on_x_m = blocks([[zeros(n, N), case.b_r, *(zeros(n, 1) for _ in acting)]])
    rates = [*(case.A_m * x + case.b * pulled + on_x).tolist(), *(case.A_m * x_m + on_x_m).tolist()]
    for row, rate, first in zip(rows, rates, case.x0.entries() * 2, strict=True):
        z[row], start[row] = rate, first

    def split(parts: list[list[fmpq]]) -> tuple[fmpq_mat, fmpq_mat]:
        of_w = [[one * size for one, size in zip(row[N:], sizes, strict=True)] for row in parts]
        return fmpq_mat([row[:N] for row in parts]), fmpq_mat(of_w)

    e, seen = (x - x_m).tolist()[:k], x.tolist()[:k]
    return *split(z), column(start), {"error_bound": split(e), "state_bound": split(seen), "control_bound": split(u)}


@rule("linear response")
def _linear_response(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """|y_i| <= sum_j ||y_i <- w_j|| + (|h_i(0)| + integral |h_i'|)/2, where h is the free response; u stays within its limits."""
    c.case.require_linear()
    quiet = c.case.facts["noise"] is None and not c.case.measurement_errors()
    require(quiet, "a measurement without noise and quantisation is needed")
    c.case.require_no("quantization", "rate_limit")
    require("sample_time" not in c.facts, "the controller must act continuously")
    require(c.fact("linear loop")["states"] == c.case.facts["states"], "e and x must contain every state of the plant")
    A, B, start, outputs = linear_loop(c)
    found, witness = dict[str, arb](), line["witness"]
    for name in outputs.keys() & witness.keys():
        C, D = outputs[name]
        each = [sum(row, arb(0)) for row in Norms(A, B, C, D, witness[name]).upper]
        if any(one != 0 for one in start.entries()):
            moving = Norms(A, start, C * A, zeros(C.nrows(), 1), witness[f"free {name}"]).upper
            each = [one + (abs(h) + rest[0]) / 2 for one, h, rest in zip(each, (C * start).entries(), moving, strict=True)]
        found[name] = largest_of(each)
    c.case.require_unlimited(found["control_bound"])
    of_e = "" if c.fact("linear loop")["states"] == c.case.n else "; e and x are its first states, before those of a baseline"
    c.case.assumed[f"the parts of controller, actuator and sensor in the linear loop are those of the case{of_e}"] = None
    c.proven["linear response"] = found


@rule("sampled response")
def _sampled_response(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """The bounds of the linear loop, while u stays within its limits."""
    case = c.case
    case.require_linear()
    require(all(path["rate_limit"] is None for path in case.facts["inputs"]), "the input has a rate limit")
    case.assumed["the controller's and the actuator's parts of the loop from sample to sample are those of the case"] = None
    loop, w = SampledLoop(c), list(map(arb, case.measurement_errors()))
    d = [arb(case.bound_of_signal(one)) for _, one in case.acting()]
    d += [arb(abs(number(path["quantization"])) / 2) for path in case.facts["inputs"] if path["quantization"] is not None]
    columns = 0 if loop.B is None else loop.B.ncols()
    require(columns == len(d), "B must have a column for each disturbance and converter")
    loop.require_plant(c)
    held, x, u = loop.bounds(case.command_bounds(), d, w, line["witness"])
    case.require_unlimited(u)
    c.proven["sampled"] = {"error_bound_held": held, "state_bound": x, "control_bound": u}


@rule("error_bound_held", "state_bound")
def _sampled_bound(c: Controller, value: Any, line: dict[str, Any]) -> None:
    at_least(value, c.earlier("sampled" if c.scheme == "sampled" else "linear response")[line["key"]], line["key"])


def steepest(signal: dict[str, Any]) -> fmpq:
    """The largest slope of a sine or of a sum of sines; 0 for other commands, whose slope is assumed."""
    if signal["kind"] not in ("sine", "sines"):
        return fmpq(0)
    ways = zip(vector(signal["amplitudes"]), vector(signal["frequencies"]), strict=True)
    return sum((abs(size * frequency) for size, frequency in ways), fmpq(0)) * (1 - ROUNDING)


def require_jumps(signal: dict[str, Any], T: fmpq, jump: fmpq, apart: fmpq | None) -> None:
    """Require that jumps of a square wave are not larger and not closer than stated, unless all of them are at samples."""
    if signal["kind"] != "square":
        return
    half = arb.pi() / arb(number(signal["frequencies"][0]))
    begin = arb(number(signal["phases"][0])) / arb.pi() * half
    if all(abs(one / arb(T) - (one / arb(T)).mid().floor() - arb("0.5")) > arb("0.5") - arb(ROUNDING) for one in (half, begin)):
        return
    require(jump >= 2 * abs(number(signal["amplitudes"][0])) * (1 - ROUNDING), "the jumps of the square wave are larger")
    require(apart is None or bool(arb(apart) <= half * arb(1 + ROUNDING)), "the jumps of the square wave are closer")


def of_sampled_loop(c: Controller) -> arb:
    """The bound with the model's motion between samples added."""
    total: arb = c.earlier("sampled")["error_bound_held"]
    T = arb(number(c.fact("sampled")["T"]))
    W, sW = c.norm("W_r").upper, c.norm("sW_r").upper
    for j, (r, between) in enumerate(zip(c.case.command_bounds(), c.fact("between"), strict=True)):
        whole, rate = largest_of([row[j] for row in W]), largest_of([row[j] for row in sW])
        found = 2 * r * whole
        if between is not None:
            slope, jump = number(between["slope"]), number(between["jump"])
            apart = None if between["apart"] is None else number(between["apart"])  # None for a single jump
            said = "" if jump == 0 else f", jumps between samples of at most {text(jump)}"
            said += f", {text(apart)} s apart" if jump != 0 and apart is not None else ", one in all" if jump != 0 else ""
            c.case.assumed[
                f"up to t_end command {j + 1} has a slope of at most {text(slope)}{said or ' and no jump between samples'}"
            ] = None
            require(slope >= steepest(c.case.facts["reference"][j]) and jump >= 0, "a command must not be steeper than stated")
            require_jumps(c.case.facts["reference"][j], number(c.fact("sampled")["T"]), jump, apart)
            require(jump == 0 or apart is None or arb(apart) > T, "jumps must be more than a sample apart")
            of_next = arb(0) if apart is None else whole / (arb(apart) - T)
            found = found.min(whole * arb(slope) * T + arb(jump) * T * (rate + of_next) if jump != 0 else whole * arb(slope) * T)
        total += found
    return total


ERROR_BOUNDS["sampled"] = of_sampled_loop


# --- A Lyapunov function of the law's author: docs/proofs.md, "A Lyapunov function of your own" --------------------------------


class Law:
    """The law of the file with the plant (1) and the model (2), where phi(x) has any value.

    Every rate is a polynomial over ``below``, which is positive. The rates of e and x follow from the case.
    """

    def __init__(self, c: Controller) -> None:
        facts, case = c.fact("law"), c.case
        inputs, p = range(case.m), len(case.theta)
        sizes = {"e": case.n, "x": case.n, "r": case.k_0.ncols(), "theta": p}
        named = {name: [f"{name}_{i + 1}" for i in range(size)] for name, size in sizes.items()}
        self.e, self.x, self.r, self.theta = named.values()
        self.state, self.phi, self.of = list(facts["state"]), facts["phi"], facts["functions"]
        normals = [name for one in facts["normals"] for name in one["n"]]
        free = [name for one in c.fact("nonnegative") for part in (one["v"], *one["F"]) for name in part]
        names = [*self.e, *self.x, *self.r, *self.theta, *self.state, *self.phi, *self.of, *normals, *free]
        require(len(set(names)) == len(names), "every variable needs a name of its own")
        require(len(self.phi) * case.m == (0 if case.linear else p), "phi needs a name for each component, unless phi(x) = x")
        self.normals, self.places = normals, {name: i for i, name in enumerate(names)}
        self.context = fmpq_mpoly_ctx.get([f"v{i}" for i in range(len(names))], Ordering.degrevlex)
        self.gens = dict(zip(names, self.context.gens(), strict=True))
        self.one, self.zero = self.context.constant(1), self.context.constant(0)
        require(
            list(facts["rates"]) == self.state and len(facts["control"]) == case.m, "a rate of each part of the state is needed"
        )
        given = {name: self.fraction(one) for name, one in (*facts["rates"].items(), *enumerate(facts["control"]))}
        self.below = self.one
        for _, below in given.values():
            self.below *= below // below.gcd(self.below)
        require(self.bounded_below(self.below), "a denominator must be a positive number plus even powers")
        over = {name: above * (self.below // below) for name, (above, below) in given.items()}
        hidden = {name for one in over.values() for name in self.used(one * self.below)} & {*self.theta, *free}
        require(not hidden, "the law must not depend on theta or on the variables of a matrix that stays nonnegative")
        self.u, self.rates = [over.pop(j) for j in inputs], over
        phi = self.x if case.linear else self.phi
        acts = [self.sum((phi[k // case.m], self.theta[k]) for k in range(j, p, case.m)) * self.below + self.u[j] for j in inputs]
        pushed = [self.below * self.linear(case.k_0.tolist()[j], self.r) for j in inputs]
        for i, (row, b) in enumerate(zip(case.A_m.tolist(), case.b.tolist(), strict=True)):
            self.rates[self.x[i]] = self.below * self.linear(row, self.x) + sum((b[j] * acts[j] for j in inputs), self.zero)
            moved = sum((b[j] * (acts[j] - pushed[j]) for j in inputs), self.zero)
            self.rates[self.e[i]] = self.below * self.linear(row, self.e) + moved

    def linear(self, factors: list[fmpq], names: list[str]) -> fmpq_mpoly:
        return sum((self.gens[name] * factor for factor, name in zip(factors, names, strict=True)), self.zero)

    def sum(self, products: Iterable[Iterable[str]]) -> fmpq_mpoly:
        """The sum of products of variables."""
        total = self.zero
        for names in products:
            one = self.one
            for name in names:
                one *= self.gens[name]
            total += one
        return total

    def poly(self, terms: dict[str, Any]) -> fmpq_mpoly:
        """The polynomial with these coefficients of monomials such as "e_1 x_2^2"; "1" is the constant."""
        found = dict[tuple[int, ...], fmpq]()
        for monomial, factor in terms.items():
            powers = [0] * len(self.places)
            for name, _, power in (part.partition("^") for part in monomial.split() if monomial != "1"):
                require(re.fullmatch(r"\d{0,2}", power) is not None, f"{monomial} is not a monomial")
                powers[self.places[name]] += int(power or 1)
            require(tuple(powers) not in found, f"{monomial} occurs twice")
            found[tuple(powers)] = number(factor)
        return self.context.from_dict(found)

    def fraction(self, facts: dict[str, Any]) -> tuple[fmpq_mpoly, fmpq_mpoly]:
        return self.poly(facts["above"]), self.poly(facts.get("below", {"1": 1}))

    def at_zero(self, poly: fmpq_mpoly) -> fmpq:
        return poly[(0,) * len(self.places)]

    def bounded_below(self, poly: fmpq_mpoly) -> bool:
        """Whether it is a positive constant plus even powers with positive coefficients."""
        terms = poly.to_dict().items()
        return self.at_zero(poly) > 0 and all(factor > 0 and not any(one % 2 for one in powers) for powers, factor in terms)

    def used(self, poly: fmpq_mpoly) -> set[str]:
        return {name for name, degree in zip(self.places, poly.degrees(), strict=True) if degree > 0}

    def rests_on(self, poly: fmpq_mpoly) -> set[str]:
        """The variables that occur in it or in its functions."""
        left, found = list(self.used(poly)), set[str]()
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left += self.x if name in self.phi else self.of.get(name, [])
        return found - set(self.of) - set(self.phi)

    def slope(self, poly: fmpq_mpoly, name: str) -> fmpq_mpoly:
        return poly.derivative(self.places[name])

    def replaced(self, poly: fmpq_mpoly, by: dict[str, fmpq_mpoly]) -> fmpq_mpoly:
        return poly.compose(*(self.gens | by).values(), ctx=self.context)

    def along(self, poly: fmpq_mpoly) -> fmpq_mpoly:
        """``below`` times the derivative along the motion of the loop."""
        moving = self.used(poly) - set(self.theta)
        require(moving <= self.rates.keys(), "only the state, e, x and theta may occur in what is differentiated")
        return sum((self.slope(poly, name) * self.rates[name] for name in moving), self.zero)

    def reduced(self, above: fmpq_mpoly, below: fmpq_mpoly) -> tuple[fmpq_mpoly, fmpq_mpoly]:
        """The reduced fraction of a positive ``below``, with a denominator that is 1 at zero and hence positive."""
        shared = above.gcd(below)
        above, below = above // shared, below // shared
        at_zero = self.at_zero(below)
        return above * (1 / at_zero), below * (1 / at_zero)

    def require_squares(self, poly: fmpq_mpoly, witness: dict[str, Any]) -> None:
        """Require that it is q'G q with G >= 0."""
        q, total = [self.poly(one) for one in witness["basis"]], self.zero
        if q:
            G = matrix(witness["G"], len(q), len(q))
            require(positive_semidefinite(G), "the matrix of a sum of squares must be positive semidefinite")
            for one, row in zip(q, G.tolist(), strict=True):
                total += one * sum((a * b for a, b in zip(row, q, strict=True)), self.zero)
        require(total == poly, "the squares do not add up to the polynomial")


class OwnV:
    """V = z'M z with z = (e, s - L theta), for which V' <= -W."""

    def __init__(self, c: Controller, witness: dict[str, Any]) -> None:
        c.case.require_nominal()
        c.case.require_regular()
        require(c.case.interval is None and c.case.theta_0 is None, "the input's gain must be known, and there is no baseline")
        require("sample_time" not in c.facts, "the controller must act continuously")
        c.case.assumed["the polynomials of the law, its functions, normals and initial values are those of the controller"] = None
        if c.fact("law")["normals"]:
            c.case.assumed["rates - gain n of projected estimates, as they stand in the file, do not leave the known set"] = None
        self.c, self.law, facts = c, Law(c), c.fact("V")
        law, size = self.law, len(facts["of"])
        self.s = facts["of"]
        require(set(self.s) <= set(law.state) and len(set(self.s)) == size, "V contains parts of the state")
        self.M = matrix(facts["M"], len(law.e) + size, len(law.e) + size)
        self.L = matrix(facts["L"], size, len(law.theta))
        require(positive_definite(self.M), "V must be positive definite in e and in its part of the state")
        self.inverse = self.M.inv()
        self.start = {name: number(value) for name, value in c.fact("law")["state"].items()}
        self.by = self._nonnegative(self._zero(), witness["nonnegative"])
        off = [law.gens[name] - law.linear(row, law.theta) for name, row in zip(self.s, self.L.tolist(), strict=True)]
        z, rates = [law.gens[name] for name in law.e] + off, [law.rates[name] for name in (*law.e, *self.s)]
        rows = zip(z, self.M.tolist(), strict=True)
        motion = sum((one * 2 * sum((a * b for a, b in zip(row, rates, strict=True)), law.zero) for one, row in rows), law.zero)
        self.falls = self.substituted(-self._without_normals(motion))
        self.below, self.W = self.substituted(law.below), self.substituted(law.poly(facts["W"]))
        self._require_motion()
        self.nonnegative(self.W, law.one, witness["W"])
        self.how = self._decay(witness["decay"])

    def substituted(self, poly: fmpq_mpoly) -> fmpq_mpoly:
        return self.law.replaced(poly, self.by)

    def _zero(self) -> dict[str, fmpq_mpoly]:
        """Parts of the state by the quantities that are zero at t = 0 and stay so."""
        law, found = self.law, dict[str, fmpq_mpoly]()
        initial = self.start | dict(zip(law.x, self.c.case.x0.entries(), strict=True)) | dict.fromkeys(law.e, fmpq(0))
        at_start = {name: law.context.constant(value) for name, value in initial.items()}
        relations = [law.poly(one) for one in self.c.fact("zero")]
        for relation in relations:
            require(law.replaced(relation, at_start).is_zero(), "a quantity that stays zero is not zero at t = 0 for every theta")
            left = law.replaced(relation, found)
            if left.is_zero():
                continue
            slopes = {name: law.slope(left, name) for name in law.state}
            name = next((one for one, slope in slopes.items() if slope.is_constant() and not slope.is_zero()), None)
            if name is None:
                raise Refused("a quantity that stays zero must determine a part of the state")
            value = law.gens[name] - left * (1 / law.at_zero(slopes[name]))
            found = {other: law.replaced(one, {name: value}) for other, one in found.items()} | {name: value}
        stay = all(law.replaced(law.along(relation), found).is_zero() for relation in relations)
        require(stay, "the rate of a quantity that stays zero must vanish with these quantities")
        return found

    def _nonnegative(self, solved: dict[str, fmpq_mpoly], witness: list[Any]) -> dict[str, fmpq_mpoly]:
        """What is substituted: the parts that are solved for, R = F F', and s + L theta for s."""
        law, factors = self.law, dict[str, fmpq_mpoly]()
        for facts, squares in zip(self.c.fact("nonnegative"), witness, strict=True):
            R, v, F, size = facts["R"], facts["v"], facts["F"], range(len(facts["R"]))
            square = len(v) == len(F) == len(size) and all(len(row) == len(size) for row in (*R, *F))
            own = {name for row in R for name in row}
            require(
                square and own <= set(law.state) and len(own) == len(size) ** 2, "R must be a square matrix of distinct states"
            )
            require(not own & factors.keys(), "a part of the state may be in one R only")
            start = fmpq_mat([[self.start[name] for name in row] for row in R])
            require(positive_semidefinite(start), "R must be positive semidefinite at t = 0")
            shared = law.slope(law.rates[R[0][0]], R[0][0])
            S = [[law.replaced(law.rates[name] - shared * law.gens[name], solved) for name in row] for row in R]
            require(all(S[i][j] == S[j][i] for i in size for j in size), "R must stay symmetric")
            form = sum((law.sum([(v[i], v[j])]) * S[i][j] for i in size for j in size), law.zero)
            above, below = law.reduced(form, law.replaced(law.below, solved))
            require(not law.used(above * below) & own, "R' must be c R + S, where S does not depend on R")
            law.require_squares(above * below, squares)
            factors |= {R[i][j]: law.sum((F[i][k], F[j][k]) for k in size) for i in size for j in size}
        require(not (solved.keys() | factors.keys()) & set(self.s), "V must not contain what stays zero or nonnegative")
        moved = zip(self.s, self.L.tolist(), strict=True)
        after = factors | {name: law.gens[name] + law.linear(row, law.theta) for name, row in moved}
        return after | {name: law.replaced(value, after) for name, value in solved.items()}

    def _without_normals(self, motion: fmpq_mpoly) -> fmpq_mpoly:
        """V' without -k (theta_hat - theta)'n, where n is an outward normal of the known set at theta_hat, which is in it."""
        law, lowers = self.law, set[str]()
        for one in self.c.fact("law")["normals"]:
            of, n, known, k = one["of"], one["n"], self.c.require_theta_known(), list[fmpq]()
            alone = self._require_projection(of, n, matrix(one["gain"], len(law.theta), len(law.theta)), known)
            require(not lowers & set(of), "a part of the state may be projected once only")
            for name, normal, true in zip(of, n, law.theta, strict=True):
                slope = law.slope(motion, normal)
                k.append(law.at_zero(law.slope(slope, true)) / law.at_zero(law.below))
                falls = slope == law.below * (law.gens[true] - law.gens[name]) * k[-1]
                require(falls and k[-1] >= 0, "the projection must lower V")
                lowers |= {name} if k[-1] > 0 else set()
            require(alone or len(set(k)) == 1, "V must weight all parameters in the same way as the gain of the projection")
        require(set(self.c.fact("law")["limited"]) <= lowers, "estimates that are kept in the known set must be projected")
        return law.replaced(motion, dict.fromkeys(law.normals, law.zero))

    def _require_projection(self, of: list[str], n: list[str], gain: fmpq_mat, known: Box | Ball) -> bool:
        """Require that n occurs as -gain n in the rates of theta_hat, and in no other rate of e, x and V nor in u, so that
        theta_hat stays in the set. Return whether each theta_tilde_i n_i >= 0."""
        law, p = self.law, len(self.law.theta)
        limited = set(self.c.fact("law")["limited"])
        require(len(of) == len(set(of)) == len(n) == p and set(of) <= set(law.state), "what is projected must have theta's size")
        require(known.holds([self.start[name] for name in of]), "theta_hat(0) must lie in the set that is projected onto")
        require(positive_definite(gain), "the gain of a projection must be positive definite")
        require(not limited & set(of) or set(of) <= limited, "all projected estimates or none are kept in the known set")
        for name, row in zip(of, gain.tolist(), strict=True):
            as_returned = all(law.slope(law.rates[name], one) == -law.below * K for one, K in zip(n, row, strict=True))
            require(as_returned, "the rates of projected estimates must be those of the projection: n occurs as -gain n only")
        others = [law.rates[name] for name in (*law.e, *law.x, *self.s) if name not in of]
        require(not any(law.used(one) & set(n) for one in (*others, *law.u)), "a normal may act on projected estimates only")
        couples = any(K != 0 for i, row in enumerate(gain.tolist()) for j, K in enumerate(row) if i != j)
        require(not couples or known.faces <= 4, "with a gain matrix the projection may make V grow in corners")
        return isinstance(known, Box) and not couples

    def _require_motion(self) -> None:
        """Require that no part of the state escapes in finite time: group by group their rates are linear in them."""
        law = self.law
        left = set(law.state) - set(self.s)
        while left:
            group = set(left)
            while bad := {name for name in group if not self._is_linear(name, group, left)}:
                group -= bad
            require(len(group) > 0, "a part of the state outside V may escape in finite time")
            left -= group

    def _is_linear(self, name: str, group: set[str], left: set[str]) -> bool:
        law = self.law
        above, below = law.reduced(law.rates[name], law.below)
        used, places = law.used(above), [law.places[one] for one in group]
        functions = [law.gens[one] for one in (used | law.used(below)) & set(law.of)]
        beyond = (used & left) - group | law.used(below) & left | {one for f in functions for one in law.rests_on(f) & left}
        beyond |= used & set(law.normals)  # which may grow with the projected rate
        return not beyond and all(sum(powers[i] for i in places) <= 1 for powers in above.to_dict())

    def _decay(self, witness: dict[str, Any] | None) -> str:
        """What is shown about V'."""
        if witness is None:
            require(self.falls == self.W * self.below, "V' must be -W identically")
            return "V' = -W identically"
        shares = {fmpq(0): ""} if self.W.is_zero() else {fmpq(1): " - W", 1 - fmpq(1, 2**20): " - (1 - 2^-20) W"}
        share = number(witness["share"])
        require(share in shares, "the share of W is 1 or 1 - 2^-20")
        return f"-V'{shares[share]} is {self.nonnegative(self.falls - self.below * self.W * share, self.below, witness)}"

    def nonnegative(self, above: fmpq_mpoly, below: fmpq_mpoly, witness: dict[str, Any]) -> str:
        """Require above/below >= 0, everywhere or for every theta of the known set; return how it is shown."""
        above, _ = self.law.reduced(above, below)
        if "cells" not in witness:
            self.law.require_squares(above, witness)
            return "a sum of squares"
        cells = list[Box]()

        def of_cell(cell: Box, leaf: dict[str, Any]) -> arb:
            cells.append(cell)
            self._require_on_cell(above, cell, leaf["squares"])
            return arb(0)

        over_cells(self.box(), witness["cells"], of_cell)
        return f"a sum of squares {f'on each of {len(cells)} cells of' if len(cells) > 1 else 'over'} the known set"

    def box(self) -> Box:
        """The smallest box around the known set."""
        known = self.c.require_theta_known()
        return known if isinstance(known, Box) else known.around()

    def _require_on_cell(self, poly: fmpq_mpoly, cell: Box, squares: list[Any]) -> None:
        """Require that every Bernstein coefficient in theta is a sum of squares."""
        law = self.law
        ends = zip(law.theta, cell.lower, cell.upper, strict=True)
        unit = law.replaced(poly, {name: law.gens[name] * (b - a) + law.context.constant(a) for name, a, b in ends})
        places = [law.places[name] for name in law.theta]
        degrees = [int(unit.degrees()[i]) for i in places]
        for index, one in zip(product(*(range(degree + 1) for degree in degrees)), squares, strict=True):
            found = dict[tuple[int, ...], fmpq]()
            for powers, factor in unit.to_dict().items():
                here = [powers[i] for i in places]
                share = fmpq(1)
                for k, power, degree in zip(index, here, degrees, strict=True):
                    share *= fmpq(comb(k, power), comb(degree, power))  # 0 if power > k
                rest = tuple(0 if i in places else power for i, power in enumerate(powers))
                found[rest] = found.get(rest, fmpq(0)) + factor * share
            law.require_squares(law.context.from_dict(found), one)

    def level(self, theta: Iterable[fmpq]) -> fmpq:
        """V(0); e(0) = 0."""
        off = column([self.start[name] for name in self.s]) - self.L * column(list(theta))
        return quadratic(blocks([[zeros(len(self.law.e), 1)], [off]]), self.M)

    def largest_level(self) -> fmpq:
        """The largest V(0) over the box around the known set, which is at a vertex: V is convex in theta."""
        box = self.box()
        require(sum(a < b for a, b in zip(box.lower, box.upper, strict=True)) <= 12, "the box has too many vertices")
        return max(self.level(one) for one in product(*(sorted({a, b}) for a, b in zip(box.lower, box.upper, strict=True))))

    def bound(self, rows: Iterable[int], level: fmpq) -> arb:
        """|z_i| <= sqrt((M^-1)_ii V(0))."""
        return root(max(self.inverse[i, i] for i in rows) * level)

    def bound_of_e(self, level: fmpq) -> arb:
        return self.bound(range(len(self.law.e)), level)


@rule("lyapunov_decay")
def _lyapunov_decay(c: Controller, value: Any, line: dict[str, Any]) -> None:
    require(c.scheme == "own V", "there is no rule for this scheme")
    found = OwnV(c, line["witness"])
    require(value == found.how, f"it is shown that {found.how}")
    c.proven["lyapunov_decay"] = found


ERROR_BOUNDS["own V"] = lambda c: (V := c.earlier("lyapunov_decay")).bound_of_e(V.level(c.case.theta))


@rule("estimates_error_bound")
def _estimates_error_bound(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """The bound applies to the estimates s_i for which s_i - (L theta)_i is s_i - theta_j."""
    V, n = c.earlier("lyapunov_decay"), c.case.n
    unit = [fmpq(0)] * (len(c.case.theta) - 1) + [fmpq(1)]
    of_theta = zip(V.s, V.L.tolist(), strict=True)
    rows = [n + i for i, (name, row) in enumerate(of_theta) if name in c.fact("law")["estimates"] and sorted(row) == unit]
    require(len(rows) > 0, "V must contain estimates of theta")
    at_least(value, V.bound(rows, V.level(c.case.theta)), "the bound of the estimates")


@rule("error_limit")
def _error_limit(c: Controller, value: Any, line: dict[str, Any]) -> None:
    """e is square integrable and e' is bounded, so e converges to zero."""
    c.earlier("lyapunov")
    require("L" not in c.facts, "P must be a Lyapunov matrix of A_m")
    V, witness = c.earlier("lyapunov_decay"), line["witness"]
    law, share = V.law, number(witness["share"])
    at_least(value, fmpq(0), "the limit of |e|")
    require(share > 0, "the share of |e|^2 must be positive")
    V.nonnegative(V.falls - V.below * law.sum((name, name) for name in law.e) * share, V.below, witness)
    bounded, parts = {*law.e, *law.x, *law.r, *V.s}, [part for one in law.u for part in law.reduced(one, law.below)]
    require(all(law.rests_on(part) <= bounded for part in parts), "u must depend only on x, r and what V contains")


# --- The program ----------------------------------------------------------------------------------------------------------------


def accepted_lines(name: str, controller: Controller, lines: list[dict[str, Any]]) -> list[str]:
    """The claimed keys, each with its value if that is a number, if all lines hold."""
    for i, line in enumerate(lines, start=1):
        key = str(line.get("key"))
        try:
            require(key in RULES, "no rule has this name")
            RULES[key](controller, line.get("value"), line)
        except Refused as error:
            raise Refused(f"{name}, line {i}, {key}: {error}") from error
        except (ArithmeticError, AttributeError, KeyError, IndexError, RecursionError, TypeError, ValueError) as error:
            raise Refused(f"{name}, line {i}, {key}: it can't be read ({type(error).__name__}: {error})") from error
    return [said_of(line["key"], line.get("value")) for line in lines if line.get("claimed") is True]


def said_of(key: str, value: Any) -> str:
    return f"{key} = {value!r}" if isinstance(value, (int, float)) and not isinstance(value, bool) else key


def check(document: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Sentences on the accepted claims of each controller, and the assumptions. Refused names the first line that fails."""
    require(document.get("format") == FORMAT, f"the file is not a {FORMAT}")
    parts = {"format", "case", "only if", "plant", "controllers"}
    require(document.keys() == parts, f"the file must contain: {', '.join(sorted(parts))}")
    said, assumed = [f"case: {document['case']}"], dict[str, None]()
    with ctx.workprec(256):
        for name, facts in document["controllers"].items():
            accepted = list[str]()
            if facts["lines"]:
                case = Case(document["plant"])
                accepted = accepted_lines(name, Controller(case, facts["facts"]), facts["lines"])
                assumed |= case.assumed
            said.append(f"{name}: accepted: {', '.join(accepted) or 'nothing is claimed'}")
            said += [f"{name}: not in the proof: {sentence}" for sentence in facts["not in the proof"]]
    said += [f"what is accepted holds only if {sentence}" for sentence in document["only if"]]
    return said, list(assumed)


def without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    require(len(found) == len(pairs), "a key is repeated in one object")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Check a file. The exit code is 0 if all lines hold, 1 if a line does not, and 2 if the file can't be read."""
    given = sys.argv[1:] if arguments is None else arguments
    if len(given) != 1 or given[0].startswith("-"):
        say("usage: barbalat-check FILE\n\n" + (__doc__ or "").strip())
        return 0 if given in (["-h"], ["--help"]) else 2
    try:
        text_of_file = Path(given[0]).read_text(encoding="utf-8")
        document = json.loads(text_of_file, parse_constant=number, object_pairs_hook=without_repetition)
    except (OSError, ValueError, RecursionError, Refused) as error:
        print(f"{given[0]}: {error}", file=sys.stderr)
        return 2
    try:
        said, assumed = check(document)
    except (Refused, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        say(f"refused: {error}")
        return 1
    said += [f"assumed, and not derived from numbers: {sentence}" for sentence in assumed]
    say("\n".join([*said, "all lines hold"]))
    return 0


def say(text: str) -> None:
    """Print, also if the reader of a pipe has gone."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
