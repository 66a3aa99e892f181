"""Block diagrams: every coefficient in its place, every text in its box."""

import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.textpath import TextPath

from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.controllers.output.l1 import L1Output, fast_limit, linear_equivalent
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputPlant
from barbalat.report import diagrams

PLANT = OutputPlant(transfer_function=TransferFunction([458.0], [1.0, 31.0, 259.0, 229.0]), nonlinear="sin(y)")
SVG = "{http://www.w3.org/2000/svg}"
SECOND_ORDER = L1Output(m=3.0, gamma=2.5e4, filter=TransferFunction([100.0], [1.0, 14.0, 100.0]), sigma_bound=40.0)


def texts(svg):
    return [text.text for text in ET.fromstring(svg).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [
        ([3.0, -1.0, 0.5], "3 s² − s + 0.5"),
        ([-1.0, 0.0], "− s"),
        ([1e4, 2.5e-7], "10⁴ s + 2.5·10⁻⁷"),
        ([1.0], "1"),
        ([0.0], "0"),
        ([1.0, 0.0, 0.0, -30.0], "s³ − 30"),
    ],
)
def test_a_polynomial_reads_as_one_writes_it(coefficients, text):
    assert diagrams.polynomial_text(np.array(coefficients)) == text


@pytest.mark.parametrize("bound", [40.0, None])
def test_all_blocks_are_there(bound):
    controller = L1Output(m=3.0, gamma=2.5e4, filter=SECOND_ORDER.filter, sigma_bound=bound)
    shown = texts(diagrams.l1_output(controller, PLANT))
    equivalent, limit = linear_equivalent(controller), fast_limit(controller)
    systems = [controller.filter, PLANT.transfer_function, *equivalent, *limit]
    for system in systems:
        numerator, denominator = diagrams.transfer_function_text(system)
        assert (numerator, denominator) in [*pairwise(shown), *((one, "") for one in shown)]
    assert any("≤ 40" in text for text in shown) == (bound is not None)
    assert shown.count("d + f(y)") == 3


def test_every_fraction_is_inside_its_box():
    """Matplotlib draws it in a font that is wider than a browser's."""
    long = L1Output(
        m=3.0, gamma=2.5e4, filter=TransferFunction([1.2345e5], [1.0, 151.25, 12345.0, 2.8765e5, 1.2345e5]), sigma_bound=40.0
    )
    count = 0
    for group in ET.fromstring(diagrams.l1_output(long, PLANT)).iter(f"{SVG}g"):
        boxes = [[float(one.get(key)) for key in ("x", "y", "width", "height")] for one in group.iter(f"{SVG}rect")]
        for text in group.iter(f"{SVG}text"):
            if " s" not in text.text or group.get("transform") is None or text.get("class") == "title":
                continue
            count += 1
            size, x, y = (float(text.get(key)) for key in ("font-size", "x", "y"))
            half = TextPath((0, 0), text.text, size=size, prop="DejaVu Serif").get_extents().width / 2
            assert any(a < x - half and x + half < a + w and b < y - 0.8 * size and y < b + h for a, b, w, h in boxes)
    assert count > 6


def test_the_certificate_carries_the_equivalent():
    """C(s) and the predictor are eliminated numerically at a frequency and compared with the printed coefficients."""
    case = load_case("l1-output")
    controller = case.controllers[0]
    certificate = certify(case.problem, [controller], case.simulation)[controller.name]
    found = certificate.values["linear_equivalent"]
    s = 7.0j
    C, m, gamma = controller.filter, controller.m, controller.gamma
    c = np.polyval(C.num, s) / np.polyval(C.den, s)
    # u + c sigma = c r;  s (s + m) sigma + gamma m (u + sigma) = gamma (s + m) y
    matrix = np.array([[1.0, c], [gamma * m, s * (s + m) + gamma * m]])
    from_r = np.linalg.solve(matrix, [c, 0.0])[0]
    from_y = np.linalg.solve(matrix, [0.0, gamma * (s + m)])[0]
    for name, expected in (("feedforward", from_r), ("feedback", -from_y)):
        system = found[name]
        assert np.polyval(system["num"], s) / np.polyval(system["den"], s) == pytest.approx(expected, rel=1e-12)
    listed = [row.quantity for row in certificate.rows]
    assert "linear_equivalent, feedback" in listed
