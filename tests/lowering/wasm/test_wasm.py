"""WebAssembly equals the kernel bit for bit, in whole runs of every controller of every bundled case."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import llvmlite.binding
import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, Problem, Sampled, Simulation, input_filter, load_case
from barbalat.cases.load import bundled
from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.llvm import ir
from barbalat.lowering.operations import Operation, Program
from barbalat.lowering.shape import ENTRY, LoopShape
from barbalat.lowering.wasm.module import PAGE_BYTES, module
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.run.engine.engine import Batch, run
from barbalat.run.kernel.step import StepProgram
from lowering.functions.test_functions import evaluated, points
from lowering.test_c99 import same_bits

pytest.importorskip("wasmtime", reason="wasmtime is not installed")

import wasmtime

from lowering.wasm.wasm_kernel import WasmKernel

EVERY_LOOP = [(case, controller.name) for case in bundled() for controller in load_case(case).controllers]
SHORT = 8.0
"""Length [s] of a run in the short tests. A whole run has up to 800,000 steps. Short ones also have a tail and windows."""


def both(problem, controller, simulation: Simulation, **options) -> tuple[Batch, Batch]:
    """The batch after its run by the kernel and by WebAssembly."""
    made = []
    for kernel in (None, WasmKernel):
        batch = Batch.of([(problem, controller)], simulation, record=True, windows=20, **options)
        if kernel is not None:
            (group,) = batch.groups
            group.kernel = kernel(batch.program)
        run([batch], problem.signals, simulation)
        made.append(batch)
    native, wasm = made
    return native, wasm


def assert_same(native: Batch, wasm: Batch, simulation: Simulation) -> None:
    assert native.states.size
    assert same_bits(native.final_states, wasm.final_states)
    (one,), (other,) = native.groups, wasm.groups
    for mine, theirs in zip(one.recorded, other.recorded, strict=True):
        assert same_bits(mine, theirs)
    assert native.metrics(simulation).of_member(0) == wasm.metrics(simulation).of_member(0)
    if native.watch is not None:
        assert same_bits(native.watch.rows, wasm.watch.rows)


@pytest.mark.parametrize(("case", "name"), EVERY_LOOP)
@pytest.mark.short(kept=lambda case, name: (case, name) in EVERY_LOOP[::2])
def test_every_bundled_loop_has_the_kernel_s_bits(case, name, sample) -> None:
    given = load_case(case)
    (controller,) = (c for c in given.controllers if c.name == name)
    simulation = replace(given.simulation, fused=False, t_end=min(sample(SHORT, given.simulation.t_end), given.simulation.t_end))
    assert_same(*both(given.problem, controller, simulation), simulation)


def with_input(problem: Problem, *, delay: float, std: float) -> Problem:
    noise = Noise(std=std, sample_time=1e-3, bound=0.15, seed=7) if std else None
    return replace(
        problem,
        plant=replace(problem.plant, input=PlantInput(delay=delay)),
        sensor=None if noise is None else Sensor(noise=noise),
    )


@pytest.mark.parametrize("adjustable", [False, True])
@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize(("delay", "std"), [(0.0123, 0.0), (0.0, 0.1), (0.0123, 0.1), (0.01, 0.1)])
def test_delays_noise_and_samples_have_the_kernel_s_bits(delay, std, sampled, adjustable) -> None:
    """With ``adjustable`` the step, the delay's weights and the numbers of steps for samples and noise are arguments."""
    case = load_case("paper")
    controller = L1Adaptive(gamma=100.0, filter=input_filter(0.1))
    if sampled:
        controller = Sampled(controller, sample_time=2e-3)
    simulation = Simulation(t_end=4.0, dt=5e-4, fused=False, record_points=50)
    problem = with_input(case.problem, delay=delay, std=std)
    native, wasm = both(problem, controller, simulation, adjustable=adjustable)
    assert np.isfinite(native.final_states).all()
    assert (native.program.shape.delayed > 0) == (delay > 0)
    assert (native.program.shape.noise > 0) == (std > 0)
    assert_same(native, wasm, simulation)


