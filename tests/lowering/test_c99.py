"""The C99 printer compared with the LLVM kernel: the results of two compilers for one list of operations are bit-identical."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from barbalat import L1Adaptive, ParameterBox, Plant, Problem, ReferenceModel, RobustMrac, input_filter
from barbalat.laws import LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering import c99
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Operation, Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import ENTRY, LoopShape
from barbalat.run.kernel.step import step_program
from barbalat.solvers import RK4

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

PROBLEM = Problem(
    plant=Plant(A_m=[[0, 1], [-0.3, -1]], b=[0, 1], theta=[4, -3], x0=[1, 1]),
    reference_model=ReferenceModel(k_0=4.0),
    uncertainty=ParameterBox(lower=[-5, -5], upper=[5, 5]),
)
CONTROLLERS = (
    L1Adaptive(gamma=1e4, filter=input_filter(0.02)),
    RobustMrac(c_0=[1, 1], tau=0.5, law=LeastSquares(covariance0=500)),
)


def compile_c(source: str, folder: Path, *flags: str) -> Callable[..., None]:
    """The loop of a C source as a function of (blocks, steps, arrays). Any warning is an error."""
    text, library = folder / "loop.c", folder / "loop.so"
    text.write_text(source)
    # -ffp-contract=off: the list and not the compiler decides on FMAs
    strict = "-std=c99 -pedantic -Wall -Wextra -Wno-unused-parameter -Werror -O2 -march=native -ffp-contract=off -shared -fPIC"
    subprocess.run(["gcc", *strict.split(), *flags, str(text), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library))[ENTRY]
    function.argtypes = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 4
    function.restype = None
    return lambda blocks, steps, *arrays: function(blocks, steps, *(array.ctypes.data for array in arrays))


def run_both(program: Program, shape: LoopShape, resets: tuple[float, ...], lanes: int, folder: Path, *arrays: np.ndarray):
    """(state, out) of the kernel and of C, from the same (blocks, steps, state, parameters, signals)."""
    blocks, steps, state, parameters, signals = arrays
    results = []
    for loop in (Kernel(program, shape, resets, lanes), compile_c(c99.loop(program, shape, resets, lanes), folder)):
        own = state.copy()
        out = np.full((blocks, shape.states + shape.accumulators, lanes), np.nan)
        loop(blocks, steps, own, parameters, signals, out)
        results.append((own, out))
    return results


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether numbers are equal including the sign of zero. All NaNs are equal, because IEEE 754 does not specify their sign and
    payload."""
    return bool(np.array_equal(np.where(np.isnan(a), 0.0, a).view(np.int64), np.where(np.isnan(b), 0.0, b).view(np.int64))) and (
        np.array_equal(np.isnan(a), np.isnan(b))
    )


@needs_gcc
@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("figures", [False, True])
@pytest.mark.parametrize("controller", CONTROLLERS, ids=lambda controller: controller.name)
def test_c_and_the_kernel_agree_in_every_bit(controller, figures, lanes, tmp_path) -> None:
    loop = ClosedLoop.of(PROBLEM, controller)
    step = step_program(loop, RK4, 1e-4, figures=figures)
    resets = step.accumulators.resets if step.accumulators else ()
    blocks, steps = 5, 100
    state = np.repeat(loop.initial()[:, None], lanes, axis=1)
    state[0] += np.linspace(0, 1, lanes)
    signals = 50 * np.sin(np.linspace(0, 1, 3 * blocks * steps)).reshape(-1, 3)
    arrays = (blocks, steps, state, np.zeros((0, lanes)), signals)
    (state_llvm, out_llvm), (state_c, out_c) = run_both(step.program, step.shape, resets, lanes, tmp_path, *arrays)
    assert np.isfinite(state_llvm).all()
    assert (state_llvm != state).any()
    assert same_bits(state_llvm, state_c)
    assert same_bits(out_llvm, out_c)


