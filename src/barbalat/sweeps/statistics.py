"""What many runs say, with intervals that assume no distribution: shares, medians, and who is better beyond chance.

A run that failed has an infinite figure: it is one run on the worse side and no more, and nobody is left out.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from barbalat.validate import Array

CONFIDENCE_LEVEL = 0.95
"""The confidence of all intervals."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """How many of the members that could be judged; the interval is Clopper and Pearson's.

    judged  members; what is not known of a member is not counted as met
    """

    count: int
    judged: int
    confidence: float = CONFIDENCE_LEVEL

    @classmethod
    def of(cls, counted: Array, judged: Array | None = None) -> Share:
        """The share of the true values among all, or among those that are ``judged``."""
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
        """How likely a share so far from one half, or farther, is where both ways are equally likely: the exact sign test."""
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
    """A share of which some members are not settled: each of them may or may not belong to it.

    count      members of which it is settled that they do
    unsettled  members of which nothing is settled
    """

    unsettled: int = 0

    @property
    def interval(self) -> tuple[float, float]:
        """From where no unsettled member belongs to the share to where all of them do."""
        least = Share(count=self.count, judged=self.judged, confidence=self.confidence).interval
        most = Share(count=self.count + self.unsettled, judged=self.judged, confidence=self.confidence).interval
        return least[0], most[1]

    def as_json(self) -> dict[str, object]:
        did_not = self.judged - self.count - self.unsettled
        return super().as_json() | {"failed": self.count, "did_not": did_not, "not_settled": self.unsettled}


Compared = TypeVar("Compared", bound=Hashable)


def beyond_chance(shares: Mapping[Compared, Share]) -> dict[Compared, int]:
    """1 where a share is above one half beyond chance, -1 where it is below, 0 where neither is known.

    Holm's correction (Scandinavian Journal of Statistics 6, 1979) holds for however many comparisons, dependent or not: where all
    shares are one half, any is called otherwise with a probability of 1 - CONFIDENCE_LEVEL at most.
    """
    found = dict.fromkeys(shares, 0)
    for left, name in zip(range(len(shares), 0, -1), sorted(shares, key=lambda one: shares[one].chance), strict=True):
        if shares[name].chance > (1 - CONFIDENCE_LEVEL) / left:
            break
        found[name] = 1 if shares[name].share > 1 / 2 else -1
    return found


@dataclass(frozen=True, kw_only=True)
class Median:
    """The median of a figure, whose values may be infinite, with its interval.

    value     the mean of the two in the middle where their number is even; the lower one of an infinity and its opposite
    interval  from the k-th smallest to the k-th largest value, exact by the binomial distribution of how many are below
              (Conover, Practical Nonparametric Statistics, section 3.2); without an end where there are too few values for one
    """

    value: float
    interval: tuple[float, float]
    confidence: float = CONFIDENCE_LEVEL

    @classmethod
    def of(cls, values: Array) -> Median:
        """The median of these values; NaN, of a run that has no figure, counts as infinite."""
        from scipy.stats import binom

        ordered = np.sort(np.where(np.isnan(values), np.inf, values))
        count = len(ordered)
        low, high = float(ordered[(count - 1) // 2]), float(ordered[count // 2])
        k = int(binom.ppf((1 - CONFIDENCE_LEVEL) / 2, count, 0.5))  # fewer than k below the median: less likely than that
        return cls(
            value=low if np.isneginf(low) else (low + high) / 2,
            interval=(float(ordered[k - 1]), float(ordered[-k])) if k else (-np.inf, np.inf),
        )
