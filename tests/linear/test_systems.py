from __future__ import annotations

import control
import numpy as np
import pytest
from scipy import signal as scipy_signal

from barbalat.controllers.parametric_model import auxiliary_filter, minimum_phase_model
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter, transfer_function
from barbalat.problem.state_feedback import Known
from independent import refusal

FREQUENCIES = np.logspace(-3, 4, 60)  # rad/s


def response(system: StateSpace, w=FREQUENCIES) -> np.ndarray:
    """C (jw I - A)^-1 B + D, solved for each frequency."""
    n = system.order
    return np.array([system.C @ np.linalg.solve(1j * f * np.eye(n) - system.A, system.B) + system.D for f in w])


def companion(polynomial: np.ndarray) -> np.ndarray:
    """The phase-variable matrix of a monic polynomial, highest power first. With b = e_n, c'(sI - A)^-1 b = c(s)/polynomial."""
    A = np.diag(np.ones(len(polynomial) - 2), 1)
    A[-1] = -polynomial[:0:-1]
    return A


def random_pair(random, n, relative_degree, rate=1.0):
    """(c, A, b, num, den) of a system with known polynomials, in random coordinates with a moderate condition number."""
    den = np.poly(-rate * random.uniform(0.3, 3.0, n))
    num = random.uniform(0.5, 2.0) * np.atleast_1d(np.poly(-rate * random.uniform(0.3, 3.0, n - relative_degree)))
    T = np.linalg.qr(random.normal(size=(n, n)))[0] @ np.diag(random.uniform(0.5, 2, n))
    c = np.zeros(n)
    c[: len(num)] = num[::-1]
    return c @ np.linalg.inv(T), T @ companion(den) @ np.linalg.inv(T), T @ np.eye(n)[-1], num, den


