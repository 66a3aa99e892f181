"""Print the table of ratios. Exit code 1 only where a contestant computes something else than we do."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from benchmarks import house, inputs, norms, outputs, speed
from benchmarks.loops import CASES
from benchmarks.race import WrongNumbersError
from benchmarks.table import console, show

MEMBERS = 1024


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Barbalat side by side with its peers.")
    parser.add_argument("--quick", action="store_true", help="fewer repeats and variants: about a minute")
    quick = parser.parse_args().quick
    console.print("Times are ns for one RK4 step of one member: best of interleaved repeats (how much slower the median is).")
    console.print("A peer is the fastest variant of its kind; all were checked to compute what the kernel computes.")
    console.print(f"{os.cpu_count()} cores; load average before the start: {os.getloadavg()[0]:.2f}\n")
    try:
        with tempfile.TemporaryDirectory() as folder:
            for case in CASES:
                show(*speed.trajectory(case(), Path(folder), quick=quick))
            for case in CASES:
                show(*speed.ensemble(case(MEMBERS), Path(folder), quick=quick))
        show("L1 norms: a certified enclosure against quadratures", *norms.section(quick=quick))
    except WrongNumbersError as error:
        print(f"wrong numbers: {error}", file=sys.stderr)
        return 1
    show("The second core, ns per step of one member", *house.two_cores(MEMBERS, quick=quick))
    for members in (1, 16):
        show("Delay and actuator, time per state as a ratio to the plain loop's", *inputs.per_state(members, quick=quick))
        show("Output feedback, time per state as a ratio to a state-feedback loop's", *outputs.per_state(members, quick=quick))
    show("From equations to a kernel", [row for case in CASES for row in house.compiling(case(), quick=quick)], [])
    show("Memory", *house.memory(quick=quick))
    show("The command line", *house.command_line(quick=quick))
    return 0


if __name__ == "__main__":
    sys.exit(main())
