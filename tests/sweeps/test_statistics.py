"""Fractions and medians with their intervals, compared with formulas, tables, other code and repetition."""

import numpy as np
import pytest
from scipy.stats import beta, binom, quantile_test

from barbalat.sweeps.statistics import Median, Share, beyond_chance

NAN = float("nan")


@pytest.mark.parametrize(("count", "judged"), [(0, 10), (3, 10), (10, 10), (17, 100_000)])
def test_intervals_are_clopper_pearsons(count, judged):
    low, high = Share(count=count, judged=judged).interval
    assert low == pytest.approx(beta.ppf(0.025, count, judged - count + 1) if count else 0.0, rel=1e-6)
    assert high == pytest.approx(beta.ppf(0.975, count + 1, judged - count) if count < judged else 1.0, rel=1e-6)


def test_the_medians_interval_is_that_of_the_order_statistics():
    """The 6th and the 15th of 20 values bound the median with 95.9 %, as in table A3 of Conover (1999)."""
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


def test_the_medians_interval_is_scipys_and_a_failure_is_one_run_on_the_worse_side():
    random = np.random.default_rng(1)
    for count in (8, 25, 200):
        values = random.normal(size=count)
        other = quantile_test(values, q=0.0, p=0.5).confidence_interval(0.95)
        assert Median.of(values).interval == (other.low, other.high)
    found = Median.of(np.concatenate([np.full(12, np.inf), random.normal(size=28), np.full(3, -np.inf)]))
    assert np.isfinite(found.interval).all() and found.interval[0] < found.value < found.interval[1]
    assert Median.of(np.arange(5.0)).interval == (-np.inf, np.inf)  # 5 equal signs are not rare enough
    k = int(np.searchsorted(binom.cdf(np.arange(26), 25, 0.5), 0.025))
    assert binom.cdf(k - 1, 25, 0.5) < 0.025 <= binom.cdf(k, 25, 0.5)


def test_the_median_is_infinite_where_half_of_the_runs_failed():
    assert Median.of(np.array([1.0, 2.0, 3.0, 4.0])).value == 2.5
    assert Median.of(np.array([1.0, 2.0, np.inf, np.inf])).value == np.inf
    assert Median.of(np.array([-np.inf, -np.inf, 1.0, 2.0])).value == -np.inf
    assert Median.of(np.array([-np.inf, -np.inf, np.inf, np.inf])).value == -np.inf  # no mean of the two


def test_many_pairs_share_one_confidence():
    """Holm's method at 5 % compares the smallest probability with 5 % divided by the number of pairs, the next with 5 % divided
    by the number of the others."""
    shares = {name: Share(count=count, judged=100) for name, count in {"a": 64, "b": 37, "c": 61, "d": 52}.items()}
    assert [round(one.chance, 3) for one in shares.values()] == [0.007, 0.012, 0.035, 0.764]
    assert beyond_chance(shares) == {"a": 1, "b": -1, "c": 0, "d": 0}  # the first three need 0.0125, 0.0167 and 0.025
