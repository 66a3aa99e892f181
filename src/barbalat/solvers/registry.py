"""The registry of solvers, by the names that case files use. The contract tests run over it."""

from __future__ import annotations

from typing import Any

from barbalat.solvers.tableau import EULER, HEUN, RK4, Tableau
from barbalat.validate import InputError, hint, is_instance, show

SOLVERS = {tableau.name: tableau for tableau in (EULER, HEUN, RK4)}
"""The methods of the package by the names that case files use."""


def solver_of(field: str, given: Any) -> Tableau:
    """A method, given itself or by its name; InputError names the field."""
    if isinstance(given, str) and given in SOLVERS:
        return SOLVERS[given]
    if is_instance(given, Tableau):
        return given  # type: ignore[no-any-return]
    meant = hint(given, SOLVERS) if isinstance(given, str) else ""
    raise InputError.of(field, f"must be one of {', '.join(SOLVERS)}, or a Tableau, got {show(given)}{meant}")
