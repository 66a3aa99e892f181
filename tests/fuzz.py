"""Run plausible cases through every command: ``./dev fuzz [CASE]``. The exit code is 1 if one fails.

A case is drawn from the schema (``plausible``), or is a bundled case or the given one with changed numbers and further keys. It
is run and certified, and each other command runs on a part of the cases. A command must end with exit code 0 and strict JSON, or
with exit code 2 and one sentence, within its processor time. A guaranteed bound must hold for the metrics of the run. If it does
not, it is compared with runs at finer steps. A case that fails is reduced key by key and stored as a case file.

  ./dev fuzz --cases 2000 --seed 7       the same cases each time; without --seed they differ every time, and the seed is printed
  ./dev fuzz --quick                     what two minutes allow
  ./dev fuzz my-plant.toml               variations of that case alone
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import copy
import io
import json
import multiprocessing
import os
import random
import resource
import secrets
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import barbalat_check
import plausible
from barbalat.cases.load import bundled
from barbalat.cli import main
from independent import as_toml

PROCESSOR_SECONDS = 90
"""Limit of processor time for a command on a small case. Commands that search have SEARCH_SECONDS."""
SEARCH_SECONDS = 900
SEARCHING_SHARE = 1 / 3
"""Fraction of a limited time in which cases with a search may begin. Otherwise one that begins at the end would continue alone
for minutes."""
WALL_SECONDS = 1800
"""Time after which a worker that uses no processor time is assumed to hang."""
MEMORY = 8 << 30
"""Bytes of address space for a worker. The package promises to reject cases that need more than half of it."""
CASES_OF_A_WORKER = 40
"""Cases after which a worker is replaced, because compiled modules are never freed."""
LONGEST_SENTENCE = 600
FINER = (1, 4, 16, 64)
"""Steps at which a bound is compared. A bound that a run violates at the case's step because of the solver holds at a finer
one."""
REDUCTIONS = 60
"""Number of attempts to leave a key out of a failing case."""
BY_TOLERANCE = 0.3
"""Fraction of the cases with a tolerance in place of a step."""
ROUNDINGS = 1e-11
"""Error of a metric by rounding: the error of estimates that start at the parameters is bounded by 0 without it."""
SAMPLES_CHECKED = 700
"""Largest number of samples that the checker follows, which takes a few seconds. A slower loop takes minutes."""
EARLY = 1500
"""Solver steps of a bundled case."""


class TooLong(BaseException):
    """Raised when a command has used its processor time. It is not an Exception, so nothing catches it."""


@dataclass(frozen=True)
class Failure:
    """A failure, identified by its kind and place, whatever the numbers."""

    kind: str
    place: str
    said: str
    command: tuple[str, ...]

    @property
    def name(self) -> tuple[str, str, str]:
        return self.command[0], self.kind, self.place


@dataclass(frozen=True)
class Said:
    """The result of a command."""

    code: int
    out: str
    err: str


@dataclass
class Tally:
    """The outcomes of the commands, and the failures, one for each kind and place."""

    ended: collections.Counter[tuple[str, str]] = field(default_factory=collections.Counter)
    cases: collections.Counter[str] = field(default_factory=collections.Counter)
    bounds: int = 0
    failures: dict[tuple[str, str, str], tuple[int, Failure, str]] = field(default_factory=dict)


# One case


def drawn(seed: int, given: dict[str, Any] | None, folder: Path) -> dict[str, Any]:
    """The case of a seed. In seven of ten it is new, otherwise a changed bundled case, or a changed ``given`` if there is one.

    Three of ten have a tolerance in place of a step.
    """
    rng = random.Random(seed)
    if given is not None:
        case = plausible.changed(rng, given, folder)
    elif rng.random() < 0.7:
        case = plausible.Draw(rng, folder).case()
    else:
        bundle = tomllib.loads(rng.choice(sorted(bundled().values())).read_text("utf-8"))
        case = plausible.changed(rng, early(bundle), folder)
    return by_tolerance(rng, case) if rng.random() < BY_TOLERANCE and "dt" in case["simulation"] else case


def by_tolerance(rng: random.Random, case: dict[str, Any]) -> dict[str, Any]:
    """The given case with a tolerance in place of a step and a solver."""
    kept = {key: value for key, value in case["simulation"].items() if key not in ("dt", "solver")}
    return case | {"simulation": kept | {"tolerance": rng.choice((1e-4, 1e-6, 1e-9))}}


def early(case: dict[str, Any]) -> dict[str, Any]:
    """The given case for a few steps only."""
    simulation = case["simulation"]
    simulation["t_end"] = min(simulation["t_end"], EARLY * simulation.get("dt", 1e-3))
    return case


def text_of(case: dict[str, Any]) -> str:
    """The case file."""
    return "\n".join(f"{as_toml(key)} = {as_toml(value)}" for key, value in case.items())


Make = Callable[[random.Random, dict[str, Any], Path], list[str] | None]


def _sampled(rng: random.Random, case: dict[str, Any]) -> str | None:
    names = [one.get("name") for one in case["controller"] if "sample_time" in one]
    return rng.choice(names) if names else None


def _export(rng: random.Random, case: dict[str, Any], folder: Path) -> list[str] | None:
    name = _sampled(rng, case)
    if name is None:
        return None
    target = rng.choice((["--target", "c99"], ["--target", "fmu2", "--sources-only"], ["--target", "fmu3", "--sources-only"]))
    more = rng.choice(([], ["--float32"], ["--closed-loop"], []))
    return ["export", "--controller", name, *target, *more, "--out", str(folder / "export")]


def _sweep(rng: random.Random, case: dict[str, Any], folder: Path) -> list[str] | None:
    numbers = [
        path
        for path in plausible.places(case)
        if isinstance(plausible.at(case, path), float) and path[0] in ("plant", "controller", "reference", "sensor")
    ]
    if not numbers:
        return None
    path = rng.choice(numbers)
    value, name = plausible.at(case, path), ""
    for key in path:
        name += f"[{key}]" if isinstance(key, int) else f".{key}" if name else key
    low, high = sorted((0.9 * value, 1.1 * value + 1e-9))
    vary = rng.choice((["--vary", f"{name}={low}:{high}:3"], ["--sample", f"{name}=uniform:{low}:{high}", "--members", "8"]))
    store = ["--store", str(folder / "store")] if rng.random() < 0.2 else []
    page = ["--out", str(folder / "sweep")] if rng.random() < 0.1 else []
    return ["sweep", *vary, *store, *page]


COMMANDS: tuple[tuple[float, int, Make], ...] = (
    (1.0, PROCESSOR_SECONDS, lambda rng, case, folder: ["run", "--no-plots"]),
    (1.0, PROCESSOR_SECONDS, lambda rng, case, folder: ["certify"]),
    (0.6, PROCESSOR_SECONDS, _export),
    (0.3, PROCESSOR_SECONDS, _sweep),
    (0.15, PROCESSOR_SECONDS, lambda rng, case, folder: ["explore", "--no-open", "--out", str(folder / "page.html")]),
    (0.05, PROCESSOR_SECONDS, lambda rng, case, folder: ["run", "--out", str(folder / "run")]),
    (0.05, PROCESSOR_SECONDS, lambda rng, case, folder: ["certify", "--out", str(folder / "certify")]),
    (0.1, SEARCH_SECONDS, lambda rng, case, folder: ["certify", "--proof", str(folder / "proof.json")]),
    (0.03, SEARCH_SECONDS, lambda rng, case, folder: ["certify", "--simulate"]),
    (0.02, PROCESSOR_SECONDS, lambda rng, case, folder: ["run", "--no-plots", "--sil"] if _sampled(rng, case) else None),
    (0.01, SEARCH_SECONDS, lambda rng, case, folder: ["tradeoff", "--density", "2", "--plants", "1"]),
    (0.01, SEARCH_SECONDS, lambda rng, case, folder: ["tune", "--for", "rms_e", "--trials", "288", "--plants", "1"]),
    (
        0.005,
        SEARCH_SECONDS,
        lambda rng, case, folder: ["contest", "--quick", "--trials", "288", "--members", "8", "--plants", "1"],
    ),
)
"""For each command the fraction of the cases on which it runs, its processor time, and its words without the case."""


@contextlib.contextmanager
def processor_time(seconds: int) -> Iterator[None]:
    """Raise TooLong after this much of this process's processor time."""

    def stop(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds, 5)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def call(words: list[str], seconds: int) -> Said | Failure:
    """Run a command in this process."""
    out, err, command = io.StringIO(), io.StringIO(), tuple(words)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), processor_time(seconds):
            code = main([*words, "--json"])
    except TooLong as error:
        return Failure("hang", _place(error), f"more than {seconds} s of processor time", command)
    except SystemExit as error:  # from the parser: it rejected the arguments, which this program chose wrongly
        return Failure("exit", str(error.code), err.getvalue(), command)
    except BaseException as error:  # noqa: BLE001  # also what no program should end by
        return Failure(type(error).__name__, _place(error), traceback.format_exc(), command)
    return Said(code, out.getvalue(), err.getvalue())


