"""``barbalat identify``: from a CSV file to a case that runs, and its rejections."""

import json
from pathlib import Path

import numpy as np
import pytest

from barbalat.cases.load import load_case
from barbalat.cli import main


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """A recording of x' = -2 x + 3 u under held steps, measured with an error of up to 1e-4. The slope stays below 12."""
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


def test_the_page_has_the_residuals_and_the_json_has_all_of_them(rig, capsys, tmp_path):
    assert main([*rig, *BOUNDS, "--out", "rig.toml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    data = np.loadtxt("rig.csv", delimiter=",", skiprows=1)
    held = data[told["trained"] :]
    left, (t, u, x) = told["residuals"], held.T
    assert left["t"] == t.tolist()
    a, b = (told["rows"]["speed"]["nominal"][name] for name in ("speed", "u"))
    forced, grown = [0.0], np.exp(a * (t - t[0]))  # by hand: the exact step of x' = a x + b u under a held input
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        forced.append(np.exp(a * h) * forced[-1] + (np.exp(a * h) - 1) / a * b * u[k])
    simulated = forced + grown * (grown @ (x - forced)) / (grown @ grown)  # from the initial state of least squares
    found = np.array(left["speed"]["values"])
    assert np.abs(found - (x - simulated)).max() < 1e-12
    assert left["speed"]["max_abs"] == np.abs(found).max() and left["speed"]["rms"] == pytest.approx(np.sqrt(np.mean(found**2)))
    page = (tmp_path / "rig.html").read_text()
    assert f"{left['speed']['max_abs']:.3g}" in page
    assert "<svg" in page or "data:image" in page
    assert "a_1_1" in page


def test_the_screen_says_what_is_guaranteed(rig, capsys):
    assert main([*rig, *BOUNDS]) == 0
    assert "known set contains every plant" in " ".join(capsys.readouterr().out.split())
    assert main(rig) == 0
    assert "confidence intervals and are not guaranteed" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--noise", "speed=1e-4"], "slope is needed with noise"),
        (["--noise", "sped=1e-4", "--slope", "speed=12"], "noise names 'sped', which is not an output; did you mean 'speed'?"),
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


@pytest.mark.parametrize("cell", ["nan", "", "inf", "1.2.3"])
def test_a_cell_that_is_no_number_is_told_with_its_line_and_column(rig, capsys, tmp_path, cell):
    lines = (tmp_path / "rig.csv").read_text().splitlines()
    lines[7] = f"{lines[7].rpartition(',')[0]},{cell}"
    (tmp_path / "rig.csv").write_text("\n".join(lines))
    assert main(rig) == 2
    told = capsys.readouterr().err
    assert f"rig.csv, line 8, column 'speed': expected a number, got {repr(cell) if cell else 'an empty cell'}" in told
    assert told.count("\n") == 1


FLOWN = """
name = "rig"
[plant]
A = [[-1.0]]
b = [3.0]
[reference_model]
poles = [-4.0]
follow = "x_1"
[reference]
kind = "constant"
value = 1.0
[uncertainty]
lower = [-3.0]
upper = [3.0]
[simulation]
t_end = 1.0
dt = 0.01
[[controller]]
scheme = "mrac"
gamma = 20.0
sample_time = 0.02
[[controller]]
scheme = "l1"
gamma = 100.0
filter = { kappa = 0.05 }
"""


@pytest.fixture
def replayed(rig, tmp_path):
    """The rig's recording with a command for its model, and a case whose plant has a = -1 instead of -2."""
    lines = (tmp_path / "rig.csv").read_text().splitlines()
    (tmp_path / "rig.csv").write_text("\n".join([f"{lines[0]},r", *(f"{line},1.0" for line in lines[1:])]))
    (tmp_path / "rig.toml").write_text(FLOWN)
    return [*rig, "--commands", "r", "--replay", "rig.toml"]


def test_a_recording_is_replayed_through_the_estimators_of_a_case(replayed, capsys):
    """The estimates equal those of the Python call. They exist only for the sampled controller."""
    from barbalat.studies import replay

    assert main([*replayed, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["controllers"]) == ["MRAC"] and told["samples"] == 400
    case, data = load_case("rig.toml"), np.loadtxt("rig.csv", delimiter=",", skiprows=1)
    expected = replay(case.problem, case.controllers[0], data[:, 0], data[:, 2:3], data[:, 1:2], data[:, 3:])
    of = told["controllers"]["MRAC"]
    np.testing.assert_array_equal(of["theta_hat"], expected.theta_hat)
    assert of["known_set"] == [[-3.0, 3.0]]
    assert of["theta_hat_final"] == of["theta_hat"][-1] and np.ptp(of["theta_hat"]) > 0.01
    assert of["rms_u_difference"] == pytest.approx(float(np.sqrt(np.mean((expected.proposed - data[:, 1:2]) ** 2))))
    assert main([*replayed, "--out", "flown.html"]) == 0
    assert "theta_hat_1" in capsys.readouterr().out
    page = Path("flown.html").read_text()
    assert "<code>rig.csv</code> through the estimators of <code>rig.toml</code>" in page and "−3 to 3" in page
    assert all(Path(f"flown{end}").stat().st_size > 1000 for end in (".png", ".svg", "-narrow.svg"))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--out", "new.toml"], "--out must be a page, NAME.html, got 'new.toml'"),
        (["--noise", "speed=1"], "--noise applies only to an identification"),
        (["--commands", "q"], "the column 'q' is not in its first line"),
        (["--outputs", "speed,u"], "must be different columns"),
        (["--time", "r"], "must be increasing"),
        (["--replay", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_a_replay_refuses_in_one_sentence(replayed, more, said, capsys):
    assert main([*replayed, *more]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") <= 3


def test_what_a_replay_needs_is_said(replayed, rig, tmp_path, capsys):
    assert main([*rig, "--replay", "rig.toml"]) == 2
    assert "--replay needs --commands" in capsys.readouterr().err
    assert main([*rig, "--commands", "r"]) == 2
    assert "--commands needs --replay" in capsys.readouterr().err
    (tmp_path / "rig.toml").write_text(FLOWN.replace("sample_time = 0.02\n", "sample_time = 0.05\n"))
    assert main(replayed) == 2
    assert "MRAC: times must be one sample time of 0.05 s apart" in capsys.readouterr().err
    (tmp_path / "rig.toml").write_text(FLOWN.replace("sample_time = 0.02\n", ""))
    assert main(replayed) == 2
    assert "needs a sampled controller that estimates something" in capsys.readouterr().err


def test_a_dead_time_and_an_operating_point_go_into_the_case(tmp_path, monkeypatch, capsys):
    """T' = -0.5 (T - 20) + 3 u(t - 0.2 s) is recorded in absolute values. The case has the delay, the deviations and the
    operating point."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u, T, lines, grown = np.repeat(rng.uniform(0, 2, 20), 40).tolist(), 20.0, ["t,u,T"], float(np.exp(-0.5 * 0.05))
    for k in range(800):
        lines.append(f"{0.05 * k!r},{u[k]!r},{T + 1e-3 * float(rng.uniform(-1, 1))!r}")
        T = 20.0 + grown * (T - 20.0) + (1 - grown) / 0.5 * 3.0 * (u[k - 4] if k >= 4 else 0.0)
    (tmp_path / "rig.csv").write_text("\n".join(lines))
    asked = ["identify", "rig.csv", "--inputs", "u", "--outputs", "T"]
    assert main(asked) == 0
    assert "try --offset --delay 0.2" in " ".join(capsys.readouterr().out.split())
    assert main([*asked, "--offset", "--delay", "0.2", "--out", "rig.toml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["delay"] == 0.2 and told["alternative"] is None
    point = told["operating_point"]
    assert point["T"] == pytest.approx(20.0 + 6.0 * point["u"], rel=1e-3)
    text = (tmp_path / "rig.toml").read_text()
    assert f"deviations from the operating point T = {point['T']:.6g}, u = {point['u']:.6g}" in text
    case = load_case("rig.toml")
    assert case.problem.plant.input.delay == 0.2
    assert {one.name for one in case.problem.plant.physical.parameters} == {"a_1_1", "b_1_1"}
    assert "deviations from the operating point" in (tmp_path / "rig.html").read_text()
    assert main([*asked, "--offset", "--delay", "0.2"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "dead time of 0.2 s" in shown and "deviations from the operating point T = " in shown
    assert main(["run", "rig.toml", "--json", "--no-plots"]) == 0
