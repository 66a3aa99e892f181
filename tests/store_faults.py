"""Real faults against a store: its writer killed at random instants, a full disk, flipped bytes, two writers, Ctrl-C.

``./dev store-faults`` runs all of it, ``--quick`` a short form. After each fault the store contains only whole rows with the
right bits, and the same command completes it. If this is violated, the exit code is 1 and a sentence says so.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.stored import INDEX_FILE, StoredRows, read_index
from barbalat.sweeps.study import Study
from barbalat.sweeps.sweep import run_study

MEMBERS, CHUNK = 6000, 100
"""Members for sixty files, one every few hundredths of a second, so kills hit every stage of writing a file."""
LONGEST = 1.5
"""Seconds from a writer's first output until it is killed. A whole run takes about as long."""
TMPFS = "300k"
"""Space for a part of the store, which needs some 1.5 MB."""

INTERRUPTED = 2.0 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
"""Seconds in which the process must end after Ctrl-C. On an idle machine it takes two."""


class Failed(Exception):
    """Raised if an expectation is violated."""


def study() -> Study:
    """A first-order loop over its known set."""
    text = CaseText(CaseText.read("first-order").text)
    draws = sampled(text, [("plant.theta", "known-set"), ("controller[0].gamma", "loguniform:1:100")])
    plan = Plan({}, draws, MEMBERS)
    return Study(VariedCase(text, plan.paths), plan)


