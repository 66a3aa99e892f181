"""Statistics of many runs, with intervals that assume no distribution: fractions, medians and significant differences.

A failed run has an infinite metric: it counts as a run on the worse side and is never excluded.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from barbalat.validate import Array

CONFIDENCE_LEVEL = 0.95
"""The confidence level of all intervals."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A fraction of the members that could be judged; the interval is that of Clopper and Pearson.

    judged  number of members judged; unknown verdicts are not counted as met
    """

    count: int
    judged: int
    confidence: float = CONFIDENCE_LEVEL

    @classmethod
    def of(cls, counted: Array, judged: Array | None = None) -> Share:
        """The fraction of true values among all values, or among the ``judged`` values."""
        return cls(count=int(counted.sum()), judged=len(counted) if judged is None else int(judged.sum()))

    @property
    def share(self) -> float:
        return self.count / self.judged

    @property
    def interval(self) -> tuple[float, float]:
        from scipy.stats import binomtest

        found = binomtest(self.count, self.judged).proportion_ci(self.confidence, method="exact")
        return float(found.low), float(found.high)

    @property
    def chance(self) -> float:
        """The probability of a fraction at least this far from one half if both outcomes are equally likely: the exact sign
        test."""
        from scipy.stats import binomtest

        return float(binomtest(self.count, self.judged).pvalue)

    def as_json(self) -> dict[str, object]:
        return {
            "count": self.count,
            "share": self.share,
            "interval": list(self.interval),
            "confidence": self.confidence,
            "judged": self.judged,
        }


@dataclass(frozen=True, kw_only=True)
class SplitShare(Share):
    """A fraction with unsettled members, each of which may or may not count.

    count      number of counted members with a settled verdict
    unsettled  number of members without a settled verdict
    """

    unsettled: int = 0

    @property
    def interval(self) -> tuple[float, float]:
        """The interval from the case in which no unsettled member counts to the case in which all of them count."""
        least = Share(count=self.count, judged=self.judged, confidence=self.confidence).interval
        most = Share(count=self.count + self.unsettled, judged=self.judged, confidence=self.confidence).interval
        return least[0], most[1]

    def as_json(self) -> dict[str, object]:
        did_not = self.judged - self.count - self.unsettled
        return super().as_json() | {"failed": self.count, "did_not": did_not, "not_settled": self.unsettled}


Compared = TypeVar("Compared", bound=Hashable)


def beyond_chance(shares: Mapping[Compared, Share]) -> dict[Compared, int]:
    """For each fraction, 1 if it is significantly above one half, -1 if it is significantly below, 0 otherwise.

    Holm's correction (Scandinavian Journal of Statistics 6, 1979) is valid for any number of comparisons, dependent or not. If
    all fractions are one half, the probability that any of them is reported as different is at most 1 - CONFIDENCE_LEVEL.
    """
    found = dict.fromkeys(shares, 0)
    for left, name in zip(range(len(shares), 0, -1), sorted(shares, key=lambda one: shares[one].chance), strict=True):
        if shares[name].chance > (1 - CONFIDENCE_LEVEL) / left:
            break
        found[name] = 1 if shares[name].share > 1 / 2 else -1
    return found


@dataclass(frozen=True, kw_only=True)
class Median:
    """The median of a metric, whose values may be infinite, with its interval.

    value     the mean of the two middle values if the number of values is even; the lower of the two if they are infinities of
              opposite sign
    interval  from the k-th smallest to the k-th largest value, exact by the binomial distribution of the number of values below
              (Conover, Practical Nonparametric Statistics, section 3.2); an end is missing if there are too few values
    """

    value: float
    interval: tuple[float, float]
    confidence: float = CONFIDENCE_LEVEL

    @classmethod
    def of(cls, values: Array) -> Median:
        """The median of these values; NaN, for a run without the metric, counts as infinite."""
        from scipy.stats import binom

        ordered = np.sort(np.where(np.isnan(values), np.inf, values))
        count = len(ordered)
        low, high = float(ordered[(count - 1) // 2]), float(ordered[count // 2])
        k = int(
            binom.ppf((1 - CONFIDENCE_LEVEL) / 2, count, 0.5)
        )  # the probability of fewer than k values below the median is smaller than the allowed one
        return cls(
            value=low if np.isneginf(low) else (low + high) / 2,
            interval=(float(ordered[k - 1]), float(ordered[-k])) if k else (-np.inf, np.inf),
        )
