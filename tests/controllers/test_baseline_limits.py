"""A baseline at the limits, with and without anti-windup, and a baseline that is computed by other code."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import BaselineAlone, L1Adaptive, Mrac, Plant, Problem, Sampled, Simulation, certify, input_filter, simulate
from barbalat.cases.load import parse_case
from barbalat.export.compiler import loaded, require_compiler, shared_library
from barbalat.export.in_the_loop import simulate_export
from barbalat.exports import export_controller
from barbalat.loop.packing import unflatten
from barbalat.plants import LqiBaseline, PiBaseline, PidBaseline, PlantInput
from barbalat.run.engine.simulate import recorded
from barbalat.signals import Constant, Steps
from barbalat.studies import replay
from independent import refusal

A, B, SPEED = np.array([[-0.5]]), np.array([2.0]), [1.0]
LIMIT, T_t = 0.6, 0.2
KINDS = {
    "pi": PiBaseline(k_p=1.0, k_i=2.0, output=SPEED, anti_windup=T_t),
    "pid": PidBaseline(k_p=1.0, k_i=2.0, k_d=0.05, T_f=0.05, output=SPEED, anti_windup=T_t),
    "lqi": LqiBaseline(Q=[1.0, 20.0], R=1.0, output=SPEED, anti_windup=T_t),
}
SIMULATION = Simulation(t_end=6.0, dt=1e-3, record_points=300)


def drive(baseline, reference=None, limit=LIMIT, **more):
    """A drive that can just reach its command after seconds at the limit."""
    plant = Plant(A=A, b=B, baseline=baseline, input=PlantInput(saturation=[-limit, limit]))
    return Problem(plant=plant, reference=reference or Constant(2.0), **more)


def by_textbook(kind, x, own, r):
    """u, the integral's part and the rates without anti-windup, by the definition of this kind with e = r - x."""
    e, given = r - x, KINDS[kind]
    if kind == "lqi":
        K = drive(given).plant.theta
        return -K @ [x, own[0]], np.array([e]), -1 / K[1]
    slope = (e - own[1]) / given.T_f if kind == "pid" else 0.0
    u = given.k_p * e + given.k_i * own[0] + (given.k_d * slope if kind == "pid" else 0.0)
    return u, np.array([e, slope] if kind == "pid" else [e]), 1 / given.k_i


@pytest.mark.parametrize("kind", KINDS)
def test_the_integral_is_tracked_back_as_in_the_textbook(kind):
    """In section 11.4 of Astrom and Murray the integral's part of u changes by (v - u)/T_t. SciPy integrates it with the
    plant."""
    problem = drive(KINDS[kind])
    run = simulate(problem, [BaselineAlone()], SIMULATION)["Baseline"]
    states = problem.plant.n - 1

    def rates(_, z):
        u, own, factor = by_textbook(kind, z[0], z[1:], 2.0)
        v = np.clip(u, -LIMIT, LIMIT)
        return np.concatenate([A[0] * z[0] + B * v, own + np.eye(states)[0] * factor * (v - u) / T_t])

    expected = solve_ivp(rates, (0.0, 6.0), np.zeros(1 + states), t_eval=run.t, method="DOP853", rtol=1e-10, atol=1e-12).y
    assert run.figures["max_abs_u"] > 1.5 * LIMIT
    np.testing.assert_allclose(run.x[:, 0], expected[0], atol=2e-4)  # the limit is left between two steps


