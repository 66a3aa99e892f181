"""Writing files so that nobody ever sees half of one: under a temporary name in the same folder, then renamed, all at once."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from barbalat.folders import made, refused
from barbalat.validate import InputError, local_path


class Folder:
    """Where a command's files go. What is written shows with ``commit``, and not at all where that is never called."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._staged: Path | None = None

    def write(self, name: str, content: bytes | str) -> Path:
        """Have a whole file ready, to replace one of the same name; returns where it will be."""
        if self._staged is None:
            self._staged = Path(tempfile.mkdtemp(dir=self.path, prefix=".barbalat-"))
        (self._staged / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return self.path / name

    def commit(self, gone: Iterable[str] = ()) -> None:
        """Put what was written in its place; what is ``gone``, files of an earlier command, is removed first."""
        if self._staged is None:
            return
        ready = sorted(self._staged.iterdir())
        for name in set(gone) - {file.name for file in ready}:
            (self.path / name).unlink(missing_ok=True)
        for file in ready:
            file.replace(self.path / file.name)
        self.discard()

    def discard(self) -> None:
        """Forget what was written and not committed."""
        if self._staged is not None:
            shutil.rmtree(self._staged, ignore_errors=True)
            self._staged = None


@contextlib.contextmanager
def output_folder(path: str | Path) -> Iterator[Folder]:
    """The folder, made if need be, of this process alone while it is used; one that stayed empty goes again.

    InputError where files can't be written in it, or where another process writes in it.
    """
    path = local_path("the output folder", path)
    refusal = f"the output folder {str(path)!r} cannot be used"
    with made(path, refusal):
        with refused(refusal):
            handle = _locked(path)
        folder = Folder(path)
        try:
            yield folder
        finally:
            folder.discard()
            if handle is not None:
                os.close(handle)


def _locked(path: Path) -> int | None:
    """A handle that holds the folder until it is closed, or the process ends in whatever way; None where there are no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise InputError(f"the output folder {str(path)!r} is in use by another run; choose another one") from None
    except OSError:  # some network file systems have no locks
        os.close(handle)
        return None
    return handle
