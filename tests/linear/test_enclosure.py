"""The basis: outward floats, exact spectra, decay certificates and the closed form of one oscillation."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg
from flint import acb, arb, arb_mat, ctx
from hypothesis import given
from hypothesis import strategies as st

from barbalat.linear.enclosure import Enclosure, float_above, float_below
from barbalat.linear.l1_norms.decay import decay_certificate, eigenvalues, require_hurwitz, scaled
from barbalat.linear.l1_norms.model import _oscillation_integral, slow_oscillation


@given(top=st.integers(-(10**40), 10**40), bottom=st.integers(1, 10**40), exponent=st.integers(-900, 880))
def test_outward_floats_are_outward_and_tight(top, bottom, exponent):
    with ctx.workprec(400):
        ball = arb(top) / arb(bottom) * arb(2) ** exponent
    exact = Fraction(top, bottom) * Fraction(2) ** exponent
    with ctx.workprec(64):  # a later, lower precision must not spoil the direction
        low, high = float_below(ball), float_above(ball)
    assert Fraction(low) <= exact <= Fraction(high)
    with ctx.workprec(400):
        low, high = float_below(ball), float_above(ball)
    assert Fraction(low) <= exact <= Fraction(high)
    assert high <= math.nextafter(low, math.inf)


def test_outward_floats_of_exact_values_are_exact():
    for value in (0.0, 1.0, -3.5, 5e-324, 1.7976931348623157e308):
        assert float_below(arb(value)) == value == float_above(arb(value))
    assert math.copysign(1.0, float_above(arb(0))) == 1.0


def test_outward_floats_beyond_the_range():
    huge = arb(2) ** 5000
    assert float_above(huge) == math.inf
    assert float_below(huge) == 1.7976931348623157e308
    tiny = arb(2) ** -5000
    assert (float_below(tiny), float_above(tiny)) == (0.0, 5e-324)
    with pytest.raises(ArithmeticError, match="finite"):
        float_above(arb("nan"))
    with pytest.raises(ArithmeticError, match="finite"):
        float_below(arb("inf"))


def test_width_of_the_exact_zero():
    assert Enclosure(0.0, 0.0).relative_width == 0.0
    assert Enclosure(1.0, 2.0).relative_width == 0.5
    assert Enclosure(1.0, 2.0).midpoint == 1.5


def test_eigenvalues_recognise_defective_blocks():
    A = np.eye(6, k=1) - 0.1 * np.eye(6)
    ((root, multiplicity),) = eigenvalues(A)
    assert multiplicity == 6
    assert root.real.contains(arb(-0.1))


def test_require_hurwitz_resolves_a_tiny_margin():
    require_hurwitz(np.array([[-1.0, 1.0], [1.0 - 2.0**-53, -1.0]]))
    with pytest.raises(ValueError, match="real part is"):
        require_hurwitz(np.array([[-1.0, 1.0], [1.0 + 2.0**-52, -1.0]]))


def test_scaling_is_exact():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(4, 4)) * 10.0 ** rng.integers(-30, 30, size=(4, 4))
    B, C = rng.normal(size=(4, 1)), rng.normal(size=(1, 4))
    with ctx.workprec(128):
        plant = scaled(A, B, C)
        assert all(entry.is_exact() for part in (plant.A, plant.B, plant.C) for entry in part.entries())
    with ctx.workprec(4000):
        # Markov parameters c A^k b of the rescaled system, 2^-((k + 1) time) times the given ones
        given_A, given_C = arb_mat(A.tolist()), arb_mat(C.tolist())
        ours, theirs = plant.B, arb_mat(B.tolist())
        for k in range(4):
            factor = arb(2) ** (plant.time_exponent * (k + 1))
            assert (plant.C * ours)[0, 0] * factor == (given_C * theirs)[0, 0]
            ours, theirs = plant.A * ours, given_A * theirs


def test_decay_certificate_bounds_the_response():
    rng = np.random.default_rng(1)
    for n in (1, 2, 3, 6, 12):
        A = rng.normal(size=(n, n))
        A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
        C, x = rng.normal(size=(2, n)), rng.normal(size=(n, 1))
        with ctx.workprec(192):
            spectrum = [complex(value) for value in np.linalg.eigvals(A)]
            certificate = decay_certificate(arb_mat(A.tolist()), arb_mat(C.tolist()), spectrum, 0.25)
            assert certificate is not None
            norm = float(certificate.norm(arb_mat(x.tolist())))
        times = np.linspace(0.0, 60.0, 601)
        move, state, rows = scipy.linalg.expm(A * 0.1), x, []
        for _ in times:
            rows.append(np.abs(C @ state).ravel())
            state = move @ state
        outputs = np.array(rows)
        integrals = outputs.sum(axis=0) * 0.1
        weighted = np.sqrt((np.exp(0.5 * times)[:, None] * outputs**2).sum(axis=0) * 0.1)
        assert (integrals <= 1.05 * norm / math.sqrt(0.5) + 0.1 * outputs[0]).all()
        assert (weighted <= 1.05 * norm + math.sqrt(0.1) * outputs[0]).all()


def test_no_certificate_beyond_the_slowest_decay():
    A, C = arb_mat([[-1.0, 5.0], [0.0, -2.0]]), arb_mat([[1.0, 1.0]])
    with ctx.workprec(192):
        assert decay_certificate(A, C, [-1.0, -2.0], 0.99) is not None
        assert decay_certificate(A, C, [-1.0, -2.0], 1.01) is None
        # with a wrong spectrum the verification still rejects
        assert decay_certificate(A, C, [-10.0, -20.0], 1.01) is None


@given(phase=st.floats(-math.pi, math.pi), decay=st.floats(0.01, 10.0), frequency=st.floats(0.1, 10.0))
def test_oscillation_integral_against_quadrature(phase, decay, frequency):
    with ctx.workprec(128):
        ball = _oscillation_integral(acb(math.cos(phase), math.sin(phase)), acb(-decay, frequency))
        # Period by period: |cos| integrated over the arcs between its zeros, each in closed form.
        root = complex(-decay, frequency)
        zeros = [(math.pi * (k + 0.5) - phase) / frequency for k in range(-3, 3)]
        zeros = [0.0, *(zero for zero in zeros if zero > 0.0)]
        amplitude = complex(math.cos(phase), math.sin(phase))

        def primitive(t: float) -> float:
            import cmath

            return (amplitude * cmath.exp(root * t) / root).real

        # the last arc starts the geometric series
        arcs = [abs(primitive(b) - primitive(a)) for a, b in itertools.pairwise(zeros)]
        ratio = math.exp(-decay * math.pi / frequency)
        last = abs(primitive(zeros[-1] + math.pi / frequency) - primitive(zeros[-1]))
        total = sum(arcs) + last / -math.expm1(-decay * math.pi / frequency)
        assert ratio < 1.0
        # the float image of the phase at a zero crossing is off by an ulp; so is the quadrature
        assert abs(float(ball.mid()) - total) <= 1e-11 * max(1.0, total) * max(1.0, frequency / decay)
        assert ball.rad() < 1e-15 * ball.mid() + arb(2) ** -60


@pytest.mark.parametrize("amplitude", [acb(0, 1), acb(0, -1), acb(1), acb(-1), acb(0)])
def test_oscillation_integral_on_the_axes(amplitude):
    with ctx.workprec(128):
        ball = _oscillation_integral(amplitude, acb(-1, 1))
        half_turn = arb.pi() / 2
        sine = half_turn.coth() / 2  # integral of e^-s |sin s|
        cosine = (1 + 1 / half_turn.sinh()) / 2  # integral of e^-s |cos s|
        exact = arb(0) if amplitude == 0 else sine if amplitude.real == 0 else cosine
        assert ball.overlaps(exact)
        assert ball.rad() < arb(2) ** -50


def test_spectral_projector_with_a_defective_rest():
    A = scipy.linalg.block_diag(np.eye(3, k=1) - 2.0 * np.eye(3), [[-0.01, 1.0], [-1.0, -0.01]])
    shear = np.eye(5) + np.triu(np.ones((5, 5)), 1)
    mixed = shear @ A @ np.linalg.inv(shear)
    with ctx.workprec(192):
        plant = arb_mat(np.round(mixed * 2**20).tolist()) * arb(2) ** -20
        entries = np.array([float(entry) for entry in plant.entries()]).reshape(5, 5)
        slow = slow_oscillation(plant, arb_mat(np.ones((1, 5)).tolist()), eigenvalues(entries))
        assert slow is not None
        assert slow.remainder is not None
        square = slow.projector * slow.projector - slow.projector
        residual = slow.projector * slow.eigenvalue
        from flint import acb_mat

        product = acb_mat(plant) * slow.projector - residual
        assert all(entry.contains(0) for entry in [*square.entries(), *product.entries()])
        assert slow.projector.trace().overlaps(acb(1))
        assert all(entry.rad() < 1e-20 for part in slow.projector.entries() for entry in (part.real, part.imag))


def test_no_slow_oscillation_where_it_saves_nothing():
    real = np.diag([-1.0, -2.0])
    double = scipy.linalg.block_diag(*[[[-0.01, 1.0], [-1.0, -0.01]]] * 2)
    with ctx.workprec(128):
        for A in (real, double):
            C = arb_mat(np.ones((1, len(A))).tolist())
            assert slow_oscillation(arb_mat(A.tolist()), C, eigenvalues(A)) is None
