"""The table of what a sample costs on a Cortex-M4F: made by a command, and still true."""

from __future__ import annotations

import re

import pytest
from benchmarks import flight
from benchmarks.flight_cases import CASES

from export.targets import needs

ROWS = ("MRAC", "L1, output feedback", "robust MRAC, least squares")


@pytest.mark.full
@needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_the_table_is_what_is_counted() -> None:
    """By the compiler that the page names; another one makes other code, within a quarter."""
    page = flight.PAGE.read_text()
    same = flight.tools() in page
    shown = {
        name: list(map(int, re.findall(r"\d+", rest))) for name, rest in re.findall(r"^\| ([^|]+?) (\|.*)$", page, re.MULTILINE)
    }
    assert set(shown) >= {name for name, _, _ in CASES}
    for name, problem, controller in CASES:
        if name not in ROWS:
            continue
        c = flight.cost(problem, controller)
        operations, instructions, cycles, _, code, state, _ = shown[name]
        assert (operations, state) == (c.operations, c.data)
        for was, found in ((instructions, c.instructions), (cycles, c.cycles), (code, c.code)):
            assert was == found if same else abs(was - found) < found / 4, name


def test_the_cycles_are_those_of_arms_table() -> None:
    """Read from the manual by hand: a product one, a quotient fourteen, a load two, N registers one more, a branch its refill."""
    for wanted, name, operands, taken in (
        (1, "vmul.f32", "s15, s14, s13", False),
        (14, "vdiv.f32", "s0, s1, s2", False),
        (14, "vsqrt.f32", "s0, s1", False),
        (2, "vldr", "s0, [r3, #4]", False),
        (5, "push", "{r4, r5, r6, lr}", False),
        (5, "vpush", "{s16-s19}", False),
        (8, "ldmia.w", "sp!, {r4, r5, r6, pc}", True),
        (3, "ldrd", "r2, r3, [r0]", False),
        (4, "bl", "8000 <f>", True),
        (1, "bne.n", "8000 <f>", False),
    ):
        assert flight._cycles(4, name, operands, taken=taken) == wanted, name
