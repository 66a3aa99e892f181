"""The detection of oscillating estimates by the size and speed of their motion within their known range."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from barbalat import Mrac, ParameterBox
from barbalat.study.ringing import fills, known_width, rings


def test_an_estimate_whose_known_set_is_nearly_a_point_does_not_ring(problems):
    """The estimate is always projected onto both ends of a range whose size is a rounding or a tenth of a per mille."""
    given, low = problems[2], np.array([-2.0, 3.0])
    for width, expected in ((1e-14, [4.0, 0.0]), (3e-4, [4.0, 0.0]), (0.03, [4.0, 0.03])):
        box = ParameterBox(lower=low, upper=np.add(low, [4.0, width]))
        found = known_width(replace(given, uncertainty=box), Mrac(gamma=1.0))
        np.testing.assert_allclose(found, expected)
        moving = SimpleNamespace(
            theta_hat_tail_min=np.array([[0.0, 3.0]]), theta_hat_tail_max=np.array([[0.0, 3.0 + width]]),
            theta_hat_variation_rate=np.array([[0.0, 100 * width]]),
        )  # fmt: skip
        assert rings(moving, found, 1.0).tolist() == fills(moving, found).tolist() == [expected[1] > 0]


def test_a_range_around_zero_is_a_point_beside_the_others(problems):
    box = ParameterBox(lower=[-1e-9, -5.0], upper=[1e-9, 5.0])
    assert known_width(replace(problems[2], uncertainty=box), Mrac(gamma=1.0)).tolist() == [0.0, 10.0]
