"""Completion of command lines in shells and of case files in editors."""

import json
import os
import subprocess
import sys
import tomllib

import pytest

from barbalat.cases.bundled import bundled
from barbalat.cli import main

SEPARATOR = "\v"


@pytest.mark.skipif(sys.platform == "win32", reason="the shell's answer comes on file descriptor 8")
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("barbalat ", {"run", "certify", "new", "schema"}),
        ("barbalat run pa", {"paper", "payload-drop"}),
        ("barbalat certify ", set(bundled())),
        ("barbalat run paper --js", {"--json"}),
        ("barbalat completion f", {"fish"}),
        ("barbalat claims tau-l", {"tau-limit-delay", "tau-limit-mu"}),
        ("barbalat fly f16-", {"f16-pitch", "f16-roll"}),
        ("barbalat export quadrotor-pitch --controller AD", {"ADRC"}),
    ],
)
def test_what_a_shell_is_offered(line, offered, tmp_path):
    answer = tmp_path / "answer"
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    environment = os.environ | asked | {"PYTHONPATH": os.pathsep.join(sys.path), "_ARGCOMPLETE_IFS": SEPARATOR}
    subprocess.run([sys.executable, "-m", "barbalat"], env=environment, cwd=tmp_path, check=True, timeout=60)
    found = {word.strip() for word in answer.read_text().split(SEPARATOR)}
    assert offered <= found, found
    assert len(line.split()) == 1 or line.endswith(" ") or len(found) == len(offered), found


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "tcsh", "powershell"])
def test_each_shell_has_its_script(shell, capsys):
    assert main(["completion", shell]) == 0
    assert "barbalat" in capsys.readouterr().out


def test_new_puts_the_schema_beside_the_case(tmp_path, capsys):
    case, schema = tmp_path / "own.toml", tmp_path / "barbalat.schema.json"
    assert main(["new", str(case)]) == 0
    assert case.read_text().startswith(f"#:schema ./{schema.name}\n")
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(schema.read_text())
    schema.write_text("{}")
    assert main(["new", str(tmp_path / "other.toml"), "--from", "rohrs"]) == 0
    assert schema.read_text() == "{}"  # the file may be the user's
    assert tomllib.loads((tmp_path / "other.toml").read_text()) == tomllib.loads(bundled()["rohrs"].read_text())


def test_a_case_that_is_not_bundled_leaves_nothing(tmp_path, capsys):
    assert main(["new", str(tmp_path / "own.toml"), "--from", "papr"]) == 2
    assert "one of the bundled cases" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_list_of_cases_tells_them_apart(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["cases"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if not line.startswith(" ")][: len(bundled())] == list(bundled())
    assert max(map(len, lines)) <= 80
    about = [line for line in lines if line.startswith("  ")]
    assert len(set(about)) > 2 * len(bundled())
