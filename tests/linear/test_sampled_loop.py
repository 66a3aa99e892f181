"""Sampled loops with delays within samples, compared with characteristic polynomials by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.linear.margins import margins
from barbalat.linear.sampled_loop import SampledLoop, delay_margin, gain_margins
from barbalat.linear.sampled_norms import SampledNorms
from independent import refusal


def integrator(k: float, T: float) -> SampledLoop:
    """The loop x' = v with u = -k x at the samples and the state X = (x, u)."""
    return SampledLoop(np.zeros((2, 2)), np.array([[1.0], [0.0]]), np.array([[1.0, 0.0], [-k, 0.0]]), np.array([[0.0, 1.0]]), T)


@pytest.mark.parametrize("kT", [1.05, 1.2, 1.6, 1.9])
def test_the_delay_margin_inside_the_first_sample(kT):
    """By Jury's conditions z^2 - (1 - k (T - d)) z + k d is stable while k d < 1."""
    T = 0.01
    assert delay_margin(integrator(kT / T, T), 0.0) == pytest.approx(T / kT, rel=1e-6)


def radius_by_hand(k, T, d):
    """The largest root of z^(l+2) - z^(l+1) + k (T - f) z + k f with d = l T + f, by hand."""
    whole, f = divmod(round(d / T, 9), 1.0)
    polynomial = np.zeros(int(whole) + 3)
    polynomial[:2] = 1.0, -1.0
    polynomial[-2] += k * T * (1 - f)
    polynomial[-1] += k * T * f
    return np.abs(np.roots(polynomial)).max()


@pytest.mark.parametrize("d", [0.0, 0.003, 0.0099, 0.01, 0.0234, 0.05])
def test_the_closed_loop_with_any_delay(d):
    assert integrator(7.0, 0.01).radius(d) == pytest.approx(radius_by_hand(7.0, 0.01, d), rel=1e-9)


@pytest.mark.parametrize("kT", [0.0123, 0.0051])
def test_a_delay_margin_of_hundreds_of_samples(kT):
    """The largest root written by hand passes 1 within a hundred-millionth of the margin."""
    T = 0.01
    margin = delay_margin(integrator(kT / T, T), 0.0)
    assert margin > 100 * T
    assert radius_by_hand(kT / T, T, margin - 1e-6 * T) < 1 < radius_by_hand(kT / T, T, margin + 1e-6 * T)


def test_long_delays_are_stable_where_the_spectral_radius_is_below_one(sample):
    """The argument principle and the eigenvalues agree for random loops with one or two inputs, whose plants have integrators and
    unstable modes, at delays of more than a hundred samples."""
    random, seen = np.random.default_rng(10), set()
    for _ in range(sample(12, 200)):
        n, m, T = int(random.integers(1, 4)), int(random.integers(1, 3)), 0.01
        A, E, J = np.zeros((n + m, n + m)), np.zeros((n + m, m)), np.eye(n + m)
        A[:n, :n] = np.diag(random.choice([0.0, -1.0, -1.0, 0.01], n)) + np.triu(random.normal(size=(n, n)), 1)
        E[:n], J[n:], C = random.normal(size=(n, m)), 0.0, np.eye(n + m)[n:]
        J[n:, :n] = -random.normal(size=(m, n)) * 10 ** random.uniform(-3, 0)
        loop, delays = SampledLoop(A, E, J, C, T), random.uniform(101, 160, m) * T
        radius = loop.radius(delays)
        assert loop.is_stable(delays) == (radius < 1)
        seen.add(radius < 1)
    assert seen == {True, False}


def test_gain_and_phase_margin_of_the_integrator():
    """|1 - k T| < 1 gives the factor 2/(k T). |L| = k T/|z - 1| = 1 at w T = 2 asin(k T/2), where the phase is -pi/2 - w T/2."""
    kT = 0.4
    found = margins(integrator(kT / 0.01, 0.01).as_continuous(0.0))
    assert found.gain_up == pytest.approx(2 / kT, rel=1e-9)
    assert found.phase == pytest.approx(np.pi / 2 - np.arcsin(kT / 2), rel=1e-9)


