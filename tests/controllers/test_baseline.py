"""A baseline with laws that add to it, compared with SciPy, with python-control's formulas by hand and with statements of
Lavretsky and Wise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from barbalat import (
    Adrc,
    BaselineAlone,
    DirectMrac,
    InputError,
    L1Adaptive,
    LinearFeedback,
    Mrac,
    MracClosedLoop,
    ParameterBox,
    Plant,
    Problem,
    RobustMrac,
    Sampled,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    load_case,
    simulate,
)
from barbalat.cases.load import parse_case
from barbalat.export.in_the_loop import simulate_export
from barbalat.laws import FixedSigma, LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import (
    LqiBaseline,
    LqrBaseline,
    PiBaseline,
    PidBaseline,
    PlantInput,
    StateBaseline,
    SystemBaseline,
    Truth,
)
from barbalat.signals import Sine
from independent import refusal, symbols_against_numbers

A, B = np.array([[-1.0, 0.9], [4.0, -1.2]]), np.array([0.0, -12.0])
ALPHA = [1.0, 0.0]
BASELINES = {
    "lqi": LqiBaseline(Q=[1.0, 0.5, 20.0], R=1.0, output=ALPHA),
    "lqr": LqrBaseline(Q=[1.0, 0.5], R=1.0, output=ALPHA),
    "state": StateBaseline(K=[-2.0, -1.0], output=ALPHA),
    "pi": PiBaseline(k_p=-1.0, k_i=-1.0, output=ALPHA),
    "pid": PidBaseline(k_p=-1.0, k_i=-1.0, k_d=-0.2, T_f=0.05, output=ALPHA),
    "system": SystemBaseline(TransferFunction([-1.0, -2.0], [0.01, 1.0]), output=ALPHA),
}
COMMAND = Sine(amplitude=0.1, frequency=1.3)
SIMULATION = Simulation(t_end=8.0, dt=1e-3)


def posed(kind, **more):
    plant = Plant(A=A, b=B, x0=[0.02, -0.01], baseline=BASELINES[kind], input=more.pop("input", None))
    departure = ParameterBox(lower=[-0.4, -0.2], upper=[0.4, 0.2])
    return Problem(plant=plant, reference=COMMAND, uncertainty=plant.baseline.around_nominal(departure), **more)


def controllers(n):
    law = LeastSquares(covariance0=10.0)
    return [
        BaselineAlone(), Mrac(gamma=20.0), L1Adaptive(gamma=200.0, filter=input_filter(0.05)), DirectMrac(gamma=20.0),
        MracClosedLoop(gamma=20.0, model_feedback=-np.eye(n)), RobustMrac(tau=0.1, law=law),
        LinearFeedback(TransferFunction([1.0, 1.0], [1.0, 0.0])),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", BASELINES)
def test_on_the_nominal_plant_every_loop_is_the_model(kind):
    """The laws have nothing to learn, so e stays at the roundings of 8,000 steps and the estimates stay at the baseline's
    gains."""
    problem = posed(kind)
    found = simulate(problem, controllers(problem.plant.n), SIMULATION)
    moved = np.abs(found["Baseline"].x_m).max()
    assert moved > 0.01
    for name, run in found.items():
        assert max(run.figures["max_abs_e"]) < 1e-11 * moved, name
    for name in ("MRAC", "L1"):
        np.testing.assert_allclose(found[name].theta_hat - problem.plant.theta, 0.0, atol=1e-9)


def off_nominal(kind):
    """A plant that differs from the nominal one by theta and has half of the input effectiveness."""
    truth = Truth(A=A + np.outer(B, [0.3, -0.1]), b=0.5 * B)
    return posed(kind, truth=truth, input_gain=(0.4, 1.5))


def by_hand(kind, x, xi, r):
    """u of the baseline and xi' by the definition of its kind."""
    K, e = BASELINES[kind], r - x[0]
    if kind == "pi":
        return K.k_p * e + K.k_i * xi[0], np.array([e])
    if kind == "pid":
        slope = (e - xi[1]) / K.T_f
        return K.k_p * e + K.k_i * xi[0] + K.k_d * slope, np.array([e, slope])
    if kind == "system":  # (-s - 2)/(0.01 s + 1) = -100 + 98/(0.01 s + 1)
        return -100.0 * e + 98.0 * xi[0], (e - xi) / 0.01
    if kind == "state":  # c'x = r at equilibrium with u = k_r r - K'x
        K = np.array([-2.0, -1.0])
        return r / (np.array(ALPHA) @ np.linalg.solve(np.outer(B, K) - A, B)) - K @ x, np.zeros(0)
    raise AssertionError(kind)


