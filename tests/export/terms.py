"""Terms over floats: only the facts of IEEE 754 on signs, on the order of two operands and on comparisons are used.

+ * / sqrt, sin, ... are uninterpreted functions, so two terms are equal only if they have the same operations with the same
operands.
"""

from __future__ import annotations

import math
import operator
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

TRUTH = frozenset({"lt", "le", "eq", "not", "and", "or", "flag", "true"})
FOLDED = {"add": operator.add, "mul": operator.mul, "div": operator.truediv}
SOLVER_SECONDS = 120


@dataclass(eq=False)
class Terms:
    """The terms. Each is stored once with a number. ``numbers`` is the type in which constants are computed."""

    numbers: type[np.floating]
    nodes: list[tuple[object, ...]] = field(default_factory=list)
    places: dict[tuple[object, ...], int] = field(default_factory=dict)

    def make(self, *node: object) -> int:
        if node not in self.places:
            self.places[node] = len(self.nodes)
            self.nodes.append(node)
        return self.places[node]

    def input(self, base: str, offset: int, *, kind: str = "input") -> int:
        """An arbitrary number or, with the kind "flag", an arbitrary truth value."""
        return self.make(kind, base, str(offset))

    def constant(self, value: float) -> int:
        """A constant by its bits. A negative one is the negation of a positive one."""
        with np.errstate(over="ignore"):
            value = float(self.numbers(value))
        made = self.make("constant", "nan" if math.isnan(value) else abs(value).hex())
        return self.make("neg", made) if math.copysign(1.0, value) < 0 else made

    def value(self, term: int) -> float | None:
        """The value of a constant."""
        node = self.nodes[term]
        if node[0] == "neg":
            inner = self.value(node[1])
            return None if inner is None else -inner
        return float.fromhex(node[1]) if node[0] == "constant" else None

    def neg(self, x: int) -> int:
        node = self.nodes[x]
        if node[0] == "neg":
            return node[1]
        return self._within_choice(self.neg, x) or self.make("neg", x)

    def of(self, name: str, *x: int) -> int:
        """The term of add, mul or div. It is the value for constants and the product for a division by a power of two. x + -0, x
        1 and x/1 are x."""
        if (found := self._within_choice(lambda *at: self.of(name, *at), *x)) is not None:
            return found
        values = [self.value(one) for one in x]
        if None not in values:
            with np.errstate(all="ignore"):
                return self.constant(float(FOLDED[name](*map(self.numbers, values))))
        if name == "div" and values[1] and math.frexp(values[1])[0] in (0.5, -0.5) and 2.0**-100 < abs(values[1]) < 2.0**100:
            return self.of("mul", x[0], self.constant(1 / values[1]))
        for one, other in ((0, 1), (1, 0)) if name != "div" else ((0, 1),):
            if name == "add" and values[other] == 0 and math.copysign(1, values[other]) < 0:
                return x[one]
            if name == "mul" and values[other] in (1.0, -1.0):
                return x[one] if values[other] > 0 else self.neg(x[one])
        if name == "add":
            return self.make(name, *sorted(x))
        plain = [self.nodes[one][1] if self.nodes[one][0] == "neg" else one for one in x]
        made = self.make(name, *(plain if name == "div" else sorted(plain)))
        return self.neg(made) if (plain[0] != x[0]) != (plain[1] != x[1]) else made

    def _within_choice(self, made: Callable[..., int], *x: int) -> int | None:
        """An operation on constants and one choice between two constants, as the choice between the two results."""
        chosen = [i for i, one in enumerate(x) if self.value(one) is None]
        if len(chosen) != 1 or self.nodes[x[chosen[0]]][0] != "ite":
            return None
        _, c, yes, no = self.nodes[x[chosen[0]]]
        if None in (self.value(yes), self.value(no)):
            return None
        both = [made(*x[: chosen[0]], one, *x[chosen[0] + 1 :]) for one in (yes, no)]
        return self.chosen(c, *both) if self.nodes[both[0]][0] not in TRUTH else self.either(c, *both)

    def either(self, c: int, yes: int, no: int) -> int:
        """A choice between two truth values."""
        denied = self.negated
        return denied(self.both(denied(self.both(c, yes)), denied(self.both(denied(c), no))))

    def compare(self, name: str, a: int, b: int) -> int:
        if (found := self._within_choice(lambda *at: self.compare(name, *at), a, b)) is not None:
            return found
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            true = self.make("true")
            return true if {"lt": x < y, "le": x <= y, "eq": x == y}[name] else self.negated(true)
        if name == "lt" and y == 0 and self.never_below_zero(a):
            return self.negated(self.make("true"))
        return self.make(name, *(sorted((a, b)) if name == "eq" else (a, b)))

    def never_below_zero(self, term: int) -> bool:
        """Whether a term is at least zero or NaN, as magnitudes, squares and their sums and products are."""
        name, *x = self.nodes[term]
        if name in ("add", "mul"):
            return all(map(self.never_below_zero, x)) or (name == "mul" and x[0] == x[1])
        if name == "ite":
            return all(map(self.never_below_zero, x[1:]))
        return name in ("fabs", "sqrt", "constant")

    def negated(self, c: int) -> int:
        node = self.nodes[c]
        return node[1] if node[0] == "not" else self.make("not", c)

    def chosen(self, c: int, yes: int, no: int) -> int:
        if yes == no or self.nodes[c] == ("true",):
            return yes
        if self.nodes[c][0] == "not":
            return self.chosen(self.nodes[c][1], no, yes)
        return self.make("ite", c, yes, no)

    def both(self, a: int, b: int) -> int:
        true = self.make("true")
        if (never := self.make("not", true)) in (a, b) or a == self.negated(b):
            return never
        first = list({one for one in (a, b) if one != true})
        return self.make("and", *sorted(first)) if len(first) == 2 else (first or [true])[0]

    def below(self, *terms: int) -> list[int]:
        """These terms and all their operands, with operands first."""
        found: set[int] = set()
        waiting = list(terms)
        while waiting:
            term = waiting.pop()
            if term not in found:
                found.add(term)
                waiting += [x for x in self.nodes[term][1:] if isinstance(x, int)]
        return sorted(found)

    def differ(self, pairs: list[tuple[int, int]]) -> bool:
        """Whether z3 finds functions and values for which the two terms of a pair differ."""
        pairs = [(a, b) for a, b in pairs if a != b]
        if not pairs:
            return False
        text = self._script(pairs)
        done = subprocess.run(["z3", "-in", f"-T:{SOLVER_SECONDS}"], input=text, capture_output=True, text=True, check=False)
        assert done.stdout.strip() in ("sat", "unsat"), done.stdout
        return done.stdout.strip() == "sat"

    def _script(self, pairs: list[tuple[int, int]]) -> str:
        """The script in SMT-LIB 2 with the theory of equality. Each term is a definition, with the facts of IEEE 754 about it as
        ground axioms."""
        terms = self.below(*(term for pair in pairs for term in pair))
        lines = ["(set-logic QF_UF)", "(declare-sort F 0)", "(declare-fun neg (F) F)"]
        arities = {node[0]: len(node) - 1 for node in map(self.nodes.__getitem__, terms) if node[0] not in LOGIC}
        for name in {*arities, "add", "mul", "div", "fabs", "lt", "le", "eq"} - {"neg"}:
            arguments = " ".join(["F"] * (1 if name == "fabs" else arities.get(name, 2)))
            lines.append(f"(declare-fun {name} ({arguments}) {'Bool' if name in TRUTH else 'F'})")
        one, none = self.constant(1.0), self.constant(-0.0)
        terms = self.below(one, none, *terms)
        for term in terms:
            lines += self._defined(term)
        for term in terms:
            name, *x = self.nodes[term]
            neutral = {"mul": one, "div": one, "add": none}.get(name)
            for a, b in ((x[0], x[1]), (x[1], x[0])) if neutral is not None else ():
                if name != "div" or b == x[1]:
                    lines.append(f"(assert (=> (= t{b} t{neutral}) (= t{term} t{a})))")
        constants = [f"t{term}" for term in terms if self.value(term) is not None]
        lines.append(f"(assert (distinct {' '.join(constants)}))")
        lines.append(f"(assert (or {' '.join(f'(not (= t{a} t{b}))' for a, b in pairs)}))")
        return "\n".join([*lines, "(check-sat)"])

    def _defined(self, term: int) -> list[str]:
        name, *x = self.nodes[term]
        at = [f"t{one}" for one in x if isinstance(one, int)]
        if name in ("constant", "input", "flag"):
            return [f"(declare-fun t{term} () {'Bool' if name == 'flag' else 'F'})"]
        kind = "Bool" if name in TRUTH else "F"
        made = f"({name} {' '.join(at)})" if at else str(name)
        lines = [f"(define-fun t{term} () {kind} {made})"]
        if name == "neg":
            lines.append(f"(assert (= (neg t{term}) {at[0]}))")
        if name in ("add", "mul"):
            lines.append(f"(assert (= t{term} ({name} {at[1]} {at[0]})))")
        if name in ("mul", "div"):
            pair = [(f"(neg {at[0]})", at[1]), (at[0], f"(neg {at[1]})")]
            lines += [f"(assert (= (neg t{term}) ({name} {a} {b})))" for a, b in pair]
            lines += [f"(assert (= (neg (neg {one})) {one}))" for one in (*at, f"t{term}")]
        if name == "fabs":
            lines.append(f"(assert (= t{term} (fabs (neg {at[0]}))))")
        if name in ("lt", "le"):
            lines.append(f"(assert (= t{term} ({name} (neg {at[1]}) (neg {at[0]}))))")
            lines.append(f"(assert (= (le {at[0]} {at[1]}) (or (lt {at[0]} {at[1]}) (eq {at[0]} {at[1]}))))")
        if name == "eq":
            lines.append(f"(assert (= t{term} (eq {at[1]} {at[0]})))")
            lines.append(f"(assert (= t{term} (eq (neg {at[1]}) (neg {at[0]}))))")
        return lines


LOGIC = {"constant", "input", "flag", "true", "ite", "not", "and", "or"}
"""Nodes that do not need a function in the script."""
