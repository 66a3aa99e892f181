"""The part of an error that is due to the solver, estimated with half of the step and compared with runs at far smaller steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Simulation, simulate
from barbalat.cases.load import load_case
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class
from barbalat.run.engine.settle import halved
from barbalat.run.results.findings import together
from barbalat.run.results.half_step import HalfStep
from barbalat.solvers import EULER, RK4

CASE = load_case("first-order")


def found(simulation, judge=None):
    (controller,) = CASE.controllers[:1]
    return halved(simulate(CASE.problem, [controller], simulation, judge=judge))[controller.name]


def test_what_is_the_solvers_is_what_a_far_smaller_step_leaves_out():
    """For Euler's method, to first order, the extrapolation from half of the step is within a tenth of the solver's error."""
    run, exact = found(Simulation(t_end=4.0, dt=0.005, solver=EULER)), found(Simulation(t_end=4.0, dt=1e-3, solver=RK4))
    i = CASE.problem.measured_names.index(run.half_step.component)
    truly = run.figures["tail_max_abs_e"][i] - exact.figures["tail_max_abs_e"][i]
    assert abs(truly) > 0.1 * run.half_step.band
    assert run.half_step.of_the_solver == pytest.approx(truly, rel=0.1)
    assert [finding.kind for finding in run.findings].count("half step") == 1
    assert exact.half_step.sentence is None and "half step" not in [finding.kind for finding in exact.findings]


def test_a_verdict_that_half_the_step_changes_is_not_settled():
    coarse = found(Simulation(t_end=4.0, dt=0.005, solver=EULER)).half_step
    between = 0.5 * (coarse.coarse + coarse.fine)
    run = found(Simulation(t_end=4.0, dt=0.005, solver=EULER), Judge(follows={coarse.component: between}))
    assert run.half_step.decides and run.verdict.settled is False
    assert f"where the verdict is *{run.half_step.kinds[1]}*" in run.half_step.sentence


def test_what_takes_too_long_is_not_run_and_then_the_lost_order_is_said():
    (controller,) = CASE.controllers[:1]
    results = simulate(CASE.problem, [controller], Simulation(t_end=1.0, dt=0.01))
    assert halved(results, afforded_steps=199)[controller.name].half_step is None
    assert halved(results, afforded_steps=200)[controller.name].half_step is not None


def test_sentences():
    kept = HalfStep("speed", 0.6954, 0.6382, 1, 0.149, (Class.OFF, Class.OFF))
    said = "about 16 % of the error of speed in the tail is due to the solver: 0.6954 at this step, 0.6382 at half of it"
    assert kept.sentence == said
    hidden = replace(kept, coarse=0.6382, fine=0.6954)
    assert hidden.sentence.startswith("the solver hides about 18 % of the error of speed in the tail: 0.6382 at this step")
    assert replace(kept, fine=0.69).sentence is None
    assert "diverges at half the step" in replace(kept, fine=np.nan).sentence
    (controller,) = CASE.controllers[:1]
    run = next(iter(simulate(CASE.problem, [controller], Simulation(t_end=1.0, dt=0.01)).values()))
    findings = [one for one in replace(run, half_step=kept).findings if one.kind == "half step"]
    told = together({"one": findings, "other": findings})
    assert [(one.owners, one.text) for one in told] == [(("one",), said), (("other",), said)]
