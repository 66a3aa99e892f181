"""The plant of an exported loop: a slice of the step of the simulation, with the sensor measurement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import count

import numpy as np

from barbalat.export.parameters import Opened, Parameter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten
from barbalat.lowering.operations import Program, sliced, sources
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.sampled_controller import STATE
from barbalat.targets import EXPORTED_LOOP

PARAMETER, SIGNAL, PAST, NOISE = 2, 3, 4, 5
"""Arguments of a step's list in addition to the state; as in ``run.kernel.step.step_function``."""


@dataclass(frozen=True, eq=False)
class PlantContents:
    """Everything between the control and the measurement (limits, actuators, delay, plant, sensor), one solver step at a time.

    rows  rows of the loop's flat state that belong to the plant: x, then the states before the plant, then the states after it
    """

    problem: TrackingProblem
    opened: Opened
    loop: ClosedLoop
    rows: tuple[int, ...]

    @classmethod
    def of(cls, problem: TrackingProblem, opened: Opened) -> PlantContents:
        """Raise InputError for a plant whose equations contain t."""
        EXPORTED_LOOP.require(problem)
        loop = opened.members.loop
        at = loop.unpack(np.arange(loop.size))
        own = flatten((at.x, at.input, at.sensor))
        return cls(problem, opened, loop, tuple(int(row) for row in own))

    @cached_property
    def step(self) -> Program:
        """The state of the plant one solver step later, followed by the values of this step that the delay must store."""
        whole = self.opened.members.program.program
        following, _, remembered = whole.outputs
        both = Program(whole.operations, ((*(following[row] for row in self.rows), *remembered),))
        return sliced(both, range(len(both.outputs[0])))

    @cached_property
    def measurement(self) -> Program:
        """The measurement that a controller receives."""
        sample = self.opened.members.program.sample
        assert sample is not None
        held = self.loop.unpack(np.arange(self.loop.size)).held
        return sliced(sample, [int(row) for row in held.measured.reshape(-1)])

    @property
    def inputs(self) -> int:
        return self.loop.inputs

    @property
    def outputs(self) -> int:
        """The number of measured entries."""
        return len(self.measurement.outputs[0])

    @property
    def disturbances(self) -> int:
        """Signals other than the commands: first the matched disturbance, then the others."""
        return self.loop.signals.timed - (self.loop.commands or 1)

    @property
    def nodes(self) -> int:
        """Instants of a solver step at which the plant reads the signals."""
        return len(self.opened.members.simulation.solver.nodes)

    @property
    def channels(self) -> int:
        """The number of values that the delay stores for each step."""
        return self.opened.members.program.shape.delayed

    @property
    def lag(self) -> int:
        """The lag in steps of the newest value that the delay reads."""
        lags = self.opened.members.lags
        return 0 if lags is None else int(lags[0])

    @property
    def history(self) -> tuple[float, ...]:
        """The value of each channel before t = 0."""
        history = self.opened.members.history
        return () if history is None else tuple(np.repeat(history[:, 0], self.channels // self.inputs).tolist())

    @property
    def steps_per_sample(self) -> int:
        return int(self.opened.members.rhythm.sample_every)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters on which the plant depends."""
        read = {at for part in (self.step, self.measurement) for kind, at in sources(part) if kind == PARAMETER}
        used = {self.opened.feeds[at] for at in read} | {self.opened.starts.get(row) for row in self.rows}
        return tuple(one for k, one in zip(count(), self.opened.parameters) if k in used)

    def fed(self, entry: int) -> Parameter | float:
        """The source of an entry of a list's third argument: a parameter, or a fixed number."""
        k = self.opened.feeds[entry]
        return float(self.opened.values[entry]) if k is None else self.opened.parameters[k]

    def start(self, row: int) -> Parameter | float:
        """The initial value of an entry of the loop's state."""
        k = self.opened.starts.get(row)
        return float(self.opened.members.states[row, 0]) if k is None else self.opened.parameters[k]

    def signal(self, entry: int) -> tuple[int, int] | None:
        """Node and disturbance of an entry of a step's signals; None for the flag of a whole step, 1."""
        node, which = divmod(entry, self.loop.signals.timed)
        if node >= self.nodes:
            return None
        assert which >= (self.loop.commands or 1), "plants do not read the command"
        return node, which - (self.loop.commands or 1)

    @cached_property
    def control_rows(self) -> tuple[int, ...]:
        """Rows of the loop's state that contain the held control."""
        held = self.loop.unpack(np.arange(self.loop.size)).held
        return tuple(int(row) for row in held.u.reshape(-1))

    def entries(self) -> dict[tuple[int, int], str]:
        """C text of the state and the control of the plant, by the arguments of the lists."""
        own = {(STATE, row): f"p->state[{i}]" for i, row in enumerate(self.rows)}
        return own | {(STATE, row): f"in->u[{i}]" for i, row in enumerate(self.control_rows)}
