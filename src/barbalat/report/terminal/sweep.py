"""What ``barbalat sweep`` shows: who failed, then what the others reached."""

from __future__ import annotations

from barbalat.report import sweep
from barbalat.report.sweep import percent
from barbalat.report.terminal.layout import Screen, grouped
from barbalat.sweeps.evidence import DIVERGES, EXAMINED
from barbalat.sweeps.result import SweepResult
from barbalat.validate import counted


def show(screen: Screen, found: SweepResult) -> None:
    """Shares with their intervals, extremes with the member to look at, how the numbers came about."""
    screen.line(f"{found.case}: {counted(len(found), 'member')} over {', '.join(map(str, found.plan.paths))}", "bold")
    for note in found.redesign_notes:
        screen.line(f"{note[0].upper()}{note[1:]}.", "yellow")
    shares = [[name, screen.name(who), *cells, _interval(low, high)] for name, who, *cells, low, high in sweep.shares(found)]
    screen.table(("", "controller", "members", "share", "95 % interval"), grouped(shares), leads=2)
    screen.line(f"Diverged: {DIVERGES}.")
    screen.line(f"Oscillated examines {EXAMINED}.")
    for sentence in found.audit.sentences:
        screen.line(f"Audit: {sentence}.", "yellow" if found.audit.changed != 0 else "")
    screen.line("")
    extremes = [[name, screen.name(who), *cells] for name, who, *cells in sweep.extremes(found)]
    screen.table(("figure", "controller", "least", "median", "largest", "worst member"), grouped(extremes), leads=2)
    for controller, part in found.evidence.filled.items():
        screen.line(
            f"{controller}: of the guaranteed bound the largest |e| of a member fills {percent(part.median)} in the middle, "
            f"{percent(part.max)} at most"
        )
    told = [one for one in found.evidence.sensitivities if one.figure.startswith("max_abs_e") and one.low > 0]
    told.sort(key=lambda one: (found.controllers.index(one.controller), one.figure, -one.first))
    explained = [
        [
            one.figure,
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
        screen.line(f"Shares of the variance: {how}. What is not listed can't be told from 0.")
    for note in found.evidence.notes:
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"Intervals: {found.evidence.intervals}.")
    if found.resumed:
        screen.line(f"In the store already: {counted(found.resumed, 'member')}.")
    rate = found.member_steps / max(found.seconds, 1e-9)
    screen.line(f"{found.seconds:.1f} s, {rate:.3g} solver steps/s in all.")


def _interval(low: str, high: str) -> str:
    return low if low == "-" else f"{low} to {high}"
