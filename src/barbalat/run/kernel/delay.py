"""The exact input delay on a fixed grid: what a step remembers, which remembered values a step needs, and how it combines them.

For each input a step remembers two values: at its start, and at its end with the signals' limits from the left. What the end of
one step and the start of the next differ by is a jump of the input: a command's, a sampled controller's, a noisy measurement's,
the one from the history before t = 0. A jump is not interpolated across. The delayed input of a step is the cubic through four
neighbours with the jumps taken out, whose error is of fourth order in the step, as RK4's is, and the jump inside the step by
stage values that have its moments, see ``jump_weights``.
"""

from __future__ import annotations

import re
from functools import cache
from math import factorial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols
from barbalat.lowering.compiled import Tabulator, tabulator
from barbalat.lowering.llvm.machine import remembered
from barbalat.lowering.shape import TAPS_PER_CHANNEL
from barbalat.protocols import Value
from barbalat.solvers import Tableau
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    import casadi as ca

MOST_DELAY_STEPS = 10_000_000
"""Steps that a member may remember: 160 MB each."""

CHANNELS_PER_INPUT = 2
"""What is remembered of each input: the value at a step's start, and at its end."""


class DelayTooShortError(InputError):
    """A delay between 0 and one solver step: ``delay`` and ``dt`` [s]; every dt up to ``delay`` carries it."""

    def __init__(self, delay: float, dt: float) -> None:
        super().__init__(
            f"plant.input.delay must be 0 or at least one solver step, got {delay:g} s at dt = {dt:g} s: "
            f"simulation.dt may be at most {delay:g} s"
        )
        self.delay, self.dt = delay, dt


def lag(delay: float, dt: float) -> int:
    """Steps back to the newest remembered step that a step needs; InputError for a delay below one step."""
    if delay / dt > MOST_DELAY_STEPS:
        raise InputError.of(
            "plant.input.delay", f"must be at most {MOST_DELAY_STEPS:g} solver steps, got {delay:g} s at dt = {dt:g} s"
        )
    whole = whole_steps(delay, dt)
    if whole < 1:
        raise DelayTooShortError(delay, dt)
    return whole


def require_memory(longest: float, inputs: int, runs: int, dt: float) -> None:
    """InputError where what runs with delays of at most ``longest`` [s], side by side, remember does not fit into the memory."""
    if not longest:
        return
    steps, each = lag(longest, dt), runs * CHANNELS_PER_INPUT * inputs * 8  # bytes
    budget.require(
        "plant.input.delay", steps, lambda lagged: Estimate(memory=remembered(int(lagged)) * each),
        given=f"= {longest:g} s, {steps} steps of {dt:g} s that each of {runs} runs remembers,",
        fits=lambda most: f"at most {most} steps", what="what a delay remembers",
    )  # fmt: skip
    needed, free = remembered(steps) * each, free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"plant.input.delay = {longest:g} s at dt = {dt:g} s needs {needed / 1e9:.3g} GB of memory for {runs} runs, "
            f"and {free / 1e9:.3g} GB are free: take a larger simulation.dt, or fewer runs at a time"
        )


def free_memory() -> int | None:
    """Bytes that programs can still get; None where the system does not say."""
    try:
        stated = Path("/proc/meminfo").read_text("ascii")
    except OSError:
        return None
    found = re.search(r"^MemAvailable:\s*(\d+) kB$", stated, re.MULTILINE)
    return None if found is None else 1024 * int(found[1])


def whole_steps(delay: float, dt: float) -> int:
    """floor(delay/dt); a delay within rounding of a whole number of steps counts as that number."""
    steps = delay / dt
    nearest = round(steps)
    return nearest if abs(steps - nearest) <= 1e-9 * max(1.0, steps) else int(np.floor(steps))


def brings_bends(loop: ClosedLoop) -> bool:
    """Whether a delayed loop's past has bends, across which ``weights`` interpolate: u bends where it begins, at t = 0.

    What a sampled controller holds has jumps alone, which the weights carry, as long as nothing behind it has a memory.
    """
    held = loop.sampled and all(not flatten(path.initial()).size for path in loop.paths if path is not None)
    return loop.delayed and not held


