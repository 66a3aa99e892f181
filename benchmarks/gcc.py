"""Compile C to a shared library with gcc for this processor."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

from benchmarks import processor


def missing() -> str | None:
    return None if shutil.which("gcc") else "gcc is not installed"


def shared_library(source: str, flags: str, folder: Path) -> Path:
    """The library compiled in ``folder``. Its name depends on the source and the flags.

    It is linked without the flags, because with -ffast-math gcc before 13 links code that turns denormal numbers off in the whole
    process.
    """
    stem = hashlib.sha256(f"{flags}\n{source}".encode()).hexdigest()[:16]
    text, part, library = (folder / f"{stem}.{ending}" for ending in ("c", "o", "so"))
    text.write_text(source)
    subprocess.run(["gcc", *processor.GCC_TARGET, *flags.split(), "-fPIC", "-c", str(text), "-o", str(part)], check=True)
    subprocess.run(["gcc", "-shared", str(part), "-o", str(library), "-lm"], check=True)
    return library
