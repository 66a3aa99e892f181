"""A box around the plants of physical parameters may have unstable points that no parameters give: the plants decide."""

import numpy as np
import pytest

from barbalat import certify
from barbalat.cases.load import parse_case
from barbalat.certificates.summary import _margin

CASE = """
name = "inverted pendulum"
[parameters]
J = { value = 1.0, between = [0.7, 1.4] }
g = { value = 9.0, between = RANGE }
[plant]
A = [[0, 1], ["g/J", 0]]
b = [0, "1/J"]
[baseline]
kind = "state"
K = [13.0, 6.0]
[reference_model]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "continuous"
scheme = "baseline"
[[controller]]
name = "sampled"
scheme = "baseline"
sample_time = 1e-3
"""
"""J s^2 + 6 s + 13 - g in the closed loop: stable for g < 13 and every J, while the box of theta and omega also combines the
largest g/J with the smallest 13/J."""


def certified(between):
    case = parse_case(CASE.replace("RANGE", between))
    found = certify(case.problem, case.controllers, case.simulation)
    return {name: (one, one.values["margins_over_known_set"][0]) for name, one in found.items()}


def delay_margin(J, g):
    """Of (6 s + 13)/(J s^2 - g) at its crossover, by hand: atan(6 w/13)/w with (J w^2 + g)^2 = 36 w^2 + 169."""
    (square,) = (root.real for root in np.roots([J**2, 2 * J * g - 36.0, g**2 - 169.0]) if root.real > 0)
    return np.arctan(6 * np.sqrt(square) / 13) / np.sqrt(square)


@pytest.mark.parametrize("name", ["continuous", "sampled"])
def test_a_box_with_unstable_points_is_not_an_unstable_plant(name):
    """The sampled loop's hold delays by half a sample, 0.5 ms."""
    certificate, found = certified("[8.0, 10.0]")[name]
    theta_1, omega = found["box_unstable_at"][0], found["box_unstable_at_gain"]
    assert theta_1 - 13 * omega > 0 and "unstable_at" not in found
    least = min(delay_margin(J, g) for J in np.linspace(0.7, 1.4, 71) for g in np.linspace(8.0, 10.0, 41))
    assert found["delay_margin"]["value"] == pytest.approx(least, abs=2e-3)
    (said,) = (note for note in certificate.notes if "unstable" in note)
    assert "of the box, not of any physical plant found: " in said and f"{found['delay_margin']['value']:.4g} s" in said
    assert "in the ranges, not in all of the box" in str(_margin(certificate))


@pytest.mark.parametrize("name", ["continuous", "sampled"])
def test_an_unstable_plant_is_named_by_its_parameters(name):
    certificate, found = certified("[5.0, 15.0]")[name]
    assert found["unstable_at_parameters"]["g"] > 13 and "box_unstable_at" not in found
    (said,) = (note for note in certificate.notes if "unstable" in note)
    assert f"g = {found['unstable_at_parameters']['g']:.4g} give" in said
