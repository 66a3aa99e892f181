"""Flights as rows of tables and as a document, for the page, the terminal and ``--json``."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from barbalat.judge.verdict import Class, percent
from barbalat.report.terminal.layout import Screen
from barbalat.run.kernel.sampled_controller import Agreement
from barbalat.validate import counted
from barbalat.vehicles.comparison import FlightComparison
from barbalat.vehicles.flight import Failing, Flight
from barbalat.vehicles.verdicts import said_of

CSV_EVERY = 10
"""Samples between rows of a CSV: ten rows per second, so the flights with one failure take about 100 kB."""

NAMED_FAILURES = 3
"""Largest number of failures that a title names. All failures of a vehicle would take two lines."""


def title(found: FlightComparison) -> str:
    """Return a title with the controllers and the failures. It names a few failures; if there are more, it gives their number."""
    names = [one.name for one in found.failures]
    if len(names) <= NAMED_FAILURES:
        return f"{found.name} through {', '.join(names)}"
    failing = sum(one != "none" for one in names)
    return f"{found.name} through {counted(failing, 'failure')}{', and without one' if failing < len(names) else ''}"


def verdicts(found: FlightComparison) -> list[str]:
    """Return a sentence for each controller with the judge's verdicts on its flights; none for a vehicle without judged
    signals."""
    return [f"{several[0].controller}: {said}" for several in found.flights if (said := _judged_flights(several))]


def _judged_flights(several: Sequence[Flight]) -> str:
    judged = [one.verdict for one in several if one.verdict is not None]
    return said_of(judged) if judged else ""


def headings(found: FlightComparison) -> tuple[str, ...]:
    """The headings of the tables of metrics."""
    return ("controller", *(["judged"] if _is_judged(found) else []), *found.vehicle.headings)


def _is_judged(found: FlightComparison) -> bool:
    return any(one.verdict is not None for several in found.flights for one in several)


def rows(found: FlightComparison, failure: Failing) -> list[list[str]]:
    """Return a row for each controller with one failure, best first: name, verdict, and the metrics or the reason why control
    was lost."""
    judged = _is_judged(found)
    return [[one.controller, *([_verdict(one)] if judged else []), *_cells(found, one)] for one in found.through(failure)]


def _verdict(flight: Flight) -> str:
    """The class of the verdict, and the error as a fraction of the scale."""
    one = flight.verdict
    if one is None or one.error is None or one.kind is Class.LOST:
        return "-" if one is None else str(one.kind)
    return f"{one.kind} {percent(one.error / one.scale)}" if one.scale > 0 else str(one.kind)


def suspects(found: FlightComparison, failure: Failing) -> list[str]:
    """Return sentences on suspected limit cycles."""
    judged = [(one.controller, one.verdict.suspect) for one in found.through(failure) if one.verdict is not None]
    return [f"{name} {said}" for name, said in judged if said]


NOT_TAKEN_FURTHER = (
    "the judge's classes are the same as in barbalat run, over the last quarter of each flight"
    "; flights are not continued with a constant command, so a limit cycle is only suspected here, never confirmed"
)


def _cells(found: FlightComparison, flight: Flight) -> list[str]:
    if not flight.lost:
        return found.vehicle.cells(flight.figures)
    empty = ["-"] * len(found.vehicle.headings)
    empty[len(empty) // 2] = f"lost {flight.duration:.1f} s"
    return empty


def reasons(found: FlightComparison, failure: Failing) -> list[str]:
    """Return a sentence for each way in which control was lost, with the controllers and times."""
    lost = [flight for flight in found.through(failure) if flight.lost]
    whys = dict.fromkeys(flight.lost for flight in lost)
    who = {why: [f"{one.controller} at {one.duration:.2f} s" for one in lost if one.lost == why] for why in whys}
    return [f"Control was lost because {why}: {', '.join(names)}" for why, names in who.items()]


def losses(found: FlightComparison) -> list[list[str]]:
    """Return a row for each controller: the number of lost flights and, if requested, the delay up to which it loses none."""
    delays = found.delays
    return [
        [name, f"{count} of {len(found.failures)}", *([] if delays is None else [_delay(found, delays[name])])]
        for name, count in found.losses.items()
    ]


def loss_headings(found: FlightComparison) -> tuple[str, ...]:
    """The headings of the table of ``losses``."""
    return ("controller", "flights lost", *([] if found.delays is None else ["tolerated\nadded delay"]))


def _delay(found: FlightComparison, seconds: float) -> str:
    more = ", at least" if seconds >= found.longest_delay else ""
    return f"{round(1e3 * seconds, 1):g} ms{more}"


def best_and_worst(found: FlightComparison, failure: Failing) -> str:
    """Return a sentence that names the best and the worst of the controllers that kept control."""
    kept = [flight for flight in found.through(failure) if not flight.lost]
    if not kept:
        return "no controller kept control"
    count = len(found.controllers)
    survived = "all kept control" if len(kept) == count else f"{len(kept)} of {count} kept control"
    if len(kept) == 1:
        return f"{survived}: {kept[0].controller}" if count > 1 else survived
    return f"{survived}; smallest error: {kept[0].controller}, largest: {kept[-1].controller}"


def facts(found: FlightComparison) -> list[tuple[str, str]]:
    """Return the labelled facts that precede the tables: controllers, vehicle, and whether flown and simulated code agree."""
    return [*found.facts(), *(("exported", sentence) for sentence in _in_the_loop(found))]


def _in_the_loop(found: FlightComparison) -> list[str]:
    """Return one sentence on all exported controllers that equal their simulation, and one on each controller that does not."""
    agreements = found.agreements or {}
    equal = {name: one for name, one in agreements.items() if one.equal and not one.refused}
    several = "every controller" if len(equal) == len(agreements) else f"{len(equal)} of {len(agreements)} controllers"
    who, together = next(iter(equal)) if len(equal) == 1 else several, Agreement.together(equal.values())
    flights = counted(together.flights, "flight")
    said = (
        f"the exported C of {who} was compiled on this machine and flown: u and the state are bit-identical to those of the "
        f"simulation at all {together.samples:,} samples of {flights}"
    )
    return [*([said] if equal else []), *(_unequal(name, one) for name, one in agreements.items() if name not in equal)]


def _unequal(name: str, one: Agreement) -> str:
    if one.equal is None:
        return f"nothing is known about the exported C of {name}: the simulator failed in every flight"
    held = f", and it rejected {one.refused:,} of {one.samples:,} samples" if one.refused else ""
    return f"the exported C of {name} differs from the simulation{f': {one.difference}' if one.difference else ''}{held}"


def as_document(found: FlightComparison) -> dict[str, Any]:
    """The document of ``fly --json``."""
    return {
        "flight": found.name,
        **found.details(),
        "units": found.vehicle.units,
        "failures": {failure.name: _judged(found, failure) for failure in found.failures},
        "losses": found.losses,
        **({} if found.delays is None else {"delay_borne": found.delays}),
        **_as_c(found),
        "controllers": {
            several[0].controller: {flight.failure.name: _flight(flight) for flight in several} for several in found.flights
        },
    }


def _flight(flight: Flight) -> dict[str, Any]:
    verdict = flight.verdict
    return flight.figures | {"lost": flight.lost or None} | ({} if verdict is None else {"verdict": verdict.as_json()})


def _as_c(found: FlightComparison) -> dict[str, Any]:
    if found.agreements is None:
        return {}
    return {"software_in_the_loop": {name: {"equal": one.equal, **asdict(one)} for name, one in found.agreements.items()}}


def _judged(found: FlightComparison, failure: Failing) -> dict[str, Any]:
    ranked = found.through(failure)
    kept = [flight.controller for flight in ranked if not flight.lost]
    return {
        "meaning": failure.meaning,
        "lost": [flight.controller for flight in ranked if flight.lost],
        "best": kept[0] if kept else None,
        "worst": kept[-1] if kept else None,
    }


def table_of(found: FlightComparison, failure: Failing) -> str:
    """Return a CSV of all flights through one failure."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["controller", *(f"{name} [{unit}]" for name, unit in found.vehicle.columns.items())])
    for flight in found.through(failure):
        chosen = np.unique([*range(0, len(flight.record), CSV_EVERY), len(flight.record) - 1])
        writer.writerows([flight.controller, *(f"{value:.6g}" for value in row)] for row in flight.record[chosen])
    return buffer.getvalue()


def notes(found: FlightComparison) -> list[str]:
    """Return sentences that explain the tables."""
    return [*found.vehicle.notes, *([NOT_TAKEN_FURTHER] if _is_judged(found) else [])]


def show(screen: Screen, found: FlightComparison) -> None:
    """Print the comparison, beginning with the losses."""
    screen.line(title(found), "bold")
    for label, text in facts(found):
        screen.fact(label, text, 8)
    for sentence in verdicts(found):
        screen.line(f"{sentence}.")
    screen.line("")
    lost = [[screen.name(name), *cells] for name, *cells in losses(found)]
    screen.table(loss_headings(found), lost)
    for failure in found.failures:
        screen.title(f"{failure.name}: {failure.meaning}")
        screen.line(f"{best_and_worst(found, failure)}.")
        body = [[screen.name(name), *cells] for name, *cells in rows(found, failure)]
        screen.table(headings(found), body)
        for reason in [*suspects(found, failure), *reasons(found, failure)]:
            screen.line(f"{reason}.", indent="    ", start="  ")
    screen.line("")
    for note in notes(found):
        screen.line(f"Note: {note}.")
