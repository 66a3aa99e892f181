"""More lines than hues: every pair of lines is distinguishable, for readers with any colour vision and in a legend."""

import io
from colorsys import rgb_to_hsv
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, width_of
from barbalat.pictures.render import render
from barbalat.pictures.shares import Shares
from barbalat.pictures.shares import draw as draw_shares
from barbalat.pictures.theme import dash_of, mark_of
from barbalat.vehicles.picture import paths_figure
from barbalat.vehicles.scene import Mover, Scene

SIGHTS = {
    "any": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
"""Linear RGB as seen with colour blindness, from the table of severity 1 in Machado, Oliveira, Fernandes (2009). Tritanopia is a
hundred times rarer."""
TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]])
"""sRGB's primaries and white D65 (IEC 61966-2-1)."""
TELLING_DISTANCE = 13
"""Smallest distance in CIELAB. Side by side 2.3 is just noticeable, but thin lines need several times as much. Blue and sky blue
have a distance of 12.2."""
NINE = 9
"""Schemes that fly on the F-16."""


def lab(colour, sight):
    part = np.array(to_rgb(colour))
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(np.array(SIGHTS[sight]) @ linear, 0, 1) / TO_XYZ.sum(axis=1)
    x, y, z = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def series(count):
    t = np.linspace(0, 10, 101)
    return [
        Series(t=t, value=np.sin(t) + 0.01 * k, label=f"scheme {k}", colour=k, width=width_of(k, count)) for k in range(count)
    ]


def styles(lines):
    return [(line.get_color(), line.get_linestyle(), line._unscaled_dash_pattern[1], line.get_marker()) for line in lines]


@pytest.mark.parametrize("palette", [COLOURS, ON_DARK])
@pytest.mark.parametrize("sight", SIGHTS)
def test_lines_with_one_dash_have_hues_that_can_be_told_apart(palette, sight):
    for i, j in combinations(range(12), 2):
        if dash_of(i) == dash_of(j):
            apart = np.linalg.norm(lab(palette[i % 6], sight) - lab(palette[j % 6], sight))
            assert apart >= TELLING_DISTANCE, (i, j)


def test_no_two_of_sixty_look_the_same():
    assert len({(COLOURS[k % 6], dash_of(k), mark_of(k)) for k in range(60)}) == 60
    assert not any(map(mark_of, range(12)))  # markers only when colours and dashes repeat


@pytest.mark.parametrize("count", [NINE, 20])
def test_every_line_of_a_panel_is_another_one_and_stands_so_in_the_legend(count):
    (axes,) = draw([Panel(title="All", series=series(count))], 10.0).axes
    told = styles(axes.get_legend().legend_handles)
    assert len(set(told)) == count and set(told) == set(styles(axes.get_lines()))


def test_components_of_one_run_keep_their_dash_and_have_marks():
    """The levels of the components, which are true values and bounds, are dashed."""
    several = [Series(t=one.t, value=one.value, label=one.label, colour=one.colour, dash=0) for one in series(NINE)]
    (axes,) = draw([Panel(title="Estimates", series=several)], 10.0).axes
    told = styles(axes.get_legend().legend_handles)
    assert len(set(told)) == NINE and {line[1] for line in told} == {"-"}


def test_paths_in_space_are_told_apart():
    t = np.linspace(0, 10, 101)
    path = np.column_stack([t, np.sin(t), t])
    attitude = np.broadcast_to(np.eye(3), (101, 3, 3))
    movers = tuple(Mover(label=f"scheme {k}", colour=k, path=path + 0.1 * k, attitude=attitude) for k in range(NINE))
    scene = Scene(title="Nine", unit="m", t=t, target=None, movers=movers, wire=(np.eye(3),), fails=0.0)
    assert len(set(styles(paths_figure(scene).legends[0].legend_handles))) == NINE


def test_distributions_of_many_schemes_are_drawn():
    """Dashes ran out after 24."""
    values = {f"scheme {k}": np.linspace(1, 2 + k, 20) for k in range(30)}
    (axes,) = draw_shares([Shares(title="All", axis="error", values=values)], "").axes
    assert len(axes.get_lines()) == 30


def test_a_png_has_every_hue_that_its_lines_have():
    """Covered lines with few visible pixels keep their hue too. A palette chosen only by pixels would turn purple into grey."""
    panels = [Panel(title="All", series=series(6), whole_row=True) for _ in range(4)]
    picture = np.asarray(Image.open(io.BytesIO(render(draw(panels, 10.0), "png"))).convert("RGB")).reshape(-1, 3).astype(int)
    assert (picture[0] == 255).all()
    seen = [(hue, saturation) for hue, saturation, _ in map(rgb_to_hsv, *(np.unique(picture, axis=0).T / 255))]
    for colour in COLOURS:
        wanted, full, _ = rgb_to_hsv(*to_rgb(colour))
        around = [saturation for hue, saturation in seen if abs((hue - wanted + 0.5) % 1 - 0.5) < 15 / 360]
        assert max(around, default=0.0) >= 0.7 * full, colour  # of the contrast of a thin line's pixels with the background
