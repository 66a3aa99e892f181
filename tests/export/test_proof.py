"""One step of the exports from every finite state and input: no undefined behaviour, no NaN, no infinity, by Frama-C's Eva."""

from __future__ import annotations

import math
import re
import subprocess
from dataclasses import replace

import pytest

from barbalat.export.contents import Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.laws import Gradient, LeastSquares
from barbalat.lowering.c99 import DOUBLE, FLOAT, Real
from barbalat.lowering.operations import Operation, Program
from barbalat.plants import Shell
from export.examples import SIMULATION, sampled_examples
from export.proof import STATES, alarms, unbounded_alone
from export.targets import needs, write

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}


def one(beginning: str, law: type | None = None) -> str:
    found = (name for name in EXAMPLES if name.startswith(beginning))
    return next(name for name in found if law is None or isinstance(EXAMPLES[name][1].controller.law, law))


THIRD_ORDER = one("MracOutput-third */ order-midpoint", Gradient)
TWO_INPUTS = one("L1PiecewiseConstant-several")
PROVEN = [
    one("Mrac-state-midpoint"),
    one("L1Adaptive-state-midpoint"),
    one("L1Adaptive-free-midpoint"),
    one("RobustMrac-free-midpoint", LeastSquares),
    THIRD_ORDER,
    one("L1Output-output-midpoint"),
    one("NormalizedMrac-state-midpoint"),
    one("Mrac-gain-midpoint"),
    one("MracOutput-output-midpoint"),
    one("LinearOutput-output-midpoint"),
    one("Mrac-state-euler"),
    one("Mrac-free-euler"),
    one("L1Adaptive-state-euler"),
    one("L1Adaptive-free-euler"),
    one("MracOutput-output-euler"),
    one("L1Output-output-euler"),
    one("KnownParameters-state-euler"),
    one("NormalizedMrac-state-euler"),
    one("LinearFeedback-state-midpoint"),
    one("L1PiecewiseConstant-state"),
    one("DirectMrac-state-euler"),
    one("MracClosedLoop-state-euler"),
    one("Adrc-state-midpoint"),
    TWO_INPUTS,
]


PROVEN_IN_32_BITS = [
    one("Mrac-state-euler"),
    one("L1Output-output-midpoint"),
    one("LinearFeedback-state-midpoint"),
    one("KnownParameters-state-euler"),
    one("Adrc-state-midpoint"),
    one("L1PiecewiseConstant-state"),
    one("MracOutput-output-euler"),
]


def printed(name: str, real: Real = DOUBLE) -> Printed:
    return Printed(Contents.of(*EXAMPLES[name], SIMULATION, real))


@needs("frama-c")
@pytest.mark.full
@pytest.mark.parametrize("name", PROVEN)
def test_no_step_can_go_wrong(name, tmp_path) -> None:
    states = 10 * STATES if name in {THIRD_ORDER, TWO_INPUTS} else STATES  # these have twice as many entries
    assert alarms(printed(name), tmp_path, states) == []


EVERYTHING = Shell(
    range={"x_1": [-2.0, 2.0], "command": [-2.0, 2.0]}, rate={"x_1": 10.0, "x_2": 60.0, "command": 5.0}, stuck={"x_2": 0.05},
    jitter=0.1, longest_outage=0.05, fallback="fade", fade=0.2,
)  # fmt: skip


def with_a_shell() -> Printed:
    problem, controller = EXAMPLES[one("Mrac-state-midpoint")]
    return Printed(Contents.of(replace(problem, shell=EVERYTHING), controller, SIMULATION, DOUBLE))


@needs("frama-c")
@pytest.mark.full
def test_no_step_with_a_shell_can_go_wrong(tmp_path) -> None:
    """The shell has every option. The step starts from every count of missed samples and at every time that a timer may
    report."""
    assert alarms(with_a_shell(), tmp_path, 20 * STATES) == []


@needs("frama-c")
@pytest.mark.full
@pytest.mark.parametrize("name", PROVEN_IN_32_BITS)
def test_no_step_in_32_bits_can_go_wrong(name, tmp_path) -> None:
    assert alarms(printed(name, FLOAT), tmp_path) == []


def test_an_infinite_constant_is_a_bound_or_nothing() -> None:
    """The proofs replace infinite constants by finite numbers, but only those that do not enter a computation."""

    def bounded(*last: Operation) -> bool:
        first = (Operation("input"), Operation("constant", value=math.inf), Operation("constant", value=-math.inf))
        return unbounded_alone(Program((*first, *last), ((len(first) + len(last) - 1,),)))

    assert bounded(Operation("lt", (0, 0)), Operation("if_else_zero", (3, 1)), Operation("fmin", (0, 4)))
    assert bounded(Operation("fmax", (0, 2)))
    assert not bounded(Operation("fmax", (0, 1)))  # always infinite
    assert not bounded(Operation("fmin", (1, 0)))
    assert not bounded(Operation("mul", (0, 1)))
    assert not bounded(Operation("lt", (0, 0)), Operation("if_else_zero", (3, 1)))


@needs("frama-c")
@pytest.mark.full
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("if (c->fade_left > 0L && c->fade > 0L)", "if (c->fade_left > 0L)"),
        ("    if (!state_is_usable(c)) {", "    if (0) {"),
        (
            "i < C190_INPUTS; ++i) {\n        c->last_u[i] = c->held_u[i]",
            "i <= C190_INPUTS; ++i) {\n        c->last_u[i] = c->held_u[i]",
        ),
    ],
)
def test_what_can_go_wrong_is_seen(right, wrong, tmp_path, monkeypatch) -> None:
    made = printed(one("RobustMrac-free-midpoint", LeastSquares))
    text = source(made)
    right, wrong = (part.replace("C190", made.macro) for part in (right, wrong))
    assert right in text
    monkeypatch.setattr("export.proof.source", lambda _: text.replace(right, wrong, 1))
    assert alarms(made, tmp_path)


MISRA = {
    "2.5": "macros for the caller",
    "8.7": "functions for the caller",
    "10.3": "cppcheck takes the type of a conditional expression for that of its condition; comparisons have the type int in C",
    "12.1": "each of the operations has two operands of the list, and comparisons bind looser in every one",
    "15.5": "refusals return early: fewer branches around the rest",
}
"""Rules of MISRA-C:2012 that cppcheck reports as violated. All are advisory or false reports. docs/laboratory/tests.md states the
reasons."""


@needs("cppcheck")
@pytest.mark.full
@pytest.mark.parametrize(
    "make",
    [lambda: printed(one("Mrac-state-midpoint")), lambda: printed(one("RobustMrac-free-midpoint", LeastSquares)), with_a_shell],
    ids=["MRAC", "robust MRAC", "with a shell"],
)
def test_misra(make, tmp_path) -> None:
    made = make()
    write(tmp_path, {"controller.h": header(made), "controller.c": source(made)})
    done = subprocess.run(
        ["cppcheck", "--addon=misra", "--std=c99", "--enable=style", "--suppress=missingIncludeSystem", "-q", "controller.c"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    found = set(re.findall(r"misra-c2012-([\d.]+)", done.stderr))
    assert found, "the addon found nothing at all: it did not run"
    assert found <= MISRA.keys()
    # cppcheck 2.10 misreads a hexadecimal bound and takes the range around zero for empty
    others = set(re.findall(r"\[(\w+)\]$", done.stderr, re.MULTILINE)) - {"unusedStructMember", "incorrectLogicOperator"}
    assert not others, done.stderr
