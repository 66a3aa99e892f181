"""The phase of a loop with a delay, compared with NumPy's unwrapped angle, and statements on intervals, compared with dense
samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from barbalat.linear.rotation import Rotation
from barbalat.linear.systems import TransferFunction


def loops():
    """Random loops with zeros and poles in either half plane, some in pairs, none nearer to the axis than a fiftieth of its
    magnitude."""
    random = np.random.default_rng(3)
    for _ in range(12):
        n = int(random.integers(1, 5))
        zeros, poles = (random.choice([-1, 1], k) * 10 ** random.uniform(-1, 1, k) for k in (int(random.integers(0, n)), n))
        if n > 1:
            size, damping = 10 ** random.uniform(-1, 1), random.uniform(0.02, 1)
            pair = size * (-damping + 1j * np.sqrt(1 - damping**2))
            poles = np.concatenate([poles[2:], [pair, pair.conjugate()]])
        gain = 10 ** random.uniform(-1, 1)
        plant = TransferFunction(gain * np.atleast_1d(np.poly(zeros)), np.poly(poles).real)
        yield Rotation(plant.realise(), 10 ** random.uniform(-2, 0))


@pytest.mark.parametrize("rotation", list(loops()))
def test_phase_swing_and_slope(rotation):
    w = np.geomspace(1e-3, 1e2, 20_001)
    unwrapped = np.unwrap(np.angle(rotation.value(w)))
    turns = (rotation.phase(w) - unwrapped) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-6)  # zeros and poles to rounding, times their conditioning
    for step in (3, 40, 1000):
        ends = np.arange(0, len(w), step)
        left, right = w[ends[:-1]], w[ends[1:]]
        below, above = rotation.swing(left, right)
        monotone = rotation.is_monotone(left, right)
        for i, (a, b) in enumerate(pairwise(ends)):
            inside = unwrapped[a : b + 1] - unwrapped[a]
            assert -below[i] - 1e-9 <= inside.min() and inside.max() <= above[i] + 1e-9
            slopes = np.diff(inside)
            assert not monotone[i] or (slopes < 1e-9).all() or (slopes > -1e-9).all()
    # the phase changes little in short intervals: each arc by less than its length over its distance to the axis, the delay by d
    steepest = (1 / rotation._width).sum() + rotation.delay
    below, above = rotation.swing(w[:-1], w[1:])
    assert (np.maximum(below, above) <= steepest * np.diff(w) * (1 + 1e-9) + 1e-15).all()
    assert rotation.is_monotone(w[:-1], w[1:]).mean() > 0.9


def test_only_intervals_with_a_crossing_are_searched(monkeypatch):
    """Most intervals with a monotone phase contain no level, which their two ends show."""
    searched, found, at_level = 0, 0, Rotation._at_level

    def counted(self, *interval):
        nonlocal searched
        searched += 1
        return at_level(self, *interval)

    monkeypatch.setattr(Rotation, "_at_level", counted)
    for rotation in loops():
        at = rotation.negative_real(1e-3, 1e2)
        found += len(at)
        values = rotation.value(at)
        np.testing.assert_allclose(values.imag, 0, atol=1e-6 * np.abs(values).max(initial=1.0))  # as above
        assert (values.real < 0).all()
        dense = np.geomspace(1e-3, 1e2, 200_001)  # the same number of levels as on a dense grid of phases
        assert len(at) == np.abs(np.diff(np.floor((rotation.phase(dense) / np.pi - 1) / 2))).sum()
    assert found > 20
    assert searched <= 1.1 * found  # an interval whose end lies within rounding of a level is searched too
