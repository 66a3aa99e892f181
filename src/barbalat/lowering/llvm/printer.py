"""Translates operations to LLVM IR text, for numbers or for vectors of W members. Elementary functions become separate
functions."""

from __future__ import annotations

import struct
from collections.abc import Collection

from barbalat.lowering.functions import FUNCTIONS, Function, function
from barbalat.lowering.operations import ALIGNED, COMPARISONS, EXPONENT_BIAS, FRACTION_BITS, Operation, Program

_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
_INTRINSICS = {"sqrt": 1, "fabs": 1, "floor": 1, "ceil": 1, "copysign": 2}


def constant(value: float) -> str:
    """A double in LLVM's exact notation, by its bits."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class Printer:
    """Prints the operations of one step; ``values`` maps a position to the text of its value."""

    def __init__(self, program: Program, lanes: int, inputs: dict[tuple[int, int], str], prefix: str = "v") -> None:
        self.program = program
        self.prefix = prefix
        self.lanes = lanes
        self.inputs = inputs
        self.vector = "double" if lanes == 1 else f"<{lanes} x double>"
        self.mask = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.bits = "i64" if lanes == 1 else f"<{lanes} x i64>"
        self.lines: list[str] = []
        self.intrinsics: set[str] = set()
        self.functions: set[str] = set()
        self.tables: dict[str, str] = {}
        self.values: list[str] = []
        self.truth: list[bool] = []
        self.temporaries = 0

    def splat(self, value: float) -> str:
        text = constant(value)
        return text if self.lanes == 1 else "<" + ", ".join([f"double {text}"] * self.lanes) + ">"

    def assign(self, text: str) -> str:
        self.temporaries += 1
        name = f"%{self.prefix}{self.temporaries}"
        self.lines.append(f"  {name} = {text}")
        return name

    def number(self, i: int) -> str:
        """Value i as a number; a truth value becomes 0 or 1."""
        if not self.truth[i]:
            return self.values[i]
        return self.assign(
            f"select {self.mask} {self.values[i]}, {self.vector} {self.splat(1.0)}, {self.vector} {self.splat(0.0)}"
        )

    def condition(self, i: int) -> str:
        if self.truth[i]:
            return self.values[i]
        return self.assign(f"fcmp une {self.vector} {self.values[i]}, {self.splat(0.0)}")

    def intrinsic(self, name: str, *operands: str) -> str:
        types = ", ".join([self.vector] * len(operands))
        self.intrinsics.add(f"declare {self.vector} @llvm.{name}.{self.suffix}({types})")
        arguments = ", ".join(f"{self.vector} {x}" for x in operands)
        return self.assign(f"call {self.vector} @llvm.{name}.{self.suffix}({arguments})")

    def select(self, condition: str, a: str, b: str) -> str:
        return self.assign(f"select {self.mask} {condition}, {self.vector} {a}, {self.vector} {b}")

    def run(self) -> list[str]:
        """The outputs' values, argument by argument."""
        for op in self.program.operations:
            if op.name == "constant":
                value = self.splat(op.value)
            elif op.name == "input":
                value = self.inputs[op.source]
            else:
                value = self.operation(op)
            self.values.append(value)
            self.truth.append(op.name in COMPARISONS)
        return [self.number(i) for row in self.program.outputs for i in row]

    def operation(self, op: Operation) -> str:
        name, operands = op.name, op.operands
        if name in ("not", "and", "or"):
            c = [self.condition(i) for i in operands]
            ones = "true" if self.lanes == 1 else "splat (i1 true)"
            return self.assign(f"xor {self.mask} {c[0]}, {ones}" if name == "not" else f"{name} {self.mask} {c[0]}, {c[1]}")
        if name in ("select", "if_else_zero"):
            other = self.number(operands[2]) if name == "select" else self.splat(0.0)
            return self.select(self.condition(operands[0]), self.number(operands[1]), other)
        x = [self.number(i) for i in operands]
        if name in _ARITHMETIC:
            return self.assign(f"{_ARITHMETIC[name]} {self.vector} {x[0]}, {x[1]}")
        if name in _COMPARE:
            return self.assign(f"fcmp {_COMPARE[name]} {self.vector} {x[0]}, {x[1]}")
        if name in ("fmin", "fmax"):
            return self.extremum(name, x)
        if name == "neg":
            return self.assign(f"fneg {self.vector} {x[0]}")
        if name == "fma":
            return self.intrinsic("fma", *x)
        if name == "fnma":
            return self.intrinsic("fma", self.assign(f"fneg {self.vector} {x[0]}"), x[1], x[2])
        if _INTRINSICS.get(name) == len(x):
            return self.intrinsic(name, *x)
        if name in FUNCTIONS:
            self.functions.add(name)
            return self.assign(f"call {self.vector} @barbalat.{name}({', '.join(f'{self.vector} {operand}' for operand in x)})")
        if name in ("exponent", "significand", "pow2"):
            return self.of_bits(name, x[0])
        if name == "lookup":
            return self.lookup(op.table, x[0])
        raise ValueError(f"the operation {name} has no LLVM translation")

    def extremum(self, name: str, x: list[str]) -> str:
        """A minimum or maximum that passes on a NaN of the first operand instead of the bound, because a divergence must stay
        visible."""
        relation = "olt" if name == "fmax" else "ogt"
        return self.select(self.assign(f"fcmp {relation} {self.vector} {x[0]}, {x[1]}"), x[1], x[0])

    def of_bits(self, name: str, x: str) -> str:
        """A number's exponent and significand, or the power of two with an exponent, by manipulating bits."""
        if name == "pow2":
            aligned = self.assign(f"fadd {self.vector} {x}, {self.splat(ALIGNED)}")
            whole = self.assign(f"bitcast {self.vector} {aligned} to {self.bits}")
            return self.as_number(self.assign(f"shl {self.bits} {whole}, {self.whole(FRACTION_BITS)}"))
        bits = self.assign(f"bitcast {self.vector} {x} to {self.bits}")
        if name == "significand":
            fraction = self.assign(f"and {self.bits} {bits}, {self.whole(2**FRACTION_BITS - 1)}")
            return self.as_number(self.assign(f"or {self.bits} {fraction}, {self.whole(EXPONENT_BIAS << FRACTION_BITS)}"))
        shifted = self.assign(f"lshr {self.bits} {bits}, {self.whole(FRACTION_BITS)}")
        exponent = self.assign(f"and {self.bits} {shifted}, {self.whole(2 * EXPONENT_BIAS + 1)}")
        # adds 2^52, which leaves the integer in the last bits: processors convert 64-bit integers only one at a time
        behind = self.as_number(
            self.assign(f"or {self.bits} {exponent}, {self.whole((EXPONENT_BIAS + FRACTION_BITS) << FRACTION_BITS)}")
        )
        return self.assign(f"fsub {self.vector} {behind}, {self.splat(ALIGNED)}")

    def as_number(self, bits: str) -> str:
        return self.assign(f"bitcast {self.bits} {bits} to {self.vector}")

    def whole(self, value: int) -> str:
        return str(value) if self.lanes == 1 else "<" + ", ".join([f"i64 {value}"] * self.lanes) + ">"

    def lookup(self, table: tuple[float, ...], place: str) -> str:
        """The table's entry for each lane; the table joins the module's constants at its first use."""
        kind = f"[{len(table)} x double]"
        name = f"@table.{len(table)}.{abs(hash(table))}"
        self.tables[name] = (
            f"{name} = internal unnamed_addr constant {kind} [{', '.join(f'double {constant(v)}' for v in table)}]"
        )
        index = self.assign(f"fptosi {self.vector} {place} to {self.bits}")
        if self.lanes == 1:
            at = self.assign(f"getelementptr double, ptr {name}, i64 {index}")
            return self.assign(f"load double, ptr {at}, align 8")
        found = "poison"
        for lane in range(self.lanes):
            one = self.assign(f"extractelement {self.bits} {index}, i64 {lane}")
            at = self.assign(f"getelementptr double, ptr {name}, i64 {one}")
            value = self.assign(f"load double, ptr {at}, align 8")
            found = self.assign(f"insertelement {self.vector} {found}, double {value}, i64 {lane}")
        return found


