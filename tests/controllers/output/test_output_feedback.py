"""Output feedback: the matching equation, the exact identity, the laws, the L1 controller and its linear equivalent."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from adaptation.examples import LAW_EXAMPLES
from barbalat.adaptation.laws import LAWS, Gradient, LeastSquares
from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.adaptation.modifications import DeadZone, FixedSigma
from barbalat.cases.load import load_case
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.certificates.schemes.output.l1 import condition_norm, small_gain_system
from barbalat.certificates.schemes.output.mrac import matched_feedback
from barbalat.controllers import Mrac, Sampled
from barbalat.controllers.output.l1 import L1Output, fast_limit, linear_equivalent
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.matching import filter_polynomial, is_strictly_positive_real, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.controllers.parametric_model import auxiliary_filter
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine, Step
from barbalat.solvers.simulation import Simulation
from independent import refusal

TF = TransferFunction
# plants and models of relative degree 1, 2, 3, a zero in the model, a negative gain; all except the first and third are unstable
EXAMPLES = {
    "n*=1": (TF([2.0, 2.0], [1.0, 1.0, 2.0]), TF([1.0], [1.0, 1.0])),
    "n*=2": (TF([2.0], [1.0, 1.0, -0.5]), TF([1.0], [1.0, 2.0, 1.0])),
    "n*=3": (TF([1.5], [1.0, 2.0, 2.0, 0.5]), TF([1.0], [1.0, 3.0, 3.5, 1.5])),
    "n=3, n*=1, W_m with a zero": (TF([2.0, 6.0, 5.0], [1.0, 1.0, -0.5, 1.0]), TF([1.5, 3.0], [1.0, 3.0, 3.5])),
    "n=3, n*=2, k_p<0": (TF([-2.0, -6.0], [1.0, 1.0, -0.5, 1.0]), TF([3.0], [1.0, 3.0, 2.0])),
}


def problem_of(plant, model, reference=None, **settings):
    return OutputProblem(
        plant=OutputPlant(transfer_function=plant, **{k: settings.pop(k) for k in ("nonlinear", "input") if k in settings}),
        reference_model=OutputReferenceModel(transfer_function=model),
        reference=reference or Sine(amplitude=1.0, frequency=1.3),
        **settings,
    )


def theta_star(plant, model):
    return matching_parameters(plant, model, filter_polynomial(len(plant.poles), model, None))


def mrac(plant, model, law, **settings):
    theta, n = theta_star(plant, model), len(plant.poles)
    near, far = sorted((0.3 * theta[-1], 3 * theta[-1]))
    lower, upper = np.append(np.full(2 * n - 1, -40.0), near), np.append(np.full(2 * n - 1, 40.0), far)
    start = np.clip(theta + 0.3, lower, upper)
    settings = {"theta_hat0": start, "lower": lower, "upper": upper, "name": "c"} | settings
    return MracOutput(order=n, relative_degree=plant.relative_degree, sign=int(np.sign(plant.num[0])), law=law, **settings)


@pytest.mark.parametrize("seed", range(30))
def test_matching_makes_the_closed_loop_the_model(seed):
    """For random plants of order 1 to 5 and any relative degree, python-control's transfer function from r to y is W_m."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 6))
    n_star = int(random.integers(1, n + 1))
    zeros, filter_poles = -random.uniform(0.5, 3, n - n_star), None
    plant = TF(random.choice([-1, 1]) * random.uniform(0.5, 3) * np.atleast_1d(np.poly(zeros)), np.poly(random.uniform(-3, 1, n)))
    model = TF([random.uniform(0.5, 2)], np.poly(-random.uniform(0.5, 3, n_star)))
    Lambda = filter_polynomial(n, model, filter_poles)
    theta = matching_parameters(plant, model, Lambda)
    alpha = [np.eye(n - 1)[i] for i in range(n - 1)]
    G = control.tf(plant.num, plant.den)

    def filtered(weights):
        return control.tf(sum((w * a for w, a in zip(weights, alpha, strict=True)), np.zeros(max(n - 1, 1))), Lambda)

    ahead = 1 / (1 - filtered(theta[: n - 1])) if n > 1 else control.tf([1.0], [1.0])
    back = (filtered(theta[n - 1 : 2 * n - 2]) if n > 1 else 0) + theta[2 * n - 2]
    loop = theta[-1] * ahead * G / (1 - ahead * G * back)
    for w in (0.1, 1.0, 7.0):
        np.testing.assert_allclose(loop(1j * w), model.at(1j * w), rtol=1e-6)
    assert len(theta) == 2 * n


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("missing", [0, 1, 2])
def test_matching_in_any_time_unit_and_for_lower_orders(missing, unit):
    """The closed loop is W_m at three frequencies, with theta* of a plant of order 3 - missing. theta grows as unit^4."""
    poles, zeros = [1.0, -2.0, 0.5][: 3 - missing], [-3.0, -1.5][: 2 - missing]
    plant = TF(2 * unit * np.atleast_1d(np.poly(np.array(zeros) * unit)), np.poly(np.array(poles) * unit))
    model = TF([3.0 * unit], [1.0, 3.0 * unit])
    Lambda = filter_polynomial(3, model, np.array([-1.0, -5.0]) * unit)
    theta = matching_parameters(plant, model, Lambda)
    for w in (0.2, 1.0, 8.0):
        s = 1j * w * unit
        alpha, filtered = np.array([s, 1.0]), np.polyval(Lambda, s)
        ahead, back = 1 / (1 - theta[:2] @ alpha / filtered), theta[2:4] @ alpha / filtered + theta[4]
        G = complex(plant.at(np.array(s)))
        assert theta[5] * ahead * G / (1 - ahead * G * back) == pytest.approx(complex(model.at(np.array(s))), rel=1e-9)


