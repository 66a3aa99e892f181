"""Mutants of the C around ``advance``: starts, the shell, rejections and checks of the state, all in one program.

Each is a copy of its function with one changed place, and the function calls the copy that is selected. A mutant that the
self-test does not find is compared with the export on random samples, faults, starts and corrupted states. If a bit of an output
differs, the mutant is a fault that the self-test misses. The others may be equivalent, but nothing is proven about them.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from barbalat.export.selftest import selftest
from barbalat.export.shell import members
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering import c99
from barbalat.plants import Shell
from export.targets import ISO, write

FUNCTION = re.compile(r"^((?:static )?\w[\w ]*? )(\w+)\(([^;{}]*?)\)\n\{\n(.*?)^\}\n", re.MULTILINE | re.DOTALL)
FIRST = "/* Whether every number is in range"
"""The line at which the functions of the export begin, after the functions of the library."""
STATEMENT = re.compile(r"^ +((?:\+\+|--)?[\w*][\w>.\[\]-]*(?: [-+*|]?= .+)?|\w+\(.*\)|\(void\)\w+\(.*\));$")
NUMBER = r"0x1\.[0-9a-f]+p[-+][0-9]+f?"
"""A rate, a limit or an initial value, other than zero."""
RULES = (
    (r"<=", "<"), (r">=", ">"), (r"(?<=\s)<(?=\s)", "<="), (r"(?<=\s)>(?=\s)", ">="), (r"==", "!="), (r"!=", "=="),
    (r"&&", "||"), (r"\|\|", "&&"), (r"(?<=\w|\]|\)) \+ ", " - "), (r"(?<=\w|\]|\)) - ", " + "), (r" / ", " * "),
    (r"(?<=\w|\]|\)) \* ", " / "), (r"\+\+(?=c|i)", "--"), (r"--(?=c|m)", "++"), (r"\b0L\b", "1L"), (r"\b1L\b", "0L"),
    (r"\b1L\b", "2L"), (r"(?<= )0(?=[;,)])", "1"), (r"(?<= )1(?=[;,)])", "0"), (r"(?<=return )0", "1"), (r"(?<=return )1", "0"),
    (r"!(?=[\w(])", ""), (r"\|= ", "= "), (r" \| ", " & "), (r"\b0\.5f?\b", "0.6"), (r"\b1\.5f?\b", "1.0"),
    (r"\b1000000000L\b", "1000L"), (r"_FADE\b", "_LONGEST_OUTAGE"), (r"_LONGEST_OUTAGE\b", "_FADE"),
    (r"\? (\w[\w.>\[\]-]*) : (\w[\w.>\[\]-]*)", r"? \2 : \1"),
    *((rf"(?:-|\b)(?:{NUMBER}|\w+_(?:RANGE|BAND)\b)", rf"(\g<0> * {factor})") for factor in (0.95, 1.05, 0.01, 100.0)),
)  # fmt: skip
"""The replacements that a mutant makes at one place of a line."""
SECONDS = 1
"""Limit of processor time for the self-test or the walk of one mutant, which also finds mutants that hang. Others take less than
0.1 s."""
STEPS = 60_000
"""Samples of a walk."""
FULL = Shell(
    range={"x_1": [-2.0, 2.0], "command": [-1.2, 1.2]},
    rate={"command": 3.0, "x_1": 50.0},
    stuck={"x_2": 0.04},
    longest_outage=0.05,
    fallback="fade",
    fade=0.2,
    jitter=0.1,
)
KINDS = (
    ("Mrac-state-midpoint", FULL),
    ("L1Adaptive-several-midpoint", replace(FULL, fallback="zero")),
    ("MracOutput-output-midpoint", Shell(rate={"x_1": 10.0}, longest_outage=0.03, fade=0.1)),
    ("L1PiecewiseConstant-state", replace(FULL, fallback="hold", stuck={})),
    ("NormalizedMrac-state-euler", Shell(range={"x_1": [-2.0, 2.0]}, rate={"x_2": 60.0})),
    ("L1Adaptive-state-euler", None),
)
"""Beginnings of examples' names with their shells."""


