"""The elementary functions as operation lists. All targets print these lists, so the library of a target cannot change any bit of
a result.

The coefficients of ``normal`` are from Wichura, all others from fdlibm. Copyright (C) 1993, 2004 by Sun Microsystems, Inc. All
rights reserved. Permission to use, copy, modify, and distribute this software is freely granted, provided that this notice is
preserved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from barbalat.lowering.functions import exponential, normal, power, trigonometric
from barbalat.lowering.functions.formats import DOUBLE, Format
from barbalat.lowering.functions.trace import traced
from barbalat.lowering.operations import Program


@dataclass(frozen=True)
class Function:
    """One function of ``arguments`` numbers, inputs (0, 0), (1, 0), ... of its lists.

    usual  computes the value and, if there is a rare list, whether the arguments need it
    rare   computes the value if ``usual`` requires it; otherwise it is not evaluated
    """

    arguments: int
    usual: Program
    rare: Program | None = None


FUNCTIONS = frozenset({"exp", "log", "sin", "cos", "tan", "tanh", "atan", "pow", "ndtri"})
"""The operations that are such functions. ndtri, the inverse of the normal distribution function, does not exist in CasADi."""


@cache
def function(name: str, of: Format = DOUBLE) -> Function:
    """One of FUNCTIONS for numbers of a format; its lists are made at the first request."""
    match name:
        case "sin" | "cos" | "tan":
            value = {"sin": trigonometric.sin, "cos": trigonometric.cos, "tan": trigonometric.tan}[name]
            return Function(1, traced(trigonometric.usual_of(value), 1, of), traced(trigonometric.large_of(value), 1, of))
        case "pow":
            return Function(2, traced(power.power, 2, of))
        case "ndtri":
            return Function(1, traced(normal.central, 1, of), traced(normal.tail, 1, of))
        case _:
            formula = {"exp": exponential.exp, "log": exponential.log, "tanh": exponential.tanh, "atan": trigonometric.atan}[name]
            return Function(1, traced(formula, 1, of))
