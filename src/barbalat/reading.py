"""Reading files that a user names, within the budget: none that has no end, and none larger than the work on it allows."""

from __future__ import annotations

import stat
from pathlib import Path

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.validate import InputError

PART_BYTES = 1 << 20
"""That are asked for at once, whatever the budget allows."""


def contents(path: Path, what: str, each: Estimate) -> bytes:
    """All bytes of a file, or of a pipe up to what the budget allows.

    what  the file is in messages, such as "the case file"
    each  byte's cost, reading and what is made of it

    Raises OSError as opening does, InputError for a device and for a file that is too large.
    """
    name, state = f"{what} {str(path)!r}", path.stat()
    if stat.S_ISCHR(state.st_mode) or stat.S_ISBLK(state.st_mode):
        raise InputError(f"{name} cannot be read: it is a device, not a file")
    if stat.S_ISREG(state.st_mode):
        _require(name, state.st_size, each, f"has {state.st_size} bytes and")
    most, found = _most(each), bytearray()
    with path.open("rb") as file:  # in parts: the size of a pipe, or of what the system makes while it is read, is not known
        while len(found) <= most and (part := file.read(min(most + 1 - len(found), PART_BYTES))):
            found += part
    if len(found) > most:
        _require(name, most + 1, each, f"has more than {most} bytes and")
    return bytes(found)


def _require(name: str, size: int, each: Estimate, given: str) -> None:
    budget.require(name, size, each.times, given=given, fits=lambda n: f"at most {n} bytes", what=f"reading {name}")


def _most(each: Estimate) -> int:
    """Bytes that the budget allows."""
    limits = budget.in_force()
    return int(min(limits.memory / each.memory, limits.seconds / each.seconds))
