"""Files of figures: they are identical for identical input, small, and have colours for a dark background."""

import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.colors import to_rgb
from PIL import Image

from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.panel_drawing import PAGE, PHONE, draw, heading
from barbalat.pictures.panels import Panel, Series, text_of
from barbalat.pictures.render import on_dark, render
from barbalat.pictures.symbols import in_symbols
from barbalat.pictures.theme import DARK_GROUND, DARK_INK, GROUND, INK, QUIET_INK, new_figure


def figure(**more):
    t = np.linspace(0, 60, 20001)
    fast = Series(t=t, value=np.sin(200 * t), label="fast", colour=1)
    slow = Series(t=t, value=np.cos(t), label="slow", colour=0)
    return draw([Panel(title="Both", series=[fast, slow], **more)], 60.0)


def luminance(colour):
    """Relative luminance, WCAG 2.2."""
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_every_colour_can_be_seen_on_its_ground():
    """The contrast is at least three to one, which WCAG 2.2 requires for lines (1.4.11)."""
    assert min(contrast(colour, GROUND) for colour in (*COLOURS, INK, QUIET_INK)) >= 3
    assert min(contrast(colour, DARK_GROUND) for colour in ON_DARK) >= 3
    assert contrast(on_dark(INK), DARK_GROUND) > 10 and contrast(on_dark(QUIET_INK), DARK_GROUND) > 3
    assert on_dark(GROUND) == DARK_GROUND


def test_an_svg_is_the_same_twice_small_and_adapts():
    first, second = (render(figure(), "svg") for _ in range(2))
    assert first == second
    assert len(first) < 60_000  # 20 000 instants of two series would be 800 kB
    text = first.decode()
    ET.fromstring(text)
    assert "prefers-color-scheme: dark" in text
    assert f'[id^="text_"] {{ fill: {DARK_INK} }}' in text  # black text sets no colour
    for colour in set(re.findall(r"stroke: (#[0-9a-f]{6})", text.partition("</style>")[2])):
        assert f'stroke: {colour}"]' in text


def test_a_png_of_any_height_holds_the_whole_pixels_in_it():
    for height in (7.73, 7.736, 7.739, 7.742):  # 850.3, 850.96, 851.29 and 851.62 pixels
        one = new_figure(2.0, height, shown=False)
        assert Image.open(io.BytesIO(render(one, "png"))).size == (220, int(height * 110))


def test_the_envelope_is_explained_where_there_is_one_only():
    assert figure().legends
    t = np.linspace(0, 1, 500)
    assert not draw([Panel(title="calm", series=[Series(t=t, value=t, label="ramp")])], 1.0).legends


def test_dark_follows_the_style_of_matplotlib():
    with rc_context({"figure.facecolor": "black"}):
        dark = figure()
    colours = {line.get_color() for line in dark.axes[0].lines}
    assert colours == {ON_DARK[0], ON_DARK[1]}
    assert {line.get_color() for line in figure().axes[0].lines} == {COLOURS[0], COLOURS[1]}


def test_names_are_shown_as_they_are():
    assert text_of("a $ b") == r"a \$ b"
    assert len(text_of("x" * 100)) == 40
    assert text_of("_hidden").startswith("\u200b_")


def test_names_in_pictures_have_symbols_and_powers_of_ten():
    """A name becomes a symbol only if a value follows. A scheme named after a letter keeps its name."""
    assert in_symbols("L1, gamma 1e6, no projection") == "L1, γ 10⁶, no projection"
    assert in_symbols("Gamma = 4.3e-05, kappa 0.02") == "Γ = 4.3·10⁻⁵, κ 0.02"
    assert in_symbols("Sigma-modification, fixed gamma, 0x1e5, v1e5") == "Sigma-modification, fixed gamma, 0x1e5, v1e5"


@pytest.mark.parametrize("narrow", [False, True])
def test_the_rows_of_a_png_are_not_sheared(narrow):
    """The axis of values is a single column of dark pixels from end to end."""
    t = np.linspace(0, 1, 50)
    figure = draw([Panel(title="x", series=[Series(t=t, value=t, label="x")])], 1.0, narrow=narrow)
    pixels = np.asarray(Image.open(io.BytesIO(render(figure, "png"))).convert("L"))
    assert (pixels < 100).sum(axis=0).max() > 0.4 * len(pixels)


@pytest.mark.parametrize("length", range(5, 60, 3))
def test_no_line_of_a_title_ends_within_a_formula(length):
    panel = Panel(
        title=f"{'n' * length}: tracking error $e = x - x_m$", series=[Series(t=np.arange(2.0), value=np.zeros(2), label="e_1")]
    )
    for sizes in (PAGE, PHONE):
        lines = heading(panel, sizes).splitlines()
        assert all(line.count("$") % 2 == 0 for line in lines) and any("$e = x - x_m$" in line for line in lines)
