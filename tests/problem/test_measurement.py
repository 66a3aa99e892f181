"""Sensor lag and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.stats import kstest

from barbalat.certificates.certify import certify
from barbalat.controllers import KnownParameters, Mrac, Sampled
from barbalat.problem.measurement import Noise, Sensor
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.portable import standard_normal
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from independent import refusal


def noisy(problem, **settings):
    return replace(problem, sensor=Sensor(noise=Noise(**settings)))


def test_numbers_are_standard_gaussian_and_white():
    drawn = standard_normal(3, 0, 0, 50_000, 3)
    assert drawn.shape == (50_000, 3)
    for channel in drawn.T:
        assert kstest(channel, "norm").pvalue > 1e-3
    # correlations of N samples have a standard deviation of 1/sqrt(N): five of them
    limit = 5 / np.sqrt(len(drawn))
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < limit
    assert abs(np.corrcoef(drawn[1:, 0], drawn[:-1, 0])[0, 1]) < limit
    assert abs(np.corrcoef(drawn[:, 0], standard_normal(3, 1, 0, 50_000, 3)[:, 0])[0, 1]) < limit
    assert abs(np.corrcoef(drawn[:, 0], standard_normal(4, 0, 0, 50_000, 3)[:, 0])[0, 1]) < limit


@pytest.mark.parametrize("channels", [1, 2, 4, 5])
def test_a_row_does_not_depend_on_how_it_is_asked_for(channels):
    whole = standard_normal(9, 2, 0, 1000, channels)
    parts = [standard_normal(9, 2, first, 125, channels) for first in range(0, 1000, 125)]
    np.testing.assert_array_equal(whole, np.concatenate(parts))


def test_members_have_streams_of_their_own_whatever_lanes_and_threads(problems):
    """13 members run over more than one kernel call each. std differs from member to member."""
    simulation = Simulation(t_end=40_000 * 2.0**-9, dt=2.0**-9)
    members = [(noisy(problems[1], std=0.01 * (i + 1), sample_time=2.0**-8, seed=1), Mrac(gamma=5.0)) for i in range(13)]
    runs = [
        simulate_ensemble(members, simulation, lanes=lanes, threads=threads).metrics
        for lanes, threads in ((1, 1), (4, 2), (16, 1))
    ]
    for other in runs[1:]:
        np.testing.assert_array_equal(runs[0].rms_e, other.rms_e)
        np.testing.assert_array_equal(runs[0].theta_hat_final, other.theta_hat_final)
    assert len(np.unique(runs[0].rms_e)) == 13
    first = simulate(members[0][0], [members[0][1]], simulation)["MRAC"].metrics
    np.testing.assert_allclose(first.rms_e[0], runs[0].rms_e[0], rtol=1e-9)  # member 0 is the single run


def test_a_bound_limits_every_value_and_changes_no_other(problems):
    """u = k_0 r - theta'x of the second controller shows the noise of each sample."""
    simulation, theta = Simulation(t_end=40.0, dt=2.0**-6, record_points=41 * 64), np.array([0.3, -0.2])
    given = {"std": [0.1, 0.2], "sample_time": 2.0**-5}
    problem = replace(problems[2], reference=Constant(1.0))
    sampled = Sampled(KnownParameters(theta=theta), 2.0**-5, discretization="euler")

    def runs(**bound):
        return simulate(noisy(problem, **given, **bound), [Mrac(gamma=5.0), sampled], simulation)

    free, far, near, none = runs(), runs(bound=1e3), runs(bound=[0.1, 0.05]), runs(bound=0.0)
    for name, run in free.items():
        np.testing.assert_array_equal(run.x, far[name].x)
        assert not np.array_equal(run.x, near[name].x)
    without = simulate(problem, [Mrac(gamma=5.0), sampled], simulation)
    np.testing.assert_allclose(none["MRAC"].x, without["MRAC"].x, rtol=1e-9, atol=1e-9)
    (name,) = free.keys() - {"MRAC"}
    k_0_r = without[name].u.ravel()[0] + without[name].x[0] @ theta
    of_noise = [np.abs(k_0_r - run[name].u.ravel() - run[name].x @ theta)[:-1:2].max() for run in (near, free)]
    assert of_noise[0] == pytest.approx(0.3 * 0.1 + 0.2 * 0.05) and of_noise[1] > 0.1


def test_members_may_have_different_bounds(problems):
    simulation = Simulation(t_end=4.0, dt=2.0**-6)
    members = [
        (noisy(problems[2], std=0.1, sample_time=2.0**-6, **bound), Mrac(gamma=5.0))
        for bound in ({"bound": 0.02}, {"bound": 0.05}, {"bound": 1e3})
    ]
    found = simulate_ensemble(members, simulation, numbers=[0] * 3).metrics.rms_e
    assert len(np.unique(found, axis=0)) == 3
    alone = simulate_ensemble([members[1]], simulation, numbers=[0]).metrics.rms_e
    np.testing.assert_array_equal(alone[0], found[1])


