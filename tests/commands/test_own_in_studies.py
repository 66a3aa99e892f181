"""The user's own controllers in pages that simulate and in trade-offs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from barbalat.cases import user_controllers
from barbalat.cases.load import load_case, parse_case
from barbalat.cli import main
from barbalat.explorer.explorer import explore
from barbalat.run.engine.simulate import simulate

LAWS = (Path(__file__).parents[1] / "foreign.py").read_text().partition("def wrong(")[0]
CASE = """
name = "own"
[plant]
A_m = [[0.0, 1.0], [-1.0, -1.4]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
[reference_model]
k_0 = 1.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 0.5
[uncertainty]
lower = [-2.0, -2.0]
upper = [2.0, 2.0]
[simulation]
t_end = 2.0
dt = 1e-2
[[controller]]
scheme = "mrac"
gamma = 5.0
"""
COPIES = Path(user_controllers.__file__).parents[1] / "explorer" / "templates" / "copies.js"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)
    Path("laws.py").write_text(LAWS + 'CONTROLLERS = [Plain(5.0), Bare(7.0, "second")]')
    return tmp_path


def data_of(page):
    return json.loads(re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', page, re.DOTALL)[1])


def setting_of(data):
    """A page's data before anybody has moved a slider."""
    simulation = data["simulation"]
    return {
        "values": [one["value"] for one in data["numbers"]], "tEnd": simulation["t_end"], "dt": simulation["dt"], "delay": 0.0,
        "solver": simulation["solver"], "projection": [one["projection"] for one in data["controllers"]],
    }  # fmt: skip


def test_a_page_simulates_them_beside_the_cases(folder):
    """The page has the modules of the Python objects, and the case determines which numbers have sliders."""
    assert main(["explore", "case.toml", "--controllers", "laws.py", "--no-open"]) == 0
    data = data_of(Path("explore.html").read_text())
    assert [one["name"] for one in data["controllers"]] == ["MRAC", "plain", "second"]
    assert data["toggles"] == [0] and data["own_file"] == "laws.py"
    paths = [one["path"] for one in data["numbers"]]
    assert "plant.theta[0]" in paths and not any(path.startswith(("controller[1]", "controller[2]")) for path in paths)
    case = load_case("case.toml", "laws.py")
    alone = data_of(explore(case.problem, case.controllers[1:], case.simulation).html)
    for mine, theirs in zip(data["controllers"][1:], alone["controllers"], strict=True):
        assert [mine["variants"]["off"][key] for key in ("modules", "states")] == [
            theirs["variants"]["off"][key] for key in ("modules", "states")
        ]


@pytest.mark.skipif(shutil.which("node") is None, reason="no JavaScript here")
def test_what_is_copied_from_the_page_runs(folder):
    """The copied Python script, with the file in the same folder, gives the metrics of the case without fused multiply-adds."""
    assert main(["explore", "case.toml", "--controllers", "laws.py", "--no-open"]) == 0
    data = data_of(Path("explore.html").read_text())
    script = f"import {{ pythonOf }} from {json.dumps(COPIES.as_uri())};\nprocess.stdout.write(pythonOf("
    Path("copy.mjs").write_text(f"{script}{json.dumps(data)}, {json.dumps(setting_of(data))}));")
    copied = subprocess.run(["node", "copy.mjs"], capture_output=True, text=True, check=True).stdout
    scope = {}
    exec(copied, scope)
    case = load_case("case.toml", "laws.py")
    expected = simulate(case.problem, case.controllers, case.simulation)
    assert list(scope["results"]) == list(expected) == ["MRAC", "plain", "second"]
    for name, result in scope["results"].items():
        np.testing.assert_allclose(result.metrics.max_abs_e, expected[name].metrics.max_abs_e, rtol=1e-10)  # fused multiply-adds


@pytest.mark.dear
def test_a_sweeps_worst_members_have_pages_of_them(folder):
    """Each page has only this controller, with the member's numbers."""
    sweep = ["sweep", "case.toml", "--controllers", "laws.py", "--vary", "plant.theta[0]=-1:1:3", "--no-bounds", "--out", "study"]
    assert main(sweep) == 0
    found = json.loads(Path("study/sweep.json").read_text())["metrics"]["max_abs_e[0]"]
    for i, name in enumerate(("MRAC", "plain", "second"), start=1):
        data = data_of(Path(f"study/explore-{i}-{name.lower()}.html").read_text())
        assert [one["name"] for one in data["controllers"]] == [name]
        assert data["case"] == f"own, member {found[name]['worst_member']}"
        theta = next(one["value"] for one in data["numbers"] if one["path"] == "plant.theta[0]")
        assert theta == [-1.0, 0.0, 1.0][found[name]["worst_member"]]


def test_one_of_a_files_controllers_joins_alone(folder):
    own = user_controllers.run("laws.py")
    assert [one.name for one in parse_case(CASE, own=own.alone(1)).controllers] == ["MRAC", "second"]
    assert [one.name for one in parse_case(CASE, own=own.alone(-1)).controllers] == ["MRAC"]
    without = CASE[: CASE.index("[[controller]]")]
    assert [one.name for one in parse_case(without, own=own.alone(0)).controllers] == ["plain"]


@pytest.mark.full
def test_a_trade_off_has_them_as_they_are_or_with_their_knobs(folder, capsys):
    """Plain has MRAC's equations, and therefore MRAC's error and delays at the same gain."""
    knobs = """
import numpy as np
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.controllers import Mrac
class Tuned(Plain):
    def knobs(self, reach):
        return TuningGrid(scheme="tuned", values={"gamma": np.array([1.0, 5.0])}, make=lambda gamma: Plain(gamma))
CONTROLLERS = [Plain(5.0), Tuned(9.0, "tuned")]
"""
    Path("laws.py").write_text(LAWS + knobs)
    options = ["--density", "2", "--plants", "1", "--out", "made"]
    assert main(["tradeoff", "case.toml", "--controllers", "laws.py", *options]) == 0
    schemes = json.loads(Path("made/tradeoff.json").read_text())["schemes"]
    assert list(schemes)[:1] == ["MRAC"] and schemes["plain"]["tunings"] == [{}]
    assert schemes["tuned"]["tunings"] == [{"gamma": 1.0}, {"gamma": 5.0}]
    for key in ("error", "onset", "loss"):
        assert schemes["tuned"][key][1] == schemes["plain"][key][0]
    assert "plain" in Path("made/report.html").read_text()
    Path("laws.py").write_text(LAWS + 'CONTROLLERS = [Plain(5.0, "L1-AC")]')
    capsys.readouterr()
    assert main(["tradeoff", "case.toml", "--controllers", "laws.py", *options]) == 2
    assert "two schemes of the trade-off have the name 'L1-AC'" in capsys.readouterr().err