@pytest.mark.parametrize("kind", KINDS)
def test_a_sampled_integral_is_tracked_back_in_kernels_with_open_numbers_too(kind):
    runs = [
        simulate(drive(KINDS[kind]), [Sampled(BaselineAlone(), 0.02)], replace(SIMULATION, fused=fused))["Baseline"]
        for fused in (True, False)
    ]
    assert runs[0].figures["max_abs_u"] > 1.5 * LIMIT
    np.testing.assert_allclose(runs[0].x, runs[1].x, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_it_spares_the_overshoot_and_changes_nothing_within_the_limits(kind):
    overshoot, within = {}, {}
    for one in (KINDS[kind], replace(KINDS[kind], anti_windup=None)):
        overshoot[one.anti_windup] = simulate(drive(one), [BaselineAlone()], SIMULATION)["Baseline"].x.max() - 2.0
        within[one.anti_windup] = simulate(drive(one, limit=1e3), [BaselineAlone()], SIMULATION)["Baseline"].x
    assert overshoot[T_t] < 0.3 * overshoot[None]
    np.testing.assert_allclose(within[T_t], within[None], atol=1e-12)


@pytest.mark.parametrize("external", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_the_exported_c_has_the_bits_of_the_simulation_at_the_limits(kind, external):
    problem = drive(replace(KINDS[kind], external=external), Steps(times=[0.0, 3.0], values=[2.0, -1.0]))
    for inner in (BaselineAlone(), Mrac(gamma=20.0), L1Adaptive(gamma=200.0, filter=input_filter(0.05))):
        controller = Sampled(inner, 0.02)
        origin = simulate(problem, [controller], SIMULATION)[controller.name]
        assert origin.figures["max_abs_u"] > 1.5 * LIMIT
        found = simulate_export(problem, controller, SIMULATION)
        assert not found.refused and not found.differs_from(origin)


def test_two_integrals_are_tracked_back_each_by_its_own_input():
    baseline = LqiBaseline(Q=np.ones(4), R=np.ones(2), output=np.eye(2), anti_windup=0.5)
    limited = PlantInput(saturation=[-1.0, 1.0])
    plant = Plant(A=[[-1.0, 0.5], [0.3, 0.2]], b=[[1.0, 0.2], [-0.3, 1.0]], baseline=baseline, input=[limited, limited])
    np.testing.assert_allclose(-plant.baseline.K[:, 2:] @ plant.baseline.W, np.eye(2) / 0.5, atol=1e-12)


EXTERNAL = drive(replace(KINDS["pi"], external=True, anti_windup=None), limit=50.0)


def test_who_computes_the_baseline_changes_no_more_than_roundings():
    computed = drive(replace(KINDS["pi"], anti_windup=None), limit=50.0)
    controllers = [Sampled(Mrac(gamma=20.0), 0.02), Sampled(BaselineAlone(), 0.02)]
    for name, run in simulate(EXTERNAL, controllers, SIMULATION).items():
        np.testing.assert_allclose(run.x, simulate(computed, controllers, SIMULATION)[name].x, atol=1e-12)


def test_a_flight_of_it_is_replayed_as_it_was_flown():
    controller = Sampled(Mrac(gamma=20.0), 0.02)
    run = recorded(EXTERNAL, controller, Simulation(t_end=4.0, dt=5e-3), 200)
    acting = [unflatten(run.loop.computer.initial(run.loop.at_first), state, 0)[0] for state in run.states]
    u = np.array([one.held.u.reshape(-1) for one in acting])
    found = replay(EXTERNAL, controller, 0.02 * np.arange(200), run.measured[:, :1], u, run.commands)
    np.testing.assert_allclose(found.theta_hat, [run.loop.theta_hat(one.controller) for one in acting], atol=1e-9)
    np.testing.assert_allclose(found.proposed, u, atol=1e-9)


ADAPTER = """
#include "controller.h"
void flown(int count, const double *x, const double *r, const double *u_baseline, double *u, double *within);
void flown(int count, const double *x, const double *r, const double *u_baseline, double *u, double *within)
{
    mrac_controller c;
    mrac_input in;
    mrac_output out;
    int k;
    mrac_init(&c);
    for (k = 0; k < count; ++k) {
        in.sample_time = MRAC_SAMPLE_TIME;
        in.freeze = 0;
        in.x[0] = x[k];
        in.x[MRAC_U_BASELINE] = u_baseline[k];
        in.r[0] = r[k];
        (void)mrac_step(&c, &in, &out);
        u[k] = out.u[0];
        within[k] = out.u_limited[0];
    }
}
"""


def test_an_existing_loop_of_its_own_code_is_heard(tmp_path):
    """The existing PI controller is a different rule, in Python. u is the sum of its output and the adaptive part, and the limits
    act on the sum."""
    compiler = require_compiler()
    folder = export_controller(EXTERNAL, Sampled(Mrac(gamma=20.0), 0.02), SIMULATION, out=tmp_path / "out")
    texts = {name: (folder / name).read_text() for name in ("controller.h", "controller.c")}
    assert "in.x[MRAC_U_BASELINE] = ..." in (folder / "README.md").read_text()
    flown = loaded(shared_library(compiler, texts | {"flown.c": ADAPTER})).flown
    x, r = np.linspace(0.0, 1.0, 60), np.full(60, 2.0)
    integral = np.cumsum(0.02 * (r - x))
    given = {"as it is": (r - x) + 2.0 * integral, "moved": (r - x) + 2.0 * integral + 3.0}
    u, within = ({name: np.zeros(60) for name in given} for _ in range(2))
    for name, u_baseline in given.items():
        flown(60, *(part.ctypes.data_as(ctypes.c_void_p) for part in (x, r, u_baseline, u[name], within[name])))
        np.testing.assert_array_equal(within[name], np.clip(u[name], -50.0, 50.0))
    assert u["as it is"][0] == given["as it is"][0]  # the law has not learnt anything yet
    assert u["moved"][0] == given["moved"][0]
    spoken = u["as it is"] - given["as it is"]
    assert np.abs(spoken[1:]).max() > 0.01


def test_a_baseline_that_says_nothing_is_a_lost_sample(tmp_path):
    texts = {
        name: (export_controller(EXTERNAL, Sampled(Mrac(gamma=20.0), 0.02), SIMULATION, out=tmp_path) / name).read_text()
        for name in ("controller.h", "controller.c")
    }
    flown = loaded(shared_library(require_compiler(), texts | {"flown.c": ADAPTER})).flown
    x, r, u_baseline = np.ones(3), np.full(3, 2.0), np.array([0.5, np.nan, 0.7])
    u, within = np.zeros(3), np.zeros(3)
    flown(3, *(part.ctypes.data_as(ctypes.c_void_p) for part in (x, r, u_baseline, u, within)))
    assert u[1] == u[0] == 0.5
    assert u[2] != u[1]


CASE = """
name = "drive"
[plant]
A = [[-0.5]]
b = [2.0]
[plant.input]
saturation = [-0.6, 0.6]
[baseline]
kind = "pi"
k_p = 1.0
k_i = 2.0
anti_windup = 0.2
external = true
[reference_model]
follow = "x_1"
[reference]
kind = "constant"
value = 2.0
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 20.0
sample_time = 0.02
"""


def test_a_case_file_says_the_same():
    case = parse_case(CASE)
    fixed = case.problem.fixed
    assert fixed.external
    np.testing.assert_array_equal(fixed.limits, [[-0.6], [0.6]])
    assert fixed.W[0, 0] == pytest.approx(1 / (2.0 * 0.2))
    assert case.problem.handed_names == ("x_1", "u_baseline")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "saturation = [-0.6, 0.6]",
            "delay = 0.01",
            "baseline.anti_windup acts at the input limits: give plant.input.saturation",
        ),
        ("anti_windup = 0.2", "anti_windup = 0.0", "baseline.anti_windup must be positive, got 0"),
        ("anti_windup = 0.2", "anti_windup = 0.01", "baseline.anti_windup must be at least the sample time of 0.02 s, got 0.01"),
        ("anti_windup = 0.2", 'anti_windup = "yes"', "anti_windup"),
        ("external = true", "external = 1", "external"),
        ('kind = "pi"\nk_p = 1.0\nk_i = 2.0', 'kind = "state"\nK = [1.0]', "anti_windup"),
        (
            "[simulation]",
            '[shell]\nlongest_outage = 0.1\nfallback = "baseline"\n[simulation]',
            "baseline.external = true leaves it to other code",
        ),
    ],
)
def test_bad_input_is_one_sentence(old, new, said):
    assert old in CASE

    def tried():
        case = parse_case(CASE.replace(old, new))
        simulate(case.problem, case.controllers, case.simulation)

    assert said in refusal(tried)


