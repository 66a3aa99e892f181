"""Operation lists written as formulas: every operator on a ``TracedNumber`` appends one operation, in the order of writing.

The list computes exactly what is written. Nothing is simplified or reordered, because that would change the last bits of a
function. Sums and products with their rounding errors, and rounding to integers, use only additions and multiplications (Knuth,
The Art of Computer Programming 2, 4.2.2, theorem B; Dekker, Numer. Math. 18 (1971) 224-242).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from barbalat.lowering.functions.formats import Format
from barbalat.lowering.operations import Operation, Program
from barbalat.lowering.optimize import drop_dead


@dataclass(eq=False)
class Trace:
    """The operations so far, on numbers of one format; equal constants share one operation."""

    format: Format
    operations: list[Operation] = field(default_factory=list)
    constants: dict[str, int] = field(default_factory=dict)

    def append(self, name: str, *operands: TracedNumber | float, table: tuple[float, ...] = ()) -> TracedNumber:
        places = tuple(self.number(operand).place for operand in operands)
        self.operations.append(Operation(name, places, table=table))
        return TracedNumber(self, len(self.operations) - 1)

    def number(self, value: TracedNumber | float) -> TracedNumber:
        if isinstance(value, TracedNumber):
            return value
        key = float(value).hex()  # -0.0 == 0.0 and NaN != NaN as keys
        if key not in self.constants:
            self.operations.append(Operation("constant", (), float(value)))
            self.constants[key] = len(self.operations) - 1
        return TracedNumber(self, self.constants[key])

    def argument(self, i: int) -> TracedNumber:
        self.operations.append(Operation("input", source=(i, 0)))
        return TracedNumber(self, len(self.operations) - 1)


@dataclass(frozen=True, eq=False)
class TracedNumber:
    """The value of one operation: a number, or a truth value if it is a comparison."""

    trace: Trace
    place: int

    @property
    def format(self) -> Format:
        """The format of the numbers in the computation."""
        return self.trace.format

    def constant(self, value: float) -> TracedNumber:
        """A constant in the same list."""
        return self.trace.number(value)

    def __add__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("add", self, other)

    def __radd__(self, other: float) -> TracedNumber:
        return self.trace.append("add", other, self)

    def __sub__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("sub", self, other)

    def __rsub__(self, other: float) -> TracedNumber:
        return self.trace.append("sub", other, self)

    def __mul__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("mul", self, other)

    def __rmul__(self, other: float) -> TracedNumber:
        return self.trace.append("mul", other, self)

    def __truediv__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("div", self, other)

    def __rtruediv__(self, other: float) -> TracedNumber:
        return self.trace.append("div", other, self)

    def __neg__(self) -> TracedNumber:
        return self.trace.append("neg", self)

    def __abs__(self) -> TracedNumber:
        return self.trace.append("fabs", self)

    def __lt__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("lt", self, other)

    def __le__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("le", self, other)

    def __gt__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("lt", other, self)

    def __ge__(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("le", other, self)

    def __and__(self, other: TracedNumber) -> TracedNumber:
        return self.trace.append("and", self, other)

    def __or__(self, other: TracedNumber) -> TracedNumber:
        return self.trace.append("or", self, other)

    def __invert__(self) -> TracedNumber:
        return self.trace.append("not", self)

    def equals(self, other: TracedNumber | float) -> TracedNumber:
        return self.trace.append("eq", self, other)

    def then(self, yes: TracedNumber | float, no: TracedNumber | float) -> TracedNumber:
        """``yes`` if this is true, otherwise ``no``; both are computed."""
        return self.trace.append("select", self, yes, no)

    def with_sign_of(self, other: TracedNumber) -> TracedNumber:
        return self.trace.append("copysign", self, other)

    def sqrt(self) -> TracedNumber:
        return self.trace.append("sqrt", self)

    def floor(self) -> TracedNumber:
        return self.trace.append("floor", self)

    def exponent(self) -> TracedNumber:
        """The exponent e in |x| = s 2^e, 1 <= s < 2, for a normal number."""
        return self.trace.append("exponent", self)

    def significand(self) -> TracedNumber:
        """The significand s in |x| = s 2^e, 1 <= s < 2, for a normal number."""
        return self.trace.append("significand", self)

    def two_to_this(self) -> TracedNumber:
        """2^k for an integer k from the smallest exponent of a normal number to the largest."""
        return self.trace.append("pow2", self)

    def entry_of(self, table: tuple[float, ...]) -> TracedNumber:
        """The table's entry at this index, which must be valid."""
        return self.trace.append("lookup", self, table=table)


def traced(formula: Callable[..., tuple[TracedNumber, ...]], arguments: int, of: Format) -> Program:
    """The operation list of a formula: each result is one output, each argument an input with one component."""
    trace = Trace(of)
    results = formula(*(trace.argument(i) for i in range(arguments)))
    return drop_dead(Program(tuple(trace.operations), tuple((result.place,) for result in results)))


class Double(NamedTuple):
    """An unevaluated sum of a number and its remainder, which is at most about half a unit in its last place."""

    high: TracedNumber
    low: TracedNumber


def rounded(x: TracedNumber) -> TracedNumber:
    """The nearest whole number, for |x| < 2^51 in doubles and 2^22 in floats: neighbouring numbers of the rounder's size differ
    by 1."""
    rounder = x.format.rounder
    return (x + rounder) - rounder


def two_sum(a: TracedNumber, b: TracedNumber) -> Double:
    """a + b = high + low, exactly."""
    high = a + b
    part = high - a
    return Double(high, (a - (high - part)) + (b - part))


def fast_two_sum(a: TracedNumber, b: TracedNumber) -> Double:
    """a + b = high + low, exactly where |a| >= |b| or a = 0."""
    high = a + b
    return Double(high, b - (high - a))


def split(x: TracedNumber) -> Double:
    """Split x into high + low, each with half of the bits (26 in doubles, 12 in floats), if the product does not overflow."""
    scaled = x * x.format.splitter
    high = scaled - (scaled - x)
    return Double(high, x - high)


def two_product(a: TracedNumber, b: TracedNumber) -> Double:
    """a b = high + low, exactly except for over- and underflow."""
    high, (a1, a2), (b1, b2) = a * b, split(a), split(b)
    return Double(high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2)
