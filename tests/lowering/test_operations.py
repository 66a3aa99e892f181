"""Reading, rewriting and compiling expressions: the values must equal NumPy's for the same numbers."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import COMPARISONS, Operation, Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape

REPRODUCIBLE = settings(max_examples=100, derandomize=True, database=None)
WIDTHS = (1, 2, 4, 8, 16, 32)


def traced(expressions, inputs: int, parameters: int = 0) -> ca.Function:
    """A step function (state, no accumulators, parameters, no signals) -> (state, none) from a function on arrays.

    ``expressions(x, p)`` returns at most ``inputs`` values. The rest of the state does not change.
    """
    x, p = ca.SX.sym("x", inputs), ca.SX.sym("p", parameters)
    values = expressions(ca.array(x).reshape(-1), ca.array(p).reshape(-1) if parameters else None)
    new = [ca.SX(v) for v in values] + [x[i] for i in range(len(values), inputs)]
    return ca.Function("f", [x, ca.SX(0, 1), p, ca.SX(0, 1)], [ca.vertcat(*new), ca.SX(0, 1)], {"cse": True})


def run_kernel(
    program: Program, points: np.ndarray, parameters: np.ndarray | None = None, lanes: int = 8, steps: int = 1
) -> np.ndarray:
    """The state after this many steps for each column of ``points`` (states, count)."""
    parameters = np.zeros((0, points.shape[1])) if parameters is None else parameters
    kernel = Kernel(program, LoopShape(len(points), 0, len(parameters), 0), (), lanes)
    result = np.empty_like(points)
    for first in range(0, points.shape[1], lanes):
        index = np.minimum(np.arange(first, first + lanes), points.shape[1] - 1)
        state, p = np.ascontiguousarray(points[:, index]), np.ascontiguousarray(parameters[:, index])
        kernel(1, steps, state, p, np.zeros(1), np.empty((1, len(points), lanes)))
        result[:, index] = state
    return result


def interpret(program: Program, x: list[float]) -> list[float]:
    """Evaluate the operation list in Python, in exact arithmetic if the numbers are integers."""
    meaning = {
        "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "neg": lambda a: -a,
        "fma": lambda a, b, c: a * b + c, "fnma": lambda a, b, c: c - a * b, "fabs": abs, "floor": math.floor,
        "ceil": math.ceil, "fmin": min, "fmax": max, "lt": lambda a, b: a < b, "le": lambda a, b: a <= b,
        "eq": lambda a, b: a == b, "ne": lambda a, b: a != b, "not": lambda a: not a, "and": lambda a, b: a and b,
        "or": lambda a, b: a or b, "if_else_zero": lambda c, a: a if c else 0, "select": lambda c, a, b: a if c else b,
    }  # fmt: skip
    values: list[float] = []
    for op in program.operations:
        if op.name == "constant":
            values.append(op.value)
        elif op.name == "input":
            values.append(x[op.source[1]])
        else:
            value = meaning[op.name](*(values[i] for i in op.operands))
            values.append(float(bool(value)) if op.name in COMPARISONS else value)
    return [float(values[i]) for i in program.outputs[0]]


# --- random graphs over integers: every association of a sum or product is exact, so equality is exact ---

GRAPH_OPERATIONS = {
    "add": (2, lambda a, b: a + b), "sub": (2, lambda a, b: a - b), "mul": (2, lambda a, b: a * b), "neg": (1, lambda a: -a),
    "square": (1, lambda a: a * a), "twice": (1, lambda a: 2 * a), "abs": (1, np.abs), "floor": (1, np.floor),
    "minimum": (2, np.minimum), "maximum": (2, np.maximum), "clip": (3, np.clip), "less": (2, lambda a, b: a < b),
    "less_equal": (2, lambda a, b: a <= b), "equal": (2, lambda a, b: a == b), "not_equal": (2, lambda a, b: a != b),
    "where": (3, lambda c, a, b: np.where(c > 0, a, b)), "where_reversed": (3, lambda c, a, b: np.where(c <= 1, a, b)),
    "not": (1, np.logical_not), "and": (2, np.logical_and), "or": (2, np.logical_or), "constant": (0, None),
}  # fmt: skip


@st.composite
def graphs(draw):
    """Steps (operation, operands, constant) over six inputs, and integers for the inputs."""
    numbers = [float(v) for v in draw(st.lists(st.integers(-4, 4), min_size=6, max_size=6))]
    steps, size = [], 6
    for name in draw(st.lists(st.sampled_from(sorted(GRAPH_OPERATIONS)), min_size=3, max_size=40)):
        count, _ = GRAPH_OPERATIONS[name]
        operands = [draw(st.integers(max(0, size - 8), size - 1)) for _ in range(count)]
        steps.append((name, operands, draw(st.sampled_from([0.0, 1.0, -1.0, 2.0, -3.0]))))
        size += 1
    return steps, numbers


def apply(steps, values, checked_against=None):
    """The graph's values for numbers or symbols. Operations whose results would exceed 2^40 for the numbers are skipped in
    both."""
    values = list(values)
    skipped = [] if checked_against is None else checked_against
    for i, (name, operands, constant) in enumerate(steps):
        if name == "constant":
            values.append(constant)
            continue
        if checked_against is not None and i in skipped:
            values.append(values[operands[0]])
            continue
        value = GRAPH_OPERATIONS[name][1](*(values[j] for j in operands))
        if checked_against is None:
            value = float(value)
            if abs(value) > 2**40:
                skipped.append(i)
                value = values[operands[0]]
        values.append(value)
    return values, skipped


@REPRODUCIBLE
@given(graphs())
def test_random_graphs(graph):
    """NumPy, the list as read, the optimised list, and machine code with one and with eight lanes are exactly equal."""
    steps, numbers = graph
    expected, skipped = apply(steps, numbers)
    expected = expected[-6:]
    function = traced(lambda x, _: apply(steps, x, skipped)[0][-6:], 6)
    program = read(function)
    optimised = optimize(program)
    assert interpret(program, numbers) == expected
    assert interpret(optimised, numbers) == expected
    points = np.array(numbers)[:, None].repeat(3, axis=1)
    for lanes in (1, 8):
        np.testing.assert_array_equal(run_kernel(optimised, points, lanes=lanes), np.array(expected)[:, None].repeat(3, axis=1))


def grown(random, depth):
    """A tree of sums, differences, products and signs. Every part is used once, so all of it may be reassociated."""
    if depth == 0 or random.random() < 0.1:
        return ("constant", float(random.integers(-3, 4))) if random.random() < 0.4 else ("input", int(random.integers(6)))
    name = str(random.choice(["add", "sub", "mul", "mul", "neg"]))
    return (name, *(grown(random, depth - 1) for _ in range(1 if name == "neg" else 2)))


def value_of(tree, x):
    if tree[0] in ("constant", "input"):
        return tree[1] if tree[0] == "constant" else x[tree[1]]
    return GRAPH_OPERATIONS[tree[0]][1](*(value_of(part, x) for part in tree[1:]))


@REPRODUCIBLE
@given(st.integers(0, 2**32 - 1))
def test_random_trees(seed):
    """The trees contain signs, fused products and collected constants. Numbers are integers below 2^53 (3^16 at depth 4), so
    equality is exact."""
    random = np.random.default_rng(seed)
    trees, numbers = [grown(random, 4) for _ in range(6)], [float(v) for v in random.integers(-3, 4, 6)]
    program = optimize(read(traced(lambda x, _: [value_of(tree, x) for tree in trees], 6)))
    expected = [value_of(tree, numbers) for tree in trees]
    assert interpret(program, numbers) == expected
    assert run_kernel(program, np.array(numbers)[:, None], lanes=1)[:, 0].tolist() == expected


@REPRODUCIBLE
@given(st.integers(0, 2**32 - 1), st.integers(2, 30))
def test_sums_of_products_of_reals(seed, terms):
    """Reassociation and fusing change a result only by roundings, which are (terms + factors) eps times the sum of magnitudes."""
    random = np.random.default_rng(seed)
    factors = [random.integers(0, 6, random.integers(1, 4)) for _ in range(terms)]
    signs = random.choice([-1.0, 1.0], terms)
    numbers = random.normal(size=6) * 10.0 ** random.integers(-3, 4, 6)

    def total(x, _=None):
        result = 0.0
        for sign, term in zip(signs, factors, strict=True):
            product = sign * 0.7
            for i in term:
                product = product * x[i]
            result = result + product if seed % 2 else product + result
        return [result]

    exact = total(np.array(numbers, dtype=np.longdouble))[0]
    magnitude = sum(0.7 * np.prod(np.abs(numbers[term])) for term in factors)
    found = run_kernel(optimize(read(traced(total, 6))), numbers[:, None], lanes=1)[0, 0]
    assert abs(found - exact) <= (terms + 4) * np.finfo(float).eps * magnitude


X = np.array([-3.7, -1.0, -0.3, -0.0, 0.0, 1e-9, 0.4, 1.0, 2.5, 40.0, 1e8])
UNARY = {
    "sqrt": np.abs, "abs": None, "floor": None, "ceil": None, "exp": lambda x: np.minimum(x, 300),
    "log": lambda x: np.abs(x) + 1e-9,
    "sign": None,
    "sin": None, "cos": None, "tan": None, "tanh": None, "arctan": None,
    "square": None, "reciprocal": lambda x: x + 0.123, "negative": None,
}  # fmt: skip


@pytest.mark.parametrize("name", UNARY)
@pytest.mark.parametrize("lanes", [1, 8])
def test_functions_of_one_number(name, lanes):
    """The tolerance is 2 ulp, because both are within one ulp of the exact value."""
    x = X if UNARY[name] is None else UNARY[name](X)
    program = optimize(read(traced(lambda s, _: [getattr(np, name)(s[0])], 1)))
    np.testing.assert_allclose(run_kernel(program, x[None], lanes=lanes)[0], getattr(np, name)(x), rtol=5e-16)


BINARY = {
    "power": lambda x, y: (np.abs(x) + 0.1, np.clip(y, -3, 3)), "copysign": None, "divide": lambda x, y: (x, y + 0.123),
    "minimum": None, "maximum": None, "add": None, "subtract": None, "multiply": None, "less": None, "greater_equal": None,
}  # fmt: skip


@pytest.mark.parametrize("name", BINARY)
def test_functions_of_two_numbers(name):
    x, y = (part.ravel() for part in np.meshgrid(X, X))
    if BINARY[name] is not None:
        x, y = BINARY[name](x, y)
    program = optimize(read(traced(lambda s, _: [getattr(np, name)(s[0], s[1])], 2)))
    found = run_kernel(program, np.array([x, y]))[0]
    np.testing.assert_allclose(
        found, getattr(np, name)(x, y).astype(float), rtol=5e-16
    )  # pow: within 1 ulp of the exact value, as is NumPy's


@pytest.mark.parametrize("exponent", [-2, -1, -0.5, 0, 0.5, 1, 2, 3, 5, 1.7])
def test_constant_powers(exponent):
    x = np.abs(X) + 0.1
    program = optimize(read(traced(lambda s, _: [s[0] ** exponent], 1)))
    np.testing.assert_allclose(run_kernel(program, x[None])[0], x**exponent, rtol=1e-15)  # repeated squaring: a few ulp


CLAMPS = {
    "clip": lambda x, p: np.clip(x, -1.0, 1.0),
    "minimum": lambda x, p: np.minimum(x, 1.0),
    "minimum, bound first": lambda x, p: np.minimum(1.0, x),
    "maximum": lambda x, p: np.maximum(x, -1.0),
    "maximum, bound first": lambda x, p: np.maximum(-1.0, x),
    "clip to parameters": lambda x, p: np.clip(x, p[0], p[1]),
    "minimum with a parameter": lambda x, p: np.minimum(x, p[1]),
    "minimum, parameter first": lambda x, p: np.minimum(p[1], x),
    "maximum, parameter first": lambda x, p: np.maximum(p[0], x),
    "projection": lambda x, p: np.maximum(np.minimum(x, np.where(p[1] >= 1, np.inf, 0.0)), np.where(p[0] <= -1, -np.inf, 0.0)),
    "where": lambda x, p: np.where(x > 0, x, 2.0),
    "where, at least": lambda x, p: np.where(x >= 1, 0.0, 5.0),
    "where, negated": lambda x, p: np.where(np.logical_not(x >= 1), 3.0, 5.0),
    "absolute": lambda x, p: np.abs(x),
}


@pytest.mark.parametrize("name", CLAMPS)
@pytest.mark.parametrize("lanes", [1, 8])
def test_bad_numbers_pass_as_in_numpy(name, lanes):
    """A clamp must not turn NaN into its bound, as C's fmin and fmax do; infinities are tested as well. Bounds are numbers or
    parameters."""
    points = np.array([[np.nan, np.inf, -np.inf, 0.0, -0.5, 0.5, 7.0, -7.0]])
    parameters = np.array([[-1.0], [1.0]]).repeat(8, axis=1)
    program = optimize(read(traced(lambda x, p: [CLAMPS[name](x[0], p)], 1, parameters=2)))
    with np.errstate(invalid="ignore"):
        expected = np.array([CLAMPS[name](x, [-1.0, 1.0]) for x in points[0]], dtype=float)
    np.testing.assert_array_equal(run_kernel(program, points, parameters, lanes)[0], expected)


LONG = 1500  # more than Python's limit of 1000 nested calls


@pytest.mark.parametrize("direction", [1, -1])
def test_a_long_sum(direction):
    """The sum is as long as that over the states of a plant of order 23 with least squares. Python's limit of recursion does not
    apply."""
    program = optimize(read(traced(lambda x, _: [sum(x[i] for i in range(LONG)[::direction])], LONG)))
    assert interpret(program, [float(i) for i in range(LONG)])[0] == LONG * (LONG - 1) / 2  # integers, so the sum is exact


def test_a_long_product():
    program = optimize(read(traced(lambda x, _: [math.prod(x[i] for i in range(LONG))], LONG)))
    assert interpret(program, [2.0 if i % 100 == 0 else 1.0 for i in range(LONG)])[0] == 2.0**15


def test_optimising_fuses_and_keeps_no_dead_operation():
    function = traced(lambda x, _: [x[0] * x[1] - x[2], x[1] - x[0] * x[2]], 3)
    program = optimize(read(function))
    used = {i for row in program.outputs for i in row} | {i for op in program.operations for i in op.operands}
    assert used == set(range(len(program.operations)))
    assert sum(op.name in ("fma", "fnma") for op in program.operations) == 2


@pytest.mark.parametrize(("function", "named"), [(np.arcsin, "asin"), (np.sinh, "sinh"), (np.hypot, "hypot")])
def test_an_unsupported_operation_is_named(function, named):
    with pytest.raises(ValueError, match=named):
        read(traced(lambda x, _: [function(*([x[0]] * function.nin))], 1))


def test_bit_identity_over_all_widths():
    """One list with library functions and divisions on 1 to 32 lanes, with 37 members, which is not a multiple of any width."""

    def expressions(x, _):
        a = np.sin(x[0]) * x[1] + np.exp(-x[2] * x[2]) / (1.3 + x[0] * x[0]) - x[1] * x[2]
        b = np.tanh(a * x[1]) + np.sqrt(np.abs(x[2])) * 0.1 + np.maximum(np.abs(x[0]), 0.2) ** 1.7
        return [a - 0.3 * b, np.clip(b * a + x[0] * 0.9, -3.0, 3.0), np.where(a > b, a * b + x[2], np.cos(b))]

    program = optimize(read(traced(expressions, 3)))
    points = np.random.default_rng(0).normal(size=(3, 37))
    results = [run_kernel(program, points, lanes=lanes, steps=5) for lanes in WIDTHS]
    for result in results[1:]:
        assert (result == results[0]).all()


def test_kernel_refuses_arrays_that_do_not_fit():
    kernel = Kernel(read(traced(lambda x, _: [x[0] + 1], 1)), LoopShape(1, 0, 0, 0), (), 1)
    good = {"state": np.zeros(1), "parameters": np.zeros(0), "signals": np.zeros(0), "out": np.zeros(1)}
    kernel(1, 1, **good)
    for name, bad in (
        ("state", np.zeros(0)),
        ("out", np.zeros(0)),
        ("state", np.zeros(1, dtype=np.float32)),
        ("out", np.zeros(4)[::2]),
    ):
        with pytest.raises(ValueError, match=name):
            kernel(1 if name == "state" else 2, 1, **(good | {name: bad}))


@pytest.mark.parametrize("lanes", [0, 3, -1])
def test_lanes_are_a_power_of_two(lanes):
    with pytest.raises(ValueError, match=str(lanes)):
        Kernel(read(traced(lambda x, _: [x[0]], 1)), LoopShape(1, 0, 0, 0), (), lanes)


def test_programs_that_differ_in_the_sign_of_a_zero_are_not_equal():
    """A cached kernel of one must not run in place of the other."""
    plus, minus = (Program((Operation("constant", value=zero),), ((0,),)) for zero in (0.0, -0.0))
    assert plus == Program(plus.operations, plus.outputs) and plus != minus
