"""The exported C flies on both models, also at the actuators' limits. The results are identical to the simulated list's, or the
difference is reported."""

import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="the extra flight is not installed: ./dev flight installs it")
pytest.importorskip("mujoco", reason="the extra flight is not installed: ./dev flight installs it")

from barbalat import Mrac, Sampled, Simulation
from barbalat.cli import main
from barbalat.export import exported_step
from barbalat.exports import exported_c
from barbalat.flights import FlightCondition, fly
from barbalat.run.engine.simulate import recorded
from barbalat.run.kernel.sampled_controller import Agreement, SampledList
from barbalat.vehicles import flying
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Axis
from barbalat.vehicles.f16.failures import OF_PITCH
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.schemes import SCHEMES
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.isolated import SimulatorFailed
from barbalat.vehicles.quadrotor.axes import Axes
from barbalat.vehicles.quadrotor.body import Quadrotor
from barbalat.vehicles.quadrotor.failures import FAILURES as OF_QUADROTOR
from barbalat.vehicles.quadrotor.hover import hovering
from export.targets import needs_gcc
from independent import refusal
from vehicles.nominal import of_axis, on_axis, quadrotor_through, scheme_on

FAILURES = {one.name: one for one in OF_PITCH}
SHORT = Timing(duration=16.0, fails_at=10.0)
pytestmark = [pytest.mark.full, needs_gcc]  # ./dev flight runs them; each starts a simulator and a compiler


@pytest.fixture(scope="module")
def axis():
    return Axis(trim=trimmed(FlightCondition()))


@pytest.mark.parametrize("name", [name for name in SCHEMES if name != "hinf"])
def test_the_f16_flies_the_same_flight_in_every_bit(axis, name):
    """During the hard-over the surface is at its limit and the command is beyond it, so integrals wind up and estimates reach
    their bounds."""
    problem, controller = of_axis(axis, name)
    by_list = fly_once(axis, SampledList.of(problem, controller).step(), FAILURES["hard-over"], timing=SHORT)
    by_c = fly_once(axis, exported_c(problem, controller).step(), FAILURES["hard-over"], timing=SHORT)
    assert by_c.record.tobytes() == by_list.record.tobytes()
    assert by_c.lost == by_list.lost
    assert by_list.agreement is None
    assert by_c.agreement == Agreement(samples=len(by_list.record))
    assert np.abs(by_c.column("elevator")).max() == pytest.approx(axis.equipment.limit)
    assert np.abs(by_c.column("elevator_command")).max() > axis.equipment.limit or name == "lqr"


def test_an_estimate_that_ends_at_its_bound_does_so_in_the_c(axis):
    """The hard-over drives an estimate to its bound, with a gain that is not tuned."""
    problem = axis.adaptive_problem
    controller = Sampled(Mrac(gamma=1.0, theta_hat0=axis.nominal), SAMPLE_TIME)
    by_list, by_c = SampledList.of(problem, controller).step(), exported_c(problem, controller).step()
    assert fly_once(axis, by_c, FAILURES["hard-over"], timing=SHORT).agreement == Agreement(samples=1600)
    fly_once(axis, by_list, FAILURES["hard-over"], timing=SHORT)
    bounds = problem.uncertainty
    assert ((by_list.estimates == bounds.lower) | (by_list.estimates == bounds.upper)).any()


@pytest.mark.parametrize("name", ["l1-piecewise", "robust-mrac"])
def test_the_quadrotor_flies_the_same_flight_in_every_bit(name):
    """Some laws are reset at the start and some are not. The list can continue from its previous flight, but the C can't."""
    short = Timing(duration=3.0, fails_at=2.5)
    axes = Axes(hover=hovering(Quadrotor()))
    failures = [OF_QUADROTOR["none"], OF_QUADROTOR["no-reset"]]
    by_list = quadrotor_through(axes, scheme_on(axes, name), failures, short)
    by_c = quadrotor_through(axes, scheme_on(axes, name, exported_c), failures, short)
    for a, b in zip(by_list, by_c, strict=True):
        assert a.record.tobytes() == b.record.tobytes()
        assert b.agreement == Agreement(samples=3 * 1200 + 3 * 300)  # 400 Hz and 100 Hz
    assert by_c[0].record.tobytes() != by_c[1].record.tobytes()


