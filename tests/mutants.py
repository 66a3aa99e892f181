"""Mutation of exported source: ``./dev mutants`` compiles mutants of each export and lets the export's self-test find them.

There is an export for every combination of scheme, problem (known set, one input or two, regressor), form, law and modification
among the tests' examples. ``--quick`` draws a few of them for a minute, and ``--all`` uses every example. The mutants of an
export are compiled once, and a number selects one. Mutants that the export's README calls killed must be killed, and those proven
equivalent must not. The exit code is 1 if this is violated or a score is below 97 %. Kinds below 97 % are named.

Then the C around the arithmetic is mutated with several shells: starts, checks of inputs and of the state, the fallback and the
timer. Surviving mutants run through random walks. Those that differ there are faults, and the self-test must find 97 % of all
known faults. The rest differ in no walk, and nothing is proven about them.
"""

# ruff: noqa: T201  # a command that prints; the tests' own folder comes before the imports from it
from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from barbalat.export.c99.files import made_of
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE, FLOAT, Real
from barbalat.plants import Shell
from barbalat.validate import InputError
from export.around_mutation import KINDS, found_around
from export.examples import SIMULATION
from export.mutation import coverage, found_in_c
from export.test_bit_identical import EXAMPLES, ONE_OF_EACH
from export.test_shell import surrounded
from turns import drawn

FLOOR = 0.97
QUICK = 9
"""Number of exports with ``--quick``, one of them with a shell, which takes about a minute on one core."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="./dev mutants", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="beginnings of examples' names; one of each kind by default")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_true", help=f"{QUICK} exports, which the commit draws")
    which.add_argument("--all", action="store_true", help="every example")
    parser.add_argument("--float32", action="store_true", help="exports in 32 bits")
    parser.add_argument("--parameters", action="store_true", help="exports whose numbers are parameters")
    parser.add_argument("--undecided", action="store_true", help="list those that are neither killed nor proven to be no fault")
    options = parser.parse_args()
    names = [name for name in EXAMPLES if options.all or name in ONE_OF_EACH]
    if options.names:
        names = [name for name in EXAMPLES if name.startswith(tuple(options.names))]
    names, real = drawn(names, QUICK) if options.quick else names, FLOAT if options.float32 else DOUBLE
    totals, below, wrong = [0, 0, 0], [], []
    for name in names:
        begun = time.process_time()
        try:
            printed = Printed(made_of(*EXAMPLES[name], SIMULATION, real, parameters=options.parameters))
        except InputError as error:
            print(f"{name}: {error}")
            continue
        with tempfile.TemporaryDirectory(prefix="barbalat-") as folder:
            found = found_in_c(printed, Path(folder))
            covered = coverage(printed, Path(folder))
        count, killed, proven = found.counted()
        ties, ties_killed, ties_proven = found.counted(ties=True)
        totals = [a + b for a, b in zip(totals, (count, killed, proven), strict=True)]
        print(
            f"{name}: {killed} of {count} killed, {proven} proven to be no fault: {100 * found.score:.1f} %; "
            f"ties: {ties_killed} of {ties}, {ties_proven} proven; {covered}; {time.process_time() - begun:.1f} s here",
            flush=True,
        )
        if options.undecided:
            print("".join(f"    t{one.place}: {one.said}\n" for one in found.undecided), end="")
        below += [name] if found.score < FLOOR else []
        wrong += [f"{name}: t{one.place}: {one.said}" for one in found.contradictions]
    count, killed, proven = totals
    print(f"\n{len(names)} exports: {killed} of {count} mutants killed, {proven} proven to be no fault", end="")
    print(f": {100 * killed / (count - proven):.1f} %" if count > proven else "")
    print(f"below {100 * FLOOR:g} %: {', '.join(below) or 'none'}")
    print("".join(f"the README and the C disagree: {one}\n" for one in wrong), end="")
    kinds = [one for one in KINDS if not options.names or one[0].startswith(tuple(options.names))]
    enough = _around(drawn(kinds, 1) if options.quick else kinds, real, parameters=options.parameters)
    return 1 if below or wrong or not enough else 0


def _around(kinds: Sequence[tuple[str, Shell | None]], real: Real, *, parameters: bool) -> bool:
    """Whether the self-tests of these exports find enough of the known faults around ``advance``."""
    enough = True
    for beginning, shell in kinds:
        printed = Printed(made_of(*surrounded(beginning, shell), SIMULATION, real, parameters=parameters))
        with tempfile.TemporaryDirectory(prefix="barbalat-") as folder:
            found = found_around(printed, Path(folder))
        killed, same = found.letters.count("x"), found.letters.count(".")
        print(
            f"around {beginning} {'without a shell' if shell is None else f'with fallback {shell.fallback}'}: {killed} of "
            f"{len(found.mutants)} killed, {len(found.missed)} missed, {same} differ in no walk: {100 * found.score:.1f} %"
        )
        print("".join(f"    {one.function}: {one.line} -> {one.other}\n" for one in found.missed), end="", flush=True)
        enough &= found.score >= FLOOR
    return enough


if __name__ == "__main__":
    sys.exit(main())
