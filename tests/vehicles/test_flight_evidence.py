"""Intervals and pairs of dispersed flights, compared with results by hand and by repetition. No simulator is needed."""

import numpy as np
import pytest

from barbalat.vehicles.dispersed import evidence_of

NAN = float("nan")


def test_losses_come_first_and_pairs_are_counted_where_not_both_are_lost():
    errors = {
        "calm": np.array([3.0, 3.0, 3.0, NAN]),
        "quick": np.array([1.0, 1.0, NAN, NAN]),
    }

    def column(controller, failure, figure):
        values = errors[controller]
        return np.where(np.isnan(values), 5.0, NAN) if figure == "lost_at" else values

    found = evidence_of(column, ("quick", "calm"), ("gusts",))
    assert found.lost == {"calm": (1, 4), "quick": (2, 4)}
    first, second = found.by_failure["gusts"]
    assert (first.controller, first.lost.count, second.lost.count) == ("calm", 1, 2)
    (pairing,) = second.pairings
    assert (pairing.better.count, pairing.better.judged) == (2, 3)  # it alone lost the third; the fourth gives no information
    assert (pairing.follows, pairing.keeps) == (0, 0)


@pytest.mark.parametrize(("better", "says"), [(33, 1), (17, -1), (32, 0), (18, 0)])
def test_a_single_pair_differs_beyond_chance_as_the_sign_test_says(better, says):
    """For 50 draws the sign test's bounds at 5 % are 17 and 33."""
    own, other = np.zeros(50), np.where(np.arange(50) < better, 1.0, -1.0)

    def column(controller, failure, figure):
        values = own if controller == "own" else other
        return np.full(50, NAN) if figure == "lost_at" else values

    flown = evidence_of(column, ("own", "other"), ("none",)).by_failure["none"]
    assert next(one for one in flown if one.controller == "own").pairings[0].follows == says


def test_among_equals_any_pair_is_called_different_as_seldom_as_it_says():
    """For 36 pairs of nine controllers with errors from one distribution, a difference is claimed in at most 5 % of trials."""
    random, wrong, trials = np.random.default_rng(3), 0, 60
    names = tuple("abcdefghi")
    for _ in range(trials):
        errors = dict(zip(names, random.exponential(size=(len(names), 40)), strict=True))

        def column(controller, failure, figure, errors=errors):
            return np.full(40, NAN) if figure == "lost_at" else errors[controller]

        flown = evidence_of(column, names, ("none",)).by_failure["none"]
        wrong += any(pairing.follows for one in flown for pairing in one.pairings)
    assert (
        wrong <= 7
    )  # with 60 trials at 5 % more occur once in fifty; pairs that are judged singly are wrong in half of all trials
