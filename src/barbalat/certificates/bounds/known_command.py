"""A bound on e for the command of the case and every theta in the known set (docs/proofs.md, "Along the command").

A loop that equals the model for theta = origin has e = G[(theta - origin)'x - k r] + w. Here G is the transfer matrix from a
matched disturbance to x, k is the factor with which the command passes through G, and w is due to adaptation. Over a cell
|theta_i - c_i| <= rho_i, with H = (I - G (c - origin)')^-1 G,

    e_c = H[(c - origin)'x_m - k r],  x_c = x_m + e_c,  s_i = H[x_c,i],  N = ||G||_1,  q = N |rho|_1/(1 - N |c - origin|_1),

e differs from e_c + sum_i (theta_i - c_i) s_i by at most q/(1 - q) sup |sum_i rho_i |s_i||, apart from the contribution of w. The
signals e_c and s_i follow from the command and are enclosed along it up to t_end. Cells are halved until the remaining
uncertainty is small.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from barbalat.certificates.bounds import laws
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption
from barbalat.certificates.rows import up
from barbalat.linear.conditions import exact_matrix, smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR, float_above
from barbalat.linear.followed import MOST_BITS, MOST_STEPS, Followed, Generator, Motion, followed
from barbalat.problem.known_set import KnownSet, ParameterBox
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Signal
from barbalat.signals import Constant, Sine, Sines, Square, Step, Steps
from barbalat.validate import Array, InputError

KEY, OF_EVERY_COMMAND = "error_bound_command", "error_bound_worst"
MOST_CELLS, MOST_WORK = 16, 250_000
"""Largest number of cells, and of cells times steps times the squared number of states of the loop; this much work takes a second
or two on one core."""
NEGLIGIBLE_REST = 0.05
"""A cell whose size contributes less than this fraction of its bound is not halved again."""
MOST_STATES = 40
"""Largest number of states of the loop with its variations."""


@dataclass(frozen=True, eq=False)
class KnownLoop:
    """G = (A, B, C = the first n states), from v = (theta - origin)'x - k r to e without adaptation; exact balls in a proof.

    passes  k, the factor with which the command passes through G in addition to the plant
    norm    N, at least ||G||_1
    added   sup |w|, due to adaptation, if theta is the origin: for other theta it is divided by 1 - N |theta - origin|_1
    """

    A: Array | arb_mat
    B: Array | list[arb]
    origin: Array
    passes: float
    norm: float
    added: float = 0.0


@dataclass(frozen=True, eq=False)
class Cell:
    """The cell low <= theta <= high with its bound, the contribution of each side to the bound, and its halves."""

    low: Array
    high: Array
    bound: float
    along: Array  # sup |rho_i s_i|, (n,)
    halves: list[Cell] = field(default_factory=list, kw_only=True)

    @property
    def side(self) -> int:
        """The side to halve."""
        return int(np.argmax(self.along))

    @property
    def center(self) -> Array:
        return np.asarray(self.low + (self.high - self.low) / 2)

    def tree(self, leaf: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """The cuts of the cell as a tree; ``leaf`` gives the entry of each cell without halves."""
        if not self.halves:
            return leaf(self)
        low, high = (half.tree(leaf) for half in self.halves)
        return {"side": self.side, "at": float(self.center[self.side]), "low": low, "high": high}


@dataclass(frozen=True, eq=False)
class FollowedCell(Cell):
    """A cell bounded along the command, with the contribution of the cell's size to the bound."""

    rest: float
    followed: Followed


