"""A claim is one file in a subject's folder, and a paper is one folder that an entry point names. Nothing else is edited."""

import json

import pytest

import barbalat
from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case
from barbalat.papers import paper as found
from barbalat.papers.jafari_2013.paper import PAPER
from copies import barbalat_says, package_in, with_entry_point

CLAIM = '''
"""A claim that is nothing but a file."""

from barbalat.papers.claim import Claim
from barbalat.papers.claim import Measurement
from barbalat.papers.finding import Sentence
from barbalat.papers.finding import Source

SENTENCE = Sentence(
    row="two-is-even", source=Source("on_parity", "Somebody", "others"), where="page 1", quote="Two is even.",
    statement="Two is even",
    literal=("the remainder of its division by two is zero",),
)


def measured() -> Claim:
    return Claim(
        sentence=SENTENCE, readings=(SENTENCE.reads(2 % 2 == 0, "2 mod 2 = 0"),), shows="The remainder is 0.",
        measured="2 mod 2 = 0", how="by division", would_change="another arithmetic",
    )


ROWS = (Measurement(measured, 0.1, {"two-is-even": "a number's parity"}, place=35, quick=True),)
'''
PAPER_FILE = '''
"""Somebody's paper."""

from barbalat.papers.paper import Paper

PAPER = Paper(package=__package__, title="On Parity", introduction="The claims of On Parity, decided.")
'''


def test_a_claim_is_one_file(tmp_path):
    """In a copy of the package the claim appears at its place among the others."""
    (package_in(tmp_path) / "papers" / "jafari_2013" / "tracking" / "parity.py").write_text(CLAIM)
    names = [row["id"] for row in json.loads(barbalat_says("claims", "--json", path=tmp_path))["claims"]]
    expected = [name for part in PAPER.ledger for name in part.names]
    expected.insert(3, "two-is-even")
    others = [name for paper in found.papers().values() if paper is not PAPER for part in paper.ledger for name in part.names]
    assert names == expected + others
    told = json.loads(barbalat_says("claims", "two-is-even", "--json", path=tmp_path))
    assert (told["finding"], told["verdict"], told["source"]) == ("holds", "confirmed", "on_parity")
    assert told["code"].endswith("tracking/parity.py: measured")


def test_a_paper_is_one_folder_and_its_entry_point(tmp_path):
    package = tmp_path / "on_parity"
    (package / "arithmetic").mkdir(parents=True)
    (package / "cases").mkdir()
    for file, text in {
        "__init__.py": "",
        "paper.py": PAPER_FILE,
        "cases/even.toml": bundled()["first-order"].read_text(),
        "arithmetic/__init__.py": "",
        "arithmetic/parity.py": CLAIM,
    }.items():
        (package / file).write_text(text)
    with_entry_point(tmp_path, found.GROUP, "on_parity")
    listed = json.loads(barbalat_says("reproduce", "--list", "--json", path=tmp_path))["papers"]
    assert [one["name"] for one in listed] == [
        "jafari_2013",
        "cao_2006",
        "cao_hovakimyan_2006",
        "on_parity",
    ]
    assert listed[-1]["cases"] == [str(package / "cases" / "even.toml")]
    document = json.loads(barbalat_says("reproduce", "on_parity", "--json", "--out", "report", path=tmp_path))
    assert [(row["id"], row["verdict"]) for row in document["claims"]] == [("two-is-even", "confirmed")]
    assert document["figures"] == {} and document["certificates"] == {}
    page = (tmp_path / "report" / "report.html").read_text()
    assert "On Parity" in page and "Jafari" not in page and 'href="even.toml"' in page
    assert load_case(tmp_path / "report" / "even.toml").name == load_case("first-order").name
    rows = json.loads(barbalat_says("claims", "--json", path=tmp_path))["claims"]
    assert rows[-1]["id"] == "two-is-even" and len(rows) == 1 + sum(
        len(part.names) for paper in found.papers().values() for part in paper.ledger
    )


def test_an_entry_point_that_can_not_be_imported_is_refused_by_its_distribution(tmp_path, monkeypatch):
    with_entry_point(tmp_path, found.GROUP, "not_there")
    monkeypatch.syspath_prepend(str(tmp_path))
    found.papers.cache_clear()
    try:
        with pytest.raises(barbalat.InputError, match=r"'anything' of others 1\.0 .* 'not_there'"):
            found.papers()
    finally:
        found.papers.cache_clear()
