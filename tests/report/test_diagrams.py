"""Block diagrams: every coefficient in its place, every text in its box."""

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.controllers.output.l1 import L1Output, fast_limit, linear_equivalent
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputPlant
from barbalat.report import diagrams

PLANT = OutputPlant(transfer_function=TransferFunction([458.0], [1.0, 31.0, 259.0, 229.0]), nonlinear="sin(y)")
SECOND_ORDER = L1Output(m=3.0, gamma=2.5e4, filter=TransferFunction([100.0], [1.0, 14.0, 100.0]), sigma_bound=40.0)


def texts(figure):
    return [text.get_text() for axes in figure.axes for text in axes.texts if text.get_text()]


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [
        ([3.0, -1.0, 0.5], "3 s^{2} - s + 0.5"),
        ([-1.0, 0.0], "- s"),
        ([1e4, 2.5e-7], r"10^{4} s + 2.5 \cdot 10^{-7}"),
        ([1.0], "1"),
        ([0.0], "0"),
        ([1.0, 0.0, 0.0, -30.0], "s^{3} - 30"),
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
        assert diagrams.transfer_function_text(system) in shown
    assert any(r"\leq 40" in text for text in shown) == (bound is not None)
    assert shown.count("$d + f(y)$") == 3


def test_every_text_is_inside_its_box():
    figure = diagrams.l1_output(SECOND_ORDER, PLANT)
    figure.draw_without_rendering()
    count = 0
    for axes in figure.axes:
        boxes = [patch.get_window_extent() for patch in axes.patches if isinstance(patch, Rectangle)]
        written = [text.get_window_extent() for text in axes.texts if "frac" in text.get_text()]
        for extent in written:
            count += 1
            assert any(box.x0 < extent.x0 and extent.x1 < box.x1 and box.y0 < extent.y0 and extent.y1 < box.y1 for box in boxes)
    assert count == 10  # four in the scheme, three in each of the others


def test_the_certificate_carries_the_equivalent():
    """Evaluated at a frequency: C(s) and the predictor, eliminated numerically, against the coefficients printed."""
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