def write(folder: Path) -> int:
    """The work of a writer's process. It returns the exit code of the command line."""
    prepared = study()
    print("begun", flush=True)  # noqa: T201
    try:
        run_study(prepared, store=folder, chunk=CHUNK, bounds=False, audit=0, threads=1)
    except InputError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return 2
    except OSError as error:
        print(f"cannot write: {error.strerror}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def writer(folder: Path, **options: object) -> subprocess.Popen[str]:
    """A started writer that has finished its imports. With a limit on file sizes Python would leave half of a module's code for
    the next process."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--write", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        **options,
    )  # type: ignore[call-overload]
    assert process.stdout is not None
    process.stdout.readline()
    return process  # type: ignore[no-any-return]


def check(folder: Path, expected: dict[str, np.ndarray], *, complete: bool) -> int:
    """The members in the store. Failed is raised if a row is wrong."""
    index = read_index(folder) if folder.exists() else None
    if index is None:
        if complete:
            raise Failed("the store has no index")
        return 0
    rows = StoredRows(folder, index)
    members = rows.column("member").astype(int)
    for name in rows.names:
        if not np.array_equal(rows.column(name), expected[name][members], equal_nan=True):
            raise Failed(f"{name} differs from what it is without a fault")
    if complete and not np.array_equal(members, np.arange(MEMBERS)):
        raise Failed(f"{len(members)} of {MEMBERS} members after the command had ended")
    return len(members)


def finished(folder: Path, expected: dict[str, np.ndarray]) -> None:
    process = writer(folder)
    _, said = process.communicate()
    if process.returncode:
        raise Failed(f"the same command ended with {process.returncode}: {said}")
    check(folder, expected, complete=True)


def kills(folder: Path, expected: dict[str, np.ndarray], count: int, rng: random.Random) -> str:
    """Kill the writers of several stores again and again with kill -9."""
    stores, lost, before = 0, 0, 0
    for _ in range(count):
        process = writer(folder)
        time.sleep(rng.uniform(0, LONGEST))
        process.kill()
        process.communicate()
        stored = check(folder, expected, complete=False)
        lost += stored < before
        before = stored
        if stored == MEMBERS:
            shutil.rmtree(folder)
            stores, before = stores + 1, 0
    if lost:
        raise Failed(f"{lost} times a store held less than before")
    finished(folder, expected)
    return f"{count} kills, {stores + 1} stores completed, none held a wrong row, none lost one"


def flips(folder: Path, expected: dict[str, np.ndarray], count: int, rng: random.Random) -> str:
    """Change a byte of a stored file, then one of the index."""
    finished(folder, expected)
    for _ in range(count):
        file = rng.choice(sorted(folder.glob("members-*.parquet")))
        content = bytearray(file.read_bytes())
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        file.write_bytes(content)
        finished(folder, expected)
    index = folder / INDEX_FILE
    whole = index.read_bytes()
    refused = 0
    for _ in range(count):
        content = bytearray(whole)
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        index.write_bytes(content)
        try:
            check(folder, expected, complete=True)
        except InputError:
            refused += 1
    index.write_bytes(whole)
    return f"{count} flipped bytes of rows found and made again; of {count} in the index {refused} refused, no row is wrong"


def full_disk(folder: Path, expected: dict[str, np.ndarray]) -> str:
    """Fill a small tmpfs if mounting is permitted, otherwise use a limit on the size of files."""
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={TMPFS}", "tmpfs", folder], capture_output=True, check=False)
    if mounted.returncode:
        import resource

        process = writer(folder, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)))
        how = "a limit of 20 kB on files (mounting a tmpfs is not permitted here)"
    else:
        process, how = writer(folder), f"a tmpfs of {TMPFS}"
    try:
        _, said = process.communicate()
        if process.returncode != 1 or len(said.splitlines()) != 1:
            raise Failed(f"on a full disk the command ended with {process.returncode}: {said}")
        stored = check(folder, expected, complete=False)
        if not mounted.returncode:
            subprocess.run(["mount", "-o", "remount,size=50m", folder], check=True)
        finished(folder, expected)
    finally:
        if not mounted.returncode:
            subprocess.run(["umount", folder], check=True)
    return f"{how}: {said.strip()!r}, {stored} members kept, completed with more room"


def two_writers(folder: Path, expected: dict[str, np.ndarray]) -> str:
    """Check that a second writer is rejected and a reader is not."""
    first = writer(folder)
    while not (folder / INDEX_FILE).exists():
        time.sleep(0.01)
    first.send_signal(signal.SIGSTOP)  # so that it can't finish before the second one asks
    second = writer(folder)
    _, said = second.communicate()
    read = check(folder, expected, complete=False)
    first.send_signal(signal.SIGCONT)
    first.communicate()
    if second.returncode != 2 or "another process" not in said:
        raise Failed(f"the second writer ended with {second.returncode}: {said}")
    check(folder, expected, complete=True)
    return f"the second is refused, {read} members read meanwhile"


def interrupt(folder: Path, *options: str) -> str:
    """Interrupt the command itself with Ctrl-C in the middle of a chunk, with threads and with a cluster's processes."""
    arguments = [
        "sweep",
        "paper",
        "--sample",
        "plant.theta=known-set",
        "--members",
        "100000",
        "--no-bounds",
        "--json",
        "--budget",
        "10h",
    ]
    command = [sys.executable, "-m", "barbalat", *arguments, "--store", str(folder), *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (folder / INDEX_FILE).exists() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(0.5)
    begun = time.perf_counter()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    seconds = time.perf_counter() - begun
    if process.returncode != 130 or "run the same command again to continue" not in said:
        raise Failed(f"after Ctrl-C the command ended with {process.returncode}: {said}")
    index = read_index(folder)
    if index is None or not index.files:
        raise Failed("nothing was kept")
    if seconds > INTERRUPTED:
        raise Failed(f"Ctrl-C took {seconds:.1f} s")
    return f"ended after {seconds:.2f} s, {len(index.files)} files kept"


@contextlib.contextmanager
def told(name: str) -> Iterator[list[str]]:
    found: list[str] = []
    started = time.perf_counter()
    yield found
    print(f"{name}: {found[0]} ({time.perf_counter() - started:.0f} s)", flush=True)  # noqa: T201


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--quick", action="store_true", help="a minute's worth")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.write:
        return write(options.write)
    rng = random.Random(options.seed)
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path)
    whole = run_study(study(), bounds=False, audit=0)
    expected = {name: whole.column(name) for name in whole.rows.names}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        try:
            with told("killed") as said:
                said.append(kills(folder / "killed", expected, 8 if options.quick else 200, rng))
            with told("flipped") as said:
                said.append(flips(folder / "flipped", expected, 2 if options.quick else 20, rng))
            with told("full disk") as said:
                said.append(full_disk(folder / "full", expected))
            with told("two writers") as said:
                said.append(two_writers(folder / "two", expected))
            with told("Ctrl-C") as said:
                said.append(interrupt(folder / "stopped"))
            with told("Ctrl-C under Dask") as said:
                said.append(interrupt(folder / "called off", "--scheduler", "local:2"))
        except Failed as error:
            print(f"failed: {error}")  # noqa: T201
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
