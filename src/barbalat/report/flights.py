"""Flights as rows of tables and as a document, for the page, the terminal and ``--json``."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict
from typing import Any

import numpy as np

from barbalat.flight.airframe import INTEGRATOR, STEP
from barbalat.flight.axis import SAMPLE_TIME
from barbalat.flight.comparison import FlightComparison
from barbalat.flight.failures import FAILS_AT, Failure
from barbalat.flight.flight import DELAY_STEP, MOST, TIMING, Flight, columns_of, figures_of

HEADINGS = ("RMS e\n[deg/s]", "max |e|\n[deg/s]", "n_z\n[g]", "alpha\n[deg]", "surface\n[deg/s]")
CSV_EVERY = 10
"""Samples from one row of a CSV to the next: ten rows a second, so that a failure's flights are some 100 kB."""
NOTES = (
    f"After the failure, which comes at {FAILS_AT:g} s and stays; e is the followed rate less that "
    "of the model to follow, alpha its largest value, surface how far that moves in a second",
    "each scheme has the setting that one rule gives on the linearised aircraft, and none is tuned on flights: these are ranked",
)


def rows(found: FlightComparison, failure: Failure) -> list[list[str]]:
    """The controllers through one failure, the best first: name, then figures, or why control was lost."""
    return [[flight.controller, *_cells(flight)] for flight in found.through(failure)]


def _cells(flight: Flight) -> list[str]:
    figures = flight.figures
    if flight.lost:
        return ["-", "-", f"lost {flight.duration:.1f} s", "-", "-"]

    def between(low: str, high: str) -> str:
        return f"{number(low)} to {number(high)}"

    def number(name: str) -> str:
        value = figures[name]
        return "-" if value is None else f"{value:.2f}"

    load = between("n_z_min", "n_z_max")
    return [number("rms_e"), number("max_abs_e"), load, number("alpha_max"), number(f"{flight.followed.surface}_travel")]


def reasons(found: FlightComparison, failure: Failure) -> list[str]:
    """A sentence for each way in which control was lost, and who lost it when."""
    lost = [flight for flight in found.through(failure) if flight.lost]
    whys = dict.fromkeys(flight.lost for flight in lost)
    who = {why: [f"{one.controller} at {one.duration:.2f} s" for one in lost if one.lost == why] for why in whys}
    return [f"Control was lost as {why}: {', '.join(names)}" for why, names in who.items()]


def losses(found: FlightComparison) -> list[list[str]]:
    """Controller, how many of its flights it lost, and where it was asked for the delay with which it loses none."""
    delays = found.delays
    return [
        [name, f"{count} of {len(found.failures)}", *([] if delays is None else [_delay(delays[name])])]
        for name, count in found.losses.items()
    ]


def loss_headings(found: FlightComparison) -> tuple[str, ...]:
    """Of ``losses``."""
    return ("controller", "flights lost", *([] if found.delays is None else ["added delay\nborne"]))


def _delay(seconds: float) -> str:
    more = ", at least" if seconds >= MOST * DELAY_STEP else ""
    return f"{1e3 * seconds:.0f} ms{more}"


def best_and_worst(found: FlightComparison, failure: Failure) -> str:
    """Of those that kept control."""
    kept = [flight for flight in found.through(failure) if not flight.lost]
    if not kept:
        return "nobody kept control"
    count = len(found.controllers)
    survived = "all kept control" if len(kept) == count else f"{len(kept)} of {count} kept control"
    if len(kept) == 1:
        return f"{survived}: {kept[0].controller}" if count > 1 else survived
    return f"{survived}; least error: {kept[0].controller}, largest: {kept[-1].controller}"


def facts(found: FlightComparison) -> list[tuple[str, str]]:
    """Where it flies, what its modes are, how it is computed."""
    trim = found.axis.trim
    alpha, elevator = np.rad2deg([trim.alpha, trim.elevator])
    modes = "; ".join(f"{name} {_mode(values)}" for name, values in trim.modes().items() if values)
    return [
        ("trim", f"{trim.condition}: alpha {alpha:.2f} deg, elevator {elevator:.2f} deg, throttle {trim.throttle:.2f}"),
        ("modes", f"{modes} [1/s]"),
        (
            "computed",
            f"JSBSim {found.jsbsim}, {INTEGRATOR}, {1 / STEP:g} Hz; control at {1 / SAMPLE_TIME:g} Hz, {TIMING.duration:g} s",
        ),
    ]


def _mode(values: list[complex]) -> str:
    first = values[0]
    return f"{first.real:.3g} +- {abs(first.imag):.3g}j" if first.imag else ", ".join(f"{one.real:.3g}" for one in values)


def as_document(found: FlightComparison) -> dict[str, Any]:
    """The document of ``fly --json``."""
    trim, axis = found.axis.trim, found.axis
    A, b = axis.model
    return {
        "flight": found.name,
        "condition": {"altitude_ft": trim.condition.altitude, "mach": trim.condition.mach},
        "trim": {
            "speed_ft_s": trim.speed,
            "alpha_deg": float(np.rad2deg(trim.alpha)),
            "elevator_deg": float(np.rad2deg(trim.elevator)),
            "throttle": trim.throttle,
        },
        "modes": {name: [[value.real, value.imag] for value in values] for name, values in trim.modes().items()},
        "design": {"A": A.tolist(), "b": b.tolist(), "gain": axis.gain.tolist(), "A_m": axis.A_m.tolist(), "k_0": axis.k_0},
        "equipment": asdict(axis.equipment),
        "simulation": {
            "simulator": f"JSBSim {found.jsbsim}", "integrator": INTEGRATOR, "dt": STEP, "sample_time": SAMPLE_TIME,
            "t_end": TIMING.duration, "fails_at": FAILS_AT,
        },
        "units": figures_of(axis.followed),
        "failures": {failure.name: _judged(found, failure) for failure in found.failures},
        "losses": found.losses,
        **({} if found.delays is None else {"delay_borne": found.delays}),
        "controllers": {
            several[0].controller: {flight.failure.name: flight.figures | {"lost": flight.lost or None} for flight in several}
            for several in found.flights
        },
    }  # fmt: skip


def _judged(found: FlightComparison, failure: Failure) -> dict[str, Any]:
    ranked = found.through(failure)
    kept = [flight.controller for flight in ranked if not flight.lost]
    return {
        "meaning": failure.meaning,
        "lost": [flight.controller for flight in ranked if flight.lost],
        "best": kept[0] if kept else None,
        "worst": kept[-1] if kept else None,
    }


def table_of(found: FlightComparison, failure: Failure) -> str:
    """A CSV of all flights through one failure."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["controller", *(f"{name} [{unit}]" for name, unit in columns_of(found.axis.followed).items())])
    for flight in found.through(failure):
        chosen = np.unique([*range(0, len(flight.record), CSV_EVERY), len(flight.record) - 1])
        writer.writerows([flight.controller, *(f"{value:.6g}" for value in row)] for row in flight.record[chosen])
    return buffer.getvalue()
