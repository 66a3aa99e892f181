"""Proofs that a mutant of an exported list is equivalent: for every admissible state and input its results are bit-identical to
those of the list.

Both lists are evaluated for all numbers at once: each value is a term with the interval that contains it. Rounding is monotone,
so the ends of the interval of an operation are the rounded ends. If a comparison is undecided, all outcomes (less, greater,
equal) are followed, each with its implications for the two numbers. A mutant is proven equivalent if its outputs are the terms of
the list in every case.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.export.evaluation import value
from barbalat.export.mutants import Mutant
from barbalat.lowering.c99 import DOUBLE, Real
from barbalat.lowering.operations import COMPARISONS, Operation, Program
from barbalat.run.kernel.sampled_controller import STATE

CASES, MORE_CASES = 30, 100
"""The budget of a proof for one mutant, in cases: in the first pass, and in the second pass for mutants that are still
undetected."""
MOST = 1e30
"""Assumed largest size of the intermediate numbers if no bound is proved for all of them: far beyond the range of accepted
results."""
ASSUMED = f", provided that no intermediate result exceeds {MOST:g}"
"""The words that end the description of a proof that needs this assumption."""
WORK = 1_000_000
"""Largest total number of operations in the cases of all proofs of one export, in each of the two passes."""
SHARE = 40
"""One mutant may use at most one part in this many of that total."""
NARROWS = 8
"""Number of bottleneck operations (through which the whole effect of a fault passes) that are compared before the outputs,
because their proofs have few cases."""
NEAR = (0, 3, 6)
"""Number of operations after a comparison among which choices are sought; cases are first divided by the conditions of these
choices."""


class Interval(NamedTuple):
    """The interval of a value, and whether it may be NaN."""

    low: float
    high: float
    none: bool = False


EXACT = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv}
LIMITED = dict.fromkeys(("sin", "cos", "tanh"), (-1.000001, 1.000001)) | {"atan": (-1.6, 1.6)}
"""Ranges of functions, slightly widened."""
MOST_EXPONENT = 80.0
"""Largest argument whose exp is finite."""
LEAST_NORMAL_ROOT = 1e-18
"""A number whose square is a normal number in 32 bits and in 64 bits."""
ANY = Interval(-math.inf, math.inf, True)
Term = int
Truth = bool | None
FOUND, TRUTH, OPEN = range(3)
Note = tuple[int, Term, Interval | Truth | tuple[Term, Term]]
"""The result of evaluating an operation for a term: its interval, its truth, or the comparison on which it depends."""


@dataclass(frozen=True)
class Assumed:
    """A case: intervals of terms by number, the outcomes of comparisons "a < b", and the terms that equal another term bit for
    bit."""

    within: dict[Term, Interval] = field(default_factory=dict)
    less: dict[tuple[Term, Term], bool] = field(default_factory=dict)
    same: dict[Term, Term] = field(default_factory=dict)


@dataclass(eq=False)
class Prover:
    """The terms of one list, whose outputs are these ``rows`` of the state.

    inputs   the intervals of the list's inputs, by (argument, component)
    ordered  pairs of inputs whose first member is at most the second
    """

    program: Program
    inputs: dict[tuple[int, int], Interval]
    real: Real
    rows: Sequence[int] = ()
    most_cases: int = CASES
    ordered: Sequence[tuple[tuple[int, int], tuple[int, int]]] = ()
    nodes: dict[tuple[object, ...], Term] = field(default_factory=dict)
    names: list[tuple[object, ...]] = field(default_factory=list)
    parts: list[tuple[Term, ...]] = field(default_factory=list)
    work: int = 0
    until: int = WORK
    unbounded: bool = False
    constants: dict[Term, float] = field(default_factory=dict)

    def proof(self, mutant: Mutant) -> str:
        """A phrase with the number of cases of the proof; empty if there is no proof within the budget."""
        if mutant.operation is None:
            return self._keeps(mutant)
        with np.errstate(all="ignore"):  # a number beyond the range of the target is infinite, as in C
            return self._proof(mutant)

    def _proof(self, mutant: Mutant) -> str:
        touched = self._touched(mutant.place)
        self.until = min(WORK, self.work + WORK // SHARE)
        for narrow in self._narrows(touched):
            if found := self._cases(mutant, narrow, 0, math.inf):
                return _said(found)
        outputs, cases, assumed = dict.fromkeys(i for i in self.program.outputs[0] if i in touched), 0, ""
        for output in outputs:
            self.unbounded = False
            ways = ((near, most) for most in (math.inf, MOST) for near in NEAR if most == math.inf or self.unbounded)
            found, most = next(((found, way[1]) for way in ways if (found := self._cases(mutant, output, *way))), (0, 0.0))
            if not found:
                return ""
            cases, assumed = (
                max(cases, found),
                assumed or ("" if most == math.inf else ASSUMED),
            )
        return _said(cases) + assumed

    def _touched(self, place: int) -> list[int]:
        """This operation and all operations that depend on it, in the list's order."""
        found = {place}
        for i, op in enumerate(self.program.operations):
            if not found.isdisjoint(op.operands):
                found.add(i)
        return sorted(found)

    def _narrows(self, touched: list[int]) -> list[int]:
        """The first operations through which the whole effect of ``touched[0]`` passes; if they are equal, so are the outputs."""
        operations, stored = self.program.operations, set(self.program.outputs[0])
        last = {j: i for i in touched for j in operations[i].operands}
        found, end = list[int](), touched[0]
        for i in touched:
            if i in stored or len(found) == NARROWS:
                break
            if i == end != touched[0]:
                found.append(i)
            end = max(end, last.get(i, i))
        return found

    def _keeps(self, mutant: Mutant) -> str:
        """The reason why a mutant that does not store a row is equivalent, if it is: the value to be stored equals the loaded
        value."""
        operations, stored = self.program.operations, self.program.outputs[0][list(self.rows).index(mutant.place)]
        loads = [i for i, op in enumerate(operations) if op.name == "input" and op.source == (STATE, mutant.place)]
        if not loads:
            return ""
        end = len(operations)
        longer = Program((*operations, Operation("copy", (stored,))), ((end,),))
        return replace(self, program=longer).proof(Mutant(end, mutant.said, Operation("copy", (loads[0],))))

    def _cases(self, mutant: Mutant, output: int, near: int, most: float) -> int:
        """The number of cases over which this output is proven equal; 0 if it is not proven."""
        needed, cases = self._needed(mutant, output), 0
        waiting: list[tuple[Assumed, _Walk | None, set[Term]]] = [(self._given(), None, set())]
        while waiting:
            cases += 1
            if cases + len(waiting) > self.most_cases or self.work > self.until:
                return 0
            case, whole, changed = waiting.pop()
            walk = _Walk(self, case, mutant, near, most, whole, changed)
            self.work += len(needed)
            try:
                pair = walk.run(needed)
            except _Contradiction:  # this case is empty
                continue
            if pair is None:
                continue
            if pair == (-1, -1):
                return 0
            changed = self._changed(pair)
            waiting += [(part, walk, changed) for part in self._divided(case, walk, *pair)]
        return cases

    def _given(self) -> Assumed:
        """The case of all admissible states and inputs."""
        less = {}
        for pair in self.ordered:
            low, high = (self.term("input", *map(str, source)) for source in pair)
            less[high, low] = False
        return Assumed(less=less)

    def _needed(self, mutant: Mutant, output: int) -> list[int]:
        """The positions of the operations on which an output depends, with the output last."""
        alive, operations = {output}, self.program.operations
        for i in range(output, -1, -1):
            if i in alive:
                alive.update(operations[i].operands)
                if i == mutant.place and mutant.operation is not None:
                    alive.update(mutant.operation.operands)
        return sorted(alive)

    def _changed(self, pair: tuple[Term, Term]) -> set[Term]:
        """The terms that a comparison narrows in a case, and the conditions, 1 or 0, of terms that are choices."""
        found = {term for term in pair if term not in self.constants} or set(pair)
        return found | {self.names[term][1] for term in found if self.names[term][0] == "choice"}  # type: ignore[misc]

    def _divided(self, case: Assumed, walk: _Walk, a: Term, b: Term) -> list[Assumed]:
        """The case with a < b, with b < a, with a = b, and with one of them NaN."""
        first, second = walk.interval(a), walk.interval(b)
        found = []
        for low, high, one, two in ((a, b, first, second), (b, a, second, first)):
            up, down = self._next(one.low, math.inf), self._next(two.high, -math.inf)
            below, above = Interval(one.low, min(one.high, down)), Interval(max(two.low, up), two.high)
            if below.low <= below.high and above.low <= above.high:
                found.append(_with(case, {low: below, high: above}, {(low, high): True, (high, low): False}))
        both = Interval(max(first.low, second.low), min(first.high, second.high))
        if both.low <= both.high:
            never_zero = both.low > 0 or both.high < 0
            equal = _with(case, {a: both, b: both}, {(a, b): False, (b, a): False})
            kept, other = (b, a) if b in self.constants else (a, b)
            found.append(replace(equal, same={**case.same, other: kept}) if never_zero else equal)
        if first.none or second.none:
            found.append(_with(case, {}, {(a, b): False, (b, a): False}))
        return found

    def term(self, *node: object) -> Term:
        if (found := self.nodes.get(node)) is None:
            found = self.nodes[node] = len(self.names)
            self.names.append(node)
            self.parts.append(tuple(part for part in node if isinstance(part, int)))
        return found

    def constant(self, number: float) -> Term:
        made = self.term("constant", float(number).hex())
        self.constants[made] = float(number)
        return made

    def rounded(self, number: float) -> float:
        """A sum, product or quotient of two numbers in the target's precision; with 24 bits it is still correctly rounded after a
        first rounding to 53 bits."""
        return number if self.real is DOUBLE else float(self.real.numbers(number))

    def _next(self, number: float, towards: float) -> float:
        return float(np.nextafter(self.real.numbers(number), self.real.numbers(towards)))


