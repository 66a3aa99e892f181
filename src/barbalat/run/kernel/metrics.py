"""The metrics of a run, taken over every solver step inside the kernel and merged block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import Outputs
from barbalat.protocols import Value
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.run.kernel.grid import Segment
    from barbalat.solvers.simulation import Simulation

DIVERGENCE_LIMIT = 1e12
"""A run has diverged if the magnitudes of x, x_m and theta_hat add up to more than this, or if a state is not finite. With
output feedback, the magnitudes of y and y - y_m are added instead, because x depends on the realisation and the parameters grow
with powers of the bandwidth."""

_RESETS = {"min": np.inf, "max": -np.inf, "sum": 0.0, "steps": 0.0, "alive": 1.0}


def divergence_measure(loop: ClosedLoop, outputs: Outputs, flat: Value) -> Value:
    """The quantity of a flat state that is compared with DIVERGENCE_LIMIT. Other integrated quantities may be large because of
    their unit or by design (u^2, a covariance)."""
    state = loop.unpack(flat)
    fed_back = (outputs.y, outputs.e) if outputs.y.shape[0] else (state.x, state.x_m, loop.theta_hat(state.controller))
    first, *others = (np.sum(np.abs(part)) for part in fed_back)
    return sum(others, first)


@dataclass(frozen=True)
class Accumulators:
    """The accumulators of a loop with n components of e and of theta_hat, in kernel order: (quantity, operation, entries).

    For e, u and theta_hat: extrema over the instants 0...N. For e^2: the sum over these instants. For |change of theta_hat|: the
    sum over the steps. "alive" is 1 until the first diverged step of a block; "steps" counts the steps before it. If a step is
    made in pieces, the instants inside it count for the extrema and for the change, but not for the sum of squares, in which all
    steps have the same weight.
    """

    errors: int
    parameters: int
    inputs: int = 1
    outputs: int = 0

    @property
    def layout(self) -> tuple[tuple[str, str, int], ...]:
        n, p, m, q = self.errors, self.parameters, self.inputs, self.outputs
        return (
            ("e", "min", n), ("e", "max", n), ("u", "min", m), ("u", "max", m),
            ("theta_hat", "min", p), ("theta_hat", "max", p), ("e^2", "sum", n),
            ("variation", "sum", p), ("y", "min", q), ("y", "max", q), ("good", "alive", 1), ("good", "steps", 1),
        )  # fmt: skip

    @property
    def resets(self) -> tuple[float, ...]:
        return tuple(_RESETS[operation] for _, operation, size in self.layout for _ in range(size))

    def slices(self) -> dict[tuple[str, str], slice]:
        result, start = {}, 0
        for quantity, operation, size in self.layout:
            result[quantity, operation] = slice(start, start + size)
            start += size
        return result

    def totals(self, members: int) -> Totals:
        """Running totals of this number of members."""
        return Totals(self, members)

    def update(
        self,
        old: Value,
        outputs: Outputs,
        size: Value,
        state_next: Value,
        moved: Value,
        *,
        begins: Value = 1.0,
        ends: Value = 1.0,
        turning: dict[str, Value] | None = None,
    ) -> Value:
        """The accumulators after one step; ``outputs`` are the outputs at its start, and ``moved`` is |change of theta_hat|.

        ``size`` is the ``divergence_measure`` after the step.

        The accumulators after a piece of a step: ``begins`` is 1 for the first piece and ``ends`` is 1 for the last piece,
        otherwise 0. ``begins`` weights the squares; ``turning`` has further values that count for the extrema.
        """
        at = self.slices()
        good = np.where(size <= DIVERGENCE_LIMIT, 1.0, 0.0)
        good = good * np.where(np.sum(np.abs(state_next)) < np.inf, 1.0, 0.0)
        alive = old[at["good", "alive"]] * good
        values = {"e": outputs.e, "u": outputs.u, "theta_hat": outputs.theta_hat, "y": outputs.y}
        new = []
        for quantity, operation, _ in self.layout:
            previous = old[at[quantity, operation]]
            if operation in ("min", "max"):
                farther = np.minimum if operation == "min" else np.maximum
                extremum = farther(previous, values[quantity])
                new.append(extremum if turning is None else farther(extremum, turning[quantity]))
            elif quantity == "e^2":
                new.append(previous + begins * (outputs.e * outputs.e))
            elif quantity == "variation":
                new.append(previous + moved)
            else:
                new.append(alive if operation == "alive" else previous + ends * alive)
        return np.concatenate(new)


@dataclass(frozen=True, eq=False)
class Metrics:
    """Metrics of a run or of an ensemble: every array has the members' axis first, (M, ...).

    max_abs_e, rms_e and tail_max_abs_e are (M, n), max_abs_u is (M,), or (M, m) with m inputs. theta_hat_final,
    theta_hat_tail_min, theta_hat_tail_max and theta_hat_variation_rate [1/s] are (M, n). diverged_at (M,) [s] is NaN where the
    run stayed bounded. All other metrics of a run that diverged are NaN. max_abs_y (M,) if the output is measured, otherwise
    None. The tail is the last quarter of [0, t_end].
    """

    diverged_at: Array
    max_abs_e: Array
    rms_e: Array
    tail_max_abs_e: Array
    max_abs_u: Array
    theta_hat_final: Array
    theta_hat_tail_min: Array
    theta_hat_tail_max: Array
    theta_hat_variation_rate: Array
    max_abs_y: Array | None = None

    @classmethod
    def together(cls, parts: Sequence[Metrics]) -> Metrics:
        """The metrics of all members, joined from these parts."""
        named = {name: [getattr(part, name) for part in parts] for name in cls.__dataclass_fields__}
        return cls(**{name: None if values[0] is None else np.concatenate(values) for name, values in named.items()})

    def of(self, which: slice | Array) -> Metrics:
        """The metrics of some of the members."""
        return Metrics(**{name: None if values is None else values[which] for name, values in vars(self).items()})

    def columns(self) -> dict[str, Array]:
        """(M,) metrics under the names of ``run --json``, with the component in brackets."""
        found: dict[str, Array] = {}
        for name, values in vars(self).items():
            if values is None:
                continue
            if values.ndim == 1:
                found[name] = values
            else:
                found |= {f"{name}[{i}]": values[:, i] for i in range(values.shape[1])}
        return found

    def end_of(self, i: int) -> float | None:
        """The time at which a member diverged [s]; None if it did not."""
        instant = float(self.diverged_at[i])
        return None if np.isnan(instant) else instant

    def of_member(self, i: int) -> dict[str, float | list[float] | None]:
        """One member's metrics under the names of the JSON contract; ``None`` for a metric that has no finite value."""
        result: dict[str, float | list[float] | None] = {}
        for name in self.__dataclass_fields__:
            if getattr(self, name) is None:
                continue
            value = getattr(self, name)[i]
            entries = [float(v) if np.isfinite(v) else None for v in np.atleast_1d(value)]
            result[name] = entries if np.ndim(value) else entries[0]  # type: ignore[assignment]
        return result


