"""Translates an operation list to C99 source of the same time loop, for embedded targets and as an independent check of the
kernel.

Every operation becomes one local constant, in the order of the list. Compiled with ``-ffp-contract=off``, the C code gives the
same results, bit for bit, as the LLVM kernel of the same list. ``-ffast-math`` must not be used: it assumes that no value is
infinite or NaN, but accumulators start at infinity, and a diverging run must remain visible.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.functions.formats import DOUBLE as DOUBLE_FORMAT
from barbalat.lowering.functions.formats import SINGLE, Format
from barbalat.lowering.operations import COMPARISONS, Operation, Program
from barbalat.lowering.shape import ENTRY, LoopShape

_EXPONENT = """\
static {real} barbalat_exponent({real} x)
{{
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    return ({real})(int{width}_t)((bits >> {stored}) & {exponents}U) - {bias};
}}
"""
_SIGNIFICAND = """\
static {real} barbalat_significand({real} x)
{{
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits = (bits & UINT{width}_C(0x{fraction:0{digits}x})) | UINT{width}_C(0x{one:0{digits}x});
    memcpy(&x, &bits, sizeof bits);
    return x;
}}
"""
_POW2 = """\
static {real} barbalat_pow2({real} k)
{{
    {real} x = k + {aligned}; /* 2^{stored} + {largest}: k with its bias is in the last bits */
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits <<= {stored};
    memcpy(&x, &bits, sizeof bits);
    return x;
}}
"""
OF_BITS = {"exponent": _EXPONENT, "significand": _SIGNIFICAND, "pow2": _POW2}


def of_bits(name: str, real: str, suffix: str, of: Format) -> str:
    """The C source of one of OF_BITS for numbers of this type."""
    width, stored = (32 if of is SINGLE else 64), of.bits - 1
    return OF_BITS[name].format(
        real=real,
        width=width,
        digits=width // 4,
        stored=stored,
        largest=of.largest_exponent,
        exponents=2 * of.largest_exponent + 1,
        bias=f"{of.largest_exponent:.1f}{suffix}",
        fraction=2**stored - 1,
        one=of.largest_exponent << stored,
        aligned=f"{of.aligned:.1f}{suffix}",
    )


_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_LIBRARY = {"sqrt": 1, "fabs": 1, "floor": 1, "ceil": 1, "copysign": 2, "fma": 3}
"""Functions of math.h whose results are exact or correctly rounded on every platform, and their numbers of arguments."""

_LOOP = """\
#include <math.h>
#include <stdint.h>
#include <string.h>

