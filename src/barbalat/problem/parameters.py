"""Physical parameters, which have a value and a range, and expressions of parameters, which are formulas in case files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.problem.formulas import FUNCTION_NAMES, Formula, FormulaNames, formula
from barbalat.settings import Settings
from barbalat.validate import InputError, Vector, freeze

NAMES = r"[A-Za-z_][A-Za-z0-9_]*"
"""Pattern of the admissible names of a parameter."""
DISTRIBUTIONS = ("uniform", "loguniform", "normal")
"""The distributions of a parameter in a study."""


class Symbolic:
    """An operand whose arithmetic gives an ``Expression``."""

    text: str
    parameters: Mapping[str, Parameter]

    def _with(self, other: Any, pattern: str) -> Expression:
        if isinstance(other, Symbolic):
            return Expression(pattern.format(self.text, other.text), {**self.parameters, **other.parameters})
        return Expression(pattern.format(self.text, repr(validate.number("a number in an expression", other))), self.parameters)

    def _of(self, function: str) -> Expression:
        return Expression(f"{function}({self.text})", self.parameters)

    def __add__(self, other: Any) -> Expression:
        return self._with(other, "({} + {})")

    def __radd__(self, other: Any) -> Expression:
        return self._with(other, "({1} + {0})")

    def __sub__(self, other: Any) -> Expression:
        return self._with(other, "({} - {})")

    def __rsub__(self, other: Any) -> Expression:
        return self._with(other, "({1} - {0})")

    def __mul__(self, other: Any) -> Expression:
        return self._with(other, "({} * {})")

    def __rmul__(self, other: Any) -> Expression:
        return self._with(other, "({1} * {0})")

    def __truediv__(self, other: Any) -> Expression:
        return self._with(other, "({} / {})")

    def __rtruediv__(self, other: Any) -> Expression:
        return self._with(other, "({1} / {0})")

    def __pow__(self, exponent: float) -> Expression:
        power = validate.number("an exponent", exponent)
        raised = f"({self.text} ** {abs(power)!r})"
        return Expression(f"(1 / {raised})" if power < 0 else raised, self.parameters)

    def __rpow__(self, base: float) -> Expression:
        number = validate.positive("the base of a power", base)
        return Expression(f"exp({math.log(number)!r} * {self.text})", self.parameters)

    def __pos__(self) -> Symbolic:
        return self

    def __neg__(self) -> Expression:
        return Expression(f"(-{self.text})", self.parameters)

    def __abs__(self) -> Expression:
        return self._of("abs")

    def exp(self) -> Expression:
        """Return the result of ``np.exp``. NumPy calls the method with the function's name."""
        return self._of("exp")

    def sin(self) -> Expression:
        """The result of ``np.sin``."""
        return self._of("sin")

    def cos(self) -> Expression:
        """The result of ``np.cos``."""
        return self._of("cos")

    def sqrt(self) -> Expression:
        """The result of ``np.sqrt``."""
        return self._of("sqrt")

    def tanh(self) -> Expression:
        """The result of ``np.tanh``."""
        return self._of("tanh")


@dataclass(frozen=True, eq=False)
class Expression(Symbolic):
    """A formula in physical parameters, together with these parameters."""

    text: str
    parameters: Mapping[str, Parameter]

    def __repr__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False)
