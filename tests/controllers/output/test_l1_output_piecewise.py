"""L1 output feedback with the piecewise-constant law: its equations compared with SciPy, its limit, its remaining error and its
margins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import cont2discrete, lfilter, ss2tf

from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.controllers.l1_piecewise import input_directions
from barbalat.controllers.output import L1Output, L1OutputPiecewiseConstant
from barbalat.controllers.output.l1 import fast_limit
from barbalat.controllers.output.l1_piecewise import observed_direction
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine, Sines, Square, Step, Steps
from barbalat.solvers.simulation import Simulation
from independent import refusal

TF = TransferFunction
PLANT, MODEL = TF([2.0], [1.0, 0.5, 1.0]), TF([4.0], [1.0, 3.0, 4.0])
WITH_ZERO = TF([2.0, 3.0], [1.0, 0.5, 1.0])
FILTER = TF([400.0], [1.0, 30.0, 400.0])
MODELS = {
    "order 1": (TF([3.0], [1.0, 3.0]), TF([20.0], [1.0, 20.0])),
    "order 2": (MODEL, FILTER),
    "order 2, a zero": (TF([2.0, 4.0], [1.0, 3.0, 4.0]), FILTER),
    "order 3": (TF([6.0], [1.0, 6.0, 11.0, 6.0]), TF([8000.0], [1.0, 60.0, 1200.0, 8000.0])),
}


def problem_of(model=MODEL, reference=None, **more):
    """A problem in which the plant's relative degree is at most the model's."""
    path = {"input": more.pop("input")} if "input" in more else {}
    plant = OutputPlant(WITH_ZERO if model.relative_degree == 1 else PLANT, **path)
    command = Sine(1.0, 0.7) if reference is None else reference
    return OutputProblem(plant=plant, reference_model=OutputReferenceModel(model), reference=command, **more)


@pytest.mark.parametrize("name", MODELS)
def test_a_run_is_the_book_s_formulas(name):
    """The predictor and sigma_hat use matrix exponentials. C(s) M(s)^-1 c'(sI - A_m)^-1 is discretised by Tustin's rule from
    polynomials.

    The tolerance is 1e-8 because SciPy loses about six digits for transfer functions of order 6 with poles within T of z = 1.
    """
    (M, C), T, steps = MODELS[name], 0.01, 200
    at = Simulation(t_end=steps * T, dt=T / 4, record_points=4 * steps)
    (run,) = simulate(problem_of(M), [L1OutputPiecewiseConstant(sample_time=T, filter=C)], at).values()
    y, u = run.y[::4].reshape(-1)[:steps], run.u[::4].reshape(-1)[:steps]
    model = M.realise()
    A, b, c, n = model.A, model.B, model.C, model.order
    P = solve_continuous_lyapunov(A.T, -np.eye(n))
    g = np.linalg.solve(P, c) / (c @ np.linalg.solve(P, c))
    Psi = np.linalg.solve(A, expm(A * T) - np.eye(n))
    x_hat, sigma = np.zeros(n), np.zeros((steps, n))
    for k in range(steps):
        if k:
            x_hat = expm(A * T) @ x_hat + Psi @ (b * u[k - 1] + sigma[k - 1])
            sigma[k] = -np.linalg.solve(Psi, expm(A * T) @ g) * (c @ x_hat - y[k])
    np.testing.assert_allclose(run.reported["sigma_hat"][::4][:steps] @ input_directions(b[:, None]).T, sigma, atol=1e-10 / T)
    expected = _tustin(C.num, C.den, np.sin(0.7 * T * np.arange(steps)), T)
    for i in range(n):
        of_state = np.trim_zeros(ss2tf(A, np.eye(n)[:, i : i + 1], c[None], np.zeros((1, 1)))[0][0].round(9), "f")
        expected -= _tustin(np.polymul(C.num, of_state), np.polymul(C.den, M.num), sigma[:, i], T)
    np.testing.assert_allclose(u, expected, atol=1e-8 * max(1.0, np.abs(u).max()))


def _tustin(num, den, signal, T):
    """Tustin's discretisation from zero, for a signal that is zero at the first sample."""
    assert signal[0] == 0
    (b,), a, _ = cont2discrete((num, den), T, method="bilinear")
    return lfilter(b, a, signal)


