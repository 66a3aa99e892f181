"""Many runs at once: members that differ in any number of the plant, the settings or what follows from them."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import symbols
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run import delay
from barbalat.run.engine import Batch, run
from barbalat.run.grid import CHUNK_STEPS, segments_of
from barbalat.run.metrics import Metrics
from barbalat.run.progress import Progress
from barbalat.run.step import step_program
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class EnsembleResult:
    """Figures of M members, in the order given; ``varied`` counts the numbers in which they differ.

    quarters  (M, 4, n) the largest |e| in each quarter of the run, t_end left out, where they were asked for; NaN for a member
              that diverged
    """

    simulation: Simulation
    metrics: Metrics
    varied: int
    quarters: Array | None = None

    def __len__(self) -> int:
        return len(self.metrics.diverged_at)


def simulate_ensemble(
    members: Sequence[tuple[TrackingProblem, Controller]],
    simulation: Simulation,
    *,
    numbers: Sequence[int] | Array | None = None,
    quarters: bool = False,
    threads: int | None = None,
    lanes: int | None = None,
    progress: Progress | None = None,
) -> EnsembleResult:
    """Run every (problem, controller) and return the figures over all steps; no trajectory is kept.

    All members have one structure (scheme, dimensions, projection or not, signals) and may differ in every number:
    theta, x0, gamma, kappa, the box, A_m and with it P, ... Numbers that are the same for all are compiled in.

    numbers         with the seed they fix each member's measurement noise; by default 0, 1, ... in the order given. Members
                    with one number and one seed have the same noise
    quarters        keep the largest |e| of each quarter of the run too; at least eight steps
    threads, lanes  only speed depends on them, not a single bit of the results
    """
    _require(members, simulation, quarters, lanes)
    streams = _numbers_of(members, numbers)
    signals = members[0][0].signals
    for i, (problem, _) in enumerate(members):
        if problem.signals != signals:
            raise InputError(f"all members must share their signals, but member {i + 1} has {validate.show(problem.signals)}")
    loops = [ClosedLoop.of(problem, controller) for problem, controller in members]
    noise_times = [None if problem.noise is None else problem.noise.sample_time for problem, _ in members]
    sample_times = [loop.sample_time for loop in loops]
    for what, times in (("the noise's sample time", noise_times), ("the controller's sample time", sample_times)):
        if any(time != times[0] for time in times):
            raise InputError(f"all members must share {what}")
    delays = [problem.delay for problem, _ in members]
    weights, lags, history = [None] * len(loops), None, None
    if loops[0].delayed:
        weights = [delay.weights(value, simulation.dt, simulation.solver) for value in delays]
        lags = np.array([delay.lag(value, simulation.dt) for value in delays])
        history = np.column_stack([problem.history for problem, _ in members])
    template, parameters, column = _symbolic_template([Member(*pair) for pair in zip(loops, weights, strict=True)])
    program = step_program(
        template.loop,
        simulation.solver,
        simulation.dt,
        column,
        delay_weights=template.delay_weights,
        lag_per_member=lags is not None and bool((lags != lags[0]).any()),
        noise=members[0][0].noise,
    )
    states = np.column_stack([loop.initial() for loop in loops])
    seeds = None if loops[0].noise == 0 else np.array([problem.noise.seed for problem, _ in members if problem.noise is not None])
    given: dict[str, Any] = {"lags": lags, "history": history, "seeds": seeds, "numbers": streams, "lanes": lanes}
    batch = Batch(program, states, parameters, record=quarters, **given)
    blocks = replace(simulation, record_points=_points(simulation)) if quarters else simulation
    run([batch], signals, blocks, threads=threads, progress=progress)
    return EnsembleResult(
        simulation=simulation,
        metrics=batch.metrics(simulation, loops[0].theta_hat_rows),
        varied=len(parameters),
        quarters=_quarters(batch, blocks) if quarters else None,
    )


def _numbers_of(members: Sequence[Any], numbers: Sequence[int] | Array | None) -> Array:
    """(M,) the members' numbers, checked."""
    if numbers is None:
        return np.arange(len(members))
    if len(numbers) != len(members):
        raise InputError(f"numbers must have {len(members)} entries, one for each member, got {len(numbers)}")
    return np.array([validate.whole("numbers", number, least=0) for number in numbers])


