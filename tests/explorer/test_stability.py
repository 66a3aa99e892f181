"""What a page says of the step is what a run says of it: the page's own scripts, outside of a browser."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib import resources
from pathlib import Path

import pytest

from barbalat import simulate
from barbalat.cases.load import CaseText
from barbalat.explorer.explorer import Explorer
from barbalat.explorer.source import TextSource

NODE = shutil.which("node")
SCRIPT = Path(__file__).parent / "judged.mjs"
EIGENVALUES_WITHIN = 1e-6
"""Relative, of h|lambda|: page and run take the eigenvalues of the same matrices by routines of their own. Of a double eigenvalue
half the digits are left, some 1e-8."""

ROHRS = """
name = "Rohrs"
[plant]
transfer_function = { num = [458.0], den = [1.0, 31.0, 259.0, 229.0] }
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "sines"
constant = 0.3
amplitudes = [1.85]
frequencies = [16.1]
[simulation]
t_end = 24.0
dt = 1e-3
[[controller]]
name = "Classical"
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = 1.0 }
theta_hat0 = [-0.65, 1.14]
"""
"""The estimates drift until the loop with the unmodelled poles is unstable: it diverges, well inside the step's region."""

L1 = """
name = "step too long"
[plant]
A_m = [[0.0, 1.0], [-0.3, -1.0]]
b = [0.0, 1.0]
theta = [4.0, -3.0]
x0 = [1.0, 1.0]
[reference_model]
k_0 = 4.0
[reference]
kind = "sine"
amplitude = 50.0
frequency = 0.5
[uncertainty]
lower = [-5.0, -5.0]
upper = [5.0, 5.0]
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
scheme = "l1"
gamma = 1e4
filter = { kappa = 0.02 }
[[controller]]
scheme = "mrac"
gamma = 1e4
"""
MORE = {
    "smooth": ("", ""),
    "a jump between two steps": (
        'kind = "sine"\namplitude = 50.0\nfrequency = 0.5',
        'kind = "step"\namplitude = 40.0\nstart = 1.00049',
    ),
    "a delay": ("[reference_model]", "[plant.input]\ndelay = 0.0123\n[reference_model]"),
    "noise": ("[reference_model]", "[sensor.noise]\nstd = [0.1, 0.1]\nsample_time = 0.01\nseed = 3\n[reference_model]"),
    "samples": ("gamma = 1e4\n[[", "gamma = 1e4\nsample_time = 0.01\n[["),
}
"""What else is in the case, by what is replaced in it; the sampled controller's own steps are implicit."""
RARER = ("a jump between two steps", "a delay")


class WithoutSliders(TextSource):
    """The case as it is given: finding out what each number moves takes a page most of its time."""

    def numbers(self):
        return iter(())


def judged(text: str, folder: Path) -> tuple[dict, dict]:
    """What a page says of each controller, and the runs of its case."""
    if NODE is None:
        pytest.skip("node is not installed")
    page = Explorer(WithoutSliders(CaseText(text, folder)))
    data = folder / "data.json"
    data.write_text(json.dumps(page.contents.data))
    templates = resources.files("barbalat.explorer") / "templates"
    said = subprocess.run([NODE, SCRIPT, str(templates), data], check=True, capture_output=True, text=True).stdout
    case = page.source.at({})
    return json.loads(said), simulate(case.problem, case.controllers, case.simulation)


def compare(said: dict, runs: dict) -> None:
    for name, run in runs.items():
        assert said[name]["figures"] == run.figures
        if said[name]["numerics"] is not None:
            assert said[name]["numerics"]["hLambda"] == pytest.approx(run.stiffness.h_lambda_max, rel=EIGENVALUES_WITHIN)
            assert said[name]["numerics"]["unstable"] == run.stiffness.unstable_from
        found = said[name]["runaway"]
        assert (found is None) == (run.runaway is None)
        if run.runaway is not None:
            assert found == pytest.approx(run.runaway.as_json(), rel=1e-9)


