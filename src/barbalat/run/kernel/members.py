"""Members of one structure, read one after another: the data of their shared kernel, and the numbers of each member."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.judge.appended import Watched
from barbalat.loop.binding import Bindings
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import comes_from_outside, structure
from barbalat.lowering.llvm.machine import Watch
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Signal
from barbalat.run.kernel import breaks, costs, delay
from barbalat.run.kernel.attempt import Attempts
from barbalat.run.kernel.grid import window_of
from barbalat.run.kernel.observed import Observed
from barbalat.run.kernel.observer import observer_program
from barbalat.run.kernel.pieces import require_known_instants
from barbalat.run.kernel.step import LARGEST_WATCHED_STATE, PLAIN_RHYTHM, Rhythm, StepProgram, step_program, traced_once
from barbalat.run.kernel.template import Columns, Member, StructureError, Template, argument_numbers, with_grid
from barbalat.run.kernel.time_signals import TimeSignals
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class Members:
    """The kernel of M members and its data: weights and lags of the delay, history, noise streams, rhythm.

    loop     the loop of the first member; states (size, M), parameters (p, M)
    lags     (M,) for a step with a delay, see ``delay.lag``; with a tolerance, delays (M,) [s] replace them
    history  (m, M) for a step with a delay: the value of each of its m inputs before t = 0
    seeds    (M,) and numbers (M,) for a step with noise: the stream of each member
    attempts    for variable steps: attempts that are observed. The program is then that of the observer, with
                ``remembered`` stored entries
    windows  largest number of windows of the run for which the kernel of a single member keeps the monitored quantity; 0 if the
             kernel monitors nothing, as for a large loop
    """

    loop: ClosedLoop
    program: StepProgram
    states: Array
    parameters: Array
    rhythm: Rhythm
    signals: tuple[Signal, ...]
    simulation: Simulation
    numbers: Array
    lags: Array | None = None
    delays: Array | None = None
    history: Array | None = None
    seeds: Array | None = None
    longest_delay: float = 0.0  # [s]
    windows: int = 0
    problem: TrackingProblem | None = None  # the first member's
    attempts: Attempts | None = None
    observed: Observed | None = None
    remembered: int = 0

    def driven_by(self, signals: tuple[Signal, ...]) -> Members:
        """The members with these signals. With a tolerance, signals are part of the attempts."""
        if self.attempts is None or signals == self.signals:
            return self
        assert self.observed is not None
        attempts = self.attempts.driven_by(TimeSignals.of(signals))
        return replace(self, signals=signals, attempts=attempts, observed=self.observed.of_attempts(attempts))

    @classmethod
    def read(
        cls,
        members: Iterable[tuple[TrackingProblem, Controller]],
        simulation: Simulation,
        *,
        windows: int = 0,
        adjustable: bool = False,
        watched: Watched | None = None,
        first: str = "",
        taken: Callable[[int], None] | None = None,
    ) -> Members:
        """Read the members once, in order, without storing them.

        adjustable  dt, the delay's weights and the rhythm become arguments of the kernel, so one kernel serves them all. A step
                    takes 6 to 9 % longer and differs in the last bits; use it for sweeps over these quantities. Without fused
                    multiply-adds it is always set, and the members' numbers are arguments too, so no bit depends on which numbers
                    vary
        watched     the judge's quantities to be kept; None for runs without a judge
        first       the beginning of messages about the first member; other members are named by their numbers
        taken       called regularly with the number of members read so far

        Raises InputError, with the member's number, if a member can't be used or differs in structure from the first.
        """
        given = iter(members)
        one = next(given)
        try:
            reader = Reader.of(one, simulation, adjustable=adjustable, watched=watched)
        except InputError as error:
            if not first:
                raise
            raise InputError(f"{first}{error}") from error
        for i, member in enumerate(given, start=2):
            try:
                reader.add(*member)
            except StructureError:
                raise InputError(
                    f"all members must have one structure (scheme, sizes, projection, delay), but member {i} differs; an "
                    f"integer is part of the structure: write 2.0 for a number that varies"
                ) from None
            except InputError as error:
                raise InputError(f"member {i}: {error}") from error
            if taken is not None and i % TOLD_EVERY == 0:
                taken(i)
        return reader.members(windows)

    def __len__(self) -> int:
        return int(self.states.shape[1])

    def some(self, which: slice | Array) -> Members:
        """Some of the members, with the same kernel; members may be repeated."""
        return replace(
            self,
            states=self.states[:, which],
            parameters=self.parameters[:, which],
            numbers=self.numbers[which],
            lags=None if self.lags is None else self.lags[which],
            delays=None if self.delays is None else self.delays[which],
            history=None if self.history is None else self.history[:, which],
            seeds=None if self.seeds is None else self.seeds[which],
        )

    def watch(self) -> Watch | None:
        """The windows in which the kernel of one member keeps the monitored quantity; None if it keeps none."""
        steps = self.simulation.steps
        return Watch(self.program.shape.states, 0, steps + 1, window_of(steps, self.windows)) if self.windows else None


class OtherRhythmError(InputError):
    """The samples or the noise have different periods in different members."""


TOLD_EVERY = 1000
"""Number of members read between two reports of progress, which takes some hundredths of a second."""


@dataclass(eq=False)
class Reader:
    """Reads members that differ from the first only in numbers."""

    simulation: Simulation
    adjustable: bool
    problem: TrackingProblem  # data of the first member, with its controller and its loop
    controller: Controller
    loop: ClosedLoop
    rhythm: Rhythm
    bind: Bindings
    columns: Columns
    initial: Columns
    weights: Columns | None = None
    delays: list[float] = field(default_factory=list)
    lags: list[int] = field(default_factory=list)
    history: list[Array] = field(default_factory=list)
    seeds: list[int] = field(default_factory=list)
    known_delays: dict[float, tuple[int, Array]] = field(default_factory=dict)
    watched: Watched | None = None

    @classmethod
    def of(
        cls,
        first: tuple[TrackingProblem, Controller],
        simulation: Simulation,
        *,
        adjustable: bool,
        watched: Watched | None = None,
    ) -> Reader:
        problem, controller = first
        by_tolerance = simulation.tolerance is not None
        adjustable = (adjustable or not simulation.fused) and not by_tolerance
        bind = Bindings()
        loop = ClosedLoop.of(problem, controller, bind=bind)
        costs.require_states(loop)
        if by_tolerance:
            require_known_instants(loop, problem, simulation)
        rhythm = PLAIN_RHYTHM if by_tolerance else Rhythm.of(loop, problem.noise, simulation)
        initial = Columns(loop.initial())
        reader = cls(simulation, adjustable, problem, controller, loop, rhythm, bind, Columns(()), initial, watched=watched)
        weights = reader._apart(problem)
        reader.columns = Columns(Member(loop, None if adjustable else weights))
        reader.weights = None if weights is None else Columns(weights)
        return reader

    def again(self) -> Reader:
        """A reader that has read only the first member."""
        firsts = {name: getattr(self, name)[:1] for name in ("delays", "lags", "history", "seeds")}
        weights = None if self.weights is None else self.weights.again()
        columns, initial = self.columns.again(), self.initial.again()
        return replace(self, bind=Bindings(), columns=columns, initial=initial, weights=weights, known_delays={}, **firsts)

    def add(self, problem: TrackingProblem, controller: Controller) -> None:
        """Add a member; raises InputError or StructureError if it can't be combined with the first."""
        if problem.signals != self.problem.signals:
            raise InputError(f"all members must share their signals, but this one has {validate.show(problem.signals)}")
        self.take(problem, controller)

    def take(self, problem: TrackingProblem, controller: Controller, equations: Any = None) -> None:
        """Read a member with any signals, using its equations if they are already known. The errors are those of ``add``."""
        loop = ClosedLoop.of(problem, controller, bind=self.bind if equations is None else lambda _, __: equations)
        noise, first_noise = problem.noise, self.problem.noise
        if noise is not None and first_noise is not None and noise.sample_time != first_noise.sample_time:
            raise OtherRhythmError("all members must share the noise's sample time")
        if loop.sampled and loop.sample_time != self.loop.sample_time:
            raise OtherRhythmError("all members must share the controller's sample time")
        if loop.delayed != self.loop.delayed:
            raise StructureError
        weights = self._apart(problem)
        self.columns.add(Member(loop, None if self.adjustable else weights))
        self.initial.add(loop.initial())
        if self.weights is not None:
            self.weights.add(weights)

    def _apart(self, problem: TrackingProblem) -> Array | None:
        """Store what is not part of the loop; return the weights of the delay."""
        self.delays.append(problem.delay)
        if problem.noise is not None:
            self.seeds.append(problem.noise.seed)
        if not self.loop.delayed:
            return None
        self.history.append(problem.history)
        if self.simulation.tolerance is not None:
            return None
        lag, weights = self._delayed(problem.delay)
        self.lags.append(lag)
        return weights

    def _delayed(self, time: float) -> tuple[int, Array]:
        """Lag and weights of a delay [s]; many members have the same one."""
        if time not in self.known_delays:
            dt, solver = self.simulation.dt, self.simulation.solver
            self.known_delays[time] = delay.lag(time, dt), delay.weights(time, dt, solver, fused=self.simulation.fused)
        return self.known_delays[time]

    def arguments(self) -> Array:
        """(N,) which numbers of a member are passed to the kernel."""
        return argument_numbers(self.columns, opened=not self.simulation.fused)

    def chosen(self, which: Array, rounding: float = 0.0) -> Array:
        """(p, M) the numbers selected by ``which``; StructureError if members differ in other numbers by more than rounding."""
        found = self.columns.chosen(which, rounding)
        return with_grid(found, self.simulation.dt, self.weights) if self.adjustable else found

    def members(self, windows: int, *, many_delays: bool = False) -> Members:
        """The members that were read; with ``many_delays`` the delays are arguments of the kernel even if all are equal."""
        windows = windows if self.loop.size <= LARGEST_WATCHED_STATE else 0
        simulation, signals, which = self.simulation, self.problem.signals, self.arguments()
        if simulation.tolerance is not None:
            return self._by_tolerance(which)
        lags = np.array(self.lags) if self.loop.delayed else None
        how = {
            "lag_per_member": lags is not None and (many_delays or bool((lags != lags[0]).any())),
            "adjustable": self.adjustable,
            "watch": windows > 0,
            "in_pieces": not self.loop.delayed and breaks.can_be_split(signals, simulation),
            "fused": simulation.fused,
        }
        program = traced_once(self._traced_by(which, how), self.columns.first, lambda: self._trace(how))
        return self._with(
            program,
            which,
            lags=lags,
            longest_delay=max(self.known_delays, default=0.0),
            windows=windows,
        )

    def _with(self, program: StepProgram, which: Array, **more: Any) -> Members:
        return Members(
            self.loop,
            program,
            self.initial.everything(),
            self.chosen(which),
            self.rhythm,
            self.problem.signals,
            self.simulation,
            np.arange(self.columns.count),
            history=np.column_stack(self.history) if self.loop.delayed else None,
            seeds=np.array(self.seeds) if self.loop.signals.noise else None,
            problem=self.problem,
            **more,
        )

    def _by_tolerance(self, which: Array) -> Members:
        """The members that were read, with the programs of attempts with a tolerance and of their observer."""
        simulation, problem, template = self.simulation, self.problem, Template.of(self.columns, opened=not self.simulation.fused)
        loop, column, fused = template.loop, template.column, simulation.fused
        attempts, grid = Attempts(loop, TimeSignals.of(problem.signals), fused, column, self.loop), simulation.grid

        def trace() -> tuple[StepProgram, int, dict[str, Any], dict[str, Any]]:
            program, remembered = observer_program(loop, grid.dt, self.watched, fused=fused, parameters=column)
            return program, remembered, attempts.traced, Observed.of(attempts, program, grid).traced

        how = {"fused": fused}
        key = self._traced_by(which, how, grid.steps, grid.t_end, attempts.signals.formulas)
        program, remembered, traced, more = traced_once(key, (self.columns.first, problem.signals), trace)
        vars(attempts).update(traced)
        observed = Observed.of(attempts, program, grid)
        vars(observed).update(more)
        delays = np.array(self.delays) if loop.delayed else None
        return self._with(program, which, attempts=attempts, observed=observed, remembered=remembered, delays=delays)

    def _trace(self, how: dict[str, bool]) -> StepProgram:
        simulation = self.simulation
        template = Template.of(self.columns, opened=not simulation.fused)
        if self.adjustable:
            template = template.adjustable(simulation.dt, self.weights)
        dt, weights = simulation.dt if template.dt is None else template.dt, template.delay_weights
        loop, column, method, rhythm = template.loop, template.column, simulation.solver, self.rhythm
        program = step_program(loop, method, dt, column, delay_weights=weights, rhythm=rhythm, **how)
        return program if self.watched is None else program.judged(loop, self.watched, dt, column)

    def _traced_by(self, which: Array, how: dict[str, bool], *more: Hashable) -> Hashable | None:
        """Everything on which the step's program depends: the structure, and the numbers that are not arguments."""
        member: Member = self.columns.first
        if comes_from_outside(member.loop):  # a user-defined function may depend on anything
            return None
        constants = self.columns.first_numbers()[~which].tobytes()
        times = self.simulation.dt, self.rhythm.sample_every, self.rhythm.noise_hold
        taps = None if self.weights is None else self.weights.first.shape
        own = self.simulation.solver, self.watched
        return *structure(member), which.tobytes(), constants, *how.values(), times, taps, *own, *more