@dataclass(frozen=True)
class Changed:
    """One mutant: its function, the line and the line in its place."""

    function: str
    line: str
    other: str


@dataclass(frozen=True, eq=False)
class FoundAround:
    """For each mutant, "x" if the self-test finds it, "d" if only the walk shows that it is a fault, "." otherwise."""

    mutants: tuple[Changed, ...]
    letters: str

    @property
    def missed(self) -> list[Changed]:
        """The faults that the self-test misses."""
        return [one for one, letter in zip(self.mutants, self.letters, strict=True) if letter == "d"]

    @property
    def score(self) -> float:
        """The fraction of killed mutants among those that are known to be faults."""
        killed = self.letters.count("x")
        return killed / (killed + len(self.missed))


def mutated_around(printed: Printed) -> tuple[str, tuple[Changed, ...]]:
    """controller.c with every mutant, and the mutants in order. ``barbalat_mutant`` selects one."""
    text = source(printed)
    if f"{printed.macro}_LONGEST_OUTAGE" not in header(printed):
        rules = tuple(one for one in RULES if "OUTAGE" not in one[1] and "OUTAGE" not in one[0])
    else:
        rules = RULES
    begins = text.index(FIRST)
    made: list[Changed] = []

    def with_copies(found: re.Match[str]) -> str:
        kind, name, given, body = found.groups()
        if name == "advance":
            return found[0]
        static = kind if kind.startswith("static ") else f"static {kind}"
        lines, copies, chosen = body.split("\n"), "", ""
        names = ", ".join(re.sub(r"\[.*?\]", "", one).split()[-1].lstrip("*") for one in given.split(","))
        for i, line in enumerate(lines):
            for other in _changed(line, rules):
                copy = "\n".join([*lines[:i], other, *lines[i + 1 :]])
                copies += f"{static}{name}_{len(made)}({given})\n{{\n{copy}}}\n\n"
                call = f"{name}_{len(made)}({names})"
                chosen += f"    case {len(made)}: {f'{call}; return' if kind.endswith('void ') else f'return {call}'};\n"
                made.append(Changed(name, line.strip(), other.strip()))
        switch = f"    switch (barbalat_mutant) {{\n{chosen}    default: break;\n    }}\n" if chosen else ""
        return f"{copies}{kind}{name}({given})\n{{\n{switch}{body}}}\n"

    whole = FUNCTION.sub(with_copies, text[begins:])
    return f"{text[:begins]}extern int barbalat_mutant;\n{whole}", tuple(made)


def _changed(line: str, rules: tuple[tuple[str, str], ...]) -> Iterator[str]:
    code = re.sub(r"/\*.*?\*/", lambda found: " " * len(found[0]), line).rstrip()
    if not code.strip() or (code.lstrip().startswith("const ") and "=" not in code):
        return
    for pattern, other in rules:
        if other == "<=" and code.lstrip().startswith("for "):
            continue  # which would read beyond an array
        for found in re.finditer(pattern, code):
            yield code[: found.start()] + found.expand(other) + code[found.end() :]
    if STATEMENT.match(code) and not code.lstrip().startswith(("return", "break")):
        yield re.sub(r"\S.*", ";", code)


def found_around(printed: Printed, folder: Path) -> FoundAround:
    """Compile the mutants once. The export's own self-test judges each of them, and the walk judges those that the self-test
    misses."""
    text, mutants = mutated_around(printed)
    write(folder, {"controller.h": header(printed), "controller.c": text, "selftest.c": selftest(printed)})
    write(folder, {"main.c": _walk(printed)})
    for name, *options in (("controller",), ("selftest", "-Dmain=selftest_main"), ("main",)):
        standard = ["-std=gnu99"] if name == "main" else ISO  # Windows has no fork
        subprocess.run(["gcc", *standard, "-O1", "-w", *options, "-c", f"{name}.c"], cwd=folder, check=True, timeout=300)
    subprocess.run(["gcc", "controller.o", "selftest.o", "main.o", "-o", "around", "-lm"], cwd=folder, check=True, timeout=60)
    done = subprocess.run([folder / "around", str(len(mutants))], capture_output=True, text=True, check=True)
    assert done.stdout[0] == ".", "the self-test fails without a mutant"
    return FoundAround(mutants, done.stdout[1:])