def test_what_an_axis_of_a_model_exports_has_test_vectors_that_move(axis):
    """The exported problem has a command or a disturbance. From zeros every wrong controller would compute the same zeros."""
    axes = Axes(hover=hovering(Quadrotor()))
    pairs = [of_axis(axis, "l1"), *(on_axis("l1", one) for one in (axes.attitude[0], axes.position[0]))]
    for problem, controller in pairs:
        T = controller.sample_time
        states = recorded(problem, controller, Simulation(t_end=200 * T, dt=T), 200).states
        assert len(np.unique(states[-50:], axis=0)) == 50


def test_of_a_vehicle_that_flies_otherwise_the_axis_is_named(monkeypatch):
    axes = Axes(hover=hovering(Quadrotor()))
    scheme = scheme_on(axes, "geometric-integral")
    with monkeypatch.context() as patch:
        patch.setattr(exported_step, "source", with_another_bit(exported_step.source))
        wrong = exported_c(*on_axis("geometric-integral", axes.attitude[1]))
    scheme = replace(scheme, loops=(scheme.loops[0], wrong, *scheme.loops[2:]))
    (found,) = quadrotor_through(axes, scheme, [OF_QUADROTOR["no-reset"]], Timing(duration=1.0, fails_at=1.0))
    assert (found.agreement.flights, found.agreement.samples) == (1, 400)
    assert found.agreement.difference.startswith("pitch: held_u[0] differs from sample ")


def test_the_command_says_so_everywhere(tmp_path, capsys):
    arguments = ["fly", "f16-roll", "--schemes", "lqr,l1-piecewise", "--failure", "hard-over", "--sil"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    sentence = (
        "the exported C of every controller was compiled on this machine and flown: u and the state are bit-identical to those "
        "of the simulation at all 6,000 samples of 2 flights"
    )
    assert sentence in said
    page = html.unescape(re.sub("<[^>]+>", "", (tmp_path / "report.html").read_text()))
    assert sentence in " ".join(page.split())
    document = json.loads((tmp_path / "fly.json").read_text())
    equal = {"equal": True, "flights": 1, "samples": 3000, "refused": 0, "difference": ""}
    assert document["software_in_the_loop"] == {"LQR": equal, "L1 piecewise": equal}


def with_another_bit(right):
    """The source with a control that differs in its last bit."""

    def wrong(printed):
        text = right(printed)
        line = next(line for line in text.splitlines() if line.startswith("    c->held_u[0] = t"))
        return text.replace(line, line.replace(";", " * (1 + 0x1p-52);"), 1)

    return wrong


def test_a_bit_that_differs_is_the_exit_code(capsys, monkeypatch):
    monkeypatch.setattr(exported_step, "source", with_another_bit(exported_step.source))
    assert main(["fly", "f16-pitch", "--schemes", "lqr", "--failure", "none", "--sil", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["software_in_the_loop"]["LQR"]
    assert found["equal"] is False
    assert found["difference"].startswith("held_u[0] differs from sample ")


def test_of_a_flight_that_breaks_nothing_is_claimed(monkeypatch):
    real = flying.isolated

    def breaking(seconds, function, *given):
        if function is flying.flown and any(failure.name == "gusts" for failure in given[3]):
            raise SimulatorFailed("the simulator's process ended by signal 11")
        return real(seconds, function, *given)

    monkeypatch.setattr(flying, "isolated", breaking)
    found = fly(schemes=["lqr"], failures=["none", "gusts"], software_in_the_loop=exported_c)
    assert found.agreements == {"LQR": Agreement(flights=1, samples=3000)}


def test_what_makes_it_fly_is_no_switch():
    assert "exported_c, got True" in refusal(lambda: fly(software_in_the_loop=True))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["f16-pitch", "--dispersions", "2", "--sil"], "--sil cannot be combined with --dispersions"),
        (["f16-pitch", "--schemes", "lqr", "--sil", "--controllers", "own.py"], "own is continuous"),
    ],
)
def test_bad_input_is_one_sentence(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text("from barbalat import Mrac\nCONTROLLERS = [Mrac(gamma=1, name='own')]\n")
    assert main(["fly", *arguments]) == 2
    out, said = capsys.readouterr()
    assert out == ""
    assert sentence in said
    assert said.count("\n") == 1
