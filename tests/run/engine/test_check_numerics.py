"""The check at a finer step, for runs whose oscillation is known to come from the solver or from the loop, and for one that is
too expensive to check."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, simulate
from barbalat.cases.load import load_case
from barbalat.judge.verdict import Class
from barbalat.plants import PlantInput
from barbalat.report.documents import run_block
from barbalat.run.engine.settle import settle
from barbalat.run.results.step_comparison import FinerStep, label
from barbalat.signals import Constant, Steps
from barbalat.studies import check_numerics
from independent import refusal

PAPER = load_case("paper").problem


def checked(problem, controller, simulation, **options):
    (result,) = check_numerics(simulate(problem, [controller], simulation), **options).values()
    return result


def test_figure_3_is_the_solvers():
    result = checked(PAPER, L1Adaptive(gamma=1e4, filter=input_filter(0.02)), Simulation(t_end=20, dt=1e-4))
    assert result.label is not None
    assert result.check.origin == "solver"
    assert (result.check.dt, result.check.t_end) == (pytest.approx(1e-5), 20)
    assert (
        "the oscillation is due to the solver: at h = 1e-05 s the estimates' variation [1/s] in the tail falls from"
        in result.numerics
    )


def test_a_divergence_without_projection_is_the_solvers():
    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False)
    result = checked(PAPER, controller, Simulation(t_end=20, dt=1e-4))
    assert result.diverged_at is not None
    assert result.check.origin == "solver"
    assert "stays bounded" in result.check.sentence


def test_a_sound_run_has_no_check():
    result = checked(PAPER, Mrac(gamma=10.0), Simulation(t_end=5, dt=1e-4))
    assert result.label is None
    assert result.check is None


def delayed(delay):
    return replace(PAPER, plant=replace(PAPER.plant, input=PlantInput(delay=delay)), reference=Constant(50.0))


def test_an_oscillation_that_the_input_delay_makes_is_not_blamed_on_the_solver():
    # fast adaptation around a delay of 0.05 s oscillates at any step; at 1e-3 s the solver adds an oscillation
    controller, problem = L1Adaptive(gamma=10.0, filter=input_filter(0.02)), delayed(0.05)
    result = checked(problem, controller, Simulation(t_end=20, dt=1e-3))
    assert result.stiffness.unstable_from is not None and result.check.origin == "both"
    assert result.label is None and result.verdict.settled  # of the same class at both steps
    finest = simulate(problem, [controller], Simulation(t_end=20, dt=2e-5))["L1"]  # finer than the check's tolerance
    assert finest.label is None
    assert max(finest.figures["theta_hat_variation_rate"]) > 20  # more than a sweep of the box per second


def test_a_step_that_damps_the_loops_own_ringing():
    # just outside the region the tail is the same, but the method's damping has suppressed most of the path before it
    controller = L1Adaptive(gamma=1800.0, filter=input_filter(0.02))
    result = checked(PAPER, controller, Simulation(t_end=20, dt=1e-4))
    assert result.stiffness.unstable_from is not None and result.check.origin == "both"
    assert result.label is None and result.verdict.settled  # of the same class at both steps
    assert "the estimates' total path rises" in result.check.sentence
    assert "in the tail" not in result.check.sentence


def test_a_label_without_consequences():
    # a correct run with a label: it is the same at every step
    (sound,) = simulate(PAPER, [Mrac(gamma=10.0)], Simulation(t_end=10, dt=1e-4)).values()
    labelled = replace(sound, stiffness=replace(sound.stiffness, unstable_from=1.0))
    (result,) = check_numerics({"MRAC": labelled}).values()
    assert result.check.origin == "loop"
    assert "the same within 10 %" in result.check.sentence
    assert result.label is None and not any(finding.kind == "solver" for finding in result.findings)


@pytest.mark.parametrize("dt", [1e-4, 1e-3])
def test_a_divergence_that_the_plant_makes_is_the_loops(dt):
    # beyond theta = 12.5 [4, -3] the filtered loop is unstable in the limit of fast adaptation, and nothing bounds the estimates
    plant = Plant(A_m=PAPER.plant.A_m, b=PAPER.plant.b, theta=[80.0, -60.0], x0=[1.0, 1.0])
    problem = replace(PAPER, plant=plant, reference=Constant(1.0))
    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False)
    result = checked(problem, controller, Simulation(t_end=60, dt=dt))
    assert result.label is not None
    assert result.check.origin == "loop"
    assert "the loop itself diverges" in result.check.sentence


@pytest.mark.parametrize(("gamma", "dt"), [(1e6, 1e-4), (1e8, 1e-4), (1e10, 1e-4)])
def test_a_divergence_at_every_step_tried_is_never_called_the_loops(gamma, dt):
    # theory: within the known set the scheme is stable at any gain, so a divergence is due to the solver or not settled
    result = checked(PAPER, Mrac(gamma=gamma, projection=False), Simulation(t_end=5, dt=dt))
    assert result.diverged_at is not None
    assert result.check.origin in {"solver", "unsettled"}


def test_what_cannot_be_afforded_is_said():
    controller, simulation = L1Adaptive(gamma=1e4, filter=input_filter(0.02)), Simulation(t_end=20, dt=1e-4)
    result = checked(PAPER, controller, simulation, afforded_steps=100_000)
    assert result.check.origin == "unsettled"
    assert result.check.dt is None
    assert "2e+06 steps" in result.check.sentence  # ten times the run's 200,000


def test_a_part_of_the_run_is_compared_with_the_same_part():
    controller, simulation = L1Adaptive(gamma=1e4, filter=input_filter(0.02)), Simulation(t_end=20, dt=1e-4)
    result = checked(PAPER, controller, simulation, afforded_steps=1_000_000)
    assert result.check.origin == "solver"
    assert result.check.t_end == pytest.approx(10)
    assert "up to t = 10 s," in result.check.sentence


def test_a_step_that_is_far_too_coarse_is_refined_twice():
    result = checked(PAPER, L1Adaptive(gamma=1e6, filter=input_filter(0.02)), Simulation(t_end=5, dt=1e-4))
    assert result.check.origin == "solver"
    assert result.check.dt == pytest.approx(1e-6)


def test_progress_ends_at_one_and_never_falls():
    seen = []
    runs = simulate(PAPER, [L1Adaptive(gamma=1e4, filter=input_filter(0.02))], Simulation(t_end=5, dt=1e-4))
    check_numerics(runs, progress=seen.append)
    assert seen[-1] == 1
    assert (np.diff(seen) >= 0).all()


def test_a_burst_before_the_tail_is_judged_by_the_whole_run():
    """The tail shows only roundings. The burst's error is two hundred times the error at a finer step."""
    problem = Problem(
        plant=Plant(A_m=[[-50.0]], b=[1.0], theta=[3.0]),
        reference_model=ReferenceModel(k_0=50.0),
        reference=Steps(times=[0.0, 10.02, 10.27], values=[0.1, 300.0, 0.1]),
        uncertainty=ParameterBox(lower=[-5.0], upper=[5.0]),
    )
    result = checked(problem, Mrac(gamma=1e5), Simulation(t_end=60.0, dt=1e-3))
    (fine,) = simulate(problem, [Mrac(gamma=1e5)], Simulation(t_end=60.0, dt=1e-4)).values()
    assert result.figures["max_abs_e"][0] > 100 * fine.figures["max_abs_e"][0]
    assert result.figures["tail_max_abs_e"][0] < 1e-4
    assert result.check.origin == "solver"
    assert "max |e| over the run falls from" in result.check.sentence
    assert "max |e| in the tail" not in result.check.sentence  # roundings show nothing


