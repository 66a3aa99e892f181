"""The operations of a sampled controller. They run before a step of a simulation or, in flight, separately with one sample per
call.

The controller's list is the same in a simulation and on a flight computer. It uses no fused multiply-adds, which some targets
lack. It is optimised separately, so it does not depend on the plant. The step used in flight contains neither a plant nor a
clock, so any simulator can be the plant. The result agrees bit for bit with the exported C, which is generated from the same
list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols, unflatten
from barbalat.loop.sampling import Acting
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Operation, Program, following, read
from barbalat.lowering.optimize import as_written, optimize
from barbalat.lowering.shape import LoopShape
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Value
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    import casadi as ca

STATE, MEASURED, PARAMETER, COMMAND, FREEZE = range(5)
"""Arguments of a controller's list; its only output is the state one sample later."""


def controller_program(loop: ClosedLoop, parameters: ca.SX | None = None) -> Program:
    """One sample of a sampled controller, as a function of its state, the measurement, the command and the freeze switch."""
    import casadi as ca

    assert loop.computer is not None
    template = initial_acting(loop)
    y = loop.at_first
    state_column, state = symbols("state", len(flatten(template)))
    measured_column, measured = symbols("measured", y.size)
    command_column, command = symbols("command", loop.commands or 1)
    freeze_column, freeze = symbols("freeze", 1)
    acting, _ = unflatten(template, state, 0)
    r = command[0] if loop.commands is None else command
    acted = loop.computer.act(acting, measured.reshape(y.shape), r, freeze[0])
    inputs = [state_column, measured_column, parameters_column(parameters), command_column, freeze_column]
    traced = ca.Function("controller", inputs, [column(flatten(acted))], {"cse": True})
    return optimize(read(traced), fused=False)


def initial_acting(loop: ClosedLoop) -> Acting:
    """The controller's state before the first sample."""
    assert loop.computer is not None
    return Acting(loop._initial.controller, loop._initial.held)


def sample_program(loop: ClosedLoop, step: ca.Function, parameters: ca.SX | None = None, dt: Value = None) -> Program:
    """The operations at a sample, before a step: from the arguments of ``step`` (see ``step_function``) to the state of the
    loop."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, table_row = symbols("signals", step.nnz_in(3))
    noise_column, noise = symbols("noise", loop.signals.noise)
    first = np.concatenate([table_row[: loop.signals.timed], noise, np.zeros(loop.signals.delayed)])
    y, r = loop.sampled_at(state, first)
    inputs = [state_column, ca.SX(0, 1), parameters_column(parameters), signal_column, ca.SX(0, 1), noise_column]
    faults = [] if loop.around is None else [column(loop.signals.named(first).faults)]
    handed = optimize(read(ca.Function("handed", inputs, [state_column, column(y), column(r), *faults])), fused=False)
    operations, acted = acting_on(handed, loop, parameters, dt)
    return Program(operations, ((*handed.outputs[0][: -len(acted)], *acted),))


def acting_on(
    handed: Program, loop: ClosedLoop, parameters: ca.SX | None = None, dt: Value = None
) -> tuple[tuple[Operation, ...], tuple[int, ...]]:
    """The operations of ``handed``, of the shell and of the controller, and the positions of the controller's new state.

    handed  computes the loop's state, the measurement, the command and, with a shell or faults, the faults
    """
    now, measured, command, *values = handed.outputs
    own = len(flatten(initial_acting(loop)))  # the controller's state comes last in the state of the loop
    operations = (*handed.operations, Operation("constant"))
    before, freeze = now[-own:], len(operations) - 1
    taken: tuple[int, ...] = ()
    if loop.around is not None:
        shell = Shelled.of(loop, parameters, dt)
        operations, taken = shell.take(operations, (*before, *measured, *command, *values[0]))
        measured, command, freeze = taken[: len(measured)], taken[len(measured) :][: len(command)], taken[shell.freeze]
    places = {(STATE, i): position for i, position in enumerate(before)}
    places |= {(MEASURED, i): position for i, position in enumerate(measured)}
    places |= {(COMMAND, i): position for i, position in enumerate(command)}
    places |= {(FREEZE, 0): freeze}
    (acted,) = (joined := following(operations, controller_program(loop, parameters), places)).outputs
    operations = joined.operations
    if loop.around is not None:
        operations, acted = shell.put_out(operations, (*before, *acted, *taken))
    return operations, acted


@dataclass(frozen=True, eq=False)
class Shelled:
    """The shell before and after a controller's list, as lists that are not reordered, because the C code has the same lines.

    taking, putting  the shell's operations, as functions of one column of arguments each
    freeze           position of the freeze switch in the result of taking a sample
    """

    taking: Program
    putting: Program
    freeze: int

    @classmethod
    def of(cls, loop: ClosedLoop, parameters: ca.SX | None, dt: Value) -> Shelled:
        """``dt`` [s] is the solver's step, which may be one of the ``parameters``."""
        around, template = loop.around, initial_acting(loop)
        assert around is not None
        own, y = len(flatten(template)), loop.at_first
        count, commands = y.size + (loop.commands or 1), loop.commands or 1
        given_column, given = symbols("given", own + count + len(around.faults))
        before, _ = unflatten(template, given, 0)
        r = given[own + y.size] if loop.commands is None else given[own + y.size : own + count]
        taken = around.take(before.held, given[own : own + y.size].reshape(y.shape), r, given[own + count :], dt)
        whole_column, whole = symbols("whole", 2 * own + len(flatten(taken)))
        (before, after, like), _ = unflatten((template, template, taken), whole, 0)
        acted = around.put_out(like, before, after)
        return cls(
            taking=_as_written(given_column, taken, parameters),
            putting=_as_written(whole_column, acted, parameters),
            freeze=y.size + commands,
        )

    def take(self, operations: tuple[Operation, ...], given: tuple[int, ...]) -> tuple[tuple[Operation, ...], tuple[int, ...]]:
        """Append the operations that take a sample; return the positions of their results."""
        return _behind(operations, self.taking, given)

    def put_out(self, operations: tuple[Operation, ...], given: tuple[int, ...]) -> tuple[tuple[Operation, ...], tuple[int, ...]]:
        """Append the operations that output a control; return the positions of the controller's whole state."""
        return _behind(operations, self.putting, given)


