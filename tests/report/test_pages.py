"""Pages: what they hold themselves, what lies beside them, and what a phone is shown of a table."""

import re
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
from barbalat.report import page, write
from barbalat.report.drawings import DrawnFile, ReportFigure
from barbalat.report.notation import mathematics
from barbalat.report.page import fits_a_phone
from barbalat.report.sweep import in_symbols


@pytest.fixture(scope="module")
def results():
    return simulate(load_case("first-order").problem, [Mrac(gamma=5)], Simulation(t_end=1, dt=1e-2))


SVG = '<svg xmlns="http://www.w3.org/2000/svg">\n<style>a { fill: #102030; width: 50% }</style><g id="a&lt;b"/></svg>'


def shown(results, svg):
    picture = ReportFigure(DrawnFile("wide.svg", svg), DrawnFile("narrow.svg", svg))
    return page.comparison("a case", list(results.values()), Certified({}, Table1(())), picture)


def test_a_small_page_holds_its_pictures(results):
    """What a browser reads from the address is the picture: the same tags, colours and texts."""
    found = shown(results, SVG)
    addresses = [unescape(one) for one in re.findall(r'src="([^"]*)"', found)]
    assert len(addresses) == 2 and "srcset" not in found and "://" not in found
    for address in addresses:
        kind, _, text = address.partition(",")
        assert kind == "data:image/svg+xml" and "#" not in text
        read, meant = (ET.canonicalize(one).replace("\n", " ") for one in (unquote(text), SVG))
        assert read == meant


def test_a_large_page_has_them_beside_it(results):
    found = shown(results, SVG.replace("<g", f"<!--{'x' * page.LARGEST_PAGE_BYTES}--><g"))
    assert len(found) < page.LARGEST_PAGE_BYTES
    assert 'src="wide.svg"' in found and 'srcset="narrow.svg"' in found and page.PICTURES_BESIDE in found


def test_loops_are_drawn_once(tmp_path):
    """Two gains have the same loop at rest, and loops of their own with the law included."""
    problem, simulation = load_case("paper").problem, Simulation(t_end=1, dt=1e-4)
    certificates = certify(problem, [Mrac(name="slow", gamma=5), Mrac(name="fast", gamma=50)], simulation)
    found = distinct(certificates)
    assert [loop.name.partition(":")[0] for loop in found].count("slow; fast") == 1
    assert len(found) == sum(len(one.loops) for one in certificates.values()) - 1
    folder = Folder(tmp_path)
    (picture,) = write.loop_pictures(certificates)
    write.keep(folder, [picture])
    folder.commit()
    assert {path.name for path in tmp_path.iterdir()} == {"loops.svg", "loops-narrow.svg"}
    assert picture.narrow is not None and picture.narrow.svg != picture.wide.svg


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


def test_progress_of_drawing_rises_to_its_end(results, tmp_path):
    """In as many steps as there are pictures, where there are no loops to draw too."""
    for certificates in ({}, certify(next(iter(results.values())).problem, [Mrac(gamma=5)], Simulation(t_end=1, dt=1e-2))):
        told = []
        write.write_comparison(
            Folder(tmp_path), "a case", list(results.values()), Certified(certificates, Table1(())), told.append
        )
        assert told == sorted(told) and told[0] < 0.8 and told[-1] == pytest.approx(1.0)
        assert len(told) >= 2
