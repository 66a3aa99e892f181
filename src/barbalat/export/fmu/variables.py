"""The variables of a unit, as both versions of the standard describe them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from barbalat.export.acceptance import numbers
from barbalat.export.parameters import Opened, Parameter


@dataclass(frozen=True)
class Variable:
    """One scalar.

    name         structured: "theta_hat[1]", "plant.x[2]"
    causality    "input", "output", "parameter", "local"
    variability  "discrete", "continuous", "tunable", "fixed"
    start        None for a calculated variable
    kind         "real", "truth" or "whole"
    path         its place in the case's symbols, "x[1]", if the name differs; else empty
    bounds       bounds on the parameter, if they depend on no other parameter: "> 0", "< 1"
    """

    name: str
    causality: str
    variability: str
    meaning: str
    start: float | None = None
    unit: str = ""
    kind: str = "real"
    path: str = ""
    bounds: tuple[str, ...] = ()

    @property
    def settable(self) -> str:
        """When a real variable may be set, for ``fmu_instance.h``: i: always, to any value; t: always; s: before the start; n:
        never. T and S are t and s for positive numbers only.
        """
        if self.causality == "input":
            return "i"
        found = {"tunable": "t", "fixed": "s"}.get(self.variability, "n") if self.causality == "parameter" else "n"
        return found.upper() if "> 0" in self.bounds and found != "n" else found


@dataclass(frozen=True)
class Variables:
    """All variables of a unit: first the real variables, then the independent variable, then the others; their references
    increase in this order."""

    reals: tuple[Variable, ...]
    wholes: tuple[Variable, ...]

    def place(self, name: str) -> int:
        """The variable's index among the real variables."""
        return next(i for i, one in enumerate(self.reals) if name in (one.name, one.path))

    @property
    def time(self) -> int:
        """The value reference of the independent variable."""
        return len(self.reals)

    @property
    def by_reference(self) -> tuple[tuple[int, Variable], ...]:
        """All variables except the independent one."""
        return (*enumerate(self.reals), *enumerate(self.wholes, self.time + 1))

    @property
    def units(self) -> tuple[str, ...]:
        """The units that are used, without duplicates."""
        return tuple(dict.fromkeys(["s", *(one.unit for one in self.reals if one.unit)]))


def entries(name: str, count: int, *, scalar: bool = False) -> list[str]:
    """The names of the entries of an array; for a scalar, its name."""
    return [name] if scalar else [f"{name}[{i + 1}]" for i in range(count)]


def array(
    name: str,
    causality: str,
    variability: str,
    meaning: str,
    starts: Iterable[float | None],
    *,
    scalar: bool = False,
    units: tuple[str, ...] = (),
) -> list[Variable]:
    """The entries of an array."""
    values = list(starts)
    given = units if len(units) == len(values) else ("",) * len(values)
    names = entries(name, len(values), scalar=scalar)
    return [
        Variable(*one) for one in zip(names, *_same(len(values), causality, variability, meaning), values, given, strict=True)
    ]


def _same(count: int, *values: str) -> list[list[str]]:
    return [[value] * count for value in values]


def parameters(
    found: Iterable[Parameter], fixed: Iterable[Parameter], opened: Opened, units: Sequence[str] = ()
) -> list[Variable]:
    """A variable for each parameter; initial values of states do not change after the start. Limits of u have the ``units`` of
    the inputs."""
    begun, made = set(fixed), []
    for one in found:
        i = opened.parameters.index(one)
        alone = (condition for condition in opened.conditions if numbers(condition) == {i})
        bounds = tuple(condition.of_number(i, lambda entry: f"{entry!r}" if entry else "0") for condition in alone)
        variability = "fixed" if one in begun else "tunable"
        unit = units[one.limit[0]] if one.limit is not None and units else ""
        made.append(Variable(one.name, "parameter", variability, one.meaning, one.value, unit, bounds=bounds))
    return made


def require_distinct(variables: Variables) -> Variables:
    """Raise InputError for two variables with the same name, because a user's scheme may have states with any name."""
    names = sorted(one.name for _, one in variables.by_reference)
    same = [a for a, b in pairwise(names) if a == b]
    assert not same, same
    return variables