def test_the_delay_margin_is_where_the_radius_passes_one(sample):
    """Random stable loops of a second-order plant with a lag are stable on a grid of delays up to the margin and unstable
    beyond."""
    random, seen = np.random.default_rng(3), 0
    for _ in range(sample(4, 60)):
        T = 10 ** random.uniform(-2, -0.5)
        A = np.zeros((3, 3))
        A[:2, :2] = [[0.0, 1.0], -random.uniform(0.1, 4.0, 2)]
        K = random.uniform(-1, 4, 2)
        J = np.eye(3)
        J[2] = [-K[0], -K[1], random.uniform(0, 0.7)]  # u[k] = -K x[k] + c u[k-1]
        loop = SampledLoop(A, np.array([[0.0], [1.0], [0.0]]), J, np.array([[0.0, 0.0, 1.0]]), T)
        if loop.radius(0.0) >= 1:
            assert "spectral radius" in refusal(lambda loop=loop: delay_margin(loop, 0.0))
            continue
        margin = delay_margin(loop, 0.0)
        ends = 40 * T if np.isinf(margin) else margin
        assert max(loop.radius(d) for d in np.linspace(0, ends * (1 - 1e-5), 33)) < 1
        if np.isfinite(margin):
            seen += 1
            assert loop.radius(margin * (1 + 1e-4)) > 1
    assert seen > 0


def test_a_loop_whose_gain_stays_just_below_one_tolerates_every_delay():
    """|L| is at most 0.985, so no delay destabilises the loop, and a search for one would not end."""
    A = np.array([[0.0, 1.0, 0.0], [-3.2281, -3.6519, 0.0], [0.0, 0.0, 0.0]])
    J = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.4941, -2.048, 0.3927]])
    loop = SampledLoop(A, np.array([[0.0], [1.0], [0.0]]), J, np.array([[0.0, 0.0, 1.0]]), 0.16285)
    assert np.isinf(delay_margin(loop, 0.0))
    assert 0.999 < loop.radius(60 * loop.T) < 1 and loop.radius(200 * loop.T) < 1


def test_sums_and_largest_values_are_bounds_that_are_close():
    random = np.random.default_rng(1)
    A = random.normal(size=(5, 5))
    M, C, N = expm(0.3 * (A - 4 * np.eye(5))), random.normal(size=(2, 5)), random.normal(size=(5, 3))
    terms = np.abs([C @ np.linalg.matrix_power(M, k) @ N for k in range(400)])
    norms = SampledNorms(M, C)
    for found, exact in ((norms.summed(N), terms.sum(axis=0)), (norms.largest(N), terms.max(axis=0))):
        assert (found >= exact).all()
        assert (found <= exact + 3e-3 * terms.sum(axis=0).max()).all()  # the tail's share
    assert "unstable" in refusal(lambda: SampledNorms(np.eye(2), np.eye(2)).summed(np.eye(2)))


A_2, B_2 = np.array([[-0.4, 1.0, 0.3], [-0.7, -0.2, 0.0], [0.5, 0.0, -0.1]]), np.array([[0.4, 1.0], [1.0, -0.2], [0.3, 0.8]])
K_2 = np.array([[0.9, 1.4, -0.5], [1.1, -1.3, 0.8]])
T_2 = 0.2


def two_inputs() -> SampledLoop:
    """The loop x' = A x + B v with u = -K x at the samples and the state X = (x, u)."""
    A, E, J = np.zeros((5, 5)), np.zeros((5, 2)), np.eye(5)
    A[:3, :3], E[:3], J[3:] = A_2, B_2, np.hstack([-K_2, np.zeros((2, 2))])
    return SampledLoop(A, E, J, np.eye(5)[3:], T_2)


