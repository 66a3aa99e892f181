"""Names of controllers, of states and of quantities as identifiers of C and C++."""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Iterable

from barbalat import validate
from barbalat.validate import InputError

LONGEST = 31
"""Characters of an identifier that every C99 compiler tells apart, also between files (5.2.4.1)."""
LONGEST_PREFIX = LONGEST - len("_plant_s")
"""With this behind it functions that differ only then are still told apart."""

_KEYWORDS = """
    alignas alignof and asm auto bitand bitor bool break case catch char class compl concept const consteval constexpr constinit
    continue decltype default delete do double else enum explicit export extern false float for friend goto if inline int long
    mutable namespace new noexcept not nullptr operator or private protected public register requires restrict return short
    signed sizeof static struct switch template this throw true try typedef typeid typename union unsigned using virtual void
    volatile while xor controller main NAN INFINITY HUGE_VAL NULL EOF BUFSIZ SAMPLES
"""
RESERVED = frozenset(_KEYWORDS.split())
"""Keywords of C99 and C++20, macros of the headers that are included, and what an export defines beside them."""
MEMBERS = frozenset({"sample_time", "last_u", "bump", "fade", "fade_left", "matching", "parameter"})
"""What the state of every export has, see ``templates/controller.h``."""


def prefix_of(name: str) -> str:
    """What an export's names begin with: the controller's name in small letters, and ``_`` for what C has no letter for.

    "Robust MRAC, T = 1 ms" becomes robust_mrac_t_1_ms. InputError where nothing is left of a name, or too much.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    found = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")
    if not any(character.isalpha() for character in found):
        raise InputError(
            f"the controller's name must have a letter from a to z, of which C makes identifiers, got {validate.show(name)}"
        )
    if len(found) > LONGEST_PREFIX:
        raise InputError(
            f"the controller's name must have at most {LONGEST_PREFIX} letters and digits for identifiers of C, "
            f"got {validate.show(name)}, of which {found} would be made"
        )
    return identifier(found)


def identifier(name: str) -> str:
    """A name with ``_`` for every character that C does not take, and ``n_`` before what can't stand alone or is reserved."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"n_{found}" if found[:1].isdigit() or found.startswith("_") or found in RESERVED else found


def distinct(names: Iterable[str]) -> list[str]:
    """The names as identifiers of members, numbered where two would be the same, or one that every export has."""
    found: list[str] = []
    for name in map(identifier, names):
        same = (f"{name}_{i}" for i in itertools.count(2))
        found.append(next(one for one in itertools.chain([name], same) if one not in found and one not in MEMBERS))
    return found