def test_members_of_an_ensemble_differ_in_parameters_of_one_module() -> None:
    """Gains, plants and initial states are numbers in the memory. Values that depend only on them are computed before the
    loop."""
    case = load_case("paper")
    simulation = Simulation(t_end=1.0, dt=1e-3, fused=False)
    members = [
        (replace(case.problem, plant=replace(case.problem.plant, theta=(4.0 + k, -3.0), x0=(1.0, 0.1 * k))),
         L1Adaptive(gamma=100.0 * 3**k, filter=input_filter(0.1 + 0.01 * k)))
        for k in range(4)
    ]  # fmt: skip
    native, wasm = (Batch.of(members, simulation, lanes=1) for _ in range(2))
    assert native.program.shape.parameters > 3
    shared = WasmKernel(wasm.program)
    for group in wasm.groups:
        group.kernel = shared
    for batch in (native, wasm):
        run([batch], case.problem.signals, simulation, threads=1)  # the module has one memory
    assert same_bits(native.final_states, wasm.final_states)
    assert native.metrics(simulation).of_member(3) == wasm.metrics(simulation).of_member(3)


def calling(name: str, count: int) -> StepProgram:
    operations = [Operation("input", source=(3, i)) for i in range(count)] + [Operation(name, tuple(range(count)))]
    return StepProgram(Program(tuple(operations), ((count,), (), ())), LoopShape(1, 0, 0, count), None)


def applied(kernel: WasmKernel, *x: np.ndarray) -> np.ndarray:
    """The value of a step's only operation for every row, read from the state at the start of the next block."""
    rows = len(x[0])
    state, out = np.zeros(1), np.empty((rows, 1))
    kernel(rows, 1, state, np.empty(0), np.column_stack(x).astype(float), out)
    return np.append(out[1:, 0], state)


EDGES = np.array([0.0, -0.0, 1.0, -1.0, 2.5, -2.5, math.inf, -math.inf, math.nan, 1e300, 5e-324, 2.0**53 - 1])


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_have_the_kernel_s_bits(name) -> None:
    count = function(name).arguments
    kernel = WasmKernel(calling(name, count))
    edges = tuple(part.ravel() for part in np.meshgrid(*[EDGES] * 2))[:count]
    for x in [edges, *points(name, 1000, np.random.default_rng(4))]:
        assert same_bits(applied(kernel, *x), evaluated(name, *x))


@pytest.mark.parametrize(("name", "count"), [
    ("fmin", 2), ("fmax", 2), ("lt", 2), ("le", 2), ("eq", 2), ("ne", 2), ("and", 2), ("or", 2), ("not", 1), ("neg", 1),
    ("fabs", 1), ("sqrt", 1), ("floor", 1),
    ("ceil", 1), ("copysign", 2), ("select", 3), ("if_else_zero", 2), ("div", 2), ("sub", 2),
])  # fmt: skip
def test_single_operations_have_the_kernel_s_bits(name, count) -> None:
    """The operations include the minimum and maximum of signed zeros and of NaNs, which f64.min and f64.max order differently."""
    x = tuple(part.ravel() for part in np.meshgrid(*[EDGES] * count))
    program = calling(name, count)
    state, out = np.zeros(1), np.empty((len(x[0]), 1))
    program.compile(1)(len(x[0]), 1, state, np.empty(0), np.column_stack(x), out)
    assert same_bits(applied(WasmKernel(program), *x), np.append(out[1:, 0], state))


@pytest.mark.parametrize("bound", [0.0, -0.0, 1.0, math.inf, math.nan])
@pytest.mark.parametrize("name", ["fmin", "fmax"])
@pytest.mark.parametrize("first", [False, True])
def test_bounds_that_a_compiler_knows_are_no_other_minimum(name, bound, first) -> None:
    """By the definition of the operation, evaluated in NumPy, the first of two equal zeros is returned, and a NaN only if it is
    the first operand."""
    operations = [
        Operation("input", source=(3, 0)),
        Operation("constant", (), bound),
        Operation(name, (1, 0) if first else (0, 1)),
    ]
    program = StepProgram(Program(tuple(operations), ((2,), (), ())), LoopShape(1, 0, 0, 1), None)
    a, b = (np.full_like(EDGES, bound), EDGES) if first else (EDGES, np.full_like(EDGES, bound))
    with np.errstate(invalid="ignore"):
        expected = np.where(a > b if name == "fmin" else a < b, b, a)
    assert same_bits(applied(WasmKernel(program), EDGES), expected)


def test_a_run_that_diverges_does_so_in_the_kernel_s_bits() -> None:
    case = load_case("paper")
    simulation = Simulation(t_end=400.0, dt=1.0, fused=False, record_points=50)
    native, wasm = both(case.problem, Mrac(gamma=1e4), simulation)
    assert not np.isfinite(native.final_states).all()
    assert_same(native, wasm, simulation)


