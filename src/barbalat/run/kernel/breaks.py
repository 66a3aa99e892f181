"""Where signals and the motion jump or bend inside solver steps: such a step is cut in two, or what is lost there is said.

A method of order p keeps it as long as a step sees a smooth right-hand side. A jump inside a step costs an error of order h, a
corner one of order h^2, whatever p is. What lies on the grid costs nothing: a step's last stage takes limits from the left.
Signals say beforehand where they break (``breaks``), and there a step is cut. When a control reaches its saturation, or an
estimate the boundary of its known set, nobody knows before the run: no step is cut there, and what that costs is said.
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
"""Of a step: a break so near to the grid is meant to lie on it. No method resolves less."""
ON_GRID_ROUNDINGS = 64
"""Likewise of the time itself: instants are products of frequencies, phases and pi, with a few roundings each."""
MOST_PIECES = 100
"""Of one step. What breaks more often in the first one is not cut: the tables of a call of the kernel would take gigabytes."""
LONGEST_WINDOW = 1 << 16
"""Steps whose breaks are looked at together: up to 50 MB with so many pieces of each."""
BEND_ORDER = 2
"""Of the error that a corner leaves."""
_ORDERS = {1: "first", 2: "second", 3: "third", 4: "fourth"}


@dataclass(frozen=True)
class LostOrder:
    """What breaks inside of steps cost a run whose steps are not cut there.

    jumps     steps with a jump inside, of the command or of a disturbance; None where they are too many to count
    corners   steps with no jump, but a corner, of the same; what the motion itself brings is not counted, see ``lost_along``
    order     in the step, that is left to the method at worst
    sentence  the same for people
    bends     whether the plant sees bends of the control through a delay, which are interpolated wherever they come
    """

    jumps: int | None
    corners: int | None
    order: int
    sentence: str
    bends: bool = False

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def breaks_inside(signals: tuple[Signal, ...], simulation: Simulation, start: int, stop: int) -> Array:
    """The instants (K,) [s], increasing, at which any signal breaks inside of the steps from ``start`` to ``stop`` - 1."""
    found = [_inside(signal, simulation, start, stop)[0] for signal in signals if isinstance(signal, BreakingSignal)]
    return np.unique(np.concatenate([np.zeros(0), *found]))


def can_be_split(signals: tuple[Signal, ...], simulation: Simulation) -> bool:
    """Whether any signal breaks inside of a step, and none so often that cutting is out of the question."""
    if not any(isinstance(signal, BreakingSignal) for signal in signals) or _too_dense(signals, simulation):
        return False
    return any(len(breaks_inside(signals, simulation, *window)) for window in _windows(simulation))


def lost_order(signals: tuple[Signal, ...], simulation: Simulation, *, delayed: bool, bends: bool = False) -> LostOrder | None:
    """What a run loses, if anything: only a ``delayed`` loop's steps are not cut, and those that would be cut too often.

    bends  whether the control that the plant sees through a delay has bends, see ``delay.brings_bends``
    """
    order = simulation.solver.order
    if _too_dense(signals, simulation):
        often = f"{MOST_PIECES} times or more in a step, too often to split it"
        return LostOrder(None, None, 1, f"the command or a disturbance jumps or bends {often}: it is not resolved")
    if not delayed:
        return None
    jumps, corners = _counted(signals, simulation)
    left = 1 if jumps else BEND_ORDER
    if not (jumps or corners or bends) or order <= left:
        return None
    sentences = []
    if jumps or corners:
        what = "jumps" if jumps else "bends"
        where = f"inside {jumps or corners} of the {simulation.steps} steps of a delayed loop, which can't be split"
        sentences.append(f"the command or a disturbance {what} {where}: {_ORDERS[left]} order there")
    if bends and order > BEND_ORDER:
        sentences.append(
            "behind the delay the control's bends, at t = 0 and a delay after each jump, are interpolated: "
            f"{_ORDERS[BEND_ORDER]} order there"
        )
    return LostOrder(jumps, corners, left, "; ".join(sentences), bends and order > BEND_ORDER)


def _inside(signal: BreakingSignal, simulation: Simulation, start: int, stop: int) -> tuple[Array, Array]:
    """The signal's breaks (K,) inside of these steps, and which of them are jumps.

    Which lie on the grid is asked of the signal: its jump is on the grid if it is seen at the grid's nearest time.
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
    if max(counts, default=0) > 10 * MOST_PIECES:  # wherever they lie; to see which are on the grid takes seconds for millions
        return True
    return len(breaks_inside(signals, simulation, 0, 1)) >= MOST_PIECES


def _windows(simulation: Simulation) -> Iterator[tuple[int, int]]:
    """The run in pieces that grow: most signals that break inside of steps do so early."""
    start, length = 0, 1
    while start < simulation.steps:
        stop = min(start + length, simulation.steps)
        yield start, stop
        start, length = stop, min(2 * length, LONGEST_WINDOW)


def _counted(signals: tuple[Signal, ...], simulation: Simulation) -> tuple[int, int]:
    """Steps with a jump inside, and those with a corner only."""
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


RATE_LIMITED = "the rate limiter follows its demand within one step, so that the step is its lag: first order"
QUANTISED = "the converter's levels are passed inside of steps, where the control jumps: first order at best"
SATURATED = "the control enters or leaves its saturation inside of steps: second order there"
JUMP_ORDER = 1
"""What a rate that jumps inside of a step leaves of any method's order."""
PROJECTED = "where the estimates reach the known set's boundary inside of a step: first order there"
JUMPED = "where the motion passes {} inside of a step: first order there"
PASSED = "where the motion passes {} inside of a step: second order there"


def lost_along(
    found: LostOrder | None, loop: ClosedLoop, simulation: Simulation, largest: Array | None, estimates: Array | None = None
) -> LostOrder | None:
    """What a run loses to its own motion, beside what it lost already.

    largest    (M, m) the largest |u_i| of members that share the loop's limits; None where they differ in them
    estimates  (K, n) along the run, where they were recorded: a projection bends where they reach the known set's boundary
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
    """Orders that are left, and sentences. What a sampled controller holds jumps at samples alone."""
    if path.quantum is not None and not loop.sampled:
        yield 1, QUANTISED
    if path.saturation is not None and saturated and not loop.sampled:
        yield BEND_ORDER, SATURATED
    if path.rate_limit is not None:
        yield 1, RATE_LIMITED


def _within(path: InputPath | None) -> float:
    """What |u| stays below where no saturation is reached."""
    if path is None or path.saturation is None:
        return np.inf
    return float(np.min(np.abs(path.saturation))) - (path.quantum or 0.0) / 2


def _passed(loop: ClosedLoop, estimates: Array | None) -> Iterator[tuple[int, str]]:
    """Where rates have a corner or jump. What a sampled controller holds has neither between its samples."""
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
    """Equations from outside declare nothing: what they are written with tells."""
    operations = used(right_hand_side(replace(loop, paths=(None,) * loop.inputs, delayed=False)))
    if operations & JUMPING:
        yield JUMP_ORDER, JUMPED.format("a comparison, np.where or np.sign in an equation")
    if operations & BENDING:
        yield BEND_ORDER, PASSED.format("a corner of np.abs, np.minimum or np.maximum in an equation")


def _parts(thing: object) -> Iterator[object]:
    """An object's parts and theirs, as far as they are dataclasses."""
    if is_dataclass(thing) and not isinstance(thing, type):
        yield thing
        for part in vars(thing).values():
            yield from _parts(part)