def _place(error: BaseException) -> str:
    """The last line of the package in the error's traceback."""
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if f"{os.sep}barbalat{os.sep}" in frame.filename]
    return f"{Path(own[-1].filename).name}:{own[-1].name}" if own else "outside"


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def judged(said: Said | Failure, words: list[str]) -> tuple[str, Any]:
    """A command's outcome, which is "done", "rejected" or "failed", and its JSON, None or the Failure."""
    if isinstance(said, Failure):
        return "failed", said
    if said.code == (1 if _not_compared(said.out, words) else 0):
        try:
            return "done", json.loads(said.out, parse_constant=_refuse)
        except ValueError as error:
            return "failed", Failure("JSON", "stdout", f"{error}\n{said.out[:2000]}", tuple(words))
    lines = [line for line in said.err.splitlines() if line.startswith("barbalat: ")]
    short = len(lines) == 1 and lines[0].isprintable() and len(lines[0]) < LONGEST_SENTENCE
    if said.code == 2 and short and not said.out:
        return "refused", None
    return "failed", Failure("exit code", str(said.code), said.err[-3000:], tuple(words))


def _not_compared(out: str, words: list[str]) -> bool:
    """Whether ``run --sil`` found no difference but could not compare a controller, which is the exit code 1."""
    if "--sil" not in words or not out:
        return False
    found = [one["equal"] for one in json.loads(out).get("software_in_the_loop", {}).values()]
    return None in found and False not in found


