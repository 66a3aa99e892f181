"""What flights of drawn vehicles came to: the one row that is read and not measured, for the simulators are not everybody's."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from itertools import combinations, product
from typing import Any

from barbalat.papers.claim import Claim, Listing, Measurement, Reading, Verdict, of_readings, verdict
from barbalat.sweeps.statistics import Share, beyond_chance


def claim() -> Claim:
    """The row, from the documents."""
    every = [Flights.stored(name) for name in stored()]
    readings = (
        _sides(every, "the adaptation: an adaptive scheme loses the vehicle less often than every linear design", LOSS),
        _sides(every, "the adaptation: an adaptive scheme follows better than every linear design", ERROR),
        _beside(
            every,
            "the filter: L1, with the filter and the adaptation that the rule gives it, follows better than MRAC, which has no filter",
            "L1",
            "MRAC",
        ),
        _beside(
            every,
            "the speed: L1 with the piecewise-constant law, which estimates anew at each sample, follows better than robust MRAC",
            "L1 piecewise, as flown",
            "Robust MRAC",
        ),
    )
    return Claim(
        id="adaptive-in-flight",
        where="not in the paper: Section IV, which says that the L1 controllers that were flown should have been compared with linear robust designs",
        statement="On flight models with what fails in flight, adaptive control does better than linear designs when at least the same margins are asked of both",
        verdict=of_readings(readings),
        measured=f"stored flights lost, the fewest of each side: {'; '.join(_told(one) for one in every)}; "
        + "; ".join(f"{one.says}: {one.measured}" for one in readings),
        how="read, not measured by this command: " + "; ".join(_provenance(one) for one in every) + ". JSBSim's F-16 follows a pitch-rate or a roll-rate command "
        "at 100 Hz through its actuator, limits, sensors and bus; MuJoCo's quadrotor flies a figure of eight with motors that lag. Draws are of the vehicle, its start, "
        "its sensors and the air. All schemes of a flight were tuned by one rule on the linearised nominal vehicle: least RMS error with the same delay and gain "
        "margins. Beyond chance is by the exact sign test on the same draws, at 95 % for all comparisons of a flight together (Holm). A reading holds where it does "
        "through more failures than its reverse. Tests fly draws again where the simulators are installed",
        listings=tuple(_table(one) for one in every),
        number=_number(every),
        readings=readings,
        condition="; ".join(f"{one.says}: {one.measured}" for one in readings if one.decides and one.verdict != "not confirmed"),
        would_change="another vehicle, margin, command or rule; faults that were known when the linear designs were made",
    )  # fmt: skip


def _provenance(flights: Flights) -> str:
    document = flights.document
    versions = ", ".join(
        f"{name} {document['versions'][name]}" for name in ("jsbsim", "mujoco", "barbalat") if name in document["versions"]
    )
    return (
        f"`barbalat fly {flights.name} --dispersions {flights.members} --json` with {versions}, seed {document['plan']['seed']}, "
        f"equations {document['equations'][:12]}, {len(flights.shares)} comparisons"
    )


def _fewest(flights: Flights) -> tuple[str, str, list[str]]:
    """The adaptive and the linear scheme that lose the fewest flights; the failures through which these differ beyond chance."""
    adaptive, linear = (min(names, key=lambda one: _sum(flights, one)) for names in (flights.adaptive, flights.linear))
    return adaptive, linear, [failure for failure in flights.failures if flights.compared(adaptive, linear, failure, LOSS)]


def _number(every: Sequence[Flights]) -> str:
    """Return the number of all flights together: two lines of the last screen, however many are stored."""
    sides = [(one, *_fewest(one)) for one in every]
    counts = [
        (_sum(one, a, "flights"), _sum(one, a), _sum(one, b), len(differ), len(one.failures)) for one, a, b, differ in sides
    ]
    said = "fewest flights lost of {}: adaptive {}, linear {}; apart beyond chance in {} of {} failures"
    return said.format(*map(sum, zip(*counts, strict=True)))


def _told(flights: Flights) -> str:
    adaptive, linear, differ = _fewest(flights)
    beyond = f"through {', '.join(differ)} beyond chance" if differ else "nowhere beyond chance"
    lost = f"adaptive {_sum(flights, adaptive)} ({adaptive}), linear {_sum(flights, linear)} ({linear})"
    return f"{flights.name}, of {_sum(flights, adaptive, 'flights')}: {lost}, which differ {beyond}"


def _sum(flights: Flights, controller: str, what: str = "count") -> int:
    """Over all failures: its lost flights, or all of its ``flights``."""
    return int(flights.document["lost"][controller][what])


def _sides(every: Sequence[Flights], says: str, by: str) -> Reading:
    """Beyond chance, than each of the other side: through which failures of which flight, and the reverse."""
    ahead = [{one: list(flights.over_all(one, flights.linear, by)) for one in flights.adaptive} for flights in every]
    behind = [{one: list(flights.over_all(one, flights.adaptive, by)) for one in flights.linear} for flights in every]
    told = [
        f"{flights.name}: {_who(flights, better, flights.linear, by)}; a linear design than every adaptive scheme: "
        f"{_who(flights, worse, flights.adaptive, by)}"
        for flights, better, worse in zip(every, ahead, behind, strict=True)
    ]
    return Reading(f"{says}, beyond chance", _prevails(every, _failures(ahead), _failures(behind)), ". ".join(told))


def _beside(every: Sequence[Flights], says: str, one: str, other: str) -> Reading:
    """Compare two schemes of one side, which does not decide the sentence."""

    def through(sign: int) -> list[list[str]]:
        return [[failure for failure in flights.failures if flights.compared(one, other, failure) == sign] for flights in every]

    better, worse = through(1), through(-1)
    told = [
        f"{flights.name}: less error {_named(less)}, more {_named(more)}"
        for flights, less, more in zip(every, better, worse, strict=True)
    ]
    found = _prevails(every, sum(map(len, better)), sum(map(len, worse)))
    return Reading(f"beside the sentence: {says}", found, ". ".join(told), decides=False)


def _failures(found: Sequence[dict[str, list[str]]]) -> int:
    """Say through which failures, of all flights, some scheme is ahead."""
    return sum(len({failure for failures in by.values() for failure in failures}) for by in found)


def _prevails(every: Sequence[Flights], won: int, lost: int) -> Verdict:
    """What holds through fewer failures than its reverse is not what the flights show."""
    return verdict(holds=won > lost, conditional=won < sum(len(flights.failures) for flights in every))


def _who(flights: Flights, found: dict[str, list[str]], others: Sequence[str], by: str) -> str:
    """Who is ahead through what; by the error with the medians, as on most draws less is not yet less by much."""
    said = [
        f"{one} through {', '.join(f'{_through(failure)}{_sized(flights, one, failure, others) if by == ERROR else str()}' for failure in won)}"
        for one, won in found.items()
        if won
    ]
    return "; ".join(said) or "nobody through any failure"


def _sized(flights: Flights, one: str, failure: str, others: Sequence[str]) -> str:
    value = flights.error(one, failure)
    medians = [error for other in others if other != one and (error := flights.error(other, failure)) is not None]
    return f" ({value:.3g} for {min(medians):.3g} {flights.unit})" if value is not None and medians else ""


def _named(failures: Sequence[str]) -> str:
    return f"through {', '.join(_through(failure) for failure in failures)}" if failures else "nowhere"


def _through(failure: str) -> str:
    """A failure's name in a sentence."""
    return "nothing failing" if failure == "none" else failure


