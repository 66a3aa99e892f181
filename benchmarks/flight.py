"""The cost of a sample of an exported controller on a Cortex-M4F: instructions, bytes, and an estimate of the rate.

``python -m benchmarks.flight`` writes docs/guides/flight-cost.txt. The count covers the instructions that an emulated Cortex-M4F
executes from the call of the step to its return. They are logged one by one with `-singlestep -d exec,nochain`, as Debian's QEMU
has no counting plugins. The cycles are an estimate from Arm's table for the Cortex-M4, without flash wait states.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from barbalat.export.contents import Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering import c99
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from benchmarks.flight_cases import CASES, SIMULATION, shelled

MACHINE = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
OPTIONS = ["-std=c99", "-ffp-contract=off", "-O2"]
BOARD = Path(__file__).parents[1] / "examples" / "cortex-m"
PAGE = Path(__file__).parents[1] / "docs" / "guides" / "flight-cost.txt"
BOARD_EMULATOR = (
    "qemu-system-arm", "-M", "mps2-an386", "-nographic", "-semihosting-config", "enable=on,target=native", "-kernel", "program",
)  # fmt: skip
SAMPLES = 20
"""Number of samples whose instructions are counted, from the first sample on. The table shows the longest sample."""
CLOCK = 168e6
"""Clock rate [Hz] of the STM32F4 in small flight controllers."""
REFILL = 3
"""Further cycles of a branch that is taken. The table states 1 to 3; the largest number is used here."""
CYCLES = {
    **dict.fromkeys(("vdiv", "vsqrt"), 14),
    **dict.fromkeys(("sdiv", "udiv"), 12),
    **dict.fromkeys(("vmla", "vmls", "vfma", "vfms"), 3),
    **dict.fromkeys(("vldr", "vstr", "ldr", "str"), 2),
}
"""Cycles of the instructions that take more than one. Source: Cortex-M4 Technical Reference Manual r0p1 (DDI 0439), tables 3-1
and 7-1. Texas Instruments has the same tables in the SimpleLink CC13x2x7 Technical Reference Manual (SWCU192), tables 3-25 and
3-27."""
SEVERAL = ("push", "pop", "ldm", "stm", "vpush", "vpop", "vldm", "vstm", "ldrd", "strd")
"""Instructions that take 1 + N cycles for N registers."""

_MAIN = """\
#include "controller.h"

static const float measured[{samples}][{macro}_MEASURED] = {{{measured}}};
static const float commands[{samples}][{macro}_COMMANDS] = {{{commands}}};
{name}_controller controller_state;

