"""Costs other than the steps: compilation, the second core, memory, the command line."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from barbalat import Simulation
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.llvm.machine import Kernel
from barbalat.run.engine.engine import Batch, best_lanes, run
from barbalat.run.kernel.step import step_program
from barbalat.solvers import RK4
from benchmarks.loops import PROBLEM, STEP, Case, l1
from benchmarks.race import Time
from benchmarks.table import Row

Section = tuple[list[Row], list[str]]

# VmHWM and not ru_maxrss, because Linux keeps the parent's ru_maxrss over fork and exec.
MEMORY_PROBE = """
import sys
import tempfile
from pathlib import Path
from barbalat import Simulation
from barbalat.run.engine.engine import Batch
from barbalat.run.engine.engine import run
from benchmarks.loops import PROBLEM, STEP, l1
case = l1(64)
batch = Batch(case.loop, case.optimised(figures=True), case.states, case.parameters)
run([batch], PROBLEM.signals, Simulation(t_end=float(sys.argv[1]), dt=STEP))
print(next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")))
"""


def compiling(case: Case, *, quick: bool) -> list[Row]:
    """Time from the equations to a running kernel with all metrics, after the imports and with an empty cache."""

    def build(lanes: int) -> None:
        program = step_program(ClosedLoop.of(PROBLEM, case.controller), RK4, STEP)
        assert program.accumulators is not None
        Kernel(program.program, program.shape, program.accumulators.resets, lanes)

    rows = []
    for lanes in sorted({1, 8, best_lanes(1024)}):
        samples = [_seconds(build, lanes) for _ in range(3 if quick else 7)]
        what = f"{case.name}: {lanes} lane{'s' * (lanes > 1)}, seconds"
        rows.append(Row(what, _text(samples), "", min(samples), at_most=0.15))
    return rows


def two_cores(members: int, *, quick: bool) -> Section:
    """Compare the engine with one thread and with two, with all metrics."""
    if (os.cpu_count() or 1) < 2:
        return [], ["skipped: this computer has one core"]
    case = l1(members)
    program = case.optimised(figures=True)
    simulation = Simulation(t_end=4.0 if quick else 20.0, dt=STEP)

    def engine(threads: int) -> tuple[float, float]:
        batch = Batch(case.loop, program, case.states, case.parameters)
        busy = time.process_time()
        wall = _seconds(lambda: run([batch], PROBLEM.signals, simulation, threads=threads))
        return wall, (time.process_time() - busy) / wall

    samples = np.array([(engine(1), engine(2)) for _ in range(3 if quick else 9)])
    one, two = samples[:, :, 0].T
    unit = 1e9 / simulation.steps / members
    ours, beside = (
        f"{name}: {Time(name, s.min() * unit, np.median(s) / s.min() - 1)}" for name, s in (("2 threads", two), ("1 thread", one))
    )
    row = Row(f"engine, {members} members, all figures", ours, beside, one.min() / two.min(), at_least=1.8)
    cores = samples[:, 1, 1].max()
    return [row], [f"Two threads had {cores:.2f} cores at best; with others at work on this computer, fewer than 2."]


def memory(*, quick: bool) -> Section:
    """Peak memory of an ensemble without recording, for t_end and for ten times t_end."""
    if not Path("/proc/self/status").exists():
        return [], ["skipped: peak memory is read from Linux's /proc"]
    t_end = 2.0 if quick else 20.0
    short, long = (_peak_memory(t) for t in (t_end, 10 * t_end))
    what = f"peak, 64 members, {10 * t_end:g} s against {t_end:g} s"
    # 5 % is the difference between two runs of the same length
    return [Row(what, f"{long / 1024:.1f} MiB", f"{short / 1024:.1f} MiB", long / short, at_most=1.05)], []


def _peak_memory(t_end: float) -> float:
    """Peak memory [KiB] of a run."""
    probe = subprocess.run([sys.executable, "-c", MEMORY_PROBE, str(t_end)], check=True, capture_output=True, text=True)
    return float(probe.stdout)


def command_line(*, quick: bool) -> Section:
    """Elapsed time of the command."""
    if importlib.util.find_spec("barbalat.cli") is None:
        return [], ["skipped: barbalat.cli does not exist"]
    command = Path(sys.executable).with_name("barbalat")
    if not command.exists():
        return [], [f"skipped: the command barbalat is not installed beside {Path(sys.executable).name}"]
    rows, notes = [], []
    commands = [("--help", 0.3, 5), ("reproduce --quick", 10.0, 1)]
    for argument, limit, repeats in commands[:1] if quick else commands:
        with tempfile.TemporaryDirectory() as folder:
            samples, done = [], None
            for _ in range(repeats):
                start = time.perf_counter()
                done = subprocess.run([command, *argument.split()], capture_output=True, text=True, check=False, cwd=folder)
                samples.append(time.perf_counter() - start)
        if done is not None and done.returncode:
            notes.append(f"barbalat {argument} ends with code {done.returncode}: {done.stderr.strip()[-120:]}")
        rows.append(Row(f"barbalat {argument}, seconds", _text(samples), "", min(samples), at_most=limit))
    return rows, notes


def _text(samples: list[float]) -> str:
    return f"{min(samples):.3f} s (median {np.median(samples):.3f} s)"


def _seconds(work: Callable[..., object], *arguments: object) -> float:
    start = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - start
