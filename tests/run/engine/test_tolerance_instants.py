"""Runs with a tolerance and events at given instants, compared with SciPy from one instant to the next."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import Simulation, load_case, simulate
from barbalat.controllers.sampled import Sampled
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.compiled import Compiled
from barbalat.problem.actuation import PlantInput
from barbalat.problem.faults import Bias, Dropout, Jitter, Spike, Stuck
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.shell import Shell
from barbalat.run.kernel.portable import standard_normal
from barbalat.signals import Square
from barbalat.validate import InputError

PAPER = load_case("paper")
L1 = replace(next(c for c in PAPER.controllers if c.name == "L1"), gamma=100.0)
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=1.0)
NOISE = Noise(std=0.01, sample_time=0.02, seed=3)
SENSOR = Sensor(lag=0.05, noise=NOISE)


def by_scipy(problem, controller, t_end, *others):
    """The state at t_end, including a sample there, from SciPy's DOP853 at 1e-12 and the controller's own Python equations.

    The pieces of the run lie between samples, arrivals of delayed samples, changes of the noise and ``others`` [s]. The bounds of
    a known set are not reached.
    """
    loop = ClosedLoop.of(problem, controller)
    rates, T, tau = Compiled(right_hand_side(loop)), loop.sample_time, problem.delay
    noise = problem.noise
    hold = None if noise is None else noise.sample_time
    every = {round(k * hold, 9) for k in range(int(t_end / hold + 1e-9) + 1)} if hold else set()
    called = [round(k * T, 9) for k in range(int(t_end / T + 1e-9) + 1)] if T else []
    jitters = [(place, fault) for place, fault in enumerate(problem.faults) if isinstance(fault, Jitter)]
    if jitters:
        called = [0.0]
        while (t := len(called) * T + sum(f.time * f.value(np.array(called[-1:]), i).item() for i, f in jitters)) <= t_end:
            called.append(t)
    every |= set(called)
    if tau:
        every |= {round(t + tau, 9) for t in called if t + tau <= t_end + 1e-9}
    instants, x, put_out = sorted({0.0, t_end, *others, *every}), loop.initial(), []
    for begin, end in zip(instants, [*instants[1:], None], strict=True):
        drawn = [] if noise is None else standard_normal(noise.seed, 0, int(begin / hold + 1e-9), 1, 2)[0]

        def driven(t, drawn=drawn, delayed=()):
            timed = (np.asarray(signal(np.array([t]))).item() for signal in problem.signals)
            return np.array([*timed, *drawn, *(delayed if len(delayed) else [0.0] * loop.signals.delayed)])

        if begin in called:
            x = np.asarray(loop.sample(x, driven(begin if jitters else round(begin / T) * T)), float)
            put_out.append((begin, np.reshape(loop.undelayed_input(x, driven(begin)), -1)))
        if end is None:
            return x
        arrived = [value for t, value in put_out if t <= begin - tau + 1e-9]
        delayed = (arrived[-1] if arrived else problem.history) if tau else ()

        def slope(t, y, inside=(begin + 1e-12, end - 1e-12), driven=driven, delayed=delayed):
            return rates(y, driven(np.clip(t, *inside), delayed=delayed))

        found = solve_ivp(slope, (begin, end), x, "DOP853", rtol=1e-12, atol=1e-13)
        x = np.asarray(loop.limit(found.y[:, -1]))  # the estimates have changed and are included
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


@pytest.mark.parametrize("delay", [0.004, 0.01, 0.025, 0.03], ids=["below a sample", "one", "two and a half", "three"])
def test_a_delayed_control_arrives_when_it_is_due(delay) -> None:
    """Until the first sample leaves the delay, its output is its history."""
    problem = replace(
        PAPER.problem, plant=replace(PAPER.problem.plant, input=PlantInput(delay=delay, history=0.5, saturation=(-9, 9)))
    )
    controller = Sampled(replace(MRAC, gamma=0.1), 0.01)
    expected = by_scipy(problem, controller, 1.0)
    assert final(problem, controller, 1.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


FAULTS = (
    Dropout(share=0.2, seed=1),
    Spike(share=0.1, size=0.3, channel="x_1", seed=2),
    Stuck(times=((0.3, 0.4),)),
    Bias(size=0.1, times=((0.6, 2.0),)),
    Dropout(times=((0.7, 0.8),), channel="command"),
)


@pytest.mark.parametrize("delay", [0.0, 0.015], ids=["no delay", "delayed"])
def test_faults_come_at_samples(delay) -> None:
    plant = replace(PAPER.problem.plant, input=PlantInput(delay=delay))
    problem = replace(PAPER.problem, plant=plant, faults=FAULTS, sensor=Sensor(lag=0.02))
    controller = Sampled(replace(MRAC, gamma=0.1), 0.01)
    expected = by_scipy(problem, controller, 1.0)
    assert final(problem, controller, 1.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())
    clean = final(replace(problem, faults=()), controller, 1.0)
    assert np.abs(clean[: len(expected)][:2] - expected[:2]).max() > 1e-3


@pytest.mark.parametrize(
    ("shell", "delay"),
    [
        (None, 0.0),
        (Shell(jitter=0.15, longest_outage=0.05), 0.0),
        (None, 0.0012),
        (None, 0.0095),
        (None, 0.01),
        (None, 0.0213),
    ],
    ids=["no shell", "late calls are misses", "a short delay", "almost a sample", "one sample", "a longer delay"],
)
def test_jittered_samples_come_when_they_are_due(shell, delay) -> None:
    """The samples are on time also at the output of a delay, which contains more samples at some times than at others."""
    faults = (Jitter(time=0.0011, seed=4), Jitter(time=0.0007, share=0.3, burst=0.1, seed=5), *FAULTS)
    plant = replace(PAPER.problem.plant, input=PlantInput(delay=delay, history=0.5))
    problem = replace(PAPER.problem, plant=plant, faults=faults, shell=shell, sensor=SENSOR)
    controller = Sampled(replace(MRAC, gamma=0.1), 0.01)
    expected = by_scipy(problem, controller, 1.0)
    assert final(problem, controller, 1.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())
    steady = final(replace(problem, faults=FAULTS), controller, 1.0)
    assert np.abs(steady[:2] - expected[:2]).max() > 1e-4


def test_a_jittered_run_is_judged_as_with_fixed_steps() -> None:
    """The judge's windows after the run begin with the call at the instant set by the last jitter. Further random numbers would
    depend on the rounding of a call's instant to fixed steps."""
    jitter = Jitter(time=0.002, times=((0.0, 0.005), (2.0, 2.005), (3.985, 3.995)), seed=8)
    assert jitter.value(np.array([3.99]), 0) > 0.5  # the last call of the run comes after its end
    problem = replace(PAPER.problem, faults=(jitter,))
    controller = Sampled(replace(MRAC, gamma=0.1), 0.01)
    ours, fixed = (
        simulate(problem, [controller], one)["MRAC"] for one in (Simulation(4.0, tolerance=1e-8), Simulation(4.0, 2e-5))
    )
    assert str(ours.verdict) == str(fixed.verdict)
    for name in ("max_abs_e", "rms_e", "max_abs_u", "theta_hat_final", "theta_hat_variation_rate"):
        assert ours.figures[name] == pytest.approx(fixed.figures[name], rel=2e-3), name


