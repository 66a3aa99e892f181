"""The statements on controllers with an observer, for which there is no bound."""

import pytest

from barbalat.cases.load import parse_case
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify

CASE = """
name = "beside an observer"
[plant]
A = [[0.0, 1.0], [0.0, -2.0]]
b = [0.0, 5.0]
[observer]
kind = "luenberger"
poles = [-20.0, -25.0]
measured = ["x_1"]
[reference_model]
poles = [-3.0, -4.0]
k_0 = 2.4
[reference]
kind = "step"
amplitude = 1.0
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
name = "it"
"""
PI = 'scheme = "linear"\ncontroller = { num = [1.0, 1.0], den = [1.0, 0.0] }\n'


@pytest.mark.parametrize(
    ("controller", "bounded", "said"),
    [
        (PI + "sample_time = 0.01\n", True, "nothing is proven beyond the bounds on x and e"),
        (PI, True, "nothing is proven beyond the bounds on x and e"),
        ('scheme = "known-parameters"\ntheta = [1.0, 2.0]\n', True, "nothing is proven beyond the bounds on x and e"),
        ('scheme = "mrac"\ngamma = 10.0\nsample_time = 0.01\n', False, "no theorem covers adaptation with an observer"),
    ],
)
def test_the_reason_fits_the_controller(controller, bounded, said):
    case = parse_case(CASE + controller)
    certificates = certify(case.problem, case.controllers, case.simulation)
    (column,) = table_1(case.problem, case.controllers, certificates).columns
    assert said in column.cells["modelling_error"].text
    bound = certificates["it"].entry("error_bound")
    assert bound.applies == bounded and (bounded or said in bound.why)
