"""What flights on JSBSim's F-16 came to: the one row that is read and not measured, for its simulator is not everybody's.

``flown.json`` is the document of ``barbalat fly f16-pitch --dispersions N --json``, its blanks left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from itertools import combinations, product
from typing import Any

from barbalat.claims.claim import Claim, Listing, Reading, of_readings, verdict
from barbalat.sweeps.evidence import Share, beyond_chance

LINEAR_SCHEMES = ("LQR", "LQR with PI", "H-infinity", "ADRC")
ADAPTIVE_SCHEMES = ("MRAC", "Robust MRAC", "L1", "L1 piecewise", "L1 piecewise, as flown")
"""As their authors call them; L1 with the piecewise-constant law is a linear controller by the row ``l1-piecewise-is-lti``."""


ERROR, LOSS = "less_error_than", "kept_where_lost"
"""Paired shares of the document: on how many draws the error was smaller, and on how many of those that one of both lost the
other was lost."""


@dataclass(frozen=True)
class Flights:
    """The stored document, asked questions."""

    document: dict[str, Any]

    @cached_property
    def members(self) -> int:
        return int(self.document["members"])

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """Those that somebody survives."""
        every = self.document["failures"]
        return tuple(
            one for one, found in every.items() if any(flown["lost"]["count"] < self.members for flown in found.values())
        )

    def lost(self, controller: str, failure: str) -> int:
        return int(self.document["failures"][failure][controller]["lost"]["count"])

    def error(self, controller: str, failure: str) -> float | None:
        value = self.document["failures"][failure][controller]["rms_e"]["median"]
        return None if value is None else float(value)

    @cached_property
    def shares(self) -> dict[tuple[str, str, str, str], Share]:
        """Of every two controllers through every failure by every criterion, where some draw decides."""
        found = {}
        for failure, by_controller in self.document["failures"].items():
            for (one, other), by in product(combinations(by_controller, 2), (ERROR, LOSS)):
                share = by_controller[one][by][other]
                if share is not None:
                    found[failure, one, other, by] = Share(count=share["count"], judged=share["judged"])
        return found

    @cached_property
    def signs(self) -> dict[tuple[str, str, str, str], int]:
        """Of these, beyond chance, all of them together."""
        return beyond_chance(self.shares)

    def compared(self, one: str, other: str, failure: str, by: str = ERROR) -> int:
        """1 where ``one`` is better than ``other`` beyond chance on the same draws, -1 where it is worse."""
        return self.signs.get((failure, one, other, by), 0) - self.signs.get((failure, other, one, by), 0)

    def over_all(self, one: str, others: Sequence[str], by: str) -> Iterator[str]:
        """The failures through which it is better than each of these, beyond chance, a lost flight having the largest error."""
        for failure in self.failures:
            if all(self.compared(one, other, failure, by) == 1 for other in others if other != one):
                yield failure


def claim() -> Claim:
    """The row, from the document."""
    flights = Flights(json.loads(resources.files("barbalat.claims").joinpath("flown.json").read_text(encoding="utf-8")))
    document = flights.document
    linear, adaptive = (tuple(one for one in names if one in document["lost"]) for names in (LINEAR_SCHEMES, ADAPTIVE_SCHEMES))
    readings = (
        _losses(flights, linear, adaptive),
        _better(flights, "the adaptation: an adaptive scheme follows better", linear, adaptive, ERROR),
        _against(
            flights,
            "the filter: L1 with its filter and fast adaptation follows better than MRAC, which has neither",
            "L1",
            "MRAC",
        ),
        _against(
            flights,
            "the speed: L1 with the piecewise-constant law, which estimates anew at each sample, follows better than robust MRAC",
            "L1 piecewise, as flown",
            "Robust MRAC",
        ),
    )
    fewest = min(document["lost"].values(), key=lambda one: int(one["count"]))
    flights_of_each = int(fewest["flights"])
    return Claim(
        id="adaptive-in-flight",
        where="not in the paper: Section IV, which says that the L1 controllers that were flown should have been compared with linear robust designs",
        statement="On a flight model that others made, with what fails in flight, adaptive control does better than linear designs under the same margins",
        verdict=of_readings(readings),
        measured="; ".join(f"{one.says}: {one.measured}" for one in readings),
        how=f"read, not measured by this command: stored by `barbalat fly {document['flight']} --dispersions {flights.members} --json` with JSBSim "
        f"{document['versions']['jsbsim']}, barbalat {document['versions']['barbalat']}, seed {document['plan']['seed']}, equations {document['equations'][:12]}. "
        "JSBSim's F-16 follows a pitch-rate command at 100 Hz through its actuator, limits, sensors and bus; draws of mass, balance, derivatives, start, gusts "
        "and delay take turns at three conditions. All schemes were tuned by one rule on the linearised nominal aircraft: least RMS error with a delay margin of "
        f"0.1 s and a gain margin of 2. Beyond chance is by the exact sign test on the same draws, at 95 % for all {len(flights.shares)} comparisons together (Holm). A test flies a draw again where JSBSim is installed",
        listings=(_table(flights),),
        number=_number(flights, linear, adaptive, flights_of_each),
        readings=readings,
        condition=_condition(flights, linear, adaptive),
        would_change="another aircraft, margin, command or rule; faults that were known when the linear designs were made",
    )  # fmt: skip


def _sum(flights: Flights, controller: str) -> int:
    return int(flights.document["lost"][controller]["count"])


def _least(flights: Flights, names: Sequence[str]) -> tuple[str, int]:
    best = min(names, key=lambda one: _sum(flights, one))
    return best, _sum(flights, best)


def _number(flights: Flights, linear: Sequence[str], adaptive: Sequence[str], each: int) -> str:
    (first, lost), (second, left) = _least(flights, adaptive), _least(flights, linear)
    differ = [failure for failure in flights.failures if flights.compared(first, second, failure, LOSS)]
    beyond = f"through {', '.join(differ)} beyond chance" if differ else "through no failure beyond chance"
    return f"stored flights, fewest of {each} lost: adaptive {lost} ({first}), linear {left} ({second}); they differ {beyond}"


def _losses(flights: Flights, linear: Sequence[str], adaptive: Sequence[str]) -> Reading:
    (first, lost), (second, left) = _least(flights, adaptive), _least(flights, linear)
    reading = _better(flights, "the adaptation: an adaptive scheme loses the aircraft less often", linear, adaptive, LOSS)
    return replace(reading, measured=f"{reading.measured}; in all {first} loses {lost}, {second} {left}")


def _better(flights: Flights, says: str, linear: Sequence[str], adaptive: Sequence[str], by: str) -> Reading:
    """Beyond chance, than each of the others; where nothing is lost nothing says it."""
    better = {one: list(flights.over_all(one, linear, by)) for one in adaptive}
    worse = {one: list(flights.over_all(one, adaptive, by)) for one in linear}
    won = {failure for found in better.values() for failure in found}
    return Reading(
        f"{says} than every linear design, beyond chance",
        verdict(holds=bool(won), conditional=len(won) < len(flights.failures)),
        f"{_who(better)}; a linear design than every adaptive scheme: {_who(worse)}",
    )


def _against(flights: Flights, says: str, one: str, other: str) -> Reading:
    found = {sign: [failure for failure in flights.failures if flights.compared(one, other, failure) == sign] for sign in (1, -1)}
    return Reading(
        says,
        verdict(holds=bool(found[1]), conditional=len(found[1]) < len(flights.failures)),
        f"less error through {_named(found[1])}, more through {_named(found[-1])}",
    )


def _condition(flights: Flights, linear: Sequence[str], adaptive: Sequence[str]) -> str:
    """By which criterion who wins, through what, and by how much; and who does on the other side."""
    fewer, less = ({one: list(flights.over_all(one, linear, by)) for one in adaptive} for by in (LOSS, ERROR))
    said = [f"by losses {_who(fewer) if any(fewer.values()) else 'nobody'}"]
    said += [f"by the error {_sized(flights, one, failure, linear)}" for one, won in less.items() for failure in won]
    reverse = {one: list(flights.over_all(one, adaptive, ERROR)) for one in linear}
    return (
        f"better than every linear design {', '.join(said)}. Of linear designs, better than every adaptive scheme by the error "
        f"{_who(reverse)}. The filter and the speed pay through some failures alone"
    )


def _sized(flights: Flights, one: str, failure: str, others: Sequence[str]) -> str:
    """With the medians: on most draws less is not yet less by much."""
    value = flights.error(one, failure)
    medians = {other: error for other in others if (error := flights.error(other, failure)) is not None}
    if value is None or not medians:
        return f"{one} through {failure}"
    best = min(medians, key=lambda other: medians[other])
    return f"{one} through {failure}, on most draws, the median being {value:.2f} deg/s and that of {best} {medians[best]:.2f}"


def _who(found: dict[str, list[str]]) -> str:
    return "; ".join(f"{name} through {', '.join(failures)}" for name, failures in found.items() if failures) or "none"


def _named(failures: Sequence[str]) -> str:
    return ", ".join(failures) or "none"


def _table(flights: Flights) -> Listing:
    every = tuple(flights.document["failures"])

    def cell(controller: str, failure: str) -> str:
        error = flights.error(controller, failure)
        return f"{flights.lost(controller, failure)}; {'-' if error is None else f'{error:.2f}'}"

    return Listing(
        f"Lost flights of {flights.members}; the median RMS error of the pitch rate [deg/s], where a lost flight's is infinite",
        ("controller", *every),
        tuple((one, *(cell(one, failure) for failure in every)) for one in flights.document["lost"]),
    )