def _walk(printed: Printed) -> str:
    """The program that runs the self-test and the walk for each mutant."""
    contents = printed.contents
    sizes = np.abs(contents.vectors.measured).max(axis=0), np.abs(contents.vectors.commands).max(axis=0)
    of_y, of_r = (", ".join(c99.constant(float(one) or 1.0, c99.DOUBLE) for one in some) for some in sizes)
    counts = ["c.fade", "c.fade_left"]
    around = contents.around
    counts += [f"c.{name}" for name in members(around)]
    ends = around is not None and around.longest is not None
    return (
        _MAIN.replace("NAME", printed.name)
        .replace("MACRO", printed.macro)
        .replace("REAL", printed.real)
        .replace("MEASUREMENT", printed.measured)
        .replace("OF_Y", of_y)
        .replace("OF_R", of_r)
        .replace("GIVEN", "x, " if contents.measures_state else "")
        .replace("COUNTS", ", ".join(f"&{one}" for one in counts))
        .replace("NUMBERS", str(len(contents.layout.rows)))
        .replace("ESTIMATED", "mix(out.theta_hat, sizeof out.theta_hat);" if contents.sizes[3] else "")
        .replace("OUTAGE", f"{int(around.longest)}L" if around is not None and around.longest is not None else "5L")
        .replace("ENDS", f"c.outage = in(0.5) ? {printed.macro}_LONGEST_OUTAGE : c.outage;" if ends else "")
        .replace("STEPS", str(STEPS))
        .replace("SECONDS", str(SECONDS))
    )


