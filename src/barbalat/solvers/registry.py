"""The registry of solvers. The contract tests cover all of them."""

from __future__ import annotations

from typing import Any

from barbalat.solvers.tableau import EULER, HEUN, RK4, Tableau
from barbalat.validate import InputError, hint, is_instance, show

SOLVERS = {tableau.name: tableau for tableau in (EULER, HEUN, RK4)}
"""The methods by their names in case files."""


def solver_of(field: str, given: Any) -> Tableau:
    """The method for a tableau or a name; InputError names the field."""
    if isinstance(given, str) and given in SOLVERS:
        return SOLVERS[given]
    if is_instance(given, Tableau):
        return given  # type: ignore[no-any-return]
    meant = hint(given, SOLVERS) if isinstance(given, str) else ""
    raise InputError.of(field, f"must be one of {', '.join(SOLVERS)}, or a Tableau, got {show(given)}{meant}")
