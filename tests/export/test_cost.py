"""The table of a sample's cost on a Cortex-M4F is written by a command and still correct."""

from __future__ import annotations

import re
import subprocess

import pytest
from benchmarks import flight
from benchmarks.flight_cases import CASES, shelled

from barbalat.controllers import SCHEMES, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.export.contents import Contents
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import FLOAT
from export.targets import needs

ROWS = ("MRAC", "L1, output feedback", "robust MRAC, least squares")
SHARE, CYCLES = 0.1, 60
"""Largest increase of a sample's cost since ``BEFORE`` due to the code around the law, also with a shell. The larger of the two
limits applies."""
LAWS = {"L1, piecewise constant": 87, "L1, output feedback, piecewise constant": 37}
"""The laws that need more operations than on commit 248adc7, and their operations there."""
BEFORE = {
    "MRAC, Euler": 675,
    "MRAC": 814,
    "MRAC, closed-loop reference model, Euler": 675,
    "MRAC, direct, Euler": 829,
    "MRAC, network of 8 neurons, Euler": 6101,
    "MIT rule, Euler": 1104,
    "MRAC, regressor with sin and exp": 1304,
    "L1, filter of first order": 1004,
    "L1, filter of second order": 1052,
    "L1, two inputs": 2295,
    "L1, piecewise constant": 588,
    "normalised MRAC, gradient": 1009,
    "normalised MRAC, least squares": 1391,
    "robust MRAC, gradient": 1294,
    "robust MRAC, least squares": 1698,
    "robust MRAC, two inputs, gradient, Euler": 1899,
    "linear, one state": 502,
    "ADRC": 413,
    "known parameters, Euler": 378,
    "output MRAC, n* = 1, Lyapunov, Euler": 455,
    "output MRAC, n* = 1, least squares": 1236,
    "output MRAC, n* = 3, gradient": 3112,
    "L1, output feedback": 490,
    "L1, output feedback, piecewise constant": 420,
    "linear, output feedback": 411,
}
"""Cycles in commit 248adc7, in which a lost measurement stopped the controller and no case had a shell."""


def test_every_scheme_has_a_row() -> None:
    there = {type(law.controller if isinstance(law, Sampled) else law) for _, _, law in CASES}
    assert there | {Sampled} >= {*SCHEMES.values(), *OUTPUT_SCHEMES.values()}


@pytest.mark.full
@needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_the_table_is_what_is_counted() -> None:
    """The counts equal the table for the compiler named on the page. Other compilers agree within a quarter."""
    same, shown = flight.tools() in flight.PAGE.read_text(), _shown()
    assert list(shown) == [name for name, _, _ in CASES]
    for name, problem, controller in CASES:
        if name not in ROWS:
            continue
        c, more = flight.cost(problem, controller), flight.cost(shelled(problem), controller)
        operations, instructions, cycles, with_shell, _, code, state, _ = shown[name]
        assert (operations, state) == (c.operations, c.data) and more.operations == operations
        pairs = ((instructions, c.instructions), (cycles, c.cycles), (with_shell, more.cycles), (code, c.code))
        for was, found in pairs:
            assert was == found if same else abs(was - found) < found / 4, name


def _shown() -> dict[str, list[int]]:
    """The page's rows: operations, instructions, cycles, cycles with a shell, rate, code, state, stack."""
    rows = re.findall(r"^\| ([^|]+?) (\| \d.*)$", flight.PAGE.read_text(), re.MULTILINE)
    return {name: list(map(int, re.findall(r"\d+", rest))) for name, rest in rows}


def test_a_sample_costs_little_more_than_before_there_was_a_shell() -> None:
    """The numbers are the ones on the page. The previous test counts some of them again."""
    shown = _shown()
    for name, before in BEFORE.items():
        most = before + max(SHARE * before, CYCLES)
        assert shown[name][2] < most, name
        assert shown[name][3] < most, name


