"""A page's statement on the step agrees with the statement of a run. The page's own scripts run without a browser."""

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
from barbalat.judge.verdict import percent
from case_texts import SECTION_V

NODE = shutil.which("node")
SCRIPT = Path(__file__).parent / "judged.mjs"
EIGENVALUES_WITHIN = 1e-6
"""Relative tolerance of h|lambda|. The page and the run compute the eigenvalues of the same matrices with different routines. A
double eigenvalue has only half of the digits, about 1e-8."""

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
"""The estimates drift until the loop with the unmodelled poles is unstable. It diverges well within the stability region of the
step."""

L1 = (
    'name = "step too long"'
    + SECTION_V
    + """[simulation]
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
)
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
"""Other contents of the case, by the replaced text. The sampled controller's own steps are implicit."""
RARER = ("a jump between two steps", "a delay")


class WithoutSliders(TextSource):
    """The case without sliders, because finding the effect of each number takes most of the time for a page."""

    def numbers(self):
        return iter(())


def judged(text: str, folder: Path) -> tuple[dict, dict]:
    """A page's statements on each controller, and the runs of its case."""
    if NODE is None:
        pytest.skip("node is not installed")
    page = Explorer(WithoutSliders(CaseText(text, folder)))
    data = folder / "data.json"
    data.write_text(json.dumps(page.contents.data))
    templates = resources.files("barbalat.explorer") / "templates"
    said = subprocess.run([NODE, SCRIPT, str(templates), data], check=True, capture_output=True, text=True).stdout
    case = page.source.at({})
    return json.loads(said), simulate(case.problem, case.controllers, case.simulation, judge=case.judge)


def compare(said: dict, runs: dict) -> None:
    for name, run in runs.items():
        assert said[name]["figures"] == run.figures
        if said[name]["numerics"] is not None:
            assert said[name]["numerics"]["hLambda"] == pytest.approx(run.stiffness.h_lambda_max, rel=EIGENVALUES_WITHIN)
            assert said[name]["numerics"]["unstable"] == run.stiffness.unstable_from
        assert said[name]["verdict"]["sentence"] == str(run.judged)


def test_a_divergence_of_the_loops_is_not_the_solvers(tmp_path):
    """All recorded instants except the last, after which the run diverges, are drawn. Every drawn value is finite."""
    said, runs = judged(ROHRS, tmp_path)
    compare(said, runs)
    assert runs["Classical"].diverged_at is not None and said["Classical"]["numerics"]["unstable"] is None
    assert said["Classical"]["instants"] == len(runs["Classical"].t) - 1 and said["Classical"]["finite"]


@pytest.mark.parametrize(("x_1", "told"), [("1e3", "within"), ("1e-3", "and by")])
def test_the_state_that_is_declared_to_follow_comes_first_on_a_page(tmp_path, x_1, told):
    """The controller is within its band, or outside it like the other one, whose error is larger."""
    judge = f'follow = "x_1"\n[judge]\nfollows = {{ x_1 = {x_1}, x_2 = 1e-6 }}'
    text = (
        L1.replace("k_0 = 4.0", judge)
        .replace('\n[[controller]]\nscheme = "mrac"\ngamma = 1e4', "")
        .replace("t_end = 2.0", "t_end = 0.5")
    )
    said, runs = judged(text.replace("gamma = 1e4", "gamma = 100.0"), tmp_path)
    compare(said, runs)
    assert all(told in one["verdict"]["sentence"] for one in said.values())


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.full) if name in RARER else name for name in MORE])
def test_the_first_step_outside_is_the_runs(tmp_path, name):
    """The comparison includes everything that a run adds to its equations in every step."""
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
CYCLE = """
name = "swings from limit to limit"
[plant]
A = [[0.0, 1.0], [0.0, -1.0]]
b = [0.0, 5.0]
[plant.input]
delay = 0.15
saturation = [-2.0, 2.0]
[reference_model]
A_m = [[0.0, 1.0], [-9.0, -4.2]]
k_0 = 1.8
[reference]
kind = "square"
amplitude = 1.0
frequency = 0.5
[sensor.noise]
std = [0.001, 0.001]
sample_time = 0.01
[simulation]
t_end = 20.0
dt = 1e-3
[labels]
input_units = ["V"]
[[controller]]
name = "cycles"
scheme = "mrac"
gamma = 50.0
"""


