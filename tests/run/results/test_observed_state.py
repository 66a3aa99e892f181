"""The observer's estimate of the state, in the series of a result."""

from __future__ import annotations

import numpy as np

from barbalat import Mrac, Plant, Problem, ReferenceModel, Sampled, Simulation, simulate
from barbalat.plants import LuenbergerObserver, PlantInput
from barbalat.signals import Sine


def test_the_estimate_of_an_observer_is_a_series_and_reaches_the_state() -> None:
    """The plant is the nominal one, with a delay of 1.5 samples, which a sampled controller's observer contains. After 3 s the
    error is exp(-27) of the first one, 2e-12. Between samples the estimate keeps its value."""
    plant = Plant(A=[[0.0, 1.0], [-2.0, -0.5]], b=[0.0, 1.0], poles=[-2.0, -3.0], input=PlantInput(delay=0.015), x0=[0.1, 0.5])
    problem = Problem(
        plant=plant,
        reference_model=ReferenceModel(follow="x_1"),
        reference=Sine(amplitude=1.0, frequency=2.0),
        observer=LuenbergerObserver([-9.0, -10.0], measured=[[1.0, 0.0]]),
    )
    run = simulate(problem, [Sampled(Mrac(gamma=3.0), 0.01)], Simulation(t_end=4.0, dt=1e-3))["MRAC"]
    columns = run.columns()
    seen = np.column_stack([columns["x_observed_1"], columns["x_observed_2"]])
    assert seen.shape == run.x.shape and np.abs(seen - run.x).max() > 0.01
    k = np.rint(run.t / 1e-3).astype(int)
    at, between = (np.flatnonzero((k > 3000) & (k % 10 == phase) & (k < 4000)) for phase in (0, 8))
    np.testing.assert_allclose(seen[at], run.x[at], atol=1e-10)
    np.testing.assert_allclose(seen[at], seen[between[-len(at) :]], rtol=0, atol=1e-14)  # roundings of the record
