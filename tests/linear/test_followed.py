"""Responses along known signals, compared with closed forms and short steps of SciPy's matrix exponential."""

import math

import numpy as np
import pytest
from flint import arb, arb_mat
from scipy.linalg import expm

from barbalat import InputError
from barbalat.certificates.bounds.known_command import generator
from barbalat.linear.followed import Motion, followed
from barbalat.signals import Chirp, Constant, Sine, Sines, Square, Step, Steps

SIGNALS = (
    Constant(0.7),
    Step(amplitude=1.5, start=1.3, constant=-0.4),
    Steps(times=(-1.0, 0.5, 2.25), values=(0.3, 1.0, -2.0), initial=9.0),
    Sine(amplitude=2.0, frequency=3.0, phase=0.4, constant=0.1),
    Sines(amplitudes=(1.0, 0.5), frequencies=(0.7, 11.0), phases=(0.0, 1.0), constant=-0.2),
    Square(amplitude=1.2, frequency=2.1, phase=0.0, constant=0.3),
    Square(amplitude=1.2, frequency=2.1, phase=-4.0),
)


def responding(A: np.ndarray, b: np.ndarray, x0: np.ndarray, signal, t_end: float) -> list[np.ndarray]:
    """The system x' = A x + b r with all states as outputs."""
    made = generator(signal, t_end)
    k, n = len(made.S), len(A)
    whole = np.block([[made.S, np.zeros((k, n))], [np.outer(b, made.c), A]])
    outputs = np.hstack([np.zeros((n, k)), np.eye(n)])
    motion = Motion(arb_mat(whole.tolist()), arb_mat(outputs.tolist()), made, [arb(float(one)) for one in x0])
    return followed(motion).bounds


def sampled(A: np.ndarray, b: np.ndarray, x0: np.ndarray, signal, t_end: float, steps: int) -> np.ndarray:
    """The response at many instants. r has Simpson's weights in each step, and at a jump the value on either side."""
    n, h = len(A), t_end / steps
    half, whole = expm(A * h / 2), expm(A * h)
    x, found = x0.astype(float), [x0.astype(float)]
    for k in range(steps):
        t = k * h
        r = [float(signal(np.array(t))), float(signal(np.array(t + h / 2))), float(signal.before(np.array(t + h)))]
        x = whole @ x + h / 6 * (whole @ b * r[0] + 4 * half @ b * r[1] + b * r[2])
        found.append(x)
    assert found[-1].shape == (n,)
    return np.array(found)


def test_the_peak_of_a_driven_lag_in_closed_form():
    """x' = -x + sin 2t from 0 has x = (sin 2t - 2 cos 2t + 2 e^-t)/5, evaluated at a million points."""
    bounds = responding(-np.eye(1), np.ones(1), np.zeros(1), Sine(1.0, 2.0), 20.0)
    t = np.linspace(0, 20, 1_000_001)
    peak = np.abs((np.sin(2 * t) - 2 * np.cos(2 * t) + 2 * np.exp(-t)) / 5).max()
    found = max(step.max() for step in bounds)
    assert peak * (1 - 1e-12) <= found <= 1.02 * peak


def test_nothing_happens_without_a_command():
    assert max(step.max() for step in responding(-np.eye(2), np.ones(2), np.zeros(2), Constant(0.0), 5.0)) == 0.0


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("n", [1, 3])
def test_no_state_leaves_its_bound_and_the_bound_is_near(signal, n):
    """Simpson's rule with 20,000 steps is accurate to 1e-6, except in the step of a jump, where its error is at most h |b| 2
    |r|."""
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) - 3 * np.eye(n)
    A[0, 0] -= 60.0  # stiff
    b, x0, t_end = rng.normal(size=n), rng.normal(size=n), 6.0
    bounds = np.array([step.max(axis=1) for step in responding(A, b, x0, signal, t_end)]).max(axis=0)
    seen = np.abs(sampled(A, b, x0, signal, t_end, 20_000)).max(axis=0)
    jump = 0.0 if isinstance(signal, (Constant, Sine, Sines)) else 8 * np.abs(b) * signal.bound * t_end / 20_000
    assert (seen <= bounds + jump + 1e-6).all()
    assert (bounds <= 1.03 * seen + jump + 1e-6).all()


def test_generators_give_their_signals_back():
    for signal in SIGNALS:
        made, start = generator(signal, 5.0), 0.0
        for length, w in made.pieces:
            duration = float(length)
            for share in (1e-9, 0.5, 1 - 1e-9):
                value = made.c @ expm(made.S * share * duration) @ np.array([float(one) for one in w])
                assert value == pytest.approx(float(signal(np.array(start + share * duration))), abs=1e-6)
            start += duration
        assert math.isclose(start, 5.0)


def test_a_chirp_is_refused():
    with pytest.raises(InputError, match="sums of sines and for piecewise constant signals"):
        generator(Chirp(amplitude=1.0, frequency_start=0.1, frequency_end=2.0, duration=3.0), 5.0)
