"""MATLAB files: their variables, and which of them are times and values."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.reading import contents
from barbalat.validate import Array, InputError

TIMES = ("t", "time", "times", "tout")
"""What times are called in MATLAB files, Simulink's among them."""


def variables(path: Path) -> dict[str, Array]:
    """The numbers in a file by their names: a field of a structure as "name.field"; InputError for what is no such file."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        packed = contents(path, "the data file", FILE_BYTE)
        _require_room(path, _unpacked(packed))
        found = loadmat(cast("Any", BytesIO(packed)), appendmat=False)  # which its stubs do not know
    except InputError:
        raise
    except (MemoryError, OverflowError):
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: an array in it has no room") from None
    except NotImplementedError:
        raise InputError(f"{path} is a MATLAB file of version 7.3; save it with save(..., '-v7')") from None
    except OSError as error:
        reason = error.strerror or "it is no MATLAB file"
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
    except (MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, zlib.error, struct.error):
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: it is no MATLAB file") from None
    return {name: one for key, value in found.items() if not key.startswith("__") for name, one in _numbers(key, value)}


FILE_BYTE = Estimate(memory=20.0, seconds=2e-7)
"""Of what a MATLAB file holds, unpacked: a number alone in a cell takes 56 bytes there and some 20 times as much here."""
HEADER_BYTES, TAG_BYTES, COMPRESSED = 128, 8, 15
"""Of a file of version 5, of what stands before each of its parts, and the type of a compressed one."""
SHAPE_AT = 16
"""Bytes into a variable, after its kind, where its shape stands."""
PIECE_BYTES = 2**20


def _unpacked(packed: bytes) -> int:
    """Bytes that a file's variables take when they are no longer compressed, found without keeping them.

    A variable counts with what it says that it holds, where that is more. What is no such file is left to who reads it.
    """
    order = {b"IM": "<", b"MI": ">"}.get(packed[HEADER_BYTES - 2 : HEADER_BYTES])
    if order is None:
        return len(packed)
    total, place = 0, HEADER_BYTES
    while place + TAG_BYTES <= len(packed):
        kind, size = struct.unpack_from(f"{order}II", packed, place)
        part, place = packed[place + TAG_BYTES : place + TAG_BYTES + size], place + TAG_BYTES + size
        head, inside = (part[:PIECE_BYTES], len(part)) if kind != COMPRESSED else _inflated(part)
        total += max(inside, _claimed(head, order))
    return total


def _inflated(part: bytes) -> tuple[bytes, int]:
    """The beginning of a compressed variable, after its tag, and all of its bytes."""
    stream, total, head = zlib.decompressobj(), 0, b""
    while part and not stream.eof:
        piece = stream.decompress(part, PIECE_BYTES)
        if not piece:
            break  # it is cut short
        part, total, head = stream.unconsumed_tail, total + len(piece), head or piece[TAG_BYTES:]
    return head, total


def _claimed(head: bytes, order: str) -> int:
    """Bytes of as many floats as a variable's shape says."""
    if len(head) < SHAPE_AT + TAG_BYTES:
        return 0
    _, size = struct.unpack_from(f"{order}II", head, SHAPE_AT)
    count = min(size, len(head) - SHAPE_AT - TAG_BYTES) // 4
    shape: tuple[int, ...] = struct.unpack_from(f"{order}{count}I", head, SHAPE_AT + TAG_BYTES)
    return 8 * math.prod(shape)


def _require_room(path: Path, size: int) -> None:
    name = f"the data file {validate.show(str(path))}"
    budget.require(name, size, FILE_BYTE.times, given=f"holds {size} bytes, unpacked, and", fits=lambda n: f"at most {n} bytes")


def _numbers(name: str, value: Any) -> Iterator[tuple[str, Array]]:
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _numbers(f"{name}.{field}", value.reshape(-1)[0][field])
    elif value.dtype.kind in "biuf":
        yield name, np.squeeze(value)


def times_and_values(path: Path, found: dict[str, Array], times: str, values: str | None) -> tuple[Array, Array]:
    """Return the variables that are named or the only ones that can be meant; InputError, with the names, where none or several
    can."""
    there = f"its variables are: {', '.join(sorted(found)) or 'none'}"
    if times not in found and times == TIMES[0]:
        named = [name for name in found if name.rpartition(".")[2].lower() in TIMES]
        times = named[0] if len(named) == 1 else times
    pair = values if values is not None else next(iter(found)) if len(found) == 1 else None
    if times not in found and pair in found and found[pair].ndim == 2 and 2 in found[pair].shape:
        if found[pair].shape == (2, 2):
            raise InputError(
                f"{path}: {pair} is 2 x 2, so that its times may be a column or a row; save them as a vector of their own"
            )
        first, second = found[pair] if found[pair].shape[0] == 2 else found[pair].T
        return first, second
    if times not in found:
        raise InputError(f"{path} has no variable {times!r} for the times; {there}")
    fitting = [name for name, one in found.items() if name != times and one.shape == found[times].shape]
    chosen = fitting[0] if values is None and len(fitting) == 1 else values
    if chosen not in found:
        missing = "name one with values" if values is None else f"it has no variable {values!r}"
        raise InputError(f"{path}: {missing}; {there}")
    return found[times], found[chosen]