int main(void)
{{
    int k, i;
    {name}_init(&controller_state);
    for (k = 0; k < {samples}; ++k) {{
        {name}_input in;
        {name}_output out;
        in.sample_time = {macro}_SAMPLE_TIME;
        in.freeze = 0;
        for (i = 0; i < {macro}_MEASURED; ++i) in.{y}[i] = measured[k][i];
        for (i = 0; i < {macro}_COMMANDS; ++i) in.r[i] = commands[k][i];
        if ({name}_step(&controller_state, &in, &out) != 0u) return 1;
    }}
    return 0;
}}
"""


@dataclass(frozen=True)
class Cost:
    """The cost of one sample of one controller, in 32 bits."""

    operations: int
    instructions: int
    cycles: int
    code: int
    data: int
    stack: int

    @property
    def rate(self) -> float:
        """Estimated rate [Hz] if nothing else is computed and the flash has no wait states."""
        return CLOCK / self.cycles


def cost(problem: TrackingProblem, controller: Controller) -> Cost:
    """Compile a controller, run it on the emulated machine, and count."""
    printed = Printed(Contents.of(problem, controller, SIMULATION, c99.FLOAT), prefix="flown")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        build(folder, printed, main_program(printed))
        text, _, _ = _run(folder, "arm-none-eabi-size", "controller.o").splitlines()[1].split()[:3]
        data = int(re.findall(r"^\w+ (\w+) \w controller_state$", _run(folder, "arm-none-eabi-nm", "-S", "program"), re.M)[0], 16)
        cycles, instructions = max(counted(folder, f"{printed.name}_step"))
        stack = _stack((folder / "controller.ci").read_text(), f"{printed.name}_step")
    return Cost(len(printed.contents.step.operations), instructions, cycles, int(text), data, stack)


def build(folder: Path, printed: Printed, main: str) -> None:
    """Build the controller and a program that calls it, for the board."""
    for name, text in {"controller.h": header(printed), "controller.c": source(printed), "main.c": main}.items():
        (folder / name).write_text(text)
    _run(folder, "arm-none-eabi-gcc", *MACHINE, *OPTIONS, "-fcallgraph-info=su", "-c", "controller.c")
    _run(folder, "arm-none-eabi-gcc", *MACHINE, *OPTIONS, "-c", "main.c")
    linked = ["--specs=rdimon.specs", "-T", str(BOARD / "memory.ld"), str(BOARD / "startup.c")]
    _run(folder, "arm-none-eabi-gcc", *MACHINE, *OPTIONS, "main.o", "controller.o", *linked, "-o", "program")


def main_program(printed: Printed) -> str:
    """The C source of a program that runs the first samples."""
    vectors = printed.contents.vectors
    rows = {
        name: ", ".join("{" + ", ".join(c99.constant(v, c99.FLOAT) for v in row) + "}" for row in values[:SAMPLES])
        for name, values in (("measured", vectors.measured), ("commands", vectors.commands))
    }
    return _MAIN.format(name=printed.name, macro=printed.macro, samples=SAMPLES, y=printed.measured, **rows)


def _run(folder: Path, *command: str) -> str:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, timeout=120).stdout


def counted(folder: Path, step: str) -> list[tuple[int, int]]:
    """The cycles and instructions of each sample."""
    listing = _run(folder, "arm-none-eabi-objdump", "-d", "program")
    (entry,) = (int(at, 16) for at in re.findall(rf"^(\w+) <{step}>:$", listing, re.MULTILINE))
    code: dict[int, tuple[int, str, str]] = {}
    for at, raw, name, operands in re.findall(r"^ *(\w+):\t([\da-f ]+?) *\t(\S+)(?:\t([^\n]*))?$", listing, re.MULTILINE):
        code[int(at, 16)] = len(raw.replace(" ", "")) // 2, name, operands
    _run(folder, *BOARD_EMULATOR, "-singlestep", "-d", "exec,nochain", "-D", "trace")
    trace = [int(at, 16) for at in re.findall(r"^Trace \d+: \S+ \[\w+/(\w+)/", (folder / "trace").read_text(), re.MULTILINE)]
    calls, found = [k for k, at in enumerate(trace) if at == entry], []
    if len(calls) != SAMPLES:
        raise RuntimeError(f"{step} was called {len(calls)} times on the emulated machine, not {SAMPLES}")
    for first in calls:
        back = trace[first - 1] + code[trace[first - 1]][0]  # the instruction after the call
        last = trace.index(back, first)
        run = trace[first : last + 1]
        found.append(
            (
                sum(_cycles(*code[at], taken=after != at + code[at][0]) for at, after in pairwise(run)),
                last - first,
            )
        )
    return found


def _cycles(_: int, name: str, operands: str, *, taken: bool) -> int:
    plain = name.split(".", maxsplit=1)[0]
    refill = REFILL if taken else 0
    if plain in SEVERAL or plain.startswith(("ldmia", "stmia", "ldmdb", "stmdb", "vldmia", "vstmia")):
        return 1 + _registers(operands) + refill
    if plain == "vmov" and operands.count(",") == 2:
        return 2  # two registers at once
    base = next((count for start, count in CYCLES.items() if plain.startswith(start)), 1)
    base += plain in {"vldr", "vstr"} and operands.startswith("d")  # a pair of registers
    return base + refill


def _registers(operands: str) -> int:
    if "{" not in operands:
        return 2  # of ldrd and strd
    count = 0
    for part in operands[operands.index("{") + 1 : operands.index("}")].split(","):
        first, _, last = part.strip().partition("-")
        count += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return count


def _stack(graph: str, step: str) -> int:
    """Bytes of the longest path from the step on, by the compiler's call graph. The library functions, which only copy or set
    memory, use none."""
    own = {name: int(size) for name, size in re.findall(r'title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(static\)', graph)}
    below: dict[str, set[str]] = {}
    for caller, callee in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
        below.setdefault(caller, set()).add(callee)
    plain = {name.rpartition(":")[2]: name for name in own}

    def deepest(name: str) -> int:
        return own.get(name, 0) + max((deepest(one) for one in below.get(name, ())), default=0)

    return deepest(plain[step])


def tools() -> str:
    """The tools and settings on which the numbers depend in addition to the controllers."""
    compiler = _run(Path.cwd(), "arm-none-eabi-gcc", "--version").splitlines()[0]
    emulator = _run(Path.cwd(), "qemu-system-arm", "--version").splitlines()[0]
    return f"Compiled with `{' '.join([*MACHINE, *OPTIONS])}` by {compiler}; executed by {emulator}."


def page() -> str:
    """The table and the tools with which it was made."""
    lines = [
        "<!-- Written by python -m benchmarks.flight: do not edit. -->",
        "| controller | operations | instructions | cycles (estimate) | with a shell | rate at 168 MHz (estimate) "
        "| code | state | stack |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, problem, controller in CASES:
        c, more = cost(problem, controller), cost(shelled(problem), controller)
        sizes = " | ".join(f"{value} B" for value in (c.code, c.data, c.stack))
        cycles = f"{c.cycles} | {more.cycles}"
        lines.append(f"| {name} | {c.operations} | {c.instructions} | {cycles} | {c.rate / 1e3:.0f} kHz | {sizes} |")
        print(lines[-1], flush=True)
    return "\n".join([*lines, "", tools(), ""])


if __name__ == "__main__":
    PAGE.write_text(page())
    print(f"written: {PAGE}", file=sys.stderr)
