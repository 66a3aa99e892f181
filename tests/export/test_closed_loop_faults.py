"""The exported plant has no faults, and the command says so if the case has faults."""

from __future__ import annotations

from barbalat.cases.load import CaseText
from barbalat.cli import main

FAULT = '\n[[faults]]\nkind = "dropout"\nshare = 0.1\n\n[simulation]'


def test_a_closed_loop_without_the_cases_faults_is_named(tmp_path, capsys):
    text = CaseText.read("quadrotor-pitch").text
    for name, given in (("plain", text), ("faulty", text.replace("\n[simulation]", FAULT))):
        file = tmp_path / f"{name}.toml"
        file.write_text(given)
        assert main(["export", str(file), "--controller", "ADRC", "--closed-loop", "--out", str(tmp_path / name)]) == 0
        said = capsys.readouterr().err
        assert ("do not contain the case's [[faults]]" in said) == (name == "faulty")
        assert "without the case's `[[faults]]`" in (tmp_path / name / "README.md").read_text()