@pytest.mark.parametrize("seed", range(5))
def test_the_predictor_s_error_falls_in_the_norm_of_P(seed):
    """|e^(A_m T) (I - g c')|_P < 1 holds for any model and any T."""
    random = np.random.default_rng(seed)
    den = np.poly(-random.uniform(0.3, 5, 3))
    model = TF([den[-1]], den).realise()
    root = np.linalg.cholesky(solve_continuous_lyapunov(model.A.T, -np.eye(3))).T
    g = observed_direction(model)
    for T in (1e-4, 0.1, 3.0):
        step = expm(model.A * T) @ (np.eye(3) - np.outer(g, model.C))
        assert np.linalg.norm(root @ step @ np.linalg.inv(root), 2) < 1


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.short(kept=lambda name: name == "order 2")
def test_for_short_samples_it_is_the_continuous_controller(name):
    """The difference from the delay margin of C/((1 - C) M) G is proportional to T: with a tenth of T, 5 to 20 % of it remain."""
    M, C = MODELS[name]
    found = []
    for T in (0.02, 0.002):
        made = L1OutputPiecewiseConstant(sample_time=T, filter=C)
        values = certify(problem_of(M), [made], Simulation(t_end=1.0, dt=T))[made.name].values
        found.append(values["delay_margin"] - values["delay_margin_limit"])
    assert 0.05 < found[1] / found[0] < 0.2


def test_with_a_first_order_model_it_tends_to_what_the_gradient_law_tends_to():
    M, C = MODELS["order 1"]
    made = L1OutputPiecewiseConstant(sample_time=1e-3, filter=C)
    values = certify(problem_of(M), [made], Simulation(t_end=1.0, dt=1e-3))[made.name].values["linear_equivalent_limit"]
    expected = fast_limit(L1Output(m=3.0, gamma=1e4, filter=C))
    for name, system in expected._asdict().items():
        s = 1j * np.array([0.1, 1.0, 20.0])
        found = TF(values[name]["num"], values[name]["den"])
        np.testing.assert_allclose(found.at(s), system.at(s), rtol=1e-12)


def test_what_constant_signals_leave_is_what_runs_show():
    made = L1OutputPiecewiseConstant(sample_time=0.01, filter=FILTER)
    at = Simulation(t_end=60.0, dt=5e-3)
    only_r, only_d = problem_of(reference=Constant(1.0)), problem_of(reference=Constant(0.0), disturbance=Step(1.0))
    left = certify(only_r, [made], at)[made.name].values["steady_error"]
    for problem, expected in ((only_r, left["r"]), (only_d, left["d"])):
        (run,) = simulate(problem, [made], at).values()
        assert float(run.e[-1, 0]) == pytest.approx(expected, abs=1e-9)
    assert 0 < abs(left["d"]) < 0.1


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.short(kept=lambda name: name == "order 2, a zero")
def test_what_the_estimate_is_of_a_constant_disturbance_is_what_a_run_shows(name):
    """For a plant equal to the model and no command, compare the first column of sigma_hat and the remaining part of y."""
    (M, C), T, d = MODELS[name], 0.05, 0.7
    made = L1OutputPiecewiseConstant(sample_time=T, filter=C)
    problem = OutputProblem(plant=OutputPlant(M), reference_model=OutputReferenceModel(M), disturbance=Constant(d))
    at = Simulation(t_end=60.0, dt=T)
    values = certify(problem, [made], at)[made.name].values
    (run,) = simulate(problem, [made], at).values()
    found = np.array(run.figures["sigma_hat_final"])
    np.testing.assert_allclose(found, np.array(values["sigma_hat_at_dc"])[:, 0] * d, rtol=1e-7)
    model = M.realise()
    to_y = -model.C @ np.linalg.solve(model.A, input_directions(model.B[:, None]))
    assert 1 - to_y @ found / (to_y[0] * d) == pytest.approx(values["disturbance_left"], rel=1e-6)
    if name == "order 1":
        assert values["disturbance_left"] == pytest.approx(-np.expm1(-3.0 * T))


