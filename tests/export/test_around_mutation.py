"""Mutants of the C around ``advance``: the self-test finds those that are known to be faults."""

from __future__ import annotations

from pathlib import Path

import pytest

from barbalat.export.c99.files import made_of
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from export.around_mutation import FULL, KINDS, found_around
from export.examples import SIMULATION
from export.made import files
from export.targets import ISO, STRICT, needs_gcc, run_selftest, write
from export.test_shell import surrounded
from turns import once

PLANTED = (
    ("c->outage = {M}_LONGEST_OUTAGE;", "c->outage = {M}_FADE;"),
    ("if (missed > 0L) {\n        told", "if (missed > 1L) {\n        told"),
    ("if (c->outage < 1000000000L) {", "if (c->outage < 1000L) {"),
    ("&& c->outage >= 0L && c->outage <= 1000000000L", "&& c->outage >= 0L && c->outage <= 1000L"),
    ("&& c->held_r[0] <= ", "&& c->held_r[0] <= 9 * "),
    ("&& c->held_r[0] >= ", "&& c->held_r[0] >= 9 * "),
    ("&& c->held_measured[0] <= ", "&& c->held_measured[0] <= 9 * "),
    ("*status |= {M}_MEASUREMENT_LOST;", "*status = {M}_MEASUREMENT_LOST;"),
    ("out->status = status | told;", "out->status = status;"),
    ("{M}_BAND + 0x1.0000000000000p-50 * time", "{M}_BAND + 0x1.0000000000000p-40 * time"),
    ("told |= status & {M}_RESULT_REFUSED;", "told |= status;"),
    ("missed >= 0L && (status & {M}_STATE_REFUSED) == 0u", "missed >= 0L"),
    ("status |= {M}_RESULT_REFUSED;", "status = {M}_RESULT_REFUSED;"),
    ("c->refused = 0;\n    c->outage = 0L;\n    c->age = 1", "c->refused = 0;\n    c->outage = 1L;\n    c->age = 1"),
    ("> 0 && c->refused < {M}_REFUSALS", "> -5 && c->refused < {M}_REFUSALS"),
    ("> 0 && c->refused < {M}_REFUSALS", "> 0 && c->refused <= {M}_REFUSALS"),
    ("in->r[0] - c->held_r[0] <= ", "in->r[0] - c->held_r[0] <= 1.01 * "),
    ("-(in->r[0] - c->held_r[0]) <= ", "-(in->r[0] - c->held_r[0]) <= 0.99 * "),
    ("in->x[0] - c->held_measured[0] <= ", "in->x[0] - c->held_measured[0] <= 0.99 * "),
    ("-(in->x[0] - c->held_measured[0]) <= ", "-(in->x[0] - c->held_measured[0]) <= 1.01 * "),
    ("    if (out->u[0] < ", "    if (out->u[0] < 1.01 * "),
    ("    if (out->u[0] > ", "    if (out->u[0] > 0.99 * "),
    ("    if (u[0] < ", "    if (u[0] < 0.99 * "),
    ("    if (u[0] > ", "    if (u[0] > 1.01 * "),
    ("|| !(x[0] >= ", "|| !(x[0] >= 0.99 * "),
    ("&& c->theta_hat[1] <= ", "&& c->theta_hat[1] <= 1.01 * "),
    ("sample_time <= {M}_SAMPLE_TIME + ", "sample_time <= {M}_SAMPLE_TIME + 0.99 * "),
    ("values[i] <= {M}_RANGE", "values[i] <= 1.01 * {M}_RANGE"),
    ("c->fade = samples > 0L ? samples : 0L;", "c->fade = samples > 1L ? samples : 0L;"),
)
"""Statements and their replacements. The self-test once missed these faults."""


@pytest.fixture(scope="module")
def correct(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The export into which faults are planted, written once, whose self-test passes."""

    def made() -> dict[str, str]:
        named = files(*surrounded("Mrac-state-midpoint", FULL), SIMULATION, name="p")
        texts = {name.removeprefix("p_"): text.replace('"p_', '"') for name, text in named.items()}
        folder = write(tmp_path_factory.mktemp("correct"), texts)
        assert run_selftest(folder, "gcc", *ISO, "-O0", "-w").returncode == 0
        return texts

    return once(shared, "around-planted", made)


@needs_gcc
@pytest.mark.parametrize(("was", "becomes"), PLANTED)
def test_planted_faults_are_found(was, becomes, correct, tmp_path) -> None:
    source, (was, becomes) = correct["controller.c"], (one.replace("{M}", "P") for one in (was, becomes))
    assert was in source
    write(tmp_path, correct | {"controller.c": source.replace(was, becomes)})
    assert run_selftest(tmp_path, "gcc", *ISO, "-O0", "-w").returncode == 1


@needs_gcc
@pytest.mark.parametrize(("beginning", "shell"), KINDS)
@pytest.mark.parametrize("float32", [False, True])
@pytest.mark.short(kept=lambda beginning, shell, float32: not float32 or (beginning, shell) in KINDS[::2])
@pytest.mark.dear
def test_the_self_test_passes_with_each_shell(beginning, shell, float32, tmp_path) -> None:
    write(tmp_path, files(*surrounded(beginning, shell), SIMULATION, float32=float32))
    told = run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O1")
    assert told.returncode == 0, told.stdout


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize(("beginning", "shell"), KINDS)
def test_known_faults_around_the_arithmetic_are_found(beginning, shell, tmp_path) -> None:
    found = found_around(Printed(made_of(*surrounded(beginning, shell), SIMULATION, DOUBLE, parameters=False)), tmp_path)
    assert found.score >= 0.97, found.missed