@pytest.mark.parametrize("kind", ["state", "pi", "pid", "system"])
def test_the_baseline_alone_is_the_controller_by_its_definition(kind):
    """SciPy integrates plant and controller off the nominal plant, where nothing cancels."""
    problem = off_nominal(kind)
    run = simulate(problem, [BaselineAlone()], replace(SIMULATION, record_points=200))["Baseline"]
    own = problem.plant.n - 2

    def rates(t, z):
        u, xi_dot = by_hand(kind, z[:2], z[2:], float(COMMAND(np.array(t))))
        return np.concatenate([problem.truth.A @ z[:2] + problem.truth.b * u, xi_dot])

    start = np.concatenate([[0.02, -0.01], np.zeros(own)])
    expected = solve_ivp(rates, (0.0, 8.0), start, t_eval=run.t, method="DOP853", rtol=1e-11, atol=1e-13).y[:2].T
    np.testing.assert_allclose(run.x, expected, atol=1e-8)


@pytest.mark.parametrize("kind", ["lqi", "lqr"])
def test_the_optimal_gains_place_the_hamiltonians_stable_eigenvalues(kind):
    baseline = BASELINES[kind]
    plant = Plant(A=A, b=B, baseline=baseline)
    A_z, b_z = (A, B) if kind == "lqr" else (np.block([[A, np.zeros((2, 1))], [-np.array([ALPHA]), 0.0]]), np.append(B, 0.0))
    H = np.block([[A_z, -np.outer(b_z, b_z)], [-np.diag(baseline.Q), -A_z.T]])
    stable = sorted(value for value in np.linalg.eigvals(H) if value.real < 0)
    np.testing.assert_allclose(sorted(np.linalg.eigvals(plant.A_m)), stable, rtol=1e-8)
    np.testing.assert_allclose(plant.A[: len(A), : len(A)], A, atol=1e-12)


def test_integral_action_leaves_no_error_beside_a_constant_disturbance_that_state_feedback_tolerates():
    from barbalat.signals import Constant

    rest = Simulation(t_end=40.0, dt=1e-2)
    left = {}
    for kind in ("lqi", "lqr"):
        problem = replace(posed(kind), reference=Constant(0.1), disturbance=Constant(0.05))
        left[kind] = simulate(problem, [BaselineAlone()], rest)["Baseline"].x[-1, 0] - 0.1
    assert abs(left["lqi"]) < 1e-8
    assert abs(left["lqr"]) > 1e-2


