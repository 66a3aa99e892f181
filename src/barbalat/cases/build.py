"""From the checked tables of a case file to the objects of the Python API."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barbalat import validate
from barbalat.adaptation.laws import Gradient
from barbalat.cases import plant_tables, schema
from barbalat.cases.parts import Case, assembled, bound_and_sampled, low_pass, sensor, signal, simulation
from barbalat.cases.plant import build_plant, within
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac
from barbalat.controllers.windup import ModifiedError
from barbalat.design import delay_weight, hinf_feedback, pi_feedback
from barbalat.linear.systems import TransferFunction
from barbalat.problem.known_set import KnownSet, ParameterBall, ParameterBox
from barbalat.problem.plant import ReferenceModel
from barbalat.problem.state_feedback import Known, Problem
from barbalat.problem.tracking import Disturbance
from barbalat.protocols import Controller, Signal
from barbalat.validate import InputError


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
        else within("plant.disturbance", lambda: signal(table.plant.disturbance, folder)),
        unmatched=tuple(_unmatched(i, given, folder) for i, given in enumerate(table.plant.unmatched, start=1)),
        sensor=None if table.sensor is None else sensor(table.sensor),
        name=table.name,
    )
    controllers = []
    for i, settings in enumerate(table.controller, start=1):
        where = f"controller {i} ({settings.name or settings.scheme})"
        controllers.append(within(where, lambda settings=settings: _bound(settings, problem)))  # type: ignore[misc]
    return assembled(problem, controllers, simulation(table.simulation))


def _commands(table: schema.CaseTable, folder: Path) -> Signal | tuple[Signal, ...]:
    given = table.reference
    if not isinstance(given, list):
        return within("reference", lambda: signal(given, folder))
    return tuple(within(f"reference {i}", lambda one=one: signal(one, folder)) for i, one in enumerate(given, start=1))  # type: ignore[misc]


def _unmatched(i: int, table: plant_tables.UnmatchedTable, folder: Path) -> Disturbance:
    given = within(f"plant.unmatched {i}", lambda: signal(table.signal, folder))
    return within(f"plant.unmatched {i}", lambda: Disturbance(direction=table.direction, signal=given))


def _bound(table: schema.SchemeTable, problem: Problem) -> Controller:
    """The controller, after it was bound to the problem once to see that the two fit."""
    controller = _linear(table, problem.known) if isinstance(table, schema.LinearTable) else _controller(table)
    return bound_and_sampled(controller, table, problem)


def _controller(table: schema.SchemeTable) -> Controller:
    match table:
        case schema.MracTable():
            remedy = None if table.modified_error is None else ModifiedError(**dict(table.modified_error))
            return Mrac(gamma=table.gamma, modified_error=remedy, **_modifications(table), **table.common())
        case schema.L1Table():
            settings: dict[str, Any] = {"gamma": table.gamma, "saturated_predictor": table.saturated_predictor}
            return L1Adaptive(filter=low_pass(table.filter), **settings, **_modifications(table), **table.common())
        case schema.NormalizedMracTable():
            if (table.law is None) == (table.gamma is None):
                raise InputError("give either gamma, for the gradient law, or law")
            law = Gradient(gamma=table.gamma) if table.law is None else table.law.build()
            return NormalizedMrac(
                law=law,
                c_0=table.c_0,
                normalization=table.normalization.build(),
                saturated_predictor=table.saturated_predictor,
                **table.common(),
            )
        case schema.RobustMracTable():
            return RobustMrac(
                tau=table.tau,
                law=table.law.build(),
                c_0=table.c_0,
                normalization=table.normalization.build(),
                saturated_predictor=table.saturated_predictor,
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


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def _known_set(table: plant_tables.UncertaintyTable | None) -> KnownSet | None:
    """[uncertainty]: exactly one of a box and a ball, or only the input gains."""
    if table is None:
        return None
    box: dict[str, Any]
    ball: dict[str, Any]
    box, ball = {"lower": table.lower, "upper": table.upper}, {"center": table.center, "radius": table.radius}
    given = {key for key, value in (box | ball).items() if value is not None}
    if not given and table.input_gain is not None:
        return None
    if given not in ({"lower", "upper"}, {"center", "radius"}):
        got = ", ".join(sorted(given)) or "nothing"
        raise InputError(f"uncertainty must have either lower and upper, or center and radius, got {got}")
    flat: dict[str, Any] = {
        key: validate.array(f"uncertainty.{key}", value, (None, None)).reshape(-1) if _is_matrix(value) else value
        for key, value in (box | ball).items()
        if key in given
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
