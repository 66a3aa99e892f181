"""Section V with something changed: what most claims are measured on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from barbalat.papers.claim import Listing
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.wording import table
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant
from barbalat.problem.reference_model import ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.kernel.metrics import Metrics
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


def at_instants(t: Array, instants: Sequence[float]) -> Array:
    """The places of recorded instants, (k,) of (K,); ValueError for one that was not recorded."""
    at = np.array([np.abs(t - instant).argmin() for instant in instants])
    if not np.allclose(t[at], instants, rtol=1e-9, atol=1e-9):  # roundings of a time's own product
        raise ValueError(f"not recorded: {instants}, nearest {t[at]}")
    return at


def by_component(caption: str, runs: Mapping[str, Metrics]) -> Listing:
    """For each scheme the tail's error and the variation of the estimates, by component; Section V has two of either."""
    errors = {f"|e_{i + 1}|, tail": [run.tail_max_abs_e[0, i] for run in runs.values()] for i in range(2)}
    rates = {f"theta_hat_{i + 1} moves [1/s]": [run.theta_hat_variation_rate[0, i] for run in runs.values()] for i in range(2)}
    return table(caption, {"scheme": list(runs), **errors, **rates})


def local_exponents(values: Array, settings: Array) -> Array:
    """From each setting to the next, (k - 1,) for (k,)."""
    return np.asarray(np.diff(np.log(values)) / np.diff(np.log(settings)))