def test_a_run_in_a_fast_time_unit_does_not_diverge_for_its_large_parameters():
    """With n = n* = 4 at 1e5 rad/s, theta* has entries up to 1e15, and y is of the order of one."""
    W = 1e5
    model, plant = TF([W**4], np.poly(-W * np.ones(4))), TF([2 * W**4], np.poly(-W * np.array([0.5, 1.0, 1.5, 2.0])))
    theta = theta_star(plant, model)
    controller = MracOutput(
        order=4, relative_degree=4, sign=1, law=Gradient(gamma=1e-9), theta_hat0=theta, c_0_min=0.1 * theta[-1], name="c"
    )
    run = simulate(problem_of(plant, model, Sine(1.0, 0.3 * W)), [controller], Simulation(t_end=2e-4, dt=1e-7))["c"]
    assert run.diverged_at is None
    assert np.abs(theta).max() > 1e14
    assert run.figures["max_abs_e"][0] < 1e-7 * run.figures["max_abs_y"]


@pytest.mark.parametrize("name", EXAMPLES)
def test_exact_parameters_leave_no_error(name):
    plant, model = EXAMPLES[name]
    controller = mrac(plant, model, Gradient(gamma=1.0), theta_hat0=theta_star(plant, model))
    run = simulate(problem_of(plant, model), [controller], Simulation(t_end=20.0, dt=1e-2))["c"]
    assert run.figures["max_abs_e"][0] < 1e-11 * run.figures["max_abs_y"]