@pytest.mark.parametrize("bound", [-0.1, [0.1, -0.1], [0.1, 0.1, 0.1], float("nan")])
def test_bounds_that_are_none(problems, bound):
    assert "noise.bound" in refusal(lambda: noisy(problems[2], std=0.1, sample_time=0.1, bound=bound))


def test_a_member_takes_its_noise_along(problems):
    """The noise depends only on the given number and not on the member's position."""
    simulation = Simulation(t_end=2.0, dt=2.0**-8)
    member = (noisy(problems[1], std=0.1, sample_time=2.0**-6), Mrac(gamma=5.0))
    found = simulate_ensemble([member] * 3, simulation).metrics.rms_e
    moved = simulate_ensemble([member] * 3, simulation, numbers=[2, 0, 2]).metrics.rms_e
    np.testing.assert_array_equal(moved, found[[2, 0, 2]])
    assert len(np.unique(found)) == 3


@pytest.mark.parametrize(
    ("numbers", "words"),
    [([0, 1], ["numbers", "3 entries", "2"]), ([0, 1, -1], ["numbers", "-1"]), ([0, 1, 0.5], ["numbers", "0.5"])],
)
def test_numbers_that_are_none(problems, numbers, words):
    member = (problems[1], Mrac(gamma=5.0))
    message = refusal(lambda: simulate_ensemble([member] * 3, Simulation(t_end=1.0, dt=0.1), numbers=numbers))
    assert all(word in message for word in words), message


def test_refining_the_step_keeps_the_noise(problems):
    """The noise is a function of time, so the runs converge. RK4 at steps of 2^-7 and 2^-8 with jumps every 2^-6 has errors below
    1e-5."""
    problem = noisy(problems[2], std=[0.1, 0.2], sample_time=2.0**-6, seed=4)
    ends = [simulate(problem, [Mrac(gamma=5.0)], Simulation(t_end=4.0, dt=dt))["MRAC"].x[-1] for dt in (2.0**-7, 2.0**-8)]
    quiet = simulate(problems[2], [Mrac(gamma=5.0)], Simulation(t_end=4.0, dt=2.0**-8))["MRAC"].x[-1]
    assert np.abs(ends[0] - ends[1]).max() < 1e-5
    assert np.abs(ends[1] - quiet).max() > 1e-3


def test_recorded_control_saw_the_noise_of_its_instant(problems):
    """u = -theta_hat'(x + noise) + k_0 r with the recorded values, up to rounding."""
    problem = noisy(problems[2], std=[0.1, 0.2], sample_time=2.0**-5, seed=4)
    run = simulate(problem, [Mrac(gamma=5.0)], Simulation(t_end=4.0, dt=2.0**-7))["MRAC"]
    steps = np.rint(run.t * 2**7).astype(int)
    measured = run.x + np.array([0.1, 0.2]) * standard_normal(4, 0, 0, steps[-1] // 4 + 1, 2)[steps // 4]
    expected = -np.sum(run.theta_hat * measured, axis=1) + problem.reference_model.k_0 * run.r
    np.testing.assert_allclose(run.u, expected, rtol=1e-12, atol=1e-12)


def test_lag_against_dop853(problems):
    """MRAC receives the measurement x/(lag s + 1), which is in equilibrium at t = 0."""
    problem, gamma, lag = replace(problems[2], sensor=Sensor(lag=0.05)), 3.0, 0.05
    known, plant, r = problem.known, problem.plant, problem.reference
    Pb = known.P @ known.b

    def slope(t, s):
        x, x_m, y, theta_hat = s[:2], s[2:4], s[4:6], s[6:]
        command = known.k_0 * float(r(np.array(t)))
        x_dot = plant.A_m @ x + plant.b * (plant.theta @ x - theta_hat @ y + command)
        return [*x_dot, *(plant.A_m @ x_m + plant.b * command), *((x - y) / lag), *(gamma * ((y - x_m) @ Pb) * y)]

    start = [*plant.x0, *plant.x0, *plant.x0, 0, 0]
    exact = solve_ivp(slope, (0, 3), start, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    run = simulate(problem, [Mrac(gamma=gamma, projection=False)], Simulation(t_end=3.0, dt=1e-3))["MRAC"]
    np.testing.assert_allclose(run.x[-1], exact[:2], atol=1e-9)
    np.testing.assert_allclose(run.theta_hat[-1], exact[6:], atol=1e-8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: Noise(std=-1.0, sample_time=1.0), ["std", "negative"]),
        (lambda p: Noise(std="loud", sample_time=1.0), ["std", "loud"]),
        (lambda p: Noise(std=1.0, sample_time=0.0), ["sample_time", "positive"]),
        (lambda p: Noise(std=1.0, sample_time=1.0, seed=-1), ["seed", "whole number"]),
        (lambda p: Sensor(lag=-1.0), ["lag", "negative"]),
        (lambda p: Sensor(noise=0.1), ["noise", "Noise"]),
        (lambda p: replace(p, sensor=0.1), ["sensor", "Sensor"]),
        (lambda p: noisy(p, std=[1.0, 2.0, 3.0], sample_time=1.0), ["std", "3"]),
        (
            lambda p: simulate(noisy(p, std=1.0, sample_time=0.015), [Mrac(gamma=1.0)], Simulation(t_end=1.0, dt=0.01)),
            ["whole number"],
        ),
    ],
)
def test_bad_settings(problems, make, words):
    message = refusal(lambda: make(problems[2]))
    assert all(word in message for word in words)


