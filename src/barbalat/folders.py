"""Making the folders that a user names, so that a command that fails leaves none of them behind."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from barbalat.validate import InputError


@contextlib.contextmanager
def made(folder: Path, refusal: str) -> Iterator[None]:
    """A folder that is made if need be and tried by writing; what was made for it and is empty at the end is removed.

    refusal  the sentence that says that the folder can't be used, to which the reason is added

    Raises InputError where no file can be written there.
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
    """Turns an OSError into an InputError: the sentence with the reason in words about the folder, not about a file in it."""
    try:
        yield
    except OSError as error:
        if isinstance(error, (FileExistsError, NotADirectoryError)):
            reason = "it, or what it would be in, is a file"
        elif isinstance(error, FileNotFoundError):  # /proc
            reason = "no files can be made there"
        else:
            reason = error.strerror or str(error)
        raise InputError(f"{refusal}: {reason}") from None


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders from the innermost outwards, up to the first that is not empty: x/../y needs x."""
    with contextlib.suppress(OSError):
        for folder in folders:
            if folder.exists():
                folder.rmdir()
