"""A requirement on every member, such as ``max_abs_e[0] < 2``: a metric, a comparison and a number."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.validate import Array, InputError

COMPARISONS: dict[str, Callable[[Array, float], Array]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_FORM = re.compile(r"\s*(?P<figure>[^<>=]*?)\s*(?P<sign><=|>=|<|>)\s*(?P<limit>[^<>=]+?)\s*$")


@dataclass(frozen=True)
class Requirement:
    """A requirement. ``figure`` may name one controller, as in ``L1/max_abs_e[0]``, or apply to all; without brackets it refers
    to all components."""

    figure: str
    sign: str
    limit: float

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Parse a requirement; raises InputError for an invalid text."""
        found = _FORM.match(text)
        limit = None if found is None else _number(found["limit"])
        if found is None or not found["figure"] or limit is None:
            raise InputError(
                f'a requirement must be METRIC, then one of < <= > >=, then NUMBER, such as "max_abs_e[0] < 2"; got {text!r}'
            )
        return cls(found["figure"], found["sign"], limit)

    def __str__(self) -> str:
        return f"{self.figure} {self.sign} {self.limit:g}"

    def columns(self, names: list[str], controller: str) -> list[str]:
        """The columns of a controller to which the requirement applies; none if it is about a different controller."""
        own = [name for name in names if name.startswith(f"{controller}/")]
        figure = self.figure.removeprefix(f"{controller}/")
        return [name for name in own if name.removeprefix(f"{controller}/").split("[")[0] == figure] or [
            name for name in own if name == f"{controller}/{figure}"
        ]

    def require_known(self, names: list[str], controllers: tuple[str, ...]) -> None:
        """Raise InputError if no controller has the metric."""
        if not any(self.columns(names, controller) for controller in controllers):
            figures = sorted({name.split("/", 1)[1] for name in names if "/" in name})
            raise InputError(
                f"the requirement {validate.show(str(self))} does not name a metric; choose one of {', '.join(figures)}"
            )

    def broken(self, values: Array) -> Array:
        """(M,) whether a column violates the requirement; a metric that is missing because of divergence violates it."""
        with np.errstate(invalid="ignore"):
            return np.asarray(~COMPARISONS[self.sign](values, self.limit))


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None
