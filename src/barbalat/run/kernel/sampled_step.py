"""A sampled controller by itself, one sample a call: the operations that simulations run and exports print, compiled here.

No plant and no clock is in it, so that any simulator can be the plant. No multiply-add is fused: its bits are those of the
exported C, which is the same list.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten, unflatten
from barbalat.loop.sampling import Acting
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import LoopShape
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.sampled_part import COMMAND, FREEZE, MEASURED, STATE, controller_program, initial_acting
from barbalat.run.kernel.stepwise import Agreement
from barbalat.validate import Array, InputError

SIGNALS = 3
"""The argument of a kernel's step by which it is handed what was sampled."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledList:
    """The operations of a controller from sample to sample, and where in its state what is; nothing of its class is left in it.

    program            a kernel's step, with what is measured, the command and the freeze switch as one row of signals
    initial            (S,) the state before the first sample
    u, x_m, theta_hat  their places in the state
    measured, signals  entries of what is measured, and of the row
    """

    name: str
    sample_time: float
    program: Program
    initial: Array
    u: Array
    x_m: Array
    theta_hat: Array
    measured: int
    signals: int

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller) -> SampledList:
        """InputError where the controller does not fit the problem, or runs continuously."""
        loop = ClosedLoop.of(problem, controller)
        if not loop.sampled:
            raise InputError(
                f"{controller.name} is continuous, and a flight computer runs from sample to sample: wrap it as "
                "Sampled(controller=..., sample_time=...)"
            )
        assert loop.sample_time is not None
        start = initial_acting(loop)
        initial = np.asarray(flatten(start), dtype=float)
        places: Acting = unflatten(start, np.arange(len(initial)), 0)[0]
        measured, commands = loop.plant.output(loop.plant.x0).size, loop.commands or 1
        return cls(
            name=controller.name,
            sample_time=loop.sample_time,
            program=_as_step(controller_program(loop), measured, commands),
            initial=initial,
            u=np.reshape(places.held.u, -1),
            x_m=np.reshape(places.held.x_m, -1),
            theta_hat=np.asarray(loop.theta_hat(places.controller), dtype=int),
            measured=measured,
            signals=measured + commands + 1,
        )

    def step(self) -> SampledStep:
        """It, compiled by LLVM."""
        return SampledStep(self)


class SampledStep:
    """Such a list, compiled here: a call is a sample. Not for several threads."""

    def __init__(self, contents: SampledList) -> None:
        self.contents, states = contents, len(contents.initial)
        kernel = Kernel(contents.program, LoopShape(states, 0, 0, contents.signals), (), lanes=1)
        self.state, self._handed = contents.initial.copy(), np.zeros(contents.signals)
        self._run = kernel.bound(1, 1, self.state, np.empty(0), self._handed, np.empty(states))

    @property
    def name(self) -> str:
        return self.contents.name

    def reset(self) -> None:
        """Back to before the first sample."""
        self.state[:] = self.contents.initial

    def __call__(self, y: Array, r: Array | float) -> Array:
        """u, (m,), at the next sample, of what is measured and of the command."""
        measured = self.contents.measured
        self._handed[:measured], self._handed[measured:-1] = y, r
        self._run()
        return self.state[self.contents.u]

    def agreement(self) -> Agreement | None:
        """There is nothing that it could differ from."""
        return None

    @property
    def estimates(self) -> Array:
        """theta_hat at the last sample."""
        return self.state[self.contents.theta_hat]


def _as_step(program: Program, measured: int, commands: int) -> Program:
    """A controller's list as a kernel's step: what it is handed as one row of signals; it accumulates and delays nothing."""
    starts = {STATE: (STATE, 0), MEASURED: (SIGNALS, 0), COMMAND: (SIGNALS, measured), FREEZE: (SIGNALS, measured + commands)}

    def placed(source: tuple[int, int]) -> tuple[int, int]:
        argument, start = starts[source[0]]
        return argument, start + source[1]

    operations = tuple(op._replace(source=placed(op.source)) if op.name == "input" else op for op in program.operations)
    return Program(operations, (program.outputs[0], (), ()))
