"""Operations -> LLVM IR text, for numbers or for vectors of W members at once."""

from __future__ import annotations

import struct

from barbalat.lowering.operations import COMPARISONS, Program

_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
_INTRINSICS = {
    "sqrt": 1, "fabs": 1, "floor": 1, "ceil": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "tanh": 1,
    "pow": 2, "copysign": 2,
}  # fmt: skip


def constant(value: float) -> str:
    """A double as LLVM writes it exactly: by its bits."""
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
        self.lines: list[str] = []
        self.intrinsics: set[str] = set()
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
                value = self.operation(op.name, op.operands)
            self.values.append(value)
            self.truth.append(op.name in COMPARISONS)
        return [self.number(i) for row in self.program.outputs for i in row]

    def operation(self, name: str, operands: tuple[int, ...]) -> str:
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
        raise ValueError(f"the operation {name} has no LLVM translation")

    def extremum(self, name: str, x: list[str]) -> str:
        """Minimum or maximum that lets the first operand's NaN through instead of the bound: a blow-up must stay visible."""
        relation = "olt" if name == "fmax" else "ogt"
        return self.select(self.assign(f"fcmp {relation} {self.vector} {x[0]}, {x[1]}"), x[1], x[0])