def tried(
    seed: int, case: dict[str, Any], folder: Path, only: tuple[str, ...] = (), *, searches: bool = True
) -> Iterator[tuple[str, str, Any]]:
    """(command, outcome, output) of each command that accepts this case. ``only`` selects those to repeat."""
    file = folder / "case.toml"
    file.write_text(text_of(case), encoding="utf-8")
    found = {}
    for place, (share, seconds, make) in enumerate(COMMANDS):
        rng = random.Random(f"{seed}/{place}")
        words = make(rng, case, folder) if rng.random() < share and (searches or seconds < SEARCH_SECONDS) else None
        if words is None or (only and words[0] not in only):
            continue
        words = [words[0], str(file), *words[1:]]
        ended, given = judged(call(words, seconds), words)
        found.setdefault(words[0], given if ended == "done" else None)
        yield words[0], ended, given
        if "--proof" in words and ended == "done":
            yield checked(Path(words[-1]), words)
    if found.get("run") and found.get("certify"):
        yield from broken_bounds(case, folder, found["run"], found["certify"])


def samples_followed(controller: dict[str, Any]) -> int:
    """The number of samples that the checker follows for a controller of a proof."""
    samples = (line["witness"]["samples"] for line in controller["lines"] if line["key"] == "sampled response")
    return max(samples, default=0)


def checked(file: Path, words: list[str]) -> tuple[str, str, Any]:
    """The verdict of the separate checker on a proof, without the controllers whose check would take minutes."""
    document = json.loads(file.read_text(encoding="utf-8"))
    of_all = document["controllers"]
    document["controllers"] = {name: one for name, one in of_all.items() if samples_followed(one) <= SAMPLES_CHECKED}
    try:
        barbalat_check.check(document)
    except barbalat_check.Refused as error:
        return "proof", "failed", Failure("proof", str(error).split(":")[0].split(", ")[-1], str(error), tuple(words))
    return "proof", "held", None


# Bounds compared with metrics

HELD = {"error_bound": "max_abs_e", "output_bound": "max_abs_y", "control_bound": "max_abs_u"}
"""A certificate's guaranteed keys, and the metrics of a run that they bound, in every component."""


def broken_bounds(case: dict[str, Any], folder: Path, run: Any, certified: Any) -> Iterator[tuple[str, str, Any]]:
    """ "held" for each guaranteed bound that was compared, "failed" for one that the metrics exceed at every step tried."""
    for name, certificate in certified["controllers"].items():
        for key in set(certificate.get("guaranteed", ())) & HELD.keys():
            bound = certificate.get(key)
            if not isinstance(bound, float) or name not in run["controllers"]:
                continue
            exceeded = [
                figure for finer in FINER if (figure := _exceeding(case, folder, run, name, key, bound, finer)) is not None
            ]
            if len(exceeded) < len(FINER):
                yield "bound", "held", None
                continue
            words = ("bound", key, name)
            yield "bound", "failed", Failure("bound", key, f"{HELD[key]} = {exceeded[-1]} > {key} = {bound} of {name}", words)


