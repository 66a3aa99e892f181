"""The search for the worst member: against a dense grid, inside its set, and rejected where it can't search."""

import json

import numpy as np
import pytest

from barbalat import load_case, simulate
from barbalat.cases.load import CaseText
from barbalat.cli import main
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.run.engine.engine import Batch, run
from barbalat.sweeps.sweep import sweep
from barbalat.sweeps.worst import SearchedSet, find_worst
from case_texts import DRIVE
from independent import refusal

STEPS = DRIVE.replace("tolerance = 1e-6", "dt = 2e-3")


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(STEPS)
    return path


RANGES = {"plant.theta[0]": "uniform:-2.9:1", "controller[0].gamma": "loguniform:0.5:20"}


def test_it_finds_what_a_dense_grid_finds(case):
    figures = ("max_abs_e[0]", "rms_e[0]", "max_abs_u")
    found = find_worst(case, figures, sample=RANGES, starts=16)
    grid = sweep(case, vary={"plant.theta[0]": "-2.9:1:79", "controller[0].gamma": "0.5:20:61:log"}, bounds=False, audit=0)
    assert [one.figure for one in found.extremes] == list(figures)
    for one in found.extremes:
        values = grid.column(f"MRAC/{one.figure}")
        width = values.max() - values.min()
        # between the grid's points, 1/60 of the set apart, a smooth minimum is a little lower
        assert -1e-9 * width <= one.largest.value - values.max() < 1e-2 * width
        assert -1e-2 * width < one.least.value - values.min() <= 1e-3 * width
    assert found.runs + found.gradients < len(grid) / 4
    assert found.undefined == 0


def test_a_delay_over_several_steps_is_searched_although_it_has_corners(case):
    """At each multiple of the step the delay has a corner, where the search moves without a slope."""
    found = find_worst(case, ["rms_e"], vary={"plant.input.delay": "0.01:0.05:3"}, starts=8)
    (one,) = found.extremes
    grid = sweep(case, vary={"plant.input.delay": "0.01:0.05:41"}, bounds=False, audit=0).column("MRAC/rms_e[0]")
    assert found.undefined > 0
    assert one.largest.value >= 0.999 * grid.max() and one.least.value <= 1.001 * grid.min()


def test_a_member_has_the_value_that_is_reported(case):
    (one,) = find_worst(case, ["rms_e"], sample=RANGES, starts=8).extremes
    paths = tuple(FieldPath.parse(path) for path in one.largest.numbers)
    own = VariedCase(CaseText.read(case), paths, redesign=False).at(list(one.largest.numbers.values()))
    batch = Batch.of([(own.problem, own.controllers[0])], own.simulation)
    run([batch], own.problem.signals, own.simulation)
    assert batch.metrics(own.simulation).rms_e[0, 0] == pytest.approx(one.largest.value, rel=1e-12)
    assert one.largest.half_step == pytest.approx(one.largest.value, rel=1e-3)
    assert one.bound is None


def test_without_ranges_it_searches_the_known_set_and_tells_the_bound(case):
    found = find_worst(case, ["max_abs_e"], starts=4)
    assert found.ranges == {"plant.theta[0]": (-3.0, 3.0)}
    (one,) = found.extremes
    assert one.largest.value <= one.bound < 100 * one.largest.value
    assert one.least.value < one.largest.value
    assert find_worst(case, ["max_abs_e"], starts=4).as_json() == found.as_json()


def test_points_stay_in_a_ball_and_a_logarithmic_axis_is_searched_in_its_logarithm(tmp_path):
    path = tmp_path / "ball.toml"
    text = CaseText.read("paper").text.replace("t_end = 60.0", "t_end = 1.0").replace("dt = 1e-4", "dt = 1e-3")
    path.write_text(text.replace("lower = [-5.0, -5.0]\nupper = [5.0, 5.0]", "center = [0.0, 0.0]\nradius = 6.0"))
    found = find_worst(path, ["max_abs_e[0]"], starts=4)
    for one in found.extremes:
        for member in (one.least, one.largest):
            assert np.linalg.norm(list(member.numbers.values())) <= 6.0
    region = SearchedSet(np.array([1.0]), np.array([100.0]), np.array([True]))
    assert region.numbers(np.array([[0.5]]))[0, 0] == pytest.approx(10.0)
    assert region.slopes(np.array([[0.5]]))[0, 0] == pytest.approx(10 * np.log(100.0))