class Parameter(Symbolic, Settings):
    """A physical parameter. Arithmetic with it, such as k/J, makes formulas for the entries of a ``PhysicalPlant``.

    name          letters, digits and underscores, as in the formulas
    value         the nominal value, for which controllers are designed
    between       [lower, upper], which contains the value; without ``between`` and ``tolerance`` the parameter is known exactly
    tolerance     instead of ``between``: the range is value (1 - tolerance) to value (1 + tolerance), 0 < tolerance < 1
    unit          such as "N m/rad"
    distribution  in studies, over the range: "uniform", "loguniform", or "normal", which is centred in the range and truncated at
                  its ends, with half of the range as three standard deviations
    """

    name: str
    value: float
    _: KW_ONLY
    between: Vector | None = None
    tolerance: float | None = None
    unit: str = ""
    distribution: str = "uniform"

    def __post_init__(self) -> None:
        require_parameter_name(self.name)
        place = f"parameters.{self.name}"
        freeze(self, value=validate.number(f"{place}.value", self.value), unit=validate.line(f"{place}.unit", self.unit))
        if self.between is not None and self.tolerance is not None:
            raise InputError.of(f"{place}.tolerance", "and between are both given; give one of them")
        if self.tolerance is not None:
            freeze(self, tolerance=validate.positive(f"{place}.tolerance", self.tolerance))
            if self.tolerance >= 1:
                raise InputError.of(f"{place}.tolerance", f"is relative to the value and must be below 1, got {self.tolerance:g}")
            if self.value == 0:
                raise InputError.of(f"{place}.tolerance", "is relative to the value, which is 0: give between = [lower, upper]")
        if self.between is not None:
            low, high = validate.vector(f"{place}.between", self.between, 2)
            if not low <= self.value <= high:
                raise InputError.of(
                    f"{place}.between", f"must contain the value, {self.value:g}, got {validate.show(self.between)}"
                )
            if not math.isfinite(float(high) - float(low)):
                raise InputError.of(
                    f"{place}.between",
                    f"must have a width that is representable in double precision, got {validate.show(self.between)}",
                )
            freeze(self, between=(float(low), float(high)))
        if self.distribution not in DISTRIBUTIONS:
            known = ", ".join(DISTRIBUTIONS)
            raise InputError.of(f"{place}.distribution", f"must be one of {known}, got {validate.show(self.distribution)}")
        if self.distribution == "loguniform" and self.range[0] <= 0:
            raise InputError.of(f"{place}.distribution", f"cannot be loguniform for a range that starts at {self.range[0]:g}")

    @property
    def text(self) -> str:  # type: ignore[override]
        return self.name

    @property
    def parameters(self) -> Mapping[str, Parameter]:  # type: ignore[override]
        return {self.name: self}

    @property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest value."""
        if self.between is not None:
            return self.between  # type: ignore[no-any-return]
        reach = abs(self.value) * (self.tolerance or 0.0)
        return self.value - reach, self.value + reach

    @property
    def is_exact(self) -> bool:
        return self.range[0] == self.range[1]


def require_parameter_name(name: object) -> None:
    """Raise InputError for a name that cannot be used in a formula."""
    import re

    if not isinstance(name, str) or not re.fullmatch(NAMES, name) or name in FUNCTION_NAMES:
        raise InputError.of(
            "parameters",
            f"must have names that consist of letters, digits and underscores and are not names of functions, got "
            f"{validate.show(name)}",
        )


def parsed(field: str, text: str | Symbolic, known: Sequence[str]) -> Formula:
    """Parse a formula of parameters. Raises InputError, with the field, if it is not a formula or contains names that are not
    ``known``."""
    shown = f"the parameters ({', '.join(known)})" if known else "parameters (the case has none)"
    found = formula(field, text.text if isinstance(text, Symbolic) else text, FormulaNames(NAMES, shown))
    there = f"the parameters are {', '.join(known)}" if known else "there are none"
    for name in sorted(found.names - set(known)):
        raise InputError.of(field, f"uses {name}, which is not a parameter; {there}{validate.hint(name, known)}")
    return found


def evaluated(field: str, part: Any, values: Mapping[str, float]) -> Any:
    """Return ``part`` with every text, which is a formula, replaced by its number for these values. Raises InputError, with the
    field, for a text that is not a formula or has no finite real value at these values.
    """
    if isinstance(part, dict):
        return {key: evaluated(f"{field}.{key}", value, values) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return [evaluated(f"{field}[{i}]", value, values) for i, value in enumerate(part)]
    if not isinstance(part, (str, Symbolic)):
        return part
    found = parsed(field, part, list(values))
    try:
        with np.errstate(all="ignore"):
            number = found.evaluate(values)
    except (ArithmeticError, ValueError):
        number = np.nan
    if isinstance(number, complex) or not np.isfinite(number):
        at = ", ".join(f"{name} = {values[name]:g}" for name in sorted(found.names))
        shown = part.text if isinstance(part, Symbolic) else part
        raise InputError.of(field, f"= {validate.show(shown)} has no finite value at {at}")
    return float(number)
