"""A bound on e for every command of the case's size and every theta in the known set, computed over cells of that set.

The loop and its parts e_c and s_i are those of ``known_command``. Their response to r is bounded by L1 norms, and the
contribution of x(0) by half the variation of their free response. With H = (I - G (c - origin)')^-1 G of a cell, q = ||H||_1
|rho|_1 < 1 and S the bound on sum_i rho_i |s_i|,

    |e| <= |e_c| + S + q S/(1 - q) + (1 + ||H||_1 |c - origin|_1) |w|/(1 - q).

The derivation is in docs/proofs.md, "For all commands".
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from barbalat.certificates.bounds import known_command
from barbalat.certificates.bounds.known_command import Cell, KnownLoop, motion, with_halves
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import Assumption
from barbalat.certificates.requested_keys import is_needed
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.followed import MOST_BITS, Generator
from barbalat.linear.l1_norms.estimate import estimated_rows
from barbalat.linear.l1_norms.norm import row_norms
from barbalat.linear.l1_norms.witness import as_floats
from barbalat.linear.l1_norms.witness import witness as norm_witness
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array, InputError

NormsOf = Callable[[arb_mat, arb_mat, arb_mat], tuple[tuple[float, ...], int]]
KEY = "error_bound_worst"
MOST_CELLS, MOST_WORK = 24, 1_500_000
"""Largest number of cells, and of cells times segments times the squared number of states of the loop; this much work takes three
seconds on one core."""
MOST_SEGMENTS = 2000
"""Largest number of segments for one norm; the remainder is bounded by its decay."""
CLOSE = 1.1
"""A bound is not refined if its ratio to a norm that is attained at some theta is below this."""
MOST_STATES = 30
"""Largest number of states of the loop with its variations."""
WIDE = 0.01
"""Cells whose estimates are below the largest bound by more than this fraction first get enclosures of this relative width."""
CLOSENESS = 2.0**-36
"""Width of the enclosures proven by witnesses, relative to the norms: far below ROUNDED."""
ROUNDED = 1 + 1e-9
"""Allowance for rounding: the loop's matrices contain sums and products of a few float64 numbers, which change the norms by far
less."""


@dataclass(frozen=True, eq=False)
class NormedCell(Cell):
    """A cell with the largest |e_i| that is attained at its centre."""

    attained: float
    segments: int


def worst_bound(problem: Problem, loop: KnownLoop) -> tuple[float, NormedCell]:
    """The bound over the known set, and the set with its cells; raises InputError, with the reason, if there is no bound."""
    known_set, order = problem.uncertainty, itertools.count()
    if not isinstance(known_set, ParameterBox):
        raise InputError("the known set is a ball, but this bound is computed over the cells of a box")
    states = problem.known.n + (1 + problem.known.n) * len(loop.B)
    if states > MOST_STATES:
        raise InputError(f"the loop, with its variations, has {states} states, more than the limit of {MOST_STATES}")
    [command] = problem.commands
    size = float(command.bound)  # type: ignore[attr-defined]

    whole = _cell(problem, loop, size, known_set.lower, known_set.upper, _norms)
    cells, attained = [(-whole.bound, next(order), whole)], whole.attained
    most = min(MOST_CELLS, MOST_WORK // (states**2 * whole.segments))
    while len(cells) < most and -cells[0][0] > CLOSE * attained:
        _, _, widest = heapq.heappop(cells)
        for low, high in with_halves(widest.low, widest.high, widest.side):
            half = _cell(problem, loop, size, low, high, _estimated)  # estimates choose the cells, and enclosures bound them
            widest.halves.append(half)
            attained = max(attained, half.attained)
            heapq.heappush(cells, (-half.bound, next(order), half))
    bound = 0.0 if whole.halves else whole.bound
    for estimated, _, cell in sorted(cells) if whole.halves else []:
        # wide enclosures, which take two thirds of the time, prove that a cell is not the worst
        if -estimated * (1 + WIDE) < bound and _cell(problem, loop, size, cell.low, cell.high, _wide_norms).bound <= bound:
            continue
        bound = max(bound, _cell(problem, loop, size, cell.low, cell.high, _norms).bound)
    if not math.isfinite(bound):
        raise InputError("the small-gain condition is not met over a cell of the known set")
    return bound, whole


def systems(problem: Problem, loop: KnownLoop, center: Array) -> dict[str, tuple[arb_mat, arb_mat, arb_mat]]:
    """(A, B, C) from r to e_c and the s_i; (A, B, C) of the derivative of their free response, if x(0) is not zero; and of H."""
    n, m = problem.known.n, len(loop.B)
    whole = motion(problem, loop, Generator(np.zeros((1, 1)), np.ones(1), []), center)  # the first state is r
    rows, C = whole.A.tolist()[1:], arb_mat([row[1:] for row in whole.C.tolist()])
    A, of_r = arb_mat([row[1:] for row in rows]), arb_mat([row[:1] for row in rows])
    looped = arb_mat([row[n : n + m] for row in A.tolist()[n : n + m]])
    found = {"forced": (A, of_r, C), "loop": (looped, arb_mat([[arb(one)] for one in loop.B]), arb_mat(np.eye(n, m).tolist()))}
    if problem.known.x0.any():
        with ctx.workprec(MOST_BITS):
            found["free"] = A, arb_mat([[one] for one in whole.start]), C * A
    return found


def witness(problem: Problem, loop: KnownLoop, cell: NormedCell) -> dict[str, Any]:
    """The witnesses of a cell's norms; raises InputError if one of them is not found."""
    found: dict[str, Any] = {"center": cell.center.tolist()}  # rounded: the witnesses hold for these numbers
    for name, (A, B, C) in systems(problem, loop, cell.center).items():
        size = max(_norms(A, B, C)[0])
        found[name] = norm_witness(A, B, C, size, closeness=CLOSENESS)
        if found[name] is None:
            raise InputError("no witness was found for the norm of a cell")
    return found


