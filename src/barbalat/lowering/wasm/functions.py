"""The elementary functions of a module: one WebAssembly function for each, in which the rare list stands in a branch."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.operations import Program
from barbalat.lowering.wasm.encode import Code, Type
from barbalat.lowering.wasm.printer import Printer


def lists_of(name: str) -> list[Program]:
    """The lists that a function consists of."""
    made = function(name)
    return [made.usual] if made.rare is None else [made.usual, made.rare]


def called_by(programs: Iterable[Program]) -> list[str]:
    """The functions that these lists call, in the order that they have in a module."""
    return sorted({op.name for program in programs for op in program.operations} & FUNCTIONS)


def tables_of(names: Iterable[str]) -> tuple[dict[tuple[float, ...], int], bytes]:
    """The functions' tables by where they begin in the memory, in doubles; and the memory's first bytes."""
    places: dict[tuple[float, ...], int] = {}
    numbers: list[float] = []
    for table in (op.table for name in names for part in lists_of(name) for op in part.operations if op.name == "lookup"):
        if table not in places:
            places[table] = len(numbers)
            numbers += table
    return places, struct.pack(f"<{len(numbers)}d", *numbers)


def coded(name: str, tables: Mapping[tuple[float, ...], int]) -> Code:
    """The function as code."""
    made = function(name)
    code = Code((Type.F64,) * made.arguments, Type.F64)
    inputs = {(i, 0): i for i in range(made.arguments)}
    usual = Printer(made.usual, code, inputs, {}, tables)
    usual.run()
    if made.rare is None:
        usual.number(made.usual.outputs[0][0])
        return code
    usual.condition(made.usual.outputs[1][0])
    code.begin_if(Type.F64)
    rare = Printer(made.rare, code, inputs, {}, tables)
    rare.run()
    rare.number(made.rare.outputs[0][0])
    code.otherwise()
    usual.number(made.usual.outputs[0][0])
    code.end()
    return code