@pytest.mark.parametrize("lag", [0.0, 0.03])
@pytest.mark.short(kept=lambda lag: lag == 0)
def test_noise_in_a_simulation_is_what_is_certified(lag):
    """The tolerances are 3 % and 5 %, as for the law with state feedback."""
    T, s = 0.01, 0.02
    made = L1OutputPiecewiseConstant(sample_time=T, filter=FILTER)
    sensor = Sensor(noise=Noise(std=s, sample_time=T, seed=5), lag=lag)
    problem = problem_of(reference=Constant(0.0), sensor=sensor)
    values = certify(problem, [made], Simulation(t_end=1.0, dt=T))[made.name].values
    run = simulate(problem, [made], Simulation(t_end=200.0, dt=T, record_points=20_000))[made.name]
    np.testing.assert_allclose(run.reported["sigma_hat"].std(axis=0), s * np.array(values["noise_in_sigma_hat"]), rtol=0.03)
    np.testing.assert_allclose(run.u.std(), s * values["noise_in_u"][0], rtol=0.05)


def random_case(random, i):
    """A plant that differs from its model, with a command without jumps or with jumps at or between samples. Every other case has
    a disturbance d."""
    T = float(random.choice([0.02, 0.05]))
    model = TF([4.0], np.poly(-random.uniform(1.0, 4.0, 1 + i % 2)))
    model = TF(model.num * model.den[-1] / 4.0, model.den)
    den = np.poly(-random.uniform(0.3, 4.0, len(model.den) - 1))
    plant = OutputPlant(TF([random.uniform(0.7, 1.5) * den[-1]], den))
    w = float(random.uniform(0.5, 3.0))
    halves = float(np.pi / (T * random.integers(20, 60)))
    signals = (Sine(1.3, w), Square(1.3, halves), Square(1.3, w, phase=0.3), Step(1.3, start=0.317), Sines((0.7, 0.6), (w, 4.0)))
    d = (None, Sine(0.8, 5.0 * w), Step(0.8, start=1.003))[i % 3]
    return T, OutputProblem(plant=plant, reference_model=OutputReferenceModel(model), reference=signals[i % 5], disturbance=d)


def test_no_run_is_farther_from_its_model_than_is_guaranteed(sample):
    """The error is relative to y_m under r and, computed here from y, to y_m under the sampled command."""
    random, close = np.random.default_rng(8), 0.0
    for i in range(sample(5, 40)):
        T, problem = random_case(random, i)
        made = L1OutputPiecewiseConstant(sample_time=T, filter=TF([400.0], [1.0, 40.0, 400.0]))
        at = Simulation(t_end=12.0, dt=T / 4, record_points=round(48.0 / T))
        found = certify(problem, [made], at)[made.name]
        if found.values["spectral_radius"] >= 1:
            assert "unstable" in found.entry("error_bound").why
            continue
        assert {"error_bound", "error_bound_held"} <= found.guaranteed
        (run,) = simulate(problem, [made], at).values()
        worst, bound = float(np.abs(run.e).max()), found.values["error_bound"]
        assert worst <= bound
        held = np.abs(run.y.reshape(-1) - held_model(problem.reference_model.transfer_function, run.r, T)).max()
        assert held <= found.values["error_bound_held"] <= bound
        close = max(close, worst / bound)
    assert close > 0.25  # the bound is not far too large: some command comes near it


def held_model(M, r, T):
    """The model's output at every quarter of a sample, from the command at every fourth instant."""
    model, x, found = M.realise(), np.zeros(M.realise().order), []
    step = expm(T / 4 * np.block([[model.A, model.B[:, None]], [np.zeros((1, model.order + 1))]]))
    for k in range(len(r)):
        found.append(model.C @ x)
        x = (step @ np.append(x, r[k - k % 4]))[:-1]
    return np.array(found)


