"""The evidence for the test vectors of an export, in its self-test and README: chosen samples, digests, and detected and
undetected mutants."""

from __future__ import annotations

from textwrap import fill

import numpy as np

from barbalat.export.equivalence import ASSUMED
from barbalat.export.mutants import Mutant
from barbalat.export.texts import Printed, filled, indented
from barbalat.export.vectors import CANDIDATES, MORE_ROUNDS, ROUNDS, chosen
from barbalat.lowering import c99
from barbalat.lowering.operations import Program
from barbalat.validate import Array

PRIME = 0x100000001B3
"""An odd number: multiplication by it modulo 2^64 maps different numbers to different products, so any single difference changes
a digest."""
MOST_SHOWN = 12
"""Largest number of mutants of one kind that a README lists individually."""


def chosen_tests(printed: Printed) -> str:
    """The text of ``test_chosen``; empty if the simulated run detects every mutant."""
    contents, vectors = printed.contents, chosen(printed.contents)
    layout, rows = contents.layout, contents.layout.rows
    if not vectors.states.shape[1]:
        return ""
    at, places = 0, []
    for part in layout.parts:
        places.append((part.name, part.size, at))
        at += part.size
    same = [f"same(c.{name}, chosen_after[k] + {at}, {size})" for name, size, at in places]
    return filled(
        "selftest_chosen.c",
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        measured=printed.measured,
        u=layout.u.name,
        count=vectors.states.shape[1],
        numbers=len(rows),
        before_rows=number_rows(printed, vectors.states[rows].T),
        measured_rows=number_rows(printed, vectors.measured.T),
        command_rows=number_rows(printed, vectors.commands.T),
        parameter_table=_parameter_table(printed, vectors.parameters),
        set_parameters=indented(
            ["memcpy(c.parameter, chosen_parameters[k], sizeof c.parameter);"] if contents.parameters else [], 8
        ),
        freeze=", ".join(str(int(value)) for value in vectors.freeze),
        after_rows=number_rows(printed, vectors.after[rows].T),
        set=indented((f"memcpy(c.{name}, chosen_before[k] + {at}, sizeof c.{name});" for name, _, at in places), 8),
        limited="" if any(one.limit for one in contents.parameters) else " && is_limited(&out)",
        has="\n                && ".join(same),
        estimates=f" && same(out.theta_hat, c.{layout.theta_hat.name}, {printed.macro}_ESTIMATES)" if contents.sizes[3] else "",
    )


def _parameter_table(printed: Printed, values: Array) -> str:
    """The parameters that are set for each chosen sample; empty if there are none."""
    if not printed.contents.parameters:
        return ""
    rows = number_rows(printed, values.T)
    return f"static const {printed.real} chosen_parameters[CHOSEN][{printed.macro}_PARAMETERS] = {{\n{rows}}};\n"


def number_rows(printed: Printed, values: Array) -> str:
    """Rows of a table in C."""
    real = printed.contents.real
    return indented(f"{{ {', '.join(c99.constant(value, real) for value in row)} }}," for row in values)


def digests(printed: Printed) -> str:
    """The digest of the state after each sample of the simulation, as in the C code."""
    return digests_of(printed, printed.contents.vectors.states[:, printed.contents.layout.rows])


def digests_of(printed: Printed, rows: Array) -> str:
    """The digest of each row of numbers (K, n), as in the C code: the bits are taken in sequence, with a multiplication by PRIME
    each time."""
    states = rows.astype(printed.contents.real.numbers)
    bits = np.ascontiguousarray(states).view(np.uint64 if states.itemsize == 8 else np.uint32)
    found = np.zeros(len(states), dtype=np.uint64)
    for column in bits.T:
        found = (found ^ column) * np.uint64(PRIME)
    return ",\n    ".join(", ".join(f"0x{value:016x}ULL" for value in found[i : i + 4]) for i in range(0, len(found), 4))


def digest_calls(printed: Printed) -> str:
    """C that computes the digest ``found`` of the whole state of ``c``."""
    return indented(f"found = mixed(found, c->{part.name}, {part.size});" for part in printed.contents.layout.parts)


def readme_evidence(printed: Printed) -> str:
    """The section of README.md."""
    vectors, contents = chosen(printed.contents), printed.contents
    count, told, proven = vectors.counted(ties=False)
    ties, ties_told, ties_proven = vectors.counted(ties=True)
    nominal = sum(not one.tie for one in vectors.mutants) - sum(not one.tie for one in vectors.missed_by_the_run)
    conditional = sum(proof.endswith(ASSUMED) and not one.tie for one, proof in vectors.missed.items())
    share = told / max(count - proven, 1)
    return filled(
        "README_evidence.md",
        samples=len(contents.vectors.states),
        chosen=vectors.states.shape[1],
        count=count,
        nominal=nominal,
        told=told,
        proven=proven,
        conditions=f"; {conditional} of them{ASSUMED.removeprefix(',')}" if conditional else "",
        undecided=count - told - proven,
        share=f"{100 * share:.1f}",
        ties=ties,
        ties_told=ties_told,
        ties_proven=ties_proven,
        outcomes=outcomes(vectors.outcomes, contents.step),
        rounds=ROUNDS + MORE_ROUNDS,
        candidates=CANDIDATES,
        listed=_listed(vectors.missed),
    )


def outcomes(found: tuple[int, int], program: Program) -> str:
    """A sentence on the covered outcomes of decisions, for reviewers who require MC/DC; the operators && and || have several
    conditions."""
    taken, of = found
    if not of:
        return "`advance` decides nothing: it has no branch."
    said = (
        f"The only decisions in `advance` are its {of // 2} choices `a ? b : c`, each with one condition, and MC/DC requires "
        f"both outcomes of each. These samples exercise at least {taken} of the {of} outcomes."
    )
    several = any(op.name in ("and", "or") for op in program.operations)
    more = " These counts omit conditions joined by && or ||; `./dev mutants` measures them if clang-19 is installed."
    return fill(said + (more if several else ""), 128)


def _listed(missed: dict[Mutant, str]) -> str:
    """The undecided and the proven mutants, one per line."""
    undecided = [_line(one, "undecided") for one, proof in missed.items() if not proof and not one.tie]
    shown = [_line(one, proof) for one, proof in missed.items() if proof]
    more = len(undecided) - MOST_SHOWN
    lines = [*undecided[:MOST_SHOWN], *([f"| | and {more} more | undecided |"] if more > 0 else []), *shown]
    return "\n".join(["", "| operation | mutant | |", "|---|---|---|", *lines, ""]) if lines else ""


def _line(one: Mutant, said: str) -> str:
    return f"| `t{one.place}` | {one.said} | {said} |"
