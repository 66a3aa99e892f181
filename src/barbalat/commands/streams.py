"""Standard output and standard error of a command, with closed streams, full disks and closed pipes handled."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

STANDARD_ERROR = 2
"""The descriptor of standard error, the last of the three standard ones."""
UNKNOWN_CHARACTERS = "backslashreplace"
"""The handler for encoding errors, which makes it possible to write names in any script to a terminal of any encoding."""


class OutputLost(Exception):
    """Standard output does not accept the command's results. ``reader_left`` is true if it is a pipe without a reader.

    This is not an OSError, because libraries handle some OSErrors themselves, and other pipes may break too.
    """

    def __init__(self, reason: str, *, reader_left: bool = False) -> None:
        super().__init__(reason)
        self.reader_left = reader_left


class _Results(io.FileIO):
    """Standard output. The first write that fails raises OutputLost; later failures, at the end of the program, are silent."""

    lost = False

    def write(self, data: ReadableBuffer, /) -> int:
        if self.lost:
            return memoryview(data).nbytes
        try:
            return super().write(data)
        except OSError as error:
            self.lost = True
            raise OutputLost(error.strerror or str(error), reader_left=error.errno == errno.EPIPE) from None


class _Notes(io.FileIO):
    """Standard error. Notes that it does not accept are lost; results and exit code are not affected."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError:  # there is no other stream on which this could be reported
            return memoryview(data).nbytes


@contextlib.contextmanager
def notes() -> Iterator[None]:
    """Provide standard error for a command. Text is lost if standard error does not accept it or does not exist."""
    before = sys.stderr
    _fill()
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        sys.stderr = nowhere if sys.stderr is None else _over(sys.stderr, _Notes)
        try:
            yield
        finally:
            sys.stderr = before


@contextlib.contextmanager
def results() -> Iterator[None]:
    """Provide standard output for a command. Raise OutputLost if it is closed or does not accept the written text."""
    before = sys.stdout
    if sys.stdout is None:  # Python sets the stream to None if the descriptor is closed
        raise OutputLost("it is closed; redirect it to a file, to a pipe, or to the null device")
    sys.stdout = _over(sys.stdout, _Results)
    try:
        yield
        sys.stdout.flush()
    except SystemExit:  # exit of the parser, which may have printed its help
        sys.stdout.flush()
        raise
    finally:
        with contextlib.suppress(OutputLost):  # a more informative exception is being raised
            sys.stdout.flush()
        sys.stdout = before


def _fill() -> None:
    """Open the null device for closed descriptors up to that of standard error; otherwise result files would get these
    descriptors."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= STANDARD_ERROR:  # each call opens the lowest free descriptor
        pass
    os.close(number)


def _over(stream: TextIO, kind: type[io.FileIO]) -> TextIO:
    """Return the stream with this kind of write. The stream is unchanged if it is not a system file, as in a notebook or a
    test."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    raw = getattr(stream.buffer, "raw", stream.buffer)  # without buffering, both are one object
    if not isinstance(raw, io.FileIO):
        stream.reconfigure(errors=UNKNOWN_CHARACTERS)
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(kind(raw.fileno(), "w", closefd=False)),
        encoding=stream.encoding,
        errors=UNKNOWN_CHARACTERS,
        line_buffering=stream.line_buffering or stream.write_through,  # PYTHONUNBUFFERED sets the second
        write_through=stream.write_through,
    )
