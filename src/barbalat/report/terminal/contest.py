"""What ``barbalat contest`` shows: failures first, then who meets the rule with what, then what differs."""

from __future__ import annotations

from barbalat.comparison.contest.result import Contest
from barbalat.report import contest
from barbalat.report.terminal.layout import Screen
from barbalat.validate import counted


def show(screen: Screen, found: Contest) -> None:
    """Tables, the first's columns last explained by the rule above it."""
    screen.line(f"{found.problem.name}: {counted(len(found.entrants), 'scheme')} under one rule", "bold")
    screen.line(f"The rule: {contest.rule(found)}.")
    screen.line(f"Held out: {contest.held_out(found)}.")
    for heading, columns, rows in (
        ("Held-out runs that failed, or do not bear what the rule asks", contest.FAILURES, contest.failures(found)),
        ("Under the rule", contest.MARGINS, contest.margins(found)),
        ("RMS |e| over RMS |x_m| of the held-out runs", contest.ERRORS, contest.errors(found)),
        ("Ratio of the errors on the same runs, 95 % interval", contest.PAIRS, contest.pairs(found, neighbours=True)),
    ):
        if rows:
            screen.title(heading)
            screen.table(columns, [[screen.name(name), *cells] for name, *cells in rows])
    screen.title("Tunings")
    for name, tuning, own, _ in contest.own(found):
        screen.line(f"{name}: {tuning}; {own}", indent="    ")
    screen.line("")
    for note in (*found.notes, *found.left_out):
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"{found.seconds:.0f} s. Measured on these plants and commands: no guarantee.")
