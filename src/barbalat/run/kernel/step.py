"""From a closed loop to a compiled kernel: one solver step with the accumulators of the metrics, traced and compiled once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from barbalat.judge.appended import Given, Watched, joined, unchanged
from barbalat.judge.memory import Memory
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import continuous_twin
from barbalat.loop.packing import column, symbols
from barbalat.lowering.llvm.ir import LONGEST_INSIDE, ExternalFunction
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import TAPS_PER_CHANNEL, LoopShape
from barbalat.problem.measurement import Noise
from barbalat.protocols import Value
from barbalat.run.kernel.delay import CHANNELS_PER_INPUT
from barbalat.run.kernel.grid import WHOLE_STEP, StepPiece
from barbalat.run.kernel.metrics import DIVERGENCE_LIMIT, Accumulators, divergence_measure
from barbalat.run.kernel.sampled_controller import parameters_column, sample_program
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

if TYPE_CHECKING:
    import casadi as ca

STEPS_WORTH_OPTIMISING = 250_000
"""Number of steps of a kernel, over all its runs, above which optimisation pays. Optimised code of Section V's loops takes 6 ms
longer to compile and saves 24 ns per step. For loops with 16,000 and 34,000 operations compilation takes 0.15 ms longer and each
step saves 0.45 ns, both per operation. The break-even number of steps is thus about the same for any loop, to within a third."""


@dataclass(eq=False)
class CompiledLoop:
    """The code of a loop, which is first compiled quickly and is optimised after enough steps."""

    make: Callable[[bool], Kernel]
    steps: float = 0.0
    kernel: Kernel | None = None
    optimised: bool = False

    def for_steps(self, steps: float) -> Kernel:
        self.steps += steps
        worth = self.steps >= STEPS_WORTH_OPTIMISING
        if self.kernel is None or (worth and not self.optimised):
            self.kernel, self.optimised = self.make(not worth), worth
        return self.kernel


@lru_cache(maxsize=64)
def compiled(
    program: Program,
    shape: LoopShape,
    resets: tuple[float, ...],
    lanes: int,
    sample: Program | None,
    watch: Program | None,
    outside: ExternalFunction | None,
) -> CompiledLoop:
    """The cached code of a loop, shared by equal lists; the least recently used entries are dropped."""

    def make(quickly: bool) -> Kernel:
        return Kernel(program, shape, resets, lanes, sample, watch, outside=outside, quickly=quickly)

    return CompiledLoop(make)


def coupling_function(loop: ClosedLoop, step: ca.Function, dt: Value = None, parameters: ca.SX | None = None) -> ca.Function:
    """|sum of J_ij J_ji over i != j| + sum of J_ii^2, without constant terms; J is the Jacobian of the right-hand side.

    Without the absolute value it is the sum of the squares of the eigenvalues, tr J^2; for the frozen oscillation of adaptation
    it is 2 omega_a^2. A rate limiter's J_ii is omitted: the limiter follows its demand within one step, so h J_ii is -1 at every
    step and would look like a mode that no step resolves. The arguments are those of ``step`` (see ``step_function``); ``dt`` [s]
    is the length of the step, and ``parameters`` are the symbols in the loop. The value is minus infinity if the run has
    diverged.
    """
    import casadi as ca

    given = [ca.SX.sym(step.name_in(i), step.nnz_in(i)) for i in range(step.n_in())]
    if parameters is not None:
        given[2] = parameters
    state, table_row, noise = (ca.array(given[i]).reshape(-1) for i in (0, 3, 5))
    # at the step's start
    signals = np.concatenate([table_row[: loop.signals.timed], noise, np.zeros(loop.signals.delayed)])
    twin = continuous_twin(loop).following_within(dt)
    slope: Value = column(twin.derivative(state[: twin.size], signals))
    own, crossed = _cycles(ca.jacobian(slope, given[0][: twin.size]), set(twin.limiter_rows))
    quantity = ca.array(own + ca.fabs(crossed)).reshape(-1)
    measure = divergence_measure(twin, twin.outputs(state[: twin.size], signals), state[: twin.size])
    watched = np.where(measure <= DIVERGENCE_LIMIT, quantity, -np.inf)
    return ca.Function("coupling", given, [column(watched)], {"cse": True})


def _cycles(jacobian: ca.SX, without: set[int]) -> tuple[ca.SX, ca.SX]:
    """sum of J_ii^2 and sum of J_ij J_ji, i != j, without constant terms and without the J_ii^2 of the rows ``without``."""
    import casadi as ca

    own, crossed = ca.SX(0), ca.SX(0)
    places = set(zip(*jacobian.sparsity().get_triplet(), strict=True))
    for i, j in sorted(places):
        if i > j or (j, i) not in places or (i == j and i in without):
            continue
        product = jacobian[i, j] * jacobian[j, i]
        if product.is_constant():
            continue
        if i == j:
            own += product
        else:
            crossed += 2 * product
    return own, crossed


LARGEST_WATCHED_STATE = 150
"""A loop with more states is not monitored during its run, because the monitored quantity has terms for each pair of states."""


@dataclass(frozen=True)
class StepProgram:
    """One step as an operation list, and the operations of a sampled controller before it; compile it for a number of lanes.

    outside  separately compiled code for the sampled controller's part of the operations before a step
    memory   the judge's memory after the loop's states; None without a judge
    """

    program: Program
    shape: LoopShape
    accumulators: Accumulators | None
    sample: Program | None = None
    watch: Program | None = None
    outside: ExternalFunction | None = None
    memory: Memory | None = None

    def judged(self, loop: ClosedLoop, watched: Watched, dt: Value, parameters: ca.SX | None) -> StepProgram:
        """This step with the judge's list appended; ``loop``, ``dt`` and ``parameters`` are the ones with which the step was
        traced."""
        assert self.accumulators is not None
        at, shape, memory = self.accumulators.slices(), self.shape, watched.memory(loop)
        given = Given(
            errors=self._taken(at["e", "min"]),
            demands=self._taken(at["u", "min"]),
            row=shape.signals,
            pieces=len(WHOLE_STEP) if shape.in_pieces else 0,
            dt=dt,
            parameters=parameters,
        )
        rows = len(memory.begins)
        return replace(
            self,
            program=joined(self.program, loop, memory, given),
            shape=replace(shape, states=shape.states + rows),
            sample=None if self.sample is None else unchanged(self.sample, shape.states, rows),
            memory=memory,
        )

    def _taken(self, rows: slice) -> tuple[int, ...]:
        """The positions of the operations whose minimum these accumulators contain."""
        operations, found = self.program.operations, []
        for i in range(*rows.indices(self.shape.accumulators)):
            operation = operations[self.program.outputs[1][i]]
            (place,) = (j for j in operation.operands if operations[j].source != (1, i) or operations[j].name != "input")
            found.append(place)
        return tuple(found)

    def watches(self, lanes: int) -> bool:
        """Whether the kernel monitors its quantity; a long one is monitored only in runs of one member."""
        return self.watch is not None and (lanes == 1 or len(self.watch.operations) <= LONGEST_INSIDE)

    def compile(self, lanes: int, steps: float = inf) -> Kernel:
        """Compile for this number of further steps. For few steps the code is compiled quickly; the results are bit-identical."""
        resets = () if self.accumulators is None else self.accumulators.resets
        watch = self.watch if self.watches(lanes) else None
        return compiled(self.program, self.shape, resets, lanes, self.sample, watch, self.outside).for_steps(steps)


@dataclass(frozen=True, eq=False)
class Rhythm:
    """The periods, in solver steps, of a controller's samples and of new noise."""

    sample_every: int = 0
    noise_hold: int = 1

    @classmethod
    def of(cls, loop: ClosedLoop, noise: Noise | None, simulation: Simulation) -> Rhythm:
        """Raise InputError if a time is not a whole number of steps or is longer than the run, or if the loop can't be
        simulated."""
        loop.require_run()
        sample_time = loop.sample_time
        every = 0 if sample_time is None else whole_steps("sample_time", sample_time, simulation)
        if loop.around is not None and loop.around.jitters:
            loop.around.require_steps(simulation.dt)
            every = 1  # each step checks whether a call of the timer is due
        return cls(
            every,
            1 if noise is None else whole_steps("sensor.noise.sample_time", noise.sample_time, simulation),
        )


