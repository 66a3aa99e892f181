"""What a campaign asks of a flight: what is drawn of its vehicles, and how all schemes fly one draw through all failures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from barbalat.flight.compared import Failing
from barbalat.flight.timing import Timing
from barbalat.open_numbers.path import FieldPath
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.spread import Uniform

SEED = 2013
KEPT = ("lost_at", "rms_e", "max_abs_e", "travel")
"""Figures of each flight."""
Draw = Mapping[str, float]
"""What is drawn of one vehicle, by names."""
Flying = Iterator[tuple[str, str, Mapping[str, float | None]]]
"""Controller, failure and at least the figures ``KEPT`` of each flight."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fleet(ABC):
    """One flight's schemes and failures, ready to fly: the vehicle is trimmed, the schemes are traced.

    It is pickled into the processes that fly.
    """

    failures: tuple[Failing, ...]

    @property
    @abstractmethod
    def controllers(self) -> tuple[str, ...]:
        """The names of the controllers that fly."""

    @property
    @abstractmethod
    def conditions(self) -> tuple[str, ...]:
        """Where the draws fly, in turns."""

    @abstractmethod
    def described(self) -> list[dict[str, object]]:
        """The failures, as a store is told from another by."""

    @abstractmethod
    def contents(self) -> Iterator[bytes]:
        """All that flights follow from beside the draws, the failures and the simulator."""

    @abstractmethod
    def flying(self) -> Callable[[Draw, int], Flying]:
        """How a draw and its number are flown, by every controller through every failure; made once in a process."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """What is drawn of a flight's vehicles, how long these flights are, and the words for what comes out.

    drawn       from what each number is drawn, by its name
    units       of these; the others are factors of what is nominal
    simulator   the package
    error_unit  of RMS e
    moved       what ``travel`` is of, in a word, and its unit
    beside      the scheme with which all are compared where it flies, and a short name for it
    set_by      the rule that set the schemes' numbers
    numbers     these, as a document has them
    prepare     schemes and failures by names, all for None, to what flies; InputError for what is none
    chunk       flights that a process flies before their rows are kept, half a minute's
    """

    drawn: Mapping[str, Uniform]
    units: Mapping[str, str]
    timing: Timing
    simulator: str
    error_unit: str
    moved: tuple[str, str]
    beside: tuple[str, str]
    set_by: str
    numbers: Mapping[str, object]
    prepare: Callable[[Sequence[str] | None, Sequence[str] | None], Fleet]
    chunk: int

    def plan(self, members: int, seed: int = SEED) -> Plan:
        """Independent draws, so that the intervals of shares are exact."""
        draws = {FieldPath(("dispersion", name)): one for name, one in self.drawn.items()}
        return Plan(draws=draws, members=members, design=Design.RANDOM, seed=seed)


def draws_of(plan: Plan, first: int, count: int) -> Iterator[tuple[int, Draw]]:
    """Members from number ``first`` on, each with its number."""
    names = [str(path.keys[1]) for path in plan.paths]
    for number, row in enumerate(plan.values(first, count).tolist(), start=first):
        yield number, dict(zip(names, row, strict=True))