@pytest.mark.parametrize("law", ["gradient", "least squares"])
@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("level", [np.inf, 0.5])
@pytest.mark.short(kept=lambda name, law, level: (law == "gradient") == np.isfinite(level))
def test_the_exact_identity(name, law, level):
    """c_0 (y - y_m) = -eps m^2 + W_c[(W_b[omega'])theta'] + W_m[u_a] with the estimate c_0 and any u_a, up to the integration's
    1e-10.

    With u limited to ``level`` and sat(u) in the model, the part removed by the limit is added to u_a. It has corners, so the
    tolerance is 1e-8.
    """
    plant, model = EXAMPLES[name]
    laws = {"gradient": Gradient(gamma=3.0), "least squares": LeastSquares(covariance0=5.0)}
    controller = mrac(plant, model, laws[law], tau=0.3, saturated_predictor=bool(np.isfinite(level)))
    problem = problem_of(plant, model)
    if np.isfinite(level):
        problem = replace(problem, plant=replace(problem.plant, input=PlantInput(saturation=(-level, level))))
    loop = ClosedLoop.of(problem, controller)
    eq, W_m = loop.equations, model.realise()
    order, r = W_m.order, problem.reference
    G = problem.dynamics.system

    def u_a(t):
        return np.array(0.4 * np.sin(3 * t) - 0.3 * np.exp(-t) + 0.1)

    def slope(t, s):
        x, x_m, *_, state, _ = loop.unpack(s[:-order])
        y, command = G.C @ x, np.array(float(r(np.array(t))))
        u = state.theta_hat @ eq.omega(state, y, command) + u_a(t)
        rates = eq.derivative(state, y, W_m.C @ x_m, command, u)
        flat = np.concatenate([np.ravel(leaf) for part in rates for leaf in (part if isinstance(part, tuple) else (part,))])
        v = np.clip(u, -level, level)
        beside = W_m.derivative(s[-order:], u_a(t) + v - u)
        return np.concatenate([G.derivative(x, v), W_m.derivative(x_m, command), flat, beside])

    start = np.append(loop.initial(), np.zeros(order))
    samples = solve_ivp(slope, (0, 4), start, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=np.linspace(0, 4, 9)).y.T
    left, right, moved = [], [], 0.0
    for s in samples:
        x, x_m, *_, state, _ = loop.unpack(s[:-order])
        y, y_m = G.C @ x, W_m.C @ x_m
        estimation = eq.estimation(state, y)
        left.append(state.theta_hat[-1] * (y - y_m))
        swapped = W_m.C @ state.swapping
        right.append(-estimation.epsilon * estimation.m_s_squared - swapped + W_m.C @ s[-order:])
        moved = max(moved, abs(swapped))
    assert moved > 1e-3 * np.abs(left).max()  # the swapping term is not negligible
    np.testing.assert_allclose(right, left, atol=(1e-10 if np.isinf(level) else 1e-8) * np.abs(left).max())


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.short(kept=lambda name: name in ("n*=2", "n=3, n*=2, k_p<0"))
def test_auxiliary_input_improves_the_transient_with_tau(name):
    """For any relative degree a smaller tau decreases the error, which tends to zero along the run in any case."""
    plant, model = EXAMPLES[name]
    controllers = [mrac(plant, model, Gradient(gamma=5.0), tau=tau, name=f"{tau}") for tau in (0.2, 0.1, 0.05)]
    runs = simulate(problem_of(plant, model), controllers, Simulation(t_end=20.0, dt=1e-3))
    peaks = [run.figures["max_abs_e"][0] for run in runs.values()]
    assert peaks[0] > 1.4 * peaks[1] > 1.4**2 * peaks[2]


def test_every_law_runs_as_in_numpy_and_keeps_c_0_on_its_side(sample):
    """The kernel's derivative equals the derivative in the equations, c_0 keeps its sign at every step, and all signals stay
    bounded."""
    plant, model = EXAMPLES["n=3, n*=2, k_p<0"]
    random = np.random.default_rng(1)
    for name in list(LAWS)[:: sample(4, 1)]:
        controller = mrac(plant, model, LAWS[name](**LAW_EXAMPLES[name].numbers), tau=0.2)
        problem = problem_of(plant, model)
        run = simulate(problem, [controller], Simulation(t_end=20.0, dt=2e-3))["c"]
        assert run.diverged_at is None, name
        assert (run.envelope.theta_hat_max[:, -1] <= 0.3 * theta_star(plant, model)[-1] + 1e-12).all(), name
        loop = ClosedLoop.of(problem, controller)
        state_column, flat = symbols("state", loop.size)
        traced = ca.Function("f", [state_column], [column(loop.derivative(flat, np.array([0.7])))])
        for _ in range(5):
            state = loop.initial() + 0.3 * random.normal(size=loop.size)
            np.testing.assert_allclose(
                np.asarray(traced(state))[:, 0], loop.derivative(state, np.array([0.7])), rtol=1e-10, atol=1e-10
            )


def test_strictly_positive_real_against_a_sweep(sample):
    random, w = np.random.default_rng(5), np.geomspace(1e-4, 1e4, 20_001)
    verdicts = []
    for _ in range(sample(40, 200)):
        n = int(random.integers(1, 5))
        zeros = np.poly(-random.uniform(0.1, 5, n - 1)) if n > 1 else np.ones(1)
        W = TF(random.choice([1, 1, -1]) * zeros, np.poly(-random.uniform(0.1, 5, n)))
        real = np.array([W.at(1j * x).real for x in w[::20]]) * (1 + w[::20] ** 2)
        if np.abs(real).min() < 1e-3 * np.abs(real).max():
            continue  # too close to the limit for a decision by sampling
        verdicts.append(is_strictly_positive_real(W))
        assert verdicts[-1] == bool((real > 0).all())
    assert any(verdicts)
    assert not all(verdicts)
    assert not is_strictly_positive_real(TF([1.0], [1.0, 2.0, 1.0]))


