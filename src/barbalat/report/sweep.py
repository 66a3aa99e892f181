"""A sweep as rows of tables, for the page and for the terminal."""

from __future__ import annotations

import re
from dataclasses import dataclass

from barbalat import validate
from barbalat.pictures.numbers import number_text
from barbalat.sweeps.evidence import FINDINGS, VERDICTS
from barbalat.sweeps.result import SweepResult
from barbalat.sweeps.spread import InBall
from barbalat.sweeps.statistics import Share, SplitShare
from barbalat.sweeps.study import OSCILLATED

SHOWN = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "max_abs_y", "diverged_at")
"""Figures, without their components; the others are in the JSON and in a store."""


@dataclass(frozen=True, kw_only=True)
class WorstMember:
    """A controller's worst member by a figure: the ``file`` of a page that simulates it, or the reason why there is none."""

    controller: str
    figure: str
    member: int
    file: str | None = None
    why: str = ""


def varied(found: SweepResult) -> list[tuple[str, str]]:
    """What varies, and how; entries of a vector that is drawn from a ball once, together."""
    rows = [(str(path), f"over {axis}") for path, axis in found.plan.axes.items()]
    for path, drawn in found.plan.draws.items():
        if not isinstance(drawn, InBall):
            rows.append((str(path), f"from {drawn}"))
        elif drawn.place == 0:
            vector = str(path).split("[", 1)[0]
            rows.append((vector, f"evenly in the ball of radius {drawn.radius:g} around {validate.show(drawn.center)}"))
    return rows


def shares(found: SweepResult) -> list[list[str]]:
    """What is judged, the controller, how many members, their share, the ends of its interval; then who can't be judged."""
    rows = [
        [
            _judged(name),
            controller,
            f"{share.count} of {share.judged}{_unsettled(share)}",
            *map(percent, (share.share, *share.interval)),
        ]
        for name, by in sorted(found.evidence.shares.items(), key=lambda one: one[0] not in VERDICTS)
        for controller, share in by.items()
    ]
    return rows + [
        [_judged(OSCILLATED), one, f"not examined: {why}", "-", "-", "-"] for one, why in found.evidence.unexamined.items()
    ]


def _unsettled(share: Share) -> str:
    """How many members may belong to it besides."""
    unsettled = share.unsettled if isinstance(share, SplitShare) else 0
    return f", {unsettled} not settled" if unsettled else ""


def _judged(name: str) -> str:
    if name == OSCILLATED:
        return "estimates oscillated"
    return name if name in FINDINGS else f"broke {name}"


def extremes(found: SweepResult) -> list[list[str]]:
    """Figure, controller, least, median, largest, worst member."""
    return [
        [name, controller, *map(number_text, (one.min, one.median, one.max)), str(one.worst_member)]
        for name, by in found.evidence.metrics.items()
        if name.split("[")[0] in SHOWN
        for controller, one in by.items()
    ]


SYMBOLS = {
    "tail_max_abs_e": "max |e{}|, tail",
    "max_abs_e": "max |e{}|",
    "rms_e": "RMS e{}",
    "max_abs_u": "max |u{}|",
    "max_abs_y": "max |y|",
    "diverged_at": "diverged at [s]",
}
"""Of figures' names in the JSON, as they are written for people; the longer name before one that is part of it."""


def in_symbols(text: str) -> str:
    """A figure's name, or a requirement with one, in the notation of terminals, which pages set as mathematics."""

    def symbol(found: re.Match[str]) -> str:
        return SYMBOLS[found["name"]].format("" if found["index"] is None else f"_{int(found['index']) + 1}")

    return re.sub(rf"\b(?P<name>{'|'.join(SYMBOLS)})\b(?:\[(?P<index>\d+)\])?", symbol, text)


def percent(share: float) -> str:
    """A share in per cent, with three digits."""
    return f"{100 * share:.3g} %"
