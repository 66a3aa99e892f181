"""The time loop around a step: blocks, resets, signals and output, and bit-identity of whole runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import RobustMrac
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.llvm.ir import LONGEST_INSIDE
from barbalat.lowering.llvm.machine import Kernel, Watch
from barbalat.lowering.operations import Operation, Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.run.engine.engine import Batch, run
from barbalat.run.kernel import step as kernel_step
from barbalat.run.kernel.grid import signal_table
from barbalat.run.kernel.step import step_function, step_program
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from independent import example_controllers


@pytest.mark.parametrize("lanes", [1, 4])
def test_blocks_resets_signals_and_parameters(lanes):
    """With x += p s, a sum and a maximum over each block agree with NumPy."""
    x, a, p, s = ca.SX.sym("x"), ca.SX.sym("a", 2), ca.SX.sym("p"), ca.SX.sym("s", 2)
    function = ca.Function("f", [x, a, p, s], [x + p * s[0], ca.vertcat(a[0] + x, ca.fmax(a[1], s[1]))])
    kernel = Kernel(optimize(read(function)), LoopShape(1, 2, 1, 2), (10.0, -np.inf), lanes)
    random = np.random.default_rng(0)
    signals = random.integers(-9, 9, (12, 2)).astype(float)  # integers, so every sum is exact
    start, parameters = np.arange(1.0, lanes + 1)[None], 2.0 * np.arange(1.0, lanes + 1)[None]
    state, out = start.copy(), np.full((3, 3, lanes), np.nan)
    kernel(3, 4, state, parameters, signals, out)
    path = start[0] + parameters[0] * np.concatenate([[0.0], np.cumsum(signals[:, 0])])[:, None]
    np.testing.assert_array_equal(state[0], path[-1])
    for block in range(3):
        steps = slice(4 * block, 4 * block + 4)
        np.testing.assert_array_equal(out[block, 0], path[4 * block])
        np.testing.assert_array_equal(out[block, 1], 10 + path[steps].sum(axis=0))
        np.testing.assert_array_equal(out[block, 2], np.full(lanes, signals[steps, 1].max()))


@pytest.mark.parametrize("blocks", [1, 6, 120])
def test_a_watch_keeps_the_largest_of_every_window(blocks):
    """With x += s, x^2 is watched at every eighth step in windows of sixteen, in two calls. It agrees with NumPy for all
    blocks."""
    x, s = ca.SX.sym("x"), ca.SX.sym("s")
    arguments = [x, ca.SX(0, 1), ca.SX(0, 1), s]
    step, watched = ca.Function("f", arguments, [x + s]), ca.Function("g", arguments, [x * x])
    kernel = Kernel(read(step), LoopShape(1, 0, 0, 1), (), 1, watch=read(watched))
    signals = np.random.default_rng(1).integers(-9, 10, (240, 1)).astype(float)  # integers, so every sum is exact
    start, watch, state = 40, Watch(1, 32, 280, 16), np.zeros((1, 1))
    for half in range(2):
        rows = signals[120 * half : 120 * half + 120]
        out = np.empty((blocks, 1, 1))
        kernel(blocks, 120 // blocks, state, np.zeros(0), rows, out, watch=watch, start=start + 120 * half)
    path, steps = np.concatenate([[0.0], np.cumsum(signals)])[:-1], np.arange(40, 280)
    assert len(watch.rows) == 16  # 248 steps
    for k, row in enumerate(watch.rows):
        seen = (steps // 8 * 8 == steps) & ((steps - 32) // 16 == k)
        if not seen.any():
            assert row[0] == -np.inf
            continue
        largest = np.argmax(path[seen] ** 2)
        np.testing.assert_array_equal(row, [path[seen][largest] ** 2, path[seen][largest], steps[seen][largest]])


def test_a_watch_is_given_to_who_watches():
    x = ca.SX.sym("x")
    program = read(ca.Function("f", [x], [x]))
    plain, watching = (Kernel(program, LoopShape(1, 0, 0, 0), (), 1, watch=watch) for watch in (None, program))
    arguments = (1, 4, np.zeros((1, 1)), np.zeros(0), np.zeros(0), np.empty((1, 1, 1)))
    for kernel, watch in ((plain, Watch(1, 0, 4, 8)), (watching, None), (watching, Watch(1, 0, 3, 8))):
        with pytest.raises(ValueError, match=r"watch|windows"):
            kernel(*arguments, watch=watch)
    many = Program((Operation("input"), *(Operation("mul", (i, i)) for i in range(LONGEST_INSIDE))), ((LONGEST_INSIDE,),))
    with pytest.raises(ValueError, match="one member"):
        Kernel(program, LoopShape(1, 0, 0, 0), (), 4, watch=many)


@pytest.mark.parametrize("lanes", [1, 4])
def test_a_step_in_pieces_counts_as_one(lanes):
    """Each piece adds s and noise to x. Samples, noise, watched steps and blocks count the steps. The result is compared with a
    loop in Python."""
    x, s, n = ca.SX.sym("x"), ca.SX.sym("s", 3), ca.SX.sym("n")
    nothing = ca.SX(0, 1)
    a = ca.SX.sym("a")
    step = ca.Function("f", [x, a, nothing, s, nothing, n], [x + s[0] * n, a + s[1] * x])
    sample = ca.Function("g", [x, nothing, nothing, s, nothing, n], [-x])
    watched = ca.Function("w", [x, nothing, nothing, s, nothing, n], [x * x])
    shape = LoopShape(1, 1, 0, 3, noise=1, noise_hold=2, sample_every=3, in_pieces=True)
    watch = Watch(1, 8, 32, 8) if lanes == 1 else None
    program = read(watched) if lanes == 1 else None
    kernel = Kernel(read(step), shape, (0.0,), lanes, sample=read(sample), watch=program)
    random = np.random.default_rng(4)
    pieces = random.integers(1, 4, 24)  # of each step
    ends, noise = np.cumsum(pieces) - 1, random.integers(-3, 4, (12, 1, lanes)).astype(float)
    table = np.zeros((pieces.sum(), 3))
    table[:, 0] = random.integers(-2, 3, len(table))
    table[ends, 2] = table[np.append(0, ends[:-1] + 1), 1] = 1
    state, out = np.ones((1, lanes)), np.empty((4, 2, lanes))
    kernel(4, 6, state, np.zeros(0), table, out, noise=noise, watch=watch, start=8)
    expected, value, row, seen = np.empty((4, 2, lanes)), np.ones(lanes), 0, {}
    for k in range(24):
        if k % 6 == 0:
            expected[k // 6] = value, np.zeros(lanes)
        for piece in range(pieces[k]):
            if piece == 0 and (8 + k) % 3 == 0:
                value = -value
            if piece == 0:
                expected[k // 6, 1] += value
                seen[8 + k] = value[0]
            value = value + table[row, 0] * noise[k // 2, 0]
            row += 1
    np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(state[0], value)
    if watch is not None:
        np.testing.assert_array_equal(watch.rows, [[seen[k] ** 2, seen[k], k] for k in (8, 16, 24)])


def test_pieces_that_end_too_few_steps_are_refused():
    x, s = ca.SX.sym("x"), ca.SX.sym("s", 3)
    nothing = ca.SX(0, 1)
    kernel = Kernel(read(ca.Function("f", [x, nothing, nothing, s], [x + s[0]])), LoopShape(1, 0, 0, 3, in_pieces=True), (), 1)
    table = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match="must end that many steps"):
        kernel(1, 2, np.zeros((1, 1)), np.zeros(0), table, np.empty((1, 1, 1)))


@pytest.mark.parametrize("scheme", ["mrac", "l1", "robust-mrac"])
def test_kernel_against_stepping_the_casadi_function(problems, scheme):
    """200 steps are compared with calls of the traced function from Python. The tolerance 1e-11 is for roundings of sums in a
    different order, without amplification."""
    problem, controller = problems[2], example_controllers(2)[scheme][0]
    loop = ClosedLoop.of(problem, controller)
    simulation = Simulation(t_end=200 * 2.0**-7, dt=2.0**-7)
    function, accumulators = step_function(loop, RK4, simulation.dt)
    table = signal_table(problem.signals, simulation, 0, 200)
    state, figures = loop.initial(), np.array(accumulators.resets)
    for row in table:
        state, figures = (np.asarray(part)[:, 0] for part in function(state, figures, [], row, [], [])[:2])
    kernel = step_program(loop, RK4, simulation.dt).compile(1)
    final, out = loop.initial()[:, None].copy(), np.empty((1, loop.size + len(figures), 1))
    kernel(1, 200, final, np.zeros((0, 1)), table, out)
    np.testing.assert_allclose(final[:, 0], state, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(out[0, loop.size :, 0], figures, rtol=1e-11, atol=1e-11)
    np.testing.assert_array_equal(out[0, : loop.size, 0], loop.initial())


def batch_of(problem, controller, starts, simulation, lanes, record):
    loop = ClosedLoop.of(problem, controller)
    states = loop.initial()[:, None].repeat(starts.shape[1], axis=1)
    states[: len(starts)] += starts
    program = step_program(loop, simulation.solver, simulation.dt)
    return Batch(loop, program, states, np.zeros((0, starts.shape[1])), record=record, lanes=lanes)


def figures_of(problem, controller, starts, simulation, lanes, threads, record=False):
    batch = batch_of(problem, controller, starts, simulation, lanes, record)
    run([batch], problem.signals, simulation, threads=threads)
    metrics = batch.metrics(simulation)
    figures = [getattr(metrics, name) for name in metrics.__dataclass_fields__]
    return [batch.final_states, *(figure for figure in figures if figure is not None)]


@pytest.mark.parametrize(("n", "scheme"), [(1, "mrac"), (2, "l1"), (2, "robust-mrac")])
@pytest.mark.parametrize("record", [False, True])
def test_bit_identity_over_lanes_and_threads(problems, n, scheme, record):
    """There are 13 members, which is not a multiple of any width above 1, and thousands of blocks, whose merging must not depend
    on the members' layout in memory either. Every number is equal bit for bit."""
    problem, controller = problems[n], example_controllers(n)[scheme][0]
    starts = np.random.default_rng(1).normal(size=(n, 13))
    simulation = Simulation(t_end=5000 * 2.0**-7, dt=2.0**-7)
    expected = figures_of(problem, controller, starts, simulation, lanes=1, threads=1, record=record)
    for lanes, threads in [(1, 4), (2, 2), (4, 1), (8, 4), (16, 1), (32, 2), (None, None)]:
        found = figures_of(problem, controller, starts, simulation, lanes, threads, record)
        for one, other in zip(found, expected, strict=True):
            assert np.array_equal(one, other, equal_nan=True), f"{lanes} lanes, {threads} threads"


