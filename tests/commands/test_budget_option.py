"""``--budget``: which commands accept it, that it applies while they work, and where the estimate is reported."""

import json
from pathlib import Path

import pytest

from barbalat import budget, cli
from barbalat.cli import main


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


WORKING = {
    "reproduce",
    "run",
    "certify",
    "sweep",
    "sensitivity",
    "tune",
    "contest",
    "design",
    "tradeoff",
    "identify",
    "explore",
    "export",
    "fly",
}


def test_every_command_that_works_takes_it():
    commands = next(action for action in cli._parser()._actions if action.choices).choices
    assert {name for name, parser in commands.items() if "--budget" in parser._option_string_actions} == WORKING


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "first-order", "--budget", "1MiB"], "simulation.record_points = 2000 would take about"),
        (["run", "first-order", "--budget", "100ms"], "--budget must be a memory, a time or both, such as 16GiB,5h, got '100ms'"),
        (["certify", "first-order", "--budget", "1KiB"], "would take about"),
        (
            ["sweep", "first-order", "--sample", "plant.theta=known-set", "--members", "9999999999", "--budget", "2h"],
            "the sweep of 9999999999 members would take about",
        ),
        (["tune", "first-order", "--for", "rms_e", "--trials", "99999999"], "trials = 99999999 would take about"),
        (["tradeoff", "paper", "--density", "1000000"], "density = 1000000 would take about"),
        (["contest", "paper", "--members", "99999999"], "members = 99999999 would take about"),
        (["explore", "first-order", "--no-open", "--budget", "1KiB"], "would take about"),
        (["export", "first-order", "--controller", "MRAC, sampled", "--out", "c", "--budget", "1KiB"], "would take about"),
    ],
)
def test_what_is_beyond_it_is_refused_in_one_sentence_and_leaves_nothing(arguments, said, capsys, tmp_path):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert not out
    assert said in err.splitlines()[-1] and err.splitlines()[-1].startswith("barbalat: ")
    assert not list(tmp_path.iterdir())
    assert budget.in_force() == budget.Budget()


def test_what_is_expected_to_take_long_is_told_beside_the_document(capsys, monkeypatch):
    monkeypatch.setattr(budget, "TOLD_SECONDS", 0.0)
    assert main(["run", "first-order", "--json", "--budget", "1h"]) == 0
    out, err = capsys.readouterr()
    assert set(json.loads(out)["controllers"]) == {"MRAC", "L1", "MRAC, sampled"}
    (told,) = [line for line in err.splitlines() if line.startswith("simulating: ")]
    assert ": estimated at about " in told and told.endswith(" of computing")


def test_the_refusal_that_the_documentation_shows_is_the_one_that_is_made(capsys):
    page = (Path(__file__).parents[2] / "docs" / "numerics.md").read_text("utf-8")
    (shown,) = [block for block in page.split("```") if block.strip().startswith("barbalat: the sweep")]
    assert main(["sweep", "paper", "--sample", "plant.theta=known-set", "--members", "100000000"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == " ".join(shown.split())


def test_what_is_soon_done_is_not_told(capsys):
    assert main(["run", "first-order", "--json"]) == 0
    assert "estimate" not in capsys.readouterr().err
