"""What a linear design is told: the model it closes the loop around, and the size of what the model leaves out."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from barbalat import validate
from barbalat.controllers.linear_feedback import require_linear_plant
from barbalat.linear.systems import TransferFunction, transfer_function
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array, InputError


def design_model(known: Known, output: Array | None = None) -> tuple[Array, TransferFunction]:
    """(c, c'(sI - A_m)^-1 b): the plant between u and c'x once the nominal theta'x is cancelled; c is P b by default.

    P b makes it strictly positive real, so minimum phase of relative degree one: the choice that limits a linear loop
    least. Raises InputError for c = 0, and for a plant with several inputs, an unknown gain or a regressor other than x.
    """
    require_linear_plant(known)
    c = known.P @ known.b if output is None else validate.vector("output", output, known.n)
    model = transfer_function(c, known.A_m, known.b)
    if not model.num.any():
        raise InputError(f"output must not be zero, got {validate.show(c)}")
    return c, model


def delay_weight(delay: float) -> TransferFunction:
    """W(s) with |e^(-j w d) - 1| <= |W(j w)| for all w and all d <= delay [s]: s delay/(1 + s delay/sqrt(12)).

    2 sin(x/2) <= x/sqrt(1 + x^2/12): both sides agree up to x^3, and the right one tends to sqrt(12) > 2. The form is that of
    Wang, Lundstrom and Skogestad (1994), with 3.465.
    """
    delay = validate.positive("unmodelled_delay", delay)
    return TransferFunction([delay, 0.0], [delay / math.sqrt(12), 1.0])


def default_delay(known: Known) -> float:
    """A tenth of the fastest time constant in the family [s]: 0.1/max |eigenvalue of A_m + b theta'| over the set's corners.

    What the model leaves out is then taken to begin a decade above what it describes.
    """
    require_linear_plant(known)
    corners = [np.zeros(known.n)] if known.theta_set is None else product(*zip(*known.theta_set.extent, strict=True))
    fastest = max(float(np.abs(np.linalg.eigvals(known.A_m + np.outer(known.b, corner))).max()) for corner in corners)
    return 0.1 / fastest