def test_a_divergence_of_the_loops_is_not_the_solvers(tmp_path):
    """Drawn are the instants of the run's record but for the last, after which it diverges; all of it is finite."""
    said, runs = judged(ROHRS, tmp_path)
    compare(said, runs)
    assert runs["Classical"].diverged_at is not None and said["Classical"]["numerics"]["unstable"] is None
    assert said["Classical"]["instants"] == len(runs["Classical"].t) - 1 and said["Classical"]["finite"]


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.full) if name in RARER else name for name in MORE])
def test_the_first_step_outside_is_the_runs(tmp_path, name):
    """With all that a run has beside its equations, to the step."""
    said, runs = judged(L1.replace(*MORE[name]) if name != "smooth" else L1, tmp_path)
    compare(said, runs)
    assert any(run.stiffness.unstable_from is not None for run in runs.values())


UNSTABLE = """
name = "limits too narrow"
[plant]
A = [[0.0, 1.0], [2.0, -0.4]]
b = [0.0, 4.0]
x0 = [0.1, 0.0]
[plant.input]
delay = 0.0777
saturation = [-3.0, 0.5]
rate_limit = 4.0
[reference_model]
A_m = [[0.0, 1.0], [-9.0, -4.2]]
k_0 = 2.25
[reference]
kind = "sine"
amplitude = 4.0
frequency = 1.0
[simulation]
t_end = 9.0
dt = 1e-3
[[controller]]
name = "runs away"
scheme = "mrac"
gamma = 20.0
"""
OUTPUT = """
name = "leaves its model"
[plant]
transfer_function = { num = [1.0], den = [1.0, -1.0] }
[plant.input]
saturation = [-0.1, 0.1]
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "constant"
value = 1.0
[simulation]
t_end = 14.0
dt = 1e-3
[[controller]]
name = "runs away"
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = 1.0 }
theta_hat0 = [-2.0, 1.0]
"""
END = """
const { endOf, runawayText } = await import(process.argv[1]);
const run = JSON.parse(process.argv[2]);
const other = { figures: { diverged_at: null }, runaway: null };
process.stdout.write(JSON.stringify([endOf(run, 15), endOf(other, 15), runawayText(run.runaway)]));
"""


@pytest.mark.parametrize("text", [UNSTABLE, OUTPUT], ids=["of the state", "of the output"])
def test_a_run_that_runs_away_is_said_to(text, tmp_path):
    """By a run's own test and in its words; of a run that does neither, no more is said than was seen."""
    said, runs = judged(text, tmp_path)
    compare(said, runs)
    run = runs["runs away"]
    assert run.diverged_at is None and run.runaway is not None
    table = (resources.files("barbalat.explorer") / "templates" / "table.js").as_uri()
    command = [NODE, "--input-type=module", "-e", END, table, json.dumps(said["runs away"])]
    away, bounded, sentence = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert "runs away" in away and "bounded" not in away + bounded and "up to 15 s" in bounded
    assert sentence.replace("e+", "e+0") == run.runaway.sentence


SCALE = """
const { scaleOf } = await import(process.argv[1]);
const plot = { series: [{ idxs: [1, 3] }], data: [[0, 1, 2, 3], [0, 1, -1, 0.5], [0, 1e3, 1e9, 1e12], [9, 0, 0.25, 0]] };
const runs = [{ gone: false, low: [] }, { gone: true, low: [] }, { low: [] }];
const found = [false, true].map((log) => scaleOf({ log, series: runs }).range(plot));
const alone = scaleOf({ series: [runs[1], runs[2]] });
process.stdout.write(JSON.stringify([...found, alone, scaleOf({ series: [runs[0], runs[2]] })]));
"""


def test_a_panel_shows_what_the_bounded_runs_need():
    """Of the instants 1 to 3 the bounded run and the line without a run reach from -1 to 1, the other one to 1e12."""
    if NODE is None:
        pytest.skip("node is not installed")
    charts = (resources.files("barbalat.explorer") / "templates" / "charts.js").as_uri()
    said = subprocess.run([NODE, "--input-type=module", "-e", SCALE, charts], check=True, capture_output=True, text=True).stdout
    linear, logarithmic, all_gone, none_gone = json.loads(said)
    assert linear == [-1.5, 1.5] and logarithmic == [0.25 / 2, 20.0]
    assert all_gone == {"distr": 4} and none_gone == {}
