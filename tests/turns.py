"""Helpers of the tests: the selection of items for a commit, so in time all are run, and results that one of pytest's processes
computes for all."""

from __future__ import annotations

import pickle
import random
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def drawn(items: Sequence[T], count: int, of: str = "") -> list[T]:
    """This many of the items, in order, selected by the commit of the sources, and separately for each name ``of``. Without
    a clone they are always the same."""
    places = random.Random(commit() + of).sample(range(len(items)), min(count, len(items)))
    return [items[i] for i in sorted(places)]


@cache
def commit() -> str:
    """The commit of the sources; empty without a clone."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout if shutil.which("git") else ""


def once(folder: Path, name: str, make: Callable[[], T]) -> T:
    """A result that the first process computes and that the others with the same ``folder`` read."""
    ready, begun = folder / f"{name}.pickle", folder / f"{name}.begun"
    try:
        begun.touch(exist_ok=False)
    except FileExistsError:
        while not ready.exists():
            assert begun.exists(), f"another process could not make {name}"
            time.sleep(0.2)
        return pickle.loads(ready.read_bytes())  # type: ignore[no-any-return]
    try:
        made = make()
        (folder / f"{name}.part").write_bytes(pickle.dumps(made))
    except BaseException:
        begun.unlink()
        raise
    (folder / f"{name}.part").replace(ready)
    return made