def definitions(names: Collection[str], lanes: int) -> tuple[list[str], set[str]]:
    """IR of the functions with these names, and the declarations and tables that they need."""
    lines: list[str] = []
    beside: set[str] = set()
    for name in sorted(names):
        made = function(name)
        inputs = {(i, 0): f"%argument{i}" for i in range(made.arguments)}
        usual = Printer(made.usual, lanes, inputs)
        rare = None if made.rare is None else Printer(made.rare, lanes, inputs, prefix="r")
        lines += _definition(name, made, usual, rare)
        for printer in (usual, rare):
            if printer is not None:
                beside |= printer.intrinsics | set(printer.tables.values())
    return lines, beside


def _definition(name: str, made: Function, usual: Printer, rare: Printer | None) -> list[str]:
    vector, arguments = usual.vector, ", ".join(f"{usual.vector} %argument{i}" for i in range(made.arguments))
    head = [f"define internal {vector} @barbalat.{name}({arguments}) noinline {{", "entry:"]
    value, *_ = usual.run()
    if rare is None:
        return [*head, *usual.lines, f"  ret {vector} {value}", "}"]
    needs_rare = usual.values[made.usual.outputs[1][0]]
    (rare_value,) = rare.run()
    if usual.lanes == 1:
        any_needs = [f"  br i1 {needs_rare}, label %rare, label %done"]
    else:
        any_needs = [
            f"  %some = call i1 @llvm.vector.reduce.or.v{usual.lanes}i1({usual.mask} {needs_rare})",
            "  br i1 %some, label %rare, label %done",
        ]
        usual.intrinsics.add(f"declare i1 @llvm.vector.reduce.or.v{usual.lanes}i1({usual.mask})")
    return [
        *head, *usual.lines, *any_needs,
        "rare:", *rare.lines,
        f"  %either = select {usual.mask} {needs_rare}, {vector} {rare_value}, {vector} {value}",
        "  br label %done",
        "done:",
        f"  %value = phi {vector} [ {value}, %entry ], [ %either, %rare ]",
        f"  ret {vector} %value", "}",
    ]  # fmt: skip
