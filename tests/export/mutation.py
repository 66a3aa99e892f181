"""Mutants of an exported ``advance`` in C, all in one program: it is compiled once, and a number selects the mutant."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from barbalat.export.mutants import Mutant
from barbalat.export.selftest import selftest
from barbalat.export.source import header, inputs, source
from barbalat.export.texts import Printed
from barbalat.export.vectors import Vectors, chosen
from barbalat.lowering import c99
from export.targets import ISO, write

STATEMENT = re.compile(r"^    const (int|double|float) t(\d+) = (.*?);( /\*.*)?$", re.MULTILINE)
SECONDS = 10
"""Time limit for one mutant's self-test, which takes milliseconds. The limit also finds mutants that hang."""
_MAIN = """\
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

int barbalat_mutant = -1;
int selftest_main(void);

/* Whether the self-test finds each of so many mutants, each in a process of its own, and before them nothing in the export. */
int main(int count, char **arguments)
{
    int k, status;
    for (k = -1; k < atoi(arguments[count - 1]); ++k) {
        const pid_t child = (fflush(stdout), fork());
        if (child == 0) {
            if (freopen("/dev/null", "w", stdout) == NULL) { _exit(2); }
            alarm(SECONDS);
            barbalat_mutant = k;
            _exit(selftest_main());
        }
        if (child < 0 || waitpid(child, &status, 0) != child) { return 2; }
        putchar(WIFEXITED(status) && WEXITSTATUS(status) == 0 ? '.' : 'x');
    }
    return 0;
}
"""


@dataclass(frozen=True, eq=False)
class Found:
    """The results of the compiled self-test for the mutants, in the order of the mutants."""

    vectors: Vectors
    killed: tuple[bool, ...]

    def counted(self, *, ties: bool = False) -> tuple[int, int, int]:
        """The number of mutants, of killed mutants and of mutants proven equivalent."""
        pairs = [(one, killed) for one, killed in zip(self.vectors.mutants, self.killed, strict=True) if one.tie == ties]
        proven = sum(bool(self.vectors.missed.get(one)) for one, _ in pairs)
        return len(pairs), sum(killed for _, killed in pairs), proven

    @property
    def score(self) -> float:
        count, killed, proven = self.counted()
        return killed / (count - proven)

    @property
    def contradictions(self) -> list[Mutant]:
        """Mutants that survive although the vectors should kill them, or that are killed although proven equivalent."""
        return [
            one
            for one, killed in zip(self.vectors.mutants, self.killed, strict=True)
            if killed != (one not in self.vectors.missed) and (not killed or self.vectors.missed[one])
        ]

    @property
    def undecided(self) -> list[Mutant]:
        pairs = zip(self.vectors.mutants, self.killed, strict=True)
        return [one for one, killed in pairs if not killed and not one.tie and not self.vectors.missed.get(one)]


def mutated(printed: Printed, mutants: tuple[Mutant, ...]) -> str:
    """controller.c with all mutants. ``barbalat_mutant`` selects one by its index, and -1 selects none."""
    contents, texts = printed.contents, inputs(printed)
    printer, operations = c99.Printer(contents.step, contents.real), contents.step.operations
    others: dict[int, list[str]] = {}
    text = source(printed)
    for k, one in enumerate(mutants):
        if one.operation is None:
            entry = contents.layout.entries()[one.place]
            text, stores = re.subn(
                rf"(static void advance\(.*?\n    {re.escape(entry)} = )([^;]*);",
                rf"\g<1>barbalat_mutant == {k} ? {entry} : \g<2>;",
                text,
                count=1,
                flags=re.DOTALL,
            )
            assert stores == 1, entry
            continue
        op = one.operation
        if op.name == "copy":
            made = printer.number(op.operands[0])
        elif op.name == "constant":
            made = c99.constant(op.value, contents.real)
        else:
            made = texts[op.source] if op.name == "input" else printer.expression(op)
        others.setdefault(one.place, []).append(f"barbalat_mutant == {k} ? {'!' if one.denied else ''}({made}) : ")

    def with_mutants(found: re.Match[str]) -> str:
        kind, place, expression, remark = found.groups()
        chain = "".join(others.pop(int(place), []))
        return f"    const {kind} t{place} = {chain}({expression});{remark or ''}"

    first = text.index("static void advance(")
    last = text.index("\n}\n", first)
    assert len(STATEMENT.findall(text[first:last])) == len(operations)
    text = text[:first] + STATEMENT.sub(with_mutants, text[first:last]) + text[last:]
    assert not others
    return text.replace("static void advance(", "extern int barbalat_mutant;\nstatic void advance(", 1)


