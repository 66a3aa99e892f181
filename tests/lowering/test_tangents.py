"""Tangents of operation lists: they equal the results of CasADi's differentiation, and the values are unchanged."""

import casadi as ca
import numpy as np
import pytest

from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Operation, Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.tangents import Tangented

x = ca.SX.sym("x", 3)
CASES = {
    "rational": [x[0] * x[1] + x[2] / (1 + x[0] ** 2), x[0] - x[1] * x[2], 1 / x[0] - x[1] ** 2],
    "functions": [
        ca.exp(0.3 * x[0]) * ca.sin(x[1]),
        ca.log(2 + x[0] ** 2) + ca.tanh(x[1]) + ca.atan(x[2]),
        ca.cos(x[0]) * ca.tan(0.2 * x[1]) + ca.sqrt(1 + x[2] ** 2),
    ],
    "branches": [
        ca.if_else(x[0] > x[1], x[0] ** 2, x[1] * x[2]),
        ca.fmin(x[0], x[1]) * ca.fmax(x[1], x[2]),
        ca.fabs(x[0]) + ca.sign(x[1]) * x[2] + ca.floor(x[0]),
    ],
    "powers": [ca.power(1 + x[0] ** 2, x[1]), ca.power(2 + x[1] ** 2, 1.5), ca.copysign(x[0], x[1]) * x[2]],
}


def with_tangents(program: Program, directions: int) -> Program:
    """A step whose state is x, followed by the tangents along each direction."""
    made = Tangented(program, directions, lambda source: source)
    made.differentiate(lambda source: tuple((0, 3 * (d + 1) + source[1]) for d in range(directions)))
    (row,) = program.outputs
    state = [*(made.place[i] for i in row), *(made.or_zero(known[i]) for known in made.by_direction for i in row)]
    return made.made((tuple(state), ()))


def advanced(program: Program, states: np.ndarray) -> np.ndarray:
    kernel, after = Kernel(program, LoopShape(len(states), 0, 0, 0), (), 1), np.empty_like(states)
    for k in range(states.shape[1]):
        one = np.ascontiguousarray(states[:, k])
        kernel(1, 1, one, np.zeros(0), np.zeros(1), np.empty((1, len(states))))
        after[:, k] = one
    return after


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("fused", (True, False))
def test_tangents_are_those_of_casadi_and_values_keep_their_bits(name, fused):
    value = ca.vertcat(*CASES[name])
    program = optimize(read(ca.Function("f", [x], [value], {"cse": True})), fused=fused)
    points, directions = np.random.default_rng(1).normal(size=(3, 40)), np.random.default_rng(2).normal(size=(2, 3, 40))
    found = advanced(with_tangents(program, 2), np.vstack([points, *directions]))
    plain = advanced(Program(program.operations, (program.outputs[0], ())), points)
    assert found[:3].tobytes() == plain.tobytes()
    slope = ca.Function("slope", [x, v := ca.SX.sym("v", 3)], [ca.jtimes(value, x, v)])
    for d in range(2):
        expected = np.array(slope(points, directions[d]))
        np.testing.assert_allclose(found[3 * (d + 1) : 3 * (d + 2)], expected, rtol=1e-11, atol=1e-11)  # roundings


def test_the_root_of_a_sum_of_squares_has_no_slope_at_zero():
    program = optimize(read(ca.Function("f", [x], [ca.vertcat(ca.norm_2(x), x[1], x[2])])))
    found = advanced(with_tangents(program, 1), np.array([[0.0, 0.0, 0.0, 1.0, 2.0, 3.0]]).T)
    assert found[:4, 0].tolist() == [0.0, 0.0, 0.0, 0.0]


def test_an_operation_without_a_derivative_is_named():
    program = Program((Operation("input"), Operation("exponent", (0,))), ((1,),))
    made = Tangented(program, 1, lambda source: source)
    with pytest.raises(ValueError, match="the operation exponent has no derivative"):
        made.differentiate(lambda source: ((0, 1),))
