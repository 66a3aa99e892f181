"""What flights of drawn vehicles came to: the one row that is read and not measured, for the simulators are not everybody's."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from itertools import combinations, product
from typing import Any

from barbalat.papers.claim import Claim, Listing, Measurement
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.sweeps.statistics import Share, beyond_chance


def claims() -> list[Claim]:
    """Both rows, from the documents."""
    every = [Flights.stored(name) for name in stored()]
    return [in_flight(every), ref_24(next(flights for flights in every if flights.name == "quadrotor"), every)]


def in_flight(every: Sequence[Flights]) -> Claim:
    """The adaptive schemes beside the linear designs: by the flights that they lose, and by the error."""
    sides = [(flights, *_fewest(flights)) for flights in every]
    lost, of_linear, flown = (
        sum(flights.sum_lost(one) for flights, one, _ in sides),
        sum(flights.sum_lost(other) for flights, _, other in sides),
        sum(flights.members * len(flights.failures) for flights in every),
    )
    apart = [flights.compared(one, other, failure, LOSS) for flights, one, other in sides for failure in flights.failures]
    ahead, behind = _through(every, ERROR)
    sentence = SENTENCES["adaptive-in-flight"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(
                lost < of_linear and 1 in apart and -1 not in apart,
                f"lost of {flown}: {lost} and {of_linear}; of {len(apart)} failures {apart.count(1)} keep them apart beyond chance, {apart.count(-1)} the other way round",
            ),
            sentence.reads(len(ahead) > len(behind), f"through {len(ahead)} failures ({_joined(ahead)}); a linear design ahead of every adaptive scheme through {len(behind)} ({_joined(behind)})", 1),
            _beside(every, "the filter: L1 follows better than MRAC, which has none, through more failures than the reverse", "L1", "MRAC"),
            _beside(every, "L1 with the piecewise-constant law, a linear controller, follows better than robust MRAC, through more failures than the reverse", "L1 piecewise, as flown", "Robust MRAC"),
        ),
        shows=f"Flights lost, reversed surfaces apart: adaptive {lost}, linear {of_linear} of {flown}. Less error beyond chance: adaptive through {len(ahead)} failures, linear through {len(behind)}.",
        measured="; ".join(
            f"{flights.name}: lost {flights.sum_lost(one)} ({one}) and {flights.sum_lost(other)} ({other}) of {flights.members * len(flights.failures)}" for flights, one, other in sides
        ),
        how="read, not measured by this command: " + "; ".join(_provenance(one) for one in every) + ". JSBSim's F-16 follows a pitch-rate or a roll-rate command "
        "at 100 Hz through its actuator, limits, sensors and bus; MuJoCo's quadrotor flies a figure of eight with motors that lag. Draws are of the vehicle, its start, "
        "its sensors and the air. All schemes of a flight were tuned by one rule on the linearised nominal vehicle: least RMS error with the same delay and gain "
        "margins. L1 with the piecewise-constant law counts as linear, as l1-piecewise-is-lti finds. Reversed control surfaces, of which nearly every flight is lost, are left out of the counts, in which flights without a failure, none, stand beside the others. Beyond "
        "chance is by the exact sign test on the same draws, at 95 % for all comparisons of a flight together (Holm). Tests fly draws again where the simulators are installed",
        listings=tuple(_table(one) for one in every),
        would_change="another vehicle, margin, command or rule; faults that were known when the linear designs were made",
    )  # fmt: skip


def ref_24(quadrotor: Flights, every: Sequence[Flights]) -> Claim:
    """L1 with the filter and MRAC, by the error of the same draws."""
    sentence = SENTENCES["ref-24-in-flight"]
    better = [failure for failure in quadrotor.failures if quadrotor.compared("L1", "MRAC", failure) == 1]
    nominal = [quadrotor.error(name, "none") for name in ("L1", "MRAC")]
    others = [flights for flights in every if flights is not quadrotor]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(not better, f"L1-AC has less error through {len(better)} of {len(quadrotor.failures)}: {', '.join(better) or 'none'}"),
            _beside(others, "on the other flights L1 follows better than MRAC, through more failures than the reverse", "L1", "MRAC"),
        ),
        shows=f"On our quadrotor L1-AC has less error than the MRAC through {len(better)} of {len(quadrotor.failures)} failures: {nominal[0]:.2g} for {nominal[1]:.2g} {quadrotor.unit} with none.",
        measured=f"median RMS error with nothing failing: L1-AC {nominal[0]:.3g}, MRAC {nominal[1]:.3g} {quadrotor.unit}; less error beyond chance through {', '.join(better) or 'none'}",
        how=f"read, not measured by this command: {_provenance(quadrotor)}. Flights without a failure, none, are counted too. The studies of Ref. 24 themselves, and their flight platform, are not at hand",
        listings=(_table(quadrotor),),
        would_change="another vehicle, as reading 2 shows; another rule of tuning",
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


def _fewest(flights: Flights) -> tuple[str, str]:
    """The adaptive and the linear scheme that lose the fewest flights."""
    adaptive, linear = (min(names, key=flights.sum_lost) for names in (flights.adaptive, flights.linear))
    return adaptive, linear


def _through(every: Sequence[Flights], by: str) -> tuple[list[str], list[str]]:
    """The failures through which some adaptive scheme is better than every linear one beyond chance, and the reverse."""

    def found(one_side: str, other: str) -> list[str]:
        return [
            f"{flights.name}: {failure}"
            for flights in every
            for failure in flights.failures
            if any(failure in flights.over_all(one, getattr(flights, other), by) for one in getattr(flights, one_side))
        ]

    return found("adaptive", "linear"), found("linear", "adaptive")


def _beside(every: Sequence[Flights], says: str, one: str, other: str) -> Reading:
    """Two schemes by their errors, which does not decide the sentence."""
    better, worse = (
        [f"{flights.name}: {failure}" for flights in every for failure in flights.failures if flights.compared(one, other, failure) == sign]
        for sign in (1, -1)
    )  # fmt: skip
    return Reading(
        says, len(better) > len(worse), f"less error through {_joined(better)}; more through {_joined(worse)}", "beside"
    )


def _joined(failures: Sequence[str]) -> str:
    return ", ".join(failures) or "none"


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
    Measurement(
        claims,
        0.1,
        {
            "adaptive-in-flight": "adaptive and linear control on a flight model that others made",
            "ref-24-in-flight": "L1-AC beside the MRAC on the quadrotor",
        },
        place=370,
    ),
)


# ``flown-NAME.json`` is such a document, its blanks left out.

LINEAR_SCHEMES = (
    "LQR",
    "LQR with PI",
    "H-infinity",
    "Geometric",
    "Geometric, integral",
    "ADRC",
    "L1 piecewise",
    "L1 piecewise, as flown",
)
"""L1 with the piecewise-constant law among them: by the row ``l1-piecewise-is-lti`` it is a linear controller."""
ADAPTIVE_SCHEMES = ("MRAC", "Robust MRAC", "L1")
REVERSED = "reversed"
"""The failure that is left out of every count: the control surface moves the wrong way, and nearly every flight is lost whoever flies."""


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
        """The failures that are counted: those that some controller survives, but for a reversed surface."""
        every = self.document["failures"]
        return tuple(
            one for one, found in every.items() if one != REVERSED and any(flown["lost"]["count"] < self.members for flown in found.values())
        )  # fmt: skip

    def sum_lost(self, controller: str) -> int:
        """Its lost flights over all failures that are counted."""
        return sum(self.lost(controller, failure) for failure in self.failures)

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
