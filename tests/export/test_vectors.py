"""What an export says of its test vectors: the compiled C agrees, proofs hold for numbers drawn anew, faces are reached."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.export.contents import Contents
from barbalat.export.equivalence import Interval, Prover
from barbalat.export.evidence import readme_evidence
from barbalat.export.mutants import Mutant
from barbalat.export.texts import Printed
from barbalat.export.vectors import _Search, chosen
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.lowering.operations import Operation, Program
from export.examples import SIMULATION
from export.mutation import coverage, found_in_c
from export.targets import needs_gcc
from export.test_bit_identical import EXAMPLES

KINDS = (
    "Adrc-state-midpoint",
    "Mrac-state-midpoint",
    "L1Adaptive-gain-midpoint",
    "NormalizedMrac-state-euler",
    "NormalizedMrac-ball-euler",
    "RobustMrac-free-euler",
    "L1Adaptive-several-euler",
    "L1Adaptive-polynomial-euler",
)


def contents(beginning: str, real=DOUBLE) -> Contents:
    name = next(name for name in EXAMPLES if name.startswith(beginning))
    return Contents.of(*EXAMPLES[name], SIMULATION, real)


@needs_gcc
@pytest.mark.parametrize("float32", [False, True])
@pytest.mark.parametrize("beginning", KINDS)
@pytest.mark.short(kept=lambda beginning, float32: beginning == KINDS[3] and not float32)
def test_the_compiled_self_test_kills_what_the_readme_says(beginning, float32, tmp_path) -> None:
    """At least 97 % of the mutants that are not proven to be no fault; those that are proven to be none survive."""
    printed = Printed(contents(beginning, FLOAT if float32 else DOUBLE))
    found = found_in_c(printed, tmp_path)
    assert found.contradictions == []
    assert found.score >= 0.97
    count, killed, proven = chosen(printed.contents).counted(ties=False)
    assert f"| undecided | {count - killed - proven} |" in readme_evidence(printed)


@pytest.mark.parametrize("beginning", KINDS)
@pytest.mark.short(kept=lambda beginning: beginning == KINDS[1])
def test_numbers_drawn_anew_kill_no_mutant_that_is_proven_to_be_none(beginning) -> None:
    made = contents(beginning)
    search = _Search(made)
    search.random = np.random.default_rng(99)
    proven = [one for one, proof in chosen(made).missed.items() if proof]
    for _ in range(6):
        pool = search._usable(search._drawn())
        judge = search._judge(np.hstack([pool, search._usable(search._bisected(pool))]))
        assert [one for one in proven if judge.tell(one).any()] == []


def test_the_sign_of_zero_and_the_rounding_of_a_root_are_not_proven_away() -> None:
    """sqrt(-0.0) is -0.0, so that its size is another number; in 32 bits sqrt(2) lies below what 64 bits give, and equals c."""
    x, within = Operation("input", (), source=(0, 0)), {(0, 0): Interval(0.0, 3.0)}
    size = Program((x, Operation("sqrt", (0,)), Operation("fabs", (1,))), ((2,),))
    left_out = Mutant(2, "fabs is left out", Operation("copy", (1,)))
    assert Prover(size, within, DOUBLE).proof(left_out) == ""
    constants = [Operation("constant", (), value=value) for value in (2**0.5, 5.0, 7.0)]
    chosen_of = (x, Operation("sqrt", (0,)), *constants, Operation("le", (1, 2)), Operation("select", (5, 3, 4)))
    second = Mutant(6, "select takes the second always", Operation("copy", (4,)))
    for real in (FLOAT, DOUBLE):
        assert Prover(Program(chosen_of, ((6,),)), {(0, 0): Interval(2.0, 3.0)}, real).proof(second) == ""
    assert Prover(Program(chosen_of, ((6,),)), {(0, 0): Interval(2.1, 3.0)}, FLOAT).proof(second)


def test_the_midpoint_laws_projection_is_reached_at_every_face() -> None:
    """In the run of the simulation it never is; chosen samples end on each face."""
    made = contents("Mrac-state-midpoint")
    rows, (low, high) = list(made.layout.theta_hat.rows), made.limits
    run = made.vectors.states[:, rows]
    assert (run > low).all() and (run < high).all()
    after = chosen(made).after[rows].T
    assert (after == low).any(axis=0).all() and (after == high).any(axis=0).all()


@needs_gcc
def test_the_self_test_takes_both_sides_of_what_advance_decides(tmp_path) -> None:
    """As gcov counts them, or clang-19; two outcomes at most no state leads to."""
    told = coverage(Printed(contents("NormalizedMrac-ball-euler")), tmp_path)
    taken, of = map(int, (part for part in told.replace(":", "").split() if part.isdigit()))
    assert of - 2 <= taken <= of