def _said(cases: int) -> str:
    return f"the same terms in each of {cases} cases" if cases > 1 else "the same terms for all numbers"


def _with(case: Assumed, within: dict[Term, Interval], less: dict[tuple[Term, Term], bool]) -> Assumed:
    return Assumed({**case.within, **within}, {**case.less, **less}, case.same)


class _Contradiction(Exception):
    """The interval of a number in a case contradicts the values from which the number is computed."""


class _Walk:
    """Both lists in one case. A number is a term; a truth value is True, False, or None with the comparison on which it
    depends.

    plain, other  the terms of the list and, where the mutant's may differ, those of the mutant, by their positions
    whole         the walk of the case that contains this one; values that do not depend on ``changed`` terms are taken from it
    """

    def __init__(
        self, prover: Prover, case: Assumed, mutant: Mutant, near: int, most: float, whole: _Walk | None, changed: set[Term]
    ) -> None:
        self.prover, self.case, self.mutant, self.near, self.most = prover, case, mutant, near, most
        self.whole, self._dependent = whole, dict.fromkeys(changed, True)
        self.names, self._positives = prover.names, dict[Term, bool]()
        self.truths: dict[Term, Truth] = {}
        self.found: dict[Term, Interval] = {}
        self.of_open: dict[Term, tuple[Term, Term]] = {}
        self.plain: dict[int, Term] = {}
        self.other: dict[int, Term] = {}
        self._known: tuple[dict[Term, Any], ...] = (self.found, self.truths, self.of_open)
        self._notes: dict[int, list[Note]] = {}

    def run(self, needed: list[int]) -> tuple[int, int] | None:
        """None if the last value is equal; otherwise an undecided comparison, or (-1, -1) if none is left."""
        plain, other, whole = self.plain, self.other, self.whole
        if whole is None:
            for i in needed:
                self._evaluate(i)
        else:
            self._evaluate_part(needed, whole)
        one, two = plain[needed[-1]], other.get(needed[-1], plain[needed[-1]])
        if one == two:
            return None
        return self._of_a_zero(plain, other) or self._between(one, two) or (-1, -1)

    def _evaluate(self, i: int) -> None:
        plain, other, mutant = self.plain, self.other, self.mutant
        op, self._noted = self.prover.program.operations[i], list[Note]()
        plain[i] = self._value(op, [plain[j] for j in op.operands])
        if i == mutant.place:
            assert mutant.operation is not None
            x = [plain[j] for j in mutant.operation.operands]
            made = x[0] if mutant.operation.name == "copy" else self._value(mutant.operation, x)
            other[i] = self._not(made) if mutant.denied else made
        elif any(other.get(j, plain[j]) != plain[j] for j in op.operands):
            other[i] = self._value(op, [other.get(j, plain[j]) for j in op.operands])
        self._notes[i] = self._noted

    def _evaluate_part(self, needed: list[int], whole: _Walk) -> None:
        """Evaluate only the values that depend on the changed terms; the rest is the same as in the whole case."""
        operations, mutant = self.prover.program.operations, self.mutant
        anew = set[int]()
        for i in needed:
            operands = operations[i].operands
            if i == mutant.place and mutant.operation is not None:
                operands += mutant.operation.operands
            mine = whole.plain[i]
            others = whole.other.get(i, mine)
            if not anew.isdisjoint(operands) or self._depends(mine) or self._depends(others):
                anew.add(i)
                self._evaluate(i)
                continue
            self.plain[i], self._notes[i] = mine, whole._notes[i]
            if i in whole.other:
                self.other[i] = others
            for kind, term, what in whole._notes[i]:
                self._known[kind][term] = what

    def _note(self, kind: int, term: Term, what: Interval | Truth | tuple[Term, Term]) -> None:
        self._known[kind][term] = what
        self._noted.append((kind, term, what))

    def _depends(self, term: Term) -> bool:
        """Whether this term is changed or computed from a changed term."""
        known, parts_of, waiting = self._dependent, self.prover.parts, [term]
        while term not in known:
            parts = parts_of[waiting[-1]]
            if any(known.get(part, False) for part in parts):
                known[waiting.pop()] = True
            elif unknown := [part for part in parts if part not in known]:
                waiting += unknown
            else:
                known[waiting.pop()] = False
        return known[term]

    def _of_a_zero(self, plain: dict[int, Term], other: dict[int, Term]) -> tuple[int, int] | None:
        """The sign of the first sum that differs only by an added zero, if there is one: adding a zero to a nonzero number has no
        effect."""
        differ = (term for i, found in other.items() if found != plain[i] for term in (plain[i], found))
        return next((self.of_open[one] for one in differ if one in self.of_open and self.names[one][0] in ("add", "sub")), None)

    def _between(self, one: Term, other: Term) -> tuple[int, int] | None:
        """An undecided comparison on the path from two terms to their difference."""
        for term in (one, other):
            if self.names[term][0] in ("choice", "add", "sub") and (found := self._guard(term)) is not None:
                return found
        x, y = (self.prover.parts[term] for term in (one, other))
        if self.names[one][0] == self.names[other][0] and len(x) == len(y):
            return next(
                (found for pair in zip(x, y, strict=True) if pair[0] != pair[1] and (found := self._between(*pair))), None
            )
        inner = (choice for part in (*x, *y) for choice in (part, *self._choices(part, NEAR[-1])))
        return next((found for choice in inner if (found := self._guard(choice)) is not None), None)

    def _guard(self, term: Term) -> tuple[int, int] | None:
        """The comparison on which a choice depends; if one of its sides is also a choice, the comparison of that choice comes
        first."""
        name, parts = self.names[term][0], self.prover.parts[term]
        if term in self.of_open:
            inner = (self._guard(choice) for side in self.of_open[term] for choice in self._choices(side, self.near))
            return next((found for found in inner if found is not None), self.of_open[term])
        below = parts[:1] if name == "choice" else parts if name in ("not", "and", "or") else []
        found = map(self._guard, below)
        return next((one for one in found if one is not None), None)

    def _choices(self, term: Term, depth: int) -> Iterator[Term]:
        """The choices among the last operations of a term."""
        if self.names[term][0] == "choice":
            yield term
        elif depth:
            for part in self.prover.parts[term]:
                yield from self._choices(part, depth - 1)

    def interval(self, term: Term) -> Interval:
        return self.case.within.get(term) or self.found.get(term, ANY)

    def _is(self, *node: object, within: Interval) -> Term:
        """The term with this interval; a constant if only one nonzero number is possible."""
        prover, most = self.prover, self.most
        if most < math.inf and within.low < most and within.high > -most:  # and it is not NaN
            within = Interval(max(within.low, -most), min(within.high, most))
        elif most == math.inf and (within.none or math.isinf(within.high - within.low)):
            prover.unbounded = True
        made = prover.term(*node)
        made = self.case.same.get(made, made)
        known = self.case.within.get(made)
        if known is not None:
            low, high = max(known.low, within.low), min(known.high, within.high)
            if low > high and not (known.none and within.none):
                raise _Contradiction
            within = Interval(low, high, known.none and within.none) if low <= high else within
        if within.low == within.high != 0 and not within.none and made not in prover.constants:
            return self._constant(within.low)
        self._note(FOUND, made, within)
        return made

    def _constant(self, number: float) -> Term:
        made = self.prover.constant(number)
        self._note(FOUND, made, Interval(number, number, math.isnan(number)))
        return made

    def _value(self, op: Operation, x: list[Term]) -> Term:
        name, prover = op.name, self.prover
        if name == "constant":
            return self._constant(float(prover.real.numbers(op.value)))
        if name == "copy":
            return x[0]
        if name == "input":
            return self._is("input", *map(str, op.source), within=prover.inputs.get(op.source, ANY))
        if name in COMPARISONS:
            return self._compared(name, x)
        if name in ("fmin", "fmax"):
            a, b = (self._number(one) for one in x)
            swapped = self._less(a, b) if name == "fmax" else self._less(b, a)
            return self._chosen(swapped, b, a, max if name == "fmax" else min)
        if name in ("select", "if_else_zero"):
            other = self._number(x[2]) if name == "select" else self._constant(0.0)
            return self._chosen(x[0], self._number(x[1]), other)
        return self._computed(name, [self._number(one) for one in x])

    def _number(self, x: Term) -> Term:
        """A truth value as 1 or 0."""
        return self._chosen(x, self._constant(1.0), self._constant(0.0)) if self._is_truth(x) else x

    def _is_truth(self, x: Term) -> bool:
        return x in self.truths

    def _truth(self, known: Truth, *node: object) -> Term:
        made = self.prover.term("truth", str(known)) if known is not None else self.prover.term(*node)
        self._note(TRUTH, made, known)
        return made

    def _less(self, a: Term, b: Term) -> Term:
        """a < b."""
        first, second = self.interval(a), self.interval(b)
        assumed: Truth = self.case.less.get((a, b))
        known = assumed
        if a == b or first.low >= second.high:
            known = False
        elif first.high < second.low and not (first.none or second.none):
            known = True
        if assumed is not None and known != assumed:
            raise _Contradiction
        made = self._truth(known, "lt", a, b)
        if known is None:
            self._note(OPEN, made, (a, b))
        return made

    def _not(self, x: Term) -> Term:
        known = self.truths[x]
        return self._truth(None if known is None else not known, "not", x)

    def _compared(self, name: str, x: list[Term]) -> Term:
        if name == "not":
            return self._not(self._as_truth(x[0]))
        if name in ("and", "or"):
            return self._both(name, *(self._as_truth(one) for one in x))
        a, b = (self._number(one) for one in x)
        if name == "lt":
            return self._less(a, b)
        if self.interval(a).none or self.interval(b).none:
            return self._truth(None, name, a, b)
        if name == "le":
            return self._not(self._less(b, a))
        differ = self._both("or", self._less(a, b), self._less(b, a))
        return differ if name == "ne" else self._not(differ)

    def _as_truth(self, x: Term) -> Term:
        if self._is_truth(x):
            return x
        return self._both("or", self._less(x, self._constant(0.0)), self._less(self._constant(0.0), x))

    def _both(self, name: str, a: Term, b: Term) -> Term:
        deciding = name == "or"  # the truth value of an operand that decides the result
        first, second = self.truths[a], self.truths[b]
        if deciding in (first, second):
            return self._truth(deciding)
        if first is not None and second is not None:
            return self._truth(not deciding)
        return self._truth(None, name, a, b)

    def _chosen(self, condition: Term, yes: Term, no: Term, ends: Callable[[float, float], float] | None = None) -> Term:
        condition = self._as_truth(condition)
        known = self.truths[condition]
        if known is not None or yes == no:
            return yes if known is not False else no
        one, two = self.interval(yes), self.interval(no)
        hull = Interval(min(one.low, two.low), max(one.high, two.high), one.none or two.none)
        if ends is not None and not one.none:  # a NaN is passed on, but a bound compared with NaN has no effect
            hull = Interval(ends(one.low, two.low), ends(one.high, two.high), two.none)
        return self._is("choice", condition, yes, no, within=hull)

    def _computed(self, name: str, x: list[Term]) -> Term:
        constants, prover = self.prover.constants, self.prover
        if constants.keys() >= set(x) and name != "lookup":
            given = [prover.real.numbers(constants[one]) for one in x]
            return self._constant(float(value(Operation(name), given, {}, prover.real)))
        within = [self.interval(one) for one in x]
        sure = all(not none and math.isfinite(low) and math.isfinite(high) for low, high, none in within)
        if name == "sub" and x[0] == x[1] and sure:
            return self._constant(0.0)
        zero = constants.get(x[-1])
        if zero == 0 and name in ("add", "sub") and (math.copysign(1, zero) > 0) == (name == "sub"):
            return x[0]
        for at, other in ((0, 1), (1, 0)) if name == "add" else ((0, 1),) if name == "sub" else ():
            if within[other][:2] == (0.0, 0.0) and not within[other].none:  # a zero of either sign
                if within[at].low > 0 or within[at].high < 0:
                    return x[at]
                made = self._is(name, *x, within=Interval(*within[at]))
                if (self._constant(0.0), x[at]) not in self.case.less:
                    self._note(OPEN, made, (self._constant(0.0), x[at]))
                return made
        if (name in ("mul", "div") and zero == 1) or (name == "fabs" and self._positive(x[0])):
            return x[0]
        return self._is(name, *x, within=self._range(name, x, within, sure))

    def _positive(self, term: Term) -> bool:
        """Whether the sign is never negative, as for squares and magnitudes and for their sums and products."""
        if (found := self._positives.get(term)) is None:
            name, x = self.names[term][0], self.prover.parts[term]
            if name in ("add", "mul"):
                found = (name == "mul" and x[0] == x[1]) or all(map(self._positive, x))
            else:
                found = name == "fabs" or self.interval(term).low > 0  # except square roots: the root of -0.0 is -0.0
            self._positives[term] = found
        return found

    def _same_sign(self, a: Term, b: Term) -> bool:
        """Whether one is the other multiplied or divided by a positive number: a rounded product keeps its sign."""
        return a in self._scaled(b) or b in self._scaled(a)

    def _scaled(self, term: Term) -> Iterator[Term]:
        """The term, and the terms of which it is a positive multiple."""
        yield term
        name = self.names[term][0]
        if name in ("mul", "div"):
            one, other = self.prover.parts[term]
            if self.interval(other).low > 0:
                yield from self._scaled(one)
            elif name == "mul" and self.interval(one).low > 0:
                yield from self._scaled(other)

    def _range(self, name: str, x: list[Term], within: list[Interval], sure: bool) -> Interval:
        none = any(one.none for one in within)
        a = within[0]
        if name == "neg":
            return Interval(-a.high, -a.low, none)
        if name == "fabs":
            return Interval(max(0.0, a.low, -a.high), max(-a.low, a.high), none)
        if name in LIMITED:
            return Interval(*LIMITED[name], none or not sure)
        if name == "exp" and a.high < MOST_EXPONENT:
            return Interval(0.0, math.exp(a.high) * (1 + 1e-6), none)
        if name == "sqrt":
            return Interval(
                self.prover.rounded(math.sqrt(max(a.low, 0.0))), math.sqrt(max(a.high, 0.0)) * (1 + 1e-6), none or a.low < 0
            )
        if name not in ("add", "sub", "mul", "div") or (name == "div" and within[1].low <= 0 <= within[1].high):
            return ANY
        b = within[1]
        pairs = [(a.low, b.low), (a.low, b.high), (a.high, b.low), (a.high, b.high)]
        if name == "mul" and x[0] == x[1]:
            pairs = [(a.low, a.low), (a.high, a.high), *([(0.0, 0.0)] if a.low <= 0 <= a.high else [])]
        if name == "mul" and self._same_sign(*x):
            pairs = [(p, q) for p, q in pairs if p * q >= 0] + ([(0.0, 0.0)] if a.low <= 0 <= a.high else [])
        ends = [self.prover.rounded(EXACT[name](float(p), float(q))) for p, q in pairs]
        if any(map(math.isnan, ends)):
            return ANY
        least = min(ends)
        if name == "mul" and self._is_relative_size(*x):
            least = max(least, 1 - 8 * float(np.finfo(self.prover.real.numbers).eps))
        return Interval(least, max(ends), none or not (sure or (name == "mul" and min(a.low, b.low) > 0)))

    def _is_relative_size(self, one: Term, root: Term) -> bool:
        """Whether these are 1/y and sqrt(w) with w >= y*y and y > 0, so that their product is at least 1 up to four rounding
        errors."""
        if self.names[one][0] != "div" or self.names[root][0] != "sqrt":
            return False
        (unit, y), (w,) = self.prover.parts[one], self.prover.parts[root]
        square = self.prover.term("mul", y, y)
        at_least = w == square or self.case.less.get((w, square)) is False or self.case.less.get((square, w)) is True
        if self.names[w][0] == "choice" and square in self.prover.parts[w]:  # as max(a, y*y), or in the other order
            condition, *both = self.prover.parts[w]
            other = both[0] if both[1] == square else both[1]
            at_least |= self.names[condition] == ("lt", other, square) and both[0] == square
            at_least |= self.names[condition] == ("lt", square, other) and both[1] == square
        return at_least and self.prover.constants.get(unit) == 1 and self.interval(y).low >= LEAST_NORMAL_ROOT
