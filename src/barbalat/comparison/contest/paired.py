"""Two entrants on the same plants, commands and noise: the ratio of their errors, with intervals that no failure upsets.

The median of the ratios and its interval are of order statistics, so that a run that failed, whose error is infinite, is one run
on the worse side and no more; nobody is left out. Interval of the median: exact, by the binomial distribution of how many lie
below it (Conover, Practical Nonparametric Statistics, section 3.2). Share in which the one is
better: Clopper and Pearson's interval. Plants and noise are independent draws and the commands a fixed set with equally many
plants each: the number below a value is then a sum of independent draws of unequal chances, of which a binomial interval covers
at least as often (Hoeffding, 1956).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.comparison.contest.held_out import HeldOut, median
from barbalat.sweeps.evidence import CONFIDENCE_LEVEL, Share
from barbalat.validate import Array


@dataclass(frozen=True, kw_only=True)
class Paired:
    """The first against the second.

    ratio     median of the first's error over the second's; infinite or 0 where half of the runs failed on one side alone
    interval  of the ratio
    better, worse  share of the runs in which the first has the smaller, or the larger, error; with a run that failed on one side
    both_failed    runs, which are neither
    """

    first: str
    second: str
    ratio: float
    interval: tuple[float, float]
    better: Share
    worse: Share
    both_failed: int

    @property
    def settled(self) -> bool:
        """Whether the interval lies to one side of 1."""
        return self.interval[1] < 1 or self.interval[0] > 1

    def as_json(self) -> dict[str, object]:
        low, high = self.interval
        return {
            "first": self.first,
            "second": self.second,
            "ratio": finite(self.ratio),
            "interval": [finite(low), finite(high)],
            "confidence": CONFIDENCE_LEVEL,
            "better": self.better.as_json(),
            "worse": self.worse.as_json(),
            "both_failed": self.both_failed,
        }


def paired(first: tuple[str, HeldOut], second: tuple[str, HeldOut]) -> Paired:
    """Of the same trials."""
    (one, a), (other, b) = first, second
    ratios = log_ratios(a.error, b.error)
    low, high = interval_of_median(ratios)
    count = len(ratios)
    return Paired(
        first=one,
        second=other,
        ratio=float(np.exp(median(ratios))),
        interval=(float(np.exp(low)), float(np.exp(high))),
        better=Share(count=int((ratios < 0).sum()), judged=count),
        worse=Share(count=int((ratios > 0).sum()), judged=count),
        both_failed=int((np.isinf(a.error) & np.isinf(b.error)).sum()),
    )


def log_ratios(a: Array, b: Array) -> Array:
    """(M,) log(a/b); 0 where both failed, infinite where one did."""
    both = np.isinf(a) & np.isinf(b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(both, 0.0, np.log(a) - np.log(b))


def interval_of_median(values: Array, confidence: float = CONFIDENCE_LEVEL) -> tuple[float, float]:
    """Two-sided: from the k-th smallest to the k-th largest; without an end where there are too few values for one."""
    from scipy.stats import binom

    ordered = np.sort(values)
    k = int(binom.ppf((1 - confidence) / 2, len(ordered), 0.5))  # fewer than k below the median: less likely than that
    return (float(ordered[k - 1]), float(ordered[-k])) if k else (-np.inf, np.inf)
