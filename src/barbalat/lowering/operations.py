"""A CasADi function as a list of scalar operations in single-assignment form.

Every target (LLVM, C) is printed from this list; this module depends on no target and contains no control theory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import copysign
from typing import TYPE_CHECKING, NamedTuple

from barbalat import vocabulary

if TYPE_CHECKING:
    import casadi


class Operation(NamedTuple):
    """One scalar operation; ``operands`` are positions of earlier operations in the same list.

    It is a tuple, because a step has thousands of operations, which are created, compared and hashed several times before they
    become machine code.
    """

    name: str
    operands: tuple[int, ...] = ()
    value: float = 0.0  # of a "constant"
    source: tuple[int, int] = (0, 0)  # for an "input": (argument, component)
    table: tuple[float, ...] = ()  # for a "lookup": its operand is an index


@dataclass(frozen=True, slots=True)
class Program:
    """Operations in order, and for each output argument the positions of its components.

    Equal programs give equal results, bit for bit; the constants 0 and -0, which == considers equal, are therefore distinguished.
    """

    operations: tuple[Operation, ...]
    outputs: tuple[tuple[int, ...], ...]
    negative_zeros: tuple[int, ...] = field(init=False, repr=False)
    """The positions of constants that are -0."""

    def __post_init__(self) -> None:
        constants = ((i, op.value) for i, op in enumerate(self.operations) if op.name == "constant" and op.value == 0)
        object.__setattr__(self, "negative_zeros", tuple(i for i, value in constants if copysign(1.0, value) < 0))


EXPONENT_BIAS = 1023
FRACTION_BITS = 52
"""Properties of a double for the operations on bits, which occur only in the lists of elementary functions: "exponent" and
"significand"
of a normal number, and "pow2" of a whole number, see ``functions.trace``."""
ALIGNED = 2.0**FRACTION_BITS + EXPONENT_BIAS
"""The number such that an integer added to it appears, with the bias, in the last bits of the sum. This avoids a conversion,
which is undefined for NaN."""
COMPARISONS = frozenset({"lt", "le", "eq", "ne", "not", "and", "or"})
"""Operations whose result is a truth value; CasADi writes them as the numbers 0 and 1."""


def read(function: casadi.Function) -> Program:
    """Translate the instruction list of an SX function.

    Raises ``ValueError``, with the name, for an operation that no target supports.
    """
    import casadi as ca

    operations: list[Operation] = []
    work: dict[int, int] = {}  # place in CasADi's work vector -> position of the operation whose value it contains
    outputs = [[-1] * function.nnz_out(k) for k in range(function.n_out())]

    def append(name: str, *operands: int, value: float = 0.0, source: tuple[int, int] = (0, 0)) -> int:
        operations.append(Operation(name, operands, value, source))
        return len(operations) - 1

    for k in range(function.n_instructions()):
        code, arguments, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            work[target[0]] = append("constant", value=function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            work[target[0]] = append("input", source=(arguments[0], arguments[1]))
        elif code == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[arguments[0]]
        elif (name := vocabulary.names().get(code)) is not None:
            a = [work[i] for i in arguments]
            if name == "sq":
                work[target[0]] = append("mul", a[0], a[0])
            elif name == "twice":
                work[target[0]] = append("add", a[0], a[0])
            elif name == "inv":
                work[target[0]] = append("div", append("constant", value=1.0), a[0])
            elif name == "constpow":
                work[target[0]] = append("pow", *a)
            elif name == "sign":
                zero = append("constant", value=0.0)
                work[target[0]] = append("sub", append("lt", zero, a[0]), append("lt", a[0], zero))
            else:
                work[target[0]] = append(name, *a)
        else:
            said = ", ".join(vocabulary.unknown(function)) or str(code)
            raise ValueError(f"the operation {said} has no translation to machine code; rewrite the expression without it")
    return Program(tuple(operations), tuple(tuple(row) for row in outputs))


def following(first: tuple[Operation, ...], program: Program, inputs: Mapping[tuple[int, int], int]) -> Program:
    """Append ``program`` to the operations ``first``; the values at the positions ``inputs`` replace its inputs. Other inputs
    stay inputs. The operations of the program keep their order and operands, so all results are unchanged, bit for bit.
    """
    operations = list(first)
    outputs = append(operations, program, inputs)
    return Program(tuple(operations), outputs)


def append(operations: list[Operation], program: Program, inputs: Mapping[tuple[int, int], int]) -> tuple[tuple[int, ...], ...]:
    """Append a program as ``following`` does; return the positions of its outputs."""
    place: list[int] = []
    for op in program.operations:
        if op.name == "input" and op.source in inputs:
            place.append(inputs[op.source])
            continue
        operations.append(op._replace(operands=tuple([place[j] for j in op.operands])))
        place.append(len(operations) - 1)
    return tuple(tuple(place[i] for i in row) for row in program.outputs)


def sliced(program: Program, keep: Sequence[int]) -> Program:
    """The operations on which these components of the first output depend, in the order of the whole list, as a list with these
    components as its only output."""
    row = tuple(program.outputs[0][i] for i in keep)
    alive = set(row)
    for i in range(len(program.operations) - 1, -1, -1):
        if i in alive:
            alive.update(program.operations[i].operands)
    place = {old: new for new, old in enumerate(sorted(alive))}
    kept = (program.operations[i] for i in sorted(alive))
    operations = tuple(op._replace(operands=tuple([place[j] for j in op.operands])) for op in kept)
    return Program(operations, (tuple(place[i] for i in row),))


def sources(program: Program) -> set[tuple[int, int]]:
    """The inputs that the list reads, as (argument, component)."""
    return {op.source for op in program.operations if op.name == "input"}
