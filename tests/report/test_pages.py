"""Pages: their contents, the files beside them, and the display of a table on a phone."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from html import unescape
from urllib.parse import unquote

import pytest

from barbalat import Mrac, Simulation, certify, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.certificates import Table1
from barbalat.certificates.certify import Certified
from barbalat.certificates.picture import distinct
from barbalat.folders import Folder
from barbalat.report import page, rendering
from barbalat.report.drawings import DrawnFile, ReportFigure
from barbalat.report.notation import mathematics
from barbalat.report.rendering import fits_a_phone
from barbalat.report.run_pages import loops_data, write_certificates, write_comparison
from barbalat.report.sweep import in_symbols


@pytest.fixture(scope="module")
def results():
    return simulate(load_case("first-order").problem, [Mrac(gamma=5)], Simulation(t_end=1, dt=1e-2))


SVG = '<svg xmlns="http://www.w3.org/2000/svg">\n<style>a { fill: #102030; width: 50% }</style><g id="a&lt;b"/></svg>'


def shown(svg):
    page = rendering.templates().from_string(
        '{% extends "page.html" %}{% from "macros.html" import image with context %}'
        '{% block title %}A page{% endblock %}{% block content %}{{ image(picture, "a picture") }}{% endblock %}'
    )
    picture = ReportFigure(DrawnFile("wide.svg", svg), DrawnFile("narrow.svg", svg))
    return rendering.render(page, {"picture": picture})


def test_a_small_page_holds_its_pictures():
    """The data URI decodes to the picture with the same tags, colours and texts."""
    found = shown(SVG)
    addresses = [unescape(one) for one in re.findall(r'src="([^"]*)"', found)]
    assert len(addresses) == 2 and "srcset" not in found and "://" not in found
    for address in addresses:
        kind, _, text = address.partition(",")
        assert kind == "data:image/svg+xml" and "#" not in text
        read, meant = (ET.canonicalize(one).replace("\n", " ") for one in (unquote(text), SVG))
        assert read == meant


def test_a_large_page_has_them_beside_it():
    found = shown(SVG.replace("<g", f"<!--{'x' * rendering.LARGEST_PAGE_BYTES}--><g"))
    assert len(found) < rendering.LARGEST_PAGE_BYTES
    assert 'src="wide.svg"' in found and 'srcset="narrow.svg"' in found and rendering.PICTURES_BESIDE in found


def test_loops_are_drawn_once(tmp_path):
    """Two gains have the same loop with frozen estimates but different loops with the law."""
    problem, simulation = load_case("paper").problem, Simulation(t_end=1, dt=1e-4)
    certificates = certify(problem, [Mrac(name="slow", gamma=5), Mrac(name="fast", gamma=50)], simulation)
    found = distinct(certificates)
    assert [loop.name.partition(":")[0] for loop in found].count("slow; fast") == 1
    assert len(found) == sum(len(one.loops) for one in certificates.values()) - 1
    (data,) = loops_data(certificates)
    assert len(data["loops"]) == len(found)
    folder = Folder(tmp_path)
    write_certificates(folder, "a case", Certified(certificates, Table1(())), "{}", pictures=True)
    folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"certify.json", "report.html", "loops.png", "loops.svg"}


def test_what_fits_a_phone():
    assert fits_a_phone(("tau [s]", "error", "delay"), [("0.1", "2.02", "84.7")])
    assert not fits_a_phone(("tau [s]",) * 8, [("0.0001234",) * 8])
    assert fits_a_phone(("reading", "measured"), [("many short words in a cell " * 5, "1")])


def test_claims_lead_to_one_another():
    found = page.linked(mathematics("as in best-filter, <b> not-there, the rohrs plant"), ["best-filter", "best", "rohrs"])
    assert found == 'as in <a href="#claim-best-filter"><code>best-filter</code></a>, &lt;b&gt; not-there, the rohrs plant'


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("max_abs_e[0]", "max |e_1|"),
        ("tail_max_abs_e[1] < 2", "max |e_2|, tail < 2"),
        ("max_abs_u", "max |u|"),
        ("oscillated", "oscillated"),
    ],
)
def test_a_sweeps_page_names_figures_by_symbols(name, shown):
    assert in_symbols(name) == shown


def test_a_page_of_runs_is_drawn_where_it_is_read(tmp_path):
    """A separate process has not imported Matplotlib afterwards. If pictures are requested, they are also written to files."""
    (tmp_path / "case.py").write_text(
        "import sys\n"
        "from barbalat.cli import main\n"
        "code = main(['run', 'first-order', '--out', 'out'])\n"
        "sys.exit(code or 10 * ('matplotlib' in sys.modules))\n"
    )
    assert subprocess.run([sys.executable, "case.py"], cwd=tmp_path, check=False, capture_output=True).returncode == 0
    assert not [*(tmp_path / "out").glob("*.png"), *(tmp_path / "out").glob("*.svg")]


def test_pictures_of_runs_are_files_where_they_are_asked_for(results, tmp_path):
    folder = Folder(tmp_path)
    write_comparison(folder, "a case", list(results.values()), Certified({}, Table1(())), pictures=True)
    folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", "comparison.png", "comparison.svg"}
