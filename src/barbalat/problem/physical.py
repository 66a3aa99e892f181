"""Plants in physical parameters, whose matrices have numbers or formulas of parameters with ranges as entries."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.parameters import NAMES, Parameter, Symbolic, evaluated
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, freeze


@dataclass(frozen=True, eq=False)
class PhysicalPlant(Settings):
    """x' = A x + b (u + d), with entries that are numbers or formulas of physical parameters.

    A           n rows of n entries, each a number, a formula as text, or an expression of ``Parameter`` objects, such as -k/J
    b           n entries, or n rows of m for m inputs
    parameters  the parameters that occur in formulas as text; those in expressions are found there
    x0          initial state, n entries; zero by default
    input       keywords of PlantInput, in which any number may be a formula: dict(gain=..., delay=..., actuator=dict(num=,
                den=)); with several inputs, one set for all inputs, or a list
    sensor      keywords of Sensor in the same form: dict(lag=..., noise=dict(std=..., sample_time=...))

    Raises InputError for unknown names and for formulas without a finite value at the nominal parameters.
    """

    A: Sequence[Sequence[Any]]
    b: Sequence[Any]
    parameters: Sequence[Parameter] = ()
    x0: Sequence[Any] | None = None
    input: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None
    sensor: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        found: dict[str, Parameter] = {}
        for one in (*self.parameters, *_parameters_in((self.A, self.b, self.x0, self.input, self.sensor))):
            validate.instance("parameters", one, Parameter)
            if found.setdefault(one.name, one) is not one:
                raise InputError.of("parameters", f"must have distinct names, but {one.name} is given twice")
        freeze(self, A=_listed(self.A), b=_listed(self.b), parameters=tuple(found.values()))
        self.matrices(self.nominal)

    @cached_property
    def nominal(self) -> dict[str, float]:
        """The parameters' values, keyed by name."""
        return {one.name: one.value for one in self.parameters}

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The smallest and the largest value of each parameter, keyed by name."""
        return {one.name: one.range for one in self.parameters}

    def with_values(self, changed: Mapping[str, float]) -> dict[str, float]:
        """Return the values of all parameters, with some changed from nominal. Raises InputError for an unknown name."""
        for name in changed:
            if name not in self.nominal:
                known = ", ".join(self.nominal) or "none"
                hint = validate.hint(name, self.nominal)
                raise InputError.of(
                    "truth.parameters", f"names {name}, which is not a parameter; the parameters are {known}{hint}"
                )
        numbers = {name: validate.number(f"truth.parameters.{name}", value) for name, value in changed.items()}
        return self.nominal | numbers

    def matrices(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return A (n, n) and b, (n,) or (n, m), at these values."""
        A = validate.square_matrix("plant.A", evaluated("plant.A", self.A, values))
        return A, input_matrix("plant.b", evaluated("plant.b", self.b, values), len(A))

    def initial(self, values: Mapping[str, float]) -> Any:
        """Return x0 at these values; None if none is given."""
        return None if self.x0 is None else evaluated("plant.x0", list(self.x0), values)

    def inputs(self, values: Mapping[str, float]) -> Any:
        """Return the path before each input at these values: None, a PlantInput, or a list of them."""
        return None if self.input is None else inputs_at("plant.input", self.input, values)

    def sensing(self, values: Mapping[str, float]) -> Sensor | None:
        """Return the sensor at these values."""
        return None if self.sensor is None else sensor_at("sensor", self.sensor, values)

    def around(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return everything except A, b and the input gains at these values, keyed by its path in a case file."""
        several = isinstance(self.input, (list, tuple))
        inputs: Sequence[Any] = self.input if isinstance(self.input, (list, tuple)) else [self.input or {}]
        given = {f"plant.input[{i}]" if several else "plant.input": one for i, one in enumerate(inputs)}
        parts = {f"{name}.{key}": part for name, one in given.items() for key, part in one.items() if key != "gain"}
        parts |= {f"sensor.{key}": part for key, part in (self.sensor or {}).items()}
        return {name: evaluated(name, part, values) for name, part in (parts | {"plant.x0": self.x0}).items()}

    def gains(self, inputs: int) -> list[Any]:
        """Return the effectiveness of each input, as a number or formula."""
        several: Sequence[Any] = self.input if isinstance(self.input, (list, tuple)) else [self.input or {}] * inputs
        return [one.get("gain", 1.0) for one in several]


def inputs_at(field: str, given: Any, values: Mapping[str, float]) -> Any:
    """Return the path before each input at these values of the parameters, from keywords of PlantInput, one set or a list."""
    several = isinstance(given, (list, tuple))
    found = [_input(evaluated(field, one, values)) for one in (given if several else (given,))]
    return found if several else found[0]


def sensor_at(field: str, given: Mapping[str, Any], values: Mapping[str, float]) -> Sensor:
    """Return the sensor at these values of the parameters, from keywords of Sensor."""
    found = evaluated(field, given, values)
    noise = found.get("noise")
    return Sensor(**{**found, "noise": Noise(**noise) if isinstance(noise, dict) else noise})


def _input(given: dict[str, Any]) -> PlantInput:
    parts = {
        name: TransferFunction(**given[name]) for name in ("actuator", "multiplicative") if isinstance(given.get(name), dict)
    }
    return PlantInput(**(given | parts))


def _listed(entries: Any) -> Any:
    """Return an array's entries as lists."""
    return entries.tolist() if isinstance(entries, np.ndarray) else entries


def _parameters_in(part: Any) -> Iterator[Parameter]:
    if isinstance(part, Symbolic):
        yield from part.parameters.values()
    entries = _listed(part)
    for inner in entries.values() if isinstance(entries, Mapping) else entries if isinstance(entries, (list, tuple)) else ():
        yield from _parameters_in(inner)


def names_in(part: Any) -> set[str]:
    """Return the names in the formulas (text or expressions) of nested lists and dictionaries, including the names of
    functions."""
    if isinstance(part, Symbolic):
        return set(part.parameters)
    if isinstance(part, str):
        return set(re.findall(NAMES, part))
    entries = _listed(part)
    inner = entries.values() if isinstance(entries, Mapping) else entries if isinstance(entries, (list, tuple)) else ()
    return {name for one in inner for name in names_in(one)}


def holds_formulas(part: Any) -> bool:
    """Return whether nested lists and dictionaries contain an expression of parameters."""
    return next(_parameters_in(part), None) is not None


def input_matrix(field: str, b: Any, n: int) -> Array:
    """Return b as (n,), or (n, m) for m > 1 inputs."""
    if validate.dimensions(b) != 2:
        return validate.vector(field, b, n)
    matrix = validate.array(field, b, (n, None))
    return validate.vector(field, matrix[:, 0], n) if matrix.shape[1] == 1 else matrix


def projection(b: Array, scale: Array) -> Array:
    """Return (b'W b)^-1 b'W (m, n) with W = diag(1/scale^2). theta = projection (A - A_m) leaves the smallest remainder in that
    norm."""
    weighted = (b / np.square(scale).reshape(-1, *[1] * (b.ndim - 1))).reshape(len(scale), -1).T
    return np.asarray(np.linalg.solve(weighted @ b.reshape(len(scale), -1), weighted))


def projected(A: Array, A_m: Array, b: Array, scale: Array) -> Array:
    """Return theta (n m,) of the weighted projection of A - A_m."""
    return (projection(b, scale) @ (A - A_m)).T.reshape(-1)


MATCHED_TO, LEAST_ROUNDING = 1e-9, 1e-13
"""An entry of an unmatched remainder counts as rounding if it is below the first fraction of the numbers from which it is
computed, or below the second fraction of the largest number."""


def rounding_of_rest(sizes: Array, b: Array, g: Array) -> Array:
    """Return the size (n, k) up to which the entries of D - b g D are rounding errors, with b (n, m) and g (m, n). D has entries
    of these ``sizes`` (n, k), or is a difference of such numbers. The result does not depend on the units of states and input."""
    return np.asarray(MATCHED_TO * (sizes + np.abs(b) @ (np.abs(g) @ sizes)) + LEAST_ROUNDING * sizes.max())
