"""Without the simulators, flights explain how to install them."""

import pytest

from barbalat import validate
from barbalat.cli import main
from barbalat.vehicles import schemes
from barbalat.vehicles.vehicle import vehicle_of


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


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["quadrotor", "--dispersions", "0"], "--dispersions must be a whole number from 1 to 1000000, got 0"),
        (
            ["f16-roll", "--dispersions", "2", "--delays"],
            "cannot be combined with --dispersions: each draw of a campaign has a different delay",
        ),
        (
            ["quadrotor", "--dispersions", "2", "--sil"],
            "a campaign flies the simulated controllers; compare the exported C with them in single flights",
        ),
        (
            ["quadrotor", "--dispersions", "2", "--mach", "0.5"],
            "the draws of a campaign have their own flight conditions",
        ),
        (["quadrotor", "--schemes", "linear"], "got 'linear'; here it is geometric-integral"),
        (["quadrotor", "--dispersions", "2", "--schemes", "adrc,l1-piecewize"], "'l1-piecewize'; did you mean l1-piecewise?"),
    ],
)
def test_bad_input_is_one_sentence_before_any_simulator_is_asked_for(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["fly", *arguments]) == 2
    out, said = capsys.readouterr()
    assert (out, said.count("\n")) == ("", 1)
    assert sentence in said
    assert list(tmp_path.iterdir()) == []


def test_the_scheme_that_needs_the_extra_robust_is_left_out_without_it(monkeypatch):
    monkeypatch.setattr(schemes, "find_spec", lambda name: None)
    for name in ("f16-pitch", "quadrotor"):
        offered = vehicle_of(name).schemes
        assert set(offered) - set(schemes.available(offered)) == {"hinf"}
