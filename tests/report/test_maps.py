"""Maps: lost runs are distinguishable, cells are centred at their values, and invalid data are rejected."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from barbalat.certificates.certificates import Table1
from barbalat.certificates.certify import Certified
from barbalat.folders import Folder
from barbalat.papers.claim import ChartAxis, Curve, Map
from barbalat.papers.jafari_2013.paper import PAPER
from barbalat.pictures.render import render
from barbalat.report import maps, page, write
from barbalat.validate import InputError
from papers.a_claim import a_claim


def example(**change):
    settings = {
        "key": "gain-step",
        "title": "Map",
        "caption": "A caption",
        "x": ChartAxis("gain", [1.0, 10.0, 100.0], logarithmic=True),
        "y": ChartAxis("step [s]", [1.0, 2.0]),
        "values": [[1.0, 2.0, 3.0], [4.0, 5.0, np.nan]],
        "quantity": "variation [1/s]",
        "curves": (Curve("boundary", [1.0, 100.0], [2.5, 0.5]),),
    }
    return Map(**(settings | change))


def test_cells_lie_around_their_values():
    figure = maps.draw(example())
    axes = figure.axes[0]
    low, high = axes.get_xlim()
    assert (low, high) == pytest.approx((10**-0.5, 10**2.5))
    assert axes.get_ylim() == pytest.approx((0.5, 2.5))


def test_the_lost_cell_is_grey_and_hatched_and_the_others_are_not():
    figure = maps.draw(example(curves=()))
    picture = imread(io.BytesIO(render(figure, "png")))[::-1]
    box = figure.axes[0].get_window_extent()
    scale = picture.shape[1] / figure.bbox.width

    def cell(row: int, column: int):
        left, right = (box.x0 + box.width * part for part in ((column + 0.1) / 3, (column + 0.9) / 3))
        low, high = (box.y0 + box.height * part for part in ((row + 0.1) / 2, (row + 0.9) / 2))
        return picture[int(low * scale) : int(high * scale), int(left * scale) : int(right * scale), :3]

    for row in range(2):
        for column in range(3):
            found = cell(row, column)
            grey = bool(np.ptp(found, axis=2).max() < 0.02)
            hatched = bool(np.ptp(found.reshape(-1, 3), axis=0).max() > 0.2)
            assert (grey, hatched) == ((True, True) if (row, column) == (1, 2) else (False, False))


def test_a_map_with_every_run_lost_and_a_logarithmic_scale_can_be_drawn():
    assert render(maps.draw(example(values=np.full((2, 3), np.nan))), "svg")
    assert render(maps.draw(example(logarithmic=True)), "png").startswith(b"\x89PNG")


def test_files_page_and_link(tmp_path):
    claim = a_claim("some-claim", True, maps=(example(),))
    folder = Folder(tmp_path)
    pictures = write.draw_maps(folder, [claim])
    folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"map-gain-step.png", "map-gain-step.svg", "map-gain-step-narrow.svg"}
    tried = {"some-claim": "explorer.html#lesson=it"}
    text = page.reproduction(PAPER, [], [claim], {}, pictures, Certified({}, Table1(())), [], {"total": 1.0}, tried)[
        "claims.html"
    ]
    card = text[text.index('<article id="claim-some-claim"') : text.index("</article>")]
    assert 'id="map-gain-step"' in card
    assert '<a href="explorer.html#lesson=it">' in card
    assert '<img class="desk" src="data:image/svg+xml,' in card and '<img class="phone" src="data:image/svg+xml,' in card
    assert "map-gain-step.svg" not in card  # the page contains its only picture
    contract, beside = (
        {"id", "where", "statement", "verdict", "finding", "source", "quote", "headline", "readings", "measured", "how"},
        {"condition", "would_change", "sharpened", "listings", "code", "equation", "changed"},
    )
    assert set(claim.as_json()) == contract | beside


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": [[1.0, 2.0]]}, r"shape \(y, x\) = \(2, 3\), got \(1, 2\)"),
        ({"key": "A map"}, "small letters"),
        ({"values": [[0.0, 1, 1], [1, 1, 1]], "logarithmic": True}, "smallest value is 0"),
    ],
)
def test_maps_that_make_no_sense(change, message):
    with pytest.raises(InputError, match=message):
        example(**change)


def test_axes_and_curves_that_make_no_sense():
    with pytest.raises(InputError, match="ascending"):
        ChartAxis("x", [1.0, 1.0])
    with pytest.raises(InputError, match="above zero"):
        ChartAxis("x", [0.0, 1.0], logarithmic=True)
    with pytest.raises(InputError, match="3 values of x and 2 of y"):
        Curve("c", [1, 2, 3], [1, 2])
