"""The search for the largest tolerated value, against known values."""

from __future__ import annotations

import math
import sys

import pytest

from barbalat.linear.largest import geometric_mean, halvings, largest, largest_from, largest_of_size, largest_whole


def up_to(limit):
    return lambda value: value <= limit


@pytest.mark.parametrize("limit", [1e-300, 1e-160, 3e-5, 0.7, 1.0 - 1e-16, 1e12, 1e200])
def test_neighbours_of_a_known_limit(limit):
    """The search finds the limit even if the product of the ends is below the smallest float, which once made the search
    endless."""
    eight_roundings = 8 * sys.float_info.epsilon
    assert largest(up_to(limit), 0.0, 10 * limit) == pytest.approx(limit, rel=eight_roundings)
    assert largest(up_to(limit), limit / 1e4, limit * 1e4) == pytest.approx(limit, rel=eight_roundings)
    for start in (limit / 1e3, limit * 1e3):
        assert largest_from(up_to(limit), start) == pytest.approx(limit, rel=eight_roundings)


def test_what_is_found_is_tolerated_and_what_is_a_little_above_is_not():
    found = largest(up_to(math.pi), 1.0, 10.0, within=1e-3)
    assert found <= math.pi < found * (1 + 1e-3 / (1 - 1e-3))


def test_where_nothing_or_everything_is_tolerated():
    assert largest(lambda _: False, 0.0, 1.0) == 0.0
    assert largest_from(lambda _: False, 1.0) == 0.0
    assert largest_from(up_to(0.4), 1.0, least=0.5) == 0.0
    assert largest_from(lambda _: True, 1.0) == math.inf


SIZES = {
    "a power": (lambda x: (x / 3e-5) ** 3, 3e-5),
    "saturating": (lambda x: 1.001 * x / (0.2 + x), 200.0),
    "a kink": (lambda x: max(x / 2, 5 * x - 9), 2.0),
    "a jump": (lambda x: 0.5 if x < math.pi else 2.0, math.pi),
    "unbounded beyond": (lambda x: x if x <= 0.7 else math.inf, 0.7),
}


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("start", [1e-8, 1.0, 1e4])
def test_secants_find_the_limit_that_bisection_finds(name, start):
    size, limit = SIZES[name]
    asked = []

    def counted(value):
        asked.append(value)
        return size(value)

    found = largest_of_size(counted, start, within=1e-6)
    assert size(found) < 1 and size(found * (1 + 1.1e-6)) >= 1 and found == pytest.approx(limit, rel=1.1e-6)
    steps = 1 + math.ceil(abs(math.log2(limit / start)))
    smooth = name in ("a power", "saturating")
    assert len(asked) - steps <= (10 if smooth else 5 * 20), "bisection from a factor of 2 takes 20"


def test_secants_where_nothing_or_everything_is_tolerated():
    assert largest_of_size(lambda _: 2.0, 1.0, within=1e-6) == 0.0
    assert largest_of_size(lambda _: 0.5, 1.0, within=1e-6) == math.inf
    assert largest_of_size(lambda _: 0.0, 1.0, within=1e-6) == math.inf


def test_the_first_exit_counts_where_the_steps_are_short():
    """Values below 2 and from 3 to 4 are tolerated. Steps of a tenth find the gap, and the result is its beginning."""
    found = largest_from(lambda value: value <= 2 or 3 <= value <= 4, 1.0, factor=1.1)
    assert found == pytest.approx(2.0, rel=1e-15)


def test_geometric_means_beyond_the_range_of_the_product():
    assert geometric_mean(2.0, 8.0) == 4.0
    assert geometric_mean(1e-200, 1e-300) == pytest.approx(1e-250, rel=1e-14)
    assert geometric_mean(1e200, 1e300) == pytest.approx(1e250, rel=1e-14)


@pytest.mark.parametrize(("ratio", "within"), [(1.0, 0.01), (1.0001, 0.01), (1.5, 0.02), (100.0, 1e-6)])
def test_as_many_halvings_as_it_takes(ratio, within):
    count, width = 0, ratio
    while width > 1 + within:
        width, count = math.sqrt(width), count + 1
    assert halvings(ratio, within) == count


@pytest.mark.parametrize("bound", range(24))
@pytest.mark.parametrize("stride", [1, 4, 7])
def test_the_largest_whole_number(bound, stride):
    """All values up to the bound are tolerated. Nothing is tried beyond the last stride."""
    tried = []

    def tolerates(number):
        tried.append(number)
        return number <= bound

    last = 20 // stride * stride
    assert largest_whole(tolerates, stride=stride, most=20) == (20 if bound >= last else bound)
    assert len(tried) == len(set(tried)) and 0 not in tried
