"""Intervals and pairs of dispersed flights, against what is known by hand and by repetition; no simulator is needed."""

import numpy as np
import pytest
from scipy.stats import binom

from barbalat.flight.evidence import Median, evidence_of

NAN = float("nan")


def test_the_medians_interval_is_that_of_the_order_statistics():
    """Of 20 values the 6th and the 15th bound the median with 95.9 %: the table of Conover (1999), A3."""
    found = Median.of(np.random.default_rng(1).permutation(np.arange(1.0, 21.0)))
    assert found.value == 10.5
    assert found.interval == (6.0, 15.0)
    assert 1 - 2 * binom.cdf(5, 20, 0.5) > 0.95 > 1 - 2 * binom.cdf(6, 20, 0.5)


def test_it_covers_the_median_as_often_as_it_says():
    random, covered = np.random.default_rng(2), 0
    for _ in range(2000):
        low, high = Median.of(random.exponential(size=25)).interval
        covered += low <= np.log(2) <= high
    assert covered / 2000 > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 2000)  # three standard deviations of so many trials


def test_too_few_values_bound_nothing_and_a_lost_flight_is_infinitely_bad():
    assert Median.of(np.array([1.0, 2.0, 3.0])).interval == (-np.inf, np.inf)
    assert Median.of(np.array([1.0, NAN, NAN])).value == np.inf


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
    assert (pairing.better.count, pairing.better.judged) == (2, 3)  # the third it lost alone, the fourth says nothing
    assert pairing.says == 0


@pytest.mark.parametrize(("better", "says"), [(40, 1), (10, -1), (29, 0)])
def test_a_pair_differs_beyond_chance_where_its_interval_leaves_one_half_out(better, says):
    """Of 50 draws: the sign test's bounds at 5 % are 18 and 32."""
    own, other = np.zeros(50), np.where(np.arange(50) < better, 1.0, -1.0)

    def column(controller, failure, figure):
        values = own if controller == "own" else other
        return np.full(50, NAN) if figure == "lost_at" else values

    flown = evidence_of(column, ("own", "other"), ("none",)).by_failure["none"]
    assert next(one for one in flown if one.controller == "own").pairings[0].says == says
