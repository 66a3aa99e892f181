"""Calls a function in a separate process with a time limit, so that a crash of a simulator becomes one sentence in this process.

On some errors in its files JSBSim ends the whole process, and it prints freely. Both effects are confined to the separate
process. The function, its arguments and its result are pickled between a process and its child.
"""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ParamSpec, TypeVar

from barbalat.validate import InputError

Given = ParamSpec("Given")
Answer = TypeVar("Answer")
ASKED, ANSWERED = "asked.pickle", "answered.pickle"
LONGEST_REASON = 200
"""Largest number of characters of a simulator's last output that are shown."""
STARTING_SECONDS, SECONDS_PER_FLIGHT = 120.0, 60.0
"""Time limits [s]. A simulator and compiled controllers start in two seconds and fly in one and a half; a shared machine may take
many times as long."""


class SimulatorFailed(RuntimeError):
    """The simulator's process ended without an answer or did not end in time."""


def isolated(seconds: float, function: Callable[Given, Answer], *given: Given.args, **named: Given.kwargs) -> Answer:
    """Call ``function(*given, **named)`` in a different process. The function must be at the top level of a module.

    Raises InputError if the function raises it, and SimulatorFailed if the process crashes or takes longer than ``seconds``.
    """
    with tempfile.TemporaryDirectory(prefix="barbalat-") as made:
        folder = Path(made)
        (folder / ASKED).write_bytes(pickle.dumps((function, given, named)))
        command = [sys.executable, "-m", "barbalat.vehicles.isolated", str(folder)]
        try:
            with _held_open() as alive:
                done = subprocess.run(command, capture_output=True, timeout=seconds, check=False, env=_environment(), stdin=alive)
        except subprocess.TimeoutExpired:
            raise SimulatorFailed(f"the simulator did not finish within {seconds:g} s and was stopped") from None
        if done.returncode:
            raise SimulatorFailed(_crash(done.returncode, done.stderr.decode(errors="replace")))
        answer = pickle.loads((folder / ANSWERED).read_bytes())
    if isinstance(answer, InputError):
        raise answer
    found: Answer = answer
    return found


@contextmanager
def _held_open() -> Iterator[int]:
    """Yield the read end of a pipe, which closes when this process ends in any way."""
    reading, writing = os.pipe()
    try:
        yield reading
    finally:
        os.close(reading)
        os.close(writing)


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}


def _crash(code: int, said: str) -> str:
    how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
    last = [line.strip() for line in said.splitlines() if line.strip()][-1:]
    return f"the simulator's process ended {how}{f', saying: {last[0][:LONGEST_REASON]}' if last else ''}"


def _end_with_parent(folder: Path) -> None:
    """Wait in the child, in parallel with its work, for the end of the parent. If the parent was killed, clean up in its place
    and end too."""
    os.read(sys.stdin.fileno(), 1)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _answer(folder: Path) -> None:
    """Call the requested function in the child, and keep its result or its error."""
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()
    function, given, named = pickle.loads((folder / ASKED).read_bytes())
    try:
        found = function(*given, **named)
    except InputError as error:
        found = error
    (folder / ANSWERED).write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    _answer(Path(sys.argv[1]))