def _exceeding(case: dict[str, Any], folder: Path, run: Any, name: str, key: str, bound: float, finer: int) -> float | None:
    """The largest metric that exceeds the bound at a step that is ``finer`` times smaller, or None."""
    if finer > 1:
        if not _exceeding(case, folder, run, name, key, bound, 1):
            return None
        again = copy.deepcopy(case)
        again["simulation"]["dt" if "dt" in again["simulation"] else "tolerance"] /= finer
        file = folder / "finer.toml"
        file.write_text(text_of(again), encoding="utf-8")
        ended, run = judged(call(["run", str(file), "--no-plots"], SEARCH_SECONDS), ["run"])
        if ended != "done":
            return None
    figures = run["controllers"][name].get(HELD[key])
    figures = figures if isinstance(figures, list) else [figures]
    beyond = [figure for figure in figures if figure is not None and figure > bound + ROUNDINGS]
    return max(beyond, default=None)


# Reduction


def reduced(seed: int, case: dict[str, Any], failure: Failure, folder: Path) -> dict[str, Any]:
    """The case without the keys that the failure does not need."""
    commands = ("run", "certify") if failure.kind == "bound" else (failure.command[0],)
    attempts = 0
    for path in sorted(plausible.places(case), key=len):
        if attempts >= REDUCTIONS or failure.kind == "hang":
            break
        smaller = copy.deepcopy(case)
        try:
            del plausible.at(smaller, path[:-1])[path[-1]]
        except (KeyError, IndexError):
            continue
        if path == ("simulation",) or not smaller.get("controller"):
            continue
        attempts += 1
        kinds = [given.name for _, ended, given in tried(seed, smaller, folder, commands) if ended == "failed"]
        if failure.name in kinds:
            case = smaller
    return case


# Workers


