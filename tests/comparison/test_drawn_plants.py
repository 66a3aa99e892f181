"""Plants drawn from the ranges of physical parameters, with a truth that has different formulas."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.cases.load import load_case
from barbalat.comparison.plants import extreme_plants, plants_of
from barbalat.comparison.search.aim import Aim, TunedQuantity
from barbalat.studies import contest
from barbalat.validate import InputError

CASE = """
name = "Spring"
[parameters]
k = { value = 4.0, between = [3.0, 6.0] }
J = { value = 0.5, tolerance = 0.2 }
tau = { value = 0.03, between = [0.02, 0.05] }

[plant]
A = [[0, 1], ["-k/J", -1.0]]
b = [0, "1/J"]

[reference_model]
poles = [-3.0, -4.0]
follow = "x_1"

[reference]
kind = "square"
amplitude = 1.0
frequency = 1.0

[truth]
A = [[0, 1, 0], ["-k/J", -1.0, "1/J"], [0, 0, "-1/tau"]]
b = [0, 0, "1/tau"]
x0 = ["0.1*k", 0, 0]
states = ["x_1", "x_2", "motor"]
parameters = { J = 0.55 }

[truth.input]
delay = "tau"

[truth.sensor]
lag = "tau/10"

[truth.terms]
x_2 = "-0.1*k*x1**3"

[simulation]
t_end = 2.0
dt = 1e-3

[[controller]]
scheme = "mrac"
gamma = 1.0
sample_time = 0.01
"""


def simulated(problem):
    around = problem.surroundings
    found = [problem.simulated.A, problem.simulated.b, problem.simulated.x0, around.paths[0].delay, around.sensor.lag]
    return np.concatenate([np.ravel(one) for one in found])


def test_all_formulas_of_the_truth_have_the_drawn_parameters(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    own = load_case(path).problem
    drawn = plants_of(own, own.uncertainty, 4, 0)
    assert drawn[0] is own and len({tuple(simulated(one)) for one in drawn}) == 4
    for one in drawn:
        values = ", ".join(f"{name} = {value!r}" for name, value in one.truth.parameters.items())
        path.write_text(CASE.replace("parameters = { J = 0.55 }", f"parameters = {{ {values} }}"))
        again = load_case(path).problem
        np.testing.assert_array_equal(simulated(one), simulated(again))
        assert one.simulated.values == again.simulated.values


OTHER = """
[truth]
A = [[0, 1], [-2, -1]]
b = [0, 1]
"""


def test_ranges_that_nothing_simulated_contains_give_no_plants(tmp_path):
    path = tmp_path / "case.toml"
    head, rest = CASE.replace("{ value = 0.03, between = [0.02, 0.05] }", "0.03").split("[truth]")
    path.write_text(head + OTHER + rest[rest.index("[simulation]") :])
    own = load_case(path).problem
    assert plants_of(own, own.uncertainty, 1, 0) == [own]
    with pytest.raises(InputError, match="plants must be 1, because no formula of the simulated plant contains k or J; got 4"):
        plants_of(own, own.uncertainty, 4, 0)
    assert extreme_plants(own, own.uncertainty, 4, 0) == []
    assert Aim(quantity=TunedQuantity("rms_e[0]", larger_is_worse=True), plants=1).unseen(own) == []
    with pytest.raises(InputError, match="validation plants cannot be drawn, because no formula of the simulated plant contains"):
        contest(path, plants=1, members=20)
