"""A step with tangents: the step of a run together with its derivatives along several directions of the kernel's numbers.

The tangents are integrated by the same steps as the run, so they are the derivatives of the discrete run itself. The state is
followed by its tangents, one direction after another, and by the number of steps so far; accumulators, parameters, signals and
stored values are followed by their tangents as well. The tangent of an extremum is the tangent at the instant at which it occurs;
the step number of this instant is kept too. The random numbers of noise have no tangent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from barbalat.lowering.operations import Program
from barbalat.lowering.shape import TAPS_PER_CHANNEL, LoopShape
from barbalat.lowering.tangents import Tangented
from barbalat.run.kernel.grid import WHOLE_STEP
from barbalat.run.kernel.metrics import Accumulators, Metrics, Totals
from barbalat.run.kernel.step import StepProgram
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.run.kernel.grid import Segment
    from barbalat.solvers.simulation import Simulation

STATE, ACCUMULATORS, PARAMETERS, SIGNALS, PAST, NOISE = range(6)
"""The arguments of a step."""
Source = tuple[int, int]


@dataclass(frozen=True)
class _Places:
    """The inputs of a step with tangents, by the inputs of the plain step."""

    shape: LoopShape
    directions: int

    @property
    def pieces(self) -> int:
        """Entries at the end of a row of signals that describe a piece of a step."""
        return len(WHOLE_STEP) if self.shape.in_pieces else 0

    @property
    def sizes(self) -> dict[int, int]:
        """How many numbers of each argument have tangents."""
        s = self.shape
        taps = s.delayed * TAPS_PER_CHANNEL
        own = {STATE: s.states, ACCUMULATORS: s.accumulators, PARAMETERS: s.parameters}
        return own | {SIGNALS: s.signals - self.pieces, PAST: taps}

    def placed(self, source: Source) -> Source:
        argument, i = source
        behind = argument == SIGNALS and i >= self.sizes[SIGNALS]
        return argument, i + (self.directions * self.sizes[SIGNALS] if behind else 0)

    def tangents(self, source: Source) -> tuple[Source | None, ...]:
        argument, i = source
        size = self.sizes.get(argument, 0)
        if i >= size:
            return (None,) * self.directions
        return tuple((argument, (d + 1) * size + i) for d in range(self.directions))

    @property
    def counter(self) -> Source:
        """The number of steps so far."""
        return STATE, (1 + self.directions) * self.shape.states

    def with_tangents(self) -> LoopShape:
        s, times = self.shape, 1 + self.directions
        return replace(
            s,
            states=times * s.states + 1,
            accumulators=(times + 1) * s.accumulators,
            parameters=times * s.parameters,
            signals=times * (s.signals - self.pieces) + self.pieces,
            delayed=times * s.delayed,
        )


def with_tangents(step: StepProgram, directions: int) -> StepProgram:
    """The step with its tangents along this number of directions, which may be zero; it has neither a judge nor a watch.

    Raises ValueError for an operation without a derivative, and for a controller that is separately compiled code.
    """
    assert step.accumulators is not None and step.memory is None
    if step.outside is not None:
        raise ValueError("separately compiled code has no derivative")
    places = _Places(step.shape, directions)
    return StepProgram(
        program=_step(step, places),
        shape=places.with_tangents(),
        accumulators=TangentAccumulators(**vars(step.accumulators), directions=directions),
        sample=None if step.sample is None else _sample(step.sample, places),
    )


def _step(step: StepProgram, places: _Places) -> Program:
    assert step.accumulators is not None
    made = Tangented(step.program, places.directions, places.placed)
    made.differentiate(places.tangents)
    state, accumulators, remembered = (
        [*(made.place[i] for i in row), *(made.or_zero(known[i]) for known in made.by_direction for i in row)]
        for row in step.program.outputs
    )
    now = made.emit("input", source=places.counter)
    length = made.constant(1.0)
    if places.pieces:
        length = made.emit("input", source=places.placed((SIGNALS, places.sizes[SIGNALS])))
    state.append(made.emit("add", now, length))
    accumulators += _instants(step, places, made, now)
    return made.made((tuple(state), tuple(accumulators), tuple(remembered)))


def _instants(step: StepProgram, places: _Places, made: Tangented, now: int) -> list[int]:
    """The instant, in steps, of each extremum; zero for the other accumulators."""
    assert step.accumulators is not None
    operations, size, found = step.program.operations, step.shape.accumulators, []
    of = [name for _, name, entries in step.accumulators.layout for _ in range(entries)]
    for i, (name, output) in enumerate(zip(of, step.program.outputs[ACCUMULATORS], strict=True)):
        if name not in ("min", "max"):
            found.append(made.constant(0.0))
            continue
        before = made.emit("input", source=(ACCUMULATORS, (1 + places.directions) * size + i))
        old, new = operations[output].operands
        turned = operations[old].source != (ACCUMULATORS, i) or operations[old].name != "input"
        pair = made.place[old], made.place[new]
        second = made.emit("lt", *(pair if name == "max" else reversed(pair)))
        found.append(made.emit("select", second, *((before, now) if turned else (now, before))))
    return found


def _sample(sample: Program, places: _Places) -> Program:
    """The operations before a step at a sample."""
    made = Tangented(sample, places.directions, places.placed)
    made.differentiate(places.tangents)
    (row,) = sample.outputs
    state = [*(made.place[i] for i in row), *(made.or_zero(known[i]) for known in made.by_direction for i in row)]
    return made.made(((*state, made.emit("input", source=places.counter)),))


@dataclass(frozen=True)
class TangentAccumulators(Accumulators):
    """The accumulators of a step with tangents: the accumulators of the plain step, their tangents along each direction, and the
    instants of extrema."""

    directions: int = 0

    @property
    def size(self) -> int:
        """Number of accumulators of the plain step."""
        return sum(entries for _, _, entries in self.layout)

    @property
    def resets(self) -> tuple[float, ...]:
        return (*super().resets, *[0.0] * (1 + self.directions) * self.size)

    def totals(self, members: int) -> TangentTotals:
        return TangentTotals(self, members)


class TangentTotals(Totals):
    """Running totals of M members and of their tangents."""

    def __init__(self, accumulators: TangentAccumulators, members: int) -> None:
        super().__init__(accumulators, members)
        self.size, self.directions = accumulators.size, accumulators.directions

    def _beside(self, rows: slice) -> Array:
        """(1 + directions, entries) the rows of the tangents of some accumulators, followed by the rows of their instants."""
        return np.arange(rows.start, rows.stop) + self.size * np.arange(1, self.directions + 2)[:, None]

    def _merge(self, segment: Segment, out: Array, members: slice) -> None:
        total = (self.tail if segment.in_tail else self.head)[:, members]
        for quantity, operation, entries in self.operations:
            rows = self.at[quantity, operation]
            beside = self._beside(rows)
            if operation == "sum":
                total[beside[:-1]] += out[:, beside[:-1]].sum(axis=0)
            elif operation in ("min", "max") and entries:
                values = out[:, rows]
                best = values.argmin(axis=0) if operation == "min" else values.argmax(axis=0)
                self._take(total, rows, operation, np.take_along_axis(values, best[None], axis=0)[0], _along(out, beside, best))
        super()._merge(segment, out, members)

    def merge_final(self, out: Array, members: slice) -> None:
        total = self.tail[:, members]
        for quantity, operation, entries in self.operations:
            rows = self.at[quantity, operation]
            beside = self._beside(rows)
            if operation in ("min", "max") and entries:
                self._take(total, rows, operation, out[rows], out[beside])
            elif quantity == "e^2":
                total[beside[:-1]] += out[beside[:-1]]
        super().merge_final(out, members)

    def _take(self, total: Array, rows: slice, operation: str, values: Array, beside: Array) -> None:
        """Store the tangents (1 + directions, entries, M) of extrema that exceed the previous ones, before these are updated."""
        farther = values < total[rows] if operation == "min" else values > total[rows]
        places = self._beside(rows)
        total[places] = np.where(farther, beside, total[places])

    def tangents(self, simulation: Simulation, final: Array) -> tuple[list[Metrics], Metrics]:
        """The tangents of the metrics along each direction, and the instants [s] of metrics that are extrema; NaN for others.

        final  (directions, n, M) the tangents of theta_hat at the end
        """
        found = [self._tangent(d, simulation, final[d]) for d in range(self.directions)]
        return found, self._instants(simulation)

    def _extremum(self, quantity: str, d: int, *parts: Array) -> Array:
        """(entries, M) the tangent of the largest magnitude along direction d; for the last index, its instant."""
        low, high = self.at[quantity, "min"], self.at[quantity, "max"]
        values = np.stack([one for part in parts for one in (-part[low], part[high])])
        sign = 1.0 if d == self.directions else -1.0
        beside = np.stack([one for part in parts for one in (sign * part[self._beside(low)[d]], part[self._beside(high)[d]])])
        return np.asarray(np.take_along_axis(beside, values.argmax(axis=0)[None], axis=0)[0])

    def _alone(self, value: Array) -> Array:
        return np.asarray(np.where(np.isnan(self.diverged_step), value, np.nan).T)

    def _metrics(self, d: int, rms_e: Array, final: Array, rate: Array, unit: float) -> Metrics:
        head, tail = self.head, self.tail
        of_inputs = unit * self._extremum("u", d, head, tail)
        low, high = (self._beside(self.at["theta_hat", which])[d] for which in ("min", "max"))
        measured = len(head[self.at["y", "min"]]) > 0
        return Metrics(
            diverged_at=np.full(head.shape[1], np.nan),
            max_abs_e=self._alone(unit * self._extremum("e", d, head, tail)),
            rms_e=self._alone(rms_e),
            tail_max_abs_e=self._alone(unit * self._extremum("e", d, tail)),
            max_abs_u=self._alone(of_inputs[0] if len(of_inputs) == 1 else of_inputs),
            theta_hat_final=self._alone(final),
            theta_hat_tail_min=self._alone(unit * tail[low]),
            theta_hat_tail_max=self._alone(unit * tail[high]),
            theta_hat_variation_rate=self._alone(rate),
            max_abs_y=self._alone(unit * self._extremum("y", d, head, tail)[0]) if measured else None,
        )

    def _tangent(self, d: int, simulation: Simulation, final: Array) -> Metrics:
        squares, variation = self.at["e^2", "sum"], self.at["variation", "sum"]
        total = self.head[squares] + self.tail[squares]
        moved = self.head[self._beside(squares)[d]] + self.tail[self._beside(squares)[d]]
        tail_time = float(simulation.t_end - simulation.time(simulation.tail_start))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            rms_e = moved / (2 * np.sqrt(total * (simulation.steps + 1)))
            rms_e = np.where((total == 0) & (moved == 0), 0.0, rms_e)  # e is zero throughout
            rate = self.tail[self._beside(variation)[d]]
            rate = rate / tail_time if tail_time else np.zeros_like(final)
            return self._metrics(d, rms_e, final, rate, 1.0)

    def _instants(self, simulation: Simulation) -> Metrics:
        e, theta_hat = self.at["e", "min"], self.at["theta_hat", "min"]
        members = self.head.shape[1]
        none = np.full((e.stop - e.start, members), np.nan)
        without = np.full((theta_hat.stop - theta_hat.start, members), np.nan)
        return self._metrics(self.directions, none, without, without, simulation.dt)


def _along(out: Array, beside: Array, best: Array) -> Array:
    """(1 + directions, entries, M) the values that accompany the extrema in the blocks ``best`` (entries, M)."""
    values = out[:, beside]  # (blocks, 1 + directions, entries, M)
    return np.asarray(np.take_along_axis(values, best[None, None], axis=0)[0])
