"""Operations -> WebAssembly instructions. A value that is used once stands where it is used, any other in a local variable."""

from __future__ import annotations

from collections.abc import Mapping

from barbalat.lowering.functions import FUNCTIONS
from barbalat.lowering.operations import ALIGNED, COMPARISONS, EXPONENT_BIAS, FRACTION_BITS, Operation, Program
from barbalat.lowering.optimize import PARAMETERS
from barbalat.lowering.wasm.encode import DOUBLE_BYTES, Code, Do, Type

_PLAIN = {
    "add": Do.F64_ADD, "sub": Do.F64_SUB, "mul": Do.F64_MUL, "div": Do.F64_DIV, "neg": Do.F64_NEG, "sqrt": Do.F64_SQRT,
    "fabs": Do.F64_ABS, "floor": Do.F64_FLOOR, "ceil": Do.F64_CEIL, "copysign": Do.F64_COPYSIGN, "lt": Do.F64_LT,
    "le": Do.F64_LE, "eq": Do.F64_EQ, "ne": Do.F64_NE,
}  # fmt: skip
DEEPEST_NESTING = 100
"""Operations within operations that stand in one expression: Python calls itself for each of them."""


class Printer:
    """Prints a list into a function; ``inputs`` are local variables by (argument, component)."""

    def __init__(
        self, program: Program, code: Code, inputs: Mapping[tuple[int, int], int], called: Mapping[str, int],
        tables: Mapping[tuple[float, ...], int],
    ) -> None:  # fmt: skip
        self.operations, self.outputs = program.operations, program.outputs
        self.code, self.called, self.tables = code, called, tables
        self.places = {i: inputs[op.source] for i, op in enumerate(self.operations) if op.name == "input"}
        self.waiting = self._used_once()

    def _used_once(self) -> set[int]:
        """The operations that are printed where their value is used."""
        uses = [0] * len(self.operations)
        for op in self.operations:
            for j in op.operands:
                uses[j] += 2 if op.name in ("fmin", "fmax") else 1  # the comparison and the selection
        for row in self.outputs:
            for j in row:
                uses[j] += 1
        depth, waiting = [0] * len(self.operations), set()
        for i, op in enumerate(self.operations):
            depth[i] = 1 + max((depth[j] for j in op.operands if j in waiting), default=0)
            if op.name != "input" and uses[i] == 1 and depth[i] < DEEPEST_NESTING:
                waiting.add(i)
        return waiting

    def before_the_loop(self) -> None:
        """Constants used more than once, and what follows from parameters alone: computed once."""
        fixed: list[bool] = []
        for op in self.operations:
            is_parameter = op.name == "input" and op.source[0] == PARAMETERS
            fixed.append(op.name == "constant" or is_parameter or (op.name != "input" and all(fixed[j] for j in op.operands)))
        last_of_fixed = {j for i, op in enumerate(self.operations) if not fixed[i] for j in op.operands if fixed[j]}
        last_of_fixed |= {j for row in self.outputs for j in row if fixed[j]}
        self.waiting -= {j for j in last_of_fixed if self.operations[j].name != "constant"}
        for i in range(len(self.operations)):
            if fixed[i]:
                self._keep(i)

    def run(self) -> None:
        """What is not printed yet, but for the values that are used once."""
        for i in range(len(self.operations)):
            self._keep(i)

    def _keep(self, i: int) -> None:
        if i in self.waiting or i in self.places:
            return
        place = self.code.local(Type.I32 if self.is_truth(i) else Type.F64)
        self._print(self.operations[i])
        self.code.set(place)
        self.places[i] = place

    def is_truth(self, i: int) -> bool:
        return self.operations[i].name in COMPARISONS

    def _value(self, i: int) -> None:
        if i in self.places:
            self.code.get(self.places[i])
        else:
            self._print(self.operations[i])

    def number(self, i: int) -> None:
        """Value i onto the stack as a number; a truth value becomes 0 or 1."""
        self._value(i)
        if self.is_truth(i):
            self.code.do(Do.F64_CONVERT_I32_U)

    def condition(self, i: int) -> None:
        self._value(i)
        if not self.is_truth(i):
            self.code.f64(0.0)
            self.code.do(Do.F64_NE)

    def _print(self, op: Operation) -> None:
        name, code = op.name, self.code
        if name == "constant":
            code.f64(op.value)
        elif name in ("not", "and", "or"):
            for j in op.operands:
                self.condition(j)
            code.do({"not": Do.I32_EQZ, "and": Do.I32_AND, "or": Do.I32_OR}[name])
        elif name in ("select", "if_else_zero"):
            self._select(op)
        elif name in ("fmin", "fmax"):
            self._extremum(op)
        else:
            for j in op.operands:
                self.number(j)
            self._apply(op)

    def _select(self, op: Operation) -> None:
        condition, yes, *no = op.operands
        self.number(yes)
        if no:
            self.number(no[0])
        else:
            self.code.f64(0.0)
        self.condition(condition)
        self.code.do(Do.SELECT)

    def _extremum(self, op: Operation) -> None:
        """The kernel's minimum or maximum, which lets the first operand's NaN through: f64.min and f64.max order zeros."""
        first, second = op.operands
        for j in (second, first, first, second):
            self.number(j)
        self.code.do(Do.F64_LT if op.name == "fmax" else Do.F64_GT, Do.SELECT)

    def _apply(self, op: Operation) -> None:
        code = self.code
        if op.name in _PLAIN:
            code.do(_PLAIN[op.name])
        elif op.name in FUNCTIONS:
            code.call(self.called[op.name])
        elif op.name == "lookup":
            code.whole_of_double()
            code.i32(DOUBLE_BYTES)
            code.do(Do.I32_MUL)
            code.load(self.tables[op.table])
        elif op.name == "pow2":
            code.f64(ALIGNED)
            code.do(Do.F64_ADD, Do.I64_REINTERPRET_F64)
            code.i64(FRACTION_BITS)
            code.do(Do.I64_SHL, Do.F64_REINTERPRET_I64)
        elif op.name in ("exponent", "significand"):
            self._part_of_bits(op.name)
        elif op.name in ("fma", "fnma"):
            raise ValueError("WebAssembly has no fused multiply-add: optimize(program, fused=False) makes a list without them")
        else:
            raise ValueError(f"the operation {op.name} has no WebAssembly translation")

    def _part_of_bits(self, name: str) -> None:
        code = self.code
        code.do(Do.I64_REINTERPRET_F64)
        if name == "exponent":
            code.i64(FRACTION_BITS)
            code.do(Do.I64_SHR_U)
            code.i64(2 * EXPONENT_BIAS + 1)
            code.do(Do.I64_AND, Do.F64_CONVERT_I64_S)
            code.f64(EXPONENT_BIAS)
            code.do(Do.F64_SUB)
        else:
            code.i64(2**FRACTION_BITS - 1)
            code.do(Do.I64_AND)
            code.i64(EXPONENT_BIAS << FRACTION_BITS)
            code.do(Do.I64_OR, Do.F64_REINTERPRET_I64)