@pytest.fixture(scope="module")
def rohrs_runs():
    case = load_case("rohrs")
    return simulate(case.problem, case.controllers, case.simulation)


def test_rohrs_counterexample(rohrs_runs):
    """As published, the classical law drifts until the loop bursts, and the modified laws stay bounded."""
    classical = rohrs_runs["Classical"]
    assert 5 < classical.diverged_at < 60
    drift = classical.theta_hat[:, 0]
    before = classical.t < 0.7 * classical.diverged_at
    assert drift[before][-1] < drift[0] - 1  # the feedback gain grows without bound
    for name in ("Sigma-modification", "Dead zone", "Normalised", "Robust"):
        assert rohrs_runs[name].diverged_at is None
        assert rohrs_runs[name].figures["max_abs_y"] < 1


def test_the_drift_is_the_loop_s_own(rohrs_runs):
    """At half the step the classical run is the same up to the burst: the drift is not a numerical artefact."""
    case = load_case("rohrs")
    until = 10.0
    fine, coarse = (
        simulate(case.problem, case.controllers[:1], replace(case.simulation, t_end=until, dt=dt))["Classical"].theta_hat[-1]
        for dt in (1e-4, 2e-4)
    )
    np.testing.assert_allclose(fine, coarse, rtol=1e-8)


G, C, M = TF([2.0], [1.0, 1.0]), TF([30.0], [1.0, 30.0]), 3.0


def l1_problem(**settings):
    return problem_of(
        G, TF([M], [1.0, M]), Sine(amplitude=1.0, frequency=1.0), disturbance=Step(amplitude=1.0, start=3.0), **settings
    )


def l1(**settings):
    return L1Output(**({"m": M, "gamma": 1e4, "filter": C, "sigma_bound": 100.0, "name": "c"} | settings))


@pytest.mark.parametrize("gamma", [10.0, 1e4])
@pytest.mark.parametrize("filter", [C, TF([40.0], [1.0, 9.0, 40.0])])
def test_linear_equivalent_agrees_to_rounding_inside_the_bounds(gamma, filter):
    """With a nonlinear plant and a disturbance, two different realisations agree to 1e-9 of the signals' size over 20,000
    steps."""
    controller = l1(gamma=gamma, filter=filter)
    same = linear_equivalent(controller)
    linear = LinearOutput(loop=same.feedback, feedforward=same.feedforward, name="linear")
    runs = simulate(l1_problem(nonlinear="0.5*sin(y)"), [controller, linear], Simulation(t_end=10.0, dt=5e-4))
    np.testing.assert_allclose(runs["linear"].u, runs["c"].u, atol=1e-9 * np.abs(runs["c"].u).max())
    np.testing.assert_allclose(runs["linear"].y, runs["c"].y, atol=1e-9)


def test_equivalent_against_python_control():
    """python-control combines the block diagram into K and F. The integral action is a pole at s = 0."""
    for gamma in (5.0, 1e4):
        controller = l1(gamma=gamma)
        s = control.tf("s")
        C_s, D = 30 / (s + 30), s**2 + M * s + gamma * M
        sigma_y, sigma_u = gamma * (s + M) / D, -gamma * M / D
        K, F = C_s * sigma_y / (1 + C_s * sigma_u), C_s / (1 + C_s * sigma_u)
        found = linear_equivalent(controller)
        for w in (0.01, 1.0, 30.0, 500.0):
            np.testing.assert_allclose(found.feedback.at(1j * w), K(1j * w), rtol=1e-9)
            np.testing.assert_allclose(found.feedforward.at(1j * w), F(1j * w), rtol=1e-9)
        assert np.abs(found.feedback.poles).min() == 0
    limit = fast_limit(l1())
    K_limit = C_s / ((1 - C_s) * M / (s + M))
    np.testing.assert_allclose(limit.feedback.at(2j), K_limit(2j), rtol=1e-12)
    np.testing.assert_allclose(linear_equivalent(l1(gamma=1e9)).feedback.at(2j), limit.feedback.at(2j), rtol=1e-6)


