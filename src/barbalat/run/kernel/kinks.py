"""What bends or jumps where the motion takes it: limits at the input, a converter, a dead zone. No step is cut there; it is said.

Signals say beforehand where they break (``breaks``); when a control reaches its saturation nobody knows before the run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass, replace

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.loop.structure import comes_from_outside
from barbalat.loop.true_values import estimate_set
from barbalat.problem.actuation import InputPath
from barbalat.protocols import Bending, Jumping
from barbalat.run.kernel.breaks import BEND_ORDER, LostOrder
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array
from barbalat.vocabulary import BENDING, JUMPING, used

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
