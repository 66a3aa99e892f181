"""The elementary functions that a kernel calls, as functions beside its loop: their lists, for one number or a vector of W."""

from __future__ import annotations

from collections.abc import Collection

from barbalat.lowering.functions import Function, function
from barbalat.lowering.llvm.printer import Printer


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
