"""User-defined laws that declare their state by roles, without a field theta_hat. Every command accepts them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import strangers
from barbalat import Sampled, simulate
from barbalat.certificates.certify import certify
from barbalat.cli import main
from barbalat.comparison.starts import initial_estimates
from barbalat.interfaces import Role
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.known_set import ParameterBox
from barbalat.roles import column_names, roles_of, state_parts, within
from barbalat.run.results.estimates import estimates_of
from barbalat.solvers.simulation import Simulation
from case_texts import OWN
from export.made import files, units
from foreign import wrong
from independent import refusal
from strangers import CONTROLLERS, NoEstimate, Sixteen, TwoLayers

FILE = Path(strangers.__file__)
SIMULATION = Simulation(t_end=2.0, dt=1e-2)
NAMES = [law.name for law in CONTROLLERS]
SAMPLED = [Sampled(controller=law, sample_time=0.02, discretization="euler") for law in CONTROLLERS]


@pytest.fixture
def linear(problems):
    return replace(problems[2], uncertainty=ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]))


@pytest.fixture
def told(tmp_path, monkeypatch, capsys):
    """The output of a command for a case with the three laws or with the laws of a different file."""
    (tmp_path / "case.toml").write_text(OWN)
    monkeypatch.chdir(tmp_path)

    def run(*arguments, controllers=FILE):
        assert main([arguments[0], "case.toml", "--controllers", str(controllers), *arguments[1:]]) == 0, capsys.readouterr().err
        return capsys.readouterr().out

    return run


@pytest.mark.parametrize("laws", [CONTROLLERS, SAMPLED], ids=["continuous", "sampled"])
def test_results_follow_the_roles(linear, laws):
    """The first layer is theta_hat, and a second layer has separate columns. True values are the ones declared by a role."""
    sixteen, layers, none = (simulate(linear, laws, SIMULATION)[name] for name in NAMES)
    theta = linear.plant.theta.tolist()
    assert [sixteen.theta_hat.shape[1], layers.theta_hat.shape[1], none.theta_hat.shape[1]] == [16, 2, 0]
    assert [one.name for one in estimates_of(sixteen)][:2] == ["W_1", "W_2"] and sixteen.true_values is None
    assert [(one.name, one.true) for one in estimates_of(layers)] == [*zip(("k_1", "k_2", "h_1", "h_2"), theta * 2, strict=True)]
    assert layers.figures["ahead_final"] == layers.states[-1, layers.loop.other_estimates[0].rows].tolist()
    assert none.figures["theta_hat_final"] == [] and none.adapting is None and not estimates_of(none)
    assert not any("no true values" in warning for run in (sixteen, layers) for warning in run.warnings)


def test_columns_hold_the_whole_state(linear):
    """Each entry of the controller's state appears once with a descriptive name, also in pandas and xarray."""
    (run,) = simulate(linear, [TwoLayers()], SIMULATION).values()
    own = ["theta_hat_1", "theta_hat_2", "ahead_1", "ahead_2", "P_1_1", "P_1_2", "P_2_1", "P_2_2", "x_hat_1", "x_hat_2"]
    columns = run.columns()
    assert set(own) <= set(columns)
    state = run.loop.unpack(run.states[-1]).controller
    assert [columns[name][-1] for name in own] == np.concatenate([np.ravel(part) for part in state]).tolist()
    assert list(run.to_pandas().columns) == list(columns)
    np.testing.assert_array_equal(run.to_xarray()["P"], run.controller_states["P"])
    assert run.controller_states["P"].shape == (len(run.t), 2, 2)
    assert run.column_meanings()["P_1_2"] == "covariance of the second layer"
    (none,) = simulate(linear, [NoEstimate()], SIMULATION).values()
    assert "z_1" in none.columns()


def test_names_of_columns_are_nobody_elses():
    """A field named like a signal, and two parts with the same last name, get longer names."""
    one, two = (state_parts(object(), strangers.Lead(np.zeros(1)))[0]._replace(path=path) for path in ("a.x", "b.x"))
    assert list(column_names([one, two], {"x"}).values()) == ["a_x", "b_x"]
    assert list(column_names([one._replace(path="x")], {"x"}).values()) == ["controller_x"]


def test_what_diverges_is_the_first_layer(linear):
    """Diverging weights make a run diverge, as for theta_hat."""
    wild = Sixteen(gamma=-1e4)
    assert simulate(linear, [wild], Simulation(t_end=20.0, dt=1e-2))["sixteen"].diverged_at is not None


def test_a_freeze_keeps_every_layer_and_the_memory(linear):
    """The predictor continues, also in sampled controllers."""
    loop = ClosedLoop.of(linear, SAMPLED[1])
    start = loop.computer.initial(np.array([0.3, -0.2]))
    moved = loop.computer.act(start, np.array([0.5, 0.1]), np.array(1.0))
    after = loop.computer.act(moved, np.array([0.7, 0.4]), np.array(0.5), np.ones(()))
    for name in ("k_hat", "ahead", "covariance"):
        np.testing.assert_array_equal(getattr(after.controller, name), getattr(moved.controller, name))
    assert not np.array_equal(after.controller.x_hat, moved.controller.x_hat)


