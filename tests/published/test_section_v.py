"""Figures 2 to 5 of Jafari, Ioannou and Rudd (2013) as numbers: what each caption says, at the paper's settings."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import L1Adaptive, Mrac, RobustMrac
from barbalat.linear.systems import input_filter
from barbalat.run.engine.simulate import simulate
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation

THETA = np.array([4.0, -3.0])


@cache
def l1(problem, gamma, dt, kappa=0.02, projection=True, t_end=60.0):
    controller = L1Adaptive(gamma=gamma, filter=input_filter(kappa), projection=projection)
    return simulate(problem, [controller], Simulation(t_end=t_end, dt=dt))["L1"]


def figures(result):
    return {name: None if value is None else np.array(value) for name, value in result.figures.items()}


def h_omega(problem, result):
    """h sqrt(Gamma max|x|^2 b'Pb), the phase of the adaptation's oscillation in each step (docs/equations.md, section 8)."""
    b = problem.plant.b
    largest = (result.x**2).sum(axis=1).max()
    return result.simulation.dt * np.sqrt(result.controller.gamma * largest * (b @ problem.known.P @ b))


def test_figure_2_robust_mrac_converges_and_learns(section_v):
    """ "converges to zero with improved transient performance"; "converges to the true value"."""
    controller = RobustMrac(
        c_0=[1.0, 1.0], tau=0.5, law=LeastSquares(covariance0=500.0), normalization=Normalization(alpha_0=0.0)
    )
    result = simulate(section_v, [controller], Simulation(t_end=60.0, dt=1e-4))[controller.name]
    found = figures(result)
    np.testing.assert_allclose(found["theta_hat_final"], THETA, atol=1e-3)  # 0.02 % of the box's width: "converges"
    assert (found["tail_max_abs_e"] < 0.01 * found["max_abs_e"]).all()
    coarse = simulate(section_v, [controller], Simulation(t_end=60.0, dt=1e-3))[controller.name]
    # no numerical effect: a step ten times as long gives the same figures; RK4 errors of 1e-12 against 1e-8
    np.testing.assert_allclose(coarse.figures["max_abs_e"], found["max_abs_e"], rtol=1e-4)  # the peak is between steps
    np.testing.assert_allclose(coarse.figures["theta_hat_final"], found["theta_hat_final"], atol=1e-6)


def test_figure_3_l1_oscillates_between_the_projection_bounds(section_v):
    """Gamma = 1e4 at h = 1e-4: "oscillate between the projection bounds", "does not converge to zero", "bounded"."""
    result = l1(section_v, 1e4, 1e-4)
    found = figures(result)
    assert result.diverged_at is None
    assert found["theta_hat_tail_min"].tolist() == [-5.0, -5.0]
    assert found["theta_hat_tail_max"].tolist() == [5.0, 5.0]
    assert (found["theta_hat_variation_rate"] > 1e3).all()  # at least a hundred full sweeps of width 10 in each second
    assert (found["tail_max_abs_e"] > 10).all()  # a fifth of the command's amplitude
    assert h_omega(section_v, result) > RK4.imaginary_limit  # and the step is too long for this gain, as Section III states


def test_figure_3_without_projection_goes_unbounded(section_v):
    result = l1(section_v, 1e4, 1e-4, projection=False)
    assert result.diverged_at is not None
    assert 0 < result.diverged_at < 60
    assert set(map(str, result.figures["max_abs_e"])) == {"None"}


def test_figure_4_a_tenth_of_the_step_ends_the_oscillation(section_v):
    """h = 1e-5: "high frequency oscillations are gone due to smaller step size", "non-zero steady state error remains"."""
    result, before = l1(section_v, 1e4, 1e-5), figures(l1(section_v, 1e4, 1e-4))
    found = figures(result)
    assert (found["theta_hat_variation_rate"] < 1e-3 * before["theta_hat_variation_rate"]).all()
    assert (found["tail_max_abs_e"] > 10).all()
    assert (np.abs(result.theta_hat[result.t > 45]) < 5).all()  # off the bounds
    assert h_omega(section_v, result) < RK4.imaginary_limit


def test_figure_4_is_the_solution_of_the_differential_equations(section_v):
    """If the step is halved again, the figures do not change, unlike Fig. 3."""
    figure_4, finer = (figures(l1(section_v, 1e4, dt, t_end=20.0)) for dt in (1e-5, 5e-6))
    for name in ("max_abs_e", "tail_max_abs_e", "rms_e", "theta_hat_variation_rate", "theta_hat_final"):
        np.testing.assert_allclose(finer[name], figure_4[name], rtol=1e-3)  # the slowest oscillation is resolved by 50 steps


def test_figure_4_error_is_proportional_to_kappa(section_v):
    """Caption of Fig. 3: "its steady-state amplitude is proportional to the value of kappa"."""
    wide, narrow = (figures(l1(section_v, 1e4, 1e-5, kappa=kappa, t_end=40.0))["tail_max_abs_e"] for kappa in (0.02, 0.005))
    np.testing.assert_allclose(wide / narrow, 4.0, rtol=0.15)  # 1 - C = kappa s + O(kappa^2)


def test_figure_5_a_larger_gain_brings_it_back(section_v):
    """Gamma = 1e6 at h = 1e-5: "leads again to numerical instability"."""
    result = l1(section_v, 1e6, 1e-5)
    found = figures(result)
    assert result.diverged_at is None
    assert found["theta_hat_tail_min"].tolist() == [-5.0, -5.0]
    assert found["theta_hat_tail_max"].tolist() == [5.0, 5.0]
    assert (found["theta_hat_variation_rate"] > 1e3).all()
    assert h_omega(section_v, result) > RK4.imaginary_limit


def test_figure_5_without_projection_goes_unbounded(section_v):
    result = l1(section_v, 1e6, 1e-5, projection=False)
    assert result.diverged_at is not None
    assert 0 < result.diverged_at < 60


def test_the_filter_hides_the_oscillation_from_the_error(section_v):
    """Figs 3 and 4 show nearly the same tracking error, although the estimates have nothing in common."""
    rough, smooth = (figures(l1(section_v, 1e4, dt))["tail_max_abs_e"] for dt in (1e-4, 1e-5))
    np.testing.assert_allclose(rough, smooth, rtol=0.05)


def test_mrac_at_a_reasonable_gain_tracks_better_than_l1(section_v):
    """By Section III the error converges to zero without the filter but not with it."""
    result = simulate(section_v, [Mrac(gamma=1.0)], Simulation(t_end=60.0, dt=1e-4))["MRAC"]
    assert max(result.figures["tail_max_abs_e"]) < 1e-3 * min(l1(section_v, 1e4, 1e-5).figures["tail_max_abs_e"])


def test_the_label_tells_figures_3_and_5_from_2_and_4(section_v):
    assert "outside the region of stability" in l1(section_v, 1e4, 1e-4).label
    assert l1(section_v, 1e4, 1e-5).label is None
    assert "outside the region of stability" in l1(section_v, 1e6, 1e-5).label


@pytest.mark.parametrize("gamma", [0.1, 1.0, 10.0])
def test_theorem_1_bounds_mrac(section_v, gamma):
    """(9) holds at three gains."""
    result = simulate(section_v, [Mrac(gamma=gamma)], Simulation(t_end=20.0, dt=1e-4))["MRAC"]
    nu_0 = np.linalg.norm(THETA) / np.sqrt(np.linalg.eigvalsh(section_v.known.P).min())
    assert max(result.figures["max_abs_e"]) <= nu_0 / np.sqrt(gamma)
