"""Where JSBSim is not installed, flights say how it is."""

from barbalat import validate
from barbalat.cli import main


def test_it_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(validate, "find_spec", lambda name: None)
    assert main(["fly", "f16-pitch"]) == 2
    said = capsys.readouterr().err
    assert said == "barbalat: a flight model needs the package jsbsim, which is not installed: pip install 'barbalat[flight]'\n"
    assert list(tmp_path.iterdir()) == []
