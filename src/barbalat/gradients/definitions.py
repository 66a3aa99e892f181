"""Numbers of a case that define the form of its equations, and of which nobody is uncertain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from barbalat.open_numbers.path import FieldPath
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem

OF_THE_DESIGN = (("plant", "A"), ("plant", "A_m"), ("reference_model", "A_m"))
OF_THE_TRUTH = ("truth", "A")
"""Matrices of states."""
UNIT_GAIN = ("actuator", "filter")
"""Transfer functions whose static gain is one by definition: another factor is a gain of its own."""


def is_definition(problem: TrackingProblem, path: FieldPath, known: Mapping[FieldPath, float]) -> bool:
    """Whether a number defines a state or the form of a transfer function, and has no uncertainty of its own.

    A row of A with a single entry of 1 or -1, where b is zero, says that one state is the rate of another. The coefficient 1 at
    one end of a denominator fixes the common factor of numerator and denominator, and equal last coefficients of an actuator or
    filter make its static gain one. ``known`` contains the numbers of the case keyed by path.
    """
    if isinstance(problem, Problem) and len(path.keys) == 4 and path.vector in (*OF_THE_DESIGN, OF_THE_TRUTH):
        _, _, row, column = path.keys
        return row != column and _is_rate(problem, path.vector == OF_THE_TRUTH, row)
    return path.keys[-2:-1] in (("num",), ("den",)) and _fixes_form(path, known)


def _is_rate(problem: Problem, of_the_truth: bool, row: object) -> bool:
    """Whether a state's derivative is plus or minus another state."""
    simulated = problem.simulated if of_the_truth else None
    A, b = (problem.plant.A_m, problem.plant.b) if simulated is None else (simulated.A, simulated.b)
    if not isinstance(row, int) or row >= len(A) or np.any(b[row]):
        return False
    entries = A[row][A[row] != 0]
    return len(entries) == 1 and abs(float(entries[0])) == 1


def _fixes_form(path: FieldPath, known: Mapping[FieldPath, float]) -> bool:
    *table, part, index = path.keys
    num, den = (_coefficients((*table, name), known) for name in ("num", "den"))
    if part == "den" and den and index == (0 if den[0] == 1 else len(den) - 1 if den[-1] == 1 else None):
        return True
    unit = table[-1] in UNIT_GAIN and len(den) > 1 and bool(num) and num[-1] == den[-1]
    return unit and index == len(num if part == "num" else den) - 1


def _coefficients(place: tuple[object, ...], known: Mapping[FieldPath, float]) -> list[float]:
    return [value for path, value in known.items() if path.keys[:-1] == place]
