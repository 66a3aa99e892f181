"""``--name``: the prefix of an export's identifiers and files, with which several controllers of one name fit in one program."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from barbalat import InputError, Sampled
from barbalat.controllers import Mrac
from barbalat.exports import export_controller
from export.examples import SIMULATION, STATE, T
from export.targets import ISO, STRICT, needs_gcc

CONTROLLER = Sampled(controller=Mrac(gamma=20.0, name="L1"), sample_time=T, discretization="euler")
BOTH = """\
#include "controllers.h"
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


def test_exports_in_one_folder_are_one_component(tmp_path) -> None:
    (tmp_path / "flight_controller.h").write_text("/* the user's own */\n")
    for name in ("roll", "pitch", "roll"):
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path, name=name)
    assert "set(CONTROLLERS pitch roll)" in (tmp_path / "CMakeLists.txt").read_text()
    included = [line for line in (tmp_path / "controllers.h").read_text().splitlines() if line.startswith("#include")]
    assert included == ['#include "pitch_controller.h"', '#include "roll_controller.h"']
    assert "[pitch_README.md](pitch_README.md)" in (tmp_path / "README.md").read_text()
    with pytest.raises(InputError, match="by more than their case"):  # their macros would collide
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path, name="Pitch")


def test_names_whose_identifiers_collide_are_refused(tmp_path) -> None:
    """``pitch_read_log`` reads the log of pitch, and is the type of the log of pitch_read."""
    for first, second in (("pitch", "pitch_read"), ("pitch_read", "pitch")):
        out = tmp_path / first
        export_controller(STATE, CONTROLLER, SIMULATION, out=out, name=first)
        before = {file.name: file.read_text() for file in out.iterdir()}
        with pytest.raises(InputError, match="the names pitch and pitch_read can't be in one folder because both exports would"):
            export_controller(STATE, CONTROLLER, SIMULATION, out=out, name=second)
        assert {file.name: file.read_text() for file in out.iterdir()} == before
        export_controller(STATE, CONTROLLER, SIMULATION, out=out, name="pitch_rate")


def test_an_export_with_a_name_and_one_without_do_not_replace_each_others_readme(tmp_path) -> None:
    for folder, first, second in (("a", "pitch", None), ("b", None, "pitch")):
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path / folder, name=first)
        before = {file.name: file.read_text() for file in (tmp_path / folder).iterdir()}
        with pytest.raises(InputError, match=r"this export would replace (its|their) README\.md"):
            export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path / folder, name=second)
        assert {file.name: file.read_text() for file in (tmp_path / folder).iterdir()} == before


@needs_gcc
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
def test_cmake_builds_the_component_and_runs_each_self_test(tmp_path) -> None:
    for name in ("pitch", "roll"):
        export_controller(STATE, CONTROLLER, SIMULATION, out=tmp_path, name=name)
    for command in (["cmake", "-B", "build"], ["cmake", "--build", "build"], ["ctest", "--test-dir", "build"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120)
    assert "2/2 Test #2: roll" in done.stdout