def test_what_a_law_sampled_by_euler_steps_chatters_is_not_called_the_loops():
    """The steps of the law are refined together with the solver's, because a finer solver alone would show the same chatter."""
    controller = Sampled(controller=Mrac(gamma=2e-3), sample_time=1e-2, discretization="euler")
    result = checked(PAPER, controller, Simulation(t_end=20, dt=1e-3))
    assert result.label is not None
    assert result.check.origin == "solver"
    assert "the oscillation is due to the sampled law" in result.check.sentence
    (finer,) = simulate(PAPER, [controller], Simulation(t_end=20, dt=1e-4)).values()
    assert finer.figures["theta_hat_variation_rate"] == pytest.approx(result.figures["theta_hat_variation_rate"], rel=1e-3)


def test_what_is_no_result_is_refused():
    results = simulate(PAPER, [Mrac(gamma=10.0)], Simulation(t_end=0.1, dt=1e-3))
    assert "results by name, as simulate returns them, got Result" in refusal(lambda: check_numerics(results["MRAC"]))
    assert "must be a Result, got 3" in refusal(lambda: check_numerics({"MRAC": 3}))


ESCAPE = """
name = "escape"
[plant]
A_m = [[0.0, 1.0], [-2.0, -1.5]]
b = [0.3, 1.0]
theta = [0.8, -0.5]
[plant.regressor]
kind = "terms"
terms = ["x1*x2*x2*x2", "x1*abs(x1)"]
[reference_model]
k_0 = 1.5
[reference]
kind = "square"
amplitude = 2.0
frequency = 0.7
[uncertainty]
lower = [-2.0, -2.0]
upper = [2.0, 2.0]
[simulation]
t_end = 12.0
dt = 0.002
[[controller]]
name = "L1"
scheme = "l1"
gamma = 200.0
filter = { kappa = 0.05 }
"""


