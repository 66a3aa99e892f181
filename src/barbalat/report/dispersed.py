"""Dispersed flights as rows of tables, sentences and a document, for the page, the terminal and ``--json``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from typing import Any

import barbalat
from barbalat.report.terminal.layout import Screen
from barbalat.sweeps.spread import Uniform
from barbalat.sweeps.statistics import CONFIDENCE_LEVEL, Median, Share
from barbalat.validate import counted
from barbalat.vehicles.dispersed import KEPT, DispersedComparison, Flown, Pairing
from barbalat.vehicles.vehicle import Vehicle

LARGE = 9.995
NOTES = (
    "lost: the number of lost draws, and the Clopper-Pearson interval of the probability of loss",
    "a lost flight counts as an infinite error in the median; the interval of the median is obtained from order statistics and "
    "needs at least six draws",
)


def headings(found: DispersedComparison) -> tuple[str, ...]:
    """The headings of the table of ``rows``."""
    vehicle = found.campaign.vehicle
    (travel, moved), (_, short) = vehicle.drawing.travel, vehicle.drawing.beside
    unit, error = vehicle.units[travel], f"RMS e\n[{vehicle.units['rms_e']}]"
    return ("controller", "lost", "of 100\nat 95 %", error, "at 95 %", f"less\nthan {short}", f"{moved}\n[{unit}]")


def notes(found: DispersedComparison) -> tuple[str, ...]:
    """Return sentences that explain the tables."""
    chance = (
        f"beyond chance: all controllers flew the same draws, so an exact sign test compares the errors and the losses of each "
        f"pair of them in each failure case. With Holm's correction over all {found.evidence.comparisons} comparisons that at "
        f"least one draw decides, the probability that no result is due to chance is {100 * CONFIDENCE_LEVEL:.0f} %"
    )
    name, short = found.campaign.vehicle.drawing.beside
    less = (
        f"less than {short}: among the draws not lost by both, the percentage with a smaller error than {name}; + and "
        f"- mark results beyond chance"
    )
    travel = f"RMS e and the travel per second (column {found.campaign.vehicle.drawing.travel[1]}) are medians of all draws"
    told = (*NOTES, travel, less)
    return (*told, chance) if found.evidence.comparisons else told


def rows(found: DispersedComparison, failure: str) -> list[list[str]]:
    """Return a row for each controller with one failure, sorted first by losses and then by error."""
    return [
        [
            one.controller,
            str(one.lost.count),
            _interval(100 * end for end in one.lost.interval),
            _number(one.error.value),
            _bounds(one.error),
            _paired(one, found.campaign.vehicle.drawing.beside[0]),
            _number(one.travel.value),
        ]
        for one in found.evidence.by_failure[failure]
    ]


def _paired(one: Flown, beside: str) -> str:
    pairing = _against(one, beside)
    if pairing is None or pairing.better is None:
        return "-"
    return f"{100 * pairing.better.share:.0f}{ {1: ' +', 0: '', -1: ' -'}[pairing.follows] }"


def _against(one: Flown, other: str) -> Pairing | None:
    return next((pairing for pairing in one.pairings if pairing.other == other), None)


def _interval(ends: Iterable[float], digits: int = 0) -> str:
    low, high = ends
    return f"{_number(low, digits)} to {_number(high, digits)}"


def _bounds(one: Median) -> str:
    """The bounds of a median, or a dash if there are too few draws."""
    return _interval(one.interval, 2) if one.interval[0] > -math.inf else "-"


def _number(value: float, digits: int = 2) -> str:
    """A number with ``digits`` decimals, one fewer if two digits precede the point."""
    return f"{value:.{max(digits - (value >= LARGE), 0)}f}" if math.isfinite(value) else "lost"


def losses(found: DispersedComparison) -> list[list[str]]:
    """Return a row for each controller: the number of lost flights, in total and for each failure."""
    counted = {one: dict.fromkeys(found.evidence.by_failure, 0) for one in found.evidence.lost}
    for failure, several in found.evidence.by_failure.items():
        for flown in several:
            counted[flown.controller][failure] = flown.lost.count
    return [[name, str(found.evidence.lost[name][0]), *map(str, counted[name].values())] for name in found.evidence.lost]


def loss_headings(found: DispersedComparison) -> tuple[str, ...]:
    """The headings of the table of ``losses``."""
    return ("controller", "all", *found.evidence.by_failure)


def verdicts(found: DispersedComparison) -> list[str]:
    """Return a sentence for each failure: the controller with the fewest losses, and the controllers that are significantly
    better or worse than the reference controller of the vehicle, by losses and by error."""
    said, beside = [], found.campaign.vehicle.drawing.beside[0]
    for failure, several in found.evidence.by_failure.items():
        least = several[0].lost.count
        if least == found.members:
            said.append(f"{failure}: all lose every flight")
            continue
        fewest = [one.controller for one in several if one.lost.count == least]
        many = "all" if len(fewest) == len(several) else _listed(fewest)
        parts = [f"{failure}: fewest losses, {least} of {found.members}: {many}; smallest error: {_least(several)}"]
        pairs = {one.controller: pair for one in several if (pair := _against(one, beside)) is not None}
        signs = {
            ("fewer losses", "more losses"): {name: pair.keeps for name, pair in pairs.items()},
            ("less error", "more error"): {name: pair.follows for name, pair in pairs.items()},
        }
        for words, by in signs.items():
            for word, sign in zip(words, (1, -1), strict=True):
                names = [name for name, one in by.items() if one == sign]
                parts += [f"{word} than {beside} beyond chance: {_listed(names)}"] if names else []
        said.append("; ".join(parts))
    return said


def _listed(names: Sequence[str]) -> str:
    """The names separated by commas. Commas within a name are removed."""
    return ", ".join(name.replace(",", "") for name in names)


def _least(several: tuple[Flown, ...]) -> str:
    """Return the controller with the smallest median error, and those whose paired difference from it may be due to chance."""
    best = min(several, key=lambda one: one.error.value)
    alike = [pairing.other for pairing in best.pairings if pairing.follows != 1]
    return best.controller + (f" (not beyond chance against {_listed(alike)})" if alike else "")


def facts(found: DispersedComparison) -> list[tuple[str, str]]:
    """Return labelled facts: the draws, the flight condition and the settings."""
    drawing, conditions = found.campaign.vehicle.drawing, found.campaign.conditions
    draws = ", ".join(_range(name, one, drawing.units.get(name, "")) for name, one in drawing.drawn.items())
    where = f"alternately at {'; '.join(conditions)}" if len(conditions) > 1 else conditions[0]
    timing = f"{drawing.timing.duration:g} s each, with the failure at {drawing.timing.fails_at:g} s"
    return [
        ("flown", f"{counted(found.members, 'draw')} with seed {found.campaign.plan.seed}, {where}; {timing}"),
        ("drawn", f"uniformly: {draws}"),
        ("set by", drawing.set_by),
    ]


def _range(name: str, one: Uniform, unit: str) -> str:
    return f"{name.replace('_', ' ')} {one.low:g} to {one.high:g}{unit and ' '}{unit}"


def as_document(found: DispersedComparison) -> dict[str, Any]:
    """The document of ``fly --dispersions --json``: everything in the tables, and where it comes from."""
    identity, vehicle = found.campaign.identity(), found.campaign.vehicle
    travel, _ = vehicle.drawing.travel
    packages = (vehicle.simulator, "numpy", "scipy")
    return {
        "flight": found.campaign.name,
        "members": found.members,
        "resumed": found.resumed,
        "plan": identity["plan"],
        "equations": identity["equations"],
        "conditions": list(found.campaign.conditions),
        "timing": asdict(vehicle.drawing.timing),
        "numbers": _numbers(vehicle),
        "versions": {"barbalat": barbalat.__version__} | {name: metadata.version(name) for name in packages},
        "units": {name: vehicle.units[of] for name, of in (("rms_e", "rms_e"), ("max_abs_e", "max_abs_e"), ("travel", travel))},
        "figures": list(KEPT),
        "first_draw": {name: value if math.isfinite(value) else None for name, value in found.rows.row(0).items()},
        "lost": {name: {"count": count, "flights": flights} for name, (count, flights) in found.evidence.lost.items()},
        "failures": {
            failure: {one.controller: _as_json(one) for one in several} for failure, several in found.evidence.by_failure.items()
        },
    }


def _numbers(vehicle: Vehicle[Any, Any, Any]) -> Mapping[str, object]:
    """The tuned parameters of the schemes, grouped by the loops on which they were found if there are several."""
    return next(iter(vehicle.numbers.values())) if len(vehicle.numbers) == 1 else vehicle.numbers


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


def show(screen: Screen, found: DispersedComparison) -> None:
    """Print the campaign, beginning with the losses."""
    screen.line(f"{found.campaign.name} on {counted(found.members, 'random vehicle')}", "bold")
    for label, text in facts(found):
        screen.fact(label, text, 8)
    screen.line("")
    lost = [[screen.name(name), *cells] for name, *cells in losses(found)]
    screen.table(loss_headings(found), lost)
    screen.line("")
    for verdict in verdicts(found):
        screen.line(f"{verdict}.", indent="    ", start="  ")
    for failure in found.campaign.failures:
        screen.title(f"{failure.name}: {failure.meaning}")
        body = [[screen.name(name), *cells] for name, *cells in rows(found, failure.name)]
        screen.table(headings(found), body)
    screen.line("")
    for note in notes(found):
        screen.line(f"Note: {note}.")
