"""Verdicts at a finer step, against runs of all members with that step."""

from dataclasses import replace

import numpy as np

from barbalat.cases.load import load_case
from barbalat.run.ensemble import simulate_ensemble
from barbalat.solvers.simulation import Simulation
from barbalat.study.finer_step import FINER_BY, drawn, rejudged


def test_verdicts_at_a_finer_step_are_those_of_runs_with_it():
    """From a large initial state the law turns too fast for the coarse step, by h sqrt(gamma) x_0, and not for the finer one."""
    case = load_case("first-order")
    problem, mrac = case.problem, case.controllers[0]
    members = [(replace(problem, plant=replace(problem.plant, x0=[x0])), mrac) for x0 in np.linspace(0.1, 12.0, 24).tolist()]
    coarse = Simulation(t_end=20.0, dt=0.5)
    fine = Simulation(t_end=20.0, dt=0.5 / FINER_BY)

    def metrics(simulation):
        return simulate_ensemble(members, simulation).metrics

    def judge(places, found):
        assert len(places) == len(found.max_abs_u)
        return ~(found.max_abs_e[:, 0] < 13.0)

    before, after = (judge(np.arange(24), metrics(one)) for one in (coarse, fine))
    found = rejudged(members, coarse, before, judge, count=20, seed=3)
    assert found.after.tolist() == after[found.chosen].tolist() and found.before.tolist() == before[found.chosen].tolist()
    assert found.changed > 0 and "artefacts of the solver" in found.sentence
    assert found.changed == (before != after)[found.chosen].sum() and f"of {len(found.chosen)} members" in found.sentence


def test_half_of_those_drawn_are_counted_as_far_as_there_are():
    counted = np.arange(100) < 30
    assert (drawn(counted, 20, 0) < 30).sum() == 10
    assert (drawn(np.arange(100) < 4, 20, 0) < 4).sum() == 4
    assert (drawn(np.arange(100) < 98, 20, 0) < 98).sum() == 18
    chosen = drawn(counted, 20, 0, [7, 99])
    assert {7, 99} <= set(chosen.tolist()) and len(set(chosen.tolist())) == 20 and (np.diff(chosen) > 0).all()
    assert drawn(counted, 20, 0).tolist() == drawn(counted, 20, 0).tolist() != drawn(counted, 20, 1).tolist()
    assert drawn(counted, 100, 0).tolist() == list(range(100))