@pytest.mark.parametrize("relative_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_realisation_has_the_frequency_response(order, relative_degree):
    """The response agrees with SciPy's evaluation of the polynomials and with python-control's state space."""
    relative_degree = min(relative_degree, order)
    random = np.random.default_rng(10 * order + relative_degree)
    den = np.poly(-random.uniform(0.1, 50, order))
    num = 3.0 * np.atleast_1d(np.poly(-random.uniform(0.1, 50, order - relative_degree)))
    system = TransferFunction(num, den).realise()
    scipys = scipy_signal.freqs(num, den, FREQUENCIES)[1]
    controls = control.tf2ss(num, den)(1j * FREQUENCIES)
    # 1e-10: solving with companion matrices of up to order 5 and poles over three decades amplifies 1e-16 by at most 1e5
    np.testing.assert_allclose(response(system), scipys, rtol=1e-10)
    np.testing.assert_allclose(response(system), controls, rtol=1e-10)
    assert system.order == order


def test_realisation_scales_by_powers_of_two_only():
    """The unscaled controllable form has the Markov parameters C A^k B. With scaling by powers of two they are identical."""
    system = TransferFunction([3.0, 7.0], [1.0, 1e4, 1e7]).realise()
    A, B, C = np.array([[-1e4, -1e7], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([3.0, 7.0])
    for k in range(4):
        assert system.C @ np.linalg.matrix_power(system.A, k) @ system.B == C @ np.linalg.matrix_power(A, k) @ B
    assert np.abs(system.A).max() < 1e5  # 1e7 unscaled, so the balancing has an effect


def test_a_constant_has_no_state():
    system = TransferFunction([4.0], [2.0]).realise()
    assert (system.order, system.D) == (0, 2.0)
    assert system.output(np.zeros(0), 3.0) == 6.0


def test_leading_zeros_and_scale_do_not_matter():
    plain, padded = TransferFunction([1.0, 2.0], [1.0, 3.0, 4.0]), TransferFunction([0, 0, 2, 4], [0, 2, 6, 8])
    assert padded.num.tolist() == plain.num.tolist()
    assert padded.den.tolist() == plain.den.tolist()
    assert padded.relative_degree == 1


def test_an_improper_system_has_no_realisation():
    assert "proper" in refusal(lambda: TransferFunction([1.0, 0.0, 0.0], [1.0, 1.0]).realise())


def test_input_filter_is_a_unit_gain_lag():
    """By Eq. (6) the filter passes half of the power at w = 1/kappa."""
    C = input_filter(0.02)
    assert C.dc_gain == 1.0
    assert C.poles == pytest.approx([-50.0], rel=1e-15)
    assert abs(response(C.realise(), [50.0])[0]) == pytest.approx(1 / np.sqrt(2), rel=1e-14)


@pytest.mark.parametrize("make", [control.tf, lambda n, d: control.ss(control.tf(n, d))], ids=["tf", "ss"])
def test_accepts_python_control(make):
    given = make([30.0], [1.0, 10.0, 30.0])
    taken = TransferFunction.accept("filter", given)
    np.testing.assert_allclose(response(taken.realise()), given(1j * FREQUENCIES), rtol=1e-12)
    assert taken.relative_degree == 2


@pytest.mark.parametrize(("relative_degree", "n"), [(1, 1), (1, 2), (2, 2), (1, 3), (2, 3), (3, 3), (1, 4), (4, 4), (3, 5)])
def test_transfer_function_of_a_state_space(n, relative_degree):
    """The result equals the polynomials from which the matrices were built, and the response computed by solving."""
    random = np.random.default_rng(100 * n + relative_degree)
    for _ in range(10):
        c, A, b, num, den = random_pair(random, n, relative_degree)
        found = transfer_function(c, A, b)
        assert found.relative_degree == relative_degree
        # a change of coordinates with a condition number < 10 and n products: about 1e-13
        np.testing.assert_allclose(found.num, num, rtol=1e-10)
        np.testing.assert_allclose(found.den, den, rtol=1e-10)
        np.testing.assert_allclose(response(found.realise()), response(StateSpace(A, b, c, 0.0)), rtol=1e-8, atol=1e-16)


@pytest.mark.parametrize("rate", [1e-3, 1.0, 20.0, 300.0, 1e4])
@pytest.mark.parametrize(("relative_degree", "n"), [(2, 2), (3, 3), (2, 3), (4, 4), (2, 4)])
def test_relative_degree_at_any_time_scale(n, relative_degree, rate):
    """In phase variables the leading coefficients of the numerator are exact zeros or exact entries of c."""
    random = np.random.default_rng(n)
    den = np.poly(-rate * random.uniform(0.5, 2.0, n))
    num = np.atleast_1d(np.poly(-rate * random.uniform(0.5, 2.0, n - relative_degree)))
    c = np.zeros(n)
    c[: len(num)] = num[::-1]
    found = transfer_function(c, companion(den), np.eye(n)[-1])
    assert found.relative_degree == relative_degree
    np.testing.assert_allclose(found.num, num, rtol=1e-12)


def test_a_zero_beside_a_pole_is_kept():
    """(s + 1)/((s + 1 + 1e-7)(s + 2)) nearly cancels but is of order 2. The response shows the difference of 1e-7 at w = 0."""
    gap = 1e-7
    den = np.poly([-1 - gap, -2])
    found = transfer_function(np.array([1.0, 1.0]), companion(den), np.array([0.0, 1.0]))
    assert len(found.den) == 3
    assert found.zeros == pytest.approx([-1.0], rel=1e-14)
    np.testing.assert_allclose(found.dc_gain, 1 / (2 * (1 + gap)), rtol=1e-15)
    np.testing.assert_allclose(found.poles.min(), -2, rtol=1e-12)


def known(A_m, b) -> Known:
    n = len(b)
    return Known(A_m=np.asarray(A_m), b=np.asarray(b), k_0=1.0, x0=np.zeros(n), estimate_set=None)


@pytest.mark.parametrize(("relative_degree", "n"), [(1, 1), (1, 2), (2, 2), (1, 3), (2, 3), (3, 3), (2, 4), (4, 4)])
def test_Q_inverts_W_m_up_to_the_lag(n, relative_degree):
    """Q(jw) W_m(jw) (tau jw + 1)^n* = 1, with each factor computed from separate matrices."""
    random = np.random.default_rng(n + 10 * relative_degree)
    for tau in (1e-3, 0.5, 10.0):
        c, A, b, _, _ = random_pair(random, n, relative_degree)
        Q = auxiliary_filter(minimum_phase_model(c, known(A, b)), tau)
        assert Q.order == n
        assert (np.linalg.eigvals(Q.A).real < 0).all()
        W_m = response(StateSpace(A, b, c, 0.0))
        lag = (tau * 1j * FREQUENCIES + 1) ** relative_degree
        # W_m falls as w^-n* and loses digits in the solve at high frequencies: compare only where they remain. Q is the small
        # difference of C(jwI - A)^-1 B and D, which is as large as tau^-n*: a rounding of D counts in it
        held = np.abs(W_m) > 1e-9
        error = np.abs(response(Q) * W_m * lag - 1)[held]
        assert (error < 1e-6 + 1e3 * np.finfo(float).eps * abs(Q.D) * np.abs(W_m * lag)[held]).all()


def test_Q_of_section_v(section_v):
    """By hand, W_m = (s + 1)/(s^2 + s + 0.3), so Q = (s^2 + s + 0.3)/((s + 1)(0.5 s + 1))."""
    W_m = minimum_phase_model(np.array([1.0, 1.0]), section_v.known)
    np.testing.assert_allclose(W_m.num, [1, 1], rtol=1e-15)
    np.testing.assert_allclose(W_m.den, [1, 1, 0.3], rtol=1e-15)
    expected = scipy_signal.freqs([1, 1, 0.3], [0.5, 1.5, 1], FREQUENCIES)[1]
    np.testing.assert_allclose(response(auxiliary_filter(W_m, 0.5)), expected, rtol=1e-12)


@pytest.mark.parametrize("rate", [1.0, 20.0, 1e3])
def test_a_minimum_phase_chain_is_accepted_at_any_time_scale(rate):
    """c_0 = e_1 on four equal lags has relative degree 4 and no zeros."""
    A = companion(np.poly([-rate] * 4))
    W_m = minimum_phase_model(np.eye(4)[0], known(A, np.eye(4)[-1]))
    assert W_m.relative_degree == 4


def test_a_zero_at_the_origin_is_found_in_any_coordinates():
    """c_0'A_m^-1 b = 0 up to rounding means a zero at s = 0, on the imaginary axis, where Q would have a pole."""
    random = np.random.default_rng(3)
    for _ in range(20):
        T = np.linalg.qr(random.normal(size=(2, 2)))[0]
        A, b, c = T @ companion(np.array([1.0, 1.0, 0.3])) @ T.T, T @ [0.0, 1.0], T @ [0.0, 1.0]
        assert "minimum phase" in refusal(lambda A=A, b=b, c=c: minimum_phase_model(c, known(A, b)))
