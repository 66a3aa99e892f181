"""User-defined laws whose estimates are not the problem's parameters: every command accepts them and states what is unknown about
them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import foreign_estimates
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.cli import main
from barbalat.comparison.tradeoff.tradeoff import trade_off
from barbalat.controllers import Sampled
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.explorer.explorer import explore
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.regressors import Polynomial
from barbalat.roles import Role
from barbalat.run.engine.check_numerics import check_numerics
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.estimates import estimates_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins
from case_texts import OWN
from export.made import files, units
from foreign_estimates import CONTROLLERS, HighOrder, Predicting, Sliding, Weighing
from independent import refusal

LAWS = Path(foreign_estimates.__file__)
SIMULATION = Simulation(t_end=2.0, dt=1e-2)
NAMES = [law.name for law in CONTROLLERS]
SAMPLED = [Sampled(controller=law, sample_time=0.02, discretization="euler") for law in CONTROLLERS]
COMPARED = {"high order": True, "predicting": True, "weighing": False, "sliding": False}
"""Whether a law's estimates are as many as the two parameters of the linear problem."""


@pytest.fixture
def linear(problems):
    """As many states as parameters, with a known set."""
    return replace(problems[2], uncertainty=ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]))


@pytest.fixture
def polynomial(problems):
    """Five parameters of two states."""
    plant = replace(problems[2].plant, theta=[0.5, 0.3, 0.2, 0.1, 0.1], regressor=Polynomial(degree=2))
    return replace(problems[2], plant=plant, uncertainty=None)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "case.toml").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("law", [*CONTROLLERS, *SAMPLED], ids=lambda law: f"{law.name} {type(law).__name__}")
def test_a_run_compares_what_can_be_compared(linear, law):
    """There are true values if there are as many estimates as parameters. Otherwise there are none, and one sentence says so."""
    (run,) = simulate(linear, [law], SIMULATION).values()
    count, known = run.theta_hat.shape[1], COMPARED[law.name]
    assert np.isfinite(run.states).all()
    assert [one.true for one in estimates_of(run)] == (linear.plant.theta.tolist() if known else [None] * count)
    assert any("no true values" in warning for warning in run.warnings) == (count == 16)
    if count == 16:
        assert run.adapting.on_bounds is None  # its ``box`` belongs to two other numbers
    if count == 0:
        assert run.adapting is None


@pytest.mark.parametrize("law", CONTROLLERS, ids=NAMES)
def test_more_parameters_than_states(polynomial, law):
    (run,) = simulate(polynomial, [law], SIMULATION).values()
    assert {one.true for one in estimates_of(run)} <= {None}
    said = [warning for warning in run.warnings if "no true values" in warning]
    assert len(said) == (run.theta_hat.shape[1] > 0) and all("5 parameters" in warning for warning in said)


@pytest.mark.parametrize("law", [*CONTROLLERS, *SAMPLED], ids=lambda law: f"{law.name} {type(law).__name__}")
def test_what_a_run_hands_on(linear, law):
    run = simulate(linear, [law], SIMULATION)
    result, count = run[law.name], run[law.name].theta_hat.shape[1]
    assert sum(name.startswith("theta_hat_") for name in result.columns()) == count
    assert result.to_xarray()["theta_hat"].shape == (len(result.t), count)
    assert len(result.to_pandas().columns) == len(result.columns())
    assert result.name in repr(result) and "max |e|" in result._repr_html_()
    assert result.plot().axes and result.to_control().nstates == 4
    assert check_numerics(run).keys() == run.keys()


@pytest.mark.parametrize("law", [*CONTROLLERS, *SAMPLED], ids=lambda law: f"{law.name} {type(law).__name__}")
def test_certificates(linear, polynomial, law):
    for problem in (linear, polynomial):
        found = certify(problem, [law], SIMULATION)
        assert not found[law.name].guaranteed
        assert len(table_1(problem, [law], found).columns) == 1


def test_ensembles_in_which_the_plant_starts_elsewhere(linear):
    """Predicting's initial state accepts only floats, so the plant's x0 can't be a symbol there. Each member equals its single
    run."""
    others = [replace(linear, plant=replace(linear.plant, x0=[value, 0.0])) for value in (0.0, 0.5)]
    for law in (*CONTROLLERS, *SAMPLED):
        together = simulate_ensemble([(problem, law) for problem in others], SIMULATION).metrics.max_abs_e
        alone = np.array([simulate(problem, [law], SIMULATION)[law.name].metrics.max_abs_e[0] for problem in others])
        np.testing.assert_array_equal(together, alone)


def test_simulated_margins(linear):
    assert list(delay_margins(linear, CONTROLLERS, SIMULATION, scan=3, resolution=0.3)) == NAMES


