"""From the checked tables of an output-feedback case to the objects of the Python API."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barbalat.cases import output_tables as tables
from barbalat.cases.parts import Case, assembled, bound_and_sampled, sensor, signal, simulation
from barbalat.cases.plant import one_input, within
from barbalat.cases.plant_tables import TransferFunctionTable
from barbalat.controllers.output.l1 import L1Output, fast_limit, linear_equivalent
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.mrac import MracOutput
from barbalat.design import mixed_sensitivity, pi_controller
from barbalat.linear.systems import TransferFunction, strictly_proper
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.output_plant import OutputPlant, OutputReferenceModel
from barbalat.protocols import Controller
from barbalat.validate import InputError


def build_output(table: tables.OutputCaseTable, folder: Path) -> Case:
    """Everything validated, controllers bound once; ``folder`` is where relative paths start."""
    plant, disturbance, at_output = table.plant, table.plant.disturbance, table.plant.output_disturbance
    problem = OutputProblem(
        plant=OutputPlant(
            transfer_function=system("plant.transfer_function", plant.transfer_function),
            nonlinear=plant.nonlinear,
            input=None if plant.input is None else one_input(plant.input),
        ),
        reference_model=OutputReferenceModel(
            transfer_function=system("reference_model.transfer_function", table.reference_model.transfer_function)
        ),
        reference=within("reference", lambda: signal(table.reference, folder)),
        disturbance=None if disturbance is None else within("plant.disturbance", lambda: signal(disturbance, folder)),
        output_disturbance=None if at_output is None else within("plant.output_disturbance", lambda: signal(at_output, folder)),
        sensor=None if table.sensor is None else sensor(table.sensor),
        name=table.name,
    )
    controllers = []
    for i, settings in enumerate(table.controller, start=1):
        where = f"controller {i} ({settings.name or settings.scheme})"
        controllers.append(
            within(where, lambda settings=settings: bound_and_sampled(_controller(settings, problem, table), settings, problem))  # type: ignore[misc]
        )
    return assembled(problem, controllers, simulation(table.simulation))


def system(field: str, table: TransferFunctionTable) -> TransferFunction:
    """A transfer function; an InputError names the field."""
    return within(field, lambda: TransferFunction(table.num, table.den))


def _controller(table: tables.OutputSchemeTable, problem: OutputProblem, case: tables.OutputCaseTable) -> Controller:
    name: dict[str, Any] = {} if table.name is None else {"name": table.name}
    match table:
        case tables.MracOutputTable():
            keys = ("order", "relative_degree", "sign", "theta_hat0", "tau", "filter_poles", "saturated_predictor")
            settings = {key: getattr(table, key) for key in (*keys, *_bounds(table))}
            return MracOutput(law=table.built_law(), normalization=table.normalization.build(), **settings, **name)
        case tables.L1OutputTable():
            return _l1(table, name)
    return _equivalent(table, case, name) if table.equivalent_of is not None else _linear(table, problem, name)


def _l1(table: tables.L1OutputTable, name: dict[str, Any]) -> L1Output:
    if table.projection and table.sigma_bound is None:
        raise InputError("projection needs sigma_bound")
    return L1Output(
        m=table.m,
        gamma=table.gamma,
        filter=system("filter", table.filter),
        sigma_bound=None if table.projection is False else table.sigma_bound,
        lipschitz=table.lipschitz,
        design_plant=None if table.design_plant is None else system("design_plant", table.design_plant),
        **name,
    )


def _equivalent(table: tables.LinearOutputTable, case: tables.OutputCaseTable, name: dict[str, Any]) -> LinearOutput:
    """What an l1-output controller of the case is inside the bounds of sigma; with ``limit`` for gamma -> infinity."""
    if further := table.model_fields_set - {"scheme", "name", "equivalent_of", "limit", "sample_time", "discretization"}:
        raise InputError(f"{min(further)} does not go with equivalent_of")
    others = {other.name or L1Output.name: other for other in case.controller if isinstance(other, tables.L1OutputTable)}
    if table.equivalent_of not in others:
        known = ", ".join(repr(other) for other in others) or "none"
        raise InputError(f"equivalent_of must name an l1-output controller of this case ({known}), got {table.equivalent_of!r}")
    build = fast_limit if table.limit else linear_equivalent
    same = build(_l1(others[table.equivalent_of], {}))
    return LinearOutput(loop=same.feedback, feedforward=same.feedforward, **name)


def _bounds(table: tables.MracOutputTable) -> tuple[str, ...]:
    """The keys of the known set that are in force."""
    lyapunov = table.law.kind == "lyapunov"
    if lyapunov and "normalization" in table.model_fields_set:
        raise InputError('normalization goes with a law on the parametric model; law.kind = "lyapunov" is unnormalised')
    if table.projection and table.lower is None and table.upper is None and table.c_0_min is None:
        raise InputError("projection needs lower and upper, or c_0_min")
    if table.projection is False and not lyapunov:
        raise InputError(
            "projection must stay on for a law on the parametric model: it keeps c_0 from zero; "
            "with c_0_min alone nothing else is projected"
        )
    return () if table.projection is False else ("lower", "upper", "c_0_min")


def _linear(table: tables.LinearOutputTable, problem: OutputProblem, name: dict[str, Any]) -> LinearOutput:
    if table.limit:
        raise InputError("limit goes with equivalent_of")
    if (table.controller is None) == (table.design is None):
        raise InputError('give either controller = { num, den } or design = "hinf" or "pi"')
    if table.controller is not None:
        if table.design_plant is not None or table.unmodelled_delay is not None or table.bandwidth is not None:
            raise InputError("design_plant, unmodelled_delay and bandwidth go with design")
        F = None if table.feedforward is None else system("feedforward", table.feedforward)
        return LinearOutput(loop=system("controller", table.controller), feedforward=F, **name)
    if table.unmodelled_delay is None:
        raise InputError(f'unmodelled_delay is missing; design = "{table.design}" needs it')
    if table.feedforward is not None:
        raise InputError("feedforward goes with controller")
    given = table.design_plant
    model = problem.plant.transfer_function if given is None else strictly_proper("design_plant", system("design_plant", given))
    if table.design == "pi":
        if table.bandwidth is not None:
            raise InputError('bandwidth goes with design = "hinf"')
        return LinearOutput(loop=pi_controller(model, table.unmodelled_delay), **name)
    designed = mixed_sensitivity(model, table.unmodelled_delay, table.bandwidth)
    return LinearOutput(loop=designed.controller.transfer_function(), **name)
