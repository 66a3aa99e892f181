"""WebAssembly and the kernel compared: bytes of the module and ns for a step with all metrics in wasmtime.

``python -m benchmarks.wasm [CASE ...]`` prints a line for each controller of the bundled cases. Browsers have other engines, with
other times.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import wasmtime

from barbalat import Simulation, load_case
from barbalat.cases.load import bundled
from barbalat.lowering.shape import ENTRY
from barbalat.lowering.wasm.loop import loop
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel.grid import signal_table
from benchmarks.race import best_seconds

STEPS = 20_000
REPEATS = 20
PAGE_BYTES = 65_536


def main() -> None:
    print(f"{'':44}{'kB':>8}{'made in ms':>12}{'ns':>8}{'kernel':>8}{'fused':>8}{'ratio':>8}")
    for case in sys.argv[1:] or sorted(bundled()):
        given = load_case(case)
        for controller in given.controllers:
            simulation = replace(given.simulation, t_end=STEPS * given.simulation.dt, fused=False)
            made = time.perf_counter()
            batch, module = compiled(given.problem, controller, simulation)
            made = (time.perf_counter() - made) * 1e3
            fused = Batch.of([(given.problem, controller)], replace(simulation, fused=True))
            table = signal_table(given.problem.signals, simulation, 0, STEPS, in_pieces=batch.program.shape.in_pieces)
            wasm = best_seconds(running(module, batch, table), REPEATS)
            native, with_fma = (best_seconds(partial(kernel_call, one, table), REPEATS) for one in (batch, fused))
            ns = [t / STEPS * 1e9 for t in (wasm, native, with_fma)]
            name = f"{case}, {controller.name}"
            print(f"{name:44}{len(module) / 1e3:8.1f}{made:12.0f}" + "".join(f"{t:8.1f}" for t in ns) + f"{ns[0] / ns[2]:8.2f}")


def compiled(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> tuple[Batch, bytes]:
    batch = Batch.of([(problem, controller)], simulation)
    program = batch.program
    assert program.accumulators is not None
    return batch, loop(program.program, program.shape, program.accumulators.resets, program.sample, program.watch)


def kernel_call(batch: Batch, table: np.ndarray) -> None:
    (group,) = batch.groups
    group.call(0, 1, STEPS, group.state.copy(), table)


def running(module: bytes, batch: Batch, table: np.ndarray) -> Callable[[], None]:
    """A run from the initial state. It overwrites its output and continues its stored past."""
    engine = wasmtime.Engine()
    store = wasmtime.Store(engine)
    exports = wasmtime.Instance(store, wasmtime.Module(engine, module), []).exports(store)
    (group,) = batch.groups
    memory, at, end = exports["memory"], [], exports["memory"].data_len(store)
    past, nothing = group.past, np.zeros(0)
    lags, ring, mask = (nothing, nothing, 0) if past is None else (past.lags, past.ring, past.mask)
    size = batch.program.shape.states + batch.program.shape.accumulators
    for array in (group.state, group.parameters, table, np.zeros(size), lags, ring):
        at.append(end)
        end += array.nbytes
    memory.grow(store, -(-end // PAGE_BYTES))
    for array, address in zip((group.state, group.parameters, table, np.zeros(size), lags, ring), at, strict=True):
        memory.write(store, array.tobytes(), address)
    state, *_ = at
    arguments = (1, STEPS, *at[:4], 0, *at[4:], mask, 0, 0, 0, 1, batch.rhythm.sample_every or 0, batch.rhythm.noise_hold)

    def call() -> None:
        memory.write(store, group.state.tobytes(), state)
        exports[ENTRY](store, *arguments)

    return call


if __name__ == "__main__":
    main()