def _norms(A: arb_mat, B: arb_mat, C: arb_mat) -> tuple[tuple[float, ...], int]:
    return row_norms(as_floats(A), as_floats(B), as_floats(C), np.zeros((C.nrows(), 1)), work_limit=MOST_SEGMENTS)


def _wide_norms(A: arb_mat, B: arb_mat, C: arb_mat) -> tuple[tuple[float, ...], int]:
    nothing = np.zeros((C.nrows(), 1))
    return row_norms(as_floats(A), as_floats(B), as_floats(C), nothing, relative_width=WIDE, work_limit=MOST_SEGMENTS)


def _estimated(A: arb_mat, B: arb_mat, C: arb_mat) -> tuple[tuple[float, ...], int]:
    found = estimated_rows(as_floats(A), as_floats(B), as_floats(C))
    if found is None:
        raise ValueError("not Hurwitz")
    return tuple(found.tolist()), 0


def _cell(problem: Problem, loop: KnownLoop, size: float, low: Array, high: Array, norms_of: NormsOf) -> NormedCell:
    """The cell with its bound. ``norms_of`` encloses or estimates the norms of the rows of a system and counts the segments."""
    center, n = low + (high - low) / 2, problem.known.n
    rho = np.nextafter(np.maximum(high - center, center - low), np.inf)
    try:
        found = {name: norms_of(*parts) for name, parts in systems(problem, loop, center).items()}
    except ValueError:  # not certainly Hurwitz
        return NormedCell(low, high, math.inf, rho, 0.0, 1)
    norms = {name: np.array(upper) * ROUNDED for name, (upper, _) in found.items()}
    segments = 1 + sum(count for _, count in found.values())
    forced, N = norms["forced"] * size, float(norms["loop"].max())
    free = norms["free"] / 2 if "free" in norms else np.zeros(len(forced))
    sizes = ((forced + free) * OUTWARD_FACTOR).reshape(n + 1, n)  # of e_c, s_1 ... s_n
    varied = rho[:, None] * sizes[1:]
    spread, away = float(varied.sum(axis=0).max()), float(np.abs(center - loop.origin).sum())
    q = N * float(rho.sum()) * OUTWARD_FACTOR**2
    if not q < 1:
        return NormedCell(low, high, math.inf, varied.max(axis=1), 0.0, segments)
    rest = (q * spread + (1 + N * away) * loop.added) / (1 - q) * OUTWARD_FACTOR**3
    bound = (float((sizes[0] + varied.sum(axis=0)).max()) + rest) * OUTWARD_FACTOR**2
    return NormedCell(low, high, bound, varied.max(axis=1), float(forced[:n].max()) / ROUNDED**2, segments)


def add(draft: Draft, problem: Problem, loop: KnownLoop, rests_on: tuple[Assumption, ...]) -> None:
    """Add the bound of a loop for all commands, or the reason why there is none. The bound for the command of the case uses
    it."""
    if problem.uncertainty is None or not is_needed(KEY, known_command.KEY):
        return
    with draft.part(KEY):
        try:
            found, _ = worst_bound(problem, loop)
        except InputError as error:
            draft.missing(KEY, str(error))
            return
        draft.guarantee(KEY, found, *rests_on)