def work(pipe: Connection, given: dict[str, Any] | None) -> None:
    """Try the cases of the numbers that arrive, and report each command's outcome and "next" after each case."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.environ["BROWSER"] = "true"
    while (asked := pipe.recv()) is not None:
        seed, searches = asked
        folder = Path(tempfile.mkdtemp())
        os.chdir(folder)
        plausible.write_files(folder)
        random.seed(seed)
        try:
            case = drawn(seed, given, folder)
            pipe.send(("case", text_of(case), plausible.accepted(case, folder)))
            for command, ended, what in tried(seed, case, folder, searches=searches):
                if ended == "failed":
                    least = reduced(seed, case, what, folder)
                    pipe.send(("failed", command, what, text_of(least)))
                else:
                    pipe.send((ended, command))
        except BaseException:  # noqa: BLE001  # of this program itself
            pipe.send(("failed", "fuzz", Failure("fuzz", "itself", traceback.format_exc(), ("fuzz",)), ""))
        finally:
            os.chdir("/")
            shutil.rmtree(folder, ignore_errors=True)
        pipe.send(("next",))


@dataclass
class Worker:
    """A process, the number of its case, and the time of its last report."""

    process: Any
    pipe: Connection
    seed: int = -1
    text: str = ""
    heard: float = 0.0
    left: int = CASES_OF_A_WORKER

    @classmethod
    def start(cls, given: dict[str, Any] | None) -> Worker:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=work, args=(there, given), daemon=False)
        process.start()
        there.close()
        return cls(process, here)

    def stop(self) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send(None)
        self.process.join(5)
        if self.process.is_alive():
            self.process.kill()


class Fuzz:
    """Gives case numbers to workers and counts their reports."""

    def __init__(self, options: argparse.Namespace, given: dict[str, Any] | None) -> None:
        self.options, self.given, self.tally = options, given, Tally()
        self.stop_at = time.monotonic() + options.seconds if options.seconds else float("inf")
        self.last_search = time.monotonic() + SEARCHING_SHARE * options.seconds if options.seconds else float("inf")
        self.number = 0

    def next_seed(self) -> int | None:
        if self.number >= self.options.cases or time.monotonic() > self.stop_at:
            return None
        self.number += 1
        return self.options.seed * 1_000_003 + self.number

    def run(self) -> Tally:
        workers = [Worker.start(self.given) for _ in range(self.options.jobs)]
        for worker in workers:
            self.feed(worker)
        while workers:
            for pipe in wait([worker.pipe for worker in workers], timeout=10):
                worker = next(one for one in workers if one.pipe is pipe)
                try:
                    self.hear(worker, worker.pipe.recv())
                except EOFError:
                    self.lost(worker, "crash", f"a worker ended with code {worker.process.exitcode}")
            for worker in workers:
                if worker.seed >= 0 and time.monotonic() - worker.heard > WALL_SECONDS:
                    self.lost(worker, "hang", f"nothing for {WALL_SECONDS} s")
            workers = [going for worker in workers if (going := self.going(worker)) is not None]
        return self.tally

    def feed(self, worker: Worker) -> None:
        """Give a worker the next case, or none if it has run its fraction."""
        seed = self.next_seed() if worker.left else None
        if seed is None:
            worker.seed = -1
        else:
            self.give(worker, seed)

    def going(self, worker: Worker) -> Worker | None:
        """Watch a worker while it has a case, then replace it as long as there are cases."""
        if worker.seed >= 0:
            return worker
        worker.stop()
        seed = self.next_seed()
        if seed is None:
            return None
        worker = Worker.start(self.given)
        self.give(worker, seed)
        return worker

    def give(self, worker: Worker, seed: int) -> None:
        worker.seed, worker.heard, worker.left = seed, time.monotonic(), worker.left - 1
        worker.pipe.send((seed, time.monotonic() < self.last_search))

    def hear(self, worker: Worker, said: tuple[Any, ...]) -> None:
        worker.heard = time.monotonic()
        kind, *rest = said
        if kind == "next":
            self.feed(worker)
        elif kind == "case":
            worker.text, made = rest
            self.tally.cases["taken" if made else "refused"] += 1
        elif kind == "failed":
            command, failure, text = rest
            self.failed(worker.seed, command, failure, text)
        else:
            self.tally.ended[rest[0], kind] += 1

    def lost(self, worker: Worker, kind: str, said: str) -> None:
        worker.process.kill()
        worker.process.join()
        self.failed(worker.seed, "worker", Failure(kind, "worker", said, ("worker",)), worker.text)
        worker.seed = -1

    def failed(self, seed: int, command: str, failure: Failure, text: str) -> None:
        self.tally.ended[command, "failed"] += 1
        if failure.name in self.tally.failures:
            return
        self.tally.failures[failure.name] = seed, failure, text
        folder = self.options.keep
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder / f"{len(self.tally.failures):03d}-{failure.command[0]}-{failure.kind}.toml"
        words = " ".join("CASE" if word.endswith("case.toml") else word for word in failure.command)
        head = f"{words} (seed {seed})\n{failure.said}"
        kept.write_text("".join(f"# {line}\n" for line in head.splitlines()) + text + "\n", encoding="utf-8")
        last = failure.said.strip().splitlines()[-1][:200] if failure.said.strip() else ""
        print(f"{failure.command[0]}: {failure.kind} at {failure.place}: {last}  ->  {kept}", flush=True)  # noqa: T201


def report(tally: Tally, seconds: float) -> None:
    """The counts, by command."""
    cases = tally.cases
    print(f"{cases.total()} cases in {seconds:.0f} s, of which {cases['refused']} were refused as a whole")  # noqa: T201
    for command in sorted({command for command, _ in tally.ended}):
        counts = [
            f"{tally.ended[command, how]} {how}" for how in ("done", "refused", "held", "failed") if tally.ended[command, how]
        ]
        print(f"  {command:9} {', '.join(counts)}")  # noqa: T201


def main_program() -> int:
    parser = argparse.ArgumentParser(prog="./dev fuzz", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("case", nargs="?", metavar="CASE", help="changes of this case alone: a file or a bundled case's name")
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=0.0, help="begin no further case after so long; no limit by default")
    parser.add_argument("--seed", type=int, help="of the cases; another one every time by default")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, default=Path("barbalat-fuzz"), help="the folder for what fails")
    parser.add_argument("--quick", action="store_true", help="as many cases as begin within 75 s")
    options = parser.parse_args()
    if options.seed is None:
        options.seed = secrets.randbelow(1_000_000)
    if options.quick:
        options.seconds = 75.0
    given = None
    if options.case:
        path = bundled().get(options.case, Path(options.case))
        given = early(tomllib.loads(path.read_text("utf-8")))
    print(f"seed {options.seed}", flush=True)  # noqa: T201
    began = time.monotonic()
    tally = Fuzz(options, given).run()
    report(tally, time.monotonic() - began)
    return 1 if tally.failures else 0


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main_program())