def _require(members: Sequence[Any], simulation: Simulation, quarters: bool, lanes: int | None) -> None:
    """InputError for what no ensemble can be made of."""
    if lanes is not None and (validate.whole("lanes", lanes, least=1) & (lanes - 1)):
        raise InputError(f"lanes must be a power of two, got {lanes}")
    if not isinstance(members, (list, tuple)):
        raise InputError(f"members must be a list of pairs (problem, controller), got {validate.show(members)}")
    if not members:
        raise InputError("an ensemble needs at least one member, got none")
    validate.instance("simulation", simulation, Simulation)
    if quarters and simulation.steps < 8:
        raise InputError(f"quarters need at least eight solver steps, got {simulation.steps}")
    for i, member in enumerate(members, start=1):
        if not (isinstance(member, tuple) and len(member) == 2 and isinstance(member[0], TrackingProblem)):
            raise InputError(f"member {i} must be a pair (problem, controller), got {validate.show(member)}")


def _points(simulation: Simulation) -> int:
    """Recorded blocks with a whole number of them in each quarter, as far as the steps can be divided so."""
    return 4 * int(np.ceil(simulation.steps / (4 * CHUNK_STEPS)))


def _quarters(batch: Batch, simulation: Simulation) -> Array:
    """(M, 4, n) from the recorded blocks: each belongs to the quarter in which its middle lies."""
    segments = list(segments_of(simulation, recorded=True))
    middles = np.concatenate([s.start + (np.arange(s.blocks) + 0.5) * s.length for s in segments])
    quarter = (4 * middles / simulation.steps).astype(int)
    shape, at = batch.program.shape, batch.totals.at
    found = []
    for group in batch.groups:
        members = group.columns.stop - group.columns.start
        out = np.concatenate(group.recorded)[:, shape.states :]  # ends early where every member has diverged
        e = np.maximum(-out[:, at["e", "min"]], out[:, at["e", "max"]])
        result = np.full((4, e.shape[1], members), -np.inf)
        np.maximum.at(result, quarter[: len(e)], e)
        found.append(np.moveaxis(result, 2, 0))
    together = np.concatenate(found)
    together[~np.isnan(batch.totals.diverged_step)] = np.nan
    return together


@dataclass(frozen=True, eq=False)
class Member:
    """Everything that a member's step depends on."""

    loop: ClosedLoop
    delay_weights: Array | None  # as of ``delay.weights``


def _symbolic_template(members: list[Member]) -> tuple[Member, Array, Any]:
    """The first member with a symbol in place of each number that differs; the members' values (p, M); the symbols' column."""
    structure = list(_structure(members[0]))
    numbers = np.empty((len(list(_numbers(members[0]))), len(members)))
    for i, member in enumerate(members):
        if list(_structure(member)) != structure:
            raise InputError(
                f"all members must have one structure (scheme, sizes, projection, delay), but member {i + 1} differs"
            )
        numbers[:, i] = list(_numbers(member))
    differs = (numbers != numbers[:, :1]).any(axis=1)
    column, parameters = symbols("parameters", int(differs.sum()))
    places = np.cumsum(differs) - 1
    values = iter([parameters[int(place)] if d else None for place, d in zip(places, differs, strict=True)])
    return _replace(members[0], values), numbers[differs], column


def _structure(part: Any) -> Iterator[Any]:
    """Everything about a part that is not a number: types, shapes, options."""
    if is_dataclass(part):
        yield type(part)
        for field in fields(part):
            yield field.name
            yield from _structure(getattr(part, field.name))
    elif isinstance(part, tuple):
        yield len(part)
        for entry in part:
            yield from _structure(entry)
    elif isinstance(part, np.ndarray):
        yield part.shape
    elif not isinstance(part, float):
        yield part


def _numbers(part: Any) -> Iterator[float]:
    if is_dataclass(part):
        for field in fields(part):
            yield from _numbers(getattr(part, field.name))
    elif isinstance(part, tuple):
        for entry in part:
            yield from _numbers(entry)
    elif isinstance(part, np.ndarray):
        yield from part.ravel().tolist()
    elif isinstance(part, float):
        yield part


def _replace(part: Any, values: Iterator[Any]) -> Any:
    """A copy with each number for which ``values`` has a symbol replaced by it, in the order of ``_numbers``."""
    if is_dataclass(part):
        twin = copy.copy(part)
        for field in fields(part):
            object.__setattr__(twin, field.name, _replace(getattr(part, field.name), values))
        return twin
    if isinstance(part, tuple):
        return tuple(_replace(entry, values) for entry in part)
    if isinstance(part, np.ndarray):
        entries = [next(values) for _ in range(part.size)]
        return part if all(entry is None for entry in entries) else _array_of(part, entries)
    if isinstance(part, float):
        symbol = next(values)
        return part if symbol is None else symbol
    return part


def _array_of(numbers: Array, entries: list[Any]) -> Any:
    """An array of expressions with the shape of ``numbers``."""
    import casadi as ca

    flat = [number if entry is None else ca.SX(entry) for number, entry in zip(numbers.ravel().tolist(), entries, strict=True)]
    return ca.array(ca.vertcat(*flat)).reshape(*numbers.shape)