def quantised(problem, resolution):
    return replace(problem, sensor=Sensor(quantization=resolution))


@pytest.mark.parametrize("resolution", [0.05, [0.05, 0.05], [0.0, 0.2], [0.3, 0.0]])
def test_a_quantised_state_feedback_against_exact_samples(problems, resolution):
    """With u = k_0 r - theta'q(x) the plant is linear and u constant between samples, so matrix exponentials are exact."""
    problem, T, count = problems[2], 0.0625, 80
    plant, theta = problem.plant, np.array([0.7, -0.4])
    controller = Sampled(controller=KnownParameters(theta=theta), sample_time=T, discretization="euler")
    simulation = Simulation(t_end=count * T, dt=T / 64, record_points=count)
    run = simulate(quantised(problem, resolution), [controller], simulation)["Known parameters"]
    A = plant.A_m + np.outer(plant.b, plant.theta)
    both = expm(T * np.block([[A, plant.b.reshape(2, 1)], [np.zeros((1, 3))]]))
    x, each = plant.x0, np.asarray(resolution) * np.ones(2)
    for k in range(count):
        np.testing.assert_allclose(run.x[k], x, atol=1e-8)
        seen = [one if q == 0 else q * np.floor(one / q + 0.5) for one, q in zip(x, each, strict=True)]
        u = np.ravel(problem.known.k_0)[0] * float(problem.reference(k * T)) - theta @ seen
        np.testing.assert_allclose(run.u[k], u, atol=1e-7)
        x = both[:2, :2] @ x + both[:2, 2] * u


def test_a_resolution_larger_than_the_motion_hides_it(problems):
    still = replace(problems[1], reference=Constant(amplitude=0.0), plant=replace(problems[1].plant, x0=[0.1]))
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=0.125)
    run = simulate(quantised(still, 1.0), [controller], Simulation(t_end=1.0, dt=2.0**-8))["MRAC"]
    hidden = np.abs(run.x[:, 0]) < 0.5
    assert not run.u[hidden].any() and run.u[~hidden].any()


@pytest.mark.parametrize(
    ("resolution", "words"),
    [
        (0.0, ["sensor.quantization", "positive"]),
        ([0.1, -0.1], ["sensor.quantization", "negative"]),
        ([0.1, 0.1, 0.1], ["sensor.quantization", "2"]),
        ("fine", ["sensor.quantization"]),
    ],
)
def test_resolutions_that_are_none(problems, resolution, words):
    message = refusal(lambda: quantised(problems[2], resolution))
    assert all(word in message for word in words), message


def test_a_continuous_controller_takes_no_quantised_measurement(problems):
    message = refusal(lambda: simulate(quantised(problems[2], 0.1), [Mrac(gamma=5.0)], Simulation(t_end=1.0, dt=0.01)))
    assert "sensor.quantization applies only to controllers that sample the sensor" in message


def test_the_linear_margins_are_those_without_quantisation_and_no_bound_is_guaranteed(problems):
    controller, simulation = Sampled(controller=Mrac(gamma=5.0), sample_time=0.125), Simulation(t_end=1.0, dt=2.0**-8)
    (plain,), (found,) = (certify(one, [controller], simulation).values() for one in (problems[1], quantised(problems[1], 0.1)))
    margins = [[(one.key, one.value) for one in each.entries if "margin" in one.key] for each in (found, plain)]
    assert margins[0] == margins[1] and margins[0]
    assert not [one.key for one in found.entries if one.kind == "guaranteed" and "error" in one.key]
