"""The rows on the filtered MRAC, the Lyapunov function and the robust MRAC's numerics, compared with independent runs."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from barbalat import Mrac, input_filter
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics import numerics
from barbalat.papers.jafari_2013.tracking import tracking
from barbalat.problem.actuation import PlantInput


def test_v_falls_within_the_condition_and_beyond_it_and_the_state_grows_beyond():
    gamma, kappa = tracking.UNSTABLE_GAIN, tracking.UNSTABLE_KAPPA
    rise, reached, _ = tracking._along(gamma, kappa, tracking.FILTERS[kappa][1])
    assert rise < tracking.V_TOLERANCE and reached > 1e5
    assert tracking._along(100.0, section_v.KAPPA, 2e-5)[1] < 500  # within it the state stays near the model, |x_m| < 400


def test_a_filter_that_is_no_filter_leaves_the_same_tails():
    """A fast filter and a slow law do not satisfy the comparison of both schemes trivially."""
    by_e, by_prediction = tracking._filtered_pair(section_v.KAPPA, 10.0, 1e-4)
    same = tracking._same_tails("itself", {10.0: (by_e.tail_max_abs_e / by_e.tail_max_abs_e)[0]})
    other = tracking._same_tails("the other", {10.0: (by_e.tail_max_abs_e / by_prediction.tail_max_abs_e)[0]})
    assert same.holds and not other.holds and same.role == "weaker"


def test_the_filtered_error_driven_law_is_that_of_scipy():
    """(3), (4) and C before the plant are integrated by a different method up to 4 s. Projection is left out because its bounds
    are not reached."""
    plant, kappa = section_v.problem().plant, section_v.KAPPA
    P = solve_continuous_lyapunov(plant.A_m.T, -np.eye(2))

    def derivative(time, state):
        x, x_m, theta_hat, u = state[:2], state[2:4], state[4:6], state[6]
        r = 50 * np.sin(0.5 * time)
        rates = (
            plant.A_m @ x + plant.b * (plant.theta @ x + u),
            plant.A_m @ x_m + plant.b * 4 * r,
            1.0 * ((x - x_m) @ P @ plant.b) * x,
            [(-theta_hat @ x + 4 * r - u) / kappa],
        )
        return np.concatenate(rates)

    t = np.linspace(0, 4, 40_001)
    found = solve_ivp(derivative, (0, 4), [1, 1, 1, 1, 0, 0, 0], method="LSODA", t_eval=t, rtol=1e-9, atol=1e-9).y
    filtered = section_v.variant(input=PlantInput(actuator=input_filter(kappa)))
    ours = section_v.figures([(filtered, Mrac(gamma=1.0, projection=False))], 4.0, 1e-4)
    np.testing.assert_allclose(ours.max_abs_e[0], np.abs(found[:2] - found[2:4]).max(axis=1), rtol=1e-3)


def test_what_a_step_changes_is_seen_in_errors_and_control():
    problem, law = section_v.problem(), section_v.robust_mrac("r")
    coarse, fine = (section_v.figures([(problem, law)], 2.0, h) for h in (1e-4, 2e-5))
    assert numerics._changed(coarse, fine) < 1e-6
    stiff = section_v.robust_mrac("r", 4e-5)  # just inside the solver's limit at the coarse step
    coarse, fine = (section_v.figures([(problem, stiff)], 2.0, h) for h in (1e-4, 2e-5))
    assert numerics._changed(coarse, fine) > 1e-4


def test_a_step_that_does_not_resolve_the_gain_is_seen_in_v():
    """V never increases with a step that resolves it. With the paper's step, in Figure 3, it does."""
    assert tracking._along(1e4, section_v.KAPPA, 1e-5)[0] < tracking.V_TOLERANCE
    assert tracking._along(1e4, section_v.KAPPA, 1e-4)[0] > tracking.V_TOLERANCE