def test_integral_action_and_anti_windup():
    """A constant disturbance causes no remaining error. After saturation the bounded sigma recovers sooner than the unbounded
    one."""
    constant = problem_of(G, TF([M], [1.0, M]), Step(amplitude=1.0), disturbance=Step(amplitude=0.7, start=1.0))
    run = simulate(constant, [l1()], Simulation(t_end=20.0, dt=1e-3))["c"]
    assert abs(run.e[-1, 0]) < 1e-9
    wave = problem_of(G, TF([M], [1.0, M]), Step(amplitude=1.0), input=PlantInput(saturation=(-1.0, 1.0)),
                      disturbance=Step(amplitude=-4.0, start=1.0))  # fmt: skip
    pulse = replace(wave, disturbance=_Pulse())
    bounded, free = l1(sigma_bound=3.0, gamma=50.0, name="bounded"), l1(sigma_bound=None, gamma=50.0, name="free")
    runs = simulate(pulse, [bounded, free], Simulation(t_end=30.0, dt=1e-3))
    late = {name: np.abs(run.e[(run.t > 8) & (run.t < 16), 0]).mean() for name, run in runs.items()}
    assert late["bounded"] < 0.5 * late["free"]


class _Pulse:
    """A pulse of -4 from 1 to 6 s."""

    bound = 4.0

    def __call__(self, t):
        return np.where((t >= 1) & (t < 6), -4.0, 0.0)

    def before(self, t):
        return np.where((t > 1) & (t <= 6), -4.0, 0.0)


@pytest.mark.parametrize("filter", [C, TF([40.0], [1.0, 9.0, 40.0])])
def test_the_system_of_condition_20_against_python_control(filter):
    """H (1 - C) with H = G G_m/(C G + (1 - C) G_m) agrees with python-control's algebra."""
    controller = l1(filter=filter)
    plant = TF([2.0, 1.0], [1.0, 0.4, -0.3])
    G, G_m, C_s = (control.tf(system.num, system.den) for system in (plant, controller.G_m, filter))
    expected = G * G_m / (C_s * G + (1 - C_s) * G_m) * (1 - C_s)
    found = small_gain_system(controller, plant)
    for w in (0.0, 0.3, 4.0, 50.0):
        assert complex(found.at(np.array(1j * w))) == pytest.approx(complex(expected(1j * w)), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", EXAMPLES)
def test_feedback_and_auxiliary_filter_against_python_control(name):
    """python-control confirms K of u = -K[y] at theta* and Q = 1/(W_m (tau s + 1)^n*)."""
    plant, model = EXAMPLES[name]
    Lambda, theta, n = filter_polynomial(len(plant.poles), model, None), theta_star(plant, model), len(plant.poles)
    alpha = [control.tf(np.eye(n - 1)[i], Lambda) for i in range(n - 1)]
    ahead = sum((w * a for w, a in zip(theta[: n - 1], alpha, strict=True)), control.tf([0.0], [1.0]))
    back = sum((w * a for w, a in zip(theta[n - 1 : 2 * n - 2], alpha, strict=True)), control.tf([theta[2 * n - 2]], [1.0]))
    K, Q = matched_feedback(theta, Lambda), auxiliary_filter(model, 0.3)
    W_m, lag = control.tf(model.num, model.den), control.tf([1.0], [0.3, 1.0])
    for w in (0.2, 1.0, 9.0):
        assert complex(K.at(np.array(1j * w))) == pytest.approx(complex(-(back / (1 - ahead))(1j * w)), rel=1e-8)
        expected = lag(1j * w) ** plant.relative_degree / W_m(1j * w)
        assert complex(Q.response(np.array([w]))[0]) == pytest.approx(complex(expected), rel=1e-8)


def test_a_diagonal_gain_makes_the_run_nearly_independent_of_the_time_unit():
    """Plant, model, command and step are in units of 1/W s. The independence is not exact because m^2 weights the entries of phi
    in their own units."""
    tails = {}
    for W, scaled in ((1.0, True), (1000.0, True), (1000.0, False)):
        plant, model = TF([1.5 * W**3], [1.0, 2 * W, 2 * W**2, 0.5 * W**3]), TF([W**3], [1.0, 3 * W, 3.5 * W**2, 1.5 * W**3])
        gain = 5.0 * W * (np.array([W**2, W**4, W**2, W**4, 1.0, 1.0]) if scaled else 1.0)
        controller = MracOutput(order=3, relative_degree=3, sign=1, law=Gradient(gamma=gain), c_0_min=0.1, name="c")
        problem = problem_of(plant, model, Sine(amplitude=1.0, frequency=1.3 * W))
        run = simulate(problem, [controller], Simulation(t_end=200 / W, dt=1e-2 / W))["c"]
        tails[W, scaled] = run.figures["tail_max_abs_e"][0]
    assert tails[1000.0, True] == pytest.approx(tails[1.0, True], rel=1e-2)
    assert tails[1000.0, False] > 1.3 * tails[1.0, True]


def test_condition_20_against_quadrature(sample):
    """The certified norm of H(1 - C) encloses a fine quadrature of its impulse response. An unstable H is rejected."""
    for plant in (TF([1.0, 3.0], [1.0, 2.0, 1.0]), G, TF([1.0], [1.0, 4.0]))[: sample(1, 3)]:
        enclosure = condition_norm(l1(), plant)
        system = small_gain_system(l1(), plant)
        t = np.linspace(0, 60, 600_001)
        response = control.impulse_response(control.tf(system.num, system.den), t)
        area = float(np.trapezoid(np.abs(np.squeeze(response.outputs)), t))
        assert enclosure.lower <= enclosure.upper <= enclosure.lower * (1 + 1e-8)
        assert area == pytest.approx(enclosure.upper, rel=1e-4)
    assert "H(s)" in refusal(lambda: condition_norm(l1(), TF([1.0], [1.0, -5.0, 60.0])))


def test_certificate_margin_against_simulated_delays():
    """The loop has no command and a pulse of disturbance. The motion decays with a delay below the certified margin and grows
    with one above."""
    problem = problem_of(G, TF([M], [1.0, M]), Sine(amplitude=1e-9, frequency=1.0), disturbance=_Pulse())
    controller, simulation = l1(), Simulation(t_end=60.0, dt=1e-3)
    margin = certify(problem, (controller,), simulation)["c"].values["delay_margin"]
    tails = []
    for factor in (0.9, 1.1):
        delayed = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=factor * margin)))
        run = simulate(delayed, [l1(sigma_bound=None)], simulation)["c"]
        tails.append(np.inf if run.diverged_at else run.figures["tail_max_abs_e"][0])
    assert tails[0] < 1e-3
    assert tails[1] > 1