def test_a_delayed_run_is_judged_as_with_fixed_steps() -> None:
    """The judge's windows after the run continue with the contents of the delay."""
    problem = replace(PAPER.problem, plant=replace(PAPER.problem.plant, input=PlantInput(delay=0.04)))
    controller = Sampled(replace(MRAC, gamma=0.1), 0.01)
    ours, fixed = (
        simulate(problem, [controller], one)["MRAC"] for one in (Simulation(4.0, tolerance=1e-8), Simulation(4.0, 5e-4))
    )
    assert str(ours.verdict) == str(fixed.verdict)
    for name in ("max_abs_e", "rms_e", "max_abs_u", "theta_hat_final", "theta_hat_variation_rate"):
        assert ours.figures[name] == pytest.approx(fixed.figures[name], rel=1e-3), name


def test_a_command_that_jumps_between_samples() -> None:
    square = Square(20.0, 1.37, phase=0.2)
    problem, controller = replace(PAPER.problem, reference=square), Sampled(MRAC, 0.01)
    expected = by_scipy(problem, controller, 3.0, *square.breaks(0.0, 3.0))
    assert final(problem, controller, 3.0) == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("sensor", [None, SENSOR], ids=["no sensor", "noise and lag"])
def test_what_is_seen_of_it_is_what_fine_steps_show(sensor) -> None:
    """RK4's own error and the motion between its instants are below these tolerances. There is no sample at the end."""
    problem = replace(PAPER.problem, sensor=sensor)
    controllers = [
        Sampled(MRAC, 0.02),
        replace(MRAC, gamma=0.05, name="continuous"),
    ]  # which reaches no bound, where RK4 would lose order
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


