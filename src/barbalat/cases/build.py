"""From the checked tables of a case file to the objects of the Python API."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from barbalat import delay, signals
from barbalat.adaptation.laws import Gradient
from barbalat.cases import schema
from barbalat.cases.plant import build_plant, within
from barbalat.cases.tables import Table
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.grid import Simulation
from barbalat.known_set import KnownSet, ParameterBall, ParameterBox
from barbalat.linear import TransferFunction, input_filter
from barbalat.linear_design import delay_weight, hinf_feedback, pi_feedback
from barbalat.measurement import Noise, Sensor
from barbalat.plant import ReferenceModel
from barbalat.problem import Disturbance, Known, Problem
from barbalat.protocols import Controller, Signal
from barbalat.solvers import SOLVERS
from barbalat.stepping import Rhythm
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False)
class Case:
    """A problem, the controllers to compare on it, and how to simulate."""

    problem: Problem
    controllers: tuple[Controller, ...]
    simulation: Simulation

    @property
    def name(self) -> str:
        return self.problem.name


def build(table: schema.CaseTable, folder: Path) -> Case:
    """Everything validated, controllers bound once; ``folder`` is where relative paths start."""
    problem = Problem(
        plant=build_plant(table),
        reference_model=ReferenceModel(k_0=table.reference_model.k_0),
        reference=_commands(table, folder),
        uncertainty=_known_set(table.uncertainty),
        input_gain=None if table.uncertainty is None else table.uncertainty.input_gain,  # type: ignore[arg-type]
        disturbance=None
        if table.plant.disturbance is None
        else within("plant.disturbance", lambda: _signal(table.plant.disturbance, folder)),
        unmatched=tuple(_unmatched(i, given, folder) for i, given in enumerate(table.plant.unmatched, start=1)),
        sensor=None if table.sensor is None else _sensor(table.sensor),
        name=table.name,
    )
    controllers = []
    for i, settings in enumerate(table.controller, start=1):
        where = f"controller {i} ({settings.name or settings.scheme})"
        controllers.append(within(where, lambda settings=settings: _bound(settings, problem)))  # type: ignore[misc]
    names = [controller.name for controller in controllers]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"every controller needs a name of its own, but {twice[0]!r} stands {names.count(twice[0])} times")
    simulation = _simulation(table.simulation)
    if problem.delay > 0:
        delay.lag(problem.delay, simulation.dt)  # refuses a delay that this step can't carry
    for controller in controllers:
        Rhythm.of(ClosedLoop.of(problem, controller), problem.noise, simulation.dt)  # likewise what happens between steps
    return Case(problem, tuple(controllers), simulation)


def _commands(table: schema.CaseTable, folder: Path) -> Signal | tuple[Signal, ...]:
    given = table.reference
    if not isinstance(given, list):
        return within("reference", lambda: _signal(given, folder))
    return tuple(within(f"reference {i}", lambda one=one: _signal(one, folder)) for i, one in enumerate(given, start=1))  # type: ignore[misc]


def _unmatched(i: int, table: schema.UnmatchedTable, folder: Path) -> Disturbance:
    signal = within(f"plant.unmatched {i}", lambda: _signal(table.signal, folder))
    return within(f"plant.unmatched {i}", lambda: Disturbance(direction=table.direction, signal=signal))


def _sensor(table: schema.SensorTable) -> Sensor:
    noise = None if table.noise is None else Noise(**dict(table.noise))
    return Sensor(lag=table.lag, noise=noise)


def _signal(table: Table | None, folder: Path) -> Signal:
    assert table is not None
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in table if key != "kind"}
    if isinstance(table, schema.CsvSignal):
        return signals.Recorded.from_csv(folder / table.file)
    kinds: dict[type[Table], Callable[..., Signal]] = {
        schema.ConstantSignal: signals.Constant,
        schema.StepSignal: signals.Step,
        schema.StepsSignal: signals.Steps,
        schema.SineSignal: signals.Sine,
        schema.SinesSignal: signals.Sines,
        schema.SquareSignal: signals.Square,
        schema.ChirpSignal: signals.Chirp,
    }
    return kinds[type(table)](**values)


def _simulation(table: schema.SimulationTable) -> Simulation:
    if table.solver not in SOLVERS:
        raise InputError(f"simulation.solver must be one of {', '.join(SOLVERS)}, got {table.solver!r}")
    return Simulation(t_end=table.t_end, dt=table.dt, solver=SOLVERS[table.solver], record_points=table.record_points)


def _bound(table: schema.SchemeTable, problem: Problem) -> Controller:
    """The controller, after it was bound to the problem once to see that the two fit."""
    controller = _linear(table, problem.known) if isinstance(table, schema.LinearTable) else _controller(table)
    if table.sample_time is not None:
        controller = Sampled(
            controller=controller, sample_time=table.sample_time, discretization=table.discretization or "midpoint"
        )
    elif table.discretization is not None:
        raise InputError("discretization goes with sample_time, which is missing")
    controller.bind(problem.known)
    return controller


def _controller(table: schema.SchemeTable) -> Controller:
    match table:
        case schema.MracTable():
            return Mrac(gamma=table.gamma, **_modifications(table), **table.common())
        case schema.L1Table():
            return L1Adaptive(gamma=table.gamma, filter=_filter(table.filter), **_modifications(table), **table.common())
        case schema.NormalizedMracTable():
            if (table.law is None) == (table.gamma is None):
                raise InputError("give either gamma, for the gradient law, or law")
            law = Gradient(gamma=table.gamma) if table.law is None else table.law.build()
            return NormalizedMrac(law=law, c_0=table.c_0, normalization=table.normalization.build(), **table.common())
        case schema.RobustMracTable():
            return RobustMrac(
                tau=table.tau,
                law=table.law.build(),
                c_0=table.c_0,
                normalization=table.normalization.build(),
                printed_sign=table.printed_sign,
                **table.common(),
            )
    raise AssertionError(f"the schema has a scheme that is not built here: {type(table).__name__}")


def _modifications(table: schema.MracTable | schema.L1Table) -> dict[str, Any]:
    """What changes the Lyapunov law of a scheme."""
    settings: dict[str, Any] = {}
    if table.modification is not None:
        settings |= {"leakage": table.modification.leakage(), "dead_zone": table.modification.dead_zone()}
    if table.learning is not None:
        settings["learning"] = table.learning.build()
    return settings


def _known_set(table: schema.UncertaintyTable | None) -> KnownSet | None:
    """[uncertainty]: exactly one of a box and a ball."""
    if table is None:
        return None
    box: dict[str, Any]
    ball: dict[str, Any]
    box, ball = {"lower": table.lower, "upper": table.upper}, {"center": table.center, "radius": table.radius}
    given = {key for key, value in (box | ball).items() if value is not None}
    if given not in ({"lower", "upper"}, {"center", "radius"}):
        got = ", ".join(sorted(given)) or "nothing"
        raise InputError(f"uncertainty must have either lower and upper, or center and radius, got {got}")
    flat: dict[str, Any] = {
        key: np.ravel(value) if isinstance(value, list) else value for key, value in (box | ball).items() if key in given
    }
    return ParameterBox(**flat) if "lower" in given else ParameterBall(**flat)


def _linear(table: schema.LinearTable, known: Known) -> LinearFeedback:
    """The controller that is given, or designed for the problem's known part."""
    if (table.controller is None) == (table.design is None):
        raise InputError('give either controller = { num, den } or design = "hinf" or "pi"')
    if table.bandwidth is not None and table.design != "hinf":
        raise InputError('bandwidth goes with design = "hinf"')
    settings: dict[str, Any] = {"output": table.output, "nominal": table.nominal}
    if table.name is not None:
        settings["name"] = table.name
    if table.controller is not None:
        K = within("controller", lambda: TransferFunction(table.controller.num, table.controller.den))  # type: ignore[union-attr]
        W = None if table.unmodelled_delay is None else delay_weight(table.unmodelled_delay)
        return LinearFeedback(controller=K, unmodelled=W, **settings)
    if table.design == "pi":
        return pi_feedback(known, unmodelled_delay=table.unmodelled_delay, **settings)
    return hinf_feedback(known, unmodelled_delay=table.unmodelled_delay, bandwidth=table.bandwidth, **settings)


def _filter(table: schema.FilterTable) -> TransferFunction | None:
    if table.kappa is not None:
        if table.num is not None or table.den is not None:
            raise InputError("filter: give either kappa or num and den")
        return None if table.kappa == 0 else input_filter(table.kappa)
    if table.num is None or table.den is None:
        raise InputError("filter: give kappa, or both num and den")
    return within("filter", lambda: TransferFunction(np.array(table.num), np.array(table.den)))
