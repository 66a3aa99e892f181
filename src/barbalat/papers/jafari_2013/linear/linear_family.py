"""Section V's family as its parameters grow, with and without a delay: what adaptive and linear controllers are compared on."""

from __future__ import annotations

import numpy as np

from barbalat.papers.jafari_2013.variants import figures, variant
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array

T_END, STEP = 60.0, 1e-4
CORNER = np.array([5.0, 5.0])
"""Of Section V's set: the direction in which mu finds the linear loops weakest. It makes the plant unstable from size 0.2 on."""
SIZES = 0.25 * 2.0 ** (np.arange(24) / 3)
"""Of the set and of theta in it, up to 51 times Section V's; a multiple of the kernel's lanes."""


def given(size: float, delay: float = 0.0) -> Problem:
    """Set and true parameters so many times as large, the parameters in the set's corner."""
    box = ParameterBox(lower=-size * np.array([5.0, 5.0]), upper=size * np.array([5.0, 5.0]))
    return variant(theta=size * CORNER, box=box, input=PlantInput(delay=delay) if delay else None)


def tail(members: list[tuple[Problem, Controller]], step: float = STEP) -> Array:
    """The tail error max |e| of each, NaN where it diverged."""
    return figures(members, T_END, step).tail_max_abs_e.max(axis=1)


def over_sizes(controller: Controller) -> Array:
    """(sizes + 1) tail errors over SIZES and, last, at Section V's own theta."""
    return tail([*((given(size), controller) for size in SIZES), (variant(), controller)])


def at_one(values: Array) -> float:
    """Return, of values over SIZES, the one at size 1."""
    return float(values[np.argmin(np.abs(SIZES - 1))])
