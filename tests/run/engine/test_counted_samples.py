"""The samples that a run reports as missed, compared with an independent count from its random faults."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from barbalat import Mrac, Sampled, Simulation, simulate
from barbalat.cases.load import load_case
from barbalat.problem.faults import Dropout, Jitter, Spike, Stuck
from barbalat.problem.shell import Shell
from barbalat.run.engine.settle import halved
from barbalat.run.engine.simulate import with_missed_samples
from barbalat.signals import Step

PROBLEM = load_case("first-order").problem
T, LONGEST = 0.02, 0.06
SHELL = Shell(longest_outage=LONGEST, fallback="zero")


def missed(problem, dt=0.002, t_end=4.0):
    controller = Sampled(Mrac(gamma=5.0), T)
    return with_missed_samples(simulate(problem, [controller], Simulation(t_end=t_end, dt=dt)))["MRAC"]


@pytest.mark.parametrize(
    "fault", [Dropout(share=0.3, seed=4), Dropout(share=0.2, burst=0.1, seed=2), Dropout(times=[[1.0, 1.5]])]
)
@pytest.mark.parametrize("dt", [0.02, 0.01, 0.004])
def test_lost_samples_are_those_of_the_draw(fault, dt):
    run = missed(replace(PROBLEM, shell=SHELL, faults=(fault,)), dt)
    lost = fault.there(T * np.arange(200), 0)
    runs = [len(list(same)) for gone, same in groupby(lost) if gone]
    allowed = round(LONGEST / T)
    expected = (200, lost.sum(), max(runs), sum(max(0, one - allowed) for one in runs))
    found = run.missed
    assert (found.samples, found.missed, found.in_a_row, found.fallback) == expected
    assert run.findings[0].sentence == found.sentence
    assert found.sentence.startswith(f"{100 * lost.sum() / 200:.2g} % of the 200 samples were lost or rejected by the shell")


def test_calls_of_a_jittered_timer_are_counted_once():
    """Every call is on time for a shell without a band, so only the random losses are counted as missed, at the instants of the
    calls."""
    faults = (Dropout(times=[[1.0, 1.51]]), Jitter(time=T / 4, seed=1))
    run = missed(replace(PROBLEM, shell=SHELL, faults=faults), dt=0.0005)
    assert run.missed.samples == 200 and 25 <= run.missed.missed <= 26
    assert "rounded to solver steps" not in run.missed.sentence
    coarse = missed(replace(PROBLEM, shell=SHELL, faults=faults), dt=0.0025)
    assert "the timer's jitter is only 2 steps: use a smaller dt" in coarse.missed.sentence
    assert halved({"MRAC": coarse})["MRAC"].half_step is None  # its calls would be different


def test_what_the_shell_refuses_is_counted():
    run = missed(replace(PROBLEM, shell=replace(SHELL, rate={PROBLEM.measured_names[0]: 1e-3})))
    assert run.missed.missed > 150 and run.missed.fallback > 100
    assert "the fallback (zero) acted" in run.missed.sentence


CHANNEL = PROBLEM.measured_names[0]


@pytest.mark.parametrize(
    ("shell", "refused"),
    [
        (None, ()),
        (Shell(), ()),
        (Shell(range={CHANNEL: [-1e3, 1e3]}), (Spike(channel=CHANNEL, size=1e4, share=0.1, seed=2),)),
        (Shell(stuck={CHANNEL: T}), (Stuck(channel=CHANNEL, times=[[0.5, 0.9]]),)),
    ],
)
def test_without_a_longest_outage_lost_and_refused_samples_are_counted(shell, refused):
    """A spike is out of range. If a sensor is stuck for 20 samples, the first repetition is accepted."""
    fault = Dropout(share=0.3, seed=4)
    run = missed(replace(PROBLEM, shell=shell, faults=(fault, *refused)), t_end=2.0)
    at, lost = T * np.arange(100), fault.there(T * np.arange(100), 0)
    if refused and refused[0].kind == "spike":
        lost = lost | refused[0].there(at, 1)
        assert lost.sum() > fault.there(at, 0).sum()
    elif refused:
        repeats = np.flatnonzero(refused[0].there(at, 1) & ~lost)
        lost = lost | np.isin(np.arange(100), repeats[1:])
    runs = [len(list(same)) for gone, same in groupby(lost) if gone]
    assert (run.missed.samples, run.missed.missed, run.missed.in_a_row, run.missed.fallback) == (100, lost.sum(), max(runs), 0)
    assert run.findings[0].sentence == run.missed.sentence


def test_a_run_without_a_shell_has_no_such_count():
    assert missed(PROBLEM).missed is None


def test_a_run_by_tolerance_is_not_counted():
    problem = replace(PROBLEM, faults=(Jitter(time=T / 8, seed=1),))
    runs = simulate(problem, [Sampled(Mrac(gamma=5.0), T)], Simulation(t_end=0.5, tolerance=1e-6))
    assert with_missed_samples(runs)["MRAC"].missed is None


def test_a_refused_command_is_held_until_its_size_may_have_been_reached():
    """With 2 per second and a sample time of 0.02 s, a step of 1 is accepted at the 25th sample and held at 0 until then. A
    command beyond its range is never accepted."""
    step = replace(PROBLEM, reference=Step(amplitude=1.0, start=1.0))
    run = missed(replace(step, shell=Shell(rate={"command": 2.0})))
    assert (run.missed.missed, run.missed.commands) == (0, 24)
    assert run.missed.sentence == "12 % of the 200 commands were lost or rejected by the shell; the last good one was held"
    late = missed(replace(PROBLEM, reference=Step(amplitude=1.0, start=1.48)))
    np.testing.assert_array_equal(run.u, late.u)
    never = missed(replace(step, shell=Shell(range={"command": [-0.5, 0.5]})))
    assert never.missed.commands == 150
    np.testing.assert_array_equal(never.u[run.t < 1.0], run.u[run.t < 1.0])
