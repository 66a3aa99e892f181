"""The exact input delay on a fixed grid: the values that a step stores, the values that a step needs, and how these are combined.

For each input a step stores two values: at its start, and at its end with the signals' limits from the left. The difference
between the end of one step and the start of the next is a jump of the input: from a command, a sampled controller, a noisy
measurement, or the history before t = 0. No interpolation crosses a jump. The delayed input of a step is the cubic through four
neighbouring values with the jumps removed. Its error is of fourth order in the step, like that of RK4. The jump inside the step
is represented by stage values that match its moments (see ``jump_weights``).
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
from barbalat.validate import Array, InputError, counted

if TYPE_CHECKING:
    import casadi as ca

MOST_DELAY_STEPS = 10_000_000
"""Largest number of steps that a member may store, which take 160 MB."""

CHANNELS_PER_INPUT = 2
"""The stored values of each input: at a step's start and at its end."""


class DelayTooShortError(InputError):
    """A delay between 0 and one solver step: ``delay`` and ``dt`` [s]; any dt up to ``delay`` is possible."""

    def __init__(self, delay: float, dt: float) -> None:
        super().__init__(
            f"plant.input.delay must be 0 or at least one solver step, got {delay:g} s at dt = {dt:g} s: "
            f"simulation.dt may be at most {delay:g} s"
        )
        self.delay, self.dt = delay, dt


def lag(delay: float, dt: float) -> int:
    """The age, in steps, of the newest stored value that a step needs; raises InputError for a delay shorter than one step."""
    if delay / dt > MOST_DELAY_STEPS:
        raise InputError.of(
            "plant.input.delay", f"must be at most {MOST_DELAY_STEPS:g} solver steps, got {delay:g} s at dt = {dt:g} s"
        )
    whole = whole_steps(delay, dt)
    if whole < 1:
        raise DelayTooShortError(delay, dt)
    return whole


def require_memory(longest: float, inputs: int, runs: int, dt: float) -> None:
    """Raise InputError if the stored values of parallel runs with delays of at most ``longest`` [s] do not fit into memory."""
    if not longest:
        return
    steps, each = lag(longest, dt), runs * CHANNELS_PER_INPUT * inputs * 8  # bytes
    budget.require(
        "plant.input.delay", steps, lambda lagged: Estimate(memory=remembered(int(lagged)) * each),
        given=f"= {longest:g} s, {steps} steps of {dt:g} s that "
        f"{'the run stores' if runs == 1 else f'each of {runs} runs stores'},",
        fits=lambda most: f"at most {counted(most, 'step')}", what="what a delay remembers",
    )  # fmt: skip
    needed, free = remembered(steps) * each, free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"plant.input.delay = {longest:g} s at dt = {dt:g} s needs {needed / 1e9:.3g} GB of memory for "
            f"{counted(runs, 'run')}, but only {free / 1e9:.3g} GB are free. Use a larger simulation.dt, or fewer runs at a time"
        )


def free_memory() -> int | None:
    """Bytes still available to programs; None if the system does not report it."""
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
    """Whether the past of a delayed loop has corners, across which ``weights`` interpolates: u has a corner at t = 0, where it
    begins.

    The output of a sampled controller has only jumps, which the weights reproduce, if nothing after it has memory.
    """
    held = loop.sampled and all(not flatten(path.initial()).size for path in loop.paths if path is not None)
    return loop.delayed and not held


def weights(delay: float, dt: float, solver: Tableau, *, fused: bool = True) -> Array:
    """(nodes, channels times taps of an input): the factors of the values at the starts of stored steps, followed by the factors
    of the values at their ends, newest first.

    With d = floor(delay/dt) and the remaining fraction f, step k receives the last part f of step k - d - 1 and then the first
    part 1 - f of step k - d. The cubic uses the end of k - d, the end and the start of k - d - 1, and the start of k - d - 2.
    Without fused multiply-adds and if a step has two parts, the weights are computed by an operation list, as in a page.
    """
    fraction = max(delay / dt - whole_steps(delay, dt), 0.0)
    if fraction * dt <= 1e-9 * delay:
        fraction = 0.0
    if fused or not fraction:
        return np.asarray(_combined(fraction, solver, jump_weights(solver, fraction)))
    (found,) = _tabulator(solver)(np.array([[fraction]]))
    return found.reshape(len(solver.nodes), -1)


def traced_weights(solver: Tableau) -> ca.Function:
    """The weights, node by node, for a fraction above 0."""
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
"""The jump between steps k - d - 1 and k - d in the stored values."""
CUBIC_VALUES = np.array([_END[0] - JUMP, _END[1], _START[1], _START[2] + _START[1] - _END[2]])
"""The points of the cubic: the stored values without the jump."""
CUBIC_PLACES = np.array([1.0, 0.0, -1.0, -2.0])
"""The instant, in steps from the beginning of step k - d."""
OTHER_PLACES = [np.delete(CUBIC_PLACES, j) for j in range(len(CUBIC_PLACES))]


def jump_weights(solver: Tableau, fraction: float) -> Array:
    """(nodes,): stage values for an input that jumps from 0 to 1 at ``fraction`` of a step, 0 <= fraction < 1.

    The method adds h^(j+1) A^j B times sum_i (b'a^j)_i v_i to the state of x' = A x + B v, j = 0, 1, ... Exact integration adds
    h^(j+1) A^j B times the moment (1 - fraction)^(j+1)/(j+1)! of such a jump. With one value for each of q nodes, the first q
    moments are matched: on a linear plant a jump then causes a single error of order h^(q+1). RK4 has three nodes and keeps its
    order.
    """
    if fraction == 0:
        return np.ones(len(solver.nodes))  # no jump inside the step
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
