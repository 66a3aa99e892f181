"""Enclosures compared with closed forms and an independent float64 method; invariances, hard cases and rejections."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg
from flint import arb, arb_mat, arb_poly, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from barbalat.linear.enclosure import Enclosure
from barbalat.linear.l1_norms import l1_norm, model
from barbalat.linear.l1_norms.norm import enclosed
from barbalat.linear.l1_norms.pieces import POLYNOMIAL_DEGREE, BernsteinPiece, bernstein_matrix, resolved

ZERO = np.zeros((1, 1))


def holds(found: Enclosure, exact: Fraction | int) -> bool:
    return Fraction(found.lower) <= exact <= Fraction(found.upper)


def holds_ball(found: Enclosure, exact: arb) -> bool:
    """Whether an enclosure contains a very thin ball around the exact value."""
    return bool(arb(found.lower) <= exact <= arb(found.upper))


def companion(numerator, denominator):
    """The controllable form of a strictly proper transfer function with a monic denominator, highest power first."""
    n = len(denominator) - 1
    A = np.eye(n, k=1)
    A[-1] = -np.asarray(denominator[:0:-1], dtype=float)
    C = np.zeros((1, n))
    C[0, : len(numerator)] = numerator[::-1]
    return A, np.eye(n)[:, -1:], C, ZERO


def second_order(zeta, omega):
    return [[0.0, 1.0], [-omega * omega, -2 * zeta * omega]], [[0.0], [1.0]], [[omega * omega, 0.0]], ZERO


def jordan(n):
    return np.eye(n, k=1) - np.eye(n)


def independent_norm(A, B, C, D, steps=4096):
    """A float64 estimate by differences of the step response on a grid with refined sign changes, and its error.

    It is independent of the module: it uses SciPy's matrix exponential and neither balls nor Taylor segments. A double sign
    change within one cell is missed. Each such cell contributes at most (cell width)^3 max|h''| / 6.
    """
    decay = -np.linalg.eigvals(A).real.max()
    horizon = 45.0 / decay
    cell = horizon / steps
    total = np.abs(np.asarray(D, dtype=float))
    missed = 0.0
    for j in range(B.shape[1]):
        states = B[:, j : j + 1]
        move = scipy.linalg.expm(A * cell)
        while states.shape[1] <= steps:
            states = np.hstack([states, move @ states])
            move = move @ move
        for i in range(C.shape[0]):
            c = C[i : i + 1]
            gain = np.linalg.solve(A.T, c.T).T
            h, slope, bend = ((c @ np.linalg.matrix_power(A, k) @ states).ravel() for k in range(3))
            primitive = (gain @ states).ravel()
            cross = np.flatnonzero(h[:-1] * h[1:] < 0)
            local = states[:, cross]
            root = np.zeros(cross.size) + cell * np.abs(h[cross]) / (np.abs(h[cross]) + np.abs(h[cross + 1]))
            for _step in range(6):
                moved, term = local.copy(), local.copy()
                for k in range(1, 16):
                    term = A @ term * (root / k)
                    moved = moved + term
                derivative = (c @ A @ moved).ravel()
                derivative[derivative == 0.0] = np.inf
                root = np.clip(root - (c @ moved).ravel() / derivative, 0.0, cell)
            middle = (gain @ moved).ravel()
            pieces = np.abs(np.diff(primitive))
            pieces[cross] = np.abs(middle - primitive[cross]) + np.abs(primitive[cross + 1] - middle)
            total[i, j] += pieces.sum() + np.abs(primitive[-1])
            dips = np.flatnonzero((slope[:-1] * slope[1:] <= 0) & (h[:-1] * h[1:] > 0))
            dips = dips[np.abs(h[dips]) < np.abs(bend[dips]) * cell**2]
            missed += (np.abs(bend[dips]) * cell**3).sum()
    return total.sum(axis=1).max(), missed


def random_system(rng, n, inputs=1, outputs=1):
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.1, 1.0)) * np.eye(n)
    return A, rng.normal(size=(n, inputs)), rng.normal(size=(outputs, n)), rng.normal(size=(outputs, inputs))


# ---------------------------------------------------------------- closed forms


@given(
    gain=st.floats(-1e6, 1e6, allow_subnormal=False),
    pole=st.floats(1e-6, 1e6),
    feedthrough=st.floats(-10, 10),
)
def test_first_order(gain, pole, feedthrough):
    found = l1_norm([[-pole]], [[1.0]], [[gain]], [[feedthrough]])
    assert holds(found, abs(Fraction(feedthrough)) + abs(Fraction(gain)) / Fraction(pole))
    assert found.converged == (found.relative_width <= 1e-9)


@given(kappa=st.floats(1e-5, 1e3))
def test_low_pass_filter_and_its_complement(kappa):
    pole = 1.0 / kappa  # the float64 pole is the system; the gain is the same float64, so the DC gain is 1 exactly
    assert holds(l1_norm([[-pole]], [[1.0]], [[pole]], [[0.0]]), 1)
    found = l1_norm([[-pole]], [[1.0]], [[-pole]], [[1.0]])
    assert holds(found, 2)
    assert found.converged


@given(zeta=st.floats(1e-4, 0.999), omega=st.floats(0.01, 100.0))
def test_underdamped_second_order(zeta, omega):
    # Overshoots form a geometric series with ratio e^(-pi zeta/sqrt(1-zeta^2)) = e^(-2x): the norm is coth x.
    A, B, C, D = second_order(zeta, omega)
    with ctx.workprec(300):
        stiffness, damping = -arb(A[1][0]), -arb(A[1][1])
        half = damping / 2
        exact = (arb.pi() * half / (2 * (stiffness - half * half).sqrt())).coth() * arb(C[0][0]) / stiffness
        found = l1_norm(A, B, C, D)
        assert holds_ball(found, exact)
    assert found.converged


@pytest.mark.parametrize("zeta", [1.0, 1.25, 3.0, 500.0])
def test_critically_and_overdamped_second_order_is_one(zeta):
    found = l1_norm(*second_order(zeta, 2.0))
    assert holds(found, 1)
    assert found.converged
    assert found.sign_changes == 0


@pytest.mark.parametrize("n", [1, 2, 3, 5, 9, 14, 20])
def test_repeated_pole_is_one(n):
    binomials = [float(math.comb(n, k)) for k in range(n + 1)]
    found = l1_norm(*companion([1.0], binomials))
    assert holds(found, 1)
    assert found.converged


def test_differences_of_exponentials():
    # h = e^-t - 3 e^-2t changes sign once, at e^-t = 1/3: the norm is 2 (3/2 u^2 - u) (1/3)... = 5/6.
    # antiderivative in u = e^-t: H = u - 3/2 u^2 from u = 0 to 1, extreme 1/6 at u = 1/3, end -1/2.
    found = l1_norm(np.diag([-1.0, -2.0]), [[1.0], [1.0]], [[1.0, -3.0]], ZERO)
    assert holds(found, Fraction(1, 6) + Fraction(1, 6) + Fraction(1, 2))
    assert found.sign_changes == 1


def test_parallel_positive_responses_add():
    poles = np.array([0.5, 1.0, 4.0, 1024.0])
    found = l1_norm(-np.diag(poles), np.ones((4, 1)), [[1.0, 2.0, 3.0, 5.0]], [[-0.25]])
    assert holds(found, Fraction(1, 4) + 2 + 2 + Fraction(3, 4) + Fraction(5, 1024))


def test_static_gain_of_order_zero():
    empty = np.zeros((0, 0))
    D = [[1.0, -2.0], [0.1, 0.2]]
    found = l1_norm(empty, np.zeros((0, 2)), np.zeros((2, 0)), D)
    assert (found.lower, found.upper) == (3.0, 3.0)
    assert found.converged
    tenth = l1_norm(empty, np.zeros((0, 2)), np.zeros((1, 0)), [[0.1, 0.2]])
    assert holds(tenth, Fraction(0.1) + Fraction(0.2))


def test_row_maximum_of_a_matrix_system():
    A = -np.diag([1.0, 2.0])
    B = np.eye(2)
    C = [[1.0, -2.0], [0.5, 8.0]]
    D = [[0.0, 3.0], [0.25, 0.0]]
    # rows: 1 + 1 + 3 = 5 and 0.5 + 0.25 + 4 = 4.75
    assert holds(l1_norm(A, B, C, D), 5)
    assert holds(l1_norm(A, B, C[::-1], D[::-1]), 5)
    assert holds(l1_norm(A, B, C[1:], D[1:]), Fraction(19, 4))


# ---------------------------------------------------------------- zeros, tangencies, cancellations


def test_sine_response_that_starts_at_zero():
    # h = e^(-t/4) sin 3t: norm w coth(pi a/2w)/(a^2 + w^2), on the closed-form path and by marching
    with ctx.workprec(300):
        exact = (arb.pi() / 24).coth() * 3 / (9 + arb(1) / 16)
        assert holds_ball(l1_norm([[-0.25, 3.0], [-3.0, -0.25]], [[1.0], [0.0]], [[0.0, -1.0]], ZERO), exact)


@pytest.mark.parametrize("width", [1e-3, 1e-9, 1e-14])
def test_tangency_without_sign_change(width):
    # e^-t (1 - cos t) >= 0 touches zero at every turn; integral 1 - 1/2.
    A = scipy.linalg.block_diag([[-1.0]], [[-1.0, 1.0], [-1.0, -1.0]])
    found = l1_norm(A, [[1.0], [1.0], [0.0]], [[1.0, -1.0, 0.0]], ZERO, relative_width=width)
    assert holds(found, Fraction(1, 2))
    assert found.converged
    assert found.sign_changes == 0


@pytest.mark.parametrize("width", [1e-3, 1e-9, 1e-14])
def test_fourth_order_tangency(width):
    # e^-t (t - 1)^4 = sum of Taylor states: integral 24 - 24 + 12 - 4 + 1 = 9
    found = l1_norm(jordan(5), [[1.0], [-4.0], [12.0], [-24.0], [24.0]], [[1.0, 0, 0, 0, 0]], ZERO, relative_width=width)
    assert holds(found, 9)
    assert found.converged


def test_triple_root_changes_sign_once():
    # e^-t (t - 1)^3: integral of |.| is 12/e - 2 (by parts on both sides of t = 1)
    found = l1_norm(jordan(4), [[-1.0], [3.0], [-6.0], [6.0]], [[1.0, 0, 0, 0]], ZERO)
    with ctx.workprec(200):
        assert holds_ball(found, 12 / arb(1).exp() - 2)
    assert found.sign_changes == 1


def test_identically_zero_channels():
    assert l1_norm([[-1.0, 0.5], [0.5, -1.0]], [[1.0], [1.0]], [[1.0, -1.0]], ZERO).upper == 0.0
    assert l1_norm(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0, 1.0]], ZERO).upper == 0.0
    found = l1_norm(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0, 1.0], [1.0, 0.0]], np.zeros((2, 1)))
    assert holds(found, 1)
    assert l1_norm([[-1.0]], [[0.0]], [[1.0]], [[2.0]]).upper == 2.0


def test_cancellation_down_to_one_unit_in_the_last_place():
    nearby = 1.0 + 2.0**-52
    found = l1_norm(np.diag([-1.0, -nearby]), [[1.0], [1.0]], [[1.0, -1.0]], ZERO)
    assert holds(found, 1 - 1 / Fraction(nearby))  # the difference is positive for all t
    assert found.converged


def test_pole_and_zero_that_nearly_cancel():
    # (s + 1 + e)/((s + 1)(s + 2)) = e/(s + 1) + (1 - e)/(s + 2), both positive
    e = 2.0**-30
    found = l1_norm(*companion([1.0, 1.0 + e], [1.0, 3.0, 2.0]))
    assert holds(found, Fraction(e) + (1 - Fraction(e)) / 2)


# ---------------------------------------------------------------- hard spectra


def test_widely_spread_poles():
    poles = [1e-3, 1.0, 30.0, 1e4]
    found = l1_norm(-np.diag(poles), np.ones((4, 1)), [[1.0, 2.0, 3.0, 4.0]], ZERO)
    assert holds(found, sum(Fraction(k + 1) / Fraction(p) for k, p in enumerate(poles)))
    assert found.converged


def test_widely_spread_poles_with_sign_change():
    # h = e^(-t/1024) - 2 e^(-8192 t): sign change at t with v = e^(-t/1024), v = 2 v^(2^23)
    found = l1_norm(np.diag([-(2.0**-10), -(2.0**13)]), [[1.0], [1.0]], [[1.0, -2.0]], ZERO)
    with ctx.workprec(200):
        time = arb(2).log() / (arb(2) ** 13 - arb(2) ** -10)
        down = 2 * (1 - (-(arb(2) ** 13) * time).exp()) / 2**13 - (1 - (-time / 1024).exp()) * 1024
        assert holds_ball(found, down * 2 + 1024 - arb(2) / 2**13)
    assert found.sign_changes == 1


def test_slow_oscillation_closed_form_agrees_with_marching(monkeypatch):
    rng = np.random.default_rng(5)
    system = random_system(rng, 5)
    A = scipy.linalg.block_diag(system[0] - np.eye(5), [[-0.01, 2.0], [-2.0, -0.01]])
    B = np.vstack([system[1], [[1.0], [0.5]]])
    C = np.hstack([system[2], [[-1.0, 0.3]]])
    quick = l1_norm(A, B, C, ZERO)
    monkeypatch.setattr(model, "slow_oscillation", lambda *_: None)
    enclosed.cache_clear()  # it would be cached otherwise
    slow = l1_norm(A, B, C, ZERO)
    assert slow.segments > 5 * quick.segments
    assert max(quick.lower, slow.lower) <= min(quick.upper, slow.upper)
    assert quick.converged
    assert slow.converged


def test_two_lightly_damped_modes_march():
    A = scipy.linalg.block_diag([[-0.01, 1.0], [-1.0, -0.01]], [[-0.02, 3.0], [-3.0, -0.02]])
    B, C = np.array([[1.0], [0.0], [1.0], [0.0]]), np.array([[1.0, 0.0, 2.0, 0.0]])
    found = l1_norm(A, B, C, ZERO)
    estimate, missed = independent_norm(A, B, C, ZERO, steps=1 << 17)
    assert found.converged
    assert abs(estimate - found.midpoint) <= 1e-9 * estimate + missed
    assert found.sign_changes > 500


def test_damping_of_one_unit_in_the_last_place():
    A, B, C, D = second_order(2.0**-53, 1.0)
    found = l1_norm(A, B, C, D)
    with ctx.workprec(300):
        half = arb(2) ** -53
        assert holds_ball(found, (arb.pi() * half / (2 * (1 - half * half).sqrt())).coth())
    assert found.converged


@pytest.mark.parametrize("shear", [1.0, 1e4, 1e8])
def test_strongly_non_normal(shear):
    found = l1_norm([[-1.0, shear], [0.0, -1.0]], [[0.0], [1.0]], [[1.0, 1.0]], ZERO)
    assert holds(found, Fraction(shear) + 1)


@pytest.mark.parametrize("exponent", [-900, -300, 300, 900])
def test_extreme_time_scale(exponent):
    pole = 2.0**exponent
    found = l1_norm([[-pole, 0.0], [0.0, -3.0 * pole]], [[pole], [3.0 * pole]], [[1.0, 1.0]], ZERO)
    assert holds(found, 2)
    assert found.converged


def test_rounding_noise_is_not_halved_for_ever():
    # Found by hypothesis: at two limbs the sheared system's last segment is all rounding noise, whose sign no halving can
    # resolve. It must be recognised, and the width must still be reached.
    A = np.array([[-7.0, -1.0, -3.0], [2.0, -9.0, 1.0], [-2.0, 1.0, -2.0]])
    B, C = np.array([[2.0], [4.0], [3.0]]), np.array([[-4.0, -1.0, -4.0]])
    for shear in (3.0, 300.0, 2.0**13):
        T = np.array([[1.0, -shear, 0.0], [0.0, 1.0, shear], [0.0, 0.0, 1.0]])
        inverse = np.array([[1.0, shear, -shear * shear], [0.0, 1.0, -shear], [0.0, 0.0, 1.0]])
        assert (inverse @ T == np.eye(3)).all()
        found = l1_norm(inverse @ A @ T, inverse @ B, C @ T, ZERO)
        plain = l1_norm(A, B, C, ZERO)
        assert found.converged
        assert found.segments < 20_000
        assert max(found.lower, plain.lower) <= min(found.upper, plain.upper)


def test_noise_that_cannot_be_resolved_is_kept_as_a_gap():
    with ctx.workprec(128):
        noise = arb_poly([arb(0, 1e-9)] * (POLYNOMIAL_DEGREE + 1))
        piece = BernsteinPiece([arb(0, 1e-9)] * (POLYNOMIAL_DEGREE + 1))
        assert piece.blurred()
        (kept,) = resolved(noise, piece, arb(1e-30), room=1000)
        assert kept is piece
        wave = arb_poly([arb(0), arb(1), arb(-3), arb(2)])
        column = arb_mat([[value] for value in [0, 1, -3, 2] + [0] * (POLYNOMIAL_DEGREE - 3)])
        rough = BernsteinPiece((bernstein_matrix(128) * column).entries())
        assert not rough.blurred()
        assert len(resolved(wave, rough, arb(2) ** -200, room=5)) <= 6


def test_work_limit_leaves_a_valid_interval_and_says_so():
    A = scipy.linalg.block_diag([[-5e-3, 1.0], [-1.0, -5e-3]], [[-5e-3, 3.0], [-3.0, -5e-3]])
    B, C = np.array([[1.0], [0.0], [1.0], [0.0]]), np.array([[1.0, 0.0, 1.0, 0.0]])
    wide = l1_norm(A, B, C, ZERO, work_limit=200)
    full = l1_norm(A, B, C, ZERO)
    assert not wide.converged
    assert wide.lower <= full.lower
    assert full.upper <= wide.upper
    assert full.converged
    many = l1_norm(A, np.hstack([B, B]), C, np.zeros((1, 2)), work_limit=200)
    assert many.lower <= 2 * full.lower
    assert 2 * full.upper <= many.upper


# ---------------------------------------------------------------- the field's example


def low_pass_mismatch(kappa):
    """W_b(s)(1 - C(s)) with three states for A_m = [[0, 1], [-0.3, -1]], b = [0, 1] and C = 1/(kappa s + 1)."""
    pole = 1.0 / kappa
    A = [[0.0, 1.0, 0.0], [-0.3, -1.0, -pole], [0.0, 0.0, -pole]]
    return np.array(A), np.array([[0.0], [1.0], [1.0]]), np.eye(2, 3), np.zeros((2, 1))


def test_l1_adaptive_control_example():
    found = [l1_norm(*low_pass_mismatch(kappa)) for kappa in (0.05, 0.049)]
    assert found[0].lower * 10.0 > 1.0 > found[1].upper * 10.0
    for kappa, enclosure in zip((0.05, 0.049), found, strict=True):
        estimate, missed = independent_norm(*low_pass_mismatch(kappa), steps=1 << 15)
        assert abs(estimate - enclosure.midpoint) <= 1e-9 * estimate + missed
        assert enclosure.converged
    A, b = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([[0.0], [1.0]])
    rate = l1_norm(A, b, A, b)  # s W_b(s) = b + A (sI - A)^-1 b
    estimate, missed = independent_norm(A, b, A, b)
    assert abs(estimate - rate.midpoint) <= 1e-9 * estimate + missed
    assert rate.converged


# ---------------------------------------------------------------- random systems, independent method


@pytest.mark.parametrize(("order", "count"), [(1, 300), (2, 500), (3, 400), (4, 400), (6, 200), (8, 150), (12, 60), (20, 20)])
def test_random_systems_against_an_independent_method(order, count, sample):
    rng = np.random.default_rng(order)
    for index in range(sample(-(-count // 10), count)):
        inputs, outputs = (1, 1) if index % 4 else (int(rng.integers(1, 3)), int(rng.integers(1, 4)))
        system = random_system(rng, order, inputs, outputs)
        found = l1_norm(*system)
        estimate, missed = independent_norm(*system)
        rounding = 1e-9 * estimate
        assert found.lower <= estimate + rounding + missed, (order, index)
        assert estimate - rounding <= found.upper, (order, index)
        assert found.converged
        assert found.relative_width <= 1e-9


@pytest.mark.full
def test_many_random_systems_at_every_width():
    rng = np.random.default_rng(99)
    for index in range(10_000):
        system = random_system(rng, int(rng.integers(1, 7)))
        narrow = l1_norm(*system, relative_width=1e-14)
        wide = l1_norm(*system, relative_width=float(10 ** rng.uniform(-12, -0.31)))
        assert wide.lower <= narrow.upper, index
        assert narrow.lower <= wide.upper, index
        assert narrow.converged
        assert wide.converged


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_wide_and_narrow_enclosures_overlap(order, sample):
    # At a wide tolerance the error bounds dominate, so a wrong bound would show.
    rng = np.random.default_rng(10 + order)
    for index in range(sample(15, 60)):
        system = random_system(rng, order)
        narrow = l1_norm(*system, relative_width=1e-14)
        for width in (0.5, 0.03, 1e-3, 1e-6):
            wide = l1_norm(*system, relative_width=width)
            assert wide.lower <= narrow.upper, (index, width)
            assert narrow.lower <= wide.upper, (index, width)
            assert wide.converged
        assert narrow.relative_width <= 1e-14


# ---------------------------------------------------------------- invariances

small = st.integers(-4, 4).map(float)


def dyadic_system(draw_matrix, n):
    """A system of small integers, shifted to be stable, so integer similarity transforms are exact in float64."""
    A = np.array(draw_matrix[: n * n]).reshape(n, n)
    A = A - (math.ceil(np.linalg.eigvals(A).real.max()) + 1.0) * np.eye(n)
    return A, np.array(draw_matrix[n * n : n * n + n]).reshape(n, 1), np.array(draw_matrix[-n:]).reshape(1, n)


@settings(max_examples=60)
@given(
    values=st.lists(small, min_size=15, max_size=15),
    shear=st.lists(st.integers(-3, 3), min_size=3, max_size=3),
)
def test_invariant_under_exact_similarity(values, shear):
    A, B, C = dyadic_system(values, 3)
    T = np.array([[1.0, shear[0], shear[1]], [0.0, 1.0, shear[2]], [0.0, 0.0, 1.0]])
    inverse = np.array([[1.0, -shear[0], shear[0] * shear[2] - shear[1]], [0.0, 1.0, -shear[2]], [0.0, 0.0, 1.0]])
    assert (inverse @ T == np.eye(3)).all()
    scale = np.diag([1.0, 2.0**20, 2.0**-30])
    first = l1_norm(A, B, C, ZERO)
    for second in (
        l1_norm(inverse @ A @ T, inverse @ B, C @ T, ZERO),
        l1_norm(np.linalg.inv(scale) @ A @ scale, np.linalg.inv(scale) @ B, C @ scale, ZERO),
        l1_norm(A.T, C.T, B.T, ZERO),
        l1_norm(4.0 * A, 4.0 * B, C, ZERO),
    ):
        assert max(first.lower, second.lower) <= min(first.upper, second.upper)
        assert second.converged


@settings(max_examples=40)
@given(values=st.lists(small, min_size=15, max_size=15), exponent=st.integers(-200, 200))
def test_scales_with_the_output(values, exponent):
    A, B, C = dyadic_system(values, 3)
    one, many = l1_norm(A, B, C, ZERO), l1_norm(A, B, C * 2.0**exponent, ZERO)
    assert many.lower <= one.upper * 2.0**exponent
    assert one.lower * 2.0**exponent <= many.upper


@settings(max_examples=40)
@given(
    first=st.lists(small, min_size=8, max_size=8),
    second=st.lists(small, min_size=8, max_size=8),
    feedthrough=st.tuples(small, small),
)
def test_triangle_and_product_inequalities(first, second, feedthrough):
    (A1, B1, C1), (A2, B2, C2) = dyadic_system(first, 2), dyadic_system(second, 2)
    d1, d2 = (np.array([[value]]) for value in feedthrough)
    one, two = l1_norm(A1, B1, C1, d1), l1_norm(A2, B2, C2, d2)
    blocks = scipy.linalg.block_diag(A1, A2)
    both = l1_norm(blocks, np.vstack([B1, B2]), np.hstack([C1, C2]), d1 + d2)
    assert both.lower <= math.nextafter(one.upper + two.upper, math.inf)
    series = np.block([[A1, np.zeros((2, 2))], [B2 @ C1, A2]])
    product = l1_norm(series, np.vstack([B1, B2 @ d1]), np.hstack([d2 @ C1, C2]), d2 @ d1)
    assert product.lower <= math.nextafter(one.upper * two.upper, math.inf)


def test_column_system_is_the_largest_of_its_rows():
    A, B, C, D = random_system(np.random.default_rng(8), 4, 1, 4)
    rows = [l1_norm(A, B, C[i : i + 1], D[i : i + 1]) for i in range(4)]
    found = l1_norm(A, B, C, D)
    assert found.lower <= max(row.upper for row in rows)
    assert max(row.lower for row in rows) <= found.upper


# ---------------------------------------------------------------- rejections


@pytest.mark.parametrize(
    ("A", "quoted"),
    [
        ([[0.5]], "0.5"),
        ([[0.0]], "0"),
        ([[0.0, 1.0], [-1.0, 0.0]], "0"),
        ([[-1.0, 1.0], [1.0, -1.0]], "0"),
        ([[-3.0, 0.0], [0.0, 2.0]], "2"),
        ([[2.0**-1000]], "9.3"),
    ],
)
def test_refuses_what_is_not_hurwitz(A, quoted):
    n = len(A)
    for B in (np.ones((n, 1)), np.zeros((n, 1))):
        with pytest.raises(ValueError, match=f"certainly Hurwitz.* real part is {quoted}"):
            l1_norm(A, B, np.ones((1, n)), ZERO)


def test_defective_spectrum_that_float64_takes_for_unstable():
    # One Jordan block of order 12 at -1/64, mixed by an exact unimodular integer matrix:
    # h = t^11/11! e^(-t/64).
    n, pole = 12, 2.0**-6
    mixing = scipy.linalg.pascal(n, kind="lower").astype(float)
    inverse = scipy.linalg.invpascal(n, kind="lower").astype(float)
    A = mixing @ (np.eye(n, k=1) - pole * np.eye(n)) @ inverse
    assert np.linalg.eigvals(A).real.max() > 0
    found = l1_norm(A, mixing[:, -1:], inverse[:1], ZERO)
    assert holds(found, 64**n)
    assert found.converged


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (([[-1.0, 0.0]], [[1.0]], [[1.0]], [[0.0]]), "shapes"),
        (([[-1.0]], [[1.0], [1.0]], [[1.0]], [[0.0]]), "shapes"),
        (([[-1.0]], [[1.0]], [[1.0, 1.0]], [[0.0]]), "shapes"),
        (([[-1.0]], [1.0], [[1.0]], [[0.0]]), "two-dimensional"),
        (([[-math.inf]], [[1.0]], [[1.0]], [[0.0]]), "finite"),
        (([[-1.0]], [[math.nan]], [[1.0]], [[0.0]]), "finite"),
    ],
)
def test_refuses_malformed_systems(system, message):
    with pytest.raises(ValueError, match=message):
        l1_norm(*system)


def test_refuses_unusable_options():
    system = ([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    for width in (0.0, -1.0, 1.0, math.nan, 1e-17):
        with pytest.raises(ValueError, match="relative_width"):
            l1_norm(*system, relative_width=width)
    with pytest.raises(ValueError, match="work_limit"):
        l1_norm(*system, work_limit=0)


def test_overflow_and_precision_limit_are_errors():
    with pytest.raises(OverflowError, match="float64"):
        l1_norm([[-1e-300]], [[1e150]], [[1e150]], ZERO)
    with pytest.raises(ArithmeticError, match="bits"):
        l1_norm(np.diag([-1e-150, -1e150]), [[1.0], [1.0]], [[1e-150, 1.0]], ZERO)


def test_precision_of_the_caller_is_left_alone():
    with ctx.workprec(77):
        l1_norm([[-1.0, 1.0], [0.0, -2.0]], [[1.0], [1.0]], [[1.0, -3.0]], ZERO)
        with pytest.raises(ValueError, match="Hurwitz"):
            l1_norm([[1.0]], [[1.0]], [[1.0]], ZERO)
        assert ctx.prec == 77


def test_result_is_frozen():
    found = l1_norm([[-1.0]], [[1.0]], [[1.0]], ZERO)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.lower = 0.0  # type: ignore[misc]
    assert found.lower <= found.midpoint <= found.upper


def test_entries_too_far_apart_are_refused_at_once():
    """Exact roots of a cubic with 800-bit coefficients took eight seconds for each precision tried."""
    A = np.array([[-1.0, 7.5e246, 0.0], [0.0, -2.0, 1.0], [-1e-3, 0.0, -3.0]])
    with pytest.raises(ArithmeticError, match="too far apart"):
        l1_norm(A, np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1)))
    near = l1_norm(np.diag([-1.0, -1e-30, -1e30]), np.eye(3)[:, :1], np.eye(3)[:1], np.zeros((1, 1)))
    assert near.lower <= 1.0 <= near.upper
