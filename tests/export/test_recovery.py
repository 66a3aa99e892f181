"""An export recovers by itself from a state that leads out of range or is out of range."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled
from barbalat.export.contents import Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import PlantInput, Shell
from barbalat.run.engine.simulate import recorded
from barbalat.signals import Sine
from export.examples import SIMULATION, T
from export.made import files
from export.targets import ISO, STRICT, drive, needs_gcc, run_selftest, write
from export.test_bit_identical import EXAMPLES, ONE_OF_EACH
from turns import drawn

STATE_REFUSED, RESULT_REFUSED, LOST, FALLBACK = 4, 8, 2, 256
REFUSALS = 10
"""Number of consecutive good samples with rejected results after which everything learnt is discarded; see controller.h."""
STIFF = Problem(
    Plant(A_m=[[0, 1], [-2000, -90]], b=[0, 2000], theta=[0.1, -0.01], input=PlantInput(saturation=[-5, 5])),
    ReferenceModel(k_0=1),
    Sine(amplitude=0.3, frequency=2),
    uncertainty=ParameterBox(lower=[-0.2, -0.02], upper=[0.2, 0.02]),
)
"""Cases in which a large command is accepted and leads the model out of range at every later sample."""
KINDS = drawn(sorted(ONE_OF_EACH), 20)
"""Each commit draws different ones."""
BARE = replace(STIFF, plant=replace(STIFF.plant, input=PlantInput()))


def exported(problem: Problem, folder: Path, controller=None) -> Printed:
    printed = Printed(Contents.of(problem, controller or Sampled(Mrac(gamma=1e-3), T), SIMULATION, DOUBLE))
    write(folder, {"controller.h": header(printed), "controller.c": source(printed)})
    return printed


def after_a_large_command(printed: Printed, folder: Path, bad: int = 100):
    """Status and u of the run and of the same run without the large command."""
    samples = recorded(printed.contents.problem.nominal, printed.contents.controller, SIMULATION, 200)
    r = samples.commands.copy()
    r[bad] = 2e5
    return drive(printed, folder, samples.measured, r), drive(printed, folder, samples.measured, samples.commands)


@needs_gcc
@pytest.mark.parametrize(("problem", "last"), [(STIFF, 102), (BARE, 100 + REFUSALS)], ids=["with limits", "without limits"])
def test_without_a_longest_outage_the_controller_begins_again_too(problem, last, tmp_path) -> None:
    """The controller begins again at the second rejected result. A control without limits that the command has made large is
    discarded after ten."""
    found, nominal = after_a_large_command(exported(problem, tmp_path), tmp_path)
    assert found.status[100] == 0 and (found.status[101 : last + 1] == RESULT_REFUSED).all()
    assert (found.status[last + 1 :] == 0).all()
    assert np.abs(found.u[160:] - nominal.u[160:]).max() < 0.05


@needs_gcc
def test_a_held_control_without_limits_does_not_refuse_for_ever(tmp_path) -> None:
    """The command has made u so large that the next states of the model and the predictor are out of range."""
    printed = exported(replace(BARE, shell=Shell(longest_outage=0.05, fallback="hold")), tmp_path)
    found, nominal = after_a_large_command(printed, tmp_path)
    assert (found.status[101:106] == RESULT_REFUSED).all() and found.status[106] == RESULT_REFUSED | FALLBACK
    assert (found.status[101 + REFUSALS :] == 0).all()
    assert np.abs(found.u[160:] - nominal.u[160:]).max() < 0.05


MAIN = """\
#include "controller.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