def whole_steps(field: str, time: float, simulation: Simulation) -> int:
    """The number of steps of a sample time; raises InputError if it is not whole, or so long that no sample would occur."""
    dt = simulation.dt
    if time > simulation.t_end:
        raise InputError.of(field, f"must not exceed simulation.t_end = {simulation.t_end:g} s, got {time:g} s")
    steps = round(time / dt)
    if steps < 1 or abs(steps * dt - time) > 1e-9 * time:
        raise InputError.of(field, f"must be a whole number of solver steps, got {time:g} s at dt = {dt:g} s")
    return steps


def step_function(
    loop: ClosedLoop,
    solver: Tableau,
    dt: Value,
    parameters: ca.SX | None = None,
    *,
    delay_weights: Value = None,
    figures: bool = True,
    in_pieces: bool = False,
) -> tuple[ca.Function, Accumulators | None]:
    """The step as a CasADi function (state, accumulators, parameters, signals, past, noise) -> (state, accumulators, remember).

    The accumulators are returned too; there are none without ``figures``. ``delay_weights`` (see ``delay.weights``) are given
    with a delay: past then contains the stored values and ``remember`` the values to add. ``loop``, ``dt`` and the weights may
    contain symbols; ``parameters`` is then their CasADi column. With ``in_pieces``, the function advances a piece of a step,
    which the last entries of the signals describe.
    """
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    timed = loop.signals.timed
    row_length = len(solver.nodes) * timed + (len(WHOLE_STEP) if in_pieces else 0)
    signal_column, table_row = symbols("signals", row_length)
    piece = StepPiece(*table_row[-len(WHOLE_STEP) :]) if in_pieces else WHOLE_STEP
    noise_column, noise = symbols("noise", loop.signals.noise)
    past_column, past = symbols("past", CHANNELS_PER_INPUT * TAPS_PER_CHANNEL * loop.signals.delayed)
    taps = past.reshape(loop.inputs, CHANNELS_PER_INPUT * TAPS_PER_CHANNEL) if loop.delayed else None
    signals = {}
    for i, node in enumerate(solver.nodes):
        delayed = [] if taps is None else [(taps @ delay_weights[i]).reshape(-1)]
        signals[node] = np.concatenate([table_row[i * timed : (i + 1) * timed], noise, *delayed])
    derivative = loop.following_within(dt).derivative
    following = solver.advance(derivative, loop.limit, state, signals, piece.length * dt)
    remembered = ca.SX(0, 1)
    if loop.delayed:
        ends = (state, signals[solver.nodes[0]]), (following, signals[solver.nodes[-1]])
        remembered = column(np.column_stack([loop.undelayed_input(*end).reshape(-1) for end in ends]).reshape(-1))
    accumulators, old_column, new = None, ca.SX(0, 1), ca.SX(0, 1)
    if figures:
        accumulators = accumulators_of(loop)
        outputs = loop.outputs(state, signals[solver.nodes[0]])
        size = divergence_measure(loop, outputs, following)
        old_column, old = symbols("accumulators", len(accumulators.resets))
        moved = loop.estimates_moved(state, following)
        new = column(accumulators.update(old, outputs, size, following, moved, begins=piece.begins, ends=piece.ends))
    inputs = [state_column, old_column, parameters_column(parameters), signal_column, past_column, noise_column]
    return ca.Function("step", inputs, [column(following), new, remembered], {"cse": True}), accumulators


