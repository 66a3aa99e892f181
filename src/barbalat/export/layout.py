"""The part of a sampled controller's state that an export keeps: the arrays on which its control or its estimates depend.

The last good measurement and command are always among these arrays, because they replace lost ones.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.sampling import Acting
from barbalat.lowering.operations import Program, sliced, sources
from barbalat.roles import MEANINGS, Role, leaves
from barbalat.run.kernel.sampled_controller import STATE, initial_acting
from barbalat.validate import InputError


@dataclass(frozen=True)
class StatePart:
    """One array of the state.

    name   name of the member in C
    path   path in the state, such as "controller.x_hat" or "held.x_m"
    shape  shape; C stores the array row by row
    start  index of its first entry in the flat state
    meaning  one phrase
    """

    name: str
    path: str
    shape: tuple[int, ...]
    start: int
    meaning: str

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    @property
    def rows(self) -> range:
        """The array's entries in the flat state."""
        return range(self.start, self.start + self.size)

    def entry(self, row: int) -> str:
        """C text of the entry at ``row`` of the flat state."""
        return f"c->{self.name}[{row - self.start}]"


@dataclass(frozen=True, eq=False)
class Layout:
    """The stored arrays, including those that the code around the arithmetic refers to by name.

    u          the control
    theta_hat  the estimates
    started    distinguishes the first sample from the others
    measured   the last good measurement
    r          the last good command
    """

    parts: tuple[StatePart, ...]
    u: StatePart
    theta_hat: StatePart
    started: StatePart
    measured: StatePart
    r: StatePart

    @classmethod
    def of(cls, program: Program, loop: ClosedLoop) -> Layout:
        """``program`` is the whole list of the loop's controller; parts on which nothing depends are omitted."""
        every = tuple(_parts(initial_acting(loop), {f"controller.{part.path}": part.role for part in loop.parts}))
        estimates = "" if loop.estimates is None else f"controller.{loop.estimates.path}"
        paths = ("held.u", estimates, "held.started", "held.measured", "held.r")
        none = StatePart("theta_hat", "", (0,), 0, "")  # for a controller without estimates
        named = [next((part for part in every if part.path == path), none) for path in paths]
        needed = {part.path: part for part in named}
        while True:
            rows = [row for part in needed.values() for row in part.rows]
            read = {row for argument, row in sources(sliced(program, rows)) if argument == STATE}
            found = {part.path: part for part in every if not read.isdisjoint(part.rows)}
            if found.keys() <= needed.keys():
                kept = tuple(part for part in every if part.path in needed and part.size)
                return cls(kept, *named)
            needed |= found

    @property
    def rows(self) -> list[int]:
        """All stored entries of the flat state."""
        return [row for part in self.parts for row in part.rows]

    def part(self, path: str) -> StatePart | None:
        """One array, by its path in the state; None if it is not kept."""
        return next((part for part in self.parts if part.path == path), None)

    def entries(self) -> dict[int, str]:
        """C text of the stored entries, by rows of the flat state."""
        return {row: part.entry(row) for part in self.parts for row in part.rows}


HELD = {
    "held.u": "control, held since the last sample",
    "held.measured": "measurement at the last sample",
    "held.x_m": "state of the reference model (2), exact for a held r",
    "held.r": "command at the last sample",
    "held.baseline": "the states of the baseline",
    "held.observer": "the observer: its estimate of x, or its filters; then the controls that a delay holds back",
    "held.started": "0 before the first sample, then 1",
}
"""The meanings of the members that all exported controllers share; the meanings of members that are specific to a scheme follow
from their roles."""


def _parts(initial: Acting, roles: Mapping[str, Role]) -> Iterator[StatePart]:
    """All arrays in the order of the flat state. Arrays of the scheme keep their names, and held values have a prefix."""
    found = [(path, np.shape(array)) for path, array in leaves(initial)]
    names = distinct(path.removeprefix("controller.") for path, _ in found)
    start = 0
    for name, (path, shape) in zip(names, found, strict=True):
        part = StatePart(name, path, shape, start, roles[path].comment if path in roles else HELD.get(path, MEANINGS["other"]))
        yield part
        start += part.size


LONGEST = 31
"""Number of significant characters of an identifier that every C99 compiler distinguishes, even between files (5.2.4.1)."""
LONGEST_PREFIX = LONGEST - len("_plant_s")
"""Largest length of a prefix that leaves room for the longest suffix: functions that differ only after the prefix must be
distinguishable."""

_KEYWORDS = """
    alignas alignof and asm auto bitand bitor bool break case catch char class compl concept const consteval constexpr constinit
    continue decltype default delete do double else enum explicit export extern false float for friend goto if inline int long
    mutable namespace new noexcept not nullptr operator or private protected public register requires restrict return short
    signed sizeof static struct switch template this throw true try typedef typeid typename union unsigned using virtual void
    volatile while xor controller main NAN INFINITY HUGE_VAL NULL EOF BUFSIZ SAMPLES
"""
RESERVED = frozenset(_KEYWORDS.split())
"""Keywords of C99 and C++20, macros of the included headers, and the other definitions of an export."""
MEMBERS = frozenset(
    {
        "last_u",
        "bump",
        "fade",
        "fade_left",
        "matching",
        "refused",
        "outage",
        "age",
        "command_outage",
        "advanced",
        "paused",
        "repeats",
        "parameter",
        "previous",
        "change",
    }
)
"""The members in the state of every export, see ``templates/controller.h``."""


def prefix_of(name: str) -> str:
    """The prefix of the names in an export: the controller's name in lower case, with ``_`` for characters that C does not allow.

    "Robust MRAC, T = 1 ms" becomes robust_mrac_t_1_ms. Raises InputError if the result is empty or too long.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    found = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")
    if not any(character.isalpha() for character in found):
        raise InputError(
            f"the controller's name must contain a letter from a to z, so that C identifiers can be formed from it, got "
            f"{validate.show(name)}"
        )
    if len(found) > LONGEST_PREFIX:
        raise InputError(
            f"the controller's name must have at most {LONGEST_PREFIX} letters and digits, so that C identifiers can be formed "
            f"from it, got {validate.show(name)}, which would give {found}"
        )
    return identifier(found)


def require_prefix(name: str) -> str:
    """Return a user's prefix unchanged; raises InputError if C identifiers cannot begin with it."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or identifier(name) != name:
        raise InputError(
            f"name must start with a letter, contain only letters, digits and _, and not be a C keyword, got "
            f"{validate.show(name)}"
        )
    if len(name) > LONGEST_PREFIX:
        raise InputError(f"name must have at most {LONGEST_PREFIX} characters, got {validate.show(name)}, which has {len(name)}")
    return name


def identifier(name: str) -> str:
    """A name with ``_`` for every character that C does not allow, and ``n_`` before an invalid or reserved name."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"n_{found}" if found[:1].isdigit() or found.startswith("_") or found in RESERVED else found


def distinct(names: Iterable[str]) -> list[str]:
    """The names as identifiers of members, numbered if two would be equal, or equal to a member that every export has."""
    found: list[str] = []
    for name in map(identifier, names):
        same = (f"{name}_{i}" for i in itertools.count(2))
        found.append(next(one for one in itertools.chain([name], same) if one not in found and one not in MEMBERS))
    return found
