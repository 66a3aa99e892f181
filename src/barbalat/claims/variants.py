"""Section V with something changed: what most claims are measured on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from barbalat.claims import section_v
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def variant(
    *,
    theta: Any = None,
    reference: Signal | None = None,
    k_0: float | None = None,
    box: ParameterBox | None = None,
    input: PlantInput | None = None,
) -> Problem:
    """The problem of Section V; what is given replaces what the paper has."""
    given = section_v.problem()
    plant = given.plant
    return Problem(
        plant=Plant(A_m=plant.A_m, b=plant.b, theta=plant.theta if theta is None else theta, x0=plant.x0, input=input),
        reference_model=given.reference_model if k_0 is None else ReferenceModel(k_0=k_0),
        reference=given.reference if reference is None else reference,
        uncertainty=given.uncertainty if box is None else box,
    )


def figures(members: Sequence[tuple[Problem, Controller]], t_end: float, dt: float) -> Metrics:
    """The figures of an ensemble over [0, t_end] with RK4."""
    return simulate_ensemble(members, Simulation(t_end=t_end, dt=dt)).metrics


def numbers(values: Array) -> str:
    """A short list for a sentence."""
    return "[" + ", ".join(f"{v:.3g}" for v in np.atleast_1d(values)) + "]"
