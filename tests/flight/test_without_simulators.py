"""Where the simulators are not installed, flights say how it is."""

import pytest

from barbalat import validate
from barbalat.cli import main


@pytest.mark.parametrize(
    ("name", "what"),
    [("f16-pitch", "a flight model needs the package jsbsim"), ("quadrotor", "the quadrotor needs the package mujoco")],
)
def test_it_says_what_to_install(name, what, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(validate, "find_spec", lambda name: None)
    assert main(["fly", name]) == 2
    said = capsys.readouterr().err
    assert said == f"barbalat: {what}, which is not installed: pip install 'barbalat[flight]'\n"
    assert list(tmp_path.iterdir()) == []
