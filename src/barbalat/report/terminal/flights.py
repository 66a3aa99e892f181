"""What ``barbalat fly`` shows: who lost control, then figures for each failure."""

from __future__ import annotations

from barbalat.report import flights
from barbalat.report.terminal.layout import Screen
from barbalat.vehicles.comparison import FlightComparison


def show(screen: Screen, found: FlightComparison) -> None:
    """Print the comparison, losses first."""
    screen.line(flights.title(found), "bold")
    for label, text in flights.facts(found):
        screen.fact(label, text, 8)
    screen.line("")
    lost = [[screen.name(name), *cells] for name, *cells in flights.losses(found)]
    screen.table(flights.loss_headings(found), lost)
    for failure in found.failures:
        screen.title(f"{failure.name}: {failure.meaning}")
        screen.line(f"{flights.best_and_worst(found, failure)}.")
        body = [[screen.name(name), *cells] for name, *cells in flights.rows(found, failure)]
        screen.table(("controller", *found.vehicle.headings), body)
        for reason in flights.reasons(found, failure):
            screen.line(f"{reason}.", indent="    ", start="  ")
    screen.line("")
    for note in found.vehicle.notes:
        screen.line(f"Note: {note}.")
