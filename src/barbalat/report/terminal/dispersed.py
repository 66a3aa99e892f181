"""What ``barbalat fly --dispersions`` shows: losses, then figures with intervals for each failure."""

from __future__ import annotations

from barbalat.report import dispersed
from barbalat.report.terminal.layout import Screen
from barbalat.vehicles.dispersed import DispersedComparison


def show(screen: Screen, found: DispersedComparison) -> None:
    """Print the campaign, losses first."""
    screen.line(f"{found.campaign.name} on {found.members} vehicles that are drawn", "bold")
    for label, text in dispersed.facts(found):
        screen.fact(label, text, 8)
    screen.line("")
    lost = [[screen.name(name), *cells] for name, *cells in dispersed.losses(found)]
    screen.table(dispersed.loss_headings(found), lost)
    screen.line("")
    for verdict in dispersed.verdicts(found):
        screen.line(f"{verdict}.", indent="    ", start="  ")
    for failure in found.campaign.failures:
        screen.title(f"{failure.name}: {failure.meaning}")
        body = [[screen.name(name), *cells] for name, *cells in dispersed.rows(found, failure.name)]
        screen.table(dispersed.headings(found), body)
    screen.line("")
    for note in dispersed.notes(found):
        screen.line(f"Note: {note}.")
