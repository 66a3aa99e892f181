"""Signals and motions with jumps or corners inside solver steps: such steps are split, or their error is reported.

A method of order p keeps this order as long as the right-hand side is smooth within each step. A jump inside a step causes an
error of order h, a corner one of order h^2, for any p. A jump on the grid causes no error, because a step's last stage uses
limits from the left. Signals declare their breaks beforehand (``breaks``), and steps are split there. The time at which a control
saturates, or an estimate reaches the boundary of its known set, is unknown before the run: steps are not split there, and the
effect is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.loop.structure import comes_from_outside
from barbalat.loop.true_values import estimate_set
from barbalat.problem.actuation import InputPath
from barbalat.protocols import Bending, BreakingSignal, Jumping, Signal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array
from barbalat.vocabulary import BENDING, JUMPING, used

ON_GRID_SHARE = 1e-12
"""A break whose distance to the grid is below this fraction of a step is treated as on the grid. No method resolves a smaller
distance."""
ON_GRID_ROUNDINGS = 64
"""The same limit as a number of rounding errors of the time: instants are products of frequencies, phases and pi, with a few
rounding errors each."""
MOST_PIECES = 100
"""Largest number of pieces of a step. Steps are not split for a signal with more breaks in the first step, because the tables of
a kernel call would take gigabytes."""
LONGEST_WINDOW = 1 << 16
"""Steps whose breaks are processed together: up to 50 MB with the largest number of pieces."""
BEND_ORDER = 2
"""Order of the error caused by a corner."""
_ORDERS = {1: "first", 2: "second", 3: "third", 4: "fourth"}


@dataclass(frozen=True)
class LostOrder:
    """The effect of breaks inside steps on a run whose steps are not split at these breaks.

    jumps     number of steps inside which the command or a disturbance jumps; None if they are too many to count
    corners   number of steps without a jump but with a corner of these signals; corners of the trajectory are not counted (see
              ``lost_along``)
    order     the order of convergence that remains in the worst case
    sentence  the effect as a sentence
    bends     whether the plant receives corners of the control through a delay, which are interpolated
    """

    jumps: int | None
    corners: int | None
    order: int
    sentence: str
    bends: bool = False

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def breaks_inside(signals: tuple[Signal, ...], simulation: Simulation, start: int, stop: int) -> Array:
    """The instants (K,) [s], increasing, of breaks of any signal inside the steps from ``start`` to ``stop`` - 1."""
    found = [_inside(signal, simulation, start, stop)[0] for signal in signals if isinstance(signal, BreakingSignal)]
    return np.unique(np.concatenate([np.zeros(0), *found]))


def can_be_split(signals: tuple[Signal, ...], simulation: Simulation) -> bool:
    """Whether a signal breaks inside a step, and no signal breaks too often to split the steps. With a tolerance, steps always
    end at breaks.
    """
    if simulation.tolerance is not None:
        return False
    if not any(isinstance(signal, BreakingSignal) for signal in signals) or _too_dense(signals, simulation):
        return False
    return any(len(breaks_inside(signals, simulation, *window)) for window in _windows(simulation))


def lost_order(signals: tuple[Signal, ...], simulation: Simulation, *, delayed: bool, bends: bool = False) -> LostOrder | None:
    """The loss of order of a run, if any. Only the steps of a ``delayed`` loop and those with too many breaks are not split.

    bends  whether the control that the plant receives through a delay has corners, as ``delay.brings_bends`` determines
    """
    order = simulation.solver.order
    if _too_dense(signals, simulation):
        often = f"{MOST_PIECES} times or more in a step, too often to split it"
        return LostOrder(None, None, 1, f"the command or a disturbance has jumps or corners {often}: it is not resolved")
    if not delayed:
        return None
    jumps, corners = _counted(signals, simulation)
    left = 1 if jumps else BEND_ORDER
    if not (jumps or corners or bends) or order <= left:
        return None
    sentences = []
    if jumps or corners:
        what = "jumps" if jumps else "has a corner"
        where = f"inside {jumps or corners} of the {simulation.steps} steps of a delayed loop, which cannot be split"
        sentences.append(f"the command or a disturbance {what} {where}: {_ORDERS[left]} order there")
    if bends and order > BEND_ORDER:
        sentences.append(
            "the delayed control has corners, at t = 0 and one delay after each jump, which are interpolated: "
            f"{_ORDERS[BEND_ORDER]} order there"
        )
    return LostOrder(jumps, corners, left, "; ".join(sentences), bends and order > BEND_ORDER)


def _inside(signal: BreakingSignal, simulation: Simulation, start: int, stop: int) -> tuple[Array, Array]:
    """The signal's breaks (K,) inside these steps, and which of them are jumps.

    The signal shows which breaks are on the grid: a jump is on the grid if it occurs exactly at the nearest grid time.
    """
    first, last = float(simulation.time(start)), float(simulation.time(stop))
    instants = np.asarray(signal.breaks(first, last), dtype=float)
    instants = instants[(instants > first) & (instants < last)]
    nearest = simulation.time(np.round(instants / simulation.t_end * simulation.steps))
    jumps, seen = (np.asarray(signal(t) != signal.before(t), dtype=bool) for t in (instants, nearest))
    tolerance = ON_GRID_SHARE * simulation.dt + ON_GRID_ROUNDINGS * np.finfo(float).eps * instants
    inside = (np.abs(instants - nearest) > tolerance) | (jumps & ~seen)
    return instants[inside], jumps[inside]


def _too_dense(signals: tuple[Signal, ...], simulation: Simulation) -> bool:
    first, second = (float(simulation.time(k)) for k in (0, 1))
    counts = [len(signal.breaks(first, second)) for signal in signals if isinstance(signal, BreakingSignal)]
    if max(counts, default=0) > 10 * MOST_PIECES:  # on the grid or not: telling them apart takes seconds for millions of breaks
        return True
    return len(breaks_inside(signals, simulation, 0, 1)) >= MOST_PIECES


def _windows(simulation: Simulation) -> Iterator[tuple[int, int]]:
    """The run divided into windows of growing length, because most signals that break inside steps do so early."""
    start, length = 0, 1
    while start < simulation.steps:
        stop = min(start + length, simulation.steps)
        yield start, stop
        start, length = stop, min(2 * length, LONGEST_WINDOW)


def _counted(signals: tuple[Signal, ...], simulation: Simulation) -> tuple[int, int]:
    """The number of steps with a jump inside, and the number of steps with only a corner inside."""
    breaking = [signal for signal in signals if isinstance(signal, BreakingSignal)]
    jumps = corners = 0
    for start, stop in _windows(simulation) if breaking else ():
        grid = simulation.time(np.arange(start, stop + 1))
        found = [_inside(signal, simulation, start, stop) for signal in breaking]
        instants, is_jump = (np.concatenate(part) for part in zip(*found, strict=True))
        step = np.searchsorted(grid, instants)
        jumping = len(np.unique(step[is_jump]))
        jumps += jumping
        corners += len(np.unique(step)) - jumping
    return jumps, corners


RATE_LIMITED = "the rate limiter follows its demand within one step, so it lags by one step: first order"
QUANTISED = "the control jumps between the converter's levels inside steps: first order at best"
SATURATED = "the control enters or leaves its saturation inside steps: second order there"
JUMP_ORDER = 1
"""The order of any method if a rate jumps inside a step."""
PROJECTED = "the estimates reach the known set's boundary inside steps: first order there"
JUMPED = "the motion passes {} inside steps: first order there"
PASSED = "the motion passes {} inside steps: second order there"


def lost_along(
    found: LostOrder | None, loop: ClosedLoop, simulation: Simulation, largest: Array | None, estimates: Array | None = None
) -> LostOrder | None:
    """Add the loss of order that the trajectory of a run causes to the loss so far.

    largest    (M, m) the largest |u_i| of members that have the same limits; None if their limits differ
    estimates  (K, n) along the run, if they were recorded: a projection has a corner where they reach the known set's boundary
    """
    reached = [largest is None or not (largest[:, i] < _within(path)).all() for i, path in enumerate(loop.paths)]
    inputs = zip(loop.paths, reached, strict=True)
    costs = [cost for path, saturated in inputs if path is not None for cost in _at_input(path, loop, saturated)]
    costs += _passed(loop, estimates)
    costs = [(order, text) for order, text in dict.fromkeys(costs) if order < simulation.solver.order]
    if not costs:
        return found
    order, sentence = min(order for order, _ in costs), "; ".join(text for _, text in costs)
    if found is None:
        return LostOrder(0, 0, order, sentence)
    return LostOrder(found.jumps, found.corners, min(order, found.order), f"{found.sentence}; {sentence}", found.bends)


def _at_input(path: InputPath, loop: ClosedLoop, saturated: bool) -> Iterator[tuple[int, str]]:
    """The remaining orders at the input, with sentences. The output of a sampled controller jumps only at samples."""
    if path.quantum is not None and not loop.sampled:
        yield 1, QUANTISED
    if path.saturation is not None and saturated and not loop.sampled:
        yield BEND_ORDER, SATURATED
    if path.rate_limit is not None:
        yield 1, RATE_LIMITED


def _within(path: InputPath | None) -> float:
    """The bound on |u| below which no saturation is reached."""
    if path is None or path.saturation is None:
        return np.inf
    return float(np.min(np.abs(path.saturation))) - (path.quantum or 0.0) / 2


def _passed(loop: ClosedLoop, estimates: Array | None) -> Iterator[tuple[int, str]]:
    """The parts whose rates have a corner or a jump. The output of a sampled controller has neither between its samples."""
    for thing in (loop.plant,) if loop.sampled else (loop.plant, loop.equations):
        for part in _parts(thing):
            if isinstance(part, Bending) and part.bend is not None:
                yield BEND_ORDER, PASSED.format(part.bend)
            if isinstance(part, Jumping):
                yield JUMP_ORDER, JUMPED.format(part.jump)
    if loop.sampled:
        return
    kept = estimate_set(loop)
    if kept is not None and (estimates is None or kept.reached_by(estimates)):
        yield JUMP_ORDER, PROJECTED
    if comes_from_outside(loop.equations):
        yield from _of_a_stranger(loop)


def _of_a_stranger(loop: ClosedLoop) -> Iterator[tuple[int, str]]:
    """Equations from outside the package declare nothing, so their operations are examined."""
    operations = used(right_hand_side(replace(loop, paths=(None,) * loop.inputs, delayed=False)))
    if operations & JUMPING:
        yield JUMP_ORDER, JUMPED.format("a comparison, np.where or np.sign in an equation")
    if operations & BENDING:
        yield BEND_ORDER, PASSED.format("a corner of np.abs, np.minimum or np.maximum in an equation")


def _parts(thing: object) -> Iterator[object]:
    """An object's parts, and their parts if they are dataclasses."""
    if is_dataclass(thing) and not isinstance(thing, type):
        yield thing
        for part in vars(thing).values():
            yield from _parts(part)
