"""Checks of settings that several schemes share."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat import validate
from barbalat.known_set import KnownSet
from barbalat.problem import Known
from barbalat.validate import Array, InputError


def check_common(settings: Any) -> None:
    """What every adaptive controller's settings share: a name, and an initial estimate of their own, if one is given."""
    validate.label("name", settings.name)
    if settings.theta_hat0 is not None:
        object.__setattr__(settings, "theta_hat0", validate.vector("theta_hat0", settings.theta_hat0))


def initial_estimate(theta_hat0: Any, box: KnownSet | None, n: int) -> Array:
    """theta_hat(0), (n,): zero unless given; inside the known set if there is one."""
    estimate = validate.vector("theta_hat0", np.zeros(n) if theta_hat0 is None else theta_hat0, n)
    if box is not None and not box.contains(estimate):
        given = "the default, " if theta_hat0 is None else ""
        raise InputError(f"theta_hat0 must lie in the known set, {box}, got {given}{validate.show(estimate)}")
    return estimate


def projection_box(projection: bool | None, known: Known) -> KnownSet | None:
    """What to project onto: by default the known set where one is given."""
    if projection is not None and not isinstance(projection, (bool, np.bool_)):
        raise InputError(f"projection must be true or false, got {validate.show(projection)}")
    if projection and known.box is None:
        raise InputError(
            "projection needs the known set: give uncertainty.lower and .upper, or .center and .radius, or set projection = false"
        )
    return known.box if projection is None or projection else None
