"""The line on the assumptions never names failed ones as if they concerned the guaranteed values."""

from barbalat import certify
from barbalat.cases.load import parse_case
from barbalat.certificates.summary import five

ROLL = """
name = "roll"
[plant]
A = [[0.0, 1.0], [0.0, -4.0]]
b = [0.0, 60.0]
[plant.input]
actuator = { num = [30.0], den = [1.0, 30.0] }
delay = 0.008
gain = 0.9
[plant.disturbance]
kind = "sine"
amplitude = 0.02
frequency = 3.0
[reference_model]
poles = [[-4.0, 3.0]]
follow = "phi"
[reference]
kind = "square"
amplitude = 0.15
frequency = 0.8
[uncertainty]
lower = [-0.1, -0.06]
upper = [0.6, 0.2]
[labels]
names = ["phi", "p"]
units = ["rad", "rad/s"]
input_units = ["rad"]
[simulation]
t_end = 5.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 1.0
sample_time = 0.01
[[controller]]
name = "ADRC"
scheme = "adrc"
bandwidth = 12.0
sample_time = 0.01
[[controller]]
name = "L1"
scheme = "l1-piecewise"
filter = { kappa = 0.1 }
sample_time = 0.01
"""


def roll(*more: tuple[str, str], keys=None):
    """The certificates of the roll axis and their lines, by controller and label."""
    text = ROLL
    for old, new in more:
        assert old in text
        text = text.replace(old, new)
    case = parse_case(text)
    found = certify(case.problem, case.controllers, case.simulation, keys=keys)
    lines = {
        column.name: {one.label: one.text.replace("\N{NO-BREAK SPACE}", " ") for one in five(column, found[column.name], None)}
        for column in found.table.columns
    }
    return found, lines


def test_guaranteed_values_are_never_beside_assumptions_that_fail():
    _, lines = roll()
    assert lines["L1"]["bound of e"].startswith("guaranteed: ")
    kept, others = lines["L1"]["assumed"].split("; ")
    assert kept.endswith("assumptions, all of which hold on this case")
    assert others == (
        "further values are not guaranteed, because their assumptions fail: delay 0.008 s, actuator, input gain 0.9, unknown to "
        "the controller, disturbance"
    )
    assert lines["MRAC"]["assumed"].startswith("fails here: delay 0.008 s, actuator")