{functions}void {name}(int64_t blocks, int64_t steps, double *restrict state, const double *restrict parameters,
{indent}const double *restrict signals, double *restrict out)
{{
{declarations}{load}    for (int64_t block = 0; block < blocks; ++block) {{
{begin}        for (int64_t k = 0; k < steps; ++k) {{
{body}            signals += {signals};
        }}
{end}        out += {row};
    }}
{store}}}
"""


@dataclass(frozen=True, slots=True)
class Real:
    """A C type for numbers: its name, the suffixes of constants and of math.h functions, and its format."""

    name: str
    suffix: str
    numbers: type[np.floating]
    format: Format


DOUBLE, FLOAT = Real("double", "", np.float64, DOUBLE_FORMAT), Real("float", "f", np.float32, SINGLE)


def constant(value: float, real: Real = DOUBLE) -> str:
    """A number in a form that C99 represents exactly: a hexadecimal constant (section 6.4.4.2) or a macro of math.h."""
    with np.errstate(over="ignore"):
        value = float(real.numbers(value))
    if not math.isfinite(value):  # macros of type float, because -Wdouble-promotion checks them
        cast = "(double)" if real is DOUBLE else ""
        return f"{'-' if value < 0 else ''}{cast}{'NAN' if math.isnan(value) else 'INFINITY'}"
    return f"{value.hex()}{real.suffix}"


def statements(program: Program, inputs: dict[tuple[int, int], str], real: Real = DOUBLE) -> list[str]:
    """One declaration for each operation; the value of operation i has the name t<i>.

    ``inputs`` gives the C text of each input by (argument, component). Raises ValueError for an operation without translation.
    """
    printer = Printer(program, real)
    lines = []
    for i, op in enumerate(program.operations):
        kind, remark = "int" if op.name in COMPARISONS else real.name, ""
        if op.name == "constant":
            text = constant(op.value, real)
            remark = f" /* {op.value!r} */" if math.isfinite(op.value) else ""
        else:
            text = inputs[op.source] if op.name == "input" else printer.expression(op)
        lines.append(f"const {kind} t{i} = {text};{remark}")
    return lines


def calls_functions(program: Program, real: Real = DOUBLE) -> bool:
    """Whether the C text of the operations needs math.h, which also defines the infinity to which a large constant rounds in 32
    bits."""
    names = {op.name for op in program.operations}
    with np.errstate(over="ignore"):
        constants = {float(real.numbers(op.value)) for op in program.operations if op.name == "constant"}
    return bool(names & {*_LIBRARY, *FUNCTIONS, "fnma"}) or not all(map(math.isfinite, constants))


class Printer:
    """The C text of operations whose values have the names t<i>."""

    def __init__(self, program: Program, real: Real = DOUBLE) -> None:
        self.real = real
        self.zero = f"0.0{real.suffix}"
        self.operations = program.operations

    def is_truth(self, i: int) -> bool:
        return self.operations[i].name in COMPARISONS

    def number(self, i: int) -> str:
        """Value i as a number; a truth value becomes 0 or 1, with a sign."""
        return f"({self.real.name})t{i}" if self.is_truth(i) else f"t{i}"

    def condition(self, i: int) -> str:
        return f"t{i}" if self.is_truth(i) else f"(t{i} != {self.zero})"

    def expression(self, op: Operation) -> str:
        name, operands = op.name, op.operands
        if name in ("not", "and", "or"):
            c = [self.condition(i) for i in operands]
            return f"!{c[0]}" if name == "not" else f"{c[0]} {'&' if name == 'and' else '|'} {c[1]}"
        if name in ("select", "if_else_zero"):
            other = self.number(operands[2]) if name == "select" else self.zero
            return f"{self.condition(operands[0])} ? {self.number(operands[1])} : {other}"
        x = [self.number(i) for i in operands]
        if name in _INFIX:
            return f"{x[0]} {_INFIX[name]} {x[1]}"
        if name in ("fmin", "fmax"):
            return self.extremum(name, x)
        if name == "neg":
            return f"-{x[0]}"
        if name == "fnma":
            return f"fma{self.real.suffix}(-{x[0]}, {x[1]}, {x[2]})"
        if _LIBRARY.get(name) == len(x):
            return f"{name}{self.real.suffix}({', '.join(x)})"
        if name in FUNCTIONS or name in OF_BITS:
            return f"barbalat_{name}({', '.join(x)})"
        if name == "lookup":
            return f"table[(int){x[0]}]"
        raise ValueError(f"the operation {name} has no C translation")

    def extremum(self, name: str, x: list[str]) -> str:
        """A minimum or maximum that passes on a NaN of the first operand, as in the LLVM kernel; fmin and fmax of C would not."""
        return f"{x[0]} {'<' if name == 'fmax' else '>'} {x[1]} ? {x[1]} : {x[0]}"


def loop(step: Program, shape: LoopShape, resets: tuple[float, ...], lanes: int = 1) -> str:
    """C99 source of ``void barbalat_loop(blocks, steps, state*, parameters*, signals*, out*)``; arrays as in ``llvm.ir.loop``.

    One lane keeps the state in local variables. More lanes are an inner loop over local arrays, which compilers vectorise.
    """
    if shape.delayed or shape.noise or shape.sample_every or shape.in_pieces:
        raise ValueError("a step with a delay, noise or a sampled part, or in pieces, has no C translation yet")
    n, m = shape.states, shape.accumulators
    x, a = ([_local(letter, i, lanes) for i in range(size)] for letter, size in (("x", n), ("a", m)))
    inputs = {(0, i): local for i, local in enumerate(x)} | {(1, i): local for i, local in enumerate(a)}
    inputs |= {(2, i): _entry("parameters", i, lanes) for i in range(shape.parameters)}
    inputs |= {(3, i): f"signals[{i}]" for i in range(shape.signals)}
    printer = Printer(step)
    following = [printer.number(i) for row in step.outputs for i in row]
    begin = [f"{_entry('out', i, lanes)} = {local};" for i, local in enumerate(x)]
    begin += [f"{local} = {constant(reset)};" for local, reset in zip(a, resets, strict=True)]
    body = statements(step, inputs) + [f"{local} = {value};" for local, value in zip(x + a, following, strict=True)]
    return _LOOP.format(
        functions=definitions([step]),
        name=ENTRY,
        indent=" " * len(f"void {ENTRY}("),
        declarations=_lines(_declarations(n, m, lanes), 4),
        load=_lines(_each_lane([f"{local} = {_entry('state', i, lanes)};" for i, local in enumerate(x)], lanes), 4),
        begin=_lines(_each_lane(begin, lanes), 8),
        body=_lines(_each_lane(body, lanes), 12),
        end=_lines(_each_lane([f"{_entry('out', n + i, lanes)} = {local};" for i, local in enumerate(a)], lanes), 8),
        store=_lines(_each_lane([f"{_entry('state', i, lanes)} = {local};" for i, local in enumerate(x)], lanes), 4),
        signals=shape.signals,
        row=(n + m) * lanes,
    )


def _declarations(n: int, m: int, lanes: int) -> list[str]:
    sizes = [(letter, size) for letter, size in (("x", n), ("a", m)) if size]
    if lanes > 1:
        return [f"double {letter}[{size}][{lanes}];" for letter, size in sizes]
    return [f"double {', '.join(_local(letter, i, lanes) for i in range(size))};" for letter, size in sizes]


def _local(letter: str, i: int, lanes: int) -> str:
    return f"{letter}{i}" if lanes == 1 else f"{letter}[{i}][lane]"


def _entry(array: str, i: int, lanes: int) -> str:
    """Component i of this lane in an array with interleaved lanes."""
    return f"{array}[{i}]" if lanes == 1 else f"{array}[{i * lanes} + lane]"


def _each_lane(lines: list[str], lanes: int) -> list[str]:
    if lanes == 1 or not lines:
        return lines
    return [f"for (int lane = 0; lane < {lanes}; ++lane) {{", *("    " + line for line in lines), "}"]


def _lines(lines: list[str], indent: int) -> str:
    return "".join(f"{' ' * indent}{line}\n" for line in lines)


NOTICE = """\
/* Coefficients: fdlibm. Copyright (C) 1993, 2004 by Sun Microsystems, Inc. All rights reserved. Permission to use, copy,
 * modify, and distribute this software is freely granted, provided that this notice is preserved. */