def closed_by_hand(delays, gains=(1.0, 1.0)):
    """The largest |z| of the map to x[k+1] and each input's last samples, written by hand for u_i(t) = -g_i K_i x at t - d_i."""
    depth = 1 + int(max(delays) // T_2) + 1
    M = np.zeros((3 + 2 * depth, 3 + 2 * depth))
    M[:3, :3] = expm(A_2 * T_2)
    of_x = np.zeros((2, 3 + 2 * depth))
    of_x[:, :3] = -K_2
    for i, d in enumerate(delays):
        whole, part = int(d // T_2), d % T_2
        held = lambda t, i=i: np.linalg.solve(A_2, (expm(A_2 * t) - np.eye(3)) @ B_2[:, i])  # noqa: E731
        for age, effect in ((whole, held(T_2 - part)), (whole + 1, held(T_2) - held(T_2 - part))):
            source = of_x[i] if age == 0 else np.eye(len(M))[3 + i * depth + age - 1]
            M[:3] += gains[i] * np.outer(effect, source)
        M[3 + i * depth] = of_x[i]
        M[4 + i * depth : 3 + (i + 1) * depth, 3 + i * depth : 2 + (i + 1) * depth] = np.eye(depth - 1)
    return np.abs(np.linalg.eigvals(M)).max()


@pytest.mark.parametrize("at", [None, 0, 1])
@pytest.mark.parametrize("own", [0.0, 0.05, 0.2])
def test_the_delay_of_one_of_several_inputs_and_of_all(at, own):
    """The loop is stable on a grid of smaller delays and unstable a millionth above. ``own`` is the delay that all inputs already
    have."""
    margin = delay_margin(two_inputs(), own, at)
    moved = np.ones(2) if at is None else np.eye(2)[at]
    assert max(closed_by_hand(own + late * moved) for late in np.linspace(0, margin * (1 - 1e-6), 40)) < 1
    assert closed_by_hand(own + margin * (1 + 1e-6) * moved) > 1


def test_the_gain_of_one_of_several_inputs_and_of_all():
    """The gain is the first factor of a fine grid at which the loop written by hand is unstable, and the loop changes within 1e-9
    of the result."""
    loop, delay = two_inputs(), 0.05
    found = {None: gain_margins(loop, delay)}
    for i in range(2):
        alone = margins(loop.as_continuous(delay, i))
        found[i] = alone.gain_down, alone.gain_up
    for at, (down, up) in found.items():
        moved = np.ones(2) if at is None else np.eye(2)[at]

        def radius(k, moved=moved):
            return closed_by_hand([delay, delay], 1 + (k - 1) * moved)

        assert max(radius(k) for k in np.linspace(max(down, 1e-3) * (1 + 1e-9), up * (1 - 1e-9), 400)) < 1
        assert radius(up * (1 + 1e-9)) > 1
        assert down == 0 or radius(down * (1 - 1e-9)) > 1
    assert found[None][1] < min(found[0][1], found[1][1])


def test_an_unstable_plant_tolerates_no_factor_that_is_too_small():
    """Two plants x' = a x + v with u = -3 f x have |e^(aT) - 3 f (e^(aT) - 1)/a| < 1 between two factors f each."""
    T = 0.1
    for a, b in ((0.5, 1.0), (1.5, 0.3)):
        A, E, J = np.zeros((4, 4)), np.zeros((4, 2)), np.eye(4)
        A[:2, :2], E[:2], J[2:] = np.diag([a, b]), np.eye(2), np.hstack([-3 * np.eye(2), np.zeros((2, 2))])
        loop = SampledLoop(A, E, J, np.eye(4)[2:], T)
        held = [np.expm1(one * T) / one for one in (a, b)]  # x[k+1] = e^(aT) x - 3 f held x
        low, high = zip(*((one / 3, (np.exp(one * T) + 1) / (3 * h)) for one, h in zip((a, b), held, strict=True)), strict=True)
        assert gain_margins(loop, 0.0) == pytest.approx((max(low), min(high)), rel=1e-9)
