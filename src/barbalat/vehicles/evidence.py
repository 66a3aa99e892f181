"""What dispersed flights are evidence of: how often control is lost, errors, and who is better than whom, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from barbalat.sweeps.statistics import Median, Share, beyond_chance
from barbalat.validate import Array


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """A controller beside another, both through the same failure on the same draws; a lost flight is worse than any other.

    better   draws on which it had the smaller error, of those on which they differ: both lost says nothing;
             None where there are none
    spared   draws on which the other alone was lost, of those on which one of them was lost alone; None where there are none
    follows  1 where its error is less beyond chance, -1 where it is more, else 0, all comparisons together
    keeps    the same of its losses: 1 where they are fewer
    """

    other: str
    better: Share | None
    spared: Share | None
    follows: int
    keeps: int


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

    lost         of all flights of each controller, the fewest first: draws are independent, flights on one draw are not, so that
                 no interval stands beside them
    comparisons  of two controllers through one failure by error or by losses that some draw decides, which share one confidence
    """

    by_failure: dict[str, tuple[Flown, ...]]
    lost: dict[str, tuple[int, int]]
    comparisons: int


ERROR, LOSS = "error", "loss"


def evidence_of(column: Callable[[str, str, str], Array], controllers: Sequence[str], failures: Sequence[str]) -> Evidence:
    """From ``column(controller, failure, figure)``."""
    errors = {(failure, one): column(one, failure, "rms_e") for failure in failures for one in controllers}
    gone = {(failure, one): int(np.isfinite(column(one, failure, "lost_at")).sum()) for failure, one in errors}
    shares = {
        (failure, *pair, by): share
        for failure in failures
        for pair in combinations(controllers, 2)
        for by, share in _shares(*(errors[failure, one] for one in pair)).items()
        if share is not None
    }
    signs = beyond_chance(shares)
    signs |= {(failure, other, one, by): -sign for (failure, one, other, by), sign in signs.items()}

    def paired(failure: str, one: str, other: str) -> Pairing:
        found = _shares(errors[failure, one], errors[failure, other])
        follows, keeps = (signs.get((failure, one, other, by), 0) for by in (ERROR, LOSS))
        return Pairing(other=other, better=found[ERROR], spared=found[LOSS], follows=follows, keeps=keeps)

    members = len(next(iter(errors.values())))
    by_failure = {}
    for failure in failures:
        found = [
            Flown(
                controller=one,
                lost=Share(count=gone[failure, one], judged=members),
                error=Median.of(errors[failure, one]),
                travel=Median.of(column(one, failure, "travel")),
                pairings=tuple(paired(failure, one, other) for other in controllers if other != one),
            )
            for one in controllers
        ]
        by_failure[failure] = tuple(sorted(found, key=lambda flown: (flown.lost.count, flown.error.value)))
    lost = {one: sum(gone[failure, one] for failure in failures) for one in controllers}
    ranked = sorted(lost.items(), key=lambda item: item[1])
    flights = members * len(failures)
    counted = {name: (count, flights) for name, count in ranked}
    return Evidence(by_failure=by_failure, lost=counted, comparisons=len(shares))


def _shares(own: Array, errors: Array) -> dict[str, Share | None]:
    own, errors = (np.where(np.isnan(one), np.inf, one) for one in (own, errors))
    lost, gone = np.isinf(own), np.isinf(errors)
    return {ERROR: _share(own < errors, own != errors), LOSS: _share(gone & ~lost, gone != lost)}


def _share(counted: Array, judged: Array) -> Share | None:
    return Share.of(counted, judged) if judged.any() else None
