"""The code on the page on own laws runs exactly as printed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from barbalat import Mrac, Simulation, simulate
from barbalat.cases import user_controllers
from barbalat.interfaces import Role, check_controller
from barbalat.regressors import Polynomial
from barbalat.roles import column_names, main_estimates, state_parts
from barbalat.testing import check, problem_kinds
from independent import refusal

PAGE = (Path(__file__).parents[2] / "docs" / "own-laws.md").read_text(encoding="utf-8")


@pytest.fixture
def law(tmp_path):
    file = tmp_path / "page.py"
    file.write_text(PAGE.partition("%%writefile mylaws.py\n")[2].partition("```")[0], encoding="utf-8")
    return user_controllers.run(file).controllers(named={})[0]


def test_the_pages_law_runs(problems, law):
    check_controller(law, problems[2])
    assert f'entry-points."{user_controllers.ENTRY_POINT_GROUP}"' in PAGE


def test_it_is_the_standard_mrac_whatever_the_regressor(problems, law):
    """The law and MRAC are equal up to roundings of reordered sums. phi has two entries for two states, then five."""
    linear = problems[2]
    plant = replace(linear.plant, theta=[0.5, 0.3, 0.2, 0.1, 0.1], regressor=Polynomial(degree=2))
    for problem in (linear, replace(linear, plant=plant, uncertainty=None)):
        standard = Mrac(gamma=law.gamma, projection=False)
        own, known = simulate(problem, [law, standard], Simulation(t_end=2.0, dt=1e-2)).values()
        np.testing.assert_allclose(own.theta_hat, known.theta_hat, rtol=1e-9, atol=1e-12)
        assert own.true_values.tolist() == problem.plant.theta.tolist()


def test_what_the_pages_law_does_not_take_it_refuses(problems, law):
    """The checker reports an input gain, which the page's standard MRAC does not estimate, and a second input."""
    message = refusal(lambda: check_controller(law, replace(problems[2], input_gain=(0.5, 2.0))))
    assert "supports only plants with one input of known gain" in message
    kinds = {
        name: one for name, one in problem_kinds().items() if name in ("one input", "several inputs", "an unknown input gain")
    }
    assert str(check(law, kinds)).count("supports only plants with one input of known gain") == 2


def test_the_pages_roles_are_those_of_a_state_like_it():
    """The example of a declaration, which is not a cell of the page, behaves as described."""
    scope = {"np": np, "NamedTuple": NamedTuple, "Role": Role}
    exec(
        PAGE.partition("```python\nclass State(NamedTuple):")[2].partition("```")[0].join(["class State(NamedTuple):", ""]), scope
    )
    state = scope["State"](np.zeros(16), np.zeros(16), np.eye(2), np.zeros(2))
    parts = state_parts(scope["Equations"](), state)
    assert [part.role.kind for part in parts] == ["estimates", "estimates", "memory", "predictor"]
    assert main_estimates(parts).path == "W_hat" and column_names(parts[2:], ()) == {parts[2]: "P", parts[3]: "x_hat"}
