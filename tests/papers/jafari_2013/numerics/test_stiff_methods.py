"""Implicit steps and other codes compared with RK4 where the loop is smooth, their budgets, and the compiled functions."""

import casadi as ca
import numpy as np
import pytest

from barbalat import L1Adaptive, Simulation, input_filter, simulate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.compiled import Compiled
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff_methods import SolverPath, cvodes, implicit, scipy_path

GIVEN = section_v.problem()
BOX = GIVEN.uncertainty


def l1(gamma: float, *, projection: bool) -> L1Adaptive:
    return L1Adaptive(gamma=gamma, filter=input_filter(0.02), projection=projection)


def rk4(controller: L1Adaptive, t_end: float) -> np.ndarray:
    """The last estimates at h = 1e-4 s, where h |lambda| is at most 0.02."""
    return simulate(GIVEN, [controller], Simulation(t_end=t_end, dt=1e-4))["L1"].theta_hat[-1]


def test_implicit_steps_converge_with_their_order():
    """Halving the step divides the error by 4 for the midpoint rule and by 2 for Euler's method. The gain is low, so the steps
    resolve the adaptation."""
    smooth = l1(0.01, projection=False)
    exact, loop = rk4(smooth, 2.0), ClosedLoop.of(GIVEN, smooth)
    for weight, order in ((0.5, 2), (1.0, 1)):
        errors = []
        for h in (1e-3, 5e-4):
            found, projected = implicit(loop, GIVEN, h, 2.0, weight, BOX)
            assert not found.lost and found.reached == 2.0
            np.testing.assert_array_equal(found.final, projected.final)  # the bounds are far away
            errors.append(np.abs(found.final - exact).max())
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.05)


def test_implicit_steps_with_projection_converge_to_the_projected_loop():
    """From 6.5 s on the first estimate is at its bound."""
    exact, loop = rk4(l1(1.0, projection=True), 8.0), ClosedLoop.of(GIVEN, l1(1.0, projection=False))
    coarse, fine = (implicit(loop, GIVEN, h, 8.0, 0.5, BOX) for h in (1e-4, 2e-5))
    errors = [np.abs(paths[1].final - exact).max() for paths in (coarse, fine)]
    assert errors[1] < errors[0] / 2 and errors[1] < 2e-3
    assert np.nanmax(fine[1].greatest) == 5 == exact[0]
    assert np.abs(fine[0].final - exact).max() > 1  # without projection it ends elsewhere


@pytest.mark.parametrize("method", ["Radau", "BDF", "LSODA"])
def test_scipys_codes_agree_with_ours(method):
    smooth = l1(0.01, projection=True)
    found = scipy_path(ClosedLoop.of(GIVEN, smooth), GIVEN, method, tolerance=1e-8, t_end=2.0, evaluations=10**5)
    assert found.reached == 2.0 and not found.lost and found.evaluations > 100
    np.testing.assert_allclose(found.final, rk4(smooth, 2.0), atol=1e-6)  # a hundred times the tolerance


@pytest.mark.parametrize("projection", [False, True])
def test_cvodes_agrees_with_ours(projection):
    controller = l1(1.0, projection=projection)
    found = cvodes(ClosedLoop.of(GIVEN, controller), GIVEN, tolerance=1e-8, t_end=8.0)
    # the tolerance accumulates in the phase of hundreds of periods; with and without projection the final estimates differ by 1.9
    np.testing.assert_allclose(found.final, rk4(controller, 8.0), atol=2e-3)


def test_a_spent_budget_is_said():
    loop = ClosedLoop.of(GIVEN, l1(1.0, projection=False))
    found = scipy_path(loop, GIVEN, "BDF", tolerance=1e-6, t_end=4.0, evaluations=200)
    assert 0 < found.reached < 4 and not found.lost and 200 <= found.evaluations < 250
    assert np.isnan(found.least[-1]).all() and np.isfinite(found.least[0]).all()


def test_ringing_is_half_the_largest_swing_of_a_window():
    least, greatest = np.zeros((400, 2)), np.zeros((400, 2))
    greatest[250], least[251], greatest[399] = [1.0, 0.0], [0.0, -3.0], [9.0, 9.0]
    path = SolverPath(least=least, greatest=greatest, final=greatest[-1], reached=4.0, lost=False, evaluations=0, seconds=0.0)
    np.testing.assert_array_equal(path.ringing(2.0, 3.9), [0.5, 1.5])
    np.testing.assert_array_equal(path.ringing(0.0, 1.0), [0.0, 0.0])


def test_ringing_is_free_of_drift():
    """Estimates that drift at 0.7 and 30 per s (the second slows down) and oscillate with amplitudes of 0.02 and 0. The result is
    within 1 % of the amplitude of the oscillation alone."""
    t = np.linspace(0, 4, 400 * 200 + 1)
    theta_hat = np.column_stack([0.7 * t + 0.02 * np.sin(2e4 * t), 30 * t - t**2])
    windows = np.array([theta_hat[200 * k : 200 * (k + 1) + 1] for k in range(400)])
    path = SolverPath(
        least=windows.min(axis=1),
        greatest=windows.max(axis=1),
        final=theta_hat[-1],
        reached=4.0,
        lost=False,
        evaluations=0,
        seconds=0.0,
    )
    np.testing.assert_allclose(path.ringing(0.5, 3.9), [0.02, 0.0], atol=2e-4)


def test_compiled_functions_are_casadis():
    x, s = ca.SX.sym("x", 3), ca.SX.sym("s", 2)
    vector = ca.vertcat(x[0] * ca.sin(s[0]), x[1] / (1 + x[2] ** 2), ca.fmax(x[0], s[1]), x[0] - x[1])
    matrix = ca.densify(ca.jacobian(vector, x))
    rng = np.random.default_rng(0)
    for value, shape in ((vector, (4,)), (matrix, (4, 3))):
        function = ca.Function("f", [x, s], [value])
        compiled = Compiled(function)
        results = []
        for _ in range(20):
            at, given = rng.normal(size=3), rng.normal(size=2)
            results.append((compiled(at, given), np.array(function(at, given)).reshape(shape)))
        for ours, theirs in results:  # each call has a separate array
            assert ours.shape == shape
            np.testing.assert_allclose(ours, theirs, rtol=1e-14, atol=1e-15)
    with pytest.raises(ValueError, match="dense"):
        Compiled(ca.Function("f", [x, s], [ca.jacobian(vector, x)]))