_MAIN = """\
#include "controller.h"
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

int barbalat_mutant = -1;
int selftest_main(void);

static unsigned long long state, digest;

static double drawn(void)
{
    state ^= state << 13; state ^= state >> 7; state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0;
}

static int in(double share) { return drawn() < share; }

static void mix(const void *of, size_t size)
{
    const unsigned char *at = of;
    for (; size > 0; --size) { digest = (digest ^ *at++) * 1099511628211ULL; }
}

static unsigned long long walk(void)
{
    static const double of_y[] = { OF_Y }, of_r[] = { OF_R };
    NAME_controller c;
    long *counts[] = { COUNTS };
    const long values[] = { -1, 0, 1, 2, OUTAGE - 1, OUTAGE, OUTAGE + 1, 999999999, 1000000000, 1000000001 };
    double y[MACRO_MEASURED] = { 0 };
    int k, i, lost = 0, large = 0, stuck = 0;
    state = 88172645463325252ULL; digest = 1469598103934665603ULL;
    memset(&c, 0, sizeof c);
    NAME_init(&c);
    for (k = 0; k < STEPS; ++k) {
        NAME_input given; NAME_output out; REAL x[MACRO_MEASURED], u[MACRO_INPUTS]; unsigned status;
        for (i = 0; i < MACRO_MEASURED; ++i) {
            y[i] = stuck > 0 ? y[i] : 0.98 * y[i] + 0.05 * of_y[i] * (drawn() - 0.5);
            x[i] = (REAL)y[i];
        }
        if (in(0.001)) { NAME_reset(&c); }
        if (in(0.003)) {
            for (i = 0; i < MACRO_INPUTS; ++i) { u[i] = (REAL)(20 * (drawn() - 0.5)); }
            u[0] = in(0.1) ? (REAL)NAN : u[0];
            status = NAME_start(&c, GIVENu, (long)(60 * drawn()) - 3, in(0.5));
            mix(&status, sizeof status);
        }
        if (in(0.002)) { /* memory is corrupted */
            const int place = (int)(drawn() * (NUMBERS + 2 * MACRO_INPUTS));
            ((REAL *)&c)[place] = in(0.3) ? (REAL)NAN : (REAL)(MACRO_RANGE * (2.4 * drawn() - 1.2));
        }
        if (in(0.003)) { *counts[(int)(drawn() * (sizeof counts / sizeof *counts))] = values[(int)(drawn() * 10)]; }
        if (in(0.003)) { /* results out of range follow */
            for (i = 0; i < NUMBERS; ++i) { ((REAL *)&c)[i] = in(0.5) ? ((REAL *)&c)[i] : in(0.5) ? MACRO_RANGE : -MACRO_RANGE; }
            c.refused = (int)(drawn() * (MACRO_REFUSALS + 1)); ENDS
        }
        if (in(0.003)) { for (i = 0; i < MACRO_INPUTS; ++i) { c.last_u[i] = (REAL)(200 * (drawn() - 0.5)); } }
        lost = lost > 0 ? lost - 1 : in(0.04) ? (int)(30 * drawn()) : 0;
        large = large > 0 ? large - 1 : in(0.002) ? (int)(30 * drawn()) : 0;
        stuck = stuck > 0 ? stuck - 1 : in(0.01) ? (int)(40 * drawn()) : 0;
        memset(&given, 0, sizeof given);
        for (i = 0; i < MACRO_MEASURED; ++i) {
            given.MEASUREMENT[i] = lost > 0 ? (REAL)NAN : large > 0 ? (REAL)(2.2 * MACRO_RANGE * (drawn() - 0.5)) : x[i];
            if (in(0.01)) { given.MEASUREMENT[i] += (REAL)(4 * of_y[i] * (drawn() - 0.5)); }
        }
        for (i = 0; i < MACRO_COMMANDS; ++i) { given.r[i] = in(0.03) ? (REAL)NAN : (REAL)(2.4 * of_r[i] * (drawn() - 0.5)); }
        given.sample_time = MACRO_SAMPLE_TIME;
        if (in(0.05)) { given.sample_time *= (REAL)(1 + (int)(drawn() * (OUTAGE + 4))); }
        if (in(0.05)) { given.sample_time *= (REAL)(1 + 0.3 * (drawn() - 0.5)); }
        if (in(0.01)) { given.sample_time *= (REAL)(1 + 0.003 * (drawn() - 0.5)); }
        given.freeze = in(0.05);
        status = NAME_step(&c, &given, &out);
        mix(&status, sizeof status); ESTIMATED
        for (i = 0; i < MACRO_INPUTS; ++i) { u[i] = out.u[i] + 0; mix(&u[i], sizeof *u); } /* +0 and -0 are the same control */
        for (i = 0; i < MACRO_INPUTS; ++i) { u[i] = out.u_limited[i] + 0; mix(&u[i], sizeof *u); }
    }
    return digest;
}

/* Whether this process, which runs one mutant, ends with 0. */
static int passes(int mutant, int walks, unsigned long long origin)
{
    int status;
    const pid_t child = (fflush(stdout), fork());
    if (child == 0) {
        if (freopen("/dev/null", "w", stdout) == NULL) { _exit(2); }
        setitimer(ITIMER_PROF, &(struct itimerval){ .it_value = { .tv_sec = SECONDS } }, NULL);
        barbalat_mutant = mutant;
        _exit(walks ? walk() != origin : selftest_main());
    }
    if (child < 0 || waitpid(child, &status, 0) != child) { exit(2); }
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

int main(int count, char **arguments)
{
    const unsigned long long origin = walk();
    int k;
    putchar(passes(-1, 0, 0) ? '.' : 'x');
    for (k = 0; k < atoi(arguments[count - 1]); ++k) { putchar(!passes(k, 0, 0) ? 'x' : passes(k, 1, origin) ? '.' : 'd'); }
    return 0;
}
"""