def test_noise_sampling_and_ensembles():
    """A member of an ensemble equals the single run. The sampled controller with Euler steps tends to the continuous one."""
    noisy = l1_problem(sensor=Sensor(lag=0.01, noise=Noise(std=0.01, sample_time=0.01, seed=2)))
    simulation = Simulation(t_end=2.0, dt=1e-3)
    together = simulate_ensemble([(noisy, l1(gamma=10.0 * (i + 1))) for i in range(3)], simulation).metrics
    alone = simulate(noisy, [l1(gamma=10.0)], simulation)["c"].metrics
    np.testing.assert_allclose(together.max_abs_y[0], alone.max_abs_y[0], rtol=1e-10)
    exact = simulate(l1_problem(), [l1(gamma=10.0)], simulation)["c"].y[-1]
    distances = []
    for T in (8e-3, 4e-3, 2e-3):
        sampled = Sampled(controller=l1(gamma=10.0), sample_time=T, discretization="euler")
        distances.append(abs(simulate(l1_problem(), [sampled], simulation)["c"].y[-1] - exact))
    assert distances[0] > 1.5 * distances[1] > 1.5**2 * distances[2]


LAW = LyapunovLaw(gamma=1.0)
WRONG = {
    "filter not strictly proper": (lambda: l1(filter=TF([1.0, 30.0], [1.0, 30.0])), ["filter", "strictly proper"]),
    "filter unstable": (lambda: l1(filter=TF([-30.0], [1.0, -30.0])), ["filter", "stable"]),
    "filter gain": (lambda: l1(filter=TF([15.0], [1.0, 30.0])), ["filter", "DC gain"]),
    "m": (lambda: l1(m=0.0), ["m", "positive"]),
    "sign": (lambda: MracOutput(order=1, relative_degree=1, sign=2, law=LAW), ["sign", "1 or -1"]),
    "degree above order": (lambda: MracOutput(order=1, relative_degree=2, sign=1, law=LAW), ["relative_degree"]),
    "theta size": (
        lambda: MracOutput(order=2, relative_degree=1, sign=1, law=LAW, theta_hat0=[1.0]), ["theta_hat0", "4"],
    ),
    "tau with the Lyapunov law": (
        lambda: MracOutput(order=1, relative_degree=1, sign=1, law=LAW, tau=1.0), ["tau", "epsilon"],
    ),
    "no bound of c_0": (lambda: _bind(MracOutput(order=1, relative_degree=1, sign=1, law=Gradient(gamma=1.0))), ["c_0_min"]),
    "a set with c_0 above zero where it is negative": (
        lambda: problem_bind(
            TF([-2.0], [1.0, 1.0]),
            MracOutput(order=1, relative_degree=1, sign=-1, law=Gradient(gamma=1.0), lower=[-9.0, -9.0], upper=[9.0, 1.0]),
            TF([3.0], [1.0, 3.0]),
        ),
        ["c_0", "below zero"],
    ),
    "wrong sign": (lambda: _bind(MracOutput(order=1, relative_degree=1, sign=-1, law=LAW)), ["sign", "gain"]),
    "model of another degree": (
        lambda: _bind(MracOutput(order=2, relative_degree=2, sign=1, law=Gradient(gamma=1.0), c_0_min=0.1)), ["relative_degree"],
    ),
    "filter pole": (
        lambda: _bind(MracOutput(order=2, relative_degree=1, sign=1, law=LAW, filter_poles=[1.0])),
        ["filter_poles", "Hurwitz"],
    ),
    "filter pole at zero": (
        lambda: _bind(MracOutput(order=2, relative_degree=1, sign=1, law=LAW, filter_poles=[-1e-300])),
        ["filter_poles", "Hurwitz"],
    ),
    "wrong sign of a plant of lower order": (
        lambda: problem_bind(
            TF([-2.0], [1.0, 1.0]), MracOutput(order=2, relative_degree=1, sign=1, law=LAW), TF([3.0], [1.0, 3.0]),
        ),
        ["sign is 1", "gain is -2"],
    ),
    "model of another m": (
        lambda: ClosedLoop.of(problem_of(G, TF([5.0], [1.0, 5.0])), l1()), ["reference model", "m/(s + m)", "m = 3"],
    ),
    "improper design plant": (lambda: l1(design_plant=TF([1.0, 2.0, 3.0], [1.0, 1.0])), ["design_plant", "strictly proper"]),
    "not SPR": (
        lambda: problem_bind(
            TF([1.0], [1.0, 2.0, 1.0]), MracOutput(order=2, relative_degree=2, sign=1, law=LAW), TF([1.0], [1, 2, 1]),
        ),
        ["strictly positive real"],
    ),
    "non-minimum phase": (
        lambda: problem_bind(
            TF([1.0, -1.0], [1.0, 2.0, 1.0]), MracOutput(order=2, relative_degree=1, sign=1, law=LAW), TF([3.0], [1.0, 3.0]),
        ),
        ["minimum phase"],
    ),
    "model unstable": (lambda: OutputReferenceModel(transfer_function=TF([1.0], [1.0, -1.0])), ["reference_model", "stable"]),
    "plant with feedthrough": (lambda: OutputPlant(transfer_function=TF([1.0, 1.0], [1.0, 2.0])), ["plant", "strictly proper"]),
    "formula": (lambda: OutputPlant(transfer_function=G, nonlinear="os.system(y)"), ["plant.nonlinear", "formula in y"]),
    "state scheme": (lambda: ClosedLoop.of(l1_problem(), Mrac(gamma=1.0)), ["MRAC", "state", "output"]),
    "improper linear": (lambda: LinearOutput(loop=TF([1.0, 0.0], [1.0])), ["proper"]),
    "two integrators": (
        lambda: LinearOutput(loop=TF([1.0], [1.0, 0.0]), feedforward=TF([1.0], [1.0, 0.0, 0.0])), ["feedforward"],
    ),
}  # fmt: skip


