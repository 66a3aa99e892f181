"""The page on laws of one's own: its lines run as they stand there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import Mrac, Polynomial, Simulation, check_controller, simulate
from barbalat.cases import outside
from independent import refusal

PAGE = (Path(__file__).parents[2] / "docs" / "own-laws.md").read_text(encoding="utf-8")


@pytest.fixture
def law(tmp_path):
    file = tmp_path / "page.py"
    file.write_text(PAGE.partition("%%writefile mylaws.py\n")[2].partition("```")[0], encoding="utf-8")
    return outside.run(file).controllers(named={})[0]


def test_the_pages_law_runs(problems, law):
    check_controller(law, problems[2])
    assert f'entry-points."{outside.ENTRY_POINT_GROUP}"' in PAGE


def test_it_is_the_standard_mrac_whatever_the_regressor(problems, law):
    """Within the roundings of the same sums in another order; phi has two entries of two states, then five."""
    linear = problems[2]
    plant = replace(linear.plant, theta=[0.5, 0.3, 0.2, 0.1, 0.1], regressor=Polynomial(degree=2))
    for problem in (linear, replace(linear, plant=plant, uncertainty=None)):
        standard = Mrac(gamma=law.gamma, projection=False)
        own, known = simulate(problem, [law, standard], Simulation(t_end=2.0, dt=1e-2)).values()
        np.testing.assert_allclose(own.theta_hat, known.theta_hat, rtol=1e-9, atol=1e-12)
        assert own.true_values.tolist() == problem.plant.theta.tolist()


def test_with_an_unknown_input_gain_it_is_refused(problems, law):
    """Which the standard MRAC of the page does not estimate."""
    message = refusal(lambda: check_controller(law, replace(problems[2], input_gain=(0.5, 2.0))))
    assert "Equations.control" in message and "line" in message
