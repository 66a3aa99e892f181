"""The C compiler of this machine; only exports need it."""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from barbalat.validate import InputError, show

COMPILERS = ("cc", "gcc", "clang")
CHOICE = "CC"
"""The environment variable that selects another compiler with its options, as in make."""
COMPILING_SECONDS = 600
"""Time limit for a compiler [s]. A compiler needs about a second for every few thousand operations."""
FLAGS = ("-std=c99", "-ffp-contract=off", "-O2", "-shared", "-fPIC")
"""Options as in the export's README, for a library."""


def require_compiler(purpose: str = "the exported C must run on this machine", remedy: str = "") -> list[str]:
    """The C compiler command, taken from CC if that is set; raises InputError, stating what it is needed for, if no compiler is
    found on this machine."""
    chosen = _chosen()
    names = [chosen[0]] if chosen else list(COMPILERS)
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None and chosen:
        raise InputError(
            f"{purpose}, and {CHOICE} names {show(chosen[0])}, which is not on this machine's PATH: name a C compiler that is, "
            f"or unset {CHOICE}"
        )
    if found is None:
        wanted = f"install a C compiler{f', {remedy}' if remedy else ''}"
        raise InputError(f"{purpose}, and none of {', '.join(COMPILERS)} is on this machine's PATH: {wanted}")
    return [found, *chosen[1:]]


def _chosen() -> list[str]:
    given = os.environ.get(CHOICE, "")
    try:
        return shlex.split(given)
    except ValueError:
        raise InputError(
            f"{CHOICE} must be the command of a C compiler, got {show(given)}: a quotation mark is not closed"
        ) from None


def shared_library(compiler: Sequence[str], texts: Mapping[str, str], *options: str, ending: str = ".so") -> bytes:
    """Compile sources, given by name, to a library; raises InputError if the compiler fails."""
    with tempfile.TemporaryDirectory(prefix="barbalat-") as made:
        folder = Path(made)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="ascii")
        sources, library = [name for name in texts if name.endswith(".c")], f"made{ending}"
        command = [*compiler, *FLAGS, *options, *sources, "-o", library, "-lm"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, timeout=COMPILING_SECONDS, check=False)
            if done.returncode == 0 and (folder / library).exists():
                return (folder / library).read_bytes()
            told = done.stderr.decode(errors="replace").strip().splitlines()  # in any encoding
            said = (told or [f"it wrote no library and ended with exit code {done.returncode}"])[0]
        except (OSError, subprocess.TimeoutExpired) as error:
            said = str(error)
    raise InputError(f"{compiler[0]} does not compile the export: {said}")


def loaded(library: bytes) -> ctypes.CDLL:
    """A compiled library, loaded into this process; each call loads a separate copy with its own data."""
    with tempfile.TemporaryDirectory(prefix="barbalat-") as folder:
        file = Path(folder) / "controller.so"
        file.write_bytes(library)
        try:
            return ctypes.CDLL(str(file))
        except OSError as error:
            raise InputError(f"the compiled export can't be loaded here: {error}") from None
