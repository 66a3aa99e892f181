"""This machine's C compiler, of which nothing but exports has need."""

from __future__ import annotations

import shutil

from barbalat.validate import InputError

COMPILERS = ("cc", "gcc", "clang")
COMPILING_SECONDS = 600
"""That a compiler may take: it needs a second for each few thousand operations."""


def require_compiler(purpose: str = "the exported C is to run here", remedy: str = "") -> str:
    """The path of a C compiler; InputError, which says what for, where this machine has none."""
    found = next(filter(None, map(shutil.which, COMPILERS)), None)
    if found is None:
        wanted = f"install a C compiler{f', {remedy}' if remedy else ''}"
        raise InputError(f"{purpose}, and none of {', '.join(COMPILERS)} is on this machine's PATH: {wanted}")
    return found
