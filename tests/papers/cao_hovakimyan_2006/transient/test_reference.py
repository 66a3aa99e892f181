"""The abstract's rows: their findings, by Theorem 1 and by V' = -|x_tilde|^2."""

import numpy as np

from barbalat.papers.cao_hovakimyan_2006.paper import PAPER
from barbalat.papers.cao_hovakimyan_2006.sentences import COVERAGE, SENTENCES
from barbalat.papers.cao_hovakimyan_2006.transient import reference


def test_every_row_has_its_sentence():
    names = [name for part in PAPER.ledger for name in part.names]
    assert set(names) == set(SENTENCES) == {one.row for one in COVERAGE if one.row}


def test_theorem_1_bounds_what_is_said_to_have_no_bound():
    claim = reference.mrac()
    assert claim.finding == "fails" and [one.holds for one in claim.readings] == [False, False]
    (shown,) = claim.listings
    largest = np.array([float(row[2]) for row in shown.rows])
    assert (largest > 0.05).all() and (largest < 1).all()  # bounds that are no more than twenty times too wide


def test_the_distance_falls_with_the_gain_and_with_time():
    """By V' = -|x_tilde|^2 the prediction error is square integrable; the reference system is stable."""
    assert {claim.id: claim.finding for claim in reference.l1()} == {
        "gain-enforces-transient": "holds",
        "asymptotic-tracking": "holds",
    }
