"""One attempt at a step whose length follows from a tolerance, by DOP853, as operations. The time of a member is part of its
state.

Every attempt is one step of the kernel's loop, whether it succeeds or not, so parallel members have individual steps; a member
that has reached the end waits for the others. Where the equations have a jump or a corner, a step keeps the branches ("choices")
that were active when it began (``lowering.switching``). If another branch is active at its end, the step is repeated with the
length at which the change happens.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols
from barbalat.lowering.operations import Program, following, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.switching import Condition, switched
from barbalat.problem.faults import FaultSignal
from barbalat.run.kernel.limiters import SAME, Limiters, following_outputs, with_rows
from barbalat.run.kernel.metrics import DIVERGENCE_LIMIT, divergence_measure
from barbalat.run.kernel.past import SAME_INSTANT, SMOOTH_LEVEL, Ahead, DelayedInput
from barbalat.run.kernel.sampled_controller import acting_on, initial_acting, parameters_column
from barbalat.run.kernel.time_signals import TimeSignals
from barbalat.solvers.order_eight import embedded, order_eight

if TYPE_CHECKING:
    import casadi as ca

RUNNING, DIVERGED, STALLED = 0.0, 1.0, 2.0
"""A member's status. A stalled member would need a step that is too short to change its time."""
ALL, SLOPE = 1.0, 2.0
"""What is recomputed before an attempt: the choices and the slope, or only the slope if the choices changed."""
SAFETY, SHRINKS, GROWS = 0.9, 1 / 3, 6.0
"""After a failed step the next is 0.9 err^(-1/8) times as long, within these limits. After a successful step, its length is
filtered (H211b with b = 4), because the error estimate depends on the phase of an oscillation; without the filter every third
attempt fails.

Source: Soderlind, Digital filters in adaptive time-stepping, ACM Transactions on Mathematical Software 29 (2003), table 1."""
FILTERED = 0.85
"""The factor of filtered lengths: with a steady error of 0.07 each step is as long as the previous one. Among the values 0.82,
0.88 and 0.94, the last needs 20 % more attempts than the others on Section V at equal error, because one in eight fails."""
SMALL = 1e-6
"""The relative error of a state refers to at least this fraction of the largest magnitude of any state."""
TINY = 1e-9
"""The relative error also refers to at least this magnitude, in the unit of the state, so rounding errors of a state at rest are
not resolved."""
MEETS = 0.1
"""Fraction of the tolerance by which the state may move between a change of choice and the end of the step."""
JOINS = 4.0
"""Multiple of the movement of ``MEETS`` within which a rate limiter that has reached its demand follows it again."""
LEAST_ROUNDINGS = 4 * float(np.finfo(float).eps)
"""Smallest step relative to the time; a shorter step does not advance the time."""
BEYOND = 2.0
"""Multiple of the movement of ``MEETS`` beyond which a choice is certain."""
BARELY = 16 * BEYOND
"""Multiple of the movement of ``MEETS`` up to which a change of choice can't be located more closely. The search shortens a step
by up to a factor of three and would end in a step that is not certain to have changed."""
SECANTS = 4
"""Number of secant steps in the search for the time of a change of choice; after these the step is halved instead."""
LOOKS = (5, 9, 10)
"""Stages at 0.33, 0.6 and 0.86 of a step, which detect a choice that changes and returns before the end."""
NEAREST = 0.05
"""No change of choice is located before this fraction of an attempt: secants are useless for a change that has just occurred."""
LARGEST = 1e300
"""Largest finite number; margins of infinite values are not compared."""
SMOOTH, CHOICE, PIECE = 1.0, 2.0, 3.0
"""The end of a step: regular, at a choice, or at the end of its piece of the run."""
FIRST = 2
"""The position of the signals' numbers in a piece's row."""
ACTED = 6
"""Argument of ``Attempts.begin``: the new state of a sampled controller."""
MOST_TRIES = 200
"""Largest number of changes of choice at one instant; more changes mean that the motion slides along a surface."""


