"""The compiled export replaces its controller in the loop: the run is the same bit for bit, and differs if the export differs."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from barbalat import Mrac, Sampled, Simulation, simulate
from barbalat.cases.load import bundled
from barbalat.cli import main
from barbalat.commands.run import show_exported
from barbalat.export import in_the_loop
from barbalat.export.in_the_loop import simulate_export
from barbalat.plants import Dropout, PlantInput, Shell
from barbalat.run.engine.simulate import with_missed_samples
from barbalat.signals import Step
from export.examples import SIMULATION, STATE, T, sampled_examples
from export.targets import needs_gcc
from independent import refusal

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}
CHOSEN = list(EXAMPLES)[::19]
pytestmark = needs_gcc


@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name: name in CHOSEN[:2])
def test_the_same_run_in_every_bit(name) -> None:
    problem, controller = EXAMPLES[name]
    origin = simulate(problem, [controller], SIMULATION)[controller.name]
    found = simulate_export(problem, controller, SIMULATION)
    assert found.refused == 0
    assert found.differs_from(origin) == ""
    assert found.result.figures == origin.figures


def test_another_bit_in_the_c_is_another_run(monkeypatch) -> None:
    """An export that differs is detected, so the control in the loop really comes from C."""
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    origin = simulate(STATE, [controller], SIMULATION)[controller.name]
    right = in_the_loop.source

    def wrong(printed):
        text = right(printed)
        line = next(line for line in text.splitlines() if line.startswith("    c->held_u[0] = t"))
        return text.replace(line, line.replace(";", " * (1 + 0x1p-52);"), 1)

    monkeypatch.setattr(in_the_loop, "source", wrong)
    found = simulate_export(STATE, controller, SIMULATION)
    assert found.differs_from(origin).startswith("the states differ from t = ")
    assert found.result.metrics.max_abs_u != pytest.approx(origin.metrics.max_abs_u, rel=0, abs=0)


def test_float32_parts_from_float64_and_stays_near() -> None:
    """The tolerance 2e-3 is for 1000 samples of a stable loop with numbers of size 3, a rounding of 6e-8 and a gain of 5."""
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    simulation = Simulation(t_end=10.0, dt=T / 2)
    origin = simulate(STATE, [controller], simulation)[controller.name]
    found = simulate_export(STATE, controller, simulation, float32=True)
    assert found.differs_from(origin)
    assert abs(found.result.x - origin.x).max() < 2e-3


LATE = replace(STATE, reference=Step(amplitude=5e6, start=12.0), plant=replace(STATE.plant, input=PlantInput(delay=0.007)))
ESCAPES = replace(LATE, plant=replace(LATE.plant, theta=[3.0, 40.0]), uncertainty=None, reference=Step(amplitude=1.0, start=11.0))
MISSES = Shell(longest_outage=0.05, fallback="zero", fade=0.1)


@pytest.mark.parametrize(
    ("problem", "controller"),
    [
        (LATE, Mrac(gamma=1e-9)),
        (replace(LATE, shell=MISSES, faults=[Dropout(channel="x_1", share=0.2, burst=0.1)]), Mrac(gamma=1e-9)),
        (replace(ESCAPES, plant=replace(ESCAPES.plant, x0=[0.0, 0.0]), sensor=None), Mrac(gamma=1e-9)),
    ],
    ids=["late command", "and outages", "diverges"],
)
def test_nothing_is_refused_that_comes_after_the_test_vectors(problem, controller) -> None:
    """Each signal exceeds the smallest range, 10^6, after the 1000 samples that the self-test replays, at t = 10 s."""
    controller, simulation = Sampled(controller=controller, sample_time=T), Simulation(t_end=20.0 + T / 2, dt=T / 2)
    run = simulate(problem, [controller], simulation)[controller.name]
    assert abs(run.x[run.t < 10]).max() < 1e5 < 1e-1 * abs(run.x).max()
    missed = with_missed_samples({controller.name: run})[controller.name].missed
    found = simulate_export(problem, controller, simulation)
    assert found.differs_from(run) == ""
    assert found.refused == (0 if missed is None else missed.missed)


def test_what_is_counted_is_said(capsys) -> None:
    """Samples at which a measurement or a command was lost. There are more of them than missed samples, which have no good
    measurement."""
    faults = (Dropout(channel="x_1", share=0.1), Dropout(channel="command", share=0.2))
    problem, controller = replace(STATE, faults=faults), Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    simulation = Simulation(t_end=3.0 + T / 2, dt=T / 2)
    run = with_missed_samples(simulate(problem, [controller], simulation))[controller.name]
    found = simulate_export(problem, controller, simulation).refused
    assert max(run.missed.missed, run.missed.commands) < found < run.missed.missed + run.missed.commands
    show_exported({controller.name: {"equal": True, "refused": found, "difference": ""}})
    told = f"bit for bit; a measurement, a command or a result was lost or rejected at {found} samples"
    assert told in " ".join(capsys.readouterr().out.split())


def test_command(tmp_path, capsys, monkeypatch) -> None:
    asked = ["run", "first-order", "--sil", "--no-plots", "--json"]
    assert main(asked) == 0
    found = json.loads(capsys.readouterr().out)["software_in_the_loop"]
    assert found == {"MRAC, sampled": {"equal": True, "refused": 0, "difference": ""}}
    assert main(["run", "paper", "--sil", "--out", str(tmp_path / "none")]) == 2
    assert "sample_time" in capsys.readouterr().err
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([*asked, "--out", str(tmp_path / "none")]) == 2
    assert "install a C compiler" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert "C compiler" in refusal(lambda: simulate_export(STATE, Mrac(gamma=1.0), SIMULATION))


def test_a_controller_that_cannot_be_compared_is_a_failure(tmp_path, capsys) -> None:
    case = tmp_path / "case.toml"
    case.write_text(
        f"{bundled()['first-order'].read_text('utf-8')}\n[shell]\nrange = {{ x_1 = [-1e-6, 1e-6] }}\n", encoding="utf-8"
    )
    assert main(["run", str(case), "--sil", "--no-plots", "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)["software_in_the_loop"].values()
    assert found["equal"] is None and "shell.range.x_1 rejects the case's fault-free run" in found["difference"]
    show_exported({"MRAC": found})
    assert "MRAC: not compared: shell.range.x_1" in " ".join(capsys.readouterr().out.split())
