"""The fixed steps of contests and pages of cases with a tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Simulation, load_case, simulate
from barbalat.cases.load import parse_case
from barbalat.controllers.sampled import Sampled
from barbalat.explorer.explorer import explore
from barbalat.problem.actuation import PlantInput
from barbalat.problem.faults import Jitter
from barbalat.problem.measurement import Noise, Sensor
from barbalat.studies import contest
from barbalat.study import fixed_steps as module
from barbalat.study.fixed_steps import fixed_steps
from case_texts import DRIVE
from independent import refusal

PAPER = load_case("paper")
MRAC, L1 = (next(c for c in PAPER.controllers if c.name == name) for name in ("MRAC", "L1"))
SLOW = replace(MRAC, gamma=1.0)


def test_steps_of_a_case_are_its_own() -> None:
    simulation = Simulation(2.0, 1e-3)
    found = fixed_steps(PAPER.problem, [MRAC], simulation)
    assert found.simulation is simulation
    assert found.sentence is None


def test_a_fast_law_takes_shorter_steps_until_its_figures_agree(monkeypatch) -> None:
    monkeypatch.setattr(module, "FEWEST_STEPS", 200)
    simulation, fast = Simulation(2.0, tolerance=1e-6), replace(L1, gamma=1e4)
    assert "rk4 with h = 0.002 s" in fixed_steps(PAPER.problem, [SLOW], simulation).sentence
    dt = fixed_steps(PAPER.problem, [fast], simulation).simulation.dt
    assert dt < 0.002
    exact, agreeing, coarser = (
        simulate(PAPER.problem, fast, one)["L1"].figures for one in (simulation, Simulation(2.0, dt), Simulation(2.0, 2 * dt))
    )
    names = ("max_abs_u", "max_abs_e", "rms_e")
    for found, least, most in ((agreeing, 0.0, 0.01), (coarser, 0.01, np.inf)):
        errors = [np.abs(np.array(found[name], dtype=float) / np.array(exact[name]) - 1).max() for name in names]
        assert least <= max(errors) <= most


def test_samples_noise_and_delays_are_whole_steps() -> None:
    plant = replace(PAPER.problem.plant, input=PlantInput(delay=5e-5))
    noisy = replace(PAPER.problem, sensor=Sensor(noise=Noise(std=0.01, sample_time=0.012)))
    for problem, controller in ((noisy, Sampled(SLOW, 0.02)), (replace(PAPER.problem, plant=plant), SLOW)):
        dt = fixed_steps(problem, [controller], Simulation(2.0, tolerance=1e-5)).simulation.dt
        assert dt <= 1e-4
        assert np.abs(np.array([2.0, 0.02, 0.012]) / dt % 1 - 0.5).min() == pytest.approx(0.5)
        assert problem.delay == 0 or dt <= problem.delay


def test_a_divergence_is_one_with_fixed_steps_too() -> None:
    case = load_case("rohrs")
    classical = next(c for c in case.controllers if c.name == "Classical")
    found = fixed_steps(case.problem, [classical], Simulation(30.0, tolerance=1e-6)).simulation
    ours, fixed = (simulate(case.problem, classical, one)["Classical"] for one in (Simulation(30.0, tolerance=1e-6), found))
    assert fixed.diverged_at == pytest.approx(ours.diverged_at, rel=0.01)


def test_refusals(monkeypatch) -> None:
    simulation = Simulation(2.0, tolerance=1e-6)
    jittery = replace(PAPER.problem, faults=(Jitter(time=0.001),))
    assert "for samples with jitter: give simulation.dt" in refusal(
        lambda: fixed_steps(jittery, [Sampled(SLOW, 0.01)], simulation)
    )
    monkeypatch.setattr(module, "AGREES", 1e-15)
    monkeypatch.setattr(module, "MOST_STEPS", 50_000)
    said = refusal(lambda: fixed_steps(PAPER.problem, [SLOW], simulation))
    assert "even with 5e+04 fixed steps" in said
    assert said.endswith("Give simulation.dt")


@pytest.mark.full
def test_a_contest_of_a_case_with_a_tolerance_is_one_with_those_steps(monkeypatch) -> None:
    monkeypatch.setattr(module, "FEWEST_STEPS", 1000)
    options = {"schemes": ["mrac"], "plants": 1, "trials": 288, "members": 8}
    case = parse_case(DRIVE, "drive.toml")
    found = contest(case, **options)
    stepped = contest(replace(case, simulation=Simulation(4.0, 4e-3)), **options)
    assert found.notes[0].startswith("runs here use fixed steps, rk4 with h = 0.004 s")
    assert found.notes[0].endswith("simulation.tolerance = 1e-06; each chosen tuning is repeated at that tolerance")
    confirmed = [note.replace("a step 4 times smaller", "a tolerance of 1e-06") for note in stepped.notes]
    assert "MRAC: a tolerance of 1e-06 confirms it" in confirmed and list(found.notes[1:]) == confirmed
    (one,) = found.entrants
    assert one.step.as_json()["tolerance"] == 1e-6 and one.step.value == pytest.approx(
        one.error, rel=1e-3
    )  # a mean over 1001 instants
    for name in stepped.held_out:
        assert found.held_out[name].error.tolist() == stepped.held_out[name].error.tolist()


def test_a_page_made_in_python_has_the_steps_of_the_case_with_a_tolerance() -> None:
    case = parse_case(DRIVE)
    page = explore(case.problem, case.controllers, case.simulation)
    steps = fixed_steps(case.problem, case.controllers, case.simulation).simulation
    assert page.at({}).simulation == replace(steps, fused=False)