@pytest.mark.parametrize(("n", "scheme"), [(1, "mrac"), (2, "l1")])
def test_a_member_is_what_it_is_alone(problems, n, scheme):
    problem, controller = problems[n], example_controllers(n)[scheme][0]
    starts = np.random.default_rng(2).normal(size=(n, 9))
    simulation = Simulation(t_end=3000 * 2.0**-7, dt=2.0**-7)
    together = figures_of(problem, controller, starts, simulation, lanes=8, threads=2)
    for i in (0, 7, 8):
        alone = figures_of(problem, controller, starts[:, i : i + 1], simulation, lanes=None, threads=1)
        assert np.array_equal(alone[0][:, 0], together[0][:, i])
        for one, all_ in zip(alone[1:], together[1:], strict=True):
            assert np.array_equal(one[0], all_[i], equal_nan=True)


def test_two_runs_are_the_same_run(section_v):
    """The run is in the regime of numerical chaos, where one bit would change the trajectory."""
    from barbalat.controllers import L1Adaptive
    from barbalat.linear.systems import input_filter
    from barbalat.run.engine.simulate import simulate

    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02))
    simulation = Simulation(t_end=5.0, dt=1e-4)
    first, second = (simulate(section_v, [controller], simulation, threads=threads)["L1"] for threads in (1, 4))
    assert np.array_equal(first.theta_hat, second.theta_hat)
    assert first.figures == second.figures


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the memory is read where Linux shows it")
def test_kernels_that_are_gone_leave_no_memory():
    """llvmlite keeps the memory of its passes unless it is released, which is 0.1 MB for each of these small kernels."""
    code = """
import casadi as ca, gc, numpy as np
from pathlib import Path
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape

def compile(i):
    x, nothing = ca.SX.sym("x", 4), ca.SX(0, 1)
    step = ca.Function("step", [x, *[nothing] * 5], [x + 0.01 * ca.sin(ca.mtimes(np.full((4, 4), 1.0 + i), x)), nothing, nothing])
    Kernel(read(step), LoopShape(4, 0, 0, 0), (), 1)

def pages():
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1])

for i in range(20):
    compile(i)
before = pages()
for i in range(20, 70):
    compile(i)
print((pages() - before) * 4096 / 1e6)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.25, "MB for fifty kernels"


def test_a_long_quantity_is_a_function_of_its_own_and_has_the_same_bits(problems, monkeypatch):
    """A block of thousands of operations takes minutes to compile together with the step, but only seconds separately."""
    from barbalat.lowering.llvm import ir

    controller = RobustMrac(c_0=[1.0, 1.0], tau=0.5, law=LeastSquares(covariance0=50.0))
    simulation, rows = Simulation(t_end=2.0, dt=2.0**-7), []
    for longest in (10**6, 0):
        monkeypatch.setattr(ir, "LONGEST_INSIDE", longest)
        kernel_step.compiled.cache_clear()
        batch = Batch.of([(problems[2], controller)], simulation, windows=4)
        run([batch], problems[2].signals, simulation)
        rows.append(batch.watch.rows)
        assert ("barbalat_look" in batch.groups[0].kernel.ir) == (longest == 0)
    assert np.isfinite(rows[0]).all()
    np.testing.assert_array_equal(*rows)
