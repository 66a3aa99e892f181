"""Estimates the costs of runs from the sizes of their loops, and rejects runs that exceed the budget."""

from __future__ import annotations

from collections.abc import Sequence

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.signals import Sines
from barbalat.solvers.simulation import Simulation
from barbalat.validate import counted

RECORD_COPIES = 5
"""Number of copies of the record: in the kernel, as columns, joined, and in the result."""
TERM_SECONDS = 3e-8
"""Cost of a sine per step."""
MEMBER = Estimate(memory=200.0, seconds=1.2e-5)
"""Cost of a member of an ensemble in addition to its states and steps: reading, columns, evaluation."""
ATTEMPT_STEPS = 40.0
"""Number of fixed steps of an ensemble's member that take as long as one attempt at a variable step, which evaluates the
equations 15 times and is observed at eight nodes. For the controllers of Section V 30 to 45 were measured over 2 s and 20 s."""
BEGUN_STEPS = 1e5
"""Fixed steps that take as long as the beginning and the end of such a run, which take 1 ms."""

JUDGED_COMPONENT, JUDGED_INPUT, JUDGED_COPIES = 3, 10, 4
"""Largest number of rows of the judge's memory for each component of the error and each input, and the number of copies of
each row."""


def require_states(loop: ClosedLoop) -> None:
    """Raise InputError for a loop with too many states, before its equations are traced."""
    dense, size = _plant_states(loop), loop.size
    budget.require(
        "the closed loop", size, lambda states: budget.of_kernel(states, dense), given=f"has {counted(size, 'state')}, and "
        f"its equations",
        fits=lambda most: f"at most {counted(most, 'state')}", what=f"the equations of {counted(size, 'state')}",
    )  # fmt: skip


def require_runs(problem: TrackingProblem, loops: Sequence[ClosedLoop], simulation: Simulation) -> None:
    """Raise InputError for parallel recorded runs with too many points or steps, before anything is traced."""
    made, steps = _made(loops), simulation.steps

    def room(points: float) -> Estimate:
        return sum((_of_record(loop, points) for loop in loops), Estimate(memory=made.memory))

    if len(loops) > 1 and not budget.in_force().allows(room(min(2, steps))):
        _require_fewer(problem, loops, simulation)
    beside = f"for {len(loops)} controllers" if len(loops) > 1 else "for its controller"
    asked = simulation.record_points
    budget.require(
        "simulation.record_points", min(steps, asked), room, least=min(2, steps), given=f"= {asked} {beside}",
    )  # fmt: skip
    rest = room(min(steps, asked)) + Estimate(seconds=made.seconds)
    given = f"= {simulation.t_end:g} s has {simulation.steps:.3g} steps of {simulation.dt:g} s, which {beside}"
    budget.require(
        "simulation.t_end", steps, lambda count: rest + of_steps(problem, loops, count), given=given,
        fits=lambda most: f"a t_end of {simulation.t_end / steps * most:.6g} s with this step", what="simulating",
    )  # fmt: skip


def _require_fewer(problem: TrackingProblem, loops: Sequence[ClosedLoop], simulation: Simulation) -> None:
    """Raise InputError, with the number of controllers that fit, if the kernels alone exceed the budget."""
    points = min(simulation.steps, simulation.record_points)

    def cost(count: float) -> Estimate:
        some = loops[: int(count)]
        return sum((_of_record(loop, points) for loop in some), _made(some) + of_steps(problem, some, simulation.steps))

    budget.require(
        "the case", len(loops), cost, given=f"has {len(loops)} controllers, each with a separate kernel: to simulate them",
        fits=lambda most: f"at most {counted(most, 'controller')}",
    )  # fmt: skip


def steps_within(problem: TrackingProblem, loops: Sequence[ClosedLoop], simulation: Simulation, most: int) -> int:
    """The number of steps of a further run, at most ``most``, that the budget allows; 0 if it allows none."""

    def fits(steps: int) -> bool:
        points = min(steps, simulation.record_points)
        cost = _made(loops) + of_steps(problem, loops, steps)
        return budget.in_force().allows(sum((_of_record(loop, points) for loop in loops), cost))

    return most if fits(most) else budget.largest(fits, 1, most) or 0


def of_steps(problem: TrackingProblem, loops: Sequence[ClosedLoop], steps: float) -> Estimate:
    """The cost of the steps of single runs, including the signals that they share."""
    counted = sum(budget.operations(loop.size, _plant_states(loop)) for loop in loops)
    terms = sum(len(signal.amplitudes) if isinstance(signal, Sines) else 1 for signal in problem.signals)
    return Estimate(seconds=steps * (counted * budget.STEP_OPERATION_SECONDS + terms * TERM_SECONDS))


def of_members(loops: Sequence[ClosedLoop], steps: float, members: float) -> Estimate:
    """The cost of an ensemble of each loop, without records."""
    counted = sum(budget.operations(loop.size, _plant_states(loop)) for loop in loops)
    each = Estimate(8.0 * sum(loop.size for loop in loops), steps * counted * budget.MEMBER_OPERATION_SECONDS)
    return (MEMBER + each).times(members)


def steps_like(attempts: float) -> float:
    """The fixed steps of an ensemble's member that take as long as a variable-step run of this many attempts."""
    return BEGUN_STEPS + ATTEMPT_STEPS * attempts


def steps_of(simulation: Simulation) -> float:
    """The number of steps of a study's runs. With a tolerance, the number of fixed steps that take as long as the largest
    expected number of attempts, which is at least one for every two steps of the resolution."""
    return simulation.steps if simulation.tolerance is None else steps_like(simulation.t_end / (2 * simulation.resolution))


def of_judging(loops: Sequence[ClosedLoop], members: float) -> Estimate:
    """The memory of the judge for parallel members: before the tail and at the end, in addition to their states."""
    rows = sum(JUDGED_COMPONENT * loop.errors + JUDGED_INPUT * loop.inputs for loop in loops)
    return Estimate(memory=8.0 * JUDGED_COPIES * rows).times(members)


def _made(loops: Sequence[ClosedLoop]) -> Estimate:
    return sum((budget.of_kernel(loop.size, _plant_states(loop)) for loop in loops), Estimate())


def _of_record(loop: ClosedLoop, points: float) -> Estimate:
    """The memory of a record with this number of instants: states, extrema of e, u and the estimates, sums."""
    numbers = loop.size + 4 * loop.errors + 3 * loop.parameters + 2 * loop.inputs
    return Estimate(memory=8.0 * RECORD_COPIES * numbers * points)


def _plant_states(loop: ClosedLoop) -> int:
    return int(loop.plant.x0.size)
