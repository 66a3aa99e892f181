"""The limits of gain and step compared with simulation. For the |x| under the command they agree within 10 to 20 %.

A run's label (``Result.label``) comes from the spectrum of the exact Jacobian along the run, but the limits come from a frozen
oscillator. The factors are 0.8 and 1.1 because |x| exceeds |x_m| in the first seconds and the oscillator neglects other modes of
the frozen loop.
"""

import math

import pytest

from barbalat import DirectMrac, L1Adaptive, Mrac, MracClosedLoop, NormalizedMrac, Sampled, certify, input_filter, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.cells import COUNTS_ON_DAMPING, limits_text
from barbalat.laws import Gradient
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.solvers import EULER, HEUN, RK4
from barbalat.solvers.simulation import Simulation

T_END = 15.0  # s; a period of the command is 12.6 s, so |x_m| has reached its maximum
SCHEMES = {
    "mrac": Mrac(gamma=10.0),
    "closed-loop model": MracClosedLoop(gamma=10.0, model_feedback=[[-1.0, 0.0], [0.0, -1.0]]),
    "direct": DirectMrac(gamma=5.0, gamma_r=2.0),
    "l1": L1Adaptive(gamma=100.0, filter=input_filter(0.02)),
    "normalised": NormalizedMrac(law=Gradient(gamma=50.0)),
}


def at_step(solver, dt):
    return Simulation(t_end=math.ceil(T_END / dt) * dt, dt=dt, solver=solver)


def limits(controller, solver, dt=1e-3):
    (found,) = certify(variant(), [controller], at_step(solver, dt)).values()
    return found.values


def labelled(controller, solver, dt):
    (run,) = simulate(variant(), [controller], at_step(solver, dt)).values()
    return run.label is not None or run.diverged_at is not None


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("solver", [HEUN, RK4], ids=["heun", "rk4"])
@pytest.mark.short(kept=lambda solver, name: solver is RK4 or name == "l1")
def test_the_step_at_which_a_run_leaves_the_region(solver, name):
    controller = SCHEMES[name]
    found = limits(controller, solver)
    at_least, seen = found["step_max"], found.get("step_max_at_model", found["step_max"])
    assert at_least <= seen
    assert not labelled(controller, solver, 0.8 * seen)
    assert labelled(controller, solver, 1.1 * seen)


def test_the_step_of_eulers_method():
    """The method tolerates an oscillation only if it is damped. The adaptation is slow, and the run is long because the growth is
    slow too."""
    controller = Mrac(gamma=1e-5)
    found = limits(controller, EULER)
    for dt, expected in ((0.9 * found["step_max"], False), (1.1 * found["step_max_at_model"], True)):
        simulation = Simulation(t_end=math.ceil(1000.0 / dt) * dt, dt=dt, solver=EULER)
        (run,) = simulate(variant(), [controller], simulation).values()
        assert (run.label is not None) == expected


@pytest.mark.parametrize("name", ["mrac", "l1"])
def test_the_gain_above_which_oscillations_are_due(name):
    dt = 1e-3
    found = limits(SCHEMES[name], RK4, dt)
    at_least, seen = found["gamma_max"], found["gamma_max_at_model"]
    assert at_least < seen

    def with_gain(gamma):
        return Mrac(gamma=gamma) if name == "mrac" else L1Adaptive(gamma=gamma, filter=input_filter(0.02))

    assert not labelled(with_gain(0.8 * seen), RK4, dt)  # 0.8 and 1.2, as the limit depends on the square root of the gain
    assert labelled(with_gain(1.2 * seen), RK4, dt)


OFF_THETA = """
name = "off theta"
[plant]
A_m = [[0.0, 1.0], [-2.0, -1.5]]
b = [0.3, 1.0]
theta = [0.8, -0.5]
[reference_model]
k_0 = 1.5
[reference]
kind = "square"
amplitude = 2.0
frequency = 0.7
[simulation]
t_end = 20.0
dt = 0.001
solver = "heun"
[[controller]]
name = "M"
scheme = "mrac"
gamma = 2000.0
"""


def test_a_limit_that_counts_on_damping_is_no_least_one(tmp_path):
    """Heun's method amplifies every undamped oscillation. theta_hat - theta changes the real part of the frozen loop's mode from
    -0.35/s to +0.13/s."""
    path = tmp_path / "case.toml"
    path.write_text(OFF_THETA)
    case = load_case(path)
    (heun,) = certify(case.problem, case.controllers, case.simulation).values()
    dt = T_END_OFF_THETA / math.ceil(T_END_OFF_THETA / (0.9 * heun.values["step_max"]))
    (run,) = simulate(case.problem, case.controllers, Simulation(t_end=T_END_OFF_THETA, dt=dt, solver=HEUN)).values()
    assert run.label is not None
    (rk4,) = certify(case.problem, case.controllers, Simulation(t_end=T_END_OFF_THETA, dt=1e-3)).values()
    sampled = Sampled(controller=case.controllers[0], sample_time=1e-3, discretization="euler")
    (euler,) = certify(case.problem, sampled, case.simulation).values()
    for found, sure in ((heun, False), (euler, False), (rk4, True)):
        tuning = limits_text(found)
        assert ("at least" in tuning) == sure and ("damping" in tuning) != sure
        for key in ("gamma_max", "step_max"):
            entry = found.entry(key)
            assert ("at least" in entry.meaning) == sure and (COUNTS_ON_DAMPING in entry.assumptions) != sure


T_END_OFF_THETA = 20.0  # s
