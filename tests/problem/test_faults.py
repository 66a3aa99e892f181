"""The random faults compared with a second implementation of SplitMix64, their shares and times, and rejected settings."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.plants import Bias, Dropout, Jitter, Latency, Shell, Spike, Stuck
from barbalat.problem.faults import FAULTS, FaultSignal, uniform
from barbalat.validate import InputError
from independent import refusal

MASK = 2**64 - 1


def mixed(z: int) -> int:
    """SplitMix64's output function on Python's integers, after the published C."""
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def test_what_is_drawn_is_splitmix() -> None:
    """The first output of SplitMix64 from a seed of zero is the published 0xE220A8397B1DCDAF. The numbers are two rounds of
    it."""
    gamma = 0x9E3779B97F4A7C15
    assert mixed(gamma) == 0xE220A8397B1DCDAF
    for seed, place, slot in ((0, 0, 0), (7, 3, 12345), (2**64 - 1, 2**32 + 5, 10**13)):
        key = mixed((seed + (place + 1) * gamma) & MASK)
        expected = (mixed(mixed((slot * gamma + key) & MASK)) >> 11) * 2.0**-53
        assert uniform(seed, place, np.array([slot]))[0] == expected


def test_a_share_is_a_share_and_draws_are_independent() -> None:
    """Shares are within four standard deviations of binomial numbers. Neighbours, seeds and places are uncorrelated."""
    t, n, p = np.arange(40_000) * 1e-3, 40_000, 0.1
    drawn = [Dropout(share=p, seed=seed).there(t, place) for seed, place in ((0, 0), (0, 1), (1, 0))]
    for one in drawn:
        assert abs(one.mean() - p) < 4 * np.sqrt(p * (1 - p) / n)
        assert abs((one[1:] & one[:-1]).mean() - p**2) < 4 * np.sqrt(p**2 / n)
    assert all(abs((drawn[0] & other).mean() - p**2) < 4 * np.sqrt(p**2 / n) for other in drawn[1:])


def test_a_burst_lasts_as_long_as_it_says_whatever_the_step() -> None:
    fault = Dropout(share=0.2, burst=0.05)
    fine = fault.there(np.arange(200_000) * 1e-3, 0)
    assert (fine.reshape(-1, 50) == fine.reshape(-1, 50)[:, :1]).all()
    assert abs(fine.mean() - 0.2) < 4 * np.sqrt(0.2 * 0.8 / 4000)
    assert (fault.there(np.arange(20_000) * 1e-2, 0) == fine[::10]).all()


def test_intervals_are_half_open_and_not_off_by_a_rounding() -> None:
    there = Bias(size=2.0, times=[[0.3, 0.7], [1.0, 1.1]]).value(np.arange(15) * 0.1, 0)
    assert np.flatnonzero(there == 2.0).tolist() == [3, 4, 5, 6, 10] and set(there.tolist()) == {0.0, 2.0}


def test_spikes_go_both_ways_and_jitter_fills_its_range() -> None:
    t = np.arange(20_000) * 1e-3
    spikes = Spike(size=3.0, share=0.5).value(t, 0)
    assert set(np.unique(spikes)) == {-3.0, 0.0, 3.0} and abs(spikes.mean()) < 4 * 3 * np.sqrt(0.5 / len(t))
    late = Jitter(time=1e-3).value(t, 0)
    assert late.min() < -0.99 and late.max() > 0.99 and abs(late.mean()) < 4 / np.sqrt(3 * len(t))


def test_a_fault_is_a_signal_like_others() -> None:
    signal, t = FaultSignal(Stuck(times=((1.0, 2.0),)), 0), np.array([0.0, 1.0, 2.0])
    assert signal(t).tolist() == signal.before(t).tolist() == [0.0, 1.0, 0.0]
    assert signal == FaultSignal(Stuck(times=((1.0, 2.0),)), 0) != FaultSignal(Stuck(times=((1.0, 2.0),)), 1)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (Dropout, "a dropout needs share or times, which determine when it acts"),
        (lambda: Dropout(share=1.5), "share must be at most 1, got 1.5"),
        (lambda: Dropout(share=0.1, times=[[0, 1]]), "give either share or times, got both"),
        (lambda: Dropout(times=[[2, 1]]), "times must be intervals [start, end] with 0 <= start < end, got [2, 1]"),
        (lambda: Dropout(burst=0.1, times=[[1, 2]]), "burst needs share, which is missing"),
        (lambda: Spike(size=0.0, share=0.1), "size must be positive, got 0.0"),
        (lambda: Latency(time=-1.0), "time must be positive, got -1.0"),
        (lambda: Shell(range={"a": [2, 1]}), "shell.range.a must be [lowest, highest], got [2, 1]"),
        (lambda: Shell(rate={"a": -1}), "shell.rate.a must be positive, got -1"),
        (lambda: Shell(fallback="zero"), "shell.fallback needs shell.longest_outage, which is missing"),
        (
            lambda: Shell(jitter=0.6, longest_outage=1.0),
            "shell.jitter must be a fraction of the sample time from 0.001 to below 0.5",
        ),
        (
            lambda: Shell(fallback="baseline", longest_outage=1.0).require(
                ("x_1",), ("command",), without_baseline="needs a case with a baseline controller, but this case has none"
            ),
            "shell.fallback = 'baseline' needs a case with a baseline",
        ),
        (lambda: Shell(fallback="stop"), "shell.fallback must be hold, zero, baseline or fade, got 'stop'"),
    ],
)
def test_what_means_nothing_is_refused(make, sentence) -> None:
    with pytest.raises(InputError) as told:
        make()
    assert str(told.value).startswith(sentence)


def test_every_fault_is_found_by_its_kind() -> None:
    assert {name: kind.kind for name, kind in FAULTS.items()} == {name: name for name in FAULTS}


def test_a_check_of_a_name_that_two_channels_have_is_refused() -> None:
    shell = Shell(range={"alpha": [-1.0, 1.0]})
    shell.require(("alpha", "q"), ("command",), without_baseline=None)
    told = "shell.range.alpha is the name of several channels; give each channel a unique label"
    for names, commands in ((("alpha", "alpha"), ("command",)), (("q",), ("alpha", "alpha"))):
        assert refusal(lambda names=names, commands=commands: shell.require(names, commands, without_baseline=None)) == told
