"""What a user waits for besides the steps: compiling, the second core, memory, the command line."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from barbalat import RK4, Simulation
from barbalat.closed_loop import ClosedLoop
from barbalat.engine import Batch, best_lanes, run
from barbalat.lowering.machine import Kernel
from barbalat.stepping import step_program
from benchmarks.loops import PROBLEM, STEP, Case, l1
from benchmarks.table import Row

MEMORY_PROBE = """
import resource, sys
from barbalat import Simulation
from barbalat.engine import Batch, run
from benchmarks.loops import PROBLEM, STEP, l1
case = l1(64)
run([Batch(case.optimised(figures=True), case.states, case.parameters)], PROBLEM.signals, Simulation(t_end=float(sys.argv[1]), dt=STEP))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def compiling(case: Case, *, quick: bool) -> list[Row]:
    """Equations to a running kernel with all figures, imports done, nothing cached."""

    def build(lanes: int) -> None:
        program = step_program(ClosedLoop.of(PROBLEM, case.controller), RK4, STEP)
        assert program.accumulators is not None
        Kernel(program.program, program.shape, program.accumulators.resets, lanes)

    rows = []
    for lanes in (1, best_lanes(1024)):
        samples = [_seconds(lambda lanes=lanes: build(lanes)) for _ in range(3 if quick else 7)]  # type: ignore[misc]
        rows.append(
            Row(
                f"{case.name}: equations to kernel, {lanes} lane{'s' * (lanes > 1)} [s]",
                f"{min(samples):.3f} s (median {np.median(samples):.3f} s)",
                "",
                min(samples),
                at_most=0.15,
            )
        )
    return rows


def two_cores(*, quick: bool) -> tuple[list[Row], list[str]]:
    """The engine with all figures: one thread against two, and what it adds to the bare kernel."""
    if (os.cpu_count() or 1) < 2:
        return [], ["skipped: two cores against one, this computer has one"]
    case = l1(1024)
    program = case.optimised(figures=True)
    simulation = Simulation(t_end=1.0 if quick else 4.0, dt=STEP)

    def engine(threads: int) -> float:
        batch = Batch(program, case.states, case.parameters)
        return _seconds(lambda: run([batch], PROBLEM.signals, simulation, threads=threads))

    one, two = np.array([(engine(1), engine(2)) for _ in range(3 if quick else 7)]).T
    unit = 1e9 / simulation.steps / case.members

    def text(samples: np.ndarray) -> str:
        return f"{samples.min() * unit:.3g} ns (median +{100 * (np.median(samples) / samples.min() - 1):.0f}%)"

    ratio = one.min() / two.min()
    return [
        Row(
            f"engine, {case.members} members, all figures: two threads",
            text(two),
            "one thread: " + text(one),
            ratio,
            at_least=1.8,
        )
    ], []


def memory(*, quick: bool) -> list[Row]:
    """Peak memory of an ensemble that records nothing, for t_end and for ten times that."""
    t_end = 2.0 if quick else 20.0
    short, long = (_peak_memory(t) for t in (t_end, 10 * t_end))
    return [
        Row(
            f"peak memory, 64 members, {10 * t_end:g} s against {t_end:g} s",
            f"{long / 1024:.1f} MiB",
            f"{short / 1024:.1f} MiB",
            long / short,
            at_most=1.05,  # what two runs of one length differ by
        )
    ]


def _peak_memory(t_end: float) -> float:
    """KiB, as Linux counts them."""
    probe = subprocess.run([sys.executable, "-c", MEMORY_PROBE, str(t_end)], check=True, capture_output=True, text=True)
    return float(probe.stdout)


def command_line(*, quick: bool) -> tuple[list[Row], list[str]]:
    """Wall time of the command."""
    if importlib.util.find_spec("barbalat.cli") is None:
        return [], ["skipped: barbalat.cli does not exist"]
    command = Path(sys.executable).with_name("barbalat")
    if not command.exists():
        return [], [f"skipped: the command barbalat is not installed beside {Path(sys.executable).name}"]
    rows, notes = [], []
    for argument, limit, repeats in (("--help", 0.3, 5), ("reproduce", 10.0, 1 if quick else 2)):
        times = []
        for _ in range(repeats):
            start = time.perf_counter()
            done = subprocess.run([command, argument], capture_output=True, text=True, check=False)
            times.append(time.perf_counter() - start)
        if done.returncode:
            notes.append(
                f"skipped: barbalat {argument} exits with {done.returncode}: {(done.stderr or done.stdout).strip()[-120:]}"
            )
            continue
        rows.append(
            Row(
                f"barbalat {argument} [s]", f"{min(times):.2f} s (median {np.median(times):.2f} s)", "", min(times), at_most=limit
            )
        )
    return rows, notes


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