def test_a_sampled_baseline_is_its_recursion():
    """The integral of the measurement is by the trapezoidal rule under the held command, and the plant moves by its
    exponential."""
    problem, T = off_nominal("lqi"), 0.05
    run = simulate(problem, [Sampled(BaselineAlone(), T)], replace(SIMULATION, record_points=161))["Baseline"]
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = problem.truth.A, problem.truth.b
    ahead = expm(whole * T)
    K, x, xi = problem.plant.theta, np.array([0.02, -0.01]), 0.0
    states = [x]
    for k in range(160):
        r = float(COMMAND(np.array(k * T)))
        u = -K @ np.append(x, xi)
        following = ahead[:2, :2] @ x + ahead[:2, 2] * u
        xi += T * (r - (x[0] + following[0]) / 2)
        x = following
        states.append(x)
    np.testing.assert_allclose(run.x[:: (len(run.t) - 1) // 160], np.array(states), atol=1e-9)


def test_mrac_around_lqi_against_scipy():
    problem = replace(off_nominal("lqi"), input_gain=None, truth=Truth(A=A + np.outer(B, [0.3, -0.1])))
    run = simulate(problem, [Mrac(gamma=20.0, projection=False)], replace(SIMULATION, record_points=200))
    A_m, b, P = problem.plant.A_m, problem.plant.b, problem.known.P

    def rates(t, y):
        x, xi, z_m, theta_hat, r = y[:2], y[2], y[3:6], y[6:], float(COMMAND(np.array(t)))
        z = np.append(x, xi)
        return np.concatenate(
            [problem.truth.A @ x - B * (theta_hat @ z), [r - x[0]], A_m @ z_m + [0.0, 0.0, r], 20.0 * ((z - z_m) @ P @ b) * z]
        )

    start = np.concatenate([[0.02, -0.01, 0.0] * 2, problem.plant.theta])
    expected = solve_ivp(rates, (0.0, 8.0), start, t_eval=run["MRAC"].t, method="DOP853", rtol=1e-11, atol=1e-13).y
    np.testing.assert_allclose(run["MRAC"].x, expected[:2].T, atol=1e-9)
    np.testing.assert_allclose(run["MRAC"].theta_hat, expected[6:].T, atol=1e-8)


@pytest.mark.parametrize("kind", ["lqi", "pid"])
def test_symbols_are_numbers(kind):
    problem = off_nominal(kind)
    for controller in (Mrac(gamma=20.0), L1Adaptive(gamma=200.0, filter=input_filter(0.05)), DirectMrac(gamma=20.0)):
        symbols_against_numbers(ClosedLoop.of(problem, controller), size=3.0)


def test_l1_filters_what_adapts_and_not_the_baseline():
    """With a filter that passes almost nothing, the loop is the loop of the baseline alone. If the baseline were filtered too,
    L1-AC would not stabilise this plant."""
    problem = off_nominal("lqi")
    runs = simulate(problem, [L1Adaptive(gamma=20.0, filter=input_filter(1e6)), BaselineAlone()], SIMULATION)
    np.testing.assert_allclose(runs["L1"].x, runs["Baseline"].x, atol=1e-5)


@pytest.mark.parametrize("kind", ["lqi", "lqr", "pid"])
def test_bounds_hold_over_the_known_set(kind):
    bounded = posed(kind)
    given = [Mrac(gamma=20.0), L1Adaptive(gamma=2000.0, filter=input_filter(0.01)), BaselineAlone()]
    for departure in ([0.4, 0.2], [-0.4, 0.2], [0.1, -0.2]):
        theta = bounded.plant.theta.copy()
        theta[:2] += np.array(departure) * (1 - 1e-9)
        problem = replace(bounded, plant=replace(bounded.plant, theta=theta))
        found, runs = certify(problem, given, SIMULATION), simulate(problem, given, SIMULATION)
        for name in ("MRAC", "L1"):
            assert "error_bound" in found[name].guaranteed
            assert max(runs[name].figures["max_abs_e"]) <= found[name].values["error_bound"]
        if "error_bound" in found["Baseline"].guaranteed:
            assert max(runs["Baseline"].figures["max_abs_e"]) <= found["Baseline"].values["error_bound"]


def test_the_margin_is_that_of_the_loop_with_the_integral_in_it():
    problem = posed("lqi")
    K, A_z, b_z = problem.plant.theta, problem.plant.A, problem.plant.b
    w = np.geomspace(1e-2, 1e3, 400_001)
    L = np.array([K @ np.linalg.solve(1j * one * np.eye(3) - A_z, b_z) for one in w[::100]])
    crossing = np.flatnonzero((np.abs(L[:-1]) >= 1) & (np.abs(L[1:]) < 1))[-1]
    phase = np.mod(np.angle(L[crossing]) + np.pi, 2 * np.pi)
    for controller in (BaselineAlone(), Mrac(gamma=20.0), L1Adaptive(gamma=200.0, filter=input_filter(0.05))):
        (found,) = certify(problem, [controller], SIMULATION).values()
        assert found.values["delay_margin"] == pytest.approx(phase / w[::100][crossing], rel=0.01)
    sampled = certify(problem, [Sampled(BaselineAlone(), 1e-3)], SIMULATION)["Baseline"].values["delay_margin"]
    assert sampled == pytest.approx(phase / w[::100][crossing] - 0.5e-3, rel=0.01)


@pytest.mark.parametrize("kind", ["lqi", "pid"])
def test_the_exported_c_has_the_bits_of_the_simulation(kind):
    problem = replace(off_nominal(kind), plant=replace(posed(kind).plant, input=PlantInput(saturation=[-0.2, 0.2])))
    for inner in (BaselineAlone(), Mrac(gamma=20.0), L1Adaptive(gamma=200.0, filter=input_filter(0.05))):
        controller = Sampled(inner, 0.02)
        found = simulate_export(problem, controller, SIMULATION)
        assert not found.refused and not found.differs_from(simulate(problem, [controller], SIMULATION)[controller.name])


def test_two_inputs_with_two_integrals():
    A_2, B_2 = np.array([[-1.0, 0.5], [0.3, 0.2]]), np.array([[1.0, 0.2], [-0.3, 1.0]])
    plant = Plant(A=A_2, b=B_2, baseline=LqiBaseline(Q=np.ones(4), R=np.ones(2), output=np.eye(2)))
    problem = Problem(plant=plant, reference=(Sine(0.5, 1.0), Sine(0.3, 0.4)), truth=Truth(A=A_2 + 0.3 * B_2))
    runs = simulate(problem, [Mrac(gamma=200.0), BaselineAlone()], Simulation(t_end=30.0, dt=5e-3))
    assert plant.n == 4 and runs["MRAC"].x.shape[1] == 2
    assert max(runs["MRAC"].figures["tail_max_abs_e"]) < 0.3 * max(runs["Baseline"].figures["tail_max_abs_e"])


CASE = """
name = "baseline"
[plant]
A = [[-1.0, 0.9], [4.0, -1.2]]
b = [0.0, -12.0]
[baseline]
kind = "lqi"
Q = [1.0, 0.5, 20.0]
R = 1.0
[reference_model]
follow = "x_1"
[reference]
kind = "sine"
amplitude = 0.1
frequency = 1.3
[uncertainty]
lower = [-0.4, -0.2]
upper = [0.4, 0.2]
input_gain = [0.5, 1.5]
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 20.0
sample_time = 0.01
"""


def test_a_case_file_says_the_same_and_adds_the_baseline_alone():
    case = parse_case(CASE)
    assert [one.name for one in case.controllers] == ["MRAC", "Baseline"]
    assert case.controllers[1].sample_time == 0.01
    np.testing.assert_array_equal(case.problem.plant.A_m, posed("lqi").plant.A_m)
    np.testing.assert_array_equal(case.problem.uncertainty.lower, posed("lqi").uncertainty.lower)
    own = parse_case(CASE + '[[controller]]\nscheme = "baseline"\nname = "as it flies"\n')
    assert [one.name for one in own.controllers] == ["MRAC", "as it flies"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('follow = "x_1"', 'follow = "x_1"\npoles = [-1, -2]', "reference_model.poles and baseline are both given"),
        ('follow = "x_1"', 'follow = "x_1"\nk_0 = 1.0', "reference_model.k_0 and baseline are both given"),
        ('follow = "x_1"', "", "reference_model.follow is missing"),
        ('follow = "x_1"', 'follow = "x_3"', "reference_model.follow does not name a state, got 'x_3'"),
        ("Q = [1.0, 0.5, 20.0]", "Q = [1.0, 0.5]", "baseline.Q must have shape 3"),
        ("Q = [1.0, 0.5, 20.0]", "Q = [1.0, 0.5, 0.0]", "does not stabilise|no optimal gain"),
        ("R = 1.0", "R = -1.0", "baseline.R must be positive definite"),
        (
            'kind = "lqi"\nQ = [1.0, 0.5, 20.0]\nR = 1.0',
            'kind = "pi"\nk_p = 1.0\nk_i = 1.0',
            "does not stabilise the nominal plant",
        ),
        ('kind = "lqi"\nQ = [1.0, 0.5, 20.0]\nR = 1.0', 'kind = "system"\nnum = [1.0]', "baseline must have either num and den"),
        (
            "lower = [-0.4, -0.2]\nupper = [0.4, 0.2]",
            "lower = [-1, -1, -1]\nupper = [1, 1, 1]",
            "uncertainty.lower must have 2 entries",
        ),
    ],
)
def test_bad_input_is_one_sentence(old, new, said):
    assert old in CASE
    import re

    found = refusal(lambda: parse_case(CASE.replace(old, new)))
    assert re.search(said, found), found


def test_an_output_that_comes_to_rest_at_zero_cannot_follow():
    """A pendulum on a cart has an equilibrium at every position of the cart. Rounding used to leave its static gain at about
    1e-18."""
    cart = (
        np.array([[0, 0, 1, 0], [0, 0, 0, 1], [0, 1.594, -11.6, -0.0065], [0, 24.6, -27.4, -0.1]]),
        np.array([0, 0, 1.52, 3.46]),
    )
    weights = {"Q": [0.75, 4.0, 0.0, 0.0], "R": 0.0003}
    assert LqrBaseline(**weights, output=[1, 0, 0, 0]).controller(*cart).k_r[0, 0] == pytest.approx(-50, rel=1e-3)
    with pytest.raises(InputError, match="it comes to rest at 0"):
        LqrBaseline(**weights, output=[0, 1, 0, 0]).controller(*cart)


def test_who_takes_no_baseline_says_who_does():
    known = posed("lqi").known
    assert "adrc cannot have a baseline" in refusal(lambda: Adrc(bandwidth=5.0).bind(known))
    assert "do not combine leakage with a baseline" in refusal(lambda: Mrac(gamma=1.0, leakage=FixedSigma(sigma=0.1)).bind(known))


def test_the_bundled_aircraft_follows_with_the_augmentation_and_not_without():
    case = load_case("aircraft-lqi")
    runs = simulate(case.problem, case.controllers, case.simulation)
    tail = {name: run.figures["tail_max_abs_e"][0] for name, run in runs.items()}
    assert max(tail["MRAC"], tail["L1"]) < 0.005
    assert tail["Baseline"] > 0.01


WITHOUT_A_BASELINE = """
name = "arm"
[parameters]
J = { value = 0.04, between = [0.03, 0.08] }
k = { value = 0.12, between = [0.1, 0.3] }
[plant]
A = [[0, 1], ["-k/J", -0.2]]
b = [0, "0.5/J"]
[reference_model]
poles = [-2.0, -3.0]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
scheme = "baseline"
SAMPLED
"""


@pytest.mark.parametrize("sampled", ["", "sample_time = 0.01"])
def test_without_a_baseline_the_scheme_has_the_gains_of_the_declared_values_and_says_them(sampled):
    """By hand, the poles (s + 2)(s + 3) give u = 6 J/0.5 r - [(6 J - k)/0.5, (5 - 0.2) J/0.5] x. The centre of the box
    differs."""
    case = parse_case(WITHOUT_A_BASELINE.replace("SAMPLED", sampled))
    J, k = 0.04, 0.12
    expected = [(6 * J - k) / 0.5, 4.8 * J / 0.5]
    for problem in (case.problem, case.problem.design):
        np.testing.assert_allclose(BaselineAlone().bind(problem.known).theta_0, expected, rtol=1e-12)
    assert np.abs(case.problem.uncertainty.middle - expected).max() > 0.1
    said = (
        "without [baseline] its gains are those for the declared values of the parameters, with an input gain of 1: "
        "u = 0.48 r - [0.24, 0.384] x"
    )
    (run,) = simulate(case.problem, case.controllers, case.simulation).values()
    np.testing.assert_allclose(run.u[0], 0.048, rtol=1e-9)
    assert said in run.warnings
    (certificate,) = certify(case.problem, case.controllers, case.simulation).values()
    assert certificate.notes.count(said) == 1


def test_the_scheme_says_nothing_where_the_case_gives_its_gains():
    problem = parse_case(WITHOUT_A_BASELINE.replace("SAMPLED", "")).problem
    given = BaselineAlone(nominal=[1.0, 2.0]).bind(problem.known)
    assert given.assumed is None and given.theta_0.tolist() == [1.0, 2.0]
    for theta, middle in ((None, "theta = 0"), (ParameterBox(lower=[0.0, 1.0], upper=[2.0, 3.0]), "the middle of the known set")):
        known = Problem(plant=Plant(A_m=[[0, 1], [-6, -5]], b=[0, 1.0], theta=[1.5, 2.5]), uncertainty=theta).known
        found = BaselineAlone().bind(known)
        assert middle in found.assumed and found.theta_0.tolist() == ([0.0, 0.0] if theta is None else [1.0, 2.0])