def test_the_worst_command_comes_near_the_bound():
    """r is the sign of e's impulse response, reversed in time. Without d this attains the bound at the samples, up to the part
    between samples."""
    T, steps = 0.05, 400
    made = L1OutputPiecewiseConstant(sample_time=T, filter=FILTER)
    at = Simulation(t_end=steps * T, dt=T, record_points=steps)

    def e_of(values):
        r = Steps(times=tuple(T * np.arange(steps)), values=tuple(values))
        problem = problem_of(reference=r)
        (run,) = simulate(problem, [made], at).values()
        return run.e[:, 0], certify(problem, [made], at)[made.name].values["error_bound_held"]

    response = np.diff(
        e_of(np.ones(steps))[0]
    )  # the response to a step, whose differences are the response to r in a single sample
    e, bound = e_of(np.where(response[::-1] >= 0, 1.0, -1.0))
    assert 0.9 * bound < np.abs(e).max() <= bound


def test_what_the_bound_does_not_cover_is_said():
    made, at = L1OutputPiecewiseConstant(sample_time=0.01, filter=FILTER), Simulation(t_end=1.0, dt=0.01)

    def why(problem):
        found = certify(problem, [made], at)[made.name]
        assert "error_bound" not in found.values
        return found.entry("error_bound").why

    assert "disturbance at the output" in why(problem_of(output_disturbance=Constant(0.1)))
    assert "f(t, y)" in why(replace(problem_of(), plant=OutputPlant(PLANT, nonlinear="0.5*sin(y)")))
    assert "delay" in why(problem_of(input=PlantInput(delay=0.01)))
    assert "noise" in why(problem_of(sensor=Sensor(noise=Noise(std=0.1, sample_time=0.01, seed=1))))


@pytest.mark.full
def test_the_delay_margin_is_that_of_runs():
    made, at = L1OutputPiecewiseConstant(sample_time=0.01, filter=FILTER), Simulation(t_end=60.0, dt=5e-3)
    found = certify(problem_of(), [made], at)[made.name].values
    late = []
    for share in (0.97, 1.03):
        delayed = problem_of(reference=Constant(1.0), input=PlantInput(delay=share * found["delay_margin"]))
        (run,) = simulate(delayed, [made], at).values()
        e = np.abs(run.e[:, 0])
        late.append(e[-len(e) // 5 :].max() / e[len(e) // 5 : 2 * len(e) // 5].max())
    assert late[0] < 1 < late[1]


def test_the_certificate_claims_no_more_than_it_knows():
    made = L1OutputPiecewiseConstant(sample_time=0.01, filter=FILTER)
    at = Simulation(t_end=1.0, dt=0.01)

    def stability(problem):
        certificates = certify(problem, [made], at)
        return table_1(problem, [made], certificates).columns[0].cells["stability"].kind

    assert stability(problem_of()) == "guaranteed"
    assert stability(problem_of(input=PlantInput(saturation=[-1.0, 1.0]))) == "does not apply"
    with_f = replace(problem_of(), plant=OutputPlant(PLANT, nonlinear="0.5*sin(y)"))
    assert stability(with_f) == "does not apply"
    lost = problem_of(input=PlantInput(delay=1.0))
    assert stability(lost) == "does not apply"
    assert "unstable" in certify(lost, [made], at)[made.name].entry("delay_margin").why


def test_what_does_not_fit_is_refused():
    slow = L1OutputPiecewiseConstant(sample_time=0.01, filter=TF([20.0], [1.0, 20.0]))
    assert "relative degree of at least 2" in refusal(lambda: slow.bind(problem_of().known))
    gradient = L1Output(m=3.0, gamma=10.0, filter=FILTER)
    assert "l1-output-piecewise" in refusal(lambda: gradient.bind(problem_of().known))
    assert refusal(lambda: L1OutputPiecewiseConstant(sample_time=0.0, filter=FILTER)).startswith("sample_time")
    assert "C(0) = 1" in refusal(lambda: L1OutputPiecewiseConstant(sample_time=0.1, filter=TF([2.0], [1.0, 1.0])))
    limited = L1OutputPiecewiseConstant(sample_time=0.1, filter=FILTER, saturated_predictor=True)
    assert "saturation" in refusal(lambda: limited.bind(problem_of().known))