def _bind(controller):
    return problem_bind(G, controller, TF([M], [1.0, M]))


def problem_bind(plant, controller, model):
    return ClosedLoop.of(problem_of(plant, model), controller)


@pytest.mark.parametrize("sign", [1, -1])
def test_c_0_min_alone_keeps_c_0_on_its_side_of_zero(sign):
    """c_0 = k_m/k_p, so the mirrored plant has the mirrored interval. c_0's initial estimate is the end nearest to zero."""
    controller = MracOutput(order=1, relative_degree=1, sign=sign, law=Gradient(gamma=1.0), c_0_min=0.1)
    equations = problem_bind(TF([2.0 * sign], [1.0, 1.0]), controller, TF([3.0], [1.0, 3.0])).equations
    near, far = sorted((equations.estimate_set.lower[-1], equations.estimate_set.upper[-1]), key=abs)
    assert near == 0.1 * sign and far * sign > 1e3
    assert equations.theta_hat0[-1] == near


@pytest.mark.parametrize("sign", [1, -1])
def test_a_known_set_on_both_sides_of_c_0_is_refused(sign):
    def controller(near, far):
        low, high = sorted((near * sign, far * sign))
        box = {"lower": [-5.0, low], "upper": [5.0, high]}
        return MracOutput(order=1, relative_degree=1, sign=sign, law=Gradient(gamma=1.0), **box)

    plant, model = TF([2.0 * sign], [1.0, 1.0]), TF([3.0], [1.0, 3.0])
    assert problem_bind(plant, controller(0.1, 4.0), model).equations.estimate_set is not None
    side = "above" if sign > 0 else "below"
    assert f"must keep c_0 {side} zero" in refusal(lambda: problem_bind(plant, controller(-0.1, 4.0), model))


