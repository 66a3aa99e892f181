"""One step from every state and every input by Frama-C's Eva, in a program whose numbers are whole intervals."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from pathlib import Path

from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.operations import Program
from export.targets import write

OPTIONS = (
    "-eva", "-eva-precision", "0",
    "-eva-min-loop-unroll", "256",  # every check of an entry is analysed separately
    "-eva-split-return", "full",  # a check's result together with the values that it has examined
    "-eva-slevel-function", "advance:20",  # no check in it: analysing its choices separately takes a minute and shows nothing
    "-warn-special-float", "non-finite",
)  # fmt: skip
LARGEST = {"double": sys.float_info.max.hex(), "float": "0x1.fffffep+127f"}
STATES = 2000
"""Largest number of states kept apart at a line, which is enough for the checks of some twenty entries. More would take minutes
elsewhere."""
SECONDS = 2400
"""Time limit for one step. A step with a shell takes some ten minutes."""
MEMBER = re.compile(r"^\s+(double|float|long|int) (\w+)(?:\[(\w+)\])?;", re.MULTILINE)
ANY = {
    "double": "Frama_C_double_interval(-DBL_MAX, DBL_MAX)",
    "float": "Frama_C_float_interval(-FLT_MAX, FLT_MAX)",
    "long": "Frama_C_long_interval(LONG_MIN, LONG_MAX)",
    "int": "Frama_C_interval(INT_MIN, INT_MAX)",
}
_MAIN = """\
#include "controller.h"
#include <float.h>
#include <limits.h>
#include "__fc_builtin.h"

int main(void)
{{
    {name}_controller c;
    {name}_input in;
    {name}_output out;
{given}{set}    {name}_step(&c, &in, &out);
    return 0;
}}
"""


def alarms(printed: Printed, folder: Path, states: int = STATES) -> list[str]:
    """Faults that Eva can't exclude in one step from any finite numbers, including violations of the header's contract."""
    assert unbounded_alone(printed.contents.step), "an infinite constant is not a bound here: it may be computed with"
    text = source(printed).replace("INFINITY", LARGEST[printed.real])
    write(folder, {"controller.h": header(printed), "controller.c": text, "main.c": _main(printed)})
    command = ["frama-c", *OPTIONS, "-eva-slevel", str(states), "controller.c", "main.c"]
    surroundings = {**os.environ, "PWD": str(folder)}  # from which Frama-C finds the files
    done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=SECONDS, check=True)
    text = done.stdout
    assert "100% of the logical properties reached have been proven" in text or "[eva:alarm]" in text, text[-2000:]
    assert re.search(r"(\d+) functions analyzed \(out of \d+\)", text), text[-2000:]
    found = re.findall(r"\[eva:alarm\][^\n]*\n(?:  [^\n]*\n)+", text)
    return [*found, *re.findall(r"[^\n]*(?:invalid|unknown)\.[^\n]*", text)]


def unbounded_alone(program: Program) -> bool:
    """Whether every infinite constant is an inactive bound: the second operand of a minimum or maximum.

    Then the largest finite number has the same effect and can replace them for Eva, which treats an infinite constant as an
    alarm. Eva shows that every other operand is finite, so none exceeds this number and the bound is never the result.
    """
    infinite: dict[int, float] = {}
    for i, op in enumerate(program.operations):
        if op.name == "constant" and math.isinf(op.value):
            infinite[i] = op.value
        found = {infinite[j] for j in op.operands if j in infinite}
        if not found:
            continue
        bounds = {"fmin": math.inf, "fmax": -math.inf}
        if op.name in {"select", "if_else_zero"} and len(found) == 1 and op.operands[0] not in infinite:
            (infinite[i],) = found
        elif op.operands[0] in infinite or bounds.get(op.name) not in found or len(found) > 1:
            return False
    return not any(i in infinite for row in program.outputs for i in row)


def _main(printed: Printed) -> str:
    text = header(printed)
    sizes = dict(re.findall(r"#define (\w+) (\d+)$", text, re.MULTILINE))
    given = []
    for variable, kind in (("c", "controller"), ("in", "input")):
        (body,) = re.findall(rf"typedef struct \{{([^}}]*)\}} {printed.name}_{kind};", text)
        for of, member, size in MEMBER.findall(body):
            places = [""] if not size else [f"[{i}]" for i in range(int(sizes.get(size, size)))]
            given += [f"    {variable}.{member}{place} = {ANY[of]};\n" for place in places]
    set_one = f"    {printed.name}_set(&c, {ANY['int']}, {ANY[printed.real]}, {ANY['long']});\n"
    return _MAIN.format(name=printed.name, given="".join(given), set=set_one if printed.contents.parameters else "")
