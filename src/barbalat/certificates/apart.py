"""The truth held against what certificates rest on: which of their guarantees do not speak of what is simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import NUMBERS_ALONE, Entry
from barbalat.problem.departures import Departure, departures, true_parameters
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller

Compute = Callable[[TrackingProblem, Controller], Certificate]
"""A controller's certificate on a problem."""


def speaks_of_the_motion(entry: Entry) -> bool:
    """A norm or a condition follows from the case's numbers alone, and no run can contradict it."""
    return entry.kind == "guaranteed" and entry.value is not None and entry.rests_on != (NUMBERS_ALONE,)


@dataclass(frozen=True)
class Apart:
    """What a case's truth means for its certificates.

    departures  from the plant and the declared sets
    voids       by controllers the keys whose guarantees do not speak of the truth
    """

    departures: tuple[Departure, ...]
    voids: Mapping[str, tuple[str, ...]]

    @property
    def sentence(self) -> str:
        """Where the truth departs from the design; empty where it does not."""
        return apart_sentence(self.departures)

    def note(self, name: str) -> str:
        """What that means for one controller."""
        keys = self.voids[name]
        if keys:
            return f"of what is guaranteed of the design, {', '.join(keys)} do{'es' * (len(keys) == 1)} not speak of the truth"
        return "nothing that is guaranteed of the motion is voided by the truth"

    def as_json(self) -> dict[str, Any]:
        """The differences and, by controllers, the keys that they void."""
        return {
            "departures": [{"sentence": one.sentence, "within": one.within} for one in self.departures],
            "voids": {name: list(keys) for name, keys in self.voids.items()},
        }


def apart_sentence(found: Sequence[Departure]) -> str:
    """One sentence on all differences."""
    return f"the truth departs from the design: {'; '.join(one.sentence for one in found)}" if found else ""


def apart(
    problem: TrackingProblem, controllers: Sequence[Controller], certificates: Mapping[str, Certificate], compute: Compute
) -> Apart | None:
    """The check of a problem's truth; None where nothing is simulated apart from the plant.

    What lies outside the declared sets voids every guarantee of the motion. Where theta and the gain lie in the sets, but not
    where the plant's are, a guarantee stays if the same certificate for the truth's numbers guarantees the same value: it was
    computed for the whole set.
    """
    if not isinstance(problem, Problem) or problem.simulated is None:
        return None
    found = tuple(departures(problem))
    voids: dict[str, tuple[str, ...]] = {}
    for controller in controllers:
        certificate = certificates[controller.name]
        claimed = [entry for entry in certificate.entries if speaks_of_the_motion(entry)]
        if all(one.within for one in found):
            kept = _values(compute(_at_the_truth(problem), controller)) if found and claimed else _values(certificate)
            voids[controller.name] = tuple(one.key for one in claimed if kept.get(one.key) != one.value)
        else:
            voids[controller.name] = tuple(one.key for one in claimed)
    return Apart(found, voids)


def _values(certificate: Certificate) -> dict[str, Any]:
    return {entry.key: entry.value for entry in certificate.entries if speaks_of_the_motion(entry)}


def _at_the_truth(problem: Problem) -> Problem:
    """The design with the truth's theta and gains as the plant's own."""
    values, design = true_parameters(problem), problem.design
    assert values is not None
    p = len(problem.plant.theta)
    plant = replace(design.plant, theta=values[:p])
    moved = replace(design, plant=plant)
    vars(moved)["derived"] = problem.derived
    gains = iter(values[p:].tolist())
    return moved if problem.input_gain is None else moved.with_inputs(lambda path: replace(path, gain=next(gains)))


def beside(problem: TrackingProblem, found: Apart | None) -> dict[str, Any]:
    """What stands beside certificates in JSON: what ranges of parameters were turned into, and the check of the truth."""
    derived = problem.derived if isinstance(problem, Problem) else None
    document = {} if derived is None else {"derived": derived.as_json()}
    return document if found is None else document | {"truth": found.as_json()}


def with_notes(problem: TrackingProblem, certificates: Mapping[str, Certificate], found: Apart | None) -> dict[str, Certificate]:
    """The certificates with what was derived from ranges and what the truth voids, as notes."""
    derived = problem.derived if isinstance(problem, Problem) else None
    shared = [] if derived is None else list(derived.sentences)
    if found is not None and found.sentence:
        shared.append(found.sentence)
    noted = {}
    for name, certificate in certificates.items():
        own = [found.note(name)] if found is not None and found.departures else []
        noted[name] = certificate.with_entries(certificate.entries, *shared, *own) if shared or own else certificate
    return noted
