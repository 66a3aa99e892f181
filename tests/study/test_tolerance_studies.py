"""Studies of cases with a tolerance, compared with the same studies at fixed steps that resolve every motion."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.cases.load import parse_case
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class
from barbalat.studies import delay_margins, trade_off, tune
from barbalat.study.finer_step import refined
from barbalat.study.ideal_benchmark import shortest_delay
from barbalat.study.resolved import resolved
from barbalat.study.verdicts import Verdicts, verdict_of
from case_texts import DRIVE
from independent import refusal
from relay import Relay

STEPPED = DRIVE.replace("tolerance = 1e-6", "dt = 4e-4")
GIVEN = {"t_end": 4.0, "dt": None, "solver": "auto", "tolerance": 1e-6}
CASE = parse_case(DRIVE)
(MRAC,) = CASE.controllers
FINE = Simulation(4.0, 4e-4)


@pytest.mark.full
def test_the_tuning_is_that_of_fine_steps(tmp_path) -> None:
    """There are limits of the control and of the delay. The tuned case keeps its tolerance."""
    options = {
        "subject_to": ["max_abs_u <= 30", "delay_margin_simulated >= 0.5"], "plants": 1, "trials": 288,
        "vary": {"controller[0].gamma": "0.1:100:log"},
    }  # fmt: skip
    found = []
    for text in (DRIVE, STEPPED):
        path = tmp_path / "drive.toml"
        path.write_text(text)
        found.append(tune(path, "rms_e", **options))
    ours, stepped = (one.controllers["MRAC"] for one in found)
    ((gamma, other),) = zip(ours.chosen.tuning.values(), stepped.chosen.tuning.values(), strict=True)
    assert gamma == pytest.approx(other, rel=0.02)  # the resolution of a search for the delay
    assert ours.chosen.value == pytest.approx(stepped.chosen.value, rel=0.02)
    assert gamma < 50
    assert "tolerance = 1e-6" in found[0].text
    assert found[0].case.simulation.as_json() == GIVEN
    checked = ours.step.as_json()
    assert (checked["dt"], checked["tolerance"], checked["limits"]) == (None, 1e-6 / 32, None)
    assert "MRAC: 1/32 of the tolerance confirms it" in found[0].notes
    vary = {"simulation.t_end": "2:4", "controller[0].gamma": "1:10"}
    path.write_text(DRIVE)
    said = refusal(lambda: tune(path, "rms_e", vary=vary, controller="MRAC", plants=1))
    assert said.startswith("numbers of the simulation cannot be tuned together with simulation.tolerance")


def test_margins_are_those_of_much_finer_steps() -> None:
    found = delay_margins(CASE.problem, MRAC, CASE.simulation, scan=6)["MRAC"]
    finer = delay_margins(CASE.problem, MRAC, Simulation(4.0, 2e-5), scan=6)["MRAC"]
    assert found.loss.loses[0] < np.inf
    assert found.loss.tolerates == pytest.approx(finer.loss.tolerates, rel=0.04)  # twice the resolution
    assert found.onset.tolerates == pytest.approx(finer.onset.tolerates, rel=0.04)


def test_the_trade_off_is_that_of_fine_steps() -> None:
    knobs = (TuningGrid(scheme="MRAC", values={"gamma": np.array([1.0, 10.0, 100.0])}, make=lambda gamma: Mrac(gamma=gamma)),)
    ours, stepped = (trade_off(CASE.problem, one, knobs=knobs, plants=2) for one in (CASE.simulation, FINE))
    assert ours.simulation.as_json() == GIVEN
    assert ours.clouds[0].error == pytest.approx(stepped.clouds[0].error, rel=1e-4)
    assert ours.clouds[0].loss == pytest.approx(stepped.clouds[0].loss, rel=0.04)
    (check,) = ours.checks
    assert check.tunings
    assert (check.as_json()["dt"], check.as_json()["tolerance"]) == (None, 1e-6 / 32)
    assert " at a tolerance of 3.125e-08 changes " in check.sentence


def test_what_stands_for_a_step() -> None:
    """The resolution grows with the steps that the case's own run takes."""
    slow, fast = (resolved(CASE.problem, [replace(MRAC, gamma=g)], CASE.simulation) for g in (1.0, 1e9))
    assert slow.resolution == 4.0 / 20_000
    assert fast.resolution < slow.resolution / 2
    assert resolved(CASE.problem, [MRAC], FINE) is FINE
    assert refined(slow).tolerance == 1e-6 / 32
    assert shortest_delay(slow) == "0.0004 s, the shortest that is tried"
    assert shortest_delay(FINE) == "two solver steps, 0.0008 s"


def test_a_delay_below_the_resolution_is_no_delay_that_is_tried() -> None:
    said = refusal(lambda: tune(CASE, "rms_e", subject_to=["delay_margin_measured >= 1e-5"], plants=1))
    assert "is shorter than the shortest that can be simulated, 0.0004 s" in said


def test_the_verdict_on_a_run_that_stalls_is_that_of_a_lost_one() -> None:
    simulation = Simulation(4.0, tolerance=1e-6)
    problem = load_case("paper").problem
    assert verdict_of(problem, Relay(2.0), simulation, Judge()).kind is Class.LOST
    (run,) = simulate(problem, Relay(0.0), simulation).values()
    assert str(verdict_of(problem, Relay(0.0), simulation, Judge())) == str(run.verdict)
    found = Verdicts.run([(problem, Relay(size)) for size in (0.0, 2.0)], simulation, Judge())
    assert found.lost.tolist() == [False, True]
