"""The comparison with linear designs if the packages for the H-infinity synthesis are not installed."""

import sys

import pytest

from barbalat.papers.jafari_2013.linear import linear_design


@pytest.mark.full
def test_the_row_says_whom_it_compares_with_where_designs_are_left_out(monkeypatch):
    monkeypatch.setitem(sys.modules, "slycot", None)
    row, _, fixed = linear_design.claims()
    assert "pip install 'barbalat[robust]'" in row.measured and "pip install 'barbalat[robust]'" in fixed.measured
    assert fixed.finding == "fails" and "amplitude with PI; with L1-AC" in fixed.shows
