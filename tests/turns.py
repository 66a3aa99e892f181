"""What tests share: which of many items a commit runs, so that all get their turn, and results that one of pytest's processes
makes for all."""

from __future__ import annotations

import pickle
import random
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def drawn(items: Sequence[T], count: int) -> list[T]:
    """This many of them in their order, selected by the sources' commit; always the same ones without a clone."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout if shutil.which("git") else ""
    places = random.Random(commit).sample(range(len(items)), min(count, len(items)))
    return [items[i] for i in sorted(places)]


def once(folder: Path, name: str, make: Callable[[], T]) -> T:
    """A result that the first process makes and the others with the same ``folder`` read."""
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
