"""Attempts with an observer in the same kernel: each successful attempt adds its nodes to the metrics of its member and to the
judge's memory.

Parallel members then run from beginning to end inside the kernel. The operations at the nodes and their operands are those of the
observer of a single run, so the results agree bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat.lowering.operations import Operation, Program, append, read
from barbalat.lowering.optimize import as_written, drop_dead, optimize
from barbalat.lowering.shape import LoopShape
from barbalat.run.kernel.attempt import PIECE, SMOOTH, Attempts, Written, dense_at, slices_of
from barbalat.run.kernel.past import SAME_INSTANT
from barbalat.run.kernel.step import StepProgram
from barbalat.solvers.simulation import Simulation

if TYPE_CHECKING:
    pass

NODES_EACH_STEP = 8
"""Least number of nodes per step, an even number; a step covers about 1.5 rad of the fastest oscillation."""
WITHIN = 0.9
"""Largest distance between nodes, as a fraction of the distance between recorded instants."""
STATE, ACCUMULATORS, _, SIGNALS = range(4)
"""Arguments of the operation list of a step."""

Places = tuple[int, ...]
"""Positions of values among the operations."""


@dataclass(frozen=True)
class Observed:
    """The kernel of attempts whose nodes are observed. Its state is the state of the attempts, followed by the parts of
    ``places``.

    A call of the kernel's step observes up to NODES_EACH_STEP nodes. A step with more nodes takes further calls, in which no step
    is attempted.

    observer  the observer of the nodes
    dt        interval between two recorded instants [s]; ``steps`` is the number of intervals up to t_end [s]
    """

    attempts: Attempts
    observer: StepProgram
    dt: float
    steps: int
    t_end: float

    @classmethod
    def of(cls, attempts: Attempts, observer: StepProgram, grid: Simulation) -> Observed:
        """The kernel for the recorded instants of this grid."""
        return cls(attempts, observer, grid.dt, grid.steps, grid.t_end)

    def of_attempts(self, attempts: Attempts) -> Observed:
        """This kernel for different attempts, whose signals may differ."""
        found = replace(self, attempts=attempts)
        if attempts.signals.formulas == self.attempts.signals.formulas:
            vars(found).update(self.traced)
        return found

    @property
    def traced(self) -> dict[str, Any]:
        """The parts that take time to trace, by their attributes' names."""
        return {"lists": self.lists}

    @cached_property
    def places(self) -> dict[str, slice]:
        """The rows of each part of the state that follows the state of the attempts.

        kept      memory of the judge and of the observer
        figures   the accumulators
        apart     1 if new metrics begin with the next step
        joins     whether the last step ended smoothly; ``before`` is the weight of its end
        waits     1 if the last node awaits the state that follows it: its time, weight, whether the motion is smooth there, the
                  signals and the state
        observed  number of nodes of a step that are already observed; 0 between steps
        written   row written by that step; ``piece`` is the row of its piece
        """
        loop, accumulators = self.attempts.loop, self.observer.accumulators
        assert accumulators is not None
        sizes = {
            "kept": self.observer.shape.states - loop.size, "figures": len(accumulators.resets),
            "apart": 1, "joins": 1, "before": 1,
            "waits": 1, "time": 1, "weight": 1, "smooth": 1, "signals": loop.signal_count, "x": loop.size,
            "observed": 1, "written": Written(loop.size).size, "piece": self.attempts.count,
        }  # fmt: skip
        return slices_of(sizes, self.attempts.carried.size)

    @property
    def size(self) -> int:
        return int(self.places["piece"].stop)

    def row(self, name: str) -> int:
        """The row of a part of the attempts' state."""
        return int(self.attempts.carried.places[name].start)

    def initial(self, attempts: np.ndarray) -> np.ndarray:
        """(size,) the state at t = 0, for this state of the attempts."""
        assert self.observer.accumulators is not None
        memory, at = self.observer.memory, self.places
        found = np.zeros(self.size)
        found[: len(attempts)] = attempts
        if memory is not None:
            found[at["kept"]][: len(memory.begins)] = memory.begins
        found[at["figures"]] = self.observer.accumulators.resets
        return found

    @property
    def shape(self) -> LoopShape:
        """Sizes for the kernel."""
        noisy = self.attempts.loop.signals.noise > 0
        return replace(self.attempts.shape, states=self.size, accumulators=0, rows_per_member=noisy)

    @cached_property
    def lists(self) -> tuple[Program, Program]:
        """An attempt with its observation, and the program that recomputes its inputs beforehand."""
        _, begin = self.attempts.lists
        line = _Line(begin.operations)
        others = line.inputs(STATE, slice(self.attempts.carried.size, self.size))
        return self._program(), Program(tuple(line.operations), ((*begin.outputs[0], *others),))

    def _program(self) -> Program:
        line, at, carried_at = _Line(), self.places, self.attempts.carried.places
        old = {name: line.inputs(STATE, rows) for name, rows in at.items()}
        pause, (never,) = line.inputs(STATE, carried_at["pause"]), line.constants(-np.inf)
        (held,) = line.select(old["observed"][0], (never,), pause)
        place = carried_at["pause"].start
        carried, written, *record = line.add(self.attempts.lists[0], {(STATE, place): held})
        carried = (*carried[:place], *pause, *carried[place + 1 :])
        written = line.select(old["observed"][0], old["written"], written)
        piece = line.select(old["observed"][0], old["piece"], line.inputs(SIGNALS, slice(0, self.attempts.count)))
        after = line.inputs(STATE, carried_at["t"]), (carried[carried_at["t"].start],)
        step = self._step(line, old, written, piece, after)
        kept = old["kept"], old["figures"]
        waiting = _Node(*(old[name] for name in _Node._fields))
        begins = line.inputs(STATE, carried_at["x"])
        rows = [(old["waits"][0], waiting, begins, step.since_waiting)]
        rows += zip(step.due, step.nodes, step.following, step.lengths, strict=True)
        zero, one = line.constants(0.0, 1.0)
        (apart,) = line.select(step.first, old["apart"], (zero,))
        for i, (due, node, then, length) in enumerate(rows):
            row = [*node.signals, *then, *node.weight, *node.smooth, apart if i == 1 else zero, length, one, one]
            kept = self._seen(line, due, (*node.x, *kept[0]), kept[1], row)
        new = {name: line.select(step.ready, values, old[name]) for name, values in step.left.items()}
        new |= {"kept": kept[0], "figures": kept[1], "apart": line.select(step.active, (zero,), old["apart"])}
        new |= {"waits": (step.ready,), "observed": (step.observed,), "written": written, "piece": piece}
        outputs = (*carried, *(place for name in at for place in new[name]))
        return drop_dead(Program(tuple(line.operations), (outputs, (), *record)))

    def _seen(self, line: _Line, due: int, state: Places, figures: Places, row: Sequence[int]) -> tuple[Places, Places]:
        """The memory and the metrics after the node if it is ``due``; otherwise unchanged."""
        size = self.attempts.loop.size
        values = {(STATE, i): place for i, place in enumerate(state)}
        values |= {(ACCUMULATORS, i): place for i, place in enumerate(figures)}
        values |= {(SIGNALS, i): place for i, place in enumerate(row)}
        found = line.add(self.observer.program, values)
        return line.select(due, found[0][size:], state[size:]), line.select(due, found[1], figures)

    def _step(
        self, line: _Line, old: Mapping[str, Places], written: Places, piece: Places, times: tuple[Places, Places]
    ) -> _Step:
        """The observations of a call for the step that has ``written``; ``times`` are the times before and after the attempt
        [s]."""
        values = (*written[:3], *(place for name in ("observed", "joins", "before", "time") for place in old[name]))
        found = line.add(self._rows(), {(0, i): place for i, place in enumerate((*values, *times[0], *times[1]))})
        shares, instants, weights, smooth, due, last, lengths, alone = found
        ended, first, active, ready, observed, since_waiting, own, joins, end_smooth = alone
        states = self.attempts.loop.size
        given = {(0, i): place for i, place in enumerate(written)}
        x = [line.add(self._dense, given | {(1, 0): share})[0] for share in shares]
        x[0] = line.select(first, written[3 : 3 + states], x[0])
        x_end = line.add(self._end, given)[0]
        driving = {(SIGNALS, i): place for i, place in enumerate(piece)}
        driven = [line.add(self._driving, driving | {(2, 0): instant})[0] for instant in instants]
        nodes = [
            _Node((instants[i],), (weights[i],), (smooth[i],), driven[i], x[i]) for i in range(NODES_EACH_STEP)
        ]  # fmt: skip
        end = _Node((instants[-1],), (own,), (end_smooth,), driven[-1], x_end)
        left = nodes[1]  # the number of nodes is even
        for i in range(3, NODES_EACH_STEP, 2):
            left = _Node(*(line.select(last[i], mine, others) for mine, others in zip(nodes[i], left, strict=True)))
        left = _Node(*(line.select(ended, mine, others) for mine, others in zip(end, left, strict=True)))
        (zero,) = line.constants(0.0)
        before = line.select(ended, (zero,), (own,))
        return _Step(
            nodes, due, [line.select(last[i], x_end, x[i + 1]) for i in range(NODES_EACH_STEP)], lengths,
            left._asdict() | {"joins": (joins,), "before": before}, since_waiting, first, active, ready, observed,
        )  # fmt: skip

    def _rows(self) -> Program:
        """Compute the data that a single run writes for its nodes besides signals and states, and the nodes that are due. The
        arguments are the step's code, beginning [s] and length [s], the number of nodes observed earlier, ``joins`` and
        ``before``, the time of the waiting node, and the times before and after the attempt [s]."""
        import casadi as ca

        given = ca.SX.sym("given", 9)
        code, t, h, seen, joins, before, waiting, t_old, t_new = ca.vertsplit(given)
        each = ca.fmax(float(NODES_EACH_STEP), 2 * ca.ceil(h / (2 * WITHIN * self.dt)))
        active, ended, first = code > 0, code == PIECE, seen == 0
        own = h / each / 3 * (self.steps + 1) / self.t_end
        shares = [(seen + i) / each for i in range(NODES_EACH_STEP + 1)]
        instants = [*(t + h * share for share in shares[:-1]), t + h * shares[-1], t_new * (1 - 2 * SAME_INSTANT)]
        last = [seen + (i + 1) == each for i in range(NODES_EACH_STEP)]
        due = [ca.logic_and(active, ca.logic_or(seen + (i + 1) < each, ca.logic_and(one, ended))) for i, one in enumerate(last)]
        weights = [own * (4.0 if i % 2 else 2.0) for i in range(NODES_EACH_STEP)]
        weights[0] = ca.if_else(first, own + before, weights[0])
        smooth = [ca.if_else(first, joins, 1.0), *([ca.SX(1.0)] * (NODES_EACH_STEP - 1))]
        following_times = [ca.if_else(one, instants[-1], instants[i + 1]) for i, one in enumerate(last)]
        lengths = [(then - now) / self.dt for now, then in zip(instants, following_times, strict=False)]
        ready = ca.logic_and(active, seen + NODES_EACH_STEP >= each)
        observed = ca.if_else(ca.logic_and(active, ca.logic_not(ready)), seen + NODES_EACH_STEP, 0.0)
        alone = [ended, first, active, ready, observed, (t_old - waiting) / self.dt, own, code == SMOOTH, ca.SX(-1.0)]
        results = [shares, instants, weights, smooth, due, last, lengths, alone]
        return as_written(read(ca.Function("rows", [given], [ca.densify(ca.vertcat(*one)) for one in results])))

    @cached_property
    def _dense(self) -> Program:
        """The states at a fraction of a step, from the row that it wrote and the fraction."""
        import casadi as ca

        states = self.attempts.loop.size
        row, share = ca.SX.sym("row", 3 + 8 * states), ca.SX.sym("share")
        found = dense_at(row[3 : 3 + states], row[3 + states :], share)
        return optimize(read(ca.Function("states", [row, share], [found])), fused=False)

    @cached_property
    def _end(self) -> Program:
        """The data that a single run writes for its nodes in addition to signals and states, and the nodes that are due. The
        arguments are the step's code, beginning [s] and length [s], the number of nodes observed earlier, ``joins`` and
        ``before``, the time of the waiting node, and the times before and after the attempt [s]."""
        import casadi as ca

        states = self.attempts.loop.size
        row = ca.SX.sym("row", 3 + 2 * states)
        return as_written(read(ca.Function("end", [row], [row[3 : 3 + states] + row[3 + states :]])))

    @cached_property
    def _driving(self) -> Program:
        """The signals at a time, from the row of its piece. The output of the delay is zero there, because no output depends on
        it."""
        import casadi as ca

        attempts = self.attempts
        t, numbers, nothing = ca.SX.sym("t"), ca.SX.sym("numbers", attempts.count), ca.SX(0, 1)
        signals = ca.vertcat(attempts.timed(t, numbers), ca.SX.zeros(attempts.loop.signals.delayed))
        traced = ca.Function("signals", [nothing, nothing, t, numbers], [ca.densify(signals)], {"cse": True})
        return optimize(read(traced), fused=False)


