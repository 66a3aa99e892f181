"""Members in the lanes of one kernel: every member is identical to its single run, for any number of lanes and threads."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, Plant, Problem, ReferenceModel, Simulation, load_case, simulate, simulate_ensemble
from barbalat.controllers.sampled import Sampled
from barbalat.judge.settings import Judge
from barbalat.loop.packing import symbols
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.run.kernel import time_signals
from barbalat.signals import Sine, Square

PAPER = load_case("paper")
L1 = next(c for c in PAPER.controllers if c.name == "L1")
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=0.1)
NOISY = replace(PAPER.problem, sensor=Sensor(noise=Noise(std=0.01, sample_time=0.02, seed=3)))
GAMMAS = (0.02, 3.0, 0.1, 1.0, 0.3)
OF_STATES = ("max_abs_e", "tail_max_abs_e", "theta_hat_final", "theta_hat_tail_min", "theta_hat_tail_max")
"""Figures that contain neither a sum nor a signal."""


def limited(problem=PAPER.problem, **others):
    return replace(problem, plant=replace(problem.plant, input=PlantInput(**others)))


def with_gammas(problem, wrap=lambda c: c, controller=MRAC, gammas=GAMMAS):
    return [(problem, wrap(replace(controller, gamma=gamma))) for gamma in gammas]


SQUARE = replace(PAPER.problem, reference=Square(20.0, 0.37, phase=0.2))
KINDS = {
    "projection": (with_gammas(PAPER.problem, controller=L1, gammas=(1e3, 1e2, 3e2)), Simulation(1.0, tolerance=1e-6)),
    "jumps": (with_gammas(SQUARE), Simulation(2.0, tolerance=1e-8)),
    "long steps": (with_gammas(PAPER.problem), Simulation(2.0, tolerance=1e-3)),
    "samples": (with_gammas(PAPER.problem, lambda c: Sampled(c, 0.03)), Simulation(2.0, tolerance=1e-6)),
    "noise": (with_gammas(NOISY, lambda c: Sampled(c, 0.01)), Simulation(1.0, tolerance=1e-6)),
    "rate limit": (with_gammas(limited(SQUARE, saturation=[-60.0, 60.0], rate_limit=300.0)), Simulation(2.0, tolerance=1e-6)),
    "delays": (
        [(limited(delay=delay, history=0.5), MRAC) for delay in (0.011, 0.02, 0.005)], Simulation(1.0, tolerance=1e-6)
    ),
    "unfused": (with_gammas(PAPER.problem), Simulation(2.0, tolerance=1e-6, fused=False)),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_members_are_their_single_runs_whatever_the_lanes(kind) -> None:
    members, simulation = KINDS[kind]
    found = [
        simulate_ensemble(members, simulation, judge=Judge(), lanes=lanes, threads=threads) for lanes, threads in ((4, 1), (1, 2))
    ]
    one, other = (vars(result.metrics) for result in found)
    assert all(np.array_equal(one[name], other[name], equal_nan=True) for name in one if one[name] is not None)
    assert np.array_equal(found[0].judged.kinds, found[1].judged.kinds)
    alone = {"noise": 1, "unfused": 0}.get(kind, 2)  # members of other noise; and of numbers that are arguments of the kernel
    for i, (problem, controller) in enumerate(members[:alone]):
        single = simulate(problem, [controller], simulation)[controller.name]
        for name in OF_STATES:
            assert one[name][i].tolist() == single.figures[name], name
        for name in ("rms_e", "max_abs_u", "theta_hat_variation_rate"):  # grouped otherwise, and signals by NumPy
            assert one[name][i] == pytest.approx(np.array(single.figures[name]), rel=1e-12, abs=1e-12)


def test_more_members_than_lanes_take_each_others_places() -> None:
    """Some members need ten times the steps of their neighbours, and others diverge."""
    case, simulation = load_case("rohrs"), Simulation(30.0, tolerance=1e-6)
    classical = next(c for c in case.controllers if c.name == "Classical")
    members = [
        (case.problem, replace(classical, law=replace(classical.law, gamma=gamma)))
        for gamma in (1.0, 0.01, 10.0, 0.1, 3.0, 0.03, 1.0)
    ]
    wide, narrow = (simulate_ensemble(members, simulation, judge=Judge(), lanes=n, threads=1) for n in (2, 1))
    assert np.isfinite(wide.metrics.diverged_at).sum() >= 2
    assert np.isnan(wide.metrics.diverged_at).sum() >= 2
    for name in ("diverged_at", "rms_e", "theta_hat_final"):
        assert np.array_equal(getattr(wide.metrics, name), getattr(narrow.metrics, name), equal_nan=True)
    for i, (problem, controller) in enumerate(members):
        single = simulate(problem, [controller], simulation)["Classical"]
        ends = np.array([single.diverged_at, wide.metrics.end_of(i)], dtype=float)
        assert ends[0] == pytest.approx(ends[1], rel=1e-9, nan_ok=True)  # gamma is an argument of their kernel
        assert single.judged.kind == wide.judged.verdict(i).kind


def test_members_continue_side_by_side_as_single_runs_do() -> None:
    """The delays make the loop settle, have a limit cycle, or diverge. Each needs a different number of windows."""
    plant = Plant(A_m=[[-2.0]], b=[1.5], theta=[1.0], x0=[0.3])
    problem = Problem(plant, ReferenceModel(k_0=1.3), Sine(1.0, 1.2), name="one state")
    members = [
        (limited(problem, saturation=[-5.0, 5.0], delay=delay), wrap(Mrac(gamma=30.0)))
        for wrap in (lambda c: c, lambda c: Sampled(c, 0.01))
        for delay in (0.02, 0.9, 0.3, 1.2, 0.6)
    ]
    simulation, judge = Simulation(8.0, tolerance=1e-6), Judge(closely=True)
    cycling = 0
    for kind in (members[:5], members[5:]):
        wide, narrow = (simulate_ensemble(kind, simulation, judge=judge, lanes=n, threads=k).judged for n, k in ((4, 1), (1, 2)))
        for name in ("amplitude", "frequency", "growing", "which"):
            assert np.array_equal(getattr(wide.cycles, name), getattr(narrow.cycles, name)), name
        cycling += int(wide.cycles.which.any(axis=1).sum())
        for i, (own, controller) in enumerate(kind):
            single = simulate(own, [controller], simulation, judge=judge)["MRAC"].judged
            assert single.kind == wide.verdict(i).kind
            assert (single.cycle is None) == (wide.verdict(i).cycle is None)
            if single.cycle is not None:
                assert wide.verdict(i).cycle.amplitude == single.cycle.amplitude
                assert wide.verdict(i).cycle.frequency == single.cycle.frequency
    assert 4 <= cycling < len(members)


def test_threads_leave_casadi_alone(monkeypatch) -> None:
    """CasADi's objects count references without a lock, so two threads that made objects caused a segmentation fault."""

    def only_at_first(name, size):
        assert threading.current_thread() is threading.main_thread()
        return symbols(name, size)

    monkeypatch.setattr(time_signals, "symbols", only_at_first)
    members = with_gammas(NOISY, lambda c: Sampled(c, 0.01))
    assert np.isfinite(simulate_ensemble(members, Simulation(1.0, tolerance=1e-6), threads=2).metrics.rms_e).all()