def test_a_number_over_decades_has_its_slopes_at_its_low_end(tmp_path):
    """The filter's matrices follow from kappa, so their slopes are differences, whose steps are relative to each value."""
    path = tmp_path / "filter.toml"
    path.write_text(STEPS.replace('scheme = "mrac"\ngamma = 3.0', 'scheme = "l1"\ngamma = 300.0\nfilter = { kappa = 0.02 }'))
    (one,) = find_worst(path, ["rms_e"], sample={"controller[0].filter.kappa": "loguniform:1e-3:2"}, starts=4).extremes
    values = sweep(path, vary={"controller[0].filter.kappa": "1e-3:2:200:log"}, bounds=False, audit=0).column("MRAC/rms_e[0]")
    assert one.least.value <= values.min() * (1 + 1e-3) and one.largest.value >= values.max() * (1 - 1e-3)


@pytest.mark.parametrize(
    ("ranges", "said"),
    [
        (
            {"sample": {"plant.theta[0]": "normal:0:1"}},
            "plant.theta[0]: a search for the worst member needs a range, but a normal",
        ),
        ({"vary": {"plant.theta[0]": "1:1:1"}}, "plant.theta[0]: a search for the worst member needs a range, got 1 alone"),
        (
            {"vary": {"reference.amplitude": "1:2:2"}},
            "reference.amplitude changes a signal or the structure, which a search does",
        ),
    ],
)
def test_what_it_cannot_search_is_refused(ranges, said, case):
    assert refusal(lambda: find_worst(case, ["rms_e"], **ranges)).startswith(said)


def test_the_command_prints_a_table_of_80_columns_and_a_document(case, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["sweep", str(case), "--worst", "max_abs_e", "--members", "4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Drive: the worst that was found; no proof" and max(map(len, lines)) <= 80
    assert "% of the guaranteed bound" in " ".join(line.strip() for line in lines)
    assert main(["sweep", str(case), "--worst", "max_abs_e", "--members", "4", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["claim"] == "the worst that was found; no proof"
    assert found["worst"][0]["largest"]["value"] > found["worst"][0]["least"]["value"]


UNUSED = ("--store x", "--design sobol", "--design latin", "--audit 0", "--member 0", "--no-bounds", "--out x", "--require a<2")


@pytest.mark.parametrize("option", [*UNUSED, "--scheduler local:2"])
def test_options_that_a_search_does_not_use_are_refused(option, case, capsys):
    assert main(["sweep", str(case), "--worst", "max_abs_e", *option.split()]) == 2
    assert f"{option.split()[0]} belongs to a sweep, but --worst runs a search instead" in capsys.readouterr().err


def test_a_known_set_on_which_the_simulated_plant_does_not_depend_is_not_searched(tmp_path):
    path = tmp_path / "apart.toml"
    apart = STEPS.replace("[reference_model]", "[truth]\nA = [[-0.5]]\n[reference_model]")
    path.write_text(apart)
    assert refusal(lambda: find_worst(path, ["rms_e"])).startswith("the known set of theta does not describe the simulated plant")
    assert find_worst(path, ["rms_e"], sample={"truth.A[0][0]": "uniform:-1:-0.5"}, starts=2).ranges == {
        "truth.A[0][0]": (-1, -0.5)
    }
    for old, new in (
        ("A_m = [[-2.0]]", 'A = [["-K"]]'),
        ("theta = [1.0]\n", ""),
        ("k_0 = 1.3", "A_m = [[-2.0]]\nk_0 = 1.3"),
        ("[uncertainty]\nlower = [-3.0]\nupper = [3.0]\n", "[parameters]\nK = { value = 0.6, tolerance = 0.2 }\n"),
    ):
        assert old in apart
        apart = apart.replace(old, new)
    path.write_text(apart)
    assert refusal(lambda: find_worst(path, ["rms_e"])).startswith(
        "no formula of the simulated plant contains K: give --redesign"
    )
    assert set(find_worst(path, ["rms_e"], starts=2, redesign=True).ranges) == {"parameters.K"}


def test_with_a_tolerance_it_searches_by_fixed_steps(tmp_path):
    path = tmp_path / "tolerance.toml"
    path.write_text(DRIVE)
    found = find_worst(path, ["max_abs_e"], starts=4)
    assert found.steps is not None and found.steps.startswith("all runs here use fixed steps, rk4 with h = ")
    (one,) = found.extremes
    path.write_text(DRIVE.replace("theta = [1.0]", f"theta = [{one.largest.numbers['plant.theta[0]']!r}]"))
    own = load_case(path)
    result = simulate(own.problem, own.controllers, own.simulation)["MRAC"]
    assert one.largest.value == pytest.approx(result.metrics.max_abs_e[0, 0], rel=1e-5)
