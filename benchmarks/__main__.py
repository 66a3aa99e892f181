"""Print the table of ratios. Exit code 1 only where a contestant computes something else than the kernel."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks import house, speed
from benchmarks.loops import CASES
from benchmarks.race import WrongNumbersError
from benchmarks.table import console, show


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Barbalat side by side with its peers.")
    parser.add_argument("--quick", action="store_true", help="fewer repeats and variants: about a minute")
    quick = parser.parse_args().quick
    console.print(
        "Times are ns for one RK4 step of one member: the best of interleaved repeats, then how much slower the median is."
    )
    console.print("'peer' is the fastest variant of its kind; all were checked to compute what the kernel computes.\n")
    try:
        with tempfile.TemporaryDirectory() as folder:
            for case in CASES:
                show("One trajectory", *speed.trajectory(case(), Path(folder), quick=quick))
            for case in CASES:
                show("An ensemble on one core", *speed.ensemble(case(1024), Path(folder), quick=quick))
    except WrongNumbersError as error:
        print(f"wrong numbers: {error}", file=sys.stderr)
        return 1
    show("The second core", *house.two_cores(quick=quick))
    rows = [row for case in CASES for row in house.compiling(case(), quick=quick)] + house.memory(quick=quick)
    command_rows, notes = house.command_line(quick=quick)
    show("Waiting and memory", rows + command_rows, notes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
