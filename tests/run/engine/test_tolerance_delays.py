"""Delays at the plant's input with a tolerance, compared with SciPy by the method of steps without interpolation."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import Simulation, load_case, simulate, simulate_ensemble
from barbalat.budget import Budget
from barbalat.controllers.sampled import Sampled
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.compiled import Compiled
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.run.kernel import past, step
from barbalat.run.kernel.portable import standard_normal
from barbalat.signals import Square
from barbalat.validate import InputError

PAPER = load_case("paper")
L1 = replace(next(c for c in PAPER.controllers if c.name == "L1"), gamma=100.0)
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=0.1)
NOISE = Noise(std=0.01, sample_time=0.02, seed=3)
ACTUATOR = TransferFunction([1.0], [0.03, 1.0])
WITHIN = 1e-12


def delayed(delay, problem=PAPER.problem, **others):
    return replace(problem, plant=replace(problem.plant, input=PlantInput(delay=delay, history=0.5, **others)))


def by_scipy(problem, controller, count, *breaks):
    """The state after ``count`` delays, from SciPy's DOP853 at 1e-12 and the loop's own Python equations.

    The intervals between multiples of the delay are integrated together, so each receives the exact control of the previous one.
    Each begins where the previous one ends, which takes as many rounds. ``breaks`` are the jumps of the signals [s].
    """
    loop, tau, noise = ClosedLoop.of(problem, controller), problem.delay, problem.noise
    rates, T, size = Compiled(right_hand_side(loop)), loop.sample_time, loop.size
    hold = None if noise is None else noise.sample_time
    samples = [] if T is None else [k * T for k in range(int(count * tau / T + 1e-9) + 1)]
    own = [k * hold for k in range(int(count * tau / hold + 1e-9) + 1)] if hold else []
    inside = {round(t % tau, 12) % tau for t in (*breaks, *samples, *own)}
    places = sorted({0.0, tau, *(s for s in inside if 1e-9 < s < tau - 1e-9)})

    def driven(t, after, leaving):
        """The signals at t, with the noise and samples after the instant ``after``."""
        drawn = [] if noise is None else standard_normal(noise.seed, 0, int(after / hold + 1e-9), 1, 2)[0]
        return np.array([*(np.asarray(one(np.array([t]))).item() for one in problem.signals), *drawn, *leaving])

    starts = [loop.initial()]
    for k in range(count):
        states = list(starts)
        for begin, end in pairwise(places):
            for i in range(k + 1):
                t = begin + i * tau
                if T is not None and abs(t - round(t / T) * T) < 1e-9:
                    states[i] = np.asarray(loop.sample(states[i], driven(t, t, [0.0])), float)

            def slopes(s, flat, begin=begin, end=end, k=k):
                s, found, leaving = min(max(s, begin + WITHIN), end - WITHIN), [], problem.history
                for i in range(k + 1):
                    x = flat[i * size : (i + 1) * size]
                    given = driven(s + i * tau, begin + i * tau, leaving)
                    found.append(rates(x, given))
                    leaving = np.reshape(np.asarray(loop.undelayed_input(x, given)), -1)
                return np.concatenate(found)

            flat = solve_ivp(slopes, (begin, end), np.concatenate(states), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
            states = [np.asarray(loop.limit(x)) for x in np.split(flat, k + 1)]
        starts.append(states[-1])
    t_end, last = count * tau, starts[-1]
    due = T is not None and abs(t_end - round(t_end / T) * T) < 1e-9
    return np.asarray(loop.sample(last, driven(t_end, t_end, [0.0])), float) if due else last


def run(problem, controller, t_end, tolerance=1e-10):
    return simulate(problem, [controller], Simulation(t_end, tolerance=tolerance))[controller.name]


SQUARE = replace(PAPER.problem, reference=Square(20.0, 0.37, phase=0.2))


@pytest.mark.parametrize(
    ("problem", "controller", "count", "breaks"),
    [
        (delayed(0.05), MRAC, 8, ()),
        (delayed(0.05), L1, 8, ()),
        (delayed(0.05, SQUARE), MRAC, 12, Square(20.0, 0.37, phase=0.2).breaks(0.0, 1.0)),
        (delayed(0.05, actuator=ACTUATOR, saturation=(-4.0, 4.0)), MRAC, 8, ()),
        (delayed(0.05, replace(PAPER.problem, sensor=Sensor(lag=0.05, noise=NOISE))), MRAC, 6, ()),
        (delayed(0.035, actuator=ACTUATOR), Sampled(MRAC, 0.01), 8, ()),
        (delayed(0.004, actuator=ACTUATOR), Sampled(MRAC, 0.01), 20, ()),
    ],
    ids=["MRAC", "L1", "jumps", "behind an actuator", "noise", "sampled, an actuator", "below a sample"],
)
def test_the_motion_is_scipys_delay_by_delay(problem, controller, count, breaks) -> None:
    expected = by_scipy(problem, controller, count, *breaks)
    found = run(problem, controller, count * problem.delay)
    assert found.states[-1] == pytest.approx(expected, rel=1e-8, abs=1e-9 * np.abs(expected).max())
    plant = replace(problem.plant, input=replace(problem.plant.input, delay=0.0))
    undelayed = run(replace(problem, plant=plant), controller, count * problem.delay)
    assert np.abs(undelayed.states[-1] - found.states[-1])[:2].max() > 1e-3


def test_the_error_falls_as_the_tolerance() -> None:
    problem = delayed(0.2)
    expected = by_scipy(problem, L1, 8)
    errors = [np.abs(run(problem, L1, 1.6, tolerance).states[-1] - expected).max() for tolerance in (1e-4, 1e-6, 1e-8)]
    assert errors[0] > 50 * errors[1] > 2500 * errors[2]
    assert errors[2] < 1e-8 * np.abs(expected).max()


def test_steps_end_at_what_a_jump_leaves(monkeypatch) -> None:
    """Steps end one, two and more delays after a jump, where a corner and then smoother and smoother effects of it leave the
    delay."""
    problem, slow = delayed(0.1, SQUARE), replace(MRAC, gamma=1e-3)  # which reaches no bound
    expected = by_scipy(problem, slow, 8, *problem.reference.breaks(0.0, 0.8))
    errors = []
    for level in (past.SMOOTH_LEVEL, 1.0):  # the second ends steps only where a jump leaves the delay
        monkeypatch.setattr(past, "SMOOTH_LEVEL", level)
        monkeypatch.setattr(step, "_programs", {})  # traced with the other level
        monkeypatch.setattr("barbalat.run.kernel.attempt.SMOOTH_LEVEL", level)
        found = run(problem, slow, 0.8, 1e-6)
        assert found.accuracy.rejected == 0
        errors.append(np.abs(found.states[-1] - expected).max() / np.abs(expected).max())
    assert errors[0] < 1e-11
    assert errors[1] > 1000 * errors[0]


def test_the_measured_error_is_no_less_than_the_error() -> None:
    """The measured error is no less than the error even if the delay and not the tolerance determines the steps."""
    problem = delayed(0.2)
    expected = by_scipy(problem, MRAC, 8)
    for tolerance in (1e-4, 1e-8):
        found = run(problem, MRAC, 1.6, tolerance)
        error = np.abs(found.states[-1] - expected)[:2] / np.abs(found.x).max(axis=0)
        assert error.max() < found.accuracy.error["x"] < 1e3 * error.max()


def test_a_delayed_run_is_judged_as_with_fixed_steps() -> None:
    """The judge's windows after the run continue with the contents of the delay."""
    problem = delayed(0.02)
    ours, fixed = (simulate(problem, [MRAC], one)["MRAC"] for one in (Simulation(4.0, tolerance=1e-8), Simulation(4.0, 2.5e-4)))
    assert ours.verdict.kind is fixed.verdict.kind
    for name in ("max_abs_e", "rms_e", "max_abs_u", "theta_hat_final", "theta_hat_variation_rate"):
        assert ours.figures[name] == pytest.approx(fixed.figures[name], rel=1e-3), name


