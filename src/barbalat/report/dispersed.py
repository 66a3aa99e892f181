"""Dispersed flights as rows of tables, sentences and a document, for the page, the terminal and ``--json``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from importlib import metadata
from typing import Any

import barbalat
from barbalat.flight.dispersed import KEPT, TIMING, DispersedComparison
from barbalat.flight.dispersions import DRAWN, UNITS
from barbalat.flight.evidence import Flown, Median, Pairing
from barbalat.flight.schemes import TUNED
from barbalat.sweeps.evidence import CONFIDENCE_LEVEL, Share

LARGE = 9.995
BESIDE = "LQR with PI"
"""What all are paired with, where it flies: the simplest of those that restore a trim."""
RULE = (
    "one rule for all (benchmarks/flight_tuning.py): least RMS error on the linearised aircraft with a delay margin of 0.1 s and "
    "a gain margin of 2"
)
HEADINGS = ("controller", "lost", "of 100\nat 95 %", "median\nRMS e", "at 95 %", "less\nthan PI", "surface\n[deg/s]")
NOTES = (
    "Lost: how many draws were lost, and the share of all draws that this is evidence of, by Clopper and Pearson's interval",
    "a lost flight counts as an infinite error in the median, whose interval is that of order statistics; fewer than six draws "
    "bound none",
    f"less than PI: on how many of 100 draws the error is smaller than that of {BESIDE}, of those that not both lost; + and - "
    "stand where that is beyond chance",
)


def notes(found: DispersedComparison) -> tuple[str, ...]:
    """How the tables are to be read."""
    chance = (
        "beyond chance: all flew the same draws, so that pairs are judged by the exact sign test, each two controllers through "
        f"each failure by error and by losses; of all {found.evidence.comparisons} such comparisons that some draw decides, none "
        f"is called so by chance with a probability of {100 * CONFIDENCE_LEVEL:.0f} %, by Holm's correction"
    )
    return (*NOTES, chance) if found.evidence.comparisons else NOTES


def rows(found: DispersedComparison, failure: str) -> list[list[str]]:
    """All controllers through one failure: fewest losses first, then the least error."""
    return [
        [
            one.controller,
            str(one.lost.count),
            _interval(100 * end for end in one.lost.interval),
            _number(one.error.value),
            _bounds(one.error),
            _paired(one),
            _number(one.travel.value),
        ]
        for one in found.evidence.by_failure[failure]
    ]


def _paired(one: Flown) -> str:
    pairing = _against(one, BESIDE)
    if pairing is None or pairing.better is None:
        return "-"
    return f"{100 * pairing.better.share:.0f}{ {1: ' +', 0: '', -1: ' -'}[pairing.follows] }"


def _against(one: Flown, other: str) -> Pairing | None:
    return next((pairing for pairing in one.pairings if pairing.other == other), None)


def _interval(ends: Iterable[float], digits: int = 0) -> str:
    low, high = ends
    return f"{_number(low, digits)} to {_number(high, digits)}"


def _bounds(one: Median) -> str:
    """Where the draws are too few to bound a median, a dash."""
    return _interval(one.interval, 2) if one.interval[0] > -math.inf else "-"


def _number(value: float, digits: int = 2) -> str:
    """So many digits after the point, one less where two stand before it."""
    return f"{value:.{max(digits - (value >= LARGE), 0)}f}" if math.isfinite(value) else "lost"


def losses(found: DispersedComparison) -> list[list[str]]:
    """Controller, and of all its flights those lost, in all and through each failure."""
    counted = {one: dict.fromkeys(found.evidence.by_failure, 0) for one in found.evidence.lost}
    for failure, several in found.evidence.by_failure.items():
        for flown in several:
            counted[flown.controller][failure] = flown.lost.count
    return [[name, str(found.evidence.lost[name][0]), *map(str, counted[name].values())] for name in found.evidence.lost]


def loss_headings(found: DispersedComparison) -> tuple[str, ...]:
    """Of ``losses``."""
    return ("controller", "all", *found.evidence.by_failure)


def verdicts(found: DispersedComparison) -> list[str]:
    """For each failure who loses least, and who is better and worse than the PI beyond chance, by losses and by error."""
    said = []
    for failure, several in found.evidence.by_failure.items():
        least = several[0].lost.count
        if least == found.members:
            said.append(f"{failure}: all lose every flight")
            continue
        fewest = [one.controller for one in several if one.lost.count == least]
        many = "all" if len(fewest) == len(several) else _listed(fewest)
        parts = [f"{failure}: fewest losses, {least} of {found.members}: {many}; least error: {_least(several)}"]
        pairs = {one.controller: pair for one in several if (pair := _against(one, BESIDE)) is not None}
        signs = {
            ("fewer losses", "more losses"): {name: pair.keeps for name, pair in pairs.items()},
            ("less error", "more error"): {name: pair.follows for name, pair in pairs.items()},
        }
        for words, by in signs.items():
            for word, sign in zip(words, (1, -1), strict=True):
                names = [name for name, one in by.items() if one == sign]
                parts += [f"{word} than {BESIDE} beyond chance: {_listed(names)}"] if names else []
        said.append("; ".join(parts))
    return said


def _listed(names: Sequence[str]) -> str:
    """With commas between them and none within."""
    return ", ".join(name.replace(",", "") for name in names)


def _least(several: tuple[Flown, ...]) -> str:
    """By the median, with those whose paired difference from it may be chance."""
    best = min(several, key=lambda one: one.error.value)
    alike = [pairing.other for pairing in best.pairings if pairing.follows != 1]
    return best.controller + (f" (not beyond chance against {_listed(alike)})" if alike else "")


def facts(found: DispersedComparison) -> list[tuple[str, str]]:
    """What was drawn, where it flies, how it was set."""
    draws = ", ".join(f"{name.replace('_', ' ')} {one.low:g} to {one.high:g}{UNITS.get(name, '')}" for name, one in DRAWN.items())
    conditions = "; ".join(str(axis.trim.condition) for axis in found.campaign.axes)
    flown = f"{found.members} draws by seed {found.campaign.plan.seed}, taking turns at {conditions}"
    return [
        ("flown", f"{flown}; {TIMING.duration:g} s each, the failure at {TIMING.fails_at:g} s"),
        ("drawn", f"uniformly: {draws}"),
        ("set by", RULE),
    ]


def as_document(found: DispersedComparison) -> dict[str, Any]:
    """The document of ``fly --dispersions --json``: all that the tables say, and what it follows from."""
    identity = found.campaign.identity()
    return {
        "flight": found.campaign.name,
        "members": found.members,
        "resumed": found.resumed,
        "plan": identity["plan"],
        "equations": identity["equations"],
        "conditions": [str(axis.trim.condition) for axis in found.campaign.axes],
        "timing": vars(TIMING),
        "numbers": TUNED[found.campaign.name],
        "versions": {"barbalat": barbalat.__version__} | {name: metadata.version(name) for name in ("jsbsim", "numpy", "scipy")},
        "figures": list(KEPT),
        "first_draw": {name: value if math.isfinite(value) else None for name, value in found.rows.row(0).items()},
        "lost": {name: {"count": count, "flights": flights} for name, (count, flights) in found.evidence.lost.items()},
        "failures": {
            failure: {one.controller: _as_json(one) for one in several} for failure, several in found.evidence.by_failure.items()
        },
    }


def _as_json(one: Flown) -> dict[str, Any]:
    return {
        "lost": one.lost.as_json(),
        "rms_e": _median(one.error),
        "travel": _median(one.travel),
        "less_error_than": {pairing.other: _share(pairing.better) for pairing in one.pairings},
        "kept_where_lost": {pairing.other: _share(pairing.spared) for pairing in one.pairings},
    }


def _median(one: Median) -> dict[str, Any]:
    ends = [value if math.isfinite(value) else None for value in one.interval]
    return {"median": one.value if math.isfinite(one.value) else None, "interval": ends, "confidence": one.confidence}


def _share(one: Share | None) -> dict[str, Any] | None:
    return None if one is None else {"count": one.count, "judged": one.judged, "interval": list(one.interval)}
