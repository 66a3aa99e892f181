"""Watched quantities of several members in lanes: each member keeps its largest value over every eighth step."""

import casadi as ca
import numpy as np
import pytest

from barbalat.lowering.llvm.machine import Kernel, Watch
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape


@pytest.mark.parametrize("lanes", [2, 4, 16])
def test_each_lane_keeps_its_largest_value_of_every_window(lanes):
    """With x += p s, x^2 is watched in windows of sixteen steps and compared with NumPy."""
    x, p, s = ca.SX.sym("x"), ca.SX.sym("p"), ca.SX.sym("s")
    arguments = [x, ca.SX(0, 1), p, s]
    step, watched = ca.Function("f", arguments, [x + p * s]), ca.Function("g", arguments, [x * x])
    kernel = Kernel(read(step), LoopShape(1, 0, 1, 1), (), lanes, watch=read(watched))
    random = np.random.default_rng(2)
    signals = random.integers(-9, 10, (96, 1)).astype(float)  # integers, so every sum is exact
    factors = random.integers(-3, 4, (1, lanes)).astype(float)
    state, watch = np.zeros((1, lanes)), Watch(1, 0, 96, 16, lanes)
    for half in range(2):
        kernel(4, 12, state, factors, signals[48 * half : 48 * half + 48], np.empty((4, 1, lanes)), watch=watch, start=48 * half)
    path = factors * np.concatenate([[0.0], np.cumsum(signals)])[:-1, None]
    seen = path[::8] ** 2
    np.testing.assert_array_equal(watch.rows, np.array([seen[2 * k : 2 * k + 2].max(axis=0) for k in range(6)]))


def test_a_watch_of_other_lanes_is_refused():
    x = ca.SX.sym("x")
    program = read(ca.Function("f", [x], [x]))
    kernel = Kernel(program, LoopShape(1, 0, 0, 0), (), 4, watch=program)
    with pytest.raises(ValueError, match="4 lanes was called with a watch of 1"):
        kernel(1, 4, np.zeros((1, 4)), np.zeros(0), np.zeros(0), np.empty((1, 1, 4)), watch=Watch(1, 0, 4, 8))
