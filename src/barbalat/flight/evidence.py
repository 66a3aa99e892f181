"""What dispersed flights are evidence of: how often control is lost, errors, and who is better than whom, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.sweeps.evidence import CONFIDENCE, Share
from barbalat.validate import Array


@dataclass(frozen=True, kw_only=True)
class Median:
    """Of a figure over all draws, a lost flight counted as infinitely bad.

    interval  exact, by order statistics: no distribution is assumed
    """

    value: float
    interval: tuple[float, float]
    confidence: float = CONFIDENCE

    @classmethod
    def of(cls, values: Array) -> Median:
        """NaN is a lost flight's."""
        from scipy.stats import binom

        found = np.sort(np.where(np.isnan(values), np.inf, values))
        count = len(found)
        below = int(binom.ppf((1 - CONFIDENCE) / 2, count, 0.5))
        # (x_(below), x_(count + 1 - below)) with places counted from 1; where below is 0 nothing bounds it
        low = float(found[below - 1]) if below > 0 else float(-np.inf)
        high = float(found[count - below]) if below > 0 else float(np.inf)
        middle = found[(count - 1) // 2], found[count // 2]
        return cls(value=float(middle[0] if middle[0] == middle[1] else (middle[0] + middle[1]) / 2), interval=(low, high))


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """On how many draws a controller had the smaller error than the other, both through the same failure; lost is worse than any.

    better  draws on which it was better, of those on which they differ: both lost says nothing;
            None where there are none
    spared  draws on which the other alone was lost, of those on which one of them was lost alone; None where there are none
    """

    other: str
    better: Share | None
    spared: Share | None

    @property
    def says(self) -> int:
        """1 where it is better beyond chance, -1 where it is worse, 0 where the interval holds one half."""
        return _says(self.better)


def _says(share: Share | None) -> int:
    if share is None:
        return 0
    low, high = share.interval
    return 1 if low > 1 / 2 else -1 if high < 1 / 2 else 0


@dataclass(frozen=True, kw_only=True)
class Flown:
    """One controller through one failure, on all draws."""

    controller: str
    lost: Share
    error: Median
    travel: Median
    pairings: tuple[Pairing, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """By failures, the controllers that lost least first, then by their error; and of all failures together.

    lost  of all flights of each controller, the fewest first: draws are independent, flights on one draw are not, so that no
          interval stands beside them
    """

    by_failure: dict[str, tuple[Flown, ...]]
    lost: dict[str, tuple[int, int]]


def evidence_of(column: Callable[[str, str, str], Array], controllers: Sequence[str], failures: Sequence[str]) -> Evidence:
    """From ``column(controller, failure, figure)``."""
    by_failure, lost = {}, dict.fromkeys(controllers, 0)
    members = len(column(controllers[0], failures[0], "lost_at"))
    for failure in failures:
        errors = {one: column(one, failure, "rms_e") for one in controllers}
        found = []
        for one in controllers:
            gone = int(np.isfinite(column(one, failure, "lost_at")).sum())
            lost[one] += gone
            found.append(
                Flown(
                    controller=one,
                    lost=Share(count=gone, judged=members),
                    error=Median.of(errors[one]),
                    travel=Median.of(column(one, failure, "travel")),
                    pairings=tuple(_paired(errors[one], other, errors[other]) for other in controllers if other != one),
                )
            )
        by_failure[failure] = tuple(sorted(found, key=lambda flown: (flown.lost.count, flown.error.value)))
    flights = members * len(failures)
    ranked = sorted(lost.items(), key=lambda item: item[1])
    return Evidence(by_failure=by_failure, lost={name: (count, flights) for name, count in ranked})


def _paired(own: Array, other: str, errors: Array) -> Pairing:
    own, errors = (np.where(np.isnan(one), np.inf, one) for one in (own, errors))
    lost, gone = np.isinf(own), np.isinf(errors)
    return Pairing(other=other, better=_share(own < errors, own != errors), spared=_share(gone & ~lost, gone != lost))


def _share(counted: Array, judged: Array) -> Share | None:
    return Share(count=int(counted.sum()), judged=int(judged.sum())) if judged.any() else None
