"""The written files, their folders and names, and rejections."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

from barbalat import L1Adaptive, L1PiecewiseConstant, Mrac, Sampled, Simulation, input_filter
from barbalat.cli import main
from barbalat.export.layout import distinct, identifier, prefix_of
from barbalat.exports import export_controller
from barbalat.plants import PlantInput
from export.examples import SIMULATION, STATE, T
from export.made import files
from export.targets import ISO, needs_gcc, run_selftest
from independent import refusal

NAMES = ["README.md", "controller.c", "controller.h", "selftest.c"]
MRAC = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
L1 = Sampled(controller=L1Adaptive(gamma=50.0, filter=input_filter(0.05)), sample_time=T)


def test_names_of_controllers_become_identifiers() -> None:
    assert prefix_of("Robust MRAC") == "robust_mrac"
    assert prefix_of("L1, T = 1 ms") == "l1_t_1_ms"
    assert prefix_of("Régulateur") == "regulateur"
    assert prefix_of("2 DOF") == "n_2_dof"
    assert prefix_of("while") == "n_while"
    assert prefix_of("controller") == "n_controller"
    assert identifier("memory.P") == "memory_P"
    assert distinct(["a.b", "a_b", "int"]) == ["a_b", "a_b_2", "n_int"]
    assert distinct(["last_u", "Γ", "Θ"]) == ["last_u_2", "n__", "n___2"]
    for bad in ("制御", "123", "--"):
        assert "letter" in refusal(lambda bad=bad: prefix_of(bad))
    assert "at most 23" in refusal(lambda: prefix_of("a controller with a long name"))


@pytest.mark.dear
def test_the_same_files_every_time(tmp_path) -> None:
    assert export_controller(STATE, MRAC, SIMULATION, out=tmp_path / "new" / "mrac") == tmp_path / "new" / "mrac"
    assert sorted(file.name for file in (tmp_path / "new" / "mrac").iterdir()) == NAMES
    found = files(STATE, MRAC, SIMULATION)
    code = "import json; from export.test_write import *; print(json.dumps(files(STATE, MRAC, SIMULATION)))"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "1"}  # sets have a different order
    told = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
    assert found == json.loads(told)
    for name, text in found.items():
        assert (tmp_path / "new" / "mrac" / name).read_text() == text
        assert text.isascii()
        assert str(tmp_path) not in text
        for forbidden in ("malloc", "alloca", "goto"):
            assert forbidden not in text
    for library in ("#include <stdio.h>", "#include <string.h>"):
        assert library not in found["controller.c"] + found["controller.h"]


def test_a_law_that_may_be_patented_says_so() -> None:
    made = files(STATE, L1PiecewiseConstant(sample_time=T, filter=input_filter(0.05)), SIMULATION)
    assert "patent 8,712,559" in made["README.md"].replace("\n", " ")
    assert "patent" not in files(STATE, MRAC, SIMULATION)["README.md"]


@pytest.mark.dear
def test_a_plain_export_leaves_no_plant_of_another_one(tmp_path) -> None:
    export_controller(STATE, MRAC, SIMULATION, out=tmp_path, closed_loop=True)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([*NAMES, "loop.c", "plant.c", "plant.h"])
    assert "loop.c" in (tmp_path / "README.md").read_text()
    export_controller(STATE, MRAC, SIMULATION, out=tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == NAMES
    assert "loop.c" not in (tmp_path / "README.md").read_text()


@needs_gcc
@pytest.mark.dear
def test_two_exports_into_one_folder_never_mix(tmp_path) -> None:
    """The second export replaces the first. Files of the two do not form a program together."""
    export_controller(STATE, MRAC, SIMULATION, out=tmp_path / "one")
    export_controller(STATE, L1, SIMULATION, out=tmp_path / "one")
    assert sorted(file.name for file in (tmp_path / "one").iterdir()) == NAMES
    assert run_selftest(tmp_path / "one", "gcc", *ISO, "-O1").returncode == 0
    renamed = Sampled(controller=Mrac(gamma=6.0), sample_time=T)
    export_controller(STATE, MRAC, SIMULATION, out=tmp_path / "two")
    export_controller(STATE, renamed, SIMULATION, out=tmp_path / "three")
    shutil.copy(tmp_path / "two" / "controller.h", tmp_path / "three")
    with pytest.raises(subprocess.CalledProcessError):
        run_selftest(tmp_path / "three", "gcc", *ISO, "-O1")


def test_refusals(tmp_path) -> None:
    def refused(controller=MRAC, simulation=SIMULATION, **settings):
        settings = {"out": tmp_path / "none"} | settings
        return refusal(lambda: export_controller(STATE, controller, simulation, **settings))

    assert "sample_time" in refused(Mrac(gamma=5.0))
    assert "c99" in refused(target="fortran")
    assert "letter" in refused(Sampled(controller=Mrac(gamma=5.0, name="制御"), sample_time=T))
    assert "whole number of solver steps" in refused(simulation=Simulation(t_end=1.0, dt=0.03125))
    unbounded = replace(STATE, plant=replace(STATE.plant, input=PlantInput()), uncertainty=None)
    chattering = Sampled(controller=Mrac(gamma=1e9), sample_time=T, discretization="euler")
    assert "diverges" in refusal(lambda: export_controller(unbounded, chattering, SIMULATION, out=tmp_path / "none"))
    assert "set t_end to at least 0.1 s" in refused(simulation=Simulation(t_end=9 * T, dt=T / 2))
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("here")
    assert "is a file" in refused(out=tmp_path / "file")
    assert (tmp_path / "file").read_text() == "here"


def test_command(tmp_path, capsys) -> None:
    asked = ["export", "first-order", "--controller", "MRAC, sampled", "--target", "c99"]
    assert main([*asked, "--out", str(tmp_path / "a"), "--float32"]) == 0
    assert "float theta_hat" in (tmp_path / "a" / "controller.h").read_text()
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == NAMES
    capsys.readouterr()
    for wrong, said in (
        (["export", "first-order", "--controller", "MRAC", "--out", str(tmp_path / "b")], "sample_time"),
        (["export", "first-order", "--controller", "none", "--out", str(tmp_path / "b")], "'MRAC, sampled'"),
        ([*asked, "--out", ""], "--out"),
    ):
        assert main(wrong) == 2
        shown = capsys.readouterr().err
        assert said in shown
        assert shown.count("\n") == 1
    assert not (tmp_path / "b").exists()
