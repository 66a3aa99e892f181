"""``barbalat identify``: from a CSV file to a case that runs, and its refusals."""

import json

import numpy as np
import pytest

from barbalat.cases.load import load_case
from barbalat.cli import main


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """x' = -2 x + 3 u under held steps, measured with an error of up to 1e-4; the slope stays below 12."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    lines, x = ["t,u,speed"], 0.0
    for k in range(400):
        if k % 20 == 0:
            u = float(rng.uniform(-2, 2))
        lines.append(f"{0.02 * k!r},{u!r},{x + 1e-4 * float(rng.choice([-1, 1]))!r}")
        x = float(np.exp(-0.04) * x + 1.5 * (1 - np.exp(-0.04)) * u)
    (tmp_path / "rig.csv").write_text("\n".join(lines))
    return ["identify", "rig.csv", "--inputs", "u", "--outputs", "speed"]


BOUNDS = ["--noise", "speed=1.01e-4", "--slope", "speed=12"]


def test_from_data_to_a_run(rig, capsys):
    assert main([*rig, *BOUNDS, "--out", "rig.toml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    low, high = told["rows"]["speed"]["known_set"]["speed"]
    assert told["guaranteed"] and low <= -2 <= high
    case = load_case("rig.toml")
    parameters = {one.name for one in case.problem.plant.physical.parameters}
    assert parameters == {"a_1_1", "b_1_1"}
    assert main(["run", "rig.toml", "--json", "--no-plots"]) == 0
    assert json.loads(capsys.readouterr().out)["controllers"]["MRAC"]["verdict"]["class"] == "follows"


def test_the_screen_says_what_is_guaranteed(rig, capsys):
    assert main([*rig, *BOUNDS]) == 0
    assert "lies in the known set" in " ".join(capsys.readouterr().out.split())
    assert main(rig) == 0
    assert "guarantee nothing" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--noise", "speed=1e-4"], "slope is needed beside noise"),
        (["--noise", "sped=1e-4", "--slope", "speed=12"], "noise names 'sped', which is no output; did you mean 'speed'?"),
        (["--noise", "speed"], "--noise must be NAME=VALUE"),
        (["--within", "speed.u=1"], "--within must be STATE.NAME=LOWER:UPPER"),
        (["--out", "rig.txt"], "--out must be a case file"),
        (["--time", "tt"], "the column 'tt' is not in its first line"),
    ],
)
def test_refusals_are_one_sentence(rig, capsys, tmp_path, options, said):
    assert main([*rig, *options]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert [one.name for one in tmp_path.iterdir()] == ["rig.csv"]
