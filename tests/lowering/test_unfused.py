"""Steps without fused multiply-adds: the results of LLVM and of a C compiler for a processor without FMA are bit-identical."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Sampled, Simulation, load_case, simulate
from barbalat.lowering import c99
from barbalat.run.engine.engine import Batch, run
from barbalat.run.kernel.grid import signal_table
from independent import refusal
from lowering.test_c99 import compile_c, needs_gcc, same_bits

ISO_C = ("-march=x86-64", "-O2")
"""An instruction set without fused multiply-adds, so none can be used."""


CASES = ("paper", "first-order", "f16-short-period")


def plain_runs() -> list[tuple[str, str]]:
    """(case, controller) of the bundled cases whose steps have a C translation, which are those without delay, noise, samples or
    pieces."""
    return [(case, c.name) for case in CASES for c in load_case(case).controllers if not isinstance(c, Sampled)]


def batch_of(case: str, name: str, steps: int) -> tuple[Batch, Simulation]:
    given = load_case(case)
    (controller,) = (c for c in given.controllers if c.name == name)
    simulation = replace(given.simulation, t_end=steps * given.simulation.dt, fused=False)
    return Batch.of([(given.problem, controller)], simulation, lanes=1), simulation


@needs_gcc
@pytest.mark.parametrize(("case", "name"), plain_runs())
def test_llvm_and_iso_c_agree_over_whole_runs(case, name, tmp_path) -> None:
    blocks, steps = 40, 500
    batch, simulation = batch_of(case, name, blocks * steps)
    program, resets = batch.program, batch.program.accumulators.resets
    table = signal_table(load_case(case).problem.signals, simulation, 0, simulation.steps)
    results = []
    compiled = compile_c(c99.loop(program.program, program.shape, resets), tmp_path, *ISO_C)
    for loop in (program.compile(1), compiled):
        state, out = batch.states.copy(), np.full((blocks, program.shape.states + len(resets), 1), np.nan)
        loop(blocks, steps, state, batch.parameters, table, out)
        results.append((state, out))
    (state_llvm, out_llvm), (state_c, out_c) = results
    assert np.isfinite(state_llvm).all()
    assert same_bits(state_llvm, state_c)
    assert same_bits(out_llvm, out_c)


@pytest.mark.parametrize(("case", "name"), plain_runs())
def test_no_operation_is_fused(case, name) -> None:
    batch, _ = batch_of(case, name, 1000)
    assert not {"fma", "fnma"} & {op.name for op in batch.program.program.operations}


def test_the_figures_are_those_of_fused_runs_but_for_roundings() -> None:
    case = load_case("paper")
    simulation = replace(case.simulation, t_end=2.0)
    fused, unfused = (simulate(case.problem, case.controllers, s) for s in (simulation, replace(simulation, fused=False)))
    for name in fused:
        # the L1 loop's fastest modes are some 100 rad/s: 1e-16 in the state grows little over 2 s
        assert np.allclose(fused[name].x, unfused[name].x, rtol=0, atol=1e-9)
        assert (fused[name].states != unfused[name].states).any()
        assert "without fused multiply-adds" in unfused[name].numerics
        assert "fused" not in fused[name].numerics


def test_lanes_and_threads_change_no_bit_without_fusing() -> None:
    case = load_case("paper")
    members = [(case.problem, case.controllers[0])] * 5
    simulation = replace(case.simulation, t_end=0.5, fused=False)
    one, four = (Batch.of(members, simulation, lanes=lanes) for lanes in (1, 4))
    for batch in (one, four):
        run([batch], case.problem.signals, simulation)
    assert same_bits(one.final_states, four.final_states)


def test_what_is_neither_true_nor_false_is_refused() -> None:
    assert "simulation.fused must be true or false, got 0" in refusal(lambda: Simulation(1.0, 1e-3, fused=0))
