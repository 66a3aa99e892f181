"""Writing files so that nobody ever sees half of one: to a temporary name in the same folder, then renamed."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from barbalat.validate import InputError


def prepare_folder(folder: Path) -> Path:
    """Create the folder if need be and see that files can be written in it; InputError if not."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise InputError(f"the output folder {str(folder)!r} cannot be used: {error.strerror or error}") from None


def write(path: Path, content: bytes | str) -> Path:
    """Write a whole file, replacing one of the same name."""
    data = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path