/* A state with one bad number, then a lost and three good samples: status and u of each. */
int main(void)
{{
    static {name}_controller c;
    {name}_input in;
    {name}_output out;
    int k;
    {name}_init(&c);
    for (k = 0; k < 8; ++k) {{
        memset(&in, 0, sizeof in);
        in.sample_time = {macro}_SAMPLE_TIME;
        if (k == 4) {{ {poked} = {value}; }}
        if (k == 4) {{ in.{x}[0] = NAN; }}
        if ({name}_step(&c, &in, &out) == {macro}_OK && !(out.u[0] == out.u[0])) return 1;
        printf("%u %a\\n", out.status, (double)out.u[0]);
    }}
    return 0;
}}
"""


@needs_gcc
@pytest.mark.parametrize("value", ["NAN", "INFINITY", "2 * {macro}_RANGE"])
@pytest.mark.parametrize("member", ["x_hat[0]", "theta_hat[1]", "last_u[0]", "bump[0]"])
def test_a_bad_state_is_told_and_ends_with_the_next_good_measurement(member, value, tmp_path) -> None:
    printed = exported(STIFF, tmp_path)
    names = {"name": printed.name, "macro": printed.macro, "x": printed.measured}
    (tmp_path / "main.c").write_text(MAIN.format(**names, poked=f"c.{member}", value=value.format(**names)))
    command = ["gcc", *ISO, *STRICT, "main.c", "controller.c", "-o", "main", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    lines = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60).stdout.splitlines()
    status, u = zip(*(line.split() for line in lines), strict=True)
    only_u = member == "last_u[0]"  # it becomes zero; nothing else is invalid
    assert [int(one) for one in status] == [0, 0, 0, 0, STATE_REFUSED, 0 if only_u else STATE_REFUSED, 0, 0]
    assert u[4] == ("0x0p+0" if only_u else u[3]) and (only_u or u[5] == u[3])


@needs_gcc
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.short(kept=lambda name: name in KINDS[:3])
def test_every_kind_recovers_as_its_own_self_test_requires(name, tmp_path) -> None:
    write(tmp_path, files(*EXAMPLES[name], SIMULATION))
    done = run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O1")
    assert done.returncode == 0, done.stdout


BOUNDED = Problem(
    Plant(A_m=[[-2.0]], b=[1.0], theta=[0.5], x0=[10.0], input=PlantInput(saturation=[0, 40])),
    ReferenceModel(k_0=2.0),
    Sine(amplitude=2, constant=12, frequency=1),
    uncertainty=ParameterBox(lower=[-1], upper=[1]),
    shell=Shell(range={"x_1": [5, 20], "command": [9, 15]}, rate={"x_1": 50.0, "command": 100.0}, longest_outage=0.05),
)
"""With ranges and rates no state leads its first-order model out of range; only a bump does."""
ADRC, ADRC_CONTROLLER = EXAMPLES[next(name for name in EXAMPLES if name.startswith("Adrc-state"))]
WITH_ADRC = replace(ADRC, shell=Shell(longest_outage=0.05))
"""A start of ADRC multiplies the measurement by 20, so that it may be out of range, too."""
PLANTED = {
    "no restart": (BOUNDED, "    if (c->outage > {M}_LONGEST_OUTAGE) {\n        int", "    if (0) {\n        int"),
    "nothing is stored": (WITH_ADRC, "    before = *c;\n", ""),
    "nothing is restored": (WITH_ADRC, "            *c = before;\n", ""),
    "nothing is checked": (
        WITH_ADRC,
        "        if (!result_is_usable(c) || !in_range(c->bump, {M}_INPUTS)) {\n",
        "        if (0) {\n",
    ),
}
"""Cases whose self-test once did not find these faults in ``refuse``."""


@needs_gcc
@pytest.mark.parametrize("fault", PLANTED)
def test_the_self_test_runs_every_part_of_a_restart(fault, tmp_path) -> None:
    problem, *texts = PLANTED[fault]
    controller = Sampled(Mrac(gamma=5.0), T) if problem is BOUNDED else ADRC_CONTROLLER
    made = files(problem, controller, SIMULATION)
    original, planted = (text.replace("{M}", controller.name.upper()) for text in texts)
    begins = made["controller.c"].index("static void refuse(")
    assert made["controller.c"].count(original, begins) == 1
    write(tmp_path, made)
    assert run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O1").returncode == 0
    before, after = made["controller.c"][:begins], made["controller.c"][begins:]
    (tmp_path / "controller.c").write_text(before + after.replace(original, planted))
    assert run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode == 1
