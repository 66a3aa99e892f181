"""Bounds of output-feedback loops are compared with simulation, and their parts with formulas."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import expm

from barbalat.certificates.bounds.formulas import largest_at_zero, largest_slope, steepest_seen
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.schemes import output_feedback as subject
from barbalat.controllers.output.l1 import linear_equivalent
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem.output_feedback import Nonlinearity, OutputPlant
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.signals import Constant, Sine, Square, Step
from certificates.output_problems import SIMULATION, TF, l1, problem

DRIVERS = (
    {"reference": Square(1.0, 0.7), "disturbance": Step(amplitude=0.5, start=3.0), "output_disturbance": None},
    {"reference": Sine(1.0, 2.0), "disturbance": Sine(0.7, 5.0), "output_disturbance": Sine(0.2, 9.0)},
)


@pytest.mark.parametrize("drivers", DRIVERS, ids=["steps", "sines"])
@pytest.mark.parametrize("f", [None, "0.6*sin(2*y + cos(t)) + 0.1*y"])
@pytest.mark.parametrize("kind", ["l1", "linear"])
@pytest.mark.short(kept=lambda kind, f, drivers: (kind == "l1") == ((f is None) == (drivers is DRIVERS[1])))
def test_random_loops_stay_within_their_bounds(kind, f, drivers, sample):
    """There are 25 loops of each kind, 4 in the short tests. No run exceeds its bound, and most bounds are within a factor of
    ten."""
    random = np.random.default_rng(3)
    members, bounds = [], []
    while len(members) < sample(4, 25):
        plant = OutputPlant(transfer_function=TF([random.uniform(0.5, 3)], [1.0, random.uniform(-0.5, 3)]), nonlinear=f)
        m = random.uniform(1, 5)
        filter = TF([100.0], [1.0, random.uniform(8, 25), 100.0])
        controller = l1(m=m, gamma=10 ** random.uniform(1.5, 3.5), filter=filter, sigma_bound=1e4)
        if kind == "linear":
            same = linear_equivalent(controller)
            controller = LinearOutput(loop=same.feedback, feedforward=same.feedforward)
        given = problem(plant, m, **drivers)
        linear = replace(controller, sigma_bound=None) if kind == "l1" else controller
        found = subject.output_bounds(given, linear, SIMULATION.t_end)
        if isinstance(found, NotApplicable):
            assert "small-gain" in found.why or "unstable" in found.why
            continue
        members.append((given, controller))
        bounds.append(found)
    metrics = simulate_ensemble(members, SIMULATION).metrics
    assert np.isnan(metrics.diverged_at).all()
    d_y = 0.0 if drivers["output_disturbance"] is None else drivers["output_disturbance"].bound
    share = metrics.max_abs_e[:, 0] / [found.e for found in bounds]
    assert share.max() <= 1
    assert np.median(share) > 0.1
    assert (metrics.max_abs_y <= [found.y + d_y for found in bounds]).all()
    if kind == "l1":
        sigma = np.abs([metrics.theta_hat_tail_min, metrics.theta_hat_tail_max]).max(axis=(0, 2))
        assert (sigma <= [found.sigma for found in bounds]).all()


def l1_norms(A, B, C, D):
    """The integrals over time of the magnitudes of the impulse response's entries, by trapezoids of 1e-3 s, plus |D|."""
    samples, transition = [B], expm(1e-3 * A)
    while np.abs(samples[-1]).max() > 1e-9 * np.abs(B).max():
        samples.append(transition @ samples[-1])
    return trapezoid(np.abs(C @ np.array(samples)), dx=1e-3, axis=0) + np.abs(D)


def test_the_bounds_are_those_of_the_small_gain_theorem():
    """f = 0.2 y + 0.1 cos t has F = 0.1 and L = 0.2. The tolerance 1e-3 is due to the trapezoids and the outward rounding of the
    norms."""
    drivers = {"reference": Sine(1.5, 2.0), "disturbance": Constant(0.5), "output_disturbance": Constant(0.05)}
    plant = OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear="0.2*y + 0.1*cos(t)")
    given, controller = problem(plant, **drivers), replace(l1(), sigma_bound=None)
    found = subject.output_bounds(given, controller, SIMULATION.t_end)
    of_y, of_e, *of_sigma = l1_norms(*subject.linear_loop(given, controller))
    y = (of_y @ [1.5, 0.5 + 0.1, 0.05]) / (1 - 0.2 * of_y[1])
    driven = [1.5, 0.5 + 0.1 + 0.2 * y, 0.05]
    assert [found.y, found.e] == pytest.approx([y, of_e @ driven], rel=1e-3)
    assert found.sigma == pytest.approx(of_sigma[0] @ driven, rel=1e-3)


def test_the_linear_loop_against_python_control():
    """The loop from r, d and d_y to y and e agrees with the block algebra of control.tf."""
    given, controller = problem(), l1()
    A, B, C, D = subject.linear_loop(given, controller)
    G, K, F = (
        control.tf(system.num, system.den)
        for system in (
            given.plant.transfer_function,
            linear_equivalent(controller).feedback,
            linear_equivalent(controller).feedforward,
        )
    )
    W_m = control.tf([3.0], [1.0, 3.0])
    S = 1 / (1 + K * G)
    expected = [[G * S * F, G * S, -G * K * S], [G * S * F - W_m, G * S, 1 - G * K * S]]
    for w in (0.3, 5.0, 60.0):
        found = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
        for i, row in enumerate(expected):
            for j, system in enumerate(row):
                assert found[i, j] == pytest.approx(complex(system(1j * w)), rel=1e-8, abs=1e-10)


@pytest.mark.parametrize(
    ("formula", "radius", "slope", "at_zero"),
    [
        ("0.5*sin(y)", 7.0, 0.5, 0.0),
        ("y**3 - 2*y", 2.0, 10.0, 0.0),
        ("abs(y)*y", 1.5, 3.0, 0.0),
        ("tanh(3*y) + 2", 1.0, 3.0, 2.0),
        ("cos(2*t)*exp(y)/4", 1.0, np.e / 4, 0.25),
        ("1/(y*y + 1)", 3.0, 3 * np.sqrt(3) / 8, 1.0),
        ("sqrt(y + 2)", 1.0, 0.5, np.sqrt(2)),
        ("2 - 1/(4*y*y)", 0.0, np.inf, np.inf),
        ("5", 3.0, 0.0, 5.0),
        ("(3*sin(t)**2 - sin(t)**3)*y", 1.0, 4.0, 0.0),  # powers of a ball around zero itself
    ],
)
def test_slopes_of_formulas(formula, radius, slope, at_zero):
    """The slope is never below the true supremum and exceeds it by at most its change over a piece."""
    f = Nonlinearity(formula)
    found = largest_slope(f, radius, 10.0)
    assert found == slope if np.isinf(slope) else slope * (1 - 1e-12) <= found <= slope * 1.05 + 1e-12
    if np.isfinite(slope):
        assert steepest_seen(f, radius) <= slope * (1 + 1e-12)
    assert largest_at_zero(f, 10.0) == pytest.approx(at_zero, rel=1e-8)


def test_what_no_lipschitz_constant_can_lie_below():
    assert steepest_seen(Nonlinearity("-0.2*y**3 + 60*y"), 0.0) == pytest.approx(60)
    assert steepest_seen(Nonlinearity("y**3"), 2.0) == pytest.approx(12)