"""


def definitions(programs: Iterable[Program], real: Real = DOUBLE) -> str:
    """The C source of the functions that these lists call, preceded by the functions on which they depend."""
    called = {op.name for program in programs for op in program.operations} & FUNCTIONS
    made = [function(name, real.format) for name in sorted(called)]
    used = {op.name for one in made for part in (one.usual, one.rare) if part is not None for op in part.operations}
    text = [of_bits(name, real.name, real.suffix, real.format) for name in OF_BITS if name in used]
    return "\n".join([NOTICE, *text, *(_definition(name, real) for name in sorted(called)), ""]) if called else ""


def _definition(name: str, real: Real) -> str:
    made = function(name, real.format)
    arguments = ", ".join(f"{real.name} x{i}" for i in range(made.arguments))
    passed = ", ".join(f"x{i}" for i in range(made.arguments))
    if made.rare is None:
        return _function(f"barbalat_{name}", arguments, made.usual, "", real)
    rare = f"barbalat_{name}_rare"
    otherwise = f"    if (t{made.usual.outputs[1][0]}) {{\n        return {rare}({passed});\n    }}\n"
    usual = _function(f"barbalat_{name}", arguments, made.usual, otherwise, real)
    return _function(rare, arguments, made.rare, "", real) + "\n" + usual


def _function(name: str, arguments: str, program: Program, otherwise: str, real: Real) -> str:
    tables = dict.fromkeys(op.table for op in program.operations if op.name == "lookup")
    lines = [f"static const {real.name} table[] = {{{', '.join(constant(entry, real) for entry in table)}}};" for table in tables]
    lines += statements(program, {(i, 0): f"x{i}" for i in range(len(program.operations))}, real)
    body = "".join(f"    {line}\n" for line in lines)
    return f"static {real.name} {name}({arguments})\n{{\n{body}{otherwise}    return t{program.outputs[0][0]};\n}}\n"
