"""``--name``: what an export's identifiers and files begin with, so that several controllers of one name fly in one program."""

from __future__ import annotations

import subprocess

import pytest

from barbalat import InputError, Sampled
from barbalat.controllers import Mrac
from barbalat.exports import export_controller
from export.examples import SIMULATION, STATE, T
from export.targets import ISO, STRICT, needs_gcc

CONTROLLER = Sampled(controller=Mrac(gamma=20.0, name="L1"), sample_time=T, discretization="euler")
BOTH = """\
#include "pitch_controller.h"
#include "roll_controller.h"
#include <stdio.h>

int main(void)
{
    static pitch_controller pitch;
    static roll_controller roll;
    pitch_init(&pitch);
    roll_init(&roll);
    return PITCH_INPUTS + ROLL_INPUTS - 2;
}
"""


@needs_gcc
def test_two_exports_of_one_controllers_name_link_and_each_passes_its_self_test(tmp_path) -> None:
    for name in ("pitch", "roll"):
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path, name=name)
        command = ["gcc", *ISO, *STRICT, f"{name}_controller.c", f"{name}_selftest.c", "-o", "selftest", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
        done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True, check=True, timeout=60)
        assert done.stdout == f"{name}: 1000 samples agree in every bit\n"
    (tmp_path / "main.c").write_text(BOTH)
    command = ["gcc", *ISO, *STRICT, "main.c", "pitch_controller.c", "roll_controller.c", "-o", "both", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    assert subprocess.run([tmp_path / "both"], check=False).returncode == 0


@pytest.mark.parametrize("name", ["", "1st", "for", "a b", "x" * 40, "_a"])
def test_a_name_that_c_has_not_is_refused(name, tmp_path) -> None:
    with pytest.raises(InputError, match=r"^name must"):
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path, name=name)
    assert list(tmp_path.iterdir()) == []