@pytest.mark.parametrize("text", [UNSTABLE, OUTPUT], ids=["of the state", "of the output"])
def test_a_run_that_is_lost_is_said_to_be(text, tmp_path):
    """The page uses the words of a run. Neither of the two has diverged."""
    said, runs = judged(text, tmp_path)
    compare(said, runs)
    run = runs["runs away"]
    assert run.diverged_at is None and said["runs away"]["verdict"]["kind"] == "lost" == run.verdict.kind


def test_a_limit_cycle_is_found_on_the_page(tmp_path):
    """If everything is held constant beyond the page's end, amplitude and frequency equal those of the run."""
    said, runs = judged(CYCLE, tmp_path)
    compare(said, runs)
    found, cycle = said["cycles"]["verdict"], runs["cycles"].verdict.cycle
    assert found["kind"] == "limit cycle" and "±2 V" in found["sentence"]
    assert found["cycle"]["amplitude"] == cycle.amplitude and found["cycle"]["frequency"] == pytest.approx(
        cycle.frequency, rel=1e-9
    )


def test_bands_of_the_case_are_the_pages(tmp_path):
    bands = "[judge]\nfollows = { x_1 = 100.0, x_2 = 100.0 }\nlost = { x_1 = 1e4 }\n"
    said, runs = judged(L1.replace("gamma = 1e4", "gamma = 10.0").replace("[simulation]", f"{bands}[simulation]"), tmp_path)
    compare(said, runs)
    assert [one["verdict"]["kind"] for one in said.values()] == ["follows", "follows"]


NUMBERS = """
const { brief, percent } = await import(process.argv[1]);
const values = JSON.parse(process.argv[2]);
process.stdout.write(JSON.stringify([values.map((v) => brief(v)), values.map((v) => brief(v, 4)), values.map(percent)]));
"""


def test_numbers_are_written_as_a_run_writes_them():
    """Numbers have Python's format %g, and shares have two digits."""
    values = [0.0, 1.0, 62.345, 0.00012345, 1.2345e-5, 9.996, 99.95, 999.6, 1234.5, 1e5, 123456.0, 0.104]
    values += [0.0996, 2.5e-4, 1.8, 0.125, 0.135, 2.5]
    judge = (resources.files("barbalat.explorer") / "templates" / "judge.js").as_uri()
    command = [NODE, "--input-type=module", "-e", NUMBERS, judge, json.dumps(values)]
    three, four, shares = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert three == [f"{value:.3g}" for value in values] and four == [f"{value:.4g}" for value in values]
    assert shares == [percent(value) if value else "0 %" for value in values]


SCALE = """
const { scaleOf } = await import(process.argv[1]);
const plot = { series: [{ idxs: [1, 3] }], data: [[0, 1, 2, 3], [0, 1, -1, 0.5], [0, 1e3, 1e9, 1e12], [9, 0, 0.25, 0]] };
const runs = [{ gone: false, low: [] }, { gone: true, low: [] }, { low: [] }];
const found = [false, true].map((log) => scaleOf({ log, series: runs }).range(plot));
const alone = scaleOf({ series: [runs[1], runs[2]] });
const from_zero = { series: [{}], data: [[0, 1, 2], [Number.MIN_VALUE, 0.5, 4]] };
const error = scaleOf({ log: true, series: [runs[0]] }).range(from_zero);
process.stdout.write(JSON.stringify([...found, alone, scaleOf({ series: [runs[0], runs[2]] }), error]));
"""


def test_a_panel_shows_what_the_bounded_runs_need():
    """From the instants 1 to 3, the bounded run and the line without a run reach from -1 to 1, and the other run reaches 1e12."""
    if NODE is None:
        pytest.skip("node is not installed")
    charts = (resources.files("barbalat.pictures") / "templates" / "charts.js").as_uri()
    said = subprocess.run([NODE, "--input-type=module", "-e", SCALE, charts], check=True, capture_output=True, text=True).stdout
    linear, logarithmic, all_gone, none_gone, error = json.loads(said)
    assert linear == [-1.5, 1.5] and logarithmic == [0.25 / 2, 20.0]
    assert all_gone == {"distr": 4} and none_gone == {} and error == [0.25, 8.0]  # an error of exactly zero is left out
