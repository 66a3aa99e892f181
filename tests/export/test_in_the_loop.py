"""The compiled export replaces its controller in the loop: the run is the same bit for bit, and differs if the export differs."""

from __future__ import annotations

import json

import pytest

from barbalat import Mrac, Sampled, Simulation, simulate
from barbalat.cli import main
from barbalat.export import in_the_loop
from barbalat.export.in_the_loop import simulate_export
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
    """An export that differs is detected: the control in the loop really comes from C."""
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
    """2e-3: 1000 samples of a loop that forgets, in numbers with a rounding of 6e-8, of a size of 3, at a gain of 5."""
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    simulation = Simulation(t_end=10.0, dt=T / 2)
    origin = simulate(STATE, [controller], simulation)[controller.name]
    found = simulate_export(STATE, controller, simulation, float32=True)
    assert found.differs_from(origin)
    assert abs(found.result.x - origin.x).max() < 2e-3


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