class _Node(NamedTuple):
    """A node: its time [s], the weight of its squares, whether the motion is smooth there, the signals and the state."""

    time: Places
    weight: Places
    smooth: Places
    signals: Places
    x: Places


class _Step(NamedTuple):
    """The nodes that a call observes.

    due, following, lengths  for each node: whether it counts, the state at the next node, and the time to the next node
    left           the waiting node and the data for the next step, if the call has finished its step (``ready``)
    since_waiting  the time from the node that waited to the beginning of the attempt
    first          whether the call begins with the step's first node
    active         whether there is a step
    observed       number of its nodes that are then observed
    """

    nodes: list[_Node]
    due: Places
    following: list[Places]
    lengths: Places
    left: dict[str, Places]
    since_waiting: int
    first: int
    active: int
    ready: int
    observed: int


class _Line:
    """Operations to which further lists are appended."""

    def __init__(self, operations: Sequence[Operation] = ()) -> None:
        self.operations = list(operations)

    def _appended(self, more: Sequence[Operation]) -> Places:
        first = len(self.operations)
        self.operations += more
        return tuple(range(first, len(self.operations)))

    def inputs(self, argument: int, rows: slice) -> Places:
        """These components of an argument of the kernel's step."""
        return self._appended([Operation("input", source=(argument, i)) for i in range(rows.start, rows.stop)])

    def constants(self, *values: float) -> Places:
        return self._appended([Operation("constant", value=value) for value in values])

    def add(self, program: Program, inputs: Mapping[tuple[int, int], int]) -> tuple[Places, ...]:
        """Append a list whose inputs are the given values or arguments of the kernel; return its outputs."""
        return append(self.operations, program, inputs)

    def select(self, condition: int, values: Sequence[int], others: Sequence[int]) -> Places:
        """Select the first values if the condition holds, otherwise the others."""
        pairs = zip(values, others, strict=True)
        return self._appended([Operation("select", (condition, value, other)) for value, other in pairs])
