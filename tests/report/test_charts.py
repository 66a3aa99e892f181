"""Charts: a lost run is marked at its end, invalid data are rejected, and the page contains picture and table."""

import numpy as np
import pytest

from barbalat.certificates.certificates import Table1
from barbalat.certificates.certify import Certified
from barbalat.folders import Folder
from barbalat.papers.claim import Chart, ChartAxis, Curve, Listing
from barbalat.papers.jafari_2013.paper import PAPER
from barbalat.pictures.render import render
from barbalat.report import maps, page, write
from barbalat.validate import InputError
from papers.a_claim import a_claim


def example(**change):
    settings = {
        "key": "sizes",
        "title": "Chart",
        "caption": "A caption",
        "x": ChartAxis("size", [1.0, 2.0, 4.0], logarithmic=True),
        "quantity": "error",
        "curves": (Curve("whole", [1.0, 2.0, 4.0], [1.0, 2.0, 3.0]), Curve("ends early", [1.0, 2.0], [3.0, 5.0])),
        "levels": (Curve("level", [1.0, 4.0], [2.0, 2.0]),),
    }
    return Chart(**(settings | change))


def crosses(figure) -> list[tuple[float, float]]:
    return [
        (float(line.get_xdata()[-1]), float(line.get_ydata()[-1])) for line in figure.axes[0].lines if line.get_marker() == "x"
    ]


def test_only_what_ends_early_is_marked():
    assert crosses(maps.draw_chart(example())) == [(2.0, 5.0)]
    assert crosses(maps.draw_chart(example(curves=example().curves[:1]))) == []
    (legend,) = maps.draw_chart(example()).legends
    assert [text.get_text() for text in legend.get_texts()] == ["whole", "ends early", "level", "diverged beyond"]


def test_many_curves_have_colours_of_their_own():
    curves = tuple(Curve(str(k), [1.0, 4.0], [1.0 + k, 2.0 + k]) for k in range(7))
    lines = maps.draw_chart(example(curves=curves, levels=())).axes[0].lines
    assert len({line.get_color() for line in lines}) == 7


def test_a_curve_that_is_lost_from_the_start_can_be_drawn():
    nothing = Curve("nothing", np.array([1.0]), np.array([1.0]))
    assert render(maps.draw_chart(example(curves=(nothing,))), "svg")


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="falls to -1"):
        example(curves=(Curve("a", [1.0, 2.0], [1.0, -1.0]),))
    with pytest.raises(InputError, match="key"):
        example(key="Not a key")
    with pytest.raises(InputError, match="2 columns"):
        Listing("table", ("a", "b"), (("1",),))


def test_page_and_files(tmp_path):
    listing = Listing("A table", ("controller", "Ms"), (("PI & co", "1.03"),))
    claim = a_claim("an-id", True, maps=(example(),), listings=(listing,))
    folder = Folder(tmp_path)
    pictures = write.draw_maps(folder, [claim])
    folder.commit()
    assert (tmp_path / "map-sizes.png").stat().st_size > 1000
    html = page.reproduction(PAPER, [], [claim], {}, pictures, Certified({}, Table1(())), [], {"total": 1.0}, {})["claims.html"]
    assert "error over size, for whole, ends early" in html
    assert '<th scope="row">PI &amp; co</th><td>1.03</td>' in html
    assert "A table" in html