def _table(flights: Flights) -> Listing:
    every = tuple(flights.document["failures"])

    def cell(controller: str, failure: str) -> str:
        error = flights.error(controller, failure)
        return f"{flights.lost(controller, failure)}; {'-' if error is None else f'{error:.3g}'}"

    return Listing(
        f"{flights.name}: lost flights of {flights.members}; the median RMS error [{flights.unit}], where a lost flight's is infinite",
        ("controller", *every),
        tuple((one, *(cell(one, failure) for failure in every)) for one in flights.document["lost"]),
    )


ROWS = (
    Measurement(claim, 0.1, {"adaptive-in-flight": "adaptive and linear control on a flight model that others made"}, place=370),
)


# ``flown-NAME.json`` is such a document, its blanks left out.

LINEAR_SCHEMES = ("LQR", "LQR with PI", "H-infinity", "Geometric", "Geometric, integral", "ADRC")
ADAPTIVE_SCHEMES = ("MRAC", "Robust MRAC", "L1", "L1 piecewise", "L1 piecewise, as flown")
"""As their authors call them; L1 with the piecewise-constant law is a linear controller by the row ``l1-piecewise-is-lti``."""


PREFIX, SUFFIX = "flown-", ".json"
"""Of a document's name."""
ERROR, LOSS = "less_error_than", "kept_where_lost"
"""Paired shares of the document: on how many draws the error was smaller, and on how many of those that one of both lost the
other was lost."""


@dataclass(frozen=True)
class Flights:
    """A stored document, asked questions."""

    document: dict[str, Any]

    @classmethod
    def stored(cls, name: str) -> Flights:
        """Return what is stored of a campaign of flights."""
        text = resources.files(__package__).joinpath(f"{PREFIX}{name}{SUFFIX}").read_text(encoding="utf-8")
        return cls(json.loads(text))

    @property
    def name(self) -> str:
        return str(self.document["flight"])

    @cached_property
    def linear(self) -> tuple[str, ...]:
        return tuple(one for one in LINEAR_SCHEMES if one in self.document["lost"])

    @cached_property
    def adaptive(self) -> tuple[str, ...]:
        return tuple(one for one in ADAPTIVE_SCHEMES if one in self.document["lost"])

    @property
    def unit(self) -> str:
        """The unit of the tracking error."""
        return str(self.document["units"]["rms_e"])

    @cached_property
    def members(self) -> int:
        return int(self.document["members"])

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """The failures that some controller survives."""
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
        """The shares of every two controllers through every failure by every criterion, where some draw decides."""
        found = {}
        for failure, by_controller in self.document["failures"].items():
            for (one, other), by in product(combinations(by_controller, 2), (ERROR, LOSS)):
                share = by_controller[one][by][other]
                if share is not None:
                    found[failure, one, other, by] = Share(count=share["count"], judged=share["judged"])
        return found

    @cached_property
    def signs(self) -> dict[tuple[str, str, str, str], int]:
        """The comparisons beyond chance, all of them judged together."""
        return beyond_chance(self.shares)

    def compared(self, one: str, other: str, failure: str, by: str = ERROR) -> int:
        """1 where ``one`` is better than ``other`` beyond chance on the same draws, -1 where it is worse."""
        return self.signs.get((failure, one, other, by), 0) - self.signs.get((failure, other, one, by), 0)

    def over_all(self, one: str, others: Sequence[str], by: str) -> Iterator[str]:
        """The failures through which it is better than each of these, beyond chance, a lost flight having the largest error."""
        for failure in self.failures:
            if all(self.compared(one, other, failure, by) == 1 for other in others if other != one):
                yield failure


def stored() -> tuple[str, ...]:
    """Names of the flights whose campaigns are stored."""
    files = (one.name for one in resources.files(__package__).iterdir())
    return tuple(sorted(name[len(PREFIX) : -len(SUFFIX)] for name in files if name.startswith(PREFIX) and name.endswith(SUFFIX)))
