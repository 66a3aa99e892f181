"""What is designed anew for each member of a sweep: reference models and controllers that follow from a plant that varies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.cases.build import Case
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.probe import Tried
from barbalat.open_numbers.varied import Varied
from barbalat.run.kernel.template import Columns
from barbalat.validate import Array

REFERENCE_MODEL = "the reference model"
"""Beside the names of controllers, what a member's own numbers may have been used for."""
OF_THE_DESIGN = ("controller", "reference_model", "uncertainty", "reference", "simulation")
"""First keys of what a designer chooses or knows: whoever varies these asks for other designs. All else is the plant's."""
OF_NO_DESIGN = (("plant", "x0"),)
"""The state is measured, so that a predictor begins at its initial value: that designs nothing."""
DESIGN_ROUNDING = 1e-9
"""Of the largest number of an array: far above what rounding leaves of a matrix that does not depend on what varies."""


def redesigned(varied: Varied, tried: Tried) -> dict[str, tuple[str, ...]]:
    """What is made anew for each member, by the paths of the plant's numbers from which it follows.

    A gain or a reference model that is computed from the plant is no longer that of the case: such a sweep tries many designs,
    each on the plant that it was made for, and not one design on many plants.
    """
    found: dict[str, tuple[str, ...]] = {}
    base = varied.at(tried.middle)
    for column, path in enumerate(varied.paths):
        if path.keys[0] in OF_THE_DESIGN or path.keys[:2] in OF_NO_DESIGN:
            continue
        cases = [varied.at(row) for row in tried.rows(column, tried.middle)]
        makers = [REFERENCE_MODEL, *(one.name for one in base.controllers)]
        differs = [any(not _alike(one, other) for other in others) for one, *others in _designs(base, cases)]
        if names := tuple(name for name, differing in zip(makers, differs, strict=True) if differing):
            found[str(path)] = names
    return found


def _designs(base: Case, cases: Sequence[Case]) -> list[list[tuple[Array, ...]]]:
    """The arrays of the reference model, then those of each controller's equations: of the base and of the others."""
    designs = [[_numbers_of(case.problem.model.matrices) for case in (base, *cases)]]
    for i in range(len(base.controllers)):
        loops = [ClosedLoop.of(case.problem, case.controllers[i]) for case in (base, *cases)]
        designs.append([_numbers_of(loop.equations) for loop in loops])
    return designs


def _numbers_of(part: object) -> tuple[Array, ...]:
    return Columns(part).leaves


def _alike(one: Sequence[Array], other: Sequence[Array]) -> bool:
    """Whether these arrays differ by no more than rounding."""
    if [leaf.shape for leaf in one] != [leaf.shape for leaf in other]:
        return False
    return all(
        np.allclose(a, b, rtol=0.0, atol=DESIGN_ROUNDING * np.abs(a[np.isfinite(a)]).max(initial=0.0), equal_nan=True)
        for a, b in zip(one, other, strict=True)
    )
