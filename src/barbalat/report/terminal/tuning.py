"""What ``barbalat tune`` shows: what each controller was and has become, and how it fares on plants that it never saw."""

from __future__ import annotations

from barbalat.comparison.tune.result import Tuning
from barbalat.report import tuning
from barbalat.report.terminal.layout import Screen, grouped
from barbalat.validate import counted


def show(screen: Screen, found: Tuning) -> None:
    """A table, the changes, the new plants."""
    screen.line(f"{found.case.name}: {tuning.judged(found)}", "bold")
    for one in found.aim.constraints:
        screen.line(f"subject to {one.requirement}", start="  ")
    rows = [[screen.name(name), *cells] for name, *cells in tuning.points(found)]
    screen.table(tuning.columns(found), grouped(rows), leads=2)
    for name, tuned in found.controllers.items():
        screen.line("")
        screen.line(f"{name}: {counted(tuned.trials, 'tuning')}, {counted(tuned.runs, 'run')}")
        for change in tuning.changes(tuned):
            screen.whole(f"  {change}")
    rows = [[screen.name(name), *cells] for name, *cells in tuning.held_out(found)]
    if rows:
        screen.line("")
        count = next(len(one.held_out.thetas) for one in found.controllers.values() if one.held_out is not None)
        screen.line(f"On {counted(count, 'plant')} of the known set that the search did not see:")
        screen.table(("controller", "median", "worst", "at theta", "constraints"), rows)
    for note in found.notes:
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"{found.seconds:.0f} s. Measured on these plants and this command: no guarantee.")