@dataclass(frozen=True)
class Carried:
    """The kernel's state: the loop's state (S,), followed by the data for the next attempt; J is the number of choices.

    ``leaving`` is the number of the record that is leaving the delay, and ``records`` the number of the record of this step (see
    ``past``). Attempts pause at the time ``pause`` [s], at which a piece must begin.
    """

    states: int
    choices: int

    @cached_property
    def places(self) -> dict[str, slice]:
        """The rows of each part."""
        sizes = {
            "x": self.states, "t": 1, "h": 1, "error": 1, "ratio": 1, "rejected": 1,
            "most": 1, "meets": 1, "until": 1, "tries": 1, "renew": 1, "status": 1, "piece": 1,
            "largest": self.states, "slope": self.states, "choices": self.choices, "margins": self.choices,
            "leaving": 1, "records": 1, "pause": 1,
        }  # fmt: skip
        return slices_of(sizes)

    @property
    def size(self) -> int:
        return int(self.places["pause"].stop)

    def initial(self, x: np.ndarray, h: float, most: float = np.inf) -> np.ndarray:
        """(size,) the state at t = 0, with the lengths [s] of the first and of the longest attempt; record 0 is the history of
        the delay."""
        found, at = np.zeros(self.size), self.places
        found[at["x"]], found[at["largest"]] = x, np.abs(x)
        found[at["h"]], found[at["renew"]] = h, ALL
        found[at["meets"]] = found[at["until"]] = found[at["pause"]] = np.inf
        found[at["most"]] = most
        found[at["error"]] = found[at["ratio"]] = 1.0
        found[at["records"]] = 1.0
        return found


@dataclass(frozen=True)
class Written:
    """The output of an attempt: 0 if it failed, otherwise how the step ended; t [s], h [s], the final x, and the seven
    coefficients, (S,) each, of ``dense_output``.
    """

    states: int

    @property
    def size(self) -> int:
        return 3 + 8 * self.states