def test_the_guide_says_what_a_shell_costs() -> None:
    """The numbers are the ones on the page. The network is listed separately because its state is the largest."""
    guide = (flight.PAGE.parent / "flight.md").read_text(encoding="utf-8")
    more = {name: row[3] - row[2] for name, row in _shown().items()}
    network = more.pop("MRAC, network of 8 neurons, Euler")
    assert f"costs {min(more.values())} to {max(more.values())} cycles ({network} with the network)" in guide


TIMED = """\
#include "controller.h"
#include <stdio.h>
#define SYSTICK ((volatile unsigned *)0xE000E010u) /* of every Cortex-M: it counts down at 25 MHz on this board */

int main(void)
{{
    {name}_controller c, before;
    {name}_input in = {{ {macro}_SAMPLE_TIME, {{ 0 }}, {{ 0 }}, 0 }};
    {name}_output out;
    unsigned start, with, without;
    int k;
    {name}_init(&before);
    SYSTICK[1] = 0xffffffu;
    SYSTICK[2] = 0u;
    SYSTICK[0] = 5u;
    while (SYSTICK[2] == 0u) {{
    }}
    start = SYSTICK[2];
    for (k = 0; k < 2000; ++k) {{
        c = before;
        (void){name}_step(&c, &in, &out);
    }}
    with = start - SYSTICK[2];
    start = SYSTICK[2];
    for (k = 0; k < 2000; ++k) {{
        c = before;
        __asm__ volatile("" ::"r"(&c) : "memory");
    }}
    without = start - SYSTICK[2];
    printf("%u\\n", 40u * (with - without) / 2000u); /* an instruction lasts 1 ns here, and a tick 40 */
    return 0;
}}
"""


@pytest.mark.full
@needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_a_timer_counts_the_same(tmp_path) -> None:
    """The emulated board's timer, with ``-icount`` and 1 ns for each instruction, counts the first sample without its call."""
    _, problem, controller = next(case for case in CASES if case[0] == "robust MRAC, least squares")
    printed = Printed(Contents.of(problem, controller, flight.SIMULATION, FLOAT), prefix="flown")
    flight.build(tmp_path, printed, flight.main_program(printed))
    _, instructions = flight.counted(tmp_path, "flown_step")[0]
    flight.build(tmp_path, printed, TIMED.format(name="flown", macro="FLOWN"))
    command = [*flight.BOARD_EMULATOR, "-icount", "shift=0"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert abs(int(done.stdout) - instructions) < 0.02 * instructions


def test_the_cycles_are_those_of_arms_table() -> None:
    """By the manual a product takes one cycle, a quotient fourteen, a load two, N registers N + 1, and a branch its refill."""
    for wanted, name, operands, taken in (
        (1, "vmul.f32", "s15, s14, s13", False),
        (14, "vdiv.f32", "s0, s1, s2", False),
        (14, "vsqrt.f32", "s0, s1", False),
        (2, "vldr", "s0, [r3, #4]", False),
        (3, "vstr", "d7, [r3, #4]", False),
        (3, "vmla.f32", "s0, s1, s2", False),
        (5, "push", "{r4, r5, r6, lr}", False),
        (5, "vpush", "{s16-s19}", False),
        (8, "ldmia.w", "sp!, {r4, r5, r6, pc}", True),
        (3, "ldrd", "r2, r3, [r0]", False),
        (4, "bl", "8000 <f>", True),
        (1, "bne.n", "8000 <f>", False),
    ):
        assert flight._cycles(4, name, operands, taken=taken) == wanted, name


def test_the_notebook_names_all_laws_that_cost_more_than_before() -> None:
    shown, notebook = _shown(), (flight.PAGE.parents[1] / "laboratory/lost-samples.md").read_text(encoding="utf-8")
    assert [name for name, cycles in BEFORE.items() if shown[name][3] > cycles] == list(LAWS)
    assert {name for name, cycles in BEFORE.items() if shown[name][2] > cycles} <= LAWS.keys()
    more = " and ".join(str(shown[name][0] - before) for name, before in LAWS.items())
    assert f"even with a shell, except for the piecewise-constant laws, which need {more} more operations" in notebook