@pytest.mark.parametrize("case", WRONG)
def test_refused_in_a_sentence(case):
    make, words = WRONG[case]
    message = refusal(make)
    assert all(word in message for word in words), message


def test_modified_lyapunov_laws_stay_bounded_under_a_disturbance():
    problem = problem_of(G, TF([M], [1.0, M]), disturbance=Sine(amplitude=0.3, frequency=5.0))
    for modification in ({"leakage": FixedSigma(sigma=0.1)}, {"dead_zone": DeadZone(g_0=0.1)}):
        controller = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=5.0, **modification), name="c")
        run = simulate(problem, [controller], Simulation(t_end=60.0, dt=1e-3))["c"]
        assert run.diverged_at is None
        assert np.abs(run.theta_hat).max() < 10


def test_certify_refuses_what_a_run_refuses():
    controller = MracOutput(order=1, relative_degree=1, sign=1, law=LAW)
    problem = problem_of(TF([-2.0], [1.0, 1.0]), TF([M], [1.0, M]))
    assert "sign is 1" in refusal(lambda: certify(problem, [controller], Simulation(t_end=1.0, dt=1e-2)))


@pytest.mark.parametrize(
    ("law", "bounded", "vanishes"),
    [
        (LyapunovLaw(gamma=1.0), True, True),
        (LyapunovLaw(gamma=1.0, leakage=FixedSigma(sigma=0.1)), True, False),
        (LyapunovLaw(gamma=1.0, dead_zone=DeadZone(g_0=0.1)), False, False),
        (Gradient(gamma=1.0), True, True),
        (Gradient(gamma=1.0, leakage=FixedSigma(sigma=0.1)), False, False),  # known only for a small sigma
        (LeastSquares(covariance0=1.0), True, True),
    ],
    ids=["lyapunov", "its sigma", "its dead zone", "gradient", "its sigma", "least squares"],
)
def test_certificate_and_table_say_the_same_of_every_modification(law, bounded, vanishes):
    controller = MracOutput(order=1, relative_degree=1, sign=1, law=law, c_0_min=0.1, name="c")
    problem = problem_of(G, TF([M], [1.0, M]))
    certificates = certify(problem, [controller], Simulation(t_end=1.0, dt=1e-2))
    (column,) = table_1(problem, [controller], certificates).columns
    assert (column.cells["stability"].kind == "guaranteed") == bounded
    assert (column.cells["tracking"].kind == "guaranteed") == vanishes
    assert vanishes or not bounded or "to a set" in column.cells["tracking"].text
    assert certificates["c"].guaranteed == frozenset()  # no number bounds the error of these schemes


def test_unmodelled_plants_that_look_wrong_are_said():
    controller = MracOutput(order=1, relative_degree=1, sign=1, law=LAW, name="c")
    problem = problem_of(TF([2.0, -4.0], [1.0, 4.0, 6.0, 3.0]), TF([M], [1.0, M]))
    findings = " ".join(certify(problem, [controller], Simulation(t_end=1.0, dt=1e-2))["c"].findings)
    assert "zero with real part 2" in findings and "contradicts sign = 1" in findings


def test_nothing_is_proven_of_a_linear_law_where_f_acts():
    controller = MracOutput(order=1, relative_degree=1, sign=1, law=LAW, name="c")
    problem = problem_of(G, TF([M], [1.0, M]), nonlinear="0.5*sin(y)")
    table = table_1(problem, [controller], certify(problem, [controller], Simulation(t_end=1.0, dt=1e-2)))
    assert {table.columns[0].cells[key].kind for key in ("stability", "tracking", "transient", "estimates")} == {"does not apply"}