def _as_written(given: ca.SX, result: Any, parameters: ca.SX | None) -> Program:
    import casadi as ca

    return as_written(read(ca.Function("shell", [given, ca.SX(0, 1), parameters_column(parameters)], [column(flatten(result))])))


def _behind(
    operations: tuple[Operation, ...], program: Program, given: tuple[int, ...]
) -> tuple[tuple[Operation, ...], tuple[int, ...]]:
    joined = following(operations, program, {(0, i): position for i, position in enumerate(given)})
    return joined.operations, joined.outputs[0]


def parameters_column(parameters: ca.SX | None) -> ca.SX:
    """The parameters of a step as an argument, which is empty without parameters."""
    import casadi as ca

    return ca.SX(0, 1) if parameters is None else parameters


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How a flown controller agrees, sample by sample, with the simulated list for the same measurements.

    flights     number of flights for which the agreement is known; it is unknown if a simulator fails
    samples     number of compared samples
    refused     number of these samples that the exported C rejected as outside its design range; it then held its last control
    difference  a phrase that names the first number that differs; empty if u and the state are bit-identical throughout
    """

    flights: int = 1
    samples: int = 0
    refused: int = 0
    difference: str = ""

    @property
    def equal(self) -> bool | None:
        """Whether everything is equal; None if nothing was compared."""
        return not self.difference if self.samples else None

    @classmethod
    def together(cls, several: Iterable[Agreement | None], *, flights: int | None = None) -> Agreement:
        """The combined agreement of several flights, some of which may lack a report, or of parts of ``flights`` flights."""
        told = [one for one in several if one is not None]
        return cls(
            flights=sum(one.flights for one in told) if flights is None else flights,
            samples=sum(one.samples for one in told),
            refused=sum(one.refused for one in told),
            difference=next((one.difference for one in told if one.difference), ""),
        )


class Step(Protocol):
    """A controller in the process in which it flies. It must not be used in several threads."""

    @property
    def name(self) -> str: ...

    def reset(self) -> None:
        """Return to the state before the first sample."""

    def __call__(self, y: Array, r: Array | float) -> Array:
        """u, (m,), at the next sample, from the measurement and the command."""

    def agreement(self) -> Agreement | None:
        """The agreement of the samples since the last call; None if the simulated list itself is flown."""


@runtime_checkable
class Resumable(Step, Protocol):
    """A step that can continue from any state: ``state``, (S,), determines the next sample."""

    state: Array


class Flyable(Protocol):
    """A controller that can be pickled and sent to the process in which it flies."""

    @property
    def name(self) -> str: ...

    @property
    def sample_time(self) -> float: ...

    def step(self) -> Step:
        """Prepare the controller in the process in which it flies."""


Maker = Callable[[TrackingProblem, Controller], Flyable]
"""A factory of flown controllers: ``SampledList.of``, or ``export.exported_c`` for software in the loop."""


SIGNALS = 3
"""The argument of a kernel's step that contains the sampled values."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledList:
    """The operations of one sample of a controller, with the positions of its outputs. They do not depend on the controller's
    class.

    program            a kernel's step, with the measurement, the command and the freeze switch as one row of signals
    initial            (S,) the state before the first sample
    u, x_m, theta_hat  positions in the state
    measured, signals  numbers of entries of the measurement and of the row
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
    def of(cls, problem: TrackingProblem, controller: Controller, program: Program | None = None) -> SampledList:
        """Raise InputError if the controller does not fit the problem, or acts in continuous time.

        program  a list of the same controller without parameters, which replaces the list of that controller
        """
        loop = ClosedLoop.of(problem, controller)
        if not loop.sampled:
            raise InputError(
                f"{controller.name} is continuous, but a flight computer needs a sampled controller: wrap it as "
                "Sampled(controller=..., sample_time=...)"
            )
        assert loop.sample_time is not None
        start = initial_acting(loop)
        initial = np.asarray(flatten(start), dtype=float)
        places: Acting = unflatten(start, np.arange(len(initial)), 0)[0]
        measured, commands = loop.at_first.size, loop.commands or 1
        return cls(
            name=controller.name,
            sample_time=loop.sample_time,
            program=_as_step(controller_program(loop) if program is None else program, measured, commands),
            initial=initial,
            u=np.reshape(places.held.u, -1),
            x_m=np.reshape(places.held.x_m, -1),
            theta_hat=np.asarray(loop.theta_hat(places.controller), dtype=int),
            measured=measured,
            signals=measured + commands + 1,
        )

    def step(self) -> SampledStep:
        """The list, compiled by LLVM."""
        return SampledStep(self)


class SampledStep:
    """A compiled list; each call is a sample. It must not be used in several threads."""

    def __init__(self, contents: SampledList) -> None:
        self.contents, states = contents, len(contents.initial)
        kernel = Kernel(contents.program, LoopShape(states, 0, 0, contents.signals), (), lanes=1)
        self.state, self._handed = contents.initial.copy(), np.zeros(contents.signals)
        self._run = kernel.bound(1, 1, self.state, np.empty(0), self._handed, np.empty(states))

    @property
    def name(self) -> str:
        return self.contents.name

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self.state[:] = self.contents.initial

    def __call__(self, y: Array, r: Array | float) -> Array:
        """u, (m,), at the next sample, from the measurement and the command."""
        measured = self.contents.measured
        self._handed[:measured], self._handed[measured:-1] = y, r
        self._run()
        return self.state[self.contents.u]

    def agreement(self) -> Agreement | None:
        """None, because this list is not compared with anything."""
        return None

    @property
    def estimates(self) -> Array:
        """theta_hat at the last sample."""
        return self.state[self.contents.theta_hat]


def _as_step(program: Program, measured: int, commands: int) -> Program:
    """A controller's list in the form of a kernel's step, with its inputs as one row of signals, no accumulators and no delay."""
    starts = {STATE: (STATE, 0), MEASURED: (SIGNALS, 0), COMMAND: (SIGNALS, measured), FREEZE: (SIGNALS, measured + commands)}

    def placed(source: tuple[int, int]) -> tuple[int, int]:
        argument, start = starts[source[0]]
        return argument, start + source[1]

    operations = tuple(op._replace(source=placed(op.source)) if op.name == "input" else op for op in program.operations)
    return Program(operations, (program.outputs[0], (), ()))