def found_in_c(printed: Printed, folder: Path) -> Found:
    """Compile the mutants once and let the self-test of the export judge each of them."""
    vectors = chosen(printed.contents)
    write(folder, {"controller.h": header(printed), "controller.c": mutated(printed, vectors.mutants)})
    write(folder, {"selftest.c": selftest(printed), "main.c": _MAIN})
    for name, *options in (("controller",), ("selftest", "-Dmain=selftest_main"), ("main", f"-DSECONDS={SECONDS}")):
        standard = ["-std=gnu99"] if name == "main" else ISO  # Windows has no fork
        subprocess.run(["gcc", *standard, "-O1", "-w", *options, "-c", f"{name}.c"], cwd=folder, check=True, timeout=300)
    subprocess.run(["gcc", "controller.o", "selftest.o", "main.o", "-o", "mutants", "-lm"], cwd=folder, check=True, timeout=60)
    done = subprocess.run([folder / "mutants", str(len(vectors.mutants))], capture_output=True, text=True, check=True)
    assert done.stdout[0] == ".", "the self-test fails without a mutant"
    return Found(vectors, tuple(letter == "x" for letter in done.stdout[1:]))


def coverage(printed: Printed, folder: Path) -> str:
    """The self-test's coverage of ``advance``: MC/DC by clang-19 if it is installed, otherwise the branch outcomes by
    gcov."""
    write(folder, {"controller.h": header(printed), "controller.c": source(printed), "selftest.c": selftest(printed)})
    return _modified_conditions(folder) if shutil.which("clang-19") and shutil.which("llvm-cov-19") else _branches(folder)


def _modified_conditions(folder: Path) -> str:
    options = ["-fprofile-instr-generate", "-fcoverage-mapping", "-fcoverage-mcdc"]
    command = ["clang-19", *ISO, "-O0", "-w", *options, "controller.c", "selftest.c", "-o", "covered", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=300)
    subprocess.run(["./covered"], cwd=folder, check=True, timeout=60, capture_output=True, env={"LLVM_PROFILE_FILE": "raw"})
    subprocess.run(["llvm-profdata-19", "merge", "raw", "-o", "data"], cwd=folder, check=True, timeout=60)
    shown = ["llvm-cov-19", "export", "covered", "-instr-profile=data"]
    told = json.loads(subprocess.run(shown, cwd=folder, check=True, timeout=60, capture_output=True).stdout)
    (one,) = [found for found in told["data"][0]["functions"] if found["name"].endswith(":advance")]
    outcomes = [count for branch in one["branches"] for count in branch[4:6]]
    shown_to_decide = [condition for record in one["mcdc_records"] for condition in record[-1]]
    several = (
        f", {sum(shown_to_decide)} of {len(shown_to_decide)} conditions of decisions with several" if shown_to_decide else ""
    )
    return f"MC/DC: {sum(map(bool, outcomes))} of {len(outcomes)} condition outcomes{several}"


def _branches(folder: Path) -> str:
    command = ["gcc", *ISO, "-O0", "-w", "--coverage", "controller.c", "selftest.c", "-o", "covered", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=300)
    subprocess.run(["./covered"], cwd=folder, check=True, timeout=60, capture_output=True)
    name = next(file.name for file in folder.glob("*controller.gcda"))
    subprocess.run(["gcov", "-b", "-c", name], cwd=folder, check=True, timeout=60, capture_output=True)
    text = (folder / "controller.c.gcov").read_text()
    inside = text[text.index("static void advance(") :]
    inside = inside[: inside.index(":}\n")]
    taken = re.findall(r"^branch +\d+ (taken \d+|never executed)", inside, re.MULTILINE)
    covered = sum(one not in ("taken 0", "never executed") for one in taken)
    return f"{covered} of {len(taken)} branch outcomes taken"
