"""Simulated delay margins and trade-offs against exact margins and brute force."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from barbalat.actuation import PlantInput
from barbalat.certify.loops import known_parameters
from barbalat.certify.margins import margins
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.ensemble import simulate_ensemble
from barbalat.grid import Simulation
from barbalat.linear import input_filter
from barbalat.measurement import Noise, Sensor
from barbalat.signals import Constant
from barbalat.study.delay_margin import Lost, delay_margins
from barbalat.study.tradeoff import Knobs, pareto_front, trade_off
from independent import refusal


@pytest.mark.parametrize("kappa", [0.0, 0.05])
def test_linear_loop_against_the_exact_margin(section_v, kappa):
    """Known theta, no command: below the exact margin the state decays, above it grows; 3 %: slowly near it."""
    problem = replace(section_v, reference=Constant(0.0))
    C = None if kappa == 0 else input_filter(kappa)
    controller = (
        Mrac(gamma=1e-60, theta_hat0=[4.0, -3.0]) if C is None else L1Adaptive(gamma=1e-60, filter=C, theta_hat0=[4.0, -3.0])
    )
    exact = margins(known_parameters(problem.plant, problem.plant.theta, None if C is None else C.realise())).delay
    found = delay_margins([(problem, controller)], Simulation(t_end=400.0, dt=2e-3), resolution=0.005)
    assert found.bears[0] < found.loses[0] < found.bears[0] * 1.01
    assert 0.97 * exact < found.bears[0] <= exact * 1.001


def test_delay_of_the_plant_is_beside_the_added_one(section_v):
    problem = replace(section_v, reference=Constant(0.0))
    delayed = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.1)))
    controller = Mrac(gamma=1e-60, theta_hat0=[4.0, -3.0])
    simulation = Simulation(t_end=100.0, dt=2e-3)
    alone, beside = (delay_margins([(p, controller)], simulation, resolution=0.005).bears[0] for p in (problem, delayed))
    assert beside == pytest.approx(alone - 0.1, abs=0.01 * alone)


def test_bracket_against_brute_force(section_v):
    """The reported pair really bears and loses, and no shorter delay of a dense grid loses; whatever the threads."""
    simulation, judge = Simulation(t_end=20.0, dt=1e-3), Lost(share=0.3)
    members = [(section_v, Mrac(gamma=gamma, name="c")) for gamma in (1e-3, 1e-1)]
    found = delay_margins(members, simulation, lost=judge, threads=1)
    again = delay_margins(members, simulation, lost=judge, threads=2)
    np.testing.assert_array_equal(found.bears, again.bears)
    base = found.undelayed.tail_max_abs_e.max(axis=1)
    for i, (problem, controller) in enumerate(members):
        grid = np.concatenate([np.geomspace(2e-3, found.bears[i], 12), [found.loses[i]]])
        delayed = [(replace(problem, plant=replace(problem.plant, input=PlantInput(delay=float(d)))), controller) for d in grid]
        metrics = simulate_ensemble(delayed, simulation).metrics
        # the model's motion: x_m = k_0 b r through A_m, its amplitude from the model's own simulation
        amplitude = np.full(len(grid), _motion(problem, simulation))
        lost = judge.judge(metrics, np.full(len(grid), base[i]), amplitude)
        assert lost[-1]
        assert not lost[-2]


def _motion(problem, simulation):
    from barbalat.simulation import simulate

    return float(np.abs(simulate(problem, [Mrac(gamma=1e-12)], replace(simulation, record_points=10**5))["MRAC"].x_m).max())


def test_a_margin_under_noise_does_not_depend_on_the_neighbours(section_v):
    """With noise as large as a fifth of the command: beside a member that is soon lost, beside one that is not, and alone."""
    noisy = replace(section_v, sensor=Sensor(noise=Noise(std=10.0, sample_time=0.01, seed=4)))
    soon = replace(noisy, plant=replace(noisy.plant, theta=[60.0, 60.0]))
    simulation, controller = Simulation(t_end=20.0, dt=1e-3), Mrac(gamma=1.0)
    beside = [
        delay_margins([(p, Mrac(gamma=0.01)), (noisy, controller)], simulation, resolution=0.005).bears[1] for p in (soon, noisy)
    ]
    alone, other = (
        delay_margins([(noisy, controller)], simulation, resolution=0.005, numbers=[number]).bears[0] for number in (1, 7)
    )
    assert beside == [alone, alone]
    assert other != alone  # another noise, or the seed would have no say


def test_a_run_that_is_lost_without_delay(section_v):
    found = delay_margins([(section_v, Mrac(gamma=1.0, projection=False))], Simulation(t_end=10.0, dt=0.5))
    assert found.bears[0] == 0
    assert found.loses[0] == 0


def test_refusals(section_v):
    member = [(section_v, Mrac(gamma=1.0))]
    simulation = Simulation(t_end=1.0, dt=0.01)
    assert "longest" in refusal(lambda: delay_margins(member, simulation, longest=0.01))
    assert "scan" in refusal(lambda: delay_margins(member, simulation, scan=1))
    assert "share" in refusal(lambda: Lost(share=0.0))
    assert "known set" in refusal(lambda: trade_off(replace(section_v, uncertainty=None), simulation))


def test_pareto_front_against_brute_force():
    random = np.random.default_rng(1)
    for _ in range(200):
        size = int(random.integers(1, 40))
        error, margin = random.integers(1, 12, size) / 4.0, random.integers(0, 12, size) / 4.0
        error[random.random(size) < 0.1] = np.nan
        front = pareto_front(error, margin)
        usable = [i for i in range(size) if np.isfinite(error[i]) and margin[i] > 0]
        best = {
            (error[i], margin[i])
            for i in usable
            if not any(
                error[j] <= error[i] and margin[j] >= margin[i] and (error[j], margin[j]) != (error[i], margin[i]) for j in usable
            )
        }
        assert {(error[i], margin[i]) for i in front} == best
        assert len(front) == len(best)
        assert (np.diff(margin[front]) > 0).all()


def test_trade_off_of_one_scheme_and_its_page(section_v, tmp_path):
    from barbalat.report import tradeoff, write

    knobs = (Knobs(scheme="MRAC", values={"gamma": np.array([1e-3, 1e-1])}, make=lambda gamma: Mrac(gamma=gamma)),)
    seen, said = [], []
    found = trade_off(
        section_v, Simulation(t_end=5.0, dt=1e-3), knobs=knobs, plants=3, estimate=said.append, progress=seen.append
    )
    assert len(said) == 1
    assert said[0] > 0
    assert seen[-1] == 1.0
    (cloud,) = found.clouds
    assert cloud.error.shape == cloud.margin.shape == (2, 3)
    np.testing.assert_array_equal(found.thetas[0], section_v.plant.theta)
    assert all(section_v.uncertainty.contains(theta) for theta in found.thetas)
    np.testing.assert_array_equal(cloud.at("worst")[1], cloud.margin.min(axis=1))
    document = json.loads(write.as_json(tradeoff.as_document(found)))
    assert document["schemes"]["MRAC"]["tunings"] == [{"gamma": 1e-3}, {"gamma": 1e-1}]
    page = write.write_tradeoff(tmp_path, found)
    assert "Tracking error against the delay" in page.read_text()
    assert (tmp_path / "tradeoff.svg").stat().st_size > 1000
