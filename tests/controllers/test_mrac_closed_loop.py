"""MRAC with a closed-loop reference model, compared with the standard MRAC at L = 0."""

import numpy as np

from barbalat import Mrac, MracClosedLoop, simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def test_without_feedback_it_is_the_standard_mrac(problems):
    """With L = 0 the model is (2), and the runs agree up to the order of roundings."""
    runs = simulate(problems[2], [Mrac(gamma=2.0), MracClosedLoop(gamma=2.0, model_feedback=np.zeros((2, 2)))], SIMULATION)
    plain, closed = runs.values()
    np.testing.assert_allclose(closed.theta_hat, plain.theta_hat, atol=1e-12)
    np.testing.assert_allclose(closed.e, plain.e, atol=1e-12)


def test_an_unstable_model_is_refused(problems):
    controller = MracClosedLoop(gamma=1.0, model_feedback=5.0 * np.eye(2))
    assert "A_m + model_feedback must be Hurwitz" in refusal(lambda: controller.bind(problems[2].known))