def test_a_long_quantity_is_called_with_its_numbers_on_the_stack(monkeypatch) -> None:
    case = load_case("paper")
    simulation = replace(case.simulation, fused=False, t_end=1.0)
    inside = WasmKernel(Batch.of([(case.problem, case.controllers[1])], simulation, windows=20).program)
    monkeypatch.setattr(ir, "LONGEST_INSIDE", 0)
    native, wasm = both(case.problem, case.controllers[1], simulation)
    assert native.watch is not None
    assert_same(native, wasm, simulation)
    called = WasmKernel(wasm.program)
    assert (inside.own, called.own) == (0, PAGE_BYTES)  # the first has no stack, the second has a page


def test_states_that_change_places_do_so_at_once() -> None:
    operations = tuple(Operation("input", source=(0, i)) for i in range(2))
    program = StepProgram(Program(operations, ((1, 0), (), ())), LoopShape(2, 0, 0, 0), None)
    state, out = np.array([1.0, 2.0]), np.empty((3, 2))
    WasmKernel(program)(3, 1, state, np.empty(0), np.empty(0), out)
    assert state.tolist() == [2.0, 1.0]
    assert out.tolist() == [[1.0, 2.0], [2.0, 1.0], [1.0, 2.0]]


def test_what_webassembly_lacks_is_refused() -> None:
    case = load_case("paper")
    fused = Batch.of([(case.problem, case.controllers[0])], case.simulation)
    with pytest.raises(ValueError, match="fused=False"):
        WasmKernel(fused.program)
    with pytest.raises(ValueError, match="asin has no LLVM translation"):
        WasmKernel(calling("asin", 1))


@pytest.mark.parametrize(("body", "lacking"), [
    ("%y = call double @llvm.fma.f64(double %x, double %x, double %x)", "fma"),
    ("%y = call double @llvm.sin.f64(double %x)", "sin"),
    ("%y = frem double %x, 3.0", "fmod"),
])  # fmt: skip
def test_a_function_from_outside_is_refused_by_name(body, lacking) -> None:
    """LLVM calls a library function if WebAssembly has no instruction, and the host's function would give different bits."""
    intrinsics = "declare double @llvm.fma.f64(double, double, double)\ndeclare double @llvm.sin.f64(double)"
    with pytest.raises(ValueError, match=f"WebAssembly has no {lacking}"):
        module(f"define double @value(double %x) {{\n  {body}\n  ret double %y\n}}\n{intrinsics}", "value")


def test_a_stack_has_a_size() -> None:
    source = """
    define double @value(double %x) {
      %at = alloca double
      store volatile double %x, ptr %at
      %y = load volatile double, ptr %at
      ret double %y
    }"""
    store = wasmtime.Store()
    made = wasmtime.Instance(store, wasmtime.Module(store.engine, module(source, "value", stack_bytes=16)), [])
    assert made.exports(store)["value"](store, 1.5) == 1.5
    with pytest.raises(ValueError, match="needs a stack"):
        module(source, "value")


def test_modules_take_version_1_and_conversions_that_do_not_trap() -> None:
    """The instruction set is the one that browsers of 2021 support. Later instructions are disabled here, so a module with one of
    them is invalid."""
    config = wasmtime.Config()
    config.wasm_bulk_memory = config.wasm_relaxed_simd = config.wasm_simd = config.wasm_multi_value = config.wasm_tail_call = (
        False
    )
    old = wasmtime.Engine(config)
    for name in ("sin", "pow", "ndtri"):
        given = wasmtime.Module(old, WasmKernel(calling(name, function(name).arguments)).bytes)
        assert given.imports == []
        assert {export.name for export in given.exports} == {"memory", ENTRY}
    with pytest.raises(wasmtime.WasmtimeError):
        wasmtime.Module(
            old, wasmtime.wat2wasm("(module (memory 1) (func (memory.fill (i32.const 0) (i32.const 0) (i32.const 8))))")
        )


def test_llvmlite_on_windows_makes_the_same_module(monkeypatch) -> None:
    """On Windows LLVM's default triples name a different object format."""
    here = WasmKernel(calling("tanh", 1)).bytes
    monkeypatch.setattr(llvmlite.binding.targets, "os", SimpleNamespace(name="nt"))
    assert WasmKernel(calling("tanh", 1)).bytes == here


def test_the_bytes_are_the_same_every_time_and_few() -> None:
    """Section V's L1 loop with all metrics has 5 kB."""
    case = load_case("paper")
    simulation = replace(case.simulation, fused=False)
    programs = [Batch.of([(case.problem, case.controllers[1])], simulation).program for _ in range(2)]
    first, second = (WasmKernel(program).bytes for program in programs)
    assert first == second
    assert first[:4] == b"\0asm"
    assert len(first) < 8_000
