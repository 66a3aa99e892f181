"""An export's statements on its test vectors: the compiled C agrees, proofs hold for new random numbers, and faces are
reached."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.cases.load import parse_case
from barbalat.export.c99.files import made_of
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
    "Mrac-state-euler-12",
    "Mrac-polynomial-midpoint",
    "MracOutput-output-midpoint-268",
    "L1Adaptive-gain-midpoint",
    "NormalizedMrac-state-euler",
    "NormalizedMrac-ball-euler",
    "RobustMrac-free-euler",
    "L1Adaptive-several-euler",
    "L1Adaptive-polynomial-euler",
    "KnownParameters-state-euler",
)


def contents(beginning: str, real=DOUBLE) -> Contents:
    name = next(name for name in EXAMPLES if name.startswith(beginning))
    return Contents.of(*EXAMPLES[name], SIMULATION, real)


@needs_gcc
@pytest.mark.parametrize("float32", [False, True])
@pytest.mark.parametrize("beginning", KINDS)
@pytest.mark.short(kept=lambda beginning, float32: beginning == KINDS[6] and not float32)
def test_the_compiled_self_test_kills_what_the_readme_says(beginning, float32, tmp_path) -> None:
    """The self-test kills at least 97 % of the mutants that are not proven equivalent, also in 32 bits. Those proven equivalent
    survive."""
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
    """sqrt(-0.0) is -0.0, which differs from its magnitude. In 32 bits sqrt(2) is below its value in 64 bits and equals c."""
    x, within = Operation("input", (), source=(0, 0)), {(0, 0): Interval(0.0, 3.0)}
    size = Program((x, Operation("sqrt", (0,)), Operation("fabs", (1,))), ((2,),))
    left_out = Mutant(2, "fabs is omitted", Operation("copy", (1,)))
    assert Prover(size, within, DOUBLE).proof(left_out) == ""
    constants = [Operation("constant", (), value=value) for value in (2**0.5, 5.0, 7.0)]
    chosen_of = (x, Operation("sqrt", (0,)), *constants, Operation("le", (1, 2)), Operation("select", (5, 3, 4)))
    second = Mutant(6, "select takes the second always", Operation("copy", (4,)))
    for real in (FLOAT, DOUBLE):
        assert Prover(Program(chosen_of, ((6,),)), {(0, 0): Interval(2.0, 3.0)}, real).proof(second) == ""
    assert Prover(Program(chosen_of, ((6,),)), {(0, 0): Interval(2.1, 3.0)}, FLOAT).proof(second)


def test_a_product_of_one_sign_is_not_below_zero_and_a_row_that_keeps_its_number_need_not_be_stored() -> None:
    """For positive c, x (c x) is at least zero and equals its maximum with zero. For c of either sign this need not hold."""
    x, y = (Operation("input", (), source=(0, row)) for row in (0, 1))
    scaled = Program(
        (x, y, Operation("mul", (0, 1)), Operation("mul", (2, 0)), Operation("constant"), Operation("fmax", (3, 4))), ((5,),)
    )
    itself = Mutant(5, "fmax takes the first always", Operation("copy", (3,)))
    for low, proven in ((0.5, True), (-0.5, False)):
        assert bool(Prover(scaled, {(0, 0): Interval(-3.0, 3.0), (0, 1): Interval(low, 2.0)}, DOUBLE).proof(itself)) == proven
    frozen = Program((x, y, Operation("lt", (0, 1)), Operation("select", (2, 0, 0)), Operation("select", (2, 0, 1))), ((3, 4),))
    within = {(0, 0): Interval(-3.0, 3.0), (0, 1): Interval(-3.0, 3.0)}
    kept, changed = (Prover(frozen, within, DOUBLE, (0, 1)).proof(Mutant(row, "is not stored", None)) for row in (0, 1))
    assert kept and not changed


def test_the_midpoint_laws_projection_is_reached_at_every_face() -> None:
    """The simulated run never reaches a face; the chosen samples end on each face."""
    made = contents("Mrac-state-midpoint")
    rows, (low, high) = list(made.layout.theta_hat.rows), made.limits
    run = made.vectors.states[:, rows]
    assert (run > low).all() and (run < high).all()
    after = chosen(made).after[rows].T
    assert (after == low).any(axis=0).all() and (after == high).any(axis=0).all()


@needs_gcc
def test_the_self_test_takes_both_sides_of_what_advance_decides(tmp_path) -> None:
    """The outcomes are counted by gcov or clang-19. At most two outcomes are unreachable from any state."""
    made = contents("NormalizedMrac-ball-euler")
    told = coverage(Printed(made), tmp_path)
    taken, of = map(int, (part for part in told.replace(":", "").split() if part.isdigit()))
    assert of - 2 <= taken <= of
    by_vectors, every = chosen(made).outcomes
    assert every == of and by_vectors <= taken


def test_a_step_that_a_limit_takes_back_to_a_face_needs_no_rate_of_zero_there() -> None:
    """Empty cases are left out, and choices deep inside a sum are split. Without the limit the mutant is a fault."""
    theta, rate = (Operation("input", (), source=(0, row)) for row in (0, 1))
    step = (
        theta,
        rate,
        Operation("constant", (), value=-2.0),
        Operation("le", (0, 2)),
        Operation("not", (3,)),
        Operation("constant", (), value=-np.inf),
        Operation("if_else_zero", (4, 5)),
        Operation("fmax", (1, 6)),
        Operation("constant", (), value=0.01),
        Operation("mul", (7, 8)),
        Operation("add", (0, 9)),
        Operation("fmax", (10, 2)),
    )
    within = {(0, 0): Interval(-2.1, 2.0), (0, 1): Interval(-1e6, 1e6)}
    anything = Mutant(6, "always takes the value", Operation("copy", (5,)))
    proofs = [Prover(Program(step, ((end,),)), within, DOUBLE).proof(anything) for end in (11, 10)]
    assert proofs[0] and not proofs[1]


def test_a_lower_limit_is_at_most_its_upper_limit_where_the_case_says_so() -> None:
    """min(max(x, low), high) after max(low, ...) with low <= high; without this condition the mutant is a fault."""
    x, low, high = (Operation("input", (), source=(0, row)) for row in (0, 1, 2))
    clipped = (x, low, high, Operation("fmin", (0, 2)), Operation("fmax", (3, 1)), Operation("fmin", (4, 2)))
    within = {(0, row): Interval(-5.0, 5.0) for row in (0, 1, 2)}
    first = Mutant(5, "fmin always takes the first", Operation("copy", (4,)))
    for ordered, proven in (([((0, 1), (0, 2))], True), ([((0, 2), (0, 1))], False), ([], False)):
        assert bool(Prover(Program(clipped, ((5,),)), within, DOUBLE, ordered=ordered).proof(first)) == proven


def test_a_norm_that_is_at_least_y_divided_by_y_is_one_up_to_rounding() -> None:
    """1 + k (sqrt(max(a, y y))/y - 1) is positive, and equal to its maximum with zero, unless y y is rounded to zero or k is
    large."""
    a, y = (Operation("input", (), source=(0, row)) for row in (0, 1))
    one, zero, k = (Operation("constant", (), value=value) for value in (1.0, 0.0, 1e6))
    steps = [a, y, one, zero, k, Operation("mul", (1, 1)), Operation("fmax", (0, 5)), Operation("sqrt", (6,))]
    steps += [Operation("div", (2, 1)), Operation("mul", (8, 7)), Operation("sub", (9, 2)), Operation("mul", (4, 10))]
    steps += [Operation("add", (2, 11)), Operation("fmax", (12, 3))]
    itself = Mutant(13, "fmax always takes the first", Operation("copy", (12,)))
    for least, gain, proven in ((1e-15, 1e6, True), (1e-200, 1e6, False), (1e-15, 1e16, False)):
        steps[4] = k._replace(value=gain)
        within = {(0, 0): Interval(0.0, 1e6), (0, 1): Interval(least, 1e3)}
        assert bool(Prover(Program(tuple(steps), ((13,),)), within, DOUBLE).proof(itself)) == proven


def test_a_fault_is_followed_no_farther_than_to_where_it_is_gone() -> None:
    """In sqrt(max(x, c)) the last bit of c is rounded away; after a hundred choices the analysis stops."""
    chain = [
        Operation("input", (), source=(0, 0)),
        Operation("constant", (), value=1.6),
        Operation("fmax", (0, 1)),
        Operation("sqrt", (2,)),
    ]
    for k in range(100):
        chain += [Operation("mul", (len(chain) - 1, 0)), Operation("fmin", (len(chain), 0 if k % 2 else 3))]
    program, within = Program(tuple(chain), ((len(chain) - 1,),)), {(0, 0): Interval(-10.0, 10.0)}
    moved = [Mutant(1, "another number", Operation("constant", (), value=float(c))) for c in (np.nextafter(1.6, 2), 1.7)]
    assert [bool(Prover(program, within, DOUBLE).proof(one)) for one in moved] == [True, False]


FIRST_ORDER = """
name = "first order"
[plant]
transfer_function = { num = [2.0], den = [1.0, 0.5] }
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "square"
amplitude = 0.7
frequency = 1.1
[simulation]
t_end = 8.0
dt = 1e-3
[[controller]]
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = 10.0 }
lower = [-4.0, 0.2]
upper = [4.0, 3.0]
discretization = "euler"
sample_time = 0.01
"""


def test_bounds_that_are_parameters_are_also_zero() -> None:
    """At a bound of zero, four faults in the law's projection change the sign of a zero and nothing else."""
    case = parse_case(FIRST_ORDER)
    made = made_of(case.problem, case.controllers[0], case.simulation, DOUBLE, parameters=True)
    count, killed, proven = chosen(made).counted(ties=False)
    assert killed >= 0.97 * (count - proven)
