"""How numbers on logarithmic axes are written."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barbalat.pictures.render import plain, power_of_ten, with_plain_powers

PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def test_a_tick_below_the_smallest_number_has_no_name():
    """Axes of a loop with a gain of 1e-300 reach down to zero, which is not a power of ten."""
    assert [power_of_ten(value) for value in (0.0, 0.1, 1.0, 10.0)] == ["", "0.1", "1", "10"]


def number_in(text):
    """The number as a person reads it: 0.2, 10⁻², 3·10⁻², each with its sign."""
    sign, text = (-1, text[1:]) if text.startswith("-") else (1, text)
    mantissa, _, power = text.rpartition("·")
    exponent = power.removeprefix("10").translate(PLAIN)
    return sign * float(text) if text.translate(PLAIN) == text else sign * float(mantissa or 1) * 10.0 ** int(exponent)


@pytest.mark.parametrize(
    ("scale", "limits"), [("log", (0.12, 0.7)), ("log", (1e-9, 1e4)), ("log", (3e-5, 7e-5)), ("symlog", (-3e6, 3e6))]
)
def test_every_tick_reads_as_the_number_at_which_it_is(scale, limits):
    """The ticks with labels are exactly those that Matplotlib would label."""
    figure = Figure()
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_xscale(scale)
    axes.set_xlim(limits)
    figure.canvas.draw()
    labelled = [bool(one.get_text()) for one in axes.get_xticklabels(which="both")]
    with_plain_powers(figure)
    figure.canvas.draw()
    ticks = axes.get_xticklabels(which="both")
    assert [bool(one.get_text()) for one in ticks] == labelled
    assert sum(labelled) > 1
    for one in ticks:
        if one.get_text():
            assert "$" not in one.get_text() or one.get_text() == r"$\mathdefault{0}$"
            if "$" not in one.get_text():
                assert number_in(one.get_text()) == pytest.approx(one.get_position()[0], rel=1e-12)


def test_another_text_stays_as_it_is():
    assert plain("$e_1$") == "$e_1$"