def test_a_margin_tells_where_the_loop_rests(linear):
    """Under the largest command, every layer is at its true value if this is known, or else at the equilibrium found by Newton's
    method."""
    found = certify(linear, CONTROLLERS, SIMULATION)
    layers = found["two layers"].entry("delay_margin").rest
    assert [one.true for one in layers.estimates] == [True, True] and layers.where == "k_hat = k, h_hat = h"
    assert layers.estimates[0].values == tuple(linear.plant.theta)
    assert found["no estimate"].entry("delay_margin").rest.estimates == ()
    document = found["two layers"].entry("delay_margin").as_json()["rest"]
    assert document["command"] == [linear.reference.bound]
    assert document["estimates"][1] | {"values": []} == {"name": "ahead", "of": "h", "values": [], "true": True}
    sixteen = found["sixteen"].entry("delay_margin")
    assert not sixteen.applies or sixteen.rest.where.startswith("|W_hat| = ")


@pytest.mark.parametrize("target", ["c99", "fmu3"])
@pytest.mark.parametrize("law", SAMPLED, ids=NAMES)
def test_exports_comment_by_roles(linear, law, target):
    if target == "fmu3":
        assert units(linear, law, SIMULATION, version=3, compiled=False)
        return
    header = files(linear, law, SIMULATION)["controller.h"]
    expected = {
        "sixteen": ["W_hat[16]; /* weights of the network */", "low[1]; /* filtered error */", "theta_hat[SIXTEEN_ESTIMATES]"],
        "two layers": ["covariance[4]; /* 2 x 2: covariance of the second layer */", "k_hat[2]; /* estimates of k */"],
        "no estimate": ["z[1]; /* of the state of the scheme */"],
    }[law.name]
    assert all(text.lower() in header.lower() for text in expected), header
    assert ("theta_hat[" in header) == (law.name != "no estimate")


def test_contests_start_where_the_first_layer_does(linear):
    assert [len(initial_estimates(linear, law)) for law in CONTROLLERS] == [16, 2, 0]


@pytest.mark.parametrize(
    ("roles", "words"),
    [
        ({"theta": Role.estimates()}, "names 'theta', but PlainState does not have it; it has theta_hat"),
        ({"theta_hat": "estimate"}, "a mapping from the names of fields to roles"),
        ({"theta_hat": Role.estimates("W", names=("W_1",))}, "a tuple of 2 strings"),
        (["theta_hat"], "a mapping from the names of fields to roles"),
    ],
)
def test_roles_that_do_not_fit_are_refused(linear, roles, words):
    assert words in refusal(lambda: simulate(linear, [wrong(roles=roles)], SIMULATION))


def test_a_role_is_taken_by_its_kind():
    """A role is also taken in a declaration by equations, and in one by a law with its own memory."""
    kinds = {"theta_hat": "estimates", "memory": "memory", "z": "predictor", "f": "filter", "g": "other"}
    roles = {path: getattr(Role, kind)() for path, kind in kinds.items()}
    by_name, by_role = (SimpleNamespace(roles=found) for found in (kinds, roles))
    for found in (roles_of, lambda one: within("law", one)):
        assert {path: vars(role) for path, role in found(by_name).items()} == {
            p: vars(role) for p, role in found(by_role).items()
        }


@pytest.mark.dear
def test_every_command_takes_them(told):
    runs = json.loads(told("run", "--json"))["controllers"]
    assert [len(runs[name]["theta_hat_final"]) for name in NAMES] == [16, 2, 0] and len(runs["two layers"]["ahead_final"]) == 2
    told("run", "--out", "out", "--no-plots")
    head = Path("out/2-two-layers.csv").read_text().partition("\n")[0]
    assert "P_1_2" in head and "ahead_1" in head
    assert "covariance of the second layer" in Path("out/datapackage.json").read_text()
    certified = json.loads(told("certify", "--json"))["controllers"]
    assert list(certified) == NAMES and "rest" in next(
        e for e in certified["two layers"]["entries"] if e["key"] == "delay_margin"
    )
    assert "h_hat = h" in " ".join(told("certify").replace("\N{NO-BREAK SPACE}", " ").split())
    found = json.loads(told("sweep", "--sample", "plant.theta=known-set", "--members", "4", "--json"))
    assert list(found["shares"]["diverged"]) == NAMES
    told("explore", "--no-open")
    data = Path("explore.html").read_text()
    assert '"ahead"' in data


@pytest.mark.full
def test_studies_and_exports_take_them(told, capsys):
    schemes = json.loads(told("tradeoff", "--density", "2", "--plants", "1", "--json"))["schemes"]
    assert {"Sixteen", "TwoLayers", "NoEstimate"} <= set(schemes)
    contest = json.loads(told("contest", "--schemes", "mrac", "--members", "8", "--quick", "--json"))
    assert {"Sixteen", "TwoLayers", "NoEstimate"} <= set(json.dumps(contest).replace('"', " ").split())
    text = FILE.read_text().replace("CONTROLLERS =", "MADE = lambda:")
    Path("laws.py").write_text(text)
    sampled = 'sample_time = 0.02\ndiscretization = "euler"\n'
    for scheme, knob in (("Sixteen", "gamma"), ("TwoLayers", "beta"), ("NoEstimate", "k")):
        Path("case.toml").write_text(OWN + f'[[controller]]\nscheme = "{scheme}"\nname = "one"\n{knob} = 2.0\n')
        asked = ["--for", "rms_e", "--vary", f"controller[0].{knob}=1:4:log", "--plants", "2", "--json"]
        assert json.loads(told("tune", *asked, controllers="laws.py"))
        Path("case.toml").write_text(OWN + f'[[controller]]\nscheme = "{scheme}"\nname = "one"\n{knob} = 2.0\n{sampled}')
        for target in ("c99", "fmu3"):
            more = ["--sources-only"] if target == "fmu3" else []
            told("export", "--controller", "one", "--target", target, "--out", f"{scheme}-{target}", *more, controllers="laws.py")
        assert (Path(f"{scheme}-c99") / "controller.c").exists()
