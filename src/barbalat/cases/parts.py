"""Parts of a case that are built alike whatever is measured: signals, sensor, simulation, the checks of the whole."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barbalat import signals
from barbalat.cases import plant_tables, schema, signal_tables
from barbalat.cases.plant import within
from barbalat.cases.tables import Table
from barbalat.controllers import Sampled
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.loop.binding import bound, require_controllers
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Signal
from barbalat.run import delay
from barbalat.run.step import Rhythm
from barbalat.solvers import SOLVERS
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False)
class Case:
    """A problem, the controllers to compare on it, and how to simulate."""

    problem: TrackingProblem
    controllers: tuple[Controller, ...]
    simulation: Simulation

    @property
    def name(self) -> str:
        return self.problem.name


def signal(table: Table | None, folder: Path) -> Signal:
    """A signal of any kind; relative paths start at ``folder``."""
    assert table is not None
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in table if key != "kind"}
    if isinstance(table, signal_tables.CsvSignal):
        return signals.Recorded.from_csv(folder / table.file)
    kinds: dict[type[Table], Callable[..., Signal]] = {
        signal_tables.ConstantSignal: signals.Constant,
        signal_tables.StepSignal: signals.Step,
        signal_tables.StepsSignal: signals.Steps,
        signal_tables.SineSignal: signals.Sine,
        signal_tables.SinesSignal: signals.Sines,
        signal_tables.SquareSignal: signals.Square,
        signal_tables.ChirpSignal: signals.Chirp,
    }
    return kinds[type(table)](**values)


def sensor(table: plant_tables.SensorTable) -> Sensor:
    """[sensor]."""
    noise = None if table.noise is None else Noise(**dict(table.noise))
    return Sensor(lag=table.lag, noise=noise)


def simulation(table: schema.SimulationTable) -> Simulation:
    """[simulation]."""
    if table.solver not in SOLVERS:
        raise InputError(f"simulation.solver must be one of {', '.join(SOLVERS)}, got {table.solver!r}")
    return Simulation(t_end=table.t_end, dt=table.dt, solver=SOLVERS[table.solver], record_points=table.record_points)


def low_pass(table: schema.FilterTable) -> TransferFunction | None:
    """C(s); None for C = 1."""
    if table.kappa is not None:
        if table.num is not None or table.den is not None:
            raise InputError("filter: give either kappa or num and den")
        return None if table.kappa == 0 else input_filter(table.kappa)
    if table.num is None or table.den is None:
        raise InputError("filter: give kappa, or both num and den")
    return within("filter", lambda: TransferFunction(np.array(table.num), np.array(table.den)))


def bound_and_sampled(controller: Controller, table: schema.SchemeTable, problem: TrackingProblem) -> Controller:
    """The controller, sampled if asked, after it was bound to the problem once to see that the two fit."""
    if table.sample_time is not None:
        controller = Sampled(
            controller=controller, sample_time=table.sample_time, discretization=table.discretization or "midpoint"
        )
    elif table.discretization is not None:
        raise InputError("discretization goes with sample_time, which is missing")
    bound(problem, controller)
    return controller


def assembled(problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation) -> Case:
    """The case, after what its parts must agree on was checked."""
    require_controllers(controllers)
    if problem.delay > 0:
        delay.lag(problem.delay, simulation.dt)  # refuses a delay that this step can't carry
    for controller in controllers:
        Rhythm.of(ClosedLoop.of(problem, controller), problem.noise, simulation.dt)  # likewise what happens between steps
    return Case(problem, tuple(controllers), simulation)
