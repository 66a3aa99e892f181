"""Translation validation: the terms of a compiled exported step, compared with the terms of the operation list."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.functions import FUNCTIONS
from barbalat.lowering.operations import Operation, sources
from barbalat.run.kernel.sampled_controller import COMMAND, FREEZE, MEASURED, PARAMETER, STATE
from export.llvm_terms import SIZES, Run
from export.targets import ISO, write
from export.terms import Terms

CLANG = [
    "clang",
    *ISO,
    "-Dstatic=",
    "-fno-inline",
    "-fno-slp-vectorize",
    "-fno-vectorize",
    "-mllvm",
    "-slp-threshold=10000",
    "-S",
    "-emit-llvm",
]
"""Options with which ``advance`` remains a separate function, sin, ... remain calls, and numbers remain scalars."""
TYPED_POINTER = re.compile(r"(%struct\.\w+|\[\d+ x \w+\]|double|float|i\d+)\*+")
"""Pointer types as clang wrote them up to version 14."""


def compiled(printed: Printed, folder: Path, level: str, text: str | None = None) -> str:
    """LLVM's text of the export or of a different source in its place."""
    write(folder, {"controller.h": header(printed), "controller.c": text or source(printed)})
    command = [*CLANG, level, "controller.c", "-o", "controller.ll"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return TYPED_POINTER.sub("ptr", (folder / "controller.ll").read_text())


def difference(printed: Printed, made: str) -> str:
    """The difference of the compiled step from its list, as an entry of the state and a missing operation. It is empty if they
    are equal."""
    contents, program = printed.contents, printed.contents.step
    terms = Terms(contents.real.numbers)
    offsets = _offsets(printed)
    run = Run(made, terms, printed.real)
    run.run("advance")
    inputs = _inputs(printed, terms, offsets)
    values = [0] * len(program.operations)
    for i, op in enumerate(program.operations):
        values[i] = of_list(terms, op, values, inputs)
    rows = contents.layout.rows
    pairs = [
        (number(terms, values[i]), run.number_at("0", offsets[row])) for i, row in zip(program.outputs[0], rows, strict=True)
    ]
    if not terms.differ(pairs):
        return ""
    row, (wanted, other) = next((row, pair) for row, pair in zip(rows, pairs, strict=True) if terms.differ([pair]))
    there, needed = set(terms.below(other)), set(terms.below(wanted))
    missing = [i for i, value in enumerate(values) if value in needed and value not in there]
    where = f", operation t{missing[0]} = {program.operations[missing[0]].name} of the list is not there" if missing else ""
    return f"{contents.layout.entries()[row]} differs{where}"


def _offsets(printed: Printed) -> dict[int, int]:
    """The offsets of the flat state's entries in the struct."""
    found, at, size = {}, 0, SIZES[printed.real]
    for part in printed.contents.layout.parts:
        found |= {row: at + size * i for i, row in enumerate(part.rows)}
        at += size * part.size
    return found


def _inputs(printed: Printed, terms: Terms, offsets: dict[int, int]) -> dict[tuple[int, int], int]:
    size = SIZES[printed.real]
    y, q, _, _ = printed.contents.sizes
    inputs = {(STATE, row): terms.input("0", offset) for row, offset in offsets.items()}
    inputs |= {(MEASURED, i): terms.input("1", size * (1 + i)) for i in range(y)}
    inputs |= {(COMMAND, i): terms.input("1", size * (1 + y + i)) for i in range(q)}
    switch = terms.input("1", size * (1 + y + q), kind="flag")  # true: 0
    inputs |= {(FREEZE, 0): terms.chosen(switch, terms.constant(0.0), terms.constant(1.0))}
    contents, behind = printed.contents, size * len(offsets)  # parameters follow the state
    for at in sorted(at for kind, at in sources(contents.step) if kind == PARAMETER):
        one = contents.fed(at)
        place = None if isinstance(one, float) else contents.parameters.index(one)
        inputs[PARAMETER, at] = terms.constant(one) if place is None else terms.input("0", behind + size * place)
    return inputs


def number(terms: Terms, value: int) -> int:
    """A truth value as 1 or 0."""
    truth = terms.nodes[value][0] in {"lt", "le", "eq", "not", "and", "or", "flag", "true"}
    return terms.chosen(value, terms.constant(1.0), terms.constant(0.0)) if truth else value


def truth(terms: Terms, value: int) -> int:
    """A number as a truth value: true unless it is zero."""
    return value if number(terms, value) != value else terms.negated(terms.compare("eq", value, terms.constant(0.0)))


def of_list(terms: Terms, op: Operation, values: list[int], inputs: dict[tuple[int, int], int]) -> int:  # noqa: PLR0912  # a case each
    """The term of an operation, as ``CONTRIBUTING.md`` defines it."""
    if op.name == "constant":
        return terms.constant(op.value)
    if op.name == "input":
        return inputs[op.source]
    given = [values[i] for i in op.operands]
    x = [number(terms, one) for one in given]
    match op.name:
        case "not":
            return terms.negated(truth(terms, given[0]))
        case "and":
            return terms.both(*(truth(terms, one) for one in given))
        case "or":
            return terms.negated(terms.both(*(terms.negated(truth(terms, one)) for one in given)))
        case "select" | "if_else_zero":
            return terms.chosen(truth(terms, given[0]), x[1], x[2] if len(x) > 2 else terms.constant(0.0))
        case "fmin":
            return terms.chosen(terms.compare("lt", x[1], x[0]), x[1], x[0])
        case "fmax":
            return terms.chosen(terms.compare("lt", x[0], x[1]), x[1], x[0])
        case "ne":
            return terms.negated(terms.compare("eq", *x))
        case "lt" | "le" | "eq":
            return terms.compare(op.name, *x)
        case "sub":
            return terms.of("add", x[0], terms.neg(x[1]))
        case "neg":
            return terms.neg(x[0])
        case "add" | "mul" | "div":
            return terms.of(op.name, *x)
    assert op.name in {"sqrt", "fabs", *FUNCTIONS}, op.name
    return terms.make(f"f_{op.name}" if op.name in FUNCTIONS else op.name, *x)