@pytest.mark.full
def test_trade_offs(linear):
    makes = {"gamma": (HighOrder, Predicting, Weighing), "w": (Sliding,)}
    knobs = [
        TuningGrid(scheme=make.__name__, values={key: np.array([1.0, 10.0])}, make=make)
        for key, kinds in makes.items()
        for make in kinds
    ]
    assert len(trade_off(linear, SIMULATION, knobs=tuple(knobs), plants=2).clouds) == 4


@pytest.mark.parametrize("target", ["c99", "fmu2", "fmu3"])
@pytest.mark.parametrize("law", SAMPLED, ids=NAMES)
def test_exports(linear, law, target):
    """Only the sources are checked. The test of every export shows that the compiled C equals the simulation bit for bit."""
    if target == "c99":
        assert "controller.c" in files(linear, law, SIMULATION)
    else:
        assert units(linear, law, SIMULATION, version=int(target[-1]), compiled=False)


def test_a_page_of_sliders(linear):
    """True values and their lines appear if the numbers agree. Named estimates keep their names on the page."""
    (data,) = (explore(linear, CONTROLLERS, SIMULATION).contents.data["controllers"],)
    assert [one["name"] for one in data] == NAMES
    assert [one["true"] is not None for one in data] == [COMPARED[one["name"]] for one in data]
    assert [len(one["estimates"]) for one in data] == [2, 2, 16, 0]


@pytest.mark.dear
def test_every_command_takes_them(folder, capsys):
    def told(*arguments):
        assert main([arguments[0], "case.toml", "--controllers", str(LAWS), *arguments[1:]]) == 0, capsys.readouterr().err
        return capsys.readouterr().out

    runs = json.loads(told("run", "--json"))["controllers"]
    assert list(runs) == NAMES
    assert "16 estimates and the problem 2 parameters" in runs["weighing"]["adapting"]["warnings"][0]
    assert "16 estimates and the problem 2 parameters" in " ".join(told("run", "--out", "out", "--no-plots").split())
    assert list(json.loads(told("certify", "--json"))["controllers"]) == NAMES
    found = json.loads(told("sweep", "--sample", "plant.theta=known-set", "--members", "4", "--json"))
    assert list(found["shares"]["diverged"]) == NAMES
    found = json.loads(told("sweep", "--vary", "plant.x0[0]=0:1:3", "--json"))
    assert found["members"] == 3


@pytest.mark.full
def test_the_page_of_a_run(folder):
    assert main(["run", "case.toml", "--controllers", str(LAWS), "--out", "out"]) == 0
    page = (folder / "out" / "report.html").read_text()
    assert "16 estimates and the problem 2 parameters" in page and all(name in page for name in NAMES)


@pytest.mark.full
@pytest.mark.parametrize("scheme", ["HighOrder", "Predicting", "Weighing", "Sliding"])
def test_tuning(folder, capsys, scheme):
    knob = "w" if scheme == "Sliding" else "gamma"
    (folder / "laws.py").write_text(LAWS.read_text().replace("CONTROLLERS =", "MADE = lambda:"))
    (folder / "case.toml").write_text(OWN + f'[[controller]]\nscheme = "{scheme}"\n{knob} = 5.0\n')
    asked = ["--for", "rms_e", "--subject-to", "delay_onset_simulated >= 0.03", "--vary", f"controller[0].{knob}=1:20:log"]
    assert main(["tune", "case.toml", "--controllers", "laws.py", *asked, "--plants", "2", "--json"]) == 0, (
        capsys.readouterr().err
    )
    assert json.loads(capsys.readouterr().out)


def test_names_that_are_not_as_many_as_the_estimates(linear):
    class Misnamed(foreign_estimates.WeighingEquations):
        roles: ClassVar = {"theta_hat": Role.estimates("W", names=("W_1", "W_2"))}

    class Law:
        name = "misnamed"

        def bind(self, known):
            return Misnamed(**vars(Weighing(1.0).bind(known)))

    assert "a tuple of 16 strings" in refusal(lambda: simulate(linear, [Law()], SIMULATION))


def test_ideal_values_are_the_laws_own_to_know(linear):
    """Weights are not treated as parameters if the law says so, even if their numbers are equal."""

    class Other(HighOrder):
        def bind(self, known):
            return OtherEquations(**vars(super().bind(known)))

    class OtherEquations(foreign_estimates.HighOrderEquations):
        roles: ClassVar = {"theta_hat": Role.estimates("W")}

    (run,) = simulate(linear, [Other(5.0)], SIMULATION).values()
    assert [(one.name, one.true) for one in estimates_of(run)] == [("W_1", None), ("W_2", None)] and not run.warnings
