"""Runs by a tolerance in which something happens at instants of its own, against SciPy from one instant to the next."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import Simulation, load_case, simulate
from barbalat.controllers.sampled import Sampled
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.compiled import Compiled
from barbalat.problem.measurement import Noise, Sensor
from barbalat.run.kernel.portable import standard_normal
from barbalat.signals import Square
from barbalat.validate import InputError

PAPER = load_case("paper")
L1 = replace(next(c for c in PAPER.controllers if c.name == "L1"), gamma=100.0)
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=1.0)
NOISE = Noise(std=0.01, sample_time=0.02, seed=3)
SENSOR = Sensor(lag=0.05, noise=NOISE)


def by_scipy(problem, controller, t_end, *others):
    """The state at t_end, a sample there included, from SciPy's DOP853 at 1e-12 and the controller's own Python equations.

    Its pieces lie between samples, renewals of the noise and ``others`` [s]. A state's known set is not met.
    """
    loop = ClosedLoop.of(problem, controller)
    rates, T = Compiled(right_hand_side(loop)), loop.sample_time
    noise = problem.noise
    hold = None if noise is None else noise.sample_time
    every = {round(k * period, 9) for period in (T, hold) if period for k in range(int(t_end / period + 1e-9) + 1)}
    instants, x = sorted({0.0, t_end, *others, *every}), loop.initial()
    for begin, end in zip(instants, [*instants[1:], None], strict=True):
        drawn = [] if noise is None else standard_normal(noise.seed, 0, int(begin / hold + 1e-9), 1, 2)[0]

        def driven(t, drawn=drawn):
            return np.array([*(float(signal(np.array(t))) for signal in problem.signals), *drawn])

        if T is not None and abs(begin / T - round(begin / T)) < 1e-9:
            x = np.asarray(loop.sample(x, driven(begin)), float)
        if end is None:
            return x

        def slope(t, y, inside=(begin + 1e-12, end - 1e-12), driven=driven):
            return rates(y, driven(np.clip(t, *inside)))

        found = solve_ivp(slope, (begin, end), x, "DOP853", rtol=1e-12, atol=1e-13)
        x = np.asarray(loop.limit(found.y[:, -1]))  # the estimates have moved and are counted
    return None


def final(problem, controller, t_end, tolerance=1e-10):
    result = simulate(problem, [controller], Simulation(t_end, tolerance=tolerance))[controller.name]
    return result.states[-1]


@pytest.mark.parametrize(
    ("problem", "controller"),
    [
        (PAPER.problem, Sampled(MRAC, 0.01)),
        (PAPER.problem, Sampled(L1, 0.003, discretization="euler")),  # which does not divide the run
        (replace(PAPER.problem, sensor=SENSOR), Sampled(MRAC, 0.05)),
        (replace(PAPER.problem, sensor=SENSOR), MRAC),
        (replace(PAPER.problem, sensor=Sensor(noise=NOISE)), Sampled(MRAC, 0.03)),  # two rhythms
    ],
    ids=["sampled", "Euler", "sampled, noise and lag", "noise and lag", "two rhythms"],
)
def test_the_motion_is_scipys_from_instant_to_instant(problem, controller) -> None:
    expected = by_scipy(problem, controller, 1.0)
    assert final(problem, controller, 1.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


def test_a_command_that_jumps_between_samples() -> None:
    square = Square(20.0, 1.37, phase=0.2)
    problem, controller = replace(PAPER.problem, reference=square), Sampled(MRAC, 0.01)
    expected = by_scipy(problem, controller, 3.0, *square.breaks(0.0, 3.0))
    assert final(problem, controller, 3.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("sensor", [None, SENSOR], ids=["no sensor", "noise and lag"])
def test_what_is_seen_of_it_is_what_fine_steps_show(sensor) -> None:
    """RK4's own error there, and what lies between its instants, is below these tolerances; no sample lies at the end."""
    problem = replace(PAPER.problem, sensor=sensor)
    controllers = [
        Sampled(MRAC, 0.02),
        replace(MRAC, gamma=0.05, name="continuous"),
    ]  # which meets no bound, where RK4 loses order
    runs = [
        simulate(problem, controllers, simulation) for simulation in (Simulation(2.01, tolerance=1e-8), Simulation(2.01, 1e-4))
    ]
    for name in ("MRAC", "continuous"):
        ours, fine = (run[name] for run in runs)
        for figure in ("max_abs_e", "rms_e", "max_abs_u", "theta_hat_tail_min", "theta_hat_tail_max", "theta_hat_final"):
            assert ours.figures[figure] == pytest.approx(fine.figures[figure], rel=2e-4, abs=1e-5), (name, figure)
        assert ours.figures["theta_hat_variation_rate"] == pytest.approx(fine.figures["theta_hat_variation_rate"], rel=1e-3)
        assert ours.x[:, 0] == pytest.approx(np.interp(ours.t, fine.t, fine.x[:, 0]), abs=1e-3)
        assert ours.verdict.kind is fine.verdict.kind


def test_a_sampled_run_takes_no_more_steps_than_samples() -> None:
    result = simulate(PAPER.problem, [Sampled(MRAC, 0.01)], Simulation(2.0, tolerance=1e-6))["MRAC"]
    assert result.accuracy.steps < 2 * 200
    assert result.accuracy.error["x"] < 1e-6


def test_refusals() -> None:
    simulation = Simulation(1.0, tolerance=1e-6)
    with pytest.raises(InputError, match=r"sample_time must not exceed simulation\.t_end = 1 s, got 2 s"):
        simulate(PAPER.problem, [Sampled(MRAC, 2.0)], simulation)
