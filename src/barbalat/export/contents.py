"""Everything that an exported controller is made of, before it is printed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.export.evaluation import Inputs, evaluate
from barbalat.export.layout import Layout
from barbalat.export.parameters import Opened, Parameter, estimate_limits
from barbalat.loop.around import Around
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten, unflatten
from barbalat.loop.sampling import Acting
from barbalat.lowering.c99 import DOUBLE, Real
from barbalat.lowering.operations import Program, sliced, sources
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, DiscretizedEquations, SampledEquations
from barbalat.run.engine.simulate import Recording, recorded
from barbalat.run.kernel.sampled_controller import COMMAND, FREEZE, MEASURED, PARAMETER, STATE, controller_program, initial_acting
from barbalat.solvers.simulation import Simulation
from barbalat.targets import require_sampled
from barbalat.validate import Array, InputError

VECTORS = 1000
"""Samples that an export's self-test replays: some 100 kB of C for a small controller."""
FEWEST_VECTORS = 10
"""The self-test refuses the ninth sample, and goes on with the next."""
LEAST_RANGE = 1e6
"""What a state or an input may be in size where the simulation gives no reason for more."""
RANGE_FACTOR = 10.0
"""How often the simulation's largest number fits into the range that is stated."""


@dataclass(frozen=True, eq=False)
class Contents:
    """One sampled controller of one problem, as it is exported.

    program  the whole of the controller's list, as the simulation runs it
    layout   what is kept of its state
    vectors  samples of the simulation, to be met in every bit
    opened   which numbers of the list are parameters; None where all are compiled in
    around   the case's shell, which is no part of the list; None without one
    """

    problem: TrackingProblem
    controller: Controller
    loop: ClosedLoop
    program: Program
    layout: Layout
    vectors: Recording
    real: Real = DOUBLE
    opened: Opened | None = None
    around: Around | None = None

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, real: Real, *, opened: Opened | None = None
    ) -> Contents:
        """InputError for a continuous controller, and for one that diverges before the vectors end."""
        surrounded, problem = problem, problem.nominal
        loop = ClosedLoop.of(problem, controller)
        require_sampled(controller.name, sampled=loop.sampled)
        around = Around.of_shell(surrounded, loop.sample_time)
        if opened is None and not simulation.fused:  # whose list has a symbol for each number, which rounds differently
            opened = Opened.of(problem, controller, simulation, tunable=False)
        program = controller_program(loop) if opened is None else controller_program(opened.template.loop, opened.template.column)
        vectors = recorded(problem, controller, simulation, VECTORS)
        if not all(np.isfinite(part).all() for part in (vectors.measured, vectors.commands, vectors.states)):
            raise InputError(
                f"{controller.name} diverges on this case within {len(vectors.states)} samples: an export would have no test "
                "vectors, and nobody should fly it"
            )
        if around is not None:
            around.require_taken(vectors.measured, surrounded.measured_names)
        made = cls(problem, controller, loop, program, Layout.of(program, loop), vectors, real, opened, around)
        if len(vectors.states) < FEWEST_VECTORS:
            raise InputError(
                f"the self-test of an export needs {FEWEST_VECTORS} samples, and this simulation has {len(vectors.states)}: let "
                f"t_end be {FEWEST_VECTORS * made.sample_time:g} s or more"
            )
        return made if real is DOUBLE else replace(made, vectors=made._rounded())

    @cached_property
    def step(self) -> Program:
        """All that is kept, one sample later: a slice of the list that is simulated."""
        return sliced(self.program, self.layout.rows)

    @property
    def sample_time(self) -> float:
        """The time between two calls of the exported step [s]."""
        assert self.loop.sample_time is not None
        return self.loop.sample_time

    @property
    def measures_state(self) -> bool:
        return self.loop.measured_outputs == 0

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Entries of what is measured, of the command, of the control, of the estimates."""
        y = self.vectors.measured.shape[1]
        return y, self.vectors.commands.shape[1], self.layout.u.size, self.layout.theta_hat.size

    @cached_property
    def initial(self) -> Array:
        """The flat state before the first sample."""
        return np.asarray(flatten(initial_acting(self.loop)), dtype=float)

    @cached_property
    def range(self) -> float:
        """Beyond which no entry of the state, of the measurement or of the command is taken for one: a power of ten."""
        kept = self.vectors.states[:, self.layout.rows], self.vectors.measured, self.vectors.commands, self.initial
        largest = max(float(np.abs(part).max(initial=0.0)) for part in kept)
        return float(max(LEAST_RANGE, 10.0 ** np.ceil(np.log10(max(RANGE_FACTOR * largest, 1.0)))))

    @cached_property
    def limits(self) -> tuple[Array, Array] | None:
        """The least and the largest value of each estimate in the set that it is projected onto; infinite where it has none."""
        return estimate_limits(self.loop)

    @property
    def checked_limits(self) -> tuple[Array, Array] | None:
        """The same, without those that are parameters: a state beyond them is brought in by the law, not refused."""
        if self.limits is None or self.opened is None:
            return self.limits
        low, high = (
            np.where(is_open, np.inf, limit) for is_open, limit in zip(self.opened.open_limits, self.limits, strict=True)
        )
        return low, high

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that this controller depends on."""
        if self.opened is None:
            return ()
        read = {at for kind, at in sources(self.step) if kind == PARAMETER}
        used = {self.opened.feeds[at] for at in read} | set(self._all_starts.values())
        return tuple(
            one for k, one in enumerate(self.opened.parameters) if k in used or (one.limit and self.saturation is not None)
        )

    @cached_property
    def starts(self) -> dict[int, Parameter]:
        """Entries of the flat state that begin with a parameter."""
        return {} if self.opened is None else {row: self.opened.parameters[k] for row, k in self._all_starts.items()}

    @cached_property
    def _all_starts(self) -> dict[int, int]:
        assert self.opened is not None
        first = self.loop.size - len(self.initial)  # the controller's state stands last in the loop's
        return {row - first: k for row, k in self.opened.starts.items() if row - first in set(self.layout.rows)}

    def fed(self, entry: int) -> Parameter | float:
        """What an entry of the list's third argument is: a parameter, or a number that stays."""
        assert self.opened is not None
        k = self.opened.feeds[entry]
        return float(self.opened.values[entry]) if k is None else self.opened.parameters[k]

    @property
    def saturation(self) -> Array | None:
        """(2, m) lower and upper limits of the actuators, infinite for one that has none; None where no actuator has any."""
        given = [path.saturation for path in self.problem.plant.paths]
        if all(limits is None for limits in given):
            return None
        return np.array([(-np.inf, np.inf) if limits is None else limits for limits in given]).T

    @cached_property
    def learnt(self) -> frozenset[int]:
        """Rows of the flat state that keep their values while the freeze switch is on, whatever is measured."""
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
        """(S,) and (S, n): the initial state is the first and the second times the measured state; zero for what is no state."""
        own = np.zeros((len(self.initial), self.sizes[0]))
        if not isinstance(self.problem, Problem):
            return self.initial, own
        rest = self._starting_at(np.zeros(self.sizes[0]))
        for i, unit in enumerate(np.eye(self.sizes[0])):
            own[:, i] = self._starting_at(unit) - rest
        return rest, own

    def _starting_at(self, x0: Array) -> Array:
        assert isinstance(self.problem, Problem)
        there = replace(self.problem, plant=replace(self.problem.plant, x0=x0))
        return np.asarray(flatten(initial_acting(ClosedLoop.of(there, self.controller))), dtype=float)

    def evaluated(self, state: Array, y: Array, r: Array, freeze: bool = False) -> Array:
        """The flat state one sample later, (S,), by the list in the target's numbers; zero where it is not kept."""
        after = np.zeros_like(self.initial)
        after[self.layout.rows] = evaluate(self.step, self.inputs(state, y, r, freeze), self.real)
        return after

    def inputs(self, state: Array, y: Array, r: Array, freeze: Array | bool) -> Inputs:
        """What the step's list reads: flat states (S,), measurements and commands, or columns of them, (S, K)."""
        given: dict[tuple[int, int], Any] = {(STATE, row): state[row] for row in self.layout.rows} | {(FREEZE, 0): freeze}
        given |= {(MEASURED, i): value for i, value in enumerate(y)} | {(COMMAND, i): value for i, value in enumerate(r)}
        if self.opened is not None:
            given |= {(PARAMETER, i): value for i, value in enumerate(self.opened.values)}
        return given

    def _rounded(self) -> Recording:
        """The vectors of a target with other numbers: its own run on what the simulation measured."""
        state, states = self.initial, np.zeros_like(self.vectors.states)
        for k, (y, r) in enumerate(zip(self.vectors.measured, self.vectors.commands, strict=True)):
            state = states[k] = self.evaluated(state, y, r)
        if not np.isfinite(states).all():
            raise InputError(f"{self.controller.name} leaves the numbers of float32 on this case; export it in float64")
        return replace(self.vectors, states=states)


PROBED_STATES = 4
"""States at which it is seen what rests; an entry that stands still by chance at all of them is not to be expected."""


def is_explicit(contents: Contents) -> bool:
    """Whether the controller takes explicit steps."""
    equations: SampledEquations | object = contents.loop.equations
    return isinstance(equations, DiscretizedEquations) and equations.explicit