def every_operation() -> tuple[Program, LoopShape]:
    """A step with one state for each operation that CasADi can use. It also has parameters and signals."""
    x, p, s = ca.SX.sym("x", 24), ca.SX.sym("p", 2), ca.SX.sym("s", 2)
    c = x[0] < x[1]
    following = ca.vertcat(
        x[0] + s[0], x[1] - p[0], x[2] * x[3], x[3] / x[2], -x[4], ca.sqrt(x[5]), ca.fabs(x[6]), ca.floor(x[7]),
        ca.ceil(x[8]), ca.exp(-x[9]), ca.log(x[10]), ca.sin(x[11]), ca.cos(x[12]), ca.tan(x[13]), ca.tanh(x[14]),
        ca.fmin(x[15], p[1]), ca.fmax(1.5, x[16]), x[17] ** p[0], ca.copysign(x[18], x[4]),
        ca.if_else(ca.logic_and(c, x[1] <= s[1]), x[19], -x[19]), ca.logic_or(c, x[20] == 3.0),
        ca.logic_not(x[21]), (x[22] != x[0]) * -1.0, ca.fmin(ca.fmax(x[23], -5.0), 5.0) + p[0] * x[0] - x[2] * x[3] * x[5],
    )  # fmt: skip
    return optimize(read(ca.Function("step", [x, ca.SX(0, 1), p, s], [following, ca.SX(0, 1)], {"cse": True}))), LoopShape(
        24, 0, 2, 2
    )


@needs_gcc
@pytest.mark.parametrize("lanes", [1, 4])
def test_every_operation_agrees(lanes, tmp_path) -> None:
    program, shape = every_operation()
    generator = np.random.default_rng(1)
    state = generator.uniform(0.1, 3, (24, lanes))
    arrays = (3, 2, state, generator.uniform(0.5, 2, (2, lanes)), generator.uniform(-2, 2, (6, 2)))
    (state_llvm, out_llvm), (state_c, out_c) = run_both(program, shape, (), lanes, tmp_path, *arrays)
    assert same_bits(out_llvm, out_c)
    assert same_bits(state_llvm, state_c)


@needs_gcc
@pytest.mark.parametrize("start", [math.nan, math.inf, -math.inf])
def test_a_blow_up_stays_visible(start, tmp_path) -> None:
    x = ca.SX.sym("x", 3)
    following = ca.vertcat(ca.fmin(ca.fmax(x[0], -5.0), 5.0), ca.fmax(x[1], x[2]), ca.fmin(x[1], x[2]))
    program = read(ca.Function("step", [x, ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)], [following, ca.SX(0, 1)]))
    arrays = (1, 1, np.full((3, 1), start), np.zeros((0, 1)), np.zeros((1, 0)))
    (llvm, _), (c, _) = run_both(program, LoopShape(3, 0, 0, 0), (), 1, tmp_path, *arrays)
    clipped = start if math.isnan(start) else math.copysign(5.0, start)
    assert same_bits(c, np.array([[clipped], [start], [start]]))
    assert same_bits(llvm, c)


@needs_gcc
def test_states_that_change_places_do_so_at_once(tmp_path) -> None:
    x = ca.SX.sym("x", 2)
    program = read(ca.Function("step", [x, ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)], [ca.vertcat(x[1], x[0]), ca.SX(0, 1)]))
    loop = compile_c(c99.loop(program, LoopShape(2, 0, 0, 0), ()), tmp_path)
    state, out = np.array([1.0, 2.0]), np.zeros((3, 2))
    loop(3, 1, state, np.zeros(0), np.zeros(0), out)
    assert state.tolist() == [2.0, 1.0]
    assert out.tolist() == [[1.0, 2.0], [2.0, 1.0], [1.0, 2.0]]


def test_constants_are_exact() -> None:
    for value in (0.1, -1 / 3, 5e-324, 1.7976931348623157e308, -0.0, 0.0, 1e4):
        assert math.copysign(1, float.fromhex(c99.constant(value))) == math.copysign(1, value)
        assert float.fromhex(c99.constant(value)) == value
    none = [math.inf, -math.inf, math.nan]
    assert [c99.constant(value) for value in none] == ["(double)INFINITY", "-(double)INFINITY", "(double)NAN"]
    assert [c99.constant(value, c99.FLOAT) for value in none] == ["INFINITY", "-INFINITY", "NAN"]


def test_the_text_is_the_same_every_time() -> None:
    program, shape = every_operation()
    assert c99.loop(program, shape, ()) == c99.loop(*every_operation(), ())


def test_an_unknown_operation_is_named() -> None:
    program = Program((Operation("input"), Operation("bessel", (0,))), ((1,),))
    with pytest.raises(ValueError, match="operation bessel has no C translation"):
        c99.loop(program, LoopShape(1, 0, 0, 0), ())