@pytest.mark.parametrize("target", ["fmu3", "rust", "ardupilot"])
def test_other_targets_say_which_one_takes_it(target, tmp_path):
    case = parse_case(CASE)
    given = case.problem, case.controllers[0], case.simulation
    assert f"the target c99 alone; got {target}" in refusal(lambda: export_controller(*given, out=tmp_path, target=target))
    assert "does not contain the existing loop" in refusal(lambda: export_controller(*given, out=tmp_path, closed_loop=True))
    assert not list(tmp_path.iterdir())


AT_A_LIMIT = """
name = "Motor"
[plant]
A = [[-2.0]]
b = [4.0]
[plant.input]
delay = 0.02
saturation = [-5.0, LIMIT]
[baseline]
kind = "pi"
k_p = 1.0
k_i = 2.0
ANTI_WINDUP
[reference_model]
follow = "x_1"
[reference]
kind = "constant"
amplitude = 1.0
[simulation]
t_end = 4.0
dt = 1e-3
[[controller]]
scheme = "baseline"
sample_time = 0.02
"""


@pytest.mark.parametrize("limit", ["0.2", "0.0"])
def test_the_linear_margins_ignore_anti_windup_where_u_rests_beyond_a_limit(limit):
    """At equilibrium under the command u is 0.5. A loop whose limit is lower than that has no linear loop."""
    margins = []
    for winds, at in (("anti_windup = 0.5", limit), ("", limit), ("anti_windup = 0.5", "5.0")):
        case = parse_case(AT_A_LIMIT.replace("LIMIT", at).replace("ANTI_WINDUP", winds))
        (found,) = certify(case.problem, case.controllers, case.simulation).values()
        margins.append(
            found.values["delay_margin_adapting"] if "delay_margin" not in found.values else found.values["delay_margin"]
        )
    assert margins[0] == pytest.approx(margins[1], rel=1e-9) == pytest.approx(margins[2], rel=1e-9)
