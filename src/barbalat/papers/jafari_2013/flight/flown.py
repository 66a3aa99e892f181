"""Results of flights of random vehicles. Their rows are read from stored documents, because few users have the simulators."""

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
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.sweeps.statistics import Share, beyond_chance


def claims() -> list[Claim]:
    """Return the two rows of the ledger, computed from the stored flight documents."""
    every = [Flights.stored(name) for name in stored()]
    return [in_flight(every), l1_and_mrac(every)]


def in_flight(every: Sequence[Flights]) -> Claim:
    """Compare the adaptive schemes with the linear designs, by lost flights and by the error."""
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
                f"out of {flown} flights the adaptive schemes lose {lost} and the linear designs {of_linear}; {apart.count(1)} "
                f"of {len(apart)} failures show this order beyond chance and {apart.count(-1)} show the opposite order",
            ),
            sentence.reads(len(ahead) > len(behind), f"for {len(ahead)} failures ({_joined(ahead)}); a linear design is ahead "
            f"of every adaptive scheme for {len(behind)} ({_joined(behind)})", 1),
            _supplementary(every, "the filter helps: L1 tracks better than MRAC, which has no filter, for more failures than "
            "the reverse", "L1", "MRAC"),
            _supplementary(every, "L1 with the piecewise-constant law, a linear controller, tracks better than robust MRAC for "
            "more failures than the reverse", "L1 piecewise, as flown", "Robust MRAC"),
        ),
        shows=f"Of {flown} flights without reversed surfaces, adaptive schemes lose {lost}, linear designs {of_linear}. "
        f"Adaptive errors are significantly smaller for {len(ahead)} failures, linear for {len(behind)}.",
        measured="; ".join(
            f"{flights.name}: lost {flights.sum_lost(one)} ({one}) and {flights.sum_lost(other)} ({other}) of "
            f"{flights.members * len(flights.failures)}" for flights, one, other in sides
        ),
        how="read from a stored document, not measured by this command: " + "; ".join(_provenance(one) for one in every) + ". "
        "JSBSim's F-16 tracks a pitch-rate or a roll-rate command at 100 Hz through its actuator, limits, sensors and bus; "
        "MuJoCo's quadrotor flies a figure of eight with motor lag. "
        "The robust MRAC has " + MENDED + ". The vehicle, its initial state, its sensors and the air vary randomly. All schemes "
        "of a vehicle were tuned by one rule on its linearised nominal model: least RMS error with the same delay and gain "
        "margins. L1 with the piecewise-constant law counts as linear, as the row l1-piecewise-is-lti shows. The counts "
        "exclude reversed control surfaces, which lose nearly every flight, and include flights without a failure (none). "
        "'Beyond chance' refers to the exact sign test on the same draws, at 95 % for all comparisons of a vehicle together "
        "(Holm). Tests repeat some of the flights if the simulators are installed",
        listings=tuple(_table(one) for one in every),
        would_change="a different vehicle, margin, command or rule; linear designs made with knowledge of the faults",
    )  # fmt: skip


