"""From the case file's plant tables to a Plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from barbalat.cases import plant_tables, schema
from barbalat.cases.tables import Table
from barbalat.design.pole_placement import place
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.plant import Plant
from barbalat.problem.regressors import GaussianRBF, Linear, Polynomial, Regressor, Terms
from barbalat.validate import InputError

T = TypeVar("T")


def within(where: str, make: Callable[[], T]) -> T:
    """Run ``make``; an InputError gets the place in front of its sentence."""
    try:
        return make()
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def build_plant(table: schema.CaseTable) -> Plant:
    """The plant, given by A_m and theta, or by A with the model's A_m or poles."""
    plant, model = table.plant, table.reference_model
    given: dict[str, Any] = {"b": plant.b, "x0": plant.x0, "input": _plant_input(plant.input)}
    if plant.A is None:
        if plant.A_m is None:
            raise InputError("plant.A_m is missing (or give plant.A together with reference_model.A_m or .poles)")
        if plant.theta is None:
            raise InputError("plant.theta is missing")
        if model.poles is not None:
            raise InputError("reference_model.poles goes with plant.A, which is missing")
        if model.A_m is not None and model.A_m != plant.A_m:
            raise InputError("reference_model.A_m differs from plant.A_m; give one of them, or plant.A with reference_model.A_m")
        return Plant(A_m=plant.A_m, theta=plant.theta, regressor=_regressor(plant.regressor), **given)
    if plant.A_m is not None:
        raise InputError("plant.A and plant.A_m are both given; plant.A goes with reference_model.A_m")
    if plant.theta is not None:
        raise InputError("plant.A and plant.theta are both given; theta follows from plant.A and reference_model.A_m")
    if plant.regressor is not None:
        raise InputError("plant.A and plant.regressor are both given; with plant.A the regressor is the state")
    if (model.A_m is None) == (model.poles is None):
        raise InputError("give either reference_model.A_m or reference_model.poles with plant.A")
    A_m = model.A_m if model.poles is None else place(plant.A, plant.b, model.poles)
    return Plant.matched(A=plant.A, A_m=A_m, **given)


def _regressor(table: Table | None) -> Regressor:
    match table:
        case None:
            return Linear()
        case plant_tables.PolynomialTable():
            return Polynomial(degree=table.degree, constant=table.constant)
        case plant_tables.GaussianTable():
            return GaussianRBF(centers=table.centers, width=table.width)
        case plant_tables.TermsTable():
            return Terms(terms=tuple(table.terms))
    raise AssertionError(f"the schema has a regressor that is not built here: {type(table).__name__}")


def _plant_input(
    table: plant_tables.InputTable | list[plant_tables.InputTable] | None,
) -> PlantInput | tuple[PlantInput, ...] | None:
    if table is None:
        return None
    return tuple(one_input(one) for one in table) if isinstance(table, list) else one_input(table)


def one_input(table: plant_tables.InputTable) -> PlantInput:
    """[plant.input], for one input."""

    def system(name: str, given: plant_tables.TransferFunctionTable | None) -> TransferFunction | None:
        return None if given is None else within(f"plant.input.{name}", lambda: TransferFunction(given.num, given.den))

    return PlantInput(
        quantization=table.quantization,
        saturation=table.saturation,
        rate_limit=table.rate_limit,
        gain=table.gain,
        actuator=system("actuator", table.actuator),
        multiplicative=system("multiplicative", table.multiplicative),
        delay=table.delay,
        history=table.history,
    )
