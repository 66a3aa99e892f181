"""Poles of plants with one input are placed with the bits of SciPy's place_poles, which the package does not import for them."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import place_poles

from barbalat.linear.pole_placement import place
from barbalat.validate import InputError


def test_same_bits_as_scipy() -> None:
    rng = np.random.default_rng(0)
    for k in range(300):
        n = int(rng.integers(2, 8))
        A, b = rng.normal(size=(n, n)) * 10 ** rng.uniform(-2, 2), rng.normal(size=(n, 1))
        if k % 4 == 0:  # the controllable form, with many zeros
            A, b = np.eye(n, k=1), np.eye(n)[:, [-1]]
            A[-1] = rng.normal(size=n)
        pairs = int(rng.integers(0, n // 2 + 1))
        poles: list[complex] = [complex(-rng.uniform(0.1, 5), rng.uniform(0.1, 5)) for _ in range(pairs)]
        poles += [complex(-rng.uniform(0.1, 5)) for _ in range(n - 2 * pairs)]
        both = [part for pole in poles for part in ([pole, pole.conjugate()] if pole.imag else [pole])]
        expected = A - b @ np.asarray(place_poles(A, b, np.array(both)).gain_matrix.real)
        assert place(A, b, poles).tobytes() == expected.tobytes()


def test_an_input_without_effect_is_refused() -> None:
    with pytest.raises(InputError, match="can't be placed"):
        place(np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros(2), [-1.0, -2.0])


def test_a_plant_with_one_input_needs_no_scipy_signal() -> None:
    program = (
        "import sys; import numpy as np; from barbalat.linear.pole_placement import place; "
        "place(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([0.0, 1.0]), [-1.0, -2.0]); assert 'scipy.signal' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
