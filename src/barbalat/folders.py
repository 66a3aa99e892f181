"""Creates the folders that a user names. A command that fails leaves no new folder behind."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from barbalat.validate import InputError, local_path


@contextlib.contextmanager
def made(folder: Path, refusal: str) -> Iterator[None]:
    """Create a folder if necessary and test that it is writable. At the end, remove new folders that are still empty.

    refusal  the error message for an unusable folder, to which the reason is appended

    Raises InputError if no file can be written there.
    """
    missing = [one for one in (folder, *folder.parents) if one.name != ".." and not one.exists()]
    try:
        with refused(refusal):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        yield
    finally:
        _remove_empty(missing)


@contextlib.contextmanager
def refused(refusal: str) -> Iterator[None]:
    """Turn an OSError into an InputError with this sentence and the reason, which concerns the folder and not a file in it."""
    try:
        yield
    except OSError as error:
        if isinstance(error, (FileExistsError, NotADirectoryError)):
            reason = "it or one of its parent folders is a file"
        elif isinstance(error, FileNotFoundError):  # /proc
            reason = "no files can be created there"
        else:
            reason = error.strerror or str(error)
        raise InputError(f"{refusal}: {reason}") from None


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders from the innermost outwards, up to the first that is not empty, because x/../y can be reached only while x
    exists."""
    with contextlib.suppress(OSError):
        for folder in folders:
            if folder.exists():
                folder.rmdir()


class Folder:
    """The folder for a command's output files. Written files appear when ``commit`` is called, and only then."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._staged: Path | None = None

    def write(self, name: str, content: bytes | str) -> Path:
        """Prepare a whole file, which may replace one of the same name; returns its final path."""
        if self._staged is None:
            self._staged = Path(tempfile.mkdtemp(dir=self.path, prefix=".barbalat-"))
        (self._staged / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return self.path / name

    def commit(self, gone: Iterable[str] = ()) -> None:
        """Remove the files in ``gone``, which an earlier command wrote, and then put the written files in place."""
        if self._staged is None:
            return
        ready = sorted(self._staged.iterdir())
        for name in set(gone) - {file.name for file in ready}:
            (self.path / name).unlink(missing_ok=True)
        for file in ready:
            file.replace(self.path / file.name)
        self.discard()

    def discard(self) -> None:
        """Discard files that were written and not committed."""
        if self._staged is not None:
            shutil.rmtree(self._staged, ignore_errors=True)
            self._staged = None


@contextlib.contextmanager
def output_folder(path: str | Path) -> Iterator[Folder]:
    """Create the folder if necessary and lock it for this process; a folder that stays empty is removed at the end.

    Raises InputError if files can't be written in it, or if another process is writing in it.
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
    """A handle that locks the folder until it is closed or the process ends; None if the file system has no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise InputError(f"the output folder {str(path)!r} is in use by another run; choose a different one") from None
    except OSError:  # some network file systems have no locks
        os.close(handle)
        return None
    return handle