@dataclass(frozen=True)
class Attempts:
    """The programs of a loop's attempts: ``begin``, if something must be recomputed, and then ``program``.

    parameters  the column of the loop's symbols, which are arguments of the kernel before the tolerance and the delay, if there
                is a delay; None without symbols
    numbered    the loop with its numbers, which determine the sampling instants; ``loop`` has symbols for some of them
    """

    loop: ClosedLoop
    signals: TimeSignals
    fused: bool = True
    parameters: Any = None
    numbered: ClosedLoop | None = None

    @property
    def sampling(self) -> ClosedLoop:
        """The loop whose sample time and shell are numbers."""
        return self.loop if self.numbered is None else self.numbered

    @cached_property
    def past(self) -> DelayedInput | None:
        """The records of a delayed input; None without a delay."""
        return DelayedInput.of(self.loop)

    @property
    def count(self) -> int:
        """Entries of a piece's row: its end, whether a controller samples at its beginning, the signals' numbers, the noise."""
        return FIRST + self.signals.numbers + self.loop.signals.noise

    @staticmethod
    def rows(ends: np.ndarray, sampled: np.ndarray, signals: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Rows of K pieces, (K, count); the last one has zero length and ends the run."""
        return np.ascontiguousarray(np.column_stack([ends, sampled, signals, noise]), dtype=float)

    def driven_by(self, signals: TimeSignals) -> Attempts:
        """These attempts with different signals. The programs are the same unless the formulas of the signals, which they
        contain, differ."""
        found = replace(self, signals=signals)
        if signals.formulas == self.signals.formulas:
            vars(found).update(self.traced)
        return found

    @cached_property
    def calls(self) -> Callable[[float], np.ndarray]:
        """See ``Around.calls``; all members of these attempts share the value."""
        assert self.sampling.around is not None
        faults = [one for one in self.signals.signals if isinstance(one, FaultSignal)]
        return cache(partial(self.sampling.around.calls, faults))

    def initial(self, x: np.ndarray, h: float, most: float = np.inf) -> np.ndarray:
        """The kernel's state at t = 0, for a loop that begins with x."""
        return self.carried.initial(x, h, most)

    @cached_property
    def _rates(self) -> ca.Function:
        """Functions of (state, parameters, signals): the slope with constant outputs of the rate limiters, the input of a delay,
        and the demands and limits of the limiters."""
        import casadi as ca

        state_column, state = symbols("state", self.loop.size)
        signal_column, signals = symbols("signals", self.loop.signal_count)
        inputs = [state_column, parameters_column(self.parameters), signal_column]
        results = [column(self.loop.following_within(np.inf).derivative(state, signals)), ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)]
        if self.past is not None:
            results[1] = column(self.loop.undelayed_input(state, signals))
        if self.loop.rate_limited:
            results[2:] = column(self.loop.demands(state, signals)), column(self.loop.rate_limits)
        return ca.Function("rates", inputs, results, {"cse": True})

    @cached_property
    def _limits(self) -> ca.Function:
        """The state after projection onto the known sets, as a function of (state, parameters)."""
        import casadi as ca

        state_column, state = symbols("state", self.loop.size)
        inputs = [state_column, parameters_column(self.parameters)]
        return ca.Function("limits", inputs, [column(self.loop.limit(state))], {"cse": True})

    @cached_property
    def carried(self) -> Carried:
        """The layout of the kernel's state."""
        import casadi as ca

        x, s, moves = (ca.SX.sym("x", n) for n in (self.loop.size, self.loop.signal_count, self.loop.signal_count))
        return Carried(self.loop.size, len(self._switched(x, Driving(s, moves), None).conditions))

    def _switched(self, x: ca.SX, driving: Driving, choices: ca.SX | None) -> _Evaluated:
        """The equations with the given choices, or with those that follow from the arguments. The conditions of the limits are
        monitored and keep their actual values."""
        import casadi as ca

        given = parameters_column(self.parameters)
        rates = switched(self._rates, [x, given, driving.values], choices)
        conditions = [*rates.conditions, *switched(self._limits, [x, given]).conditions]
        slope, entering, demands, limits = rates.values
        if not self.loop.rate_limited:
            return _Evaluated(slope, conditions, entering)
        made = ca.vertcat(ca.SX(0, 1), *(one.truth for one in rates.conditions))
        made = made if choices is None else choices[: len(rates.conditions)]
        rows = self.loop.limiter_rows
        speeds = self._speeds(x, given, driving.values, made, slope, driving.moves)
        limiters = Limiters(x[list(rows)], demands, speeds, limits)
        own = limiters.conditions(None if choices is None else choices[len(conditions) :])
        moving = ca.vertcat(*(one.truth for one in own)) if choices is None else choices[len(conditions) :]
        return _Evaluated(with_rows(slope, rows, limiters.rates(moving)), [*conditions, *own], entering, limiters)

    @cached_property
    def _speeds(self) -> ca.Function:
        """The rates of the limiters' demands as a function of (state, parameters, signals, choices, slope, signals' slopes)."""
        import casadi as ca

        sizes = self.loop.size, parameters_column(self.parameters).numel(), self.loop.signal_count
        x, given, s = (ca.SX.sym("given", size) for size in sizes)
        choices = ca.SX.sym("choices", len(switched(self._rates, [x, given, s]).conditions))
        x_moves, s_moves = ca.SX.sym("x'", sizes[0]), ca.SX.sym("s'", sizes[2])
        demands = switched(self._rates, [x, given, s], choices).values[2]
        moved = ca.jtimes(demands, ca.vertcat(x, s), ca.vertcat(x_moves, s_moves))
        return ca.Function("speeds", [x, given, s, choices, x_moves, s_moves], [ca.densify(moved)], {"cse": True})

    @cached_property
    def _signals_move(self) -> ca.Function:
        """The slopes of the signals as a function of (t, numbers of the piece)."""
        import casadi as ca

        t, numbers = ca.SX.sym("t"), ca.SX.sym("numbers", self.signals.numbers)
        return ca.Function("moves", [t, numbers], [ca.densify(ca.jacobian(self.signals.at(t, numbers), t))], {"cse": True})

    @property
    def shape(self) -> LoopShape:
        """Sizes for the kernel."""
        carried = self.carried
        written = Written(self.loop.size).size
        renew, piece, leaving, own = (carried.places[name].start for name in ("renew", "piece", "leaving", "records"))
        given = 1 + parameters_column(self.parameters).numel() + (self.past is not None)
        recalled = None if self.past is None else self.past.recalled(leaving, own)
        rows = {"sample_row": renew, "signal_row": piece, "recalled": recalled}
        return LoopShape(carried.size, written, given, self.count, sample_every=1, **rows)

    @property
    def traced(self) -> dict[str, Any]:
        """The parts that take time to trace, by their attributes' names."""
        return {"carried": self.carried, "lists": self.lists}

    @cached_property
    def lists(self) -> tuple[Program, Program]:
        """An attempt with its dense output, and the program that recomputes its inputs beforehand."""
        return self.program(), self.begin()

    def begin(self) -> Program:
        """Recompute choices and slope if a piece of the run begins or the last step ended at a change of choice."""
        import casadi as ca

        parts, numbers, tolerance, inputs = self._inputs()
        t, renew = parts["t"], parts["renew"]
        everything = renew == ALL
        acted = ca.SX.sym("acted", self._own)
        due = ca.logic_and(everything, ca.logic_and(numbers[1], t <= numbers[FIRST]))
        x = parts["x"]
        if self._own:
            x = ca.if_else(due, ca.vertcat(x[: -self._own], acted), x)
        s = self._driven(t, numbers)
        found = self._switched(x, s, None)
        if found.limiters is not None:
            x = ca.if_else(renew != 0, self._joined(x, found.limiters, parts, tolerance), x)
            found = self._switched(x, s, None)
        conditions = found.conditions
        given = self._switched(x, s, parts["choices"]).conditions  # after the change, some condition may have no choice left,
        old, chosen = ca.vertsplit(parts["choices"]), []
        for one, now, before, was in zip(conditions, given, old, ca.vertsplit(parts["margins"]), strict=True):
            open_now = ca.logic_or(ca.fabs(now.margin) == np.inf, ca.fabs(was) == np.inf)  # or had no margin
            chosen.append(ca.if_else(everything, one.truth, ca.if_else(ca.logic_and(renew != 0, open_now), now.truth, before)))
        choices = ca.vertcat(ca.SX(0, 1), *chosen)
        after = self._switched(x, s, choices)
        margins = ca.vertcat(ca.SX(0, 1), *(one.margin for one in after.conditions))
        new = {
            "x": x,
            "largest": ca.fmax(parts["largest"], ca.fabs(x)),
            "slope": ca.if_else(renew != 0, after.slope, parts["slope"]),
            "choices": choices,
            "margins": ca.if_else(renew != 0, margins, parts["margins"]),
            "renew": ca.SX(0.0),
        }
        return self._behind_a_sample(self._lowered("begin", [*inputs, acted], [self._packed(parts | new)]))

    def _joined(self, x: ca.SX, limiters: Limiters, parts: dict[str, ca.SX], tolerance: ca.SX) -> ca.SX:
        """The state in which the output of each limiter that has reached its demand, within the tolerance of the step, is set to
        that demand."""
        rows, scale = self.loop.limiter_rows, _scale(parts["largest"], tolerance)
        return with_rows(x, rows, limiters.joined(JOINS * MEETS * scale[list(rows)]))

    @property
    def _own(self) -> int:
        """Number of entries of a sampled controller's state, which come last in the state of the loop."""
        return len(flatten(initial_acting(self.loop))) if self.loop.sampled else 0

    def _behind_a_sample(self, begin: Program) -> Program:
        """``begin`` preceded by the operations of the controller, which are the same as with fixed steps."""
        import casadi as ca

        if not self.loop.sampled:
            return begin
        parts, numbers, _, inputs = self._inputs()
        driving = self._driven(parts["t"], numbers).values
        state, signals = (ca.array(value).reshape(-1) for value in (parts["x"], driving))
        y, r = self.loop.sampled_at(state, signals)
        faults = [] if self.loop.around is None else [column(self.loop.signals.named(signals).faults)]
        handed = optimize(read(ca.Function("handed", inputs, [parts["x"], column(y), column(r), *faults])), fused=False)
        operations, acted = acting_on(handed, self.loop, self.parameters)
        return following(operations, begin, {(ACTED, i): place for i, place in enumerate(acted)})

    def _packed(self, parts: dict[str, ca.SX]) -> ca.SX:
        import casadi as ca

        return ca.vertcat(*(parts[name] for name in self.carried.places))

    def _inputs(self) -> tuple[dict[str, ca.SX], ca.SX, ca.SX, list[ca.SX]]:
        """The carried state by its parts, the row of numbers (those of the current piece, the delay, the number of known records
        and these records), the tolerance, and all inputs."""
        import casadi as ca

        carried = self.carried
        given, numbers, tolerance = (ca.SX.sym(*one) for one in (("state", carried.size), ("row", self.count), ("tolerance", 1)))
        parts = {name: given[rows] for name, rows in carried.places.items()}
        nothing = ca.SX(0, 1)
        written = ca.SX.sym("written", Written(self.loop.size).size)
        arguments = ca.vertcat(parameters_column(self.parameters), tolerance)
        if self.past is None:
            return parts, numbers, tolerance, [given, written, arguments, numbers, nothing, nothing]
        recalled = self.shape.recalled
        assert recalled is not None
        delay, records = ca.SX.sym("delay"), ca.SX.sym("records", recalled.records * recalled.width)
        driven = ca.vertcat(numbers, delay, parts["records"] - parts["leaving"], records)
        return parts, driven, tolerance, [given, written, ca.vertcat(arguments, delay), numbers, records, nothing]

    def _delay(self, numbers: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The delay [s], the number of known records, and the records, from ``_inputs``."""
        return numbers[self.count], numbers[self.count + 1], numbers[self.count + 2 :]

    def _lowered(self, name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> Program:
        import casadi as ca

        return optimize(read(ca.Function(name, inputs, outputs, {"cse": True})), fused=self.fused)

    def program(self, *, dense: bool = True) -> Program:
        """One attempt; without ``dense`` it writes no coefficients and saves three evaluations."""
        import casadi as ca

        parts, numbers, tolerance, inputs = self._inputs()
        x, t, status = parts["x"], parts["t"], parts["status"]
        t_stop = numbers[0]
        running = ca.logic_and(status == RUNNING, ca.logic_and(t < t_stop, t < parts["pause"]))
        ahead = None if self.past is None else self.past.ahead(*self._delay(numbers))
        h, t_new, cut = _length(parts, t_stop, ahead)
        stages, x_new, inside = self._stages(parts, numbers, h, t_new)
        largest = ca.fmax(parts["largest"], ca.fabs(x_new))
        scale = _scale(largest, tolerance)
        error = _error(stages, scale, h)
        good = error <= 1
        found = self._meeting(parts, numbers, x_new, t_new, stages[0], scale, h, inside)
        kept = self._limits(x_new, parameters_column(self.parameters))
        if self.loop.rate_limited:
            kept = self._following(kept, numbers, t_new, parts["choices"])
        measure = divergence_measure(self.loop, self._outputs(kept, numbers, t_new), ca.array(kept).reshape(-1))
        sound = ca.SX(column(np.reshape(np.where(measure <= DIVERGENCE_LIMIT, 1.0, 0.0), 1)))
        fits = ca.logic_and(running, ca.logic_and(good, ca.logic_and(found.ready, sound)))
        choosing = ca.logic_and(running, ca.logic_and(good, ca.logic_not(found.ready)))
        ends = ca.logic_and(fits, found.due)  # at a choice
        arrives = ca.logic_and(fits, t_new >= t_stop)
        passes = ca.SX(0.0) if ahead is None else ca.logic_and(fits, ahead.meets <= t_new * (1 + SAME_INSTANT))
        new = _next(parts, h, error, running, fits, choosing, ends, cut, found, t)
        stuck = ca.logic_or(ca.logic_and(ca.logic_not(good), h <= LEAST_ROUNDINGS * ca.fabs(t)), new["tries"] > MOST_TRIES)
        lost = ca.logic_and(good, ca.logic_not(sound))
        new["status"] = ca.if_else(running, ca.if_else(lost, DIVERGED, ca.if_else(stuck, STALLED, RUNNING)), status)
        new |= {
            "x": ca.if_else(fits, kept, x),
            "t": ca.if_else(fits, t_new, t),
            "piece": parts["piece"] + arrives,
            "renew": ca.if_else(ca.logic_or(arrives, passes), ALL, new["renew"]),
            "largest": ca.if_else(fits, ca.fmax(parts["largest"], ca.fabs(kept)), parts["largest"]),
            "slope": ca.if_else(fits, stages[12], parts["slope"]),
            "margins": ca.if_else(fits, found.margins, parts["margins"]) if self.carried.choices else parts["margins"],
        }
        more = _dense(self._more(stages, parts, numbers, h), x, x_new, h)
        coefficients = more if dense else ca.SX(7 * self.loop.size, 1)
        step = ca.if_else(fits, ca.if_else(arrives, PIECE, ca.if_else(ca.logic_or(ends, passes), CHOICE, SMOOTH)), 0.0)
        written, record = ca.vertcat(step, t, h, x, coefficients), ca.SX(0, 1)
        if self.past is not None and ahead is not None:
            left = self.past.left(t_new, *self._delay(numbers))
            new |= {
                "leaving": parts["leaving"] + ca.if_else(fits, left, 0.0),
                "records": parts["records"] + ca.if_else(fits, 1.0, 0.0),
            }
            again = SMOOTH_LEVEL if self.past.held else ca.if_else(passes, ahead.level + 1, SMOOTH_LEVEL)
            level = ca.if_else(ca.logic_or(arrives, ends), 0.0, again)
            record = self._record(parts, numbers, x_new, t_new, h, level, more)
        return self._lowered("attempt", inputs, [self._packed(parts | new), ca.SX(ca.densify(written)), record])

    def _record(
        self, parts: dict[str, ca.SX], numbers: ca.SX, x_new: ca.SX, t_new: ca.SX, h: ca.SX, level: ca.SX, more: ca.SX
    ) -> ca.SX:
        """The record that the step leaves; ``more`` contains the coefficients of its dense output."""
        import casadi as ca

        assert self.past is not None
        values = []
        for share in self.past.places:
            t = parts["t"] + share * h if share < 1 else t_new
            x = x_new if share == 1 else dense_at(parts["x"], more, share) if share else parts["x"]
            # the delay's input does not depend on its output at the same time
            driving = self._driving(t, numbers, ca.SX.zeros(self.past.inputs))
            values.append(self._switched(x, driving, parts["choices"]).entering)
        return self.past.record(parts["t"], t_new, level, values)

    def _following(self, x: ca.SX, numbers: ca.SX, t: ca.SX, choices: ca.SX) -> ca.SX:
        """The state in which the outputs of inactive rate limiters equal their demands."""
        limiters, rows = self._switched(x, self._driven(t, numbers), choices).limiters, self.loop.limiter_rows
        assert limiters is not None
        return with_rows(x, rows, following_outputs(limiters.demands, limiters.outputs, choices[-2 * len(rows) :]))

    def _outputs(self, x: ca.SX, numbers: ca.SX, t: ca.SX) -> Any:
        import casadi as ca

        return self.loop.outputs(ca.array(x).reshape(-1), ca.array(self._driven(t, numbers).values).reshape(-1))

    def _driven(self, t: ca.SX, numbers: ca.SX) -> Driving:
        """The signals of the loop at t, from the row of its piece and the records."""
        return self._driving(t, numbers, None if self.past is None else self.past.leaving(t, *self._delay(numbers)))

    def _driving(self, t: ca.SX, numbers: ca.SX, leaving: ca.SX | None) -> Driving:
        """The signals of the loop at t, including the output of the delay, on which no rate limiter's demand depends
        directly."""
        import casadi as ca

        timed = self.timed(t, numbers)
        values = timed if leaving is None else ca.vertcat(timed, leaving)
        if not self.loop.rate_limited:
            return Driving(values, ca.SX(0, 1))
        moves = self._signals_move(t, numbers[FIRST : FIRST + self.signals.numbers])
        return Driving(values, ca.vertcat(moves, ca.SX.zeros(values.numel() - moves.numel())))

    def timed(self, t: ca.SX, numbers: ca.SX) -> ca.SX:
        """The signals of the loop at t without the output of a delay."""
        import casadi as ca

        first = FIRST + self.signals.numbers
        return ca.vertcat(self.signals.at(t, numbers[FIRST:first]), numbers[first : self.count])

    def _slope(self, x: ca.SX, numbers: ca.SX, t: ca.SX, choices: ca.SX) -> ca.SX:
        return self._switched(x, self._driven(t, numbers), choices).slope

    def _stages(
        self, parts: dict[str, ca.SX], numbers: ca.SX, h: ca.SX, t_new: ca.SX
    ) -> tuple[list[ca.SX], ca.SX, list[tuple[float, list[Any]]]]:
        """The thirteen slopes, the state at the end, and the conditions inside the step, each with its position."""
        formula, x, t, choices = order_eight(), parts["x"], parts["t"], parts["choices"]
        slopes, inside = [parts["slope"]], []
        for i, (row, node) in enumerate(zip(formula.a[1:], formula.c[1:], strict=True), start=1):
            at = t + node * h if node < 1 else t_new
            found = self._switched(x + h * _weighted(row, slopes), self._driven(at, numbers), choices)
            slopes.append(found.slope)
            if i in LOOKS:
                inside.append((node, found.conditions))
        x_new = x + h * _weighted(formula.b, slopes)
        slopes.append(self._slope(x_new, numbers, t_new, choices))
        return slopes, x_new, inside

    def _more(self, slopes: list[ca.SX], parts: dict[str, ca.SX], numbers: ca.SX, h: ca.SX) -> list[ca.SX]:
        """The stages and the three slopes of the dense output."""
        found, x, t = list(slopes), parts["x"], parts["t"]
        for row, node in zip(embedded().more_a, embedded().more_c, strict=True):
            at = x + h * _weighted(row[: len(found)], found)
            found.append(self._slope(at, numbers, t + node * h, parts["choices"]))
        return found

    def _meeting(
        self, parts: dict[str, ca.SX], numbers: ca.SX, x: ca.SX, t: ca.SX, slope: ca.SX, scale: ca.SX, h: ca.SX,
        inside: list[tuple[float, list[Any]]],
    ) -> _Meeting:  # fmt: skip
        """Find out whether a step changes a choice, at its end or at one of its stages, and where."""
        import casadi as ca

        s = self._driven(t, numbers)
        conditions = self._switched(x, s, parts["choices"]).conditions
        if not conditions:
            no, yes = ca.SX(0.0), ca.SX(1.0)
            return _Meeting(no, yes, ca.SX(np.inf), no, ca.SX(0, 1), ca.SX(0, 1), no)
        old = ca.vertsplit(parts["choices"])
        before = ca.vertsplit(parts["margins"])
        place, moved, first_try = [], [], parts["tries"] == 0
        seen, barely = [ca.SX(0.0)] * len(inside), ca.SX(1.0)
        for i, (one, chosen, was) in enumerate(zip(conditions, old, before, strict=True)):
            least = ca.fmin(SAME * one.size, LARGEST)  # of the switching quantity; infinite margins are excluded
            way = 1 - 2 * chosen  # a margin times this is positive if it has changed sides
            at_start = ca.logic_and(first_try, ca.fabs(was) <= least)
            there = [way * conditions_there[i].margin > BEYOND * least for _, conditions_there in inside]
            other = way * one.margin > BEYOND * least
            seen = [
                ca.logic_or(old_seen, ca.logic_and(now, ca.logic_not(at_start)))
                for old_seen, now in zip(seen, there, strict=True)
            ]
            share = was / (was - one.margin)
            share = ca.if_else(ca.logic_and(share > 0, share < 1), ca.fmax(share, NEAREST), 0.5)
            place.append(ca.if_else(other, ca.if_else(at_start, np.inf, share), np.inf))
            moved.append(ca.logic_and(at_start, ca.logic_or(other, there[0])))
            for margin in (one.margin, *(conditions_there[i].margin for _, conditions_there in inside)):
                barely = ca.logic_and(barely, ca.logic_not(way * margin > BARELY * least))
        earlier = ca.SX(np.inf)
        for (node, _), found_there in zip(reversed(inside), reversed(seen), strict=True):
            earlier = ca.if_else(found_there, node, earlier)
        at_once = ca.mmax(ca.vertcat(*moved)) > 0  # it had already changed when the step began
        first = ca.fmin(ca.mmin(ca.vertcat(*place)), earlier)
        due = ca.if_else(ca.logic_or(at_once, first < np.inf), 1.0, 0.0)
        near = MEETS / ca.fmax(ca.mmax(ca.fabs(slope) / scale), 1e-300)
        near = ca.fmax(near, LEAST_ROUNDINGS * ca.fabs(t))
        close = ca.logic_or(ca.logic_or(ca.logic_and((1 - first) * h <= near, earlier > 1), h <= near), barely)
        ready = ca.logic_or(ca.logic_not(due), ca.logic_and(close, ca.logic_not(at_once)))
        aim = first * h + 0.3 * near
        margins = ca.vertcat(*(one.margin for one in conditions))
        return _Meeting(due, ready, aim, at_once, margins, ca.vertcat(*moved), earlier <= 1)


class Driving(NamedTuple):
    """The signals of a loop, and their rates if a rate limiter needs them."""

    values: ca.SX
    moves: ca.SX


class _Evaluated(NamedTuple):
    """The equations at one instant.

    entering  the input of the delay, if there is a delay
    limiters  the rate limiters, if any
    """

    slope: ca.SX
    conditions: list[Condition]
    entering: ca.SX
    limiters: Limiters | None = None


@dataclass(frozen=True)
class _Meeting:
    """The crossing at the end of an attempt.

    due      whether any choice has changed
    ready    whether the attempt need not be repeated
    aim      the estimated length [s] at which the choice changes
    at_once  whether the choice had already changed when the step began; then the choices ``flipped`` (J,) are changed without a
             step
    margins  (J,) at the end
    inside   whether ``aim`` is the position of a stage at which a choice had already changed
    """

    due: Any
    ready: Any
    aim: Any
    at_once: Any
    margins: Any
    flipped: Any
    inside: Any


def slices_of(sizes: Mapping[str, int], start: int = 0) -> dict[str, slice]:
    """The rows of consecutive parts of these sizes, from row ``start`` on."""
    ends = np.cumsum([start, *sizes.values()]).tolist()
    return {name: slice(*pair) for name, pair in zip(sizes, pairwise(ends), strict=True)}


def _scale(largest: ca.SX, tolerance: ca.SX) -> ca.SX:
    """The admissible error of each state."""
    import casadi as ca

    return tolerance * ca.fmax(largest, ca.fmax(SMALL * ca.mmax(largest), TINY))


def _length(parts: dict[str, ca.SX], t_stop: ca.SX, ahead: Ahead | None) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The attempt's length, the time at its end, and whether a limit other than the error has shortened it.

    t_stop  the end of the current piece of the run [s]
    """
    import casadi as ca

    t, own = parts["t"], parts["h"]
    free = ca.fmin(ca.fmin(own, parts["most"]), ca.fmin(parts["meets"], parts["until"] - t))
    if ahead is not None:
        together = ca.fabs(ahead.meets - t_stop) <= SAME_INSTANT * t_stop
        t_stop = ca.if_else(together, t_stop, ca.fmin(t_stop, ahead.meets))
        free = ca.fmin(free, ahead.most - t)
    rest = t_stop - t
    last = free * (1 + 1e-6) >= rest
    h = ca.if_else(last, rest, ca.fmin(free, ca.if_else(2 * free > rest, 0.5 * rest, free)))
    return h, ca.if_else(last, t_stop, t + h), h < own


def _error(slopes: list[ca.SX], scale: ca.SX, h: ca.SX) -> ca.SX:
    """The error estimate of DOP853 as a multiple of the admissible error."""
    import casadi as ca

    def squares(weights: tuple[float, ...]) -> ca.SX:
        return ca.sumsqr(_weighted(weights, slopes) / scale)

    fifth, third = squares(embedded().error_5), squares(embedded().error_3)
    both = fifth + 0.01 * third
    return ca.if_else(both == 0, 0.0, h * fifth / ca.sqrt(both * scale.numel()))


def _next(
    parts: dict[str, ca.SX], h: ca.SX, error: ca.SX, running: ca.SX, fits: ca.SX, choosing: ca.SX, ends: ca.SX, cut: ca.SX,
    found: _Meeting, t: ca.SX,
) -> dict[str, ca.SX]:  # fmt: skip
    """Lengths, tries and recomputed data for the next attempt."""
    import casadi as ca

    bounded = ca.fmax(error, 1e-12)
    factor = ca.if_else(error < np.inf, ca.fmax(SAFETY / _root(bounded, 3), SHRINKS), SHRINKS)
    filtered = FILTERED / (_root(bounded * parts["error"], 5) * _root(parts["ratio"], 2))
    filtered = ca.fmin(ca.fmax(filtered, SHRINKS), ca.if_else(parts["rejected"], 1.0, GROWS))
    grown = ca.if_else(cut, ca.fmax(h * filtered, parts["h"]), h * filtered)
    smaller = h * ca.fmin(factor, SAFETY)
    failed = ca.logic_and(running, ca.logic_not(ca.logic_or(fits, choosing)))
    waits = ca.logic_or(ends, ca.logic_and(choosing, found.at_once))
    tries = parts["tries"]
    aim = ca.if_else(
        ca.logic_and(tries >= 1, ca.logic_not(found.inside)), ca.fmax(2 * found.aim - h, 0.5 * h), found.aim
    )  # to the left of it, from which the next secant step is exact
    aim = ca.if_else(tries >= SECANTS, ca.fmin(0.5 * h, aim), aim)
    inside = ca.logic_and(choosing, ca.logic_not(found.at_once))
    choices = parts["choices"]
    flipped = ca.if_else(ca.logic_and(choosing, found.at_once), found.flipped, 0 * choices) if choices.numel() else choices
    return {
        "h": ca.if_else(fits, grown, ca.if_else(failed, smaller, parts["h"])),
        "rejected": ca.if_else(running, ca.if_else(failed, 1.0, 0.0), parts["rejected"]),
        "meets": ca.if_else(inside, aim, ca.if_else(running, np.inf, parts["meets"])),
        "until": ca.if_else(
            ca.logic_or(waits, ca.logic_and(fits, t + h >= parts["until"])), np.inf, ca.if_else(inside, t + h, parts["until"])
        ),
        "error": ca.if_else(fits, bounded, parts["error"]),
        "ratio": ca.if_else(ca.logic_and(fits, ca.logic_not(cut)), filtered, ca.if_else(failed, 1.0, parts["ratio"])),
        "tries": ca.if_else(choosing, tries + 1, ca.if_else(fits, 0.0, tries)),
        "renew": ca.if_else(ends, ALL, ca.if_else(ca.logic_and(choosing, found.at_once), SLOPE, parts["renew"])),
        "choices": ca.if_else(flipped, 1 - choices, choices) if choices.numel() else choices,
    }


def _root(value: ca.SX, times: int) -> ca.SX:
    """Repeated square roots, which are exactly rounded, so the result is bit-identical on every machine."""
    import casadi as ca

    for _ in range(times):
        value = ca.sqrt(value)
    return value


def _weighted(weights: tuple[float, ...], slopes: list[ca.SX]) -> ca.SX:
    """The sum of the slopes with these weights."""
    first, *others = [weight * slope for weight, slope in zip(weights, slopes, strict=True) if weight]
    return sum(others, first)


def _dense(slopes: list[ca.SX], x: ca.SX, x_new: ca.SX, h: ca.SX) -> ca.SX:
    """The seven coefficients, (7 S,), of the polynomial of ``dense_output``, from all sixteen slopes."""
    import casadi as ca

    moved = x_new - x
    rows = [moved, h * slopes[0] - moved, 2 * moved - h * (slopes[12] + slopes[0])]
    return ca.vertcat(*rows, *(h * _weighted(row, slopes) for row in embedded().dense))


def dense_at(x: ca.SX, coefficients: ca.SX, share: float | ca.SX) -> ca.SX:
    """The states at this fraction of a step, from x at its beginning and the coefficients of its dense output."""
    states, value = x.numel(), 0 * x
    for i in range(7):
        row = coefficients[(6 - i) * states : (7 - i) * states]
        value = (value + row) * (share if i % 2 == 0 else 1 - share)
    return value + x


def dense_output(written: np.ndarray, states: int, share: np.ndarray) -> np.ndarray:
    """The states (K, S) at these fractions (K,) of the steps in K rows of ``written``.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.6.
    """
    x, rows = written[:, 3 : 3 + states], written[:, 3 + states :].reshape(len(written), 7, states)
    found, s = np.zeros_like(x), share[:, None]
    for i in range(7):
        found = (found + rows[:, 6 - i]) * (s if i % 2 == 0 else 1 - s)
    return np.asarray(found + x)
