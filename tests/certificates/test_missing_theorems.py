"""Each controller of each bundled case has a bound on e, or a sentence on the page names the missing theorem."""

from pathlib import Path

import pytest

from barbalat.cases.load import bundled
from barbalat.certificates import theorems
from barbalat.certificates.certificates import column_of
from barbalat.certificates.summary import five

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "missing-theorems.md"
SENTENCES = {value for name, value in vars(theorems).items() if name.isupper()}


@pytest.mark.parametrize("name", sorted(bundled()))
def test_a_bound_of_e_or_the_missing_theorem(name, certified):
    case, found = certified(name)
    for controller in case.controllers:
        certificate = found[controller.name]
        bound = certificate.entry("error_bound")
        if bound is not None and bound.kind == "guaranteed":
            assert not bound.theorem
            continue
        assert bound is not None, f"{controller.name} says nothing of a bound of e"
        assert set(bound.theorem.split("; ")) <= {part for s in SENTENCES for part in s.split("; ")}
        assert bound.theorem, f"{controller.name}: {bound.why} names no theorem"
        assert bound.as_json()["theorem"] == bound.theorem
        line = five(column_of(case.problem, controller, certificate), certificate, None)[1]
        assert bound.theorem in line.text


def test_the_page_has_every_sentence():
    page = PAGE.read_text()
    assert not [sentence for sentence in SENTENCES if sentence not in page]
