"""Print the table of ratios. Exit code 1 only if a contestant computes something different."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import accuracy, house, inputs, norms, outputs, processor, speed, studies
from benchmarks.loops import CASES, l1
from benchmarks.race import WrongNumbersError
from benchmarks.table import console, show


def main() -> int:
    start = time.perf_counter()
    parser = argparse.ArgumentParser(prog="./dev benchmark", description="Barbalat side by side with its peers, in one run.")
    parser.add_argument("--quick", action="store_true", help="fewer repeats, variants and peers: within a minute instead of five")
    parser.add_argument("--peers", action="store_true", help="also JAX, diffrax, heyoka and Numba, which ./dev installs for it")
    parser.add_argument("--avx2", action="store_true", help="everyone compiles as for this processor without AVX-512")
    parser.add_argument("--studies", action="store_true", help="sweeps alone: threads, stores, Dask, a million members")
    given = parser.parse_args()
    if given.avx2:
        processor.without_avx512()
    console.print(f"{processor.description()}; load average before the start: {os.getloadavg()[0]:.2f}")
    console.print("Times are ns for one RK4 step of one member: best of interleaved repeats (how much slower the median is).")
    console.print("A peer is the fastest variant of its kind; all were checked to compute what the kernel computes.\n")
    try:
        extent = speed.Extent(given.quick, given.peers)
        if not given.studies:
            compare(extent)
        compare_studies(extent)
    except WrongNumbersError as error:
        print(f"wrong numbers: {error}", file=sys.stderr)
        return 1
    if not given.peers:
        console.print("Not compared: JAX, diffrax, heyoka, Numba. --peers installs and times them.")
    console.print(f"Finished in {time.perf_counter() - start:.0f} s.")
    return 0


def compare(extent: speed.Extent) -> None:
    """Measure every section and print it as soon as it is measured."""
    quick = extent.quick
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            show(*speed.trajectory(case(), Path(folder), extent))
        for case in CASES:
            show(*speed.ensemble(case(speed.MEMBERS), Path(folder), extent))
    show("L1 norms: a certified enclosure against quadratures", *norms.section(quick=quick))
    show("The second core, ns per step of one member", *house.two_cores(speed.MEMBERS, quick=quick))
    for controller in accuracy.controllers()[: 1 if quick else None]:
        show(*accuracy.section(controller, quick=quick, peers=extent.peers))
    for members in (1, 16):
        show("Delay and actuator, time per state as a ratio to the plain loop's", *inputs.per_state(members, quick=quick))
        show("Output feedback, time per state as a ratio to a state-feedback loop's", *outputs.per_state(members, quick=quick))
    show("From equations to a kernel", [row for case in CASES for row in house.compiling(case(), quick=quick)], [])
    show("Memory", *house.memory(quick=quick))
    show("The command line", *house.command_line(quick=quick))


def compare_studies(extent: speed.Extent) -> None:
    """Measure the sweeps and then, in the same process, the peers with an equal number of members. In the opposite order the
    peers' idle threads would count as work of a sweep."""
    for title, (rows, notes) in studies.sections(quick=extent.quick):
        show(title, rows, notes)
    if extent.peers and not extent.quick:
        with tempfile.TemporaryDirectory() as folder:
            show(*speed.ensemble(l1(10_000), Path(folder), extent))


if __name__ == "__main__":
    sys.exit(main())
