"""If the user's own set does not contain the ranges of the parameters, no guarantee covers the ranges."""

import pytest

from barbalat import certify
from barbalat.cases.load import parse_case
from barbalat.certificates.summary import five

CASE = """
name = "pendulum"
[parameters]
J = { value = 1.0, between = [0.5, 2.0] }
[plant]
A = [[0, 1], [-2.0, "-1/J"]]
b = [0, "1/J"]
[reference_model]
poles = [-2, -3]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[uncertainty]
lower = [3.5, 2.5]
upper = [4.5, 4.7]
[[controller]]
name = "mrac"
scheme = "mrac"
gamma = 1.0
"""


@pytest.mark.parametrize("gain", [False, True])
def test_a_set_that_lacks_the_gain_s_range_guarantees_nothing_of_the_ranges(gain):
    text = CASE.replace("[[controller]]", "input_gain = [0.4, 2.5]\n[[controller]]") if gain else CASE
    case = parse_case(text)
    found = certify(case.problem, case.controllers, case.simulation)
    (column,) = found.table.columns
    said = {line.label: line.text.replace("\N{NO-BREAK SPACE}", " ") for line in five(column, found["mrac"], None)}
    notes = " ".join(found["mrac"].notes)
    if gain:
        assert "error_bound" in found["mrac"].guaranteed and "does not contain" not in notes
        assert "all of which hold" in said["assumed"]
        return
    assert "omega in [0.5, 2], but the input gain is assumed to be known; no guarantee covers the ranges" in notes
    assert "error_bound" not in found["mrac"].guaranteed
    assert said["bound of e"].startswith("guaranteed for the design")
    assert "the parameter ranges exceed the set given in the case" in said["assumed"]
    assert not any(cell.kind == "guaranteed" for cell in column.cells.values())
    loops = found["mrac"].values["margins_over_known_set"]
    assert [loop.get("over") for loop in loops] == [None, "the parameters' ranges"]