def test_no_solver_is_blamed_for_a_finite_escape(tmp_path):
    """The plant escapes in finite time. This time converges with the step, and the region of stability of every step is left just
    before it."""
    path = tmp_path / "escape.toml"
    path.write_text(ESCAPE)
    found = load_case(path)
    coarse = simulate(found.problem, found.controllers, found.simulation)
    assert "not settled" in coarse["L1"].label and "numerically unstable" not in coarse["L1"].label
    result = check_numerics(coarse, afforded_steps=100_000)["L1"]
    fine = simulate(found.problem, found.controllers, replace(found.simulation, dt=2e-4))["L1"]
    assert result.diverged_at == pytest.approx(fine.diverged_at, rel=1e-3)
    assert result.check.origin == "unsettled" and result.check.diverged_at == fine.diverged_at
    assert result.label == "diverges at t = 10.02 s, also at h = 0.0002 s: whether plant or solver causes it is not settled"
    block = run_block(result)
    assert block["label"] == result.label and "diverges at t = 10.018" in block["finer_step"]["sentence"]
    assert "numerically unstable" not in result.numerics


def test_a_divergence_that_a_finer_step_takes_away_is_the_solvers():
    check = FinerStep("solver", "the divergence is the solver's")
    assert label(2.6, 2.7, Class.LOST, check) == label(2.6, None, Class.OFF, check) == "numerically unstable from t = 2.6 s"
    assert "numerically unstable" not in label(2.6, 2.7, Class.LOST, FinerStep("loop", "the loop's own"))
    elsewhere = FinerStep("unsettled", "not settled", dt=1e-5, diverged_at=2.2)
    found = label(2.6, 2.7, Class.LOST, elsewhere)
    assert "also" not in found and "not settled" in found
    assert label(None, 2.7, Class.LOST, None) is None


def test_to_leave_the_region_is_no_verdict():
    """Without a finer step nothing is settled. If it finds the same class, the run is correct, and a different class is due to
    the solver."""
    assert "not settled" in label(2.6, None, Class.FOLLOWS, None)
    for origin in ("loop", "both"):
        assert label(2.6, None, Class.FOLLOWS, FinerStep(origin, "", kind=Class.FOLLOWS)) is None
        assert "numerically unstable" in label(2.6, None, Class.FOLLOWS, FinerStep(origin, "", kind=Class.OFF))


SAMPLED = """
name = "sampled"
[plant]
transfer_function = { num = [2.0], den = [1.0, -1.0] }
[plant.input]
saturation = [-20.0, 20.0]
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "square"
amplitude = 1.0
frequency = 1.0
[simulation]
t_end = 30.0
dt = 1e-3
[[controller]]
name = "Euler"
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = 5.0 }
theta_hat0 = [0.0, 1.0]
sample_time = 0.01
discretization = "euler"
"""


def test_a_sound_sampled_run_is_not_called_unstable(tmp_path):
    """The frozen discrete-time map has a spectral radius above 1, but the run follows the model, as with a tenth of the sample
    time."""
    path = tmp_path / "sampled.toml"
    path.write_text(SAMPLED)
    found = load_case(path)
    coarse = simulate(found.problem, found.controllers, found.simulation)
    assert coarse["Euler"].stiffness.radius_max > 1 and coarse["Euler"].verdict.settled is None
    result = check_numerics(coarse)["Euler"]
    assert result.label is None and result.verdict.settled
    assert str(result.verdict) == "follows within 4.3 %"
    assert "numerically unstable" not in result.numerics


def test_what_is_not_examined_is_a_finding():
    """The step damps motions that it does not resolve. A finer step with the same class removes the finding."""
    coarse = simulate(PAPER, Mrac(gamma=1.0), Simulation(t_end=20, dt=1e-3))
    assert coarse["MRAC"].stiffness.unstable_from is None and coarse["MRAC"].verdict.settled is None
    assert any("was not tried" in finding.sentence for finding in coarse["MRAC"].findings)
    settled = settle(coarse)["MRAC"]
    assert settled.verdict.settled and not any(finding.kind in ("solver", "damping") for finding in settled.findings)
