"""An operation list evaluated by Python functions or printed as Python: what JAX and Numba compile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from barbalat.lowering.operations import Program

_TEXT = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul": "{0} * {1}", "div": "{0} / {1}", "neg": "-{0}",
    "fma": "{0} * {1} + {2}", "fnma": "{2} - {0} * {1}", "sqrt": "sqrt({0})", "fabs": "abs({0})",
    "lt": "{0} < {1}", "le": "{0} <= {1}", "not": "invert({0})",
    "fmin": "minimum({0}, {1})", "fmax": "maximum({0}, {1})",
    "if_else_zero": "where({0}, {1}, 0.0)", "select": "where({0}, {1}, {2})",
}  # fmt: skip


def statements(program: Program, inputs: Callable[[int, int], str]) -> list[str]:
    """Lines ``t<i> = ...``; the functions that they call are minimum, maximum, where, invert, sqrt."""
    lines = []
    for i, op in enumerate(program.operations):
        if op.name == "constant":
            text = repr(op.value)
        elif op.name == "input":
            text = inputs(*op.source)
        else:
            text = _TEXT[op.name].format(*(f"t{j}" for j in op.operands))
        lines.append(f"t{i} = {text}")
    return lines


def step(program: Program, functions: dict[str, Any]) -> Callable[[Sequence[Any], Sequence[Any], Sequence[Any]], tuple[Any, ...]]:
    """The step as a Python function (state, parameters, signals) -> state, all sequences of scalars."""
    arguments = {0: "state", 2: "parameters", 3: "signals"}
    body = statements(program, lambda argument, component: f"{arguments[argument]}[{component}]")
    result = ", ".join(f"t{i}" for i in program.outputs[0])
    source = "\n    ".join(["def step(state, parameters, signals):", *body, f"return ({result},)"])
    namespace = {"inf": float("inf"), **functions}
    exec(compile(source, "<operation list>", "exec"), namespace)
    return namespace["step"]
