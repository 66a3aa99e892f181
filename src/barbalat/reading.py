"""Reads files that a user names within the budget; rejects endless files and files that are too large for the work on them."""

from __future__ import annotations

import contextlib
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.validate import InputError, counted

PART_BYTES = 1 << 20
"""Number of bytes requested at once, whatever the budget allows."""
WAITED_SECONDS = 3.0
"""Time [s] after which the user is told what the program is waiting for; longer than a disk takes."""


def contents(path: Path, what: str, each: Estimate) -> bytes:
    """All bytes of a file, or of a pipe up to what the budget allows.

    Like every program that reads a pipe, the function waits for the pipe's writer, which may be about to start. The user is told
    about the wait (see ``Budget.told``).

    what  how messages name the file, such as "the case file"
    each  the cost of reading and processing one byte

    Raises OSError if the file cannot be opened, and InputError for a device or for a file that is too large.
    """
    name, state = f"{what} {str(path)!r}", path.stat()
    if stat.S_ISCHR(state.st_mode) or stat.S_ISBLK(state.st_mode):
        raise InputError(f"{name} cannot be read: it is a device, not a file")
    if stat.S_ISREG(state.st_mode):
        _require(name, state.st_size, each, f"has {state.st_size} bytes and")
    limits, found = budget.in_force(), bytearray()
    most = int(min(limits.memory / each.memory, limits.seconds / each.seconds))
    # in parts as they arrive: the size of a pipe, or of a file that the system generates while it is read, is unknown
    with _announced(name, found), path.open("rb", 0) as file:
        while len(found) <= most and (part := file.read(min(most + 1 - len(found), PART_BYTES))):
            found += part
    if len(found) > most:
        _require(name, most + 1, each, f"has more than {most} bytes and")
    return bytes(found)


@contextlib.contextmanager
def _announced(name: str, found: bytearray) -> Iterator[None]:
    """If reading takes more than a few seconds, report what the program is waiting for and how much has arrived."""
    told = budget.in_force().told
    if told is None:
        yield
        return

    def tell() -> None:
        here = f"{counted(len(found), 'byte')} of it received" if found else "nothing received yet"
        told(f"waiting for {name}: {here}; Ctrl-C ends the wait")

    timer = threading.Timer(WAITED_SECONDS, tell)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _require(name: str, size: int, each: Estimate, given: str) -> None:
    budget.require(name, size, each.times, given=given, fits=lambda n: f"at most {counted(n, 'byte')}", what=f"reading {name}")
