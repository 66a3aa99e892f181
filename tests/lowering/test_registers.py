"""The order of operations: the values and their operands are the same, and fewer values are live at once."""

from __future__ import annotations

import pytest

from barbalat import L1Adaptive, input_filter
from barbalat.cases.load import load_case
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.operations import Operation, Program
from barbalat.lowering.registers import few_waiting
from barbalat.run.kernel.step import step_program
from barbalat.solvers import RK4

CHAINS = 8


def side_by_side() -> Program:
    """The sum of (c_i x)^2 with eight numbers c_i, with all products before all squares."""
    x = [Operation("input", (), 0.0, (0, 0))]
    numbers = [Operation("constant", (), 1.5 + i) for i in range(CHAINS)]
    products = [Operation("mul", (0, 1 + i)) for i in range(CHAINS)]
    squares = [Operation("mul", (1 + CHAINS + i, 1 + CHAINS + i)) for i in range(CHAINS)]
    first = 1 + 2 * CHAINS
    sums = [Operation("add", (first if i == 1 else first + CHAINS + i - 2, first + i)) for i in range(1, CHAINS)]
    return Program((*x, *numbers, *products, *squares, *sums), ((first + 2 * CHAINS - 2,), ()))


def alive(program: Program) -> int:
    """The largest number of live values. Inputs are live from the start, and constants are never live."""
    operations, last = program.operations, {}
    for i, op in enumerate(operations):
        last |= dict.fromkeys(op.operands, i)
    last |= {i: len(operations) for row in program.outputs for i in row}
    born = {i: 0 if op.name == "input" else i for i, op in enumerate(operations) if op.name != "constant"}
    return max(sum(b <= t < last[i] for i, b in born.items()) for t in range(len(operations)))


def numbered(program: Program, known: dict[object, int]) -> list[list[int]]:
    """The outputs, each as the number that ``known`` assigns to its tree of operations. Equal numbers mean equal bits."""
    numbers: list[int] = []
    for op in program.operations:
        key = (op.name, tuple(numbers[j] for j in op.operands), repr(op.value), op.source)
        numbers.append(known.setdefault(key, len(known)))
    return [[numbers[i] for i in row] for row in program.outputs]


@pytest.mark.parametrize("urgent_first", [False, True])
def test_a_chain_is_finished_before_the_next_begins(urgent_first: bool) -> None:
    given = side_by_side()
    assert alive(given) == CHAINS
    assert alive(few_waiting(given, urgent_first=urgent_first)) <= 3  # x, the sum so far, and the current chain


@pytest.mark.parametrize("urgent_first", [False, True])
def test_every_operation_keeps_its_operands(urgent_first: bool) -> None:
    problem = load_case("paper").problem
    program = step_program(
        ClosedLoop.of(problem, L1Adaptive(gamma=1e4, filter=input_filter(0.02))), RK4, 1e-4, figures=False
    ).program
    ordered = few_waiting(program, urgent_first=urgent_first)
    known: dict[object, int] = {}
    assert numbered(ordered, known) == numbered(program, known)
    assert len(ordered.operations) == len(program.operations)
    assert all(j < i for i, op in enumerate(ordered.operations) for j in op.operands)
    assert alive(ordered) < alive(program)