def test_nothing_turns_where_the_noise_jumps() -> None:
    """The extrema of the control are found between the changes of the noise, each of which makes it jump."""
    problem = replace(PAPER.problem, sensor=Sensor(noise=replace(NOISE, std=0.2)))
    controller = replace(MRAC, gamma=0.05)
    ours, fine = (
        simulate(problem, [controller], simulation)["MRAC"]
        for simulation in (Simulation(1.0, tolerance=1e-8), Simulation(1.0, 1e-5))
    )
    most, expected_most = (one.envelope.u_max.reshape(50, 40).max(axis=1) for one in (ours, fine))
    least, expected_least = (one.envelope.u_min.reshape(50, 40).min(axis=1) for one in (ours, fine))
    unseen = 1e-2  # with fixed steps: the last 1e-5 s before a change of the noise, in which u changes by half of that
    assert (np.abs(most - expected_most) < unseen).all()
    assert (np.abs(least - expected_least) < unseen).all()


def test_the_final_estimates_are_those_before_a_sample_at_the_end() -> None:
    for t_end in (0.5, 0.505, 0.4):  # with and without such a sample; in the last run the tail begins at a sample
        ours, fixed = (
            simulate(PAPER.problem, [Sampled(MRAC, 0.01)], simulation)["MRAC"].figures
            for simulation in (Simulation(t_end, tolerance=1e-10), Simulation(t_end, 5e-4))
        )
        assert ours["theta_hat_final"] == pytest.approx(fixed["theta_hat_final"], rel=1e-6)
        if t_end != 0.505:  # both tails begin at the same instant
            assert ours["theta_hat_variation_rate"] == pytest.approx(fixed["theta_hat_variation_rate"], rel=1e-6)


@pytest.mark.parametrize("before", [1e-4, 2e-4, 3e-4])
def test_a_trough_just_after_the_tail_begins(before) -> None:
    """theta_hat_2 grows while it oscillates, so its smallest value in the tail is the first trough, between the tail's first
    nodes."""
    fine = simulate(PAPER.problem, [MRAC], Simulation(3.2, tolerance=1e-9, record_points=200_000))["MRAC"]
    estimate = fine.theta_hat[:, 1]
    troughs = 1 + np.flatnonzero((estimate[1:-1] < estimate[:-2]) & (estimate[1:-1] <= estimate[2:]))
    first = troughs[fine.t[troughs] > 2.3][0]
    t_end = (fine.t[first] - before) / 0.75
    tail = (fine.t >= fine.t[first] - before) & (fine.t <= t_end)
    assert estimate[tail].min() == estimate[first]
    found = simulate(PAPER.problem, [MRAC], Simulation(t_end, tolerance=1e-6))["MRAC"].figures["theta_hat_tail_min"][1]
    assert found == pytest.approx(estimate[first], abs=1e-5 * np.ptp(estimate[tail]))
