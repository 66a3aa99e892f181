"""Plants faults in a copy of the sources, one at a time, and reports which tests find them: ``./dev faults``.

A faster test suite must not be a weaker one. A seed draws faults of several kinds (a sign, an index, a dropped term, swapped
arguments, a wrong direction of a bound or a rounding) and rooms of the house. The tests of the room that contains the fault run
on each fault, then the whole short command, both until the first failure; if these find nothing, the rest of the full command
runs. The draw depends on the sources, so a seed names the same faults only at the same commit. ``--from K`` continues after a
stop.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = Path("src/barbalat")

ROOMS = {
    "equations": ["controllers/**/*.py", "adaptation/**/*.py"],
    "projection": ["problem/known_set/*.py"],
    "solvers": ["solvers/*.py"],
    "delay": [
        "run/kernel/delay.py",
        "run/kernel/step.py",
        "lowering/llvm/loads.py",
        "problem/actuation.py",
        "linear/peaks.py",
    ],
    "certificates": ["certificates/**/*.py", "linear/**/*.py"],
    "case reading": ["cases/*.py"],
}
MIRRORS = {
    "adaptation": ["tests/adaptation", "tests/contracts"],
    "controllers": ["tests/contracts", "tests/controllers"],
    "lowering": ["tests/lowering", "tests/run"],
    "cases": ["tests/cases", "tests/test_validate.py", "tests/contracts/test_registries.py", "tests/commands"],
    "problem": ["tests/problem", "tests/adaptation", "tests/test_validate.py"],
    "solvers": ["tests/solvers", "tests/contracts/test_solvers.py", "tests/test_validate.py"],
}
"""The tests that run first on a fault in a room. For a room without an entry they are in the folder of tests that mirrors it."""

OTHER_WAY = {
    "up": "down", "upper": "lower", "floor": "ceil", "abs_upper": "abs_lower", "ROUND_CEILING": "ROUND_FLOOR",
    "max": "min", "maximum": "minimum",
}  # fmt: skip
OTHER_WAY |= {b: a for a, b in OTHER_WAY.items()}
NOT_SWAPPED = {
    "isinstance", "issubclass", "hasattr", "getattr", "setattr", "__setattr__", "cast", "Function", "SX",
    "max", "min", "maximum", "minimum", "hypot", "zip",
}  # fmt: skip
"""Calls whose first arguments have different types, so that no test is needed, or may be swapped without effect."""

STAGE_LIMIT = 1800.0
"""Time limits in seconds. If a stage reaches the limit, the fault has caused an endless loop and is regarded as found."""


@dataclass(frozen=True)
class Fault:
    """One replacement in one file: ``text`` replaces the bytes ``start`` to ``stop``."""

    room: str
    kind: str
    file: str
    line: int
    start: int
    stop: int
    text: str
    before: str
    after: str


class _Places(ast.NodeVisitor):
    """(kind, first byte, last, replacement) of every place in a module where a fault can be planted."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        lines = source.splitlines(keepends=True)
        self.starts = [sum(map(len, lines[:i])) for i in range(len(lines))]
        self.found: list[tuple[str, int, int, str]] = []

    def span(self, node: ast.AST) -> tuple[int, int]:
        return (
            self.starts[node.lineno - 1] + node.col_offset,
            self.starts[node.end_lineno - 1] + node.end_col_offset,
        )

    def visit_Raise(self, node: ast.Raise) -> None:
        """Plant no faults in the wording of messages."""

    visit_JoinedStr = visit_Import = visit_ImportFrom = visit_Raise

    def visit_If(self, node: ast.If) -> None:
        if "TYPE_CHECKING" not in ast.unparse(node.test):
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in [*node.args.defaults, *node.args.kw_defaults]:
            if default is not None:
                self.visit(default)
        for statement in node.body:
            self.visit(statement)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if isinstance(node.op, (ast.Add, ast.Sub)) and not (_is_text(node.left) or _is_text(node.right)):
            stop, last = self.span(node.left)[1], self.span(node)[1]
            between = self.source[stop : self.span(node.right)[0]].decode()  # the operator, and parentheses of both sides
            sign = min(between.find(mark) for mark in "+-" if mark in between)
            other = "-" if between[sign] == "+" else "+"
            self.found.append(("sign", stop + sign, stop + sign + 1, other))
            self.found.append(("dropped term", stop + len(between[:sign].rstrip()), last, ""))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
            start, _ = self.span(node)
            self.found.append(("sign", start, start + 1, "+"))
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            number = index.lower or index.upper if isinstance(index, ast.Slice) else index
            try:
                value = None if number is None else ast.literal_eval(number)
            except ValueError:
                continue
            if isinstance(value, int) and not isinstance(value, bool):
                self.found.append(("index", *self.span(number), str(value + 1 if value in (0, -2) else value - 1)))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = ast.unparse(node.func).rsplit(".", 1)[-1]
        pair = node.args[1:3] if name == "where" else node.args[:2]
        if len(pair) == 2 and name not in NOT_SWAPPED and not any(isinstance(a, ast.Starred) for a in pair):
            (start, stop), (start_2, stop_2) = map(self.span, pair)
            a, between, b = (self.source[i:j].decode() for i, j in ((start, stop), (stop, start_2), (start_2, stop_2)))
            if a != b and ")" not in between and "(" not in between:
                self.found.append(("swapped arguments", start, stop_2, b + between + a))
        self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load) and node.id in OTHER_WAY:
            self.found.append(("direction", *self.span(node), OTHER_WAY[node.id]))

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if isinstance(node.ctx, ast.Load) and node.attr in OTHER_WAY:
            _, stop = self.span(node)
            self.found.append(("direction", stop - len(node.attr), stop, OTHER_WAY[node.attr]))
        self.generic_visit(node)


