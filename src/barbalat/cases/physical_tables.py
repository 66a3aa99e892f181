"""Formulas of physical parameters in the tables of a case file. They are replaced by their values before anything is checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.judge.settings import Judge
from barbalat.linear.driven_response import driven_response
from barbalat.problem.labels import UNLABELLED, Labels
from barbalat.problem.parameters import Parameter, evaluated, require_parameter_name
from barbalat.problem.physical import PhysicalPlant, names_in
from barbalat.problem.plant import Model, Plant, ReferenceModel
from barbalat.problem.truth import Truth
from barbalat.validate import Array, InputError

Tables = dict[str, Any]
OF_PLANT = ("A", "b", "C", "x0", "input")
"""Keys of [plant] whose texts are formulas."""
OF_TRUTH = (*OF_PLANT, "sensor")
"""Keys of [truth] whose texts are formulas."""
MOTION_INSTANTS = 2000
"""Number of instants at which the model's motion is evaluated for the scales of its states."""


def with_numbers(tables: Tables) -> tuple[Tables, Tables | None]:
    """The tables with each formula replaced by its number, and the original tables if they have parameters or a truth; otherwise
    the unchanged tables, and None.

    The formulas of the plant are evaluated at the nominal parameters, those of the truth at the truth's parameters. Raises
    InputError for an invalid formula, and for parameters if the plant is not given by A and b.
    """
    if "parameters" not in tables and "truth" not in tables:
        return tables, None
    given, plant, truth = tables.get("parameters", {}), tables.get("plant"), tables.get("truth", {})
    if not isinstance(plant, dict) or not isinstance(given, dict) or not isinstance(truth, dict):
        return tables, tables  # rejected when the tables are checked
    if "transfer_function" in plant:
        which = "parameters" if "parameters" in tables else "truth"
        raise InputError.of(
            which, "needs a plant in state space, plant.A and plant.b; plant.transfer_function is simulated directly"
        )
    if given and "A" not in plant:
        raise InputError.of("parameters", "needs plant.A and plant.b with formulas as entries, but plant.A is missing")
    for name in given:
        require_parameter_name(name)
    nominal = {name: _value(value) for name, value in given.items()}
    changed = truth.get("parameters", {})
    own = {name: _value(value) for name, value in changed.items() if name in nominal} if isinstance(changed, dict) else {}
    found = tables | {"plant": _numbers("plant", plant, OF_PLANT, nominal)}
    if "sensor" in tables:
        found["sensor"] = evaluated("sensor", tables["sensor"], nominal)
    if "truth" in tables:
        found["truth"] = _numbers("truth", truth, OF_TRUTH, nominal | own)
    _require_use(given, (plant, tables.get("sensor"), truth))
    return found, tables


def _require_use(given: Mapping[str, Any], parts: Any) -> None:
    """Raise InputError for a parameter with a range that occurs in no formula of these parts."""
    used = names_in(parts)
    for name, one in given.items():
        if name not in used and isinstance(one, dict) and one.keys() & {"between", "tolerance"}:
            raise InputError.of(f"parameters.{name}", "has a range, but occurs in no formula of plant, sensor or truth")


def _value(given: Any) -> float:
    """A parameter's value; 1 for an invalid one, which is rejected when the tables are checked."""
    value = given.get("value") if isinstance(given, dict) else given
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else 1.0


def _numbers(name: str, table: Tables, keys: tuple[str, ...], values: Mapping[str, float]) -> Tables:
    return table | {key: evaluated(f"{name}.{key}", table[key], values) for key in keys if key in table}


def physical_plant(tables: Tables, parameters: Mapping[str, Any]) -> PhysicalPlant:
    """The plant of a case file as formulas; ``tables`` are those of the file, ``parameters`` the checked parameters keyed by
    name."""
    declared = [Parameter(name, **(one if isinstance(one, dict) else {"value": one})) for name, one in parameters.items()]
    plant = tables["plant"]
    more = {key: plant.get(key) for key in ("x0", "input")}
    return PhysicalPlant(A=plant["A"], b=plant.get("b", []), parameters=declared, sensor=tables.get("sensor"), **more)


def with_formulas(truth: Truth, tables: Tables) -> Truth:
    """The truth with the formulas of its table in place of their values, so that it also holds for other values of the
    parameters."""
    given = tables.get("truth", {})
    return replace(truth, **{key: given[key] for key in OF_TRUTH if key in given and any(_texts(given[key]))})


def _texts(part: Any) -> Iterator[str]:
    """The texts in nested lists and tables."""
    if isinstance(part, str):
        yield part
    for inner in part.values() if isinstance(part, dict) else part if isinstance(part, (list, tuple)) else ():
        yield from _texts(inner)


def scale_of_states(
    plant: Plant, model: ReferenceModel, commands: Any, labels: Labels | None, judge: Judge, t_end: float
) -> tuple[Array, str]:
    """The scales whose inverse squares weight the plant's states, and their origin: the judge's bands, or the model's motion."""
    n = plant.states
    names = (labels or UNLABELLED).of_states(n)
    if all(name in judge.follows for name in names):
        return np.array([judge.follows[name] for name in names]), "the bands of judge.follows"
    k_0 = model.gain(plant, names) if plant.baseline is None else plant.baseline.feedforward
    signals = tuple(commands) if isinstance(commands, (list, tuple)) else (commands,)
    if plant.baseline is None:
        model.require_commands(plant, k_0, len(signals))
    A, B, C = Model(plant.A_m, plant.b, k_0, plant.x0, plant.enters, n).matrices
    _, x_m = driven_response(A, B, C, plant.x0, signals, t_end, MOTION_INSTANTS)
    largest = np.abs(x_m).max(axis=0)
    moves = largest > 1e-9 * largest.max(initial=0.0)
    said = "the largest motions of the reference model" + ("" if moves.all() else ", or 1 for states that it does not move")
    return np.where(moves, largest, 1.0), said
