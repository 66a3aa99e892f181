"""The contents of an exported controller before printing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.export.acceptance import Condition, Norm, Order, numbers, placed
from barbalat.export.evaluation import Inputs, evaluate
from barbalat.export.layout import Layout
from barbalat.export.parameters import Opened, Parameter, estimate_limits
from barbalat.loop.around import LOST, Around
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten, unflatten
from barbalat.loop.sampling import Acting
from barbalat.lowering.c99 import DOUBLE, Real
from barbalat.lowering.operations import Operation, Program, sliced, sources
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, DiscretizedEquations, SampledEquations
from barbalat.run.engine.simulate import Recording, largest_numbers, recorded
from barbalat.run.kernel.sampled_controller import (
    COMMAND,
    FREEZE,
    MEASURED,
    PARAMETER,
    STATE,
    SampledList,
    controller_program,
    initial_acting,
)
from barbalat.solvers.simulation import Simulation
from barbalat.targets import require_sampled
from barbalat.validate import Array, InputError

VECTORS = 1000
"""Number of samples that the self-test of an export replays; about 100 kB of C for a small controller."""
FEWEST_VECTORS = 10
"""Least number of samples: the self-test lets the ninth sample be rejected and continues with the next one."""
LEAST_RANGE = 1e6
"""Range of a state or an input, unless the simulation requires a larger one."""
PARAMETER_FACTOR = 1e3
"""Smallest admissible ratio of a parameter to the largest parameter of the case."""
MOST_PARAMETER = 1e36
"""Largest size of a number of 32 bits."""
RANGE_FACTOR = 10.0
"""Ratio of the stated range to the largest number in the simulation."""


@dataclass(frozen=True, eq=False)
class Contents:
    """One sampled controller of one problem, prepared for export.

    program  the whole operation list of the controller, as the simulation runs it
    layout   the parts of its state that the export keeps
    vectors  samples of the simulation that must be reproduced bit for bit
    largest  the largest number of the state, of the measurement and of the command in the whole run, including the run with the
             faults of the case
    opened   the numbers of the list that are parameters; None if all are compiled in
    around   the shell of the case, which is not part of the list; None without a shell
    """

    problem: TrackingProblem
    controller: Controller
    loop: ClosedLoop
    program: Program
    layout: Layout
    vectors: Recording
    largest: float
    real: Real = DOUBLE
    opened: Opened | None = None
    around: Around | None = None

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, real: Real, *, opened: Opened | None = None
    ) -> Contents:
        """Raise InputError for a continuous controller, and for a controller that diverges before the vectors end."""
        surrounded, problem = problem, problem.nominal
        loop = ClosedLoop.of(problem, controller)
        require_sampled(controller.name, sampled=loop.sampled)
        around = Around.of_shell(surrounded, loop.sample_time)
        if opened is None and not simulation.fused:  # the list has a symbol for each number, and rounds differently
            opened = Opened.of(problem, controller, simulation, tunable=False)
        program = controller_program(loop) if opened is None else controller_program(opened.template.loop, opened.template.column)
        vectors = recorded(problem, controller, simulation, VECTORS)
        if not all(np.isfinite(part).all() for part in (vectors.measured, vectors.commands, vectors.states)):
            raise InputError(
                f"{controller.name} diverges on this case within {len(vectors.states)} "
                "samples: an export would have no test vectors, and it should not be flown"
            )
        if around is not None:
            measured, commands = (part.astype(real.numbers).astype(float) for part in (vectors.measured, vectors.commands))
            around.require_taken(measured, commands, surrounded)  # rounded as in the export: settled outputs may repeat
        layout, kept = Layout.of(program, loop), largest_numbers(surrounded, controller, simulation)
        of_shell = kept[vectors.states.shape[1] :]
        parts = vectors.states[:, layout.rows], vectors.measured, vectors.commands, kept[layout.rows], of_shell
        largest = max(float(np.abs(part).max(initial=0.0)) for part in parts)
        made = cls(problem, controller, loop, program, layout, vectors, largest, real, opened, around)
        if len(vectors.states) < FEWEST_VECTORS:
            raise InputError(
                f"the self-test of an export needs {FEWEST_VECTORS} samples, but this simulation has only "
                f"{len(vectors.states)}: set t_end to at least {FEWEST_VECTORS * made.sample_time:g} s"
            )
        return made if real is DOUBLE else made.replayed()

    @cached_property
    def step(self) -> Program:
        """The slice of the simulated list that computes everything that is kept from one sample to the next."""
        return self._with_each_parameter_once(sliced(self.program, self.layout.rows))

    def _with_each_parameter_once(self, program: Program) -> Program:
        """The program in which a parameter that occurs several times in the equations is read only from its first place."""
        if self.opened is None:
            return program
        first: dict[int, int] = {}
        places = [at if k is None else first.setdefault(k, at) for at, k in enumerate(self.opened.feeds)]

        def placed(op: Operation) -> Operation:
            is_one = op.name == "input" and op.source[0] == PARAMETER
            return op._replace(source=(PARAMETER, places[op.source[1]])) if is_one else op

        return Program(tuple(map(placed, program.operations)), program.outputs)

    @property
    def sample_time(self) -> float:
        """The time between two calls of the exported step [s]."""
        assert self.loop.sample_time is not None
        return self.loop.sample_time

    @property
    def measures_state(self) -> bool:
        """Whether a start receives a measurement that determines the state, directly or by an observer."""
        return self.loop.measured_outputs == 0

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Numbers of entries of the measurement, the command, the control and the estimates."""
        y = self.vectors.measured.shape[1]
        return y, self.vectors.commands.shape[1], self.layout.u.size, self.layout.theta_hat.size

    @cached_property
    def initial(self) -> Array:
        """The flat state before the first sample."""
        return np.asarray(flatten(initial_acting(self.loop)), dtype=float)

    @cached_property
    def range(self) -> float:
        """The limit, a power of ten, beyond which entries of the state, of the measurement or of the command are rejected."""
        return float(max(LEAST_RANGE, 10.0 ** np.ceil(np.log10(max(RANGE_FACTOR * self.largest, 1.0)))))

    @cached_property
    def limits(self) -> tuple[Array, Array] | None:
        """The smallest and the largest value of each estimate in the set onto which it is projected; infinite without a set."""
        return estimate_limits(self.loop)

    @property
    def checked_limits(self) -> tuple[Array, Array] | None:
        """``limits`` without those that are parameters. The law returns a state beyond such limits to the set, so such a state is
        not rejected."""
        if self.limits is None or self.opened is None:
            return self.limits
        (low, high), (low_is_open, high_is_open) = self.limits, self.opened.open_limits
        return np.where(low_is_open, -np.inf, low), np.where(high_is_open, np.inf, high)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters on which this controller depends."""
        if self.opened is None:
            return ()
        used = self._read | set(self._all_starts.values())
        return tuple(
            one for k, one in enumerate(self.opened.parameters) if k in used or (one.limit and self.saturation is not None)
        )

    @property
    def read_parameters(self) -> tuple[Parameter, ...]:
        """The parameters that an operation reads or that limit the control; the others are initial values of states."""
        every = () if self.opened is None else enumerate(self.opened.parameters)
        return tuple(one for k, one in every if k in self._read or (one.limit and self.saturation is not None))

    @cached_property
    def _read(self) -> set[int | None]:
        assert self.opened is not None
        return {self.opened.feeds[at] for kind, at in sources(self.step) if kind == PARAMETER}

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions of the case on these parameters, by parameter index."""
        if self.opened is None:
            return ()
        place, every = {one: i for i, one in enumerate(self.parameters)}, self.opened.parameters
        return placed(self.opened.conditions, lambda k: place.get(every[k], every[k].value))

    def takes(self, given: Array) -> Array:
        """(K,) whether columns of parameters, (P, K), satisfy all conditions."""
        good: Array = (np.abs(given) <= self.parameter_range).all(axis=0)
        for condition in self.conditions:
            good &= condition.holds(given)
        return good

    def bounds(self, i: int) -> tuple[float, float]:
        """The smallest and the largest admissible value of the i-th parameter, over all values of the others."""
        low, high = -np.inf, np.inf
        for condition in self.conditions:
            if numbers(condition) != {i}:
                continue
            first, last = (self.real.numbers(end) for end in condition.around(i, np.zeros(0)))
            strict = isinstance(condition, Order) and condition.strict
            if np.isfinite(first):
                low = max(low, float(np.nextafter(first, last) if strict else first))
            if np.isfinite(last):
                high = min(high, float(np.nextafter(last, first) if strict else last))
        return low, high

    @cached_property
    def parameter_range(self) -> float:
        """The largest admissible magnitude of a parameter: a power of ten."""
        largest = max((abs(one.value) for one in self.parameters), default=0.0)
        found = 10.0 ** np.ceil(np.log10(max(LEAST_RANGE, PARAMETER_FACTOR * largest)))
        most = np.sqrt(MOST_PARAMETER) if any(isinstance(one, Norm) for one in self.conditions) else MOST_PARAMETER
        return float(min(found, most))  # the test of a norm squares it

    @cached_property
    def starts(self) -> dict[int, Parameter]:
        """The entries of the flat state whose initial value is a parameter."""
        return {} if self.opened is None else {row: self.opened.parameters[k] for row, k in self._all_starts.items()}

    @cached_property
    def _all_starts(self) -> dict[int, int]:
        assert self.opened is not None
        first = self.loop.size - len(self.initial)  # the controller's state comes last in the state of the loop
        return {row - first: k for row, k in self.opened.starts.items() if row - first in set(self.layout.rows)}

    def fed(self, entry: int) -> Parameter | float:
        """The source of an entry of the list's third argument: a parameter, or a fixed number."""
        assert self.opened is not None
        k = self.opened.feeds[entry]
        return float(self.opened.values[entry]) if k is None else self.opened.parameters[k]

    @property
    def saturation(self) -> Array | None:
        """(2, m) lower and upper limits of the actuators, infinite without a limit; None if no actuator has limits."""
        given = [path.saturation for path in self.problem.plant.paths]
        if all(limits is None for limits in given):
            return None
        return np.array([(-np.inf, np.inf) if limits is None else limits for limits in given]).T

    @cached_property
    def learnt(self) -> frozenset[int]:
        """Rows of the flat state that keep their values while the freeze switch is on, whatever the measurements."""
        computer, random = self.loop.computer, np.random.default_rng(0)
        assert computer is not None
        template, resting = initial_acting(self.loop), np.ones(len(self.initial), dtype=bool)
        for _ in range(PROBED_STATES):
            moved = self.initial + random.uniform(0.1, 1.0, len(self.initial))
            acting: Acting = unflatten(template, moved, 0)[0]
            y, r = acting.held.measured + random.uniform(0.1, 1.0), acting.held.r + random.uniform(0.1, 1.0)
            with np.errstate(all="ignore"):
                after = np.asarray(flatten(computer.act(acting, y, r, np.ones(()))), dtype=float)
            resting &= after == moved
        own = len(flatten(template.controller))
        return frozenset(np.flatnonzero(resting[:own]).tolist())

    @cached_property
    def at_start(self) -> tuple[Array, Array]:
        """(S,) and (S, n): the initial state is the vector plus the matrix times the measured state. Rows of the matrix are zero
        for entries that are not copied from the state."""
        own = np.zeros((len(self.initial), self.sizes[0]))
        if not isinstance(self.problem, Problem):
            return self.initial, own
        rest = self._starting_at(np.zeros(self.sizes[0]))
        for i, unit in enumerate(np.eye(self.sizes[0])):
            own[:, i] = self._starting_at(unit) - rest
        own[list(self.layout.measured.rows)] = np.eye(self.sizes[0])
        return rest, own

    def _starting_at(self, x0: Array) -> Array:
        assert isinstance(self.problem, Problem)
        x0 = x0[: self.problem.measured]
        if self.problem.fixed_observer is not None:
            x0 = self.problem.fixed_observer.from_measured(x0)
        there = replace(self.problem, plant=replace(self.problem.plant, x0=x0))
        return np.asarray(flatten(initial_acting(ClosedLoop.of(there, self.controller))), dtype=float)

    @property
    def lost(self) -> float:
        """The value of the freeze switch at a lost sample: with an observer, it differs from the value that only freezes the
        estimates."""
        return 1.0 if self.loop.observer is None else LOST

    def evaluated(self, state: Array, y: Array, r: Array, freeze: float = 0.0) -> Array:
        """The flat state one sample later, (S,), computed by the list in the target's number type; zero for entries that are not
        kept."""
        after = np.zeros_like(self.initial)
        after[self.layout.rows] = evaluate(self.step, self.inputs(state, y, r, freeze), self.real)
        return after

    def inputs(
        self, state: Array, y: Array, r: Array, freeze: Array | float, parameters: Sequence[Array | float] | None = None
    ) -> Inputs:
        """The inputs of the step's list: flat states (S,), measurements and commands, or columns of them, (S, K).

        parameters  in order; by default those of the case
        """
        given: dict[tuple[int, int], Any] = {(STATE, row): state[row] for row in self.layout.rows} | {(FREEZE, 0): freeze}
        given |= {(MEASURED, i): value for i, value in enumerate(y)} | {(COMMAND, i): value for i, value in enumerate(r)}
        if self.opened is not None:
            given |= {(PARAMETER, i): value for i, value in enumerate(self.opened.values)}
        if parameters is not None:
            places = {one: i for i, one in enumerate(self.parameters)}
            read = [at for kind, at in sources(self.step) if kind == PARAMETER]
            own = ((at, self.fed(at)) for at in read)
            given |= {(PARAMETER, at): parameters[places[one]] for at, one in own if isinstance(one, Parameter)}
        return given

    def replayed(self) -> Contents:
        """A copy with separate test vectors, for different numbers or operations, which receives the measurements of the
        simulation."""
        states = self._compiled() if self.real is DOUBLE else self._evaluated()
        if not np.isfinite(states).all():
            raise InputError(f"{self.controller.name} exceeds the range of float32 on this case; export it in float64")
        largest = max(self.largest, float(np.abs(states[:, self.layout.rows]).max()))
        return replace(self, vectors=replace(self.vectors, states=states), largest=largest)

    def _evaluated(self) -> Array:
        state, states = self.initial, np.zeros_like(self.vectors.states)
        for k, (y, r) in enumerate(zip(self.vectors.measured, self.vectors.commands, strict=True)):
            state = states[k] = self.evaluated(state, y, r)
        return states

    def _compiled(self) -> Array:
        """The states after each sample, computed by LLVM, which supports only 64 bits here."""

        def constant(op: Operation) -> Operation:
            if op.name != "input" or op.source[0] != PARAMETER or self.opened is None:
                return op
            return Operation("constant", value=float(self.opened.values[op.source[1]]))

        program = Program(tuple(map(constant, self.program.operations)), self.program.outputs)
        step = SampledList.of(self.problem, self.controller, program).step()
        states = np.zeros_like(self.vectors.states)
        for k, (y, r) in enumerate(zip(self.vectors.measured, self.vectors.commands, strict=True)):
            step(y, r)
            states[k] = step.state
        return states


PROBED_STATES = 4
"""Number of states used to identify entries that do not change. It is unlikely that an entry stays unchanged at all of them by
chance."""


def is_explicit(contents: Contents) -> bool:
    """Whether the controller takes explicit steps."""
    equations: SampledEquations | object = contents.loop.equations
    return isinstance(equations, DiscretizedEquations) and equations.explicit
