"""Compares the simulated plant ([truth]) with the assumptions of certificates: some guarantees may not hold for that plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from barbalat.certificates.assumptions import unmet_by
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certificates import column_of
from barbalat.certificates.entry import OF_THE_DESIGN, Entry, of_the_design, speaks_of_the_motion
from barbalat.problem.departures import Departure, apart_sentence, departures, sets_and_truth, true_parameters
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller

Compute = Callable[[TrackingProblem, Controller], Certificate]
"""A controller's certificate on a problem."""


@dataclass(frozen=True)
class Apart:
    """The effect of the truth of a case on its certificates.

    departures  the differences from the plant and the declared sets
    claimed     keyed by controller: whether the design has any guarantee about the motion
    voids       keyed by controller: the keys whose guarantees don't hold for the simulated plant
    cells       keyed by controller: the cells of Table 1 that don't hold for it
    """

    departures: tuple[Departure, ...]
    claimed: Mapping[str, bool]
    voids: Mapping[str, tuple[str, ...]]
    cells: Mapping[str, tuple[str, ...]]

    @property
    def sentence(self) -> str:
        """The differences between truth and design; empty if there are none."""
        return apart_sentence(self.departures)

    def note(self, name: str) -> str:
        """The consequence for one controller; empty if its design has no guarantee about the motion."""
        if not self.claimed[name]:
            return ""
        rows = ", ".join(PROPERTIES[key] for key in self.cells[name])
        voided = [", ".join(self.voids[name]), rows and f"in Table 1 {rows}"]
        if any(voided):
            return f"the simulated plant ([truth]) invalidates these guarantees of the design: {'; '.join(filter(None, voided))}"
        return "the simulated plant ([truth]) invalidates no guarantee about the motion"

    def as_json(self) -> dict[str, Any]:
        """The differences and, by controller, the keys that they void."""
        return {
            "departures": [one.as_json() for one in self.departures],
            "voids": {name: list(keys) for name, keys in self.voids.items()},
        }


def apart(
    problem: TrackingProblem, controllers: Sequence[Controller], certificates: Mapping[str, Certificate], compute: Compute
) -> Apart | None:
    """The check of a problem's truth; None if the simulated plant is the design plant.

    A simulated plant outside the declared sets voids every guarantee about the motion. Its theta and gain may be inside the sets
    but differ from those of the design. A guarantee then remains valid if the certificate for the simulated plant guarantees the
    same value, because the value was computed for the whole set.
    """
    if not isinstance(problem, Problem) or problem.simulated is None:
        return None
    found = tuple(departures(problem))
    guaranteed: dict[str, bool] = {}
    voids: dict[str, tuple[str, ...]] = {}
    cells: dict[str, tuple[str, ...]] = {}
    for controller in controllers:
        claimed = _claims(problem.design, controller, certificates[controller.name])
        guaranteed[controller.name] = any(claimed)
        kept = claimed if not found else _Claims({}, {})
        if found and any(claimed) and all(one.within for one in found):
            moved = _at_the_truth(problem)
            kept = _claims(moved, controller, compute(moved, controller))
        voids[controller.name], cells[controller.name] = map(_missing_in, kept, claimed)
    return Apart(found, guaranteed, voids, cells)


class _Claims(NamedTuple):
    """The guarantees about the motion, by key."""

    entries: dict[str, Any]
    cells: dict[str, Any]


def _claims(problem: Problem, controller: Controller, certificate: Certificate) -> _Claims:
    cells = column_of(problem, controller, certificate).cells.values()
    return _Claims(*({one.key: one.value for one in part if speaks_of_the_motion(one)} for part in (certificate.entries, cells)))


def _missing_in(kept: Mapping[str, Any], claimed: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(key for key, value in claimed.items() if kept.get(key) != value)


def _at_the_truth(problem: Problem) -> Problem:
    """The design with the theta and gains of the simulated plant."""
    values, design = true_parameters(problem), problem.design
    assert values is not None
    p = len(problem.plant.theta)
    plant = replace(design.plant, theta=values[:p])
    moved = replace(design, plant=plant)
    vars(moved)["derived"] = problem.derived
    gains = iter(values[p:].tolist())
    return moved if problem.input_gain is None else moved.with_inputs(lambda path: replace(path, gain=next(gains)))


def further_blocks(problem: TrackingProblem, found: Apart | None) -> dict[str, Any]:
    """The blocks of the JSON document besides the certificates: the sets derived from ranges of parameters, and the check of the
    simulated plant."""
    return sets_and_truth(problem) | ({} if found is None else {"truth": found.as_json()})


FAULTS_NOTE = (
    "the case has faults: all numbers are for the loop without faults, in which every sample arrives as it was measured; with "
    "faults nothing is guaranteed"
)
SHELL_NOTE = (
    "the case has a [shell]: all guarantees are for the loop in which the shell rejects no sample; nothing is guaranteed from "
    "the first rejected sample on"
)


def _claims_more(entry: Entry) -> bool:
    return entry.kind == OF_THE_DESIGN or speaks_of_the_motion(entry)


def with_notes(problem: TrackingProblem, certificates: Mapping[str, Certificate], found: Apart | None) -> dict[str, Certificate]:
    """The certificates with notes. Guarantees that the simulated plant voids are marked as guarantees for the design; the notes
    explain this and the derived sets."""
    derived = problem.derived if isinstance(problem, Problem) else None
    shared = [] if derived is None else list(derived.sentences)
    if problem.faults:
        shared.append(FAULTS_NOTE)
    if problem.shell is not None:
        shared.append(SHELL_NOTE)
    if found is not None and found.sentence:
        shared.append(found.sentence)
    noted = {}
    for name, certificate in certificates.items():
        own = [note] if found is not None and found.departures and (note := found.note(name)) else []
        voided = () if found is None else found.voids[name]
        entries = tuple(of_the_design(one) if one.key in voided else one for one in certificate.entries)
        for unmet in unmet_by(problem):
            entries = tuple(of_the_design(one, unmet) if _claims_more(one) else one for one in entries)
        noted[name] = certificate.with_entries(_with_units(problem, entries), *shared, *own)
    return noted


OF_STATES = frozenset(
    {
        "error_bound",
        "error_bound_worst",
        "error_bound_command",
        "error_bound_held",
        "error_rms_bound",
        "state_bound",
        "reference_error_bound",
        "reference_distance",
        "reference_distance_between",
    }
)
"""The keys of values that are one number for every component of a state."""


def _with_units(problem: TrackingProblem, entries: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """The entries with the declared units of the states; none if the state also contains those of a baseline."""
    labels = problem.labels
    if labels is None or len(labels.units) != len(problem.model.x0):
        return entries
    unit = labels.every_unit[1:-1]
    return tuple(replace(one, quantity=one.quantity._replace(unit=unit)) if one.key in OF_STATES else one for one in entries)