def l1_and_mrac(every: Sequence[Flights]) -> Claim:
    """Compare the errors of L1 with the filter and of MRAC on the same draws, for the quadrotor and for the F-16."""
    sentence = SENTENCES["l1-mrac-in-flight"]
    sides = [[one for one in every if one.name == QUADROTOR], [one for one in every if one.name != QUADROTOR]]
    found = [(_failures(some, "L1", "MRAC", 1), _failures(some, "L1", "MRAC", -1)) for some in sides]
    (quadrotor,), (ahead, behind), (f16_ahead, f16_behind) = sides[0], *found
    nominal = [quadrotor.error(name, "none") for name in ("L1", "MRAC")]
    return Claim(
        sentence=sentence,
        readings=tuple(
            sentence.reads(len(better) > len(worse), f"less error for {_joined(better)}; more for {_joined(worse)}", part)
            for part, (better, worse) in enumerate(found)
        ),
        shows=f"L1-AC's error is smaller than MRAC's for {len(ahead)} failures and larger for {len(behind)} on the quadrotor; on "
        f"the F-16 these numbers are {len(f16_ahead)} and {len(f16_behind)}.",
        measured=f"on the quadrotor without a failure the median RMS error of L1-AC is {nominal[0]:.3g} and that of MRAC "
            f"{nominal[1]:.3g} {quadrotor.unit}. Among {sum(len(one.failures) for one in every)} failures L1-AC's error "
            f"is smaller beyond chance for {len(ahead) + len(f16_ahead)}, and larger for {len(behind) + len(f16_behind)}",
        how="read from stored documents, not measured by this command: " + "; ".join(_provenance(one) for one in every) + ". "
        "Flights without a failure (none) are counted too; reversed surfaces are not. L1-AC is state feedback with the filter "
        "(6), "
        "whose kappa is tuned like the gains. The studies of Ref. 24 and their flight platform are not available",
        listings=tuple(_table(one) for one in every),
        would_change="a different vehicle, as the two readings show; a different tuning rule, or a second-order filter (two "
        "slopes)",
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
    """Return the adaptive scheme and the linear scheme that lose the fewest flights."""
    adaptive, linear = (min(names, key=flights.sum_lost) for names in (flights.adaptive, flights.linear))
    return adaptive, linear


def _through(every: Sequence[Flights], by: str) -> tuple[list[str], list[str]]:
    """Return the failures for which some adaptive scheme is significantly better than every linear one, and the failures for
    which the reverse holds."""

    def found(one_side: str, other: str) -> list[str]:
        return [
            f"{flights.name}: {failure}"
            for flights in every
            for failure in flights.failures
            if any(failure in flights.over_all(one, getattr(flights, other), by) for one in getattr(flights, one_side))
        ]

    return found("adaptive", "linear"), found("linear", "adaptive")


def _supplementary(every: Sequence[Flights], says: str, one: str, other: str) -> Reading:
    """Compare two schemes by their errors. This does not decide the sentence."""
    better, worse = (_failures(every, one, other, sign) for sign in (1, -1))
    return Reading(says, len(better) > len(worse), f"less error for {_joined(better)}; more for {_joined(worse)}", "beside")


def _failures(every: Sequence[Flights], one: str, other: str, sign: int) -> list[str]:
    """Return the failures for which ``one`` has significantly less error than ``other``, or more for the sign -1."""
    return [f"{flights.name}: "
    f"{failure}" for flights in every for failure in flights.failures if flights.compared(one, other, failure) == sign]  # fmt: skip


def _joined(failures: Sequence[str]) -> str:
    return ", ".join(failures) or "none"


def _table(flights: Flights) -> Listing:
    every = tuple(flights.document["failures"])

    def cell(controller: str, failure: str) -> str:
        error = flights.error(controller, failure)
        return f"{flights.lost(controller, failure)}; {'-' if error is None else f'{error:.3g}'}"

    return Listing(
        f"{flights.name}: lost flights of {flights.members}; the median RMS error [{flights.unit}], with an infinite error for "
        f"a lost flight",
        ("controller", *every),
        tuple((one, *(cell(one, failure) for failure in every)) for one in flights.document["lost"]),
    )


ROWS = (
    Measurement(
        claims,
        0.1,
        {
            "adaptive-in-flight": "adaptive and linear control on third-party flight models",
            "l1-mrac-in-flight": "L1-AC compared with MRAC in flight, on a quadrotor and an F-16",
        },
        place=370,
    ),
)


# ``flown-NAME.json`` is such a document without white space.

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
"""The linear controllers. They include L1 with the piecewise-constant law, which is linear by the row
``l1-piecewise-is-lti``."""
ADAPTIVE_SCHEMES = ("MRAC", "Robust MRAC", "L1")
QUADROTOR = "quadrotor"
REVERSED = "reversed"
"""The failure that every count excludes. The control surface moves the wrong way, and nearly every flight is lost with any
controller."""


PREFIX, SUFFIX = "flown-", ".json"
"""The beginning and the end of a document's name."""
ERROR, LOSS = "less_error_than", "kept_where_lost"
"""Names of the document's paired fractions: draws with a smaller error, and draws that only one of the two loses."""


@dataclass(frozen=True)
class Flights:
    """A stored document, with queries on it."""

    document: dict[str, Any]

    @classmethod
    def stored(cls, name: str) -> Flights:
        """Return the stored document of a campaign of flights."""
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
        """The failures that are evaluated: all that some controller survives, except reversed surfaces."""
        every = self.document["failures"]
        return tuple(
            one for one, found in every.items() if one != REVERSED and any(flown["lost"]["count"] < self.members for flown in found.values())
        )  # fmt: skip

    def sum_lost(self, controller: str) -> int:
        """Return the number of flights that the controller loses, over all evaluated failures."""
        return sum(self.lost(controller, failure) for failure in self.failures)

    def lost(self, controller: str, failure: str) -> int:
        return int(self.document["failures"][failure][controller]["lost"]["count"])

    def error(self, controller: str, failure: str) -> float | None:
        value = self.document["failures"][failure][controller]["rms_e"]["median"]
        return None if value is None else float(value)

    @cached_property
    def shares(self) -> dict[tuple[str, str, str, str], Share]:
        """The fractions of every pair of controllers for every failure and every criterion on which at least one draw decides."""
        found = {}
        for failure, by_controller in self.document["failures"].items():
            for (one, other), by in product(combinations(by_controller, 2), (ERROR, LOSS)):
                share = by_controller[one][by][other]
                if share is not None:
                    found[failure, one, other, by] = Share(count=share["count"], judged=share["judged"])
        return found

    @cached_property
    def signs(self) -> dict[tuple[str, str, str, str], int]:
        """The significant comparisons, judged jointly."""
        return beyond_chance(self.shares)

    def compared(self, one: str, other: str, failure: str, by: str = ERROR) -> int:
        """Return 1 if ``one`` is significantly better than ``other`` on the same draws, -1 if it is worse, else 0."""
        return self.signs.get((failure, one, other, by), 0) - self.signs.get((failure, other, one, by), 0)

    def over_all(self, one: str, others: Sequence[str], by: str) -> Iterator[str]:
        """Yield the failures for which ``one`` is significantly better than each of the others. A lost flight has the largest
        error."""
        for failure in self.failures:
            if all(self.compared(one, other, failure, by) == 1 for other in others if other != one):
                yield failure


def stored() -> tuple[str, ...]:
    """Return the names of the flights whose campaigns are stored."""
    files = (one.name for one in resources.files(__package__).iterdir())
    return tuple(sorted(name[len(PREFIX) : -len(SUFFIX)] for name in files if name.startswith(PREFIX) and name.endswith(SUFFIX)))