class Totals:
    """Running totals of M members over the head and the tail of a run."""

    def __init__(self, accumulators: Accumulators, members: int) -> None:
        self.at = accumulators.slices()
        self.operations = accumulators.layout
        start = np.array(accumulators.resets)[:, None].repeat(members, axis=1)
        self.head, self.tail = start.copy(), start.copy()
        self.diverged_step = np.full(members, np.nan)

    def merge(self, segment: Segment, out: Array, members: slice) -> None:
        """Add a segment's blocks; ``out`` is (blocks, accumulators, members of the slice)."""
        with np.errstate(invalid="ignore", over="ignore"):  # a member that has just diverged may overflow; its metrics become NaN
            self._merge(segment, out, members)

    def _merge(self, segment: Segment, out: Array, members: slice) -> None:
        total = (self.tail if segment.in_tail else self.head)[:, members]
        for quantity, operation, _ in self.operations:
            rows = self.at[quantity, operation]
            if operation == "min":
                total[rows] = np.minimum(total[rows], out[:, rows].min(axis=0))
            elif operation == "max":
                total[rows] = np.maximum(total[rows], out[:, rows].max(axis=0))
            elif operation == "sum":
                total[rows] += out[:, rows].cumsum(axis=0)[
                    -1
                ]  # block by block, because sum() would group them by the memory layout
        good_steps = out[:, self.at["good", "steps"].start]
        bad = good_steps < segment.length
        first = bad.argmax(axis=0)
        step = segment.start + first * segment.length + np.take_along_axis(good_steps, first[None], axis=0)[0] + 1
        known = self.diverged_step[members]
        self.diverged_step[members] = np.where(np.isnan(known) & bad.any(axis=0), step, known)

    def merge_final(self, out: Array, members: slice) -> None:
        """Add the outputs at t_end; ``out`` is (accumulators, members) from one step that starts there."""
        total = self.tail[:, members]
        for quantity, operation, _ in self.operations:
            rows = self.at[quantity, operation]
            if operation == "min":
                total[rows] = np.minimum(total[rows], out[rows])
            elif operation == "max":
                total[rows] = np.maximum(total[rows], out[rows])
            elif quantity == "e^2":
                total[rows] += out[rows]

    def metrics(self, simulation: Simulation, theta_hat_final: Array) -> Metrics:
        """The metrics; ``theta_hat_final`` is (n, M)."""
        at, head, tail = self.at, self.head, self.tail
        diverged = ~np.isnan(self.diverged_step)

        def magnitude(quantity: str, *parts: Array) -> Array:
            largest = [np.maximum(-part[at[quantity, "min"]], part[at[quantity, "max"]]) for part in parts]
            return np.asarray(np.max(largest, axis=0))

        def finite_only(value: Array) -> Array:
            return np.asarray(np.where(diverged, np.nan, value).T)

        tail_time = float(simulation.t_end - simulation.time(simulation.tail_start))
        with np.errstate(all="ignore"):  # a diverged member's totals may be infinite; they become NaN
            squares = head[at["e^2", "sum"]] + tail[at["e^2", "sum"]]
            of_inputs = magnitude("u", head, tail)
            rate = tail[at["variation", "sum"]] / tail_time if tail_time else np.zeros_like(theta_hat_final)
            return Metrics(
                diverged_at=simulation.time(self.diverged_step),
                max_abs_e=finite_only(magnitude("e", head, tail)),
                rms_e=finite_only(np.sqrt(squares / (simulation.steps + 1))),
                tail_max_abs_e=finite_only(magnitude("e", tail)),
                max_abs_u=finite_only(of_inputs[0] if len(of_inputs) == 1 else of_inputs),
                theta_hat_final=finite_only(theta_hat_final),
                theta_hat_tail_min=finite_only(tail[at["theta_hat", "min"]]),
                theta_hat_tail_max=finite_only(tail[at["theta_hat", "max"]]),
                theta_hat_variation_rate=finite_only(rate),
                max_abs_y=finite_only(magnitude("y", head, tail)[0]) if len(head[at["y", "min"]]) else None,
            )
