"""A plant given by A and b: theta, which follows from them, varies as in a case that states theta."""

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.explorer.worst_members import explored
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps.bounds import Bounds
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.study import Study
from barbalat.sweeps.sweep import run_study

CLOSED = """name = "own"
[plant]
A_m = [[0.0, 1.0], [-1.0, -1.5]]
b = [0.0, 2.0]
theta = [1.0, -0.25]
[reference_model]
k_0 = 1.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 0.5
[uncertainty]
lower = [-2.0, -1.0]
upper = [2.0, 1.0]
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 10.0
"""
OPEN = CLOSED.replace("A_m = [[0.0, 1.0], [-1.0, -1.5]]", "A = [[0.0, 1.0], [1.0, -2.0]]").replace("theta = [1.0, -0.25]\n", "")
BY_A_M = OPEN.replace("k_0 = 1.0", "k_0 = 1.0\nA_m = [[0.0, 1.0], [-1.0, -1.5]]")
BY_POLES = OPEN.replace("k_0 = 1.0", "k_0 = 1.0\npoles = [[-0.75, 0.6614378277661477]]")
"""The plant with the polynomial s^2 + 1.5 s + 1."""
KNOWN = [("plant.theta", "known-set")]


def study(text, draws=KNOWN):
    plan = Plan({}, sampled(CaseText(text), draws), 6)
    return Study(VariedCase(CaseText(text), plan.paths), plan)


def test_the_members_are_those_of_the_case_that_states_theta():
    """All numbers of these plants are exact, so the results are identical."""
    found, expected = study(BY_A_M).run(0, 6), study(CLOSED).run(0, 6)
    assert set(found) == set(expected) and {"plant.theta[0]", "plant.theta[1]"} <= set(found)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)
    assert np.ptp(found["MRAC/max_abs_e[0]"]) > 0


def test_poles_stay_where_they_are_asked_for():
    for values in study(BY_POLES).values(0, 3):
        plant = study(BY_POLES).varied.at(values).problem.plant
        np.testing.assert_allclose(np.linalg.eigvals(plant.A_m), np.array([-0.75 + 0.6614378j, -0.75 - 0.6614378j]), rtol=1e-6)
        np.testing.assert_array_equal(plant.theta, values)


def test_an_entry_alone_leaves_the_other_as_it_follows():
    plant = study(BY_A_M, [("plant.theta[1]", "uniform:-0.5:0.5")]).varied.at([0.125]).problem.plant
    np.testing.assert_allclose(plant.theta, [1.0, 0.125], atol=1e-12)  # A - A_m = [2, -0.5] = 2 theta'


@pytest.mark.parametrize("other", ["plant.A[1][0]", "reference_model.A_m[1][0]"])
def test_what_theta_follows_from_does_not_vary_beside_it(other):
    with pytest.raises(InputError, match=r"cannot both vary: with plant\.A given, theta follows"):
        study(BY_A_M, [*KNOWN, (other, "uniform:-1:1")])


def test_an_explorer_of_the_worst_member_has_its_theta():
    text = CaseText(BY_A_M)
    plan = Plan({}, sampled(text, KNOWN), 6)
    found = run_study(Study(VariedCase(text, plan.paths), plan), bounds=False)
    (one,) = explored(text, found)
    assert one.row.why == "" and one.page is not None and "plant.theta[1]" in one.page


TWO_INPUTS = CLOSED.replace("b = [0.0, 2.0]", "b = [[1.0, 0.0], [0.0, 2.0]]").replace(
    "theta = [1.0, -0.25]", "theta = [[1.0, 0.0], [0.5, -0.25]]"
).replace("k_0 = 1.0", "k_0 = [[1.0], [1.0]]").replace("lower = [-2.0, -1.0]", "lower = [[-2.0, -1.0], [-3.0, -4.0]]").replace(
    "upper = [2.0, 1.0]", "upper = [[2.0, 1.0], [3.0, 4.0]]"
)  # fmt: skip


def test_a_matrix_of_parameters_is_drawn_entry_by_entry():
    found = study(TWO_INPUTS)
    assert [str(path) for path in found.plan.paths] == [f"plant.theta[{i}][{j}]" for i in range(2) for j in range(2)]
    rows = found.values(0, 6)
    np.testing.assert_array_equal(Bounds(found)._thetas(rows), rows)
    assert (np.abs(rows) <= [2.0, 1.0, 3.0, 4.0]).all()


def test_what_is_no_vector_is_said():
    with pytest.raises(InputError, match=r"the case has no plant\.thet;"):
        sampled(CaseText(CLOSED), [("plant.thet", "known-set")])
