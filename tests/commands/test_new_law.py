"""``barbalat new FILE.py``: a law that runs as written and passes the checker."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.cases import user_controllers
from barbalat.cli import main
from barbalat.commands.law_template import MyLaw
from barbalat.testing import problem_kinds


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_runs_beside_a_case_s_controllers(folder, capsys):
    assert main(["new", "my-law.py"]) == 0
    said = capsys.readouterr().err
    assert "barbalat run paper --controllers my-law.py" in said
    assert "equal effort and compare them with: barbalat contest CASE --controllers my-law.py --schemes mrac l1 --quick" in said
    assert [type(one).__name__ for one in load_case("paper", "my-law.py").controllers][-1] == "MyLaw"
    assert main(["run", "third-order", "--controllers", "my-law.py", "--json"]) == 0
    assert np.isfinite(json.loads(capsys.readouterr().out)["controllers"]["MyLaw"]["max_abs_e"]).all()


def test_a_case_that_the_law_rejects_is_named_with_its_property(folder, capsys):
    """The message once was only the sentence of the law's author."""
    assert main(["new", "my-law.py"]) == 0
    assert main(["contest", "first-order", "--controllers", "my-law.py", "--quick"]) == 2
    assert (
        capsys.readouterr()
        .err.strip()
        .endswith(
            "MyLaw supports only plants with a known input gain. MyLaw therefore cannot be used in the case 'First-order plant', "
            "whose plant has an unknown input gain"
        )
    )


def test_what_is_there_is_kept(folder, capsys):
    Path("law.py").write_text("mine")
    assert main(["new", "law.py"]) == 2
    assert "exists already" in capsys.readouterr().err and Path("law.py").read_text() == "mine"
    assert main(["new", "other.py", "--from", "paper"]) == 2
    assert "--from copies a case" in capsys.readouterr().err and not Path("other.py").exists()


@pytest.mark.parametrize(
    ("file", "name"), [("gradient_two.py", "GradientTwo"), ("role.py", "MyLaw"), ("None.py", "MyLaw"), ("2nd.py", "MyLaw")]
)
def test_the_class_is_called_after_the_file(folder, capsys, file, name):
    """The class takes the file's name unless that is not an identifier or is already used in the file."""
    assert main(["new", file, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"law": file}
    (controller,) = user_controllers.run(file).controllers(named={})
    assert type(controller).__name__ == controller.name == name


@pytest.mark.full
def test_its_own_test_passes_as_a_program_and_in_pytest(folder):
    assert main(["new", "my-law.py"]) == 0
    for command in ([sys.executable, "my-law.py"], [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "my-law.py"]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    trade = ["tradeoff", "third-order", "--controllers", "my-law.py", "--density", "2", "--plants", "1", "--out", "made"]
    assert main(trade) == 0
    assert len(json.loads(Path("made/tradeoff.json").read_text())["schemes"]["MyLaw"]["tunings"]) > 1


@pytest.mark.full
def test_an_edit_for_one_input_is_told_the_remedy_without_a_traceback(folder):
    """Such a law runs on every case with one input. As a program, its check once ended with a traceback and no remedy."""
    assert main(["new", "my-law.py"]) == 0
    file = Path("my-law.py")
    own = "theta_hat_dot = self.gamma * phi * (e @ known.P @ known.b)"
    text = file.read_text()
    file.write_text(text.replace("theta_hat_dot = self.gamma * np.dot(phi, e @ known.P @ known.b)", own))
    assert own in file.read_text()
    done = subprocess.run([sys.executable, "my-law.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "several inputs: " in done.stderr
    assert "let bind raise InputError where known.inputs > 1" in done.stderr.splitlines()[-1]


def test_it_is_the_standard_mrac_with_its_remedy_against_windup():
    """While no limit acts, the law agrees closely with MRAC. At a limit it learns from a smaller error, and its estimates stay in
    their set."""
    kinds, simulation = problem_kinds(), Simulation(2.0, 2e-3)
    for kind in ("one input", "several inputs", "a tight known set"):
        own, known = simulate(kinds[kind], [MyLaw(10.0), Mrac(gamma=10.0)], simulation).values()
        np.testing.assert_allclose(own.theta_hat, known.theta_hat, rtol=1e-9, atol=1e-9)
    limited = kinds["limits of the input"]
    free = simulate(limited, [MyLaw(10.0)], simulation)["MyLaw"]
    assert np.abs(free.controller_states["e_d"]).max() > 1e-3
    without = replace(limited, plant=replace(limited.plant, input=None))
    assert not simulate(without, [MyLaw(10.0)], simulation)["MyLaw"].controller_states["e_d"].any()