def _is_text(node: ast.AST) -> bool:
    """Whether + concatenates text or lists and is not a sum."""
    return isinstance(node, (ast.List, ast.Tuple, ast.JoinedStr, ast.ListComp)) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def places(room: str) -> Iterator[Fault]:
    """Every fault that can be planted in a room."""
    files = sorted({path for pattern in ROOMS[room] for path in (ROOT / PACKAGE).glob(pattern)})
    if not files:
        raise SystemExit(f"the room {room!r} of tests/faults.py has no file any more: name its new place there")
    for path in files:
        source = path.read_bytes()
        seen = _Places(source)
        seen.visit(ast.parse(source))
        for kind, start, stop, text in seen.found:
            changed = source[:start] + text.encode() + source[stop:]
            line = source[:start].count(b"\n")
            rows = [s.splitlines()[line].decode().strip() for s in (source, changed)]
            yield Fault(room, kind, str(path.relative_to(ROOT)), line + 1, start, stop, text, *rows)


def draw(seed: int, count: int) -> list[Fault]:
    """This many random faults, one room after another, each of a kind that the room's last faults did not have."""
    random_ = random.Random(seed)
    left: dict[str, dict[str, list[Fault]]] = {}
    for room in ROOMS:
        left[room] = {}
        for fault in places(room):
            left[room].setdefault(fault.kind, []).append(fault)
    kinds = {room: random_.sample(sorted(found), len(found)) for room, found in left.items()}
    drawn: list[Fault] = []
    while len(drawn) < count:
        room = list(ROOMS)[len(drawn) % len(ROOMS)]
        kind = kinds[room][len(drawn) // len(ROOMS) % len(kinds[room])]
        choices = left[room][kind]
        fault = choices.pop(random_.randrange(len(choices)))
        if not choices:
            kinds[room].remove(kind)
        drawn.append(fault)
    return drawn


class Copy:
    """A copy of sources and tests in which faults are planted. The working tree is never changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        # every versioned file, since the contracts' tests read many of them
        kept = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in filter(None, kept.split("\0")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
        # compiled code is looked up by content, since a file changed twice within a second keeps its time stamp
        command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "src"]
        subprocess.run(command, cwd=folder, check=True)
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        self.environment = os.environ | threads | {"PYTHONPATH": str(folder / "src"), "PYTHONDONTWRITEBYTECODE": "1"}

    def first_failure(self, *options: str) -> str | None:
        """The test that fails first, or None if all pass."""
        command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", "--tb=no", "-rfE", *options]
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=STAGE_LIMIT, check=False
            )
        except subprocess.TimeoutExpired:
            return f"no end within {STAGE_LIMIT:g} s"
        if done.returncode == 0:
            return None
        failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return failed[0].split(" ", 1)[1].split(" - ")[0] if failed else f"pytest ended with {done.returncode}"


def mirror(file: str) -> list[str]:
    """The tests closest to a file."""
    parts = Path(file).relative_to(PACKAGE).parts
    named = MIRRORS.get(parts[0])
    if named is not None:
        return named
    for depth in range(len(parts) - 1, 0, -1):
        path = Path("tests", *parts[:depth])
        if (ROOT / path).is_dir():
            return [str(path)]
    return []


def _nearest_first(fault: Fault, folders: list[str]) -> list[str]:
    """The test files of these folders: first those that share most words with the fault's file, then the short ones."""
    known = _words(Path(fault.file).relative_to(PACKAGE).with_suffix(""))
    paths = [ROOT / folder for folder in folders]
    files = {file for path in paths for file in ([path] if path.is_file() else path.rglob("test_*.py"))}

    def distance(file: Path) -> tuple[int, int, str]:
        return -len(known & _words(file.relative_to(ROOT / "tests").with_suffix(""))), file.stat().st_size, str(file)

    return [str(file.relative_to(ROOT)) for file in sorted(files, key=distance)]


def _words(path: Path) -> set[str]:
    return {word for part in path.parts for word in part.removeprefix("test_").split("_")}


def found_by(copy: Copy, fault: Fault, workers: str, *, full: bool) -> tuple[str, str]:
    """(command, test) that finds the fault, or ("nothing", "") if none does."""
    path = copy.folder / fault.file
    source = path.read_bytes()
    path.write_bytes(source[: fault.start] + fault.text.encode() + source[fault.stop :])
    own = _nearest_first(fault, mirror(fault.file))
    others = [file for file in _nearest_first(fault, ["tests"]) if file not in own]
    stages = [("short", own), ("short", ["-n", workers, *others])]
    if full:
        stages.append(("full", ["--rest", "-n", workers, *own, *others]))
    try:
        for name, options in stages:
            test = copy.first_failure(*options)
            if test is not None:
                return name, test
        return "nothing", ""
    finally:
        path.write_bytes(source)


def main() -> int:
    parser = argparse.ArgumentParser(prog="./dev faults", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--from", dest="first", type=int, default=1, metavar="K", help="go on with fault K")
    parser.add_argument("--only", type=int, nargs="+", metavar="K", help="these faults alone")
    parser.add_argument("--workers", default="0", help="processes of a test run, as pytest -n takes them")
    parser.add_argument("--short", action="store_true", help="leave out the full command")
    parser.add_argument("--list", action="store_true", help="print the faults and plant none")
    parser.add_argument("--record", type=Path, help="a file to which each result is added, a line of JSON each")
    options = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        copy = None if options.list else Copy(Path(folder))
        for number, fault in enumerate(draw(options.seed, options.count), 1):
            if number < options.first or (options.only and number not in options.only):
                continue
            sys.stdout.write(f"{number:3d}  {fault.room}, {fault.kind}  {fault.file}:{fault.line}\n")
            sys.stdout.write(f"     - {fault.before}\n     + {fault.after}\n")
            if copy is None:
                continue
            if not results and (failing := copy.first_failure("-n", options.workers)) is not None:
                sys.stderr.write(f"{failing} fails without a fault, so that it would seem to find each one: mend it first\n")
                return 1
            started = time.perf_counter()
            command, test = found_by(copy, fault, options.workers, full=not options.short)
            seconds = time.perf_counter() - started
            results.append(command)
            sys.stdout.write(f"     found by: {command} {test} ({seconds:.0f} s)\n")
            sys.stdout.flush()
            if options.record is not None:
                with options.record.open("a") as record:
                    record.write(json.dumps(asdict(fault) | {"number": number, "found by": command, "test": test}) + "\n")
    if results:
        counts = {name: results.count(name) for name in ("short", "full", "nothing")}
        sys.stdout.write(f"{len(results)} faults: " + ", ".join(f"{n} by {name}" for name, n in counts.items()) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