def test_each_member_has_its_own_delay() -> None:
    """Each member also has a separate history, and is identical to the single run."""
    members = [(delayed(tau), MRAC) for tau in (0.01, 0.03, 0.1)]
    plant = replace(members[1][0].plant, input=PlantInput(delay=0.03))
    members.append((replace(members[1][0], plant=plant), MRAC))
    simulation = Simulation(1.0, tolerance=1e-8)
    found = simulate_ensemble(members, simulation).metrics
    for i, (problem, controller) in enumerate(members):
        single = simulate(problem, controller, simulation)["MRAC"]
        assert found.theta_hat_final[i].tolist() == pytest.approx(single.figures["theta_hat_final"], rel=1e-9)
        assert found.max_abs_e[i].tolist() == pytest.approx(single.figures["max_abs_e"], rel=1e-6)
    assert len(np.unique(found.theta_hat_final[:, 0])) == 4


def test_what_is_in_the_delay_counts_for_the_budget() -> None:
    problem, simulation = delayed(0.5), Simulation(1.0, tolerance=1e-6, record_points=50)
    controller = Sampled(MRAC, 1e-4)
    assert simulate(problem, controller, simulation)["MRAC"].accuracy.steps > 10_000
    with Budget(memory=150_000), pytest.raises(InputError, match=r"plant\.input\.delay .*more than the budget"):
        simulate(problem, controller, simulation)
