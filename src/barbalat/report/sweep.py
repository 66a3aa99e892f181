"""A sweep as rows of tables, for the page and for the terminal."""

from __future__ import annotations

import re
from dataclasses import dataclass

from barbalat import validate
from barbalat.open_numbers.path import by_label
from barbalat.pictures.symbols import number_text
from barbalat.problem.labels import Labels
from barbalat.report.terminal.layout import Screen, grouped
from barbalat.sweeps.evidence import DIVERGED, DIVERGES, EXAMINED, FINDINGS, RING, VERDICTS
from barbalat.sweeps.result import SweepResult
from barbalat.sweeps.spread import InBall
from barbalat.sweeps.statistics import Share, SplitShare
from barbalat.sweeps.study import OSCILLATED
from barbalat.validate import counted

SHOWN = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "max_abs_y", "diverged_at")
"""Names of the displayed metrics, without component numbers. The other metrics are in the JSON and in a store."""


@dataclass(frozen=True, kw_only=True)
class WorstMember:
    """The worst member of a controller by a metric, with the ``file`` of its explorer or the reason why there is none."""

    controller: str
    figure: str
    member: int
    file: str | None = None
    why: str = ""


def varied(found: SweepResult) -> list[tuple[str, str]]:
    """Return what varies, and how. The entries of a vector that is drawn from a ball are one row."""
    rows = [(str(path), f"over {axis}") for path, axis in found.plan.axes.items()]
    for path, drawn in found.plan.draws.items():
        if not isinstance(drawn, InBall):
            rows.append((str(path), f"from {drawn}"))
        elif drawn.place == 0:
            vector = str(path).split("[", 1)[0]
            rows.append((vector, f"evenly in the ball of radius {drawn.radius:g} around {validate.show(drawn.center)}"))
    return rows


def shares(found: SweepResult) -> list[list[str]]:
    """Return rows with the judged property, the controller, the number of members, their fraction and its interval."""
    own = [one for one in found.evidence.shares.items() if not found.judged or one[0] not in (DIVERGED, OSCILLATED)]
    return [
        [
            _judged(name),
            controller,
            f"{share.count} of {share.judged}{_unsettled(share)}",
            "-" if isinstance(share, SplitShare) and share.unsettled == share.judged else percent(share.share),
            *map(percent, share.interval),
        ]
        for name, by in sorted(own, key=lambda one: one[0] not in VERDICTS)
        for controller, share in by.items()
    ]


def _unsettled(share: Share) -> str:
    """A text with the number of unsettled members, which may belong to the fraction too."""
    unsettled = share.unsettled if isinstance(share, SplitShare) else 0
    return f", {unsettled} not settled" if unsettled else ""


def _judged(name: str) -> str:
    if name == OSCILLATED:
        return RING
    return name if name in FINDINGS else f"broke {name}"


def meanings(found: SweepResult) -> list[str]:
    """Return sentences, without full stops, that explain the names of the fractions."""
    unexamined = found.evidence.unexamined.items()
    lacking = [f"Whether the estimates of {one} oscillate is not examined: {why}" for one, why in unexamined]
    if not found.judged:
        return [f"Diverged: {DIVERGES}", f"Estimates oscillate, at this step: {EXAMINED}", *lacking]
    return [
        "Lost: diverged, or a component exceeded its limit, by default 100 times its scale (normally the largest motion of the "
        "model). Limit cycle: the control oscillates permanently. Off: the error in the tail is outside its band, by default 5 "
        "% of the scale. The table [judge] sets limits and bands",
        "Not settled: no step within the budget shows whether the plant or the solver causes the verdict; the intervals allow "
        "either verdict for these members",
        *(f"Not settled of {name}: {why}" for name, why in found.unsettled.items()),
        *lacking,
    ]


def extremes(found: SweepResult) -> list[list[str]]:
    """Return rows with the metric, the controller, the smallest, median and largest value, and the worst member."""
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
"""Names of metrics in the JSON and their displayed form. A longer name precedes the names that it contains."""


def in_symbols(text: str) -> str:
    """Return the text with names of metrics in the notation of terminals, which pages set as mathematics."""

    def symbol(found: re.Match[str]) -> str:
        return SYMBOLS[found["name"]].format("" if found["index"] is None else f"_{int(found['index']) + 1}")

    return re.sub(rf"\b(?P<name>{'|'.join(SYMBOLS)})\b(?:\[(?P<index>\d+)\])?", symbol, text)


def percent(share: float) -> str:
    """Format a fraction in per cent with three digits."""
    return f"{100 * share:.3g} %"


def show(screen: Screen, found: SweepResult, labels: Labels | None) -> None:
    """Print fractions with their intervals, extremes with the member to examine, and how the numbers were obtained.

    State labels of the case replace the indices of errors.
    """
    screen.line(f"{found.case}: {counted(len(found), 'member')} over {', '.join(map(str, found.plan.paths))}", "bold")
    for note in found.redesign_notes:
        screen.line(f"{note[0].upper()}{note[1:]}.", "yellow")
    for name, sentence in found.sentences.items():
        screen.line(f"{screen.name(name)}: {sentence}", indent="  ")
    screen.line("")
    lost = [
        [by_label(name, labels), screen.name(who), *cells, _interval(low, high)] for name, who, *cells, low, high in shares(found)
    ]
    screen.table(("", "controller", "members", "share", "95 % interval"), grouped(lost), leads=2)
    for note in meanings(found):
        screen.line(f"{note}.")
    for sentence in found.audit.sentences:
        screen.line(f"Audit: {sentence}.", "yellow" if found.audit.changed != 0 else "")
    screen.line("")
    reached = [[by_label(name, labels), screen.name(who), *cells] for name, who, *cells in extremes(found)]
    screen.table(("figure", "controller", "smallest", "median", "largest", "worst member"), grouped(reached), leads=2)
    for controller, part in found.evidence.filled.items():
        screen.line(
            f"{controller}: the largest |e| of a member reaches {percent(part.median)} of the guaranteed bound in the median, "
            f"and at most {percent(part.max)}"
        )
    told = [one for one in found.evidence.sensitivities if one.figure.startswith("max_abs_e") and one.low > 0]
    told.sort(key=lambda one: (found.controllers.index(one.controller), one.figure, -one.first))
    explained = [
        [
            by_label(one.figure, labels),
            screen.name(one.controller),
            str(one.path),
            percent(one.first),
            "exact" if one.low == one.high else f"{percent(one.low)} to {percent(one.high)}",
        ]
        for one in told
    ]
    screen.line("")
    screen.table(("variance of", "controller", "due to", "share", "95 % interval"), grouped(explained), leads=3)
    for how in dict.fromkeys(one.estimator for one in found.evidence.sensitivities):
        screen.line(f"Fractions of the variance: {how}. Fractions that are not listed cannot be distinguished from 0.")
    for note in found.evidence.notes:
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"Intervals: {found.evidence.intervals}.")
    if found.resumed:
        screen.line(f"Already in the store: {counted(found.resumed, 'member')}.")
    rate = found.member_steps / max(found.seconds, 1e-9)
    screen.line(f"{found.seconds:.1f} s, {rate:.3g} solver steps/s in total." if rate else f"{found.seconds:.1f} s in total.")


def _interval(low: str, high: str) -> str:
    return low if low == "-" else f"{low} to {high}"