def command_bound(problem: Problem, loop: KnownLoop, known_set: KnownSet, t_end: float) -> tuple[float, FollowedCell]:
    """The bound over the known set, and the set with its cells; raises InputError, with the reason, if there is no bound."""
    if not isinstance(known_set, ParameterBox):
        raise InputError("the known set is a ball, but the response to the command is bounded over the cells of a box")
    states = _states(problem, loop)
    if states > MOST_STATES:
        raise InputError(f"the loop, with its variations, has {states} states, more than the limit of {MOST_STATES}")
    [command] = problem.commands
    signal, order = generator(command, t_end), itertools.count()

    def entered(low: Array, high: Array) -> tuple[float, int, FollowedCell]:
        cell = _cell(problem, loop, signal, low, high)
        return -cell.bound, next(order), cell

    cells = [entered(known_set.lower, known_set.upper)]
    whole = cells[0][2]
    most = min(MOST_CELLS, MOST_WORK // (states**2 * len(whole.followed.bounds)))
    while len(cells) < most and cells[0][2].rest > NEGLIGIBLE_REST * cells[0][2].bound:
        _, _, widest = heapq.heappop(cells)
        for low, high in with_halves(widest.low, widest.high, widest.side):
            half = entered(low, high)
            widest.halves.append(half[2])
            heapq.heappush(cells, half)
    if not math.isfinite(cells[0][2].bound):
        raise InputError("the small-gain condition is not met over a cell of the known set")
    return cells[0][2].bound, whole


def witness(cell: FollowedCell) -> dict[str, Any]:
    """The numbers needed to recompute the response of a cell."""
    found = cell.followed
    return {"bits": 2 * found.bits, "weights": found.weights, "steps": found.steps}


def with_halves(low: Array, high: Array, side: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The ends of both halves of a cell."""
    middle_low, middle_high = low.copy(), high.copy()
    middle_low[side] = middle_high[side] = low[side] + (high[side] - low[side]) / 2
    return (low, middle_high), (middle_low, high)


def _states(problem: Problem, loop: KnownLoop) -> int:
    return problem.known.n + (1 + problem.known.n) * len(loop.B)


def _cell(problem: Problem, loop: KnownLoop, signal: Generator, low: Array, high: Array) -> FollowedCell:
    center = low + (high - low) / 2
    rho = np.nextafter(np.maximum(high - center, center - low), np.inf)
    response = followed(motion(problem, loop, signal, center))
    n = problem.known.n
    sizes = np.array(response.bounds).reshape(len(response.bounds), n + 1, n, -1)  # bounds on e_c, s_1 ... s_n in each step
    varied = rho[None, :, None, None] * sizes[:, 1:]
    first = float((sizes[:, 0] + varied.sum(axis=1)).max()) * OUTWARD_FACTOR
    of_size = float(varied.sum(axis=1).max()) * OUTWARD_FACTOR
    away = float(np.abs(center - loop.origin).sum()) * OUTWARD_FACTOR
    wide = float(rho.sum()) * OUTWARD_FACTOR
    left = 1 - loop.norm * (away + wide) * OUTWARD_FACTOR**2
    if not left > 0:
        return FollowedCell(low, high, math.inf, varied.max(axis=(0, 2, 3)), math.inf, response)
    rest = loop.norm * wide / left * of_size * OUTWARD_FACTOR**2  # q/(1 - q) = N |rho|/(1 - N |c| - N |rho|)
    bound = (first + rest + loop.added / left) * OUTWARD_FACTOR**2
    return FollowedCell(low, high, bound, varied.max(axis=(0, 2, 3)), rest, response)


def motion(problem: Problem, loop: KnownLoop, signal: Generator, center: Array) -> Motion:
    """(w, x_m, e_c, s_1 ... s_n) with w of the command generator; the outputs are e_c and the s_i."""
    n, k, m = problem.known.n, len(signal.S), len(loop.B)
    A_m, b_r, _ = problem.model.matrices
    with ctx.workprec(MOST_BITS):
        A = _Blocks(k + n + (n + 1) * m)
        off = [arb(one) - arb(origin) for one, origin in zip(center.tolist(), loop.origin.tolist(), strict=True)]
        B = [arb(one) for one in loop.B]
        command = [arb(float(one)) for one in signal.c]
        A.add(0, 0, signal.S)
        A.add(k, k, A_m)
        A.add_product(k, 0, [arb(float(one)) for one in b_r[:, 0]], command)
        for j in range(n + 1):
            at = k + n + j * m
            A.add(at, at, loop.A)
            A.add_product(at, at, B, off)
        A.add_product(k + n, k, B, off)
        A.add_product(k + n, 0, B, [-arb(loop.passes) * one for one in command])
        outputs = np.zeros(((n + 1) * n, len(A.rows)))
        for j in range(n + 1):
            at = k + n + j * m
            outputs[j * n : (j + 1) * n, at : at + n] = np.eye(n)
            if j:  # driven by x_c,j = x_m,j + e_c,j
                unit = [arb(int(i == j - 1)) for i in range(n)]
                A.add_product(at, k, B, unit)
                A.add_product(at, k + n, B, unit)
        start = [arb(float(one)) for one in problem.known.x0] + [arb(0)] * ((n + 1) * m)
        return Motion(arb_mat(A.rows), arb_mat(outputs.tolist()), signal, start)


class _Blocks:
    """A square matrix of balls to which blocks are added."""

    def __init__(self, size: int) -> None:
        self.rows = [[arb(0)] * size for _ in range(size)]

    def add(self, row: int, column: int, block: Array | arb_mat) -> None:
        for i, line in enumerate(block.tolist()):
            for j, one in enumerate(line):
                self.rows[row + i][column + j] += arb(one)

    def add_product(self, row: int, column: int, left: Sequence[arb], right: Sequence[arb]) -> None:
        for i, a in enumerate(left):
            for j, b in enumerate(right):
                self.rows[row + i][column + j] += a * b


def add(draft: Draft, problem: Problem, loop: KnownLoop, t_end: float, rests_on: tuple[Assumption, ...]) -> None:
    """Add the bound of a loop for the known command, or the reason why there is none. The bound for every command also holds for
    this command."""
    known_set = problem.uncertainty
    if known_set is None:
        return
    with draft.part(KEY):
        try:
            found, _ = command_bound(problem, loop, known_set, t_end)
        except InputError as error:
            draft.missing(KEY, str(error))
            return
        of_every = draft.entries.get(OF_EVERY_COMMAND)
        known = of_every is not None and of_every.kind == "guaranteed" and of_every.value is not None
        draft.guarantee(KEY, min(found, of_every.value) if of_every is not None and known else found, *rests_on)


def told(certificate: Certificate) -> str:
    """The text on this bound in a cell of Table 1, where it follows the bound for all commands."""
    entry = certificate.entry(KEY)
    given = entry is not None and entry.applies and entry.value is not None
    return f"; {up(entry.value)} under the case's command up to t_end" if entry is not None and given else ""


def of_adapting(problem: Problem, closed: Known, gamma: float | Array, theta_hat0: Array) -> float:
    """sup |x_tilde_i| over the known set for any command. V decreases, so x_tilde_i^2 <= (P^-1)_ii V(0), with the P of
    ``closed``."""
    known_set = problem.uncertainty
    assert known_set is not None
    single = np.ndim(gamma) < 2
    weights = 1 / np.broadcast_to(gamma, theta_hat0.shape) if single else 1 / laws.least_gain(gamma)
    least = smallest_eigenvalue(closed.P)
    level = known_set.farthest(theta_hat0, weights) / math.sqrt(least) * OUTWARD_FACTOR**3
    return level * largest_component(closed.P, least) * OUTWARD_FACTOR


def largest_component(P: Array, least: float) -> float:
    """max_i sqrt((P^-1)_ii lambda_min), at most 1: the ratio of the bound on |e_i| to the bound on |e|_2 from V, rounded up."""
    inverse = exact_matrix(P).inv()
    widest = max((inverse[i, i] for i in range(len(P))), key=float)
    found = float_above((widest * arb(least)).sqrt()) * OUTWARD_FACTOR
    return min(found, 1.0)


def generator(signal: Signal, t_end: float) -> Generator:
    """The signal as the output of a linear system for 0 <= t <= t_end; raises InputError if there is no such system."""
    with ctx.workprec(MOST_BITS):  # sines and instants must be accurate at any precision of the enclosure
        return _generator(signal, t_end)


def _generator(signal: Signal, t_end: float) -> Generator:
    if isinstance(signal, Sine):
        signal = Sines((signal.amplitude,), (signal.frequency,), (signal.phase,), signal.constant)
    if isinstance(signal, Sines):
        count = len(signal.amplitudes)
        S, c, w = np.zeros((2 * count + 1, 2 * count + 1)), np.zeros(2 * count + 1), [arb(1)]
        c[0], c[1::2] = signal.constant, signal.amplitudes
        for i, (frequency, phase) in enumerate(zip(signal.frequencies, signal.phases or (), strict=True)):
            S[2 * i + 1, 2 * i + 2], S[2 * i + 2, 2 * i + 1] = frequency, -frequency
            w += [arb(phase).sin(), arb(phase).cos()]
        return Generator(S, c, [(arb(t_end), w)])
    times, levels = _levels(signal, t_end)
    ends = [*times[1:], arb(t_end)]
    pieces = [(end - start, [level]) for start, end, level in zip(times, ends, levels, strict=True)]
    return Generator(np.zeros((1, 1)), np.ones(1), pieces)


def _levels(signal: Signal, t_end: float) -> tuple[list[arb], list[arb]]:
    """The instants from 0 on at which a signal jumps, and its values after them."""
    if isinstance(signal, Constant):
        return [arb(0)], [arb(signal.amplitude)]
    if isinstance(signal, Step):
        signal = Steps((signal.start,), (signal.constant + signal.amplitude,), signal.constant)
    if isinstance(signal, Steps):
        first = sum(time <= 0 for time in signal.times)
        later = [(time, value) for time, value in zip(signal.times, signal.values, strict=True) if 0 < time < t_end]
        start = signal.values[first - 1] if first else signal.initial
        return [arb(0), *(arb(time) for time, _ in later)], [arb(start), *(arb(value) for _, value in later)]
    if isinstance(signal, Square):
        return _half_periods(signal, t_end)
    raise InputError("the response to the case's command is enclosed only for sums of sines and for piecewise constant signals")


def _half_periods(signal: Square, t_end: float) -> tuple[list[arb], list[arb]]:
    phase, frequency = arb(signal.phase), arb(signal.frequency)
    first = (phase / arb.pi()).floor().unique_fmpz()
    if first is None:
        raise InputError(f"the sign of the square wave at t = 0 is not certain for the phase {signal.phase:g}")
    half, times = int(first), [arb(0)]
    levels = [arb(signal.constant) + (-1) ** half * arb(signal.amplitude)]
    while len(times) <= MOST_STEPS:
        half += 1
        at = (half * arb.pi() - phase) / frequency
        if not at < t_end:
            return times, levels
        times.append(at)
        levels.append(arb(signal.constant) + (-1) ** half * arb(signal.amplitude))
    raise InputError(f"the command jumps more than {MOST_STEPS} times up to t_end")