def weights(delay: float, dt: float, solver: Tableau, *, fused: bool = True) -> Array:
    """(nodes, channels times taps of an input): what multiplies the starts, then the ends, of remembered steps, the newest first.

    With d = floor(delay/dt) and f the fraction left, step k sees of step k - d - 1 the last part f and then the first part 1 - f
    of step k - d. The cubic stands on the end of k - d, the end and the start of k - d - 1, and the start of k - d - 2. Without
    fused multiply-adds it is a list that combines them, as in a page, as far as a step has two parts.
    """
    fraction = max(delay / dt - whole_steps(delay, dt), 0.0)
    if fraction * dt <= 1e-9 * delay:
        fraction = 0.0
    if fused or not fraction:
        return np.asarray(_combined(fraction, solver, jump_weights(solver, fraction)))
    (found,) = _tabulator(solver)(np.array([[fraction]]))
    return found.reshape(len(solver.nodes), -1)


def traced_weights(solver: Tableau) -> ca.Function:
    """The weights, node by node, of a fraction above 0."""
    import casadi as ca

    fraction_column, (fraction,) = symbols("fraction", 1)
    rows, moments = _jump_equations(solver, fraction)
    jumps = np.linalg.inv(rows) @ ca.array(ca.vertcat(*moments))
    return ca.Function("weights", [fraction_column], [column(_combined(fraction, solver, jumps).reshape(-1))], {"cse": True})


@cache
def _tabulator(solver: Tableau) -> Tabulator:
    return tabulator(traced_weights(solver))


def _combined(fraction: Value, solver: Tableau, jumps: Value) -> Value:
    """``weights`` with these stage values for a jump inside the step."""
    nodes = np.array(solver.nodes)[:, None] - fraction
    factors = zip(CUBIC_PLACES, OTHER_PLACES, strict=True)
    cubic = np.column_stack([np.prod((nodes - others) / (place - others), axis=1) for place, others in factors])
    return cubic @ CUBIC_VALUES + jumps.reshape(-1, 1) * JUMP


_START, _END = np.eye(CHANNELS_PER_INPUT * TAPS_PER_CHANNEL).reshape(CHANNELS_PER_INPUT, TAPS_PER_CHANNEL, -1)
JUMP = _START[0] - _END[1]
"""Between steps k - d - 1 and k - d, of what is remembered."""
CUBIC_VALUES = np.array([_END[0] - JUMP, _END[1], _START[1], _START[2] + _START[1] - _END[2]])
"""What the cubic goes through: what is remembered as if there were no jump."""
CUBIC_PLACES = np.array([1.0, 0.0, -1.0, -2.0])
"""Where, in steps from the beginning of step k - d."""
OTHER_PLACES = [np.delete(CUBIC_PLACES, j) for j in range(len(CUBIC_PLACES))]


def jump_weights(solver: Tableau, fraction: float) -> Array:
    """(nodes,): stage values for an input that jumps from 0 to 1 at ``fraction`` of a step, 0 <= fraction < 1.

    To the state of x' = A x + B v the method adds h^(j+1) A^j B times sum_i (b'a^j)_i v_i, exact integration h^(j+1) A^j B times
    the moment (1 - fraction)^(j+1)/(j+1)! of such a jump, j = 0, 1, ... With one value for each of q nodes the first q of these
    are made equal: on a linear plant a jump costs an error of order h^(q+1), once. RK4 has three nodes and keeps its order.
    """
    if fraction == 0:
        return np.ones(len(solver.nodes))  # none inside the step
    rows, moments = _jump_equations(solver, fraction)
    return np.linalg.solve(rows, moments)


def _jump_equations(solver: Tableau, fraction: Value) -> tuple[Array, list[Value]]:
    """The matrix and the right-hand side that ``jump_weights`` solve."""
    rows = _jump_matrix(solver)
    return rows, [(1 - fraction) ** (j + 1) / factorial(j + 1) for j in range(len(rows))]


@cache
def _jump_matrix(solver: Tableau) -> Array:
    stages = len(solver.b)
    a = np.array([[*row, *[0.0] * (stages - len(row))] for row in solver.a])
    by_node = np.equal.outer(solver.c, solver.nodes).astype(float)  # (stages, nodes)
    rows, row = [], np.array(solver.b)
    for _ in solver.nodes:
        rows.append(row @ by_node)
        row = row @ a
    return np.array(rows)