def accumulators_of(loop: ClosedLoop) -> Accumulators:
    """The accumulators of a loop's metrics."""
    return Accumulators(errors=loop.errors, parameters=loop.parameters, inputs=loop.inputs, outputs=loop.measured_outputs)


def sampled_states(loop: ClosedLoop) -> ca.Function:
    """The state after a sampled controller's action: (state, signals) -> state; the arguments may have columns for many
    instants."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    return ca.Function("sampled", [state_column, signal_column], [column(loop.sample(state, signals))], {"cse": True})


PLAIN_RHYTHM = Rhythm()
"""The step without samples and noise."""


def step_program(
    loop: ClosedLoop,
    solver: Tableau,
    dt: Value,
    parameters: ca.SX | None = None,
    *,
    delay_weights: Value = None,
    lag_per_member: bool = False,
    rhythm: Rhythm = PLAIN_RHYTHM,
    adjustable: bool = False,
    figures: bool = True,
    watch: bool = False,
    in_pieces: bool = False,
    fused: bool = True,
) -> StepProgram:
    """Trace and optimise the step (see ``step_function``). With ``watch``, ``coupling_function`` is monitored.

    With ``adjustable``, the rhythm is not part of the program but an argument of every call of its kernel. For ``fused``, see
    ``optimize``.
    """
    function, accumulators = step_function(
        loop, solver, dt, parameters, delay_weights=delay_weights, figures=figures, in_pieces=in_pieces
    )
    states, accumulated, varied, signals = (function.nnz_in(i) for i in range(4))
    shape = LoopShape(
        states,
        accumulated,
        varied,
        signals,
        delayed=CHANNELS_PER_INPUT * loop.signals.delayed,
        lag_per_member=lag_per_member,
        noise=loop.signals.noise,
        noise_hold=None if adjustable and loop.signals.noise else rhythm.noise_hold,
        sample_every=None if adjustable and loop.sampled else rhythm.sample_every,
        in_pieces=in_pieces,
    )

    def lowered(traced: ca.Function) -> Program:
        return optimize(read(traced), fused=fused)

    sample = sample_program(loop, function, parameters, dt) if loop.sampled else None
    watched = lowered(coupling_function(loop, function, dt, parameters)) if watch else None
    return StepProgram(lowered(function), shape, accumulators, sample, watched)


Traced = TypeVar("Traced")
_programs: dict[Hashable, tuple[Any, object]] = {}
"""Cache of traced steps; the key is everything on which a step depends. A search runs the same step repeatedly, for example with
different delays."""
MOST_PROGRAMS = 64
"""Largest number of traced steps that are kept, the same as for compiled steps."""


def traced_once(key: Hashable | None, of: object, trace: Callable[[], Traced]) -> Traced:
    """The result of ``trace``, cached unless ``key`` is None. The key states everything on which the result depends; ``of`` is
    kept alive, because a key may contain ids of its parts."""
    if key is None:
        return trace()
    found = _programs.pop(key, None) or (trace(), of)
    _programs[key] = found  # the most recently used one
    if len(_programs) > MOST_PROGRAMS:
        _programs.pop(next(iter(_programs)), None)
    traced: Traced = found[0]
    return traced


def output_function(loop: ClosedLoop) -> ca.Function:
    """The outputs (e, u, theta_hat, x, x_m) as a CasADi function of (state, signals); the arguments may have columns for many
    instants."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    outputs = loop.outputs(state, signals)
    return ca.Function("outputs", [state_column, signal_column], [column(value) for value in outputs], {"cse": True})
