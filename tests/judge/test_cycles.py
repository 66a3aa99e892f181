"""Limit cycles known in closed form are found with their amplitudes and frequencies, and nothing else is taken for one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from labelled_runs import (
    RELAY_GAIN,
    Gain,
    VanDerPol,
    describing_function_cycle,
    labelled,
    oscillator,
    relay_cycle,
    relay_problem,
)

from barbalat import InputError, Simulation, simulate, simulate_ensemble
from barbalat.cases.load import CaseText, parse_case
from barbalat.judge.cycles import Windows
from barbalat.judge.held import Held
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class
from barbalat.open_numbers.varied import VariedCase
from barbalat.run.engine.judging import tail_is_short
from barbalat.signals import Constant, Recorded, Sine, Sines, Square, Step
from barbalat.signals.smooth import Clock
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Design, Plan

JOINT = Path(__file__).parent / "flexible-joint.toml"


@pytest.mark.parametrize(("a", "delay"), [(0.5, 0.2), (1.1, 0.1), (3.0, 0.4)])
def test_a_relay_with_delay_cycles_as_computed_exactly(a, delay):
    simulation = Simulation(t_end=20.0, dt=0.0005)
    (result,) = simulate(relay_problem(a, delay), [Gain(k=np.array([RELAY_GAIN]))], simulation).values()
    verdict = result.verdict
    amplitude, frequency = relay_cycle(a, delay)
    assert verdict.kind is Class.CYCLE
    assert verdict.cycle.signal == "u_limited[0]"
    assert verdict.cycle.amplitude == pytest.approx(1.0, abs=1e-9)
    assert verdict.cycle.frequency == pytest.approx(frequency, rel=0.01)
    assert verdict.error == pytest.approx(amplitude, rel=0.02)
    assert verdict.at_limit[0] > 0.95


def recorded_noise(t_end):
    """A constant command as a logger records it."""
    t = np.linspace(0.0, t_end, 2001)
    return Recorded(times=t, values=1.0 + 1e-6 * np.random.default_rng(0).normal(size=len(t)))


@pytest.mark.parametrize(
    "ripple", [{"disturbance": Sine(1e-6, 100.0)}, {"disturbance": Sine(0.05, 37.0)}, {"reference": recorded_noise(20.0)}]
)
def test_no_ripple_of_a_signal_hides_a_cycle(ripple):
    """The ripple reverses more often than the control and does not drive it."""
    problem = replace(relay_problem(0.5, 0.2), **ripple)
    (result,) = simulate(problem, [Gain(k=np.array([RELAY_GAIN]))], Simulation(t_end=20.0, dt=0.001)).values()
    assert result.verdict.kind is Class.CYCLE and result.verdict.cycle.amplitude == pytest.approx(1.0)


def test_turns_are_counted_beyond_a_ripple():
    t = np.linspace(0.0, 20.0, 20001)
    noisy = Recorded(times=t, values=np.sin(t) + 1e-3 * np.random.default_rng(0).normal(size=len(t)))
    assert Held.of([Sine(1.0, 1.0)], 0.0, 20.0).turns == Held.of([noisy], 0.0, 20.0).turns == 6
    assert Held.of([Square(1.0, 1.0)], 0.0, 20.0).turns == 2 * 6 - 1  # each jump begins and reverses


@pytest.mark.parametrize(("a", "delay"), [(0.5, 0.2), (1.1, 0.1)])
def test_harmonic_balance_agrees_where_the_plant_is_a_low_pass(a, delay):
    exact, balanced = relay_cycle(a, delay), describing_function_cycle(a, delay)
    np.testing.assert_allclose(balanced, exact, rtol=0.35)
    simulation = Simulation(t_end=20.0, dt=0.001)
    (result,) = simulate(relay_problem(a, delay), [Gain(k=np.array([RELAY_GAIN]))], simulation).values()
    assert result.verdict.cycle.frequency == pytest.approx(balanced[1], rel=0.15)


def test_van_der_pol_has_the_period_of_the_tables():
    """The period is 6.66329 for mu = 1 (Andersen and Geer, SIAM Journal on Applied Mathematics 42, 1982) and the amplitude
    2.0086."""
    (result,) = simulate(oscillator(0.0, [0.1, 0.0]), [VanDerPol(mu=1.0)], Simulation(t_end=80.0, dt=0.005)).values()
    verdict = result.verdict
    assert verdict.kind is Class.CYCLE
    assert np.abs(result.x[-1500:, 0]).max() == pytest.approx(2.0086, rel=1e-3)
    turns = np.flatnonzero(np.diff(np.sign(result.x[-1000:, 0])) > 0)
    period = float(np.diff(result.t[-1000:][turns]).mean())
    assert period == pytest.approx(6.66329, rel=0.01)
    assert verdict.cycle.frequency == pytest.approx(2 * np.pi / 6.66329, rel=0.01)  # u = (1 - x^2) x' has smaller waves too


def test_labels_known_beforehand():
    """Every cycle with three periods in the tail is found, and nothing else is called one: 18 kinds of runs, 20 of each."""
    missed, false = {}, {}
    for name, (members, simulation, cycle) in labelled(np.random.default_rng(0), 20).items():
        judged = simulate_ensemble(members, simulation, judge=Judge()).judged
        called = int(judged.cycles.which.any(axis=1).sum())
        (missed if cycle else false)[name] = (len(members) - called) if cycle else called
    missed.pop("one to three periods in the tail")
    assert set(missed.values()) == {0}, missed
    assert set(false.values()) == {0}, false


def test_what_is_looked_at_in_runs_is_no_cycle_either():
    """A run that follows a reversing command is checked as in a sweep, with everything held constant. No label becomes false."""
    for name, (members, simulation, cycle) in labelled(np.random.default_rng(2), 6).items():
        if not cycle:
            found = simulate_ensemble(members, simulation, judge=Judge(closely=True), frequencies=False).judged
            assert not found.cycles.which.any(), name


def test_a_run_that_cycles_where_its_command_turns_as_fast_is_a_limit_cycle():
    """The run stays within 5 % of the scale, moves from limit to limit, and reverses less often than the command."""
    problem = relay_problem(1.0, 0.01, reference=Sines(amplitudes=[1.0, 0.06], frequencies=[0.3, 100.0]), limit=1.3)
    (result,) = simulate(problem, [Gain(k=np.array([1e3]))], Simulation(t_end=40.0, dt=1e-3)).values()
    verdict = result.verdict
    assert verdict.error < verdict.band and verdict.at_limit[0] > 0.8
    assert verdict.kind is Class.CYCLE and verdict.cycle.amplitude == pytest.approx(1.25, abs=0.06)


SLOW = """
name = "Slow hunting"
[plant]   # an integrator, nearly, behind a delay of 6 s: a relay's cycle of 23 s, and a tail of 10 s
A = [[-0.02]]
b = [1.0]
x0 = [1.0]
[plant.input]
saturation = [-1.0, 1.0]
delay = 6.0
[reference_model]
poles = [-0.5]
k_0 = 0.5
[reference]
kind = "constant"
value = 0.0
[uncertainty]
lower = [-1.0]
upper = [1.0]
[simulation]
t_end = 40.0
dt = 0.01
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 10.0
"""


def test_a_cycle_slower_than_the_tail_is_found_where_it_is_looked_at_closely():
    """The cycle is found by ``judge.closely``, which ``run`` uses if the tail is shorter than three periods of the model."""
    plain, closely = (parse_case(SLOW + more) for more in ("", "[judge]\nclosely = true\n"))
    simulation = plain.simulation
    assert tail_is_short(plain.problem, simulation)
    assert not tail_is_short(plain.problem, replace(simulation, t_end=160.0))
    hidden, seen = (simulate(c.problem, c.controllers, simulation, judge=c.judge)["MRAC"].verdict for c in (plain, closely))
    long = simulate(plain.problem, plain.controllers, replace(simulation, t_end=400.0))["MRAC"].verdict
    assert hidden.kind is Class.OFF and seen.kind is long.kind is Class.CYCLE
    assert seen.cycle.amplitude == pytest.approx(long.cycle.amplitude, rel=1e-6)
    assert seen.cycle.frequency == pytest.approx(long.cycle.frequency, rel=0.05)
    assert long.cycle.frequency == pytest.approx(2 * np.pi / 23, rel=0.05)
    with pytest.raises(InputError, match=r"judge\.closely must be true or false"):
        Judge(closely=1)


@pytest.mark.parametrize("steps", [1, 2, 3, 5])
def test_a_run_of_a_few_steps_is_judged_closely_too(steps):
    case = parse_case(SLOW + "[judge]\nclosely = true\n")
    simulation = Simulation(t_end=float(steps), dt=1.0)
    assert simulate(case.problem, case.controllers, simulation, judge=case.judge)["MRAC"].verdict.kind in Class


@pytest.mark.parametrize("kind", ["van der Pol", "one to three periods in the tail", "relay with delay"])
def test_no_verdict_depends_on_who_runs_beside(kind):
    members, simulation, _ = labelled(np.random.default_rng(1), 12)[kind]
    alone, together = (simulate_ensemble(members, simulation, judge=Judge(), lanes=w).judged for w in (1, 8))
    for name in ("which", "growing", "amplitude", "frequency"):
        np.testing.assert_array_equal(getattr(alone.cycles, name), getattr(together.cycles, name), err_msg=name)


def test_of_100_flexible_joints_40_are_limit_cycles_under_mrac():
    """An independent program found that with a constant command and no noise 40 oscillate for ever and 60 come to rest."""
    source = CaseText.read(JOINT)
    draws = sampled(source, [("plant.theta", "known-set"), ("plant.input.gain", "uniform:0.6:1.4")])
    plan = Plan({}, draws, 100, Design.LATIN, 0)
    varied, numbers = VariedCase(source, plan.paths), np.arange(100)
    cases = [varied.at(row) for row in plan.values_for(numbers)]
    members = [(case.problem, case.controllers[0]) for case in cases]
    found = simulate_ensemble(members, cases[0].simulation, numbers=plan.streams_for(numbers), judge=Judge())
    assert np.isfinite(found.metrics.diverged_at).sum() == 0
    assert found.judged.count(Class.CYCLE) == 40
    assert found.judged.count(Class.LOST) == 0
    reversals = found.judged.kept.in_tail("reversals")[:, 0]
    cycling = found.judged.cycles.which[:, 0]
    assert reversals[cycling].min() > 3 * reversals[~cycling].max()


ARM = """
name = "Arm"
plant = { A = [[0.0, 1.0], [5.0, -1.0]], b = [0.0, 10.0], x0 = [0.1, 0.0], input = { saturation = [-3.0, 3.0], delay = %s, gain = %s } }
reference_model = { poles = [[-4.0, 3.0]], follow = "angle" }
uncertainty = { lower = [-1.0, -1.0], upper = [4.0, 2.0] }
labels = { names = ["angle", "rate"], units = ["rad", "rad/s"] }
reference = { kind = "square", amplitude = 0.5, frequency = 1.0 }
simulation = { t_end = 10.0, dt = 1e-3 }
controller = [{ scheme = "adrc", bandwidth = 25.0, sample_time = 0.01 }]
"""  # noqa: E501
"""A plant that is unstable by itself. With the long delay it swings from limit to limit, and its limits lose it sooner or
later."""


@pytest.mark.parametrize(("delay", "lost"), [(0.0707, True), (0.001, False)])
def test_what_is_lost_in_its_continuation_is_told(delay, lost):
    case = parse_case(ARM % (delay, 1.4613725744136374))
    (result,) = simulate(case.problem, case.controllers, case.simulation).values()
    assert result.verdict.kind is Class.OFF
    assert result.verdict.lost_when_held is result.verdict.as_json()["lost_when_held"] is lost
    assert [one.kind for one in result.findings if one.kind == "held"] == ["held"] * lost


def test_lost_samples_hide_no_limit_cycle():
    """Holding a lost sample in the continuation would open the loop, and the control would be constant. Here u moves from limit
    to limit."""
    lost = '\n[[faults]]\nkind = "dropout"\nchannel = "theta"\nshare = 0.02\nseed = 1\n'
    case = CaseText(JOINT.read_text("utf-8").replace("delay = 0.012", "delay = 0.032") + lost, JOINT.parent).case()
    (result,) = simulate(case.problem, [one for one in case.controllers if one.name == "MRAC"], case.simulation).values()
    assert result.verdict.kind is Class.CYCLE
    assert result.verdict.cycle.amplitude == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("swing", "cycle"),
    [
        ([2.0, 1.0, 1.0], True),
        ([0.5, 1.0, 1.3, 1.4, 1.42], True),  # on its way to a cycle
        ([1.0, 0.85, 0.85**2, 0.85**3], False),  # weakly damped
        ([1.0, 1.2, 1.44, 1.728], False),  # diverges slowly
        ([1.0, 0.9, 1.0, 0.95], True),  # beats
        ([1.0, 0.1, 0.01], False),
        ([0.02, 0.02, 0.02], False),  # below the band
    ],
)
def test_what_lasts(swing, cycle):
    swing = np.array(swing)[:, None, None]
    windows = Windows(swing, np.full_like(swing, 9.0), np.zeros(1, dtype=bool))
    assert windows.cycling(np.array([[0.05]]))[0, 0] == cycle


def test_a_drift_is_no_cycle_though_it_swings():
    windows = Windows(np.ones((3, 1, 1)), np.zeros((3, 1, 1)), np.zeros(1, dtype=bool))
    assert not windows.cycling(np.array([[0.05]])).any()


def test_signals_are_held_where_they_are_largest_with_their_sign():
    held = Held.of([Sine(2.0, 1.0), Square(1.5, 3.0), Constant(-0.7), Step(4.0, start=15.0), Clock()], 10.0, 20.0)
    np.testing.assert_allclose(np.abs(held.values[:4]), [2.0, 1.5, 0.7, 4.0], rtol=1e-5)
    assert (held.values[2], held.values[3]) == (-0.7, 4.0)
    assert np.isnan(held.values[4])
    assert held.turns > 0
    assert Held.of([Constant(1.0)], 0.0, 1.0).turns == 0
