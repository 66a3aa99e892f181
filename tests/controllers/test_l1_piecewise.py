"""The piecewise-constant L1 law, compared with SciPy's discretisations, formulas by hand and simulations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, lfilter, ss2tf

from barbalat import (
    L1Adaptive,
    L1PiecewiseConstant,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    TransferFunction,
    input_filter,
    simulate,
)
from barbalat.controllers.l1_piecewise import input_directions, realisation, started
from barbalat.laws import AsFlown
from barbalat.plants import Disturbance, Noise, PlantInput, Sensor
from barbalat.protocols import Sample
from barbalat.signals import Constant, Sine, Step
from independent import EPS, refusal

SECOND = TransferFunction([900.0], [1.0, 42.0, 900.0])


def second_order(**more):
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 2.0], theta=[1.0, -0.5], x0=[0.5, -0.5])
    given = {"reference_model": ReferenceModel(k_0=2.0), "reference": Sine(2.0, 1.0)}
    return Problem(plant=plant, **(given | more))


def several_inputs(**more):
    plant = Plant(
        A_m=[[-2.0, 1.0, 0.0], [0.0, -3.0, 0.5], [0.2, 0.0, -1.0]], b=[[1.0, 0.2], [0.0, 1.0], [0.3, 0.0]],
        theta=[0.5, -0.3, 0.2, 0.4, 0.1, -0.2], x0=[0.3, -0.2, 0.1],
    )  # fmt: skip
    model = ReferenceModel(k_0=[[2.0, 0.0], [0.0, 3.0]])
    return Problem(plant=plant, reference_model=model, **({"reference": (Sine(1.0, 0.7), Sine(0.5, 1.3))} | more))


def sampled_run(problem, controller, t_end=6.0, steps=4):
    """x, r, u and sigma_hat at the samples, u and sigma_hat after them."""
    dt = controller.sample_time / steps
    run = simulate(problem, [controller], Simulation(t_end=t_end, dt=dt, record_points=round(t_end / dt)))[controller.name]
    at = slice(None, -1, steps)
    return run, run.x[at], run.r[at], run.u[at], run.reported["sigma_hat"][at]


def unfold(values):
    return values.reshape(len(values), -1)


CASES = {
    "exact": (second_order(), L1PiecewiseConstant(sample_time=0.02, filter=SECOND)),
    "no filter": (second_order(), L1PiecewiseConstant(sample_time=0.02, filter=None)),
    "compensated": (second_order(), L1PiecewiseConstant(sample_time=0.02, filter=SECOND, output=[1.0, 0.0])),
    "several": (several_inputs(), L1PiecewiseConstant(sample_time=0.02, filter=input_filter(0.1))),
    "several, compensated": (
        several_inputs(),
        L1PiecewiseConstant(sample_time=0.02, filter=input_filter(0.1), output=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.2]]),
    ),
    "flown": (
        second_order(),
        L1PiecewiseConstant(sample_time=0.02, filter=SECOND, as_flown=AsFlown(predictor_poles=[-5.0, -9.0], nominal=[0.4, 0.1])),
    ),
    "flown, several, another T": (
        several_inputs(),
        L1PiecewiseConstant(
            sample_time=0.02, filter=input_filter(0.1), as_flown=AsFlown(predictor_poles=-3.0, assumed_sample_time=0.03)
        ),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_the_linear_time_invariant_realisation(name):
    """The tolerance is 1e-11: roundings of numbers of size 1 in 300 samples, times 1/T in sigma_hat."""
    problem, controller = CASES[name]
    _, x, r, u, _ = sampled_run(problem, controller)
    equations = controller.bind(problem.known)
    found, state = realisation(equations), started(equations, x[0], r[0])
    computed = []
    for measured in np.hstack([x, unfold(r)]):
        computed.append(found.C @ state + found.D @ measured)
        state = found.A @ state + found.B @ measured
    np.testing.assert_allclose(unfold(u), computed, rtol=0, atol=1e-11 * np.abs(u).max() / controller.sample_time)


@pytest.mark.parametrize("name", ["exact", "several"])
def test_the_estimate_is_a_difference_of_two_measurements(name):
    """sigma_hat[i+1] = B^-1 Phi^-1 e^(A_m T) (x[i+1] - e^(A_m T) x[i] - Phi b u[i]) has no gain and no state."""
    problem, controller = CASES[name]
    plant, T = problem.plant, controller.sample_time
    _, x, _, u, sigma_hat = sampled_run(problem, controller)
    E, B = expm(plant.A_m * T), input_directions(plant.b)
    assert np.abs(B[:, plant.inputs :].T @ plant.b.reshape(plant.n, -1)).max() < 10 * EPS
    Phi = np.linalg.solve(plant.A_m, E - np.eye(plant.n))
    what = x[1:].T - E @ x[:-1].T - Phi @ plant.b.reshape(plant.n, -1) @ unfold(u[:-1]).T
    np.testing.assert_allclose(sigma_hat[1:].T, np.linalg.solve(B, np.linalg.solve(Phi, E @ what)), atol=1e-10)


@pytest.mark.parametrize("name", ["exact", "several"])
def test_u_is_what_scipys_trapezoidal_rule_makes_of_the_estimates(name):
    """The two agree from 5 s on. SciPy's filter starts before the first sample and the package's filter starts at it, but by then
    the initial values have decayed by e^-50."""
    problem, controller = CASES[name]
    m, T, C = problem.plant.inputs, controller.sample_time, controller.filter
    _, _, r, u, sigma_hat = sampled_run(problem, controller)
    wanted = unfold(r) @ np.reshape(problem.reference_model.k_0, (m, -1)).T - sigma_hat[:, :m]
    num, den, _ = cont2discrete((C.num, C.den), T, "bilinear")
    np.testing.assert_allclose(unfold(u)[250:], lfilter(num[0], den, wanted, axis=0)[250:], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("a", "left"), [(-5.0, 0.0124), (-10.0, 0.0247)])
def test_what_is_left_of_a_constant_disturbance_at_400_hz(a, left):
    """sigma_hat tends to e^(aT) times the disturbance, so 1.24 % and 2.47 % remain for any C."""
    T, plant = 1 / 400, Plant(A_m=[[-2.0]], b=[1.0], theta=[0.0])
    problem = Problem(plant=plant, disturbance=Constant(3.0), reference=Constant(0.0))
    flown = L1PiecewiseConstant(sample_time=T, filter=input_filter(0.05), as_flown=AsFlown(predictor_poles=a))
    run, *_ = sampled_run(problem, flown, t_end=20.0, steps=1)
    assert 1 - run.figures["sigma_hat_final"][0] / 3.0 == pytest.approx(left, abs=5e-5)
    assert 1 - run.figures["sigma_hat_final"][0] / 3.0 == pytest.approx(-np.expm1(a * T), rel=1e-6)


def test_the_dc_gain_of_the_exact_form_with_any_input_matrix():
    """The gain is B^-1 e^(A_m T) B for a matched and an unmatched constant."""
    given = several_inputs()
    B, T = input_directions(given.plant.b), 0.05
    sigma = np.array([1.0, -2.0, 0.7])
    plant = Plant(A_m=given.plant.A_m, b=given.plant.b, theta=np.zeros(6))
    acts = (Disturbance(direction=B @ sigma, signal=Constant(1.0)),)
    quiet = (Constant(0.0), Constant(0.0))
    problem = Problem(plant=plant, reference_model=given.reference_model, reference=quiet, unmatched=acts)
    controller = L1PiecewiseConstant(sample_time=T, filter=input_filter(0.1))
    run, *_ = sampled_run(problem, controller, t_end=40.0, steps=2)
    expected = np.linalg.solve(B, expm(plant.A_m * T) @ B @ sigma)
    np.testing.assert_allclose(run.figures["sigma_hat_final"], expected, atol=1e-8)
    assert np.abs(expected - sigma).max() > 0.03


def integrator(**more):
    """The plant x' = u + d with the baseline u_b = r - x in A_m."""
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0], **({"x0": more.pop("x0")} if "x0" in more else {}))
    return Problem(plant=plant, **({"reference": Step(1.0, start=0.0)} | more))


def flown(T, kappa, *, assumed=None, a=0.0):
    C = None if kappa is None else input_filter(kappa)
    return L1PiecewiseConstant(
        sample_time=T, filter=C, as_flown=AsFlown(predictor_poles=a, nominal=[1.0], assumed_sample_time=assumed)
    )


def test_on_an_integrator_with_a_at_zero_it_is_a_pi():
    """u = -[z D/((z - 1) N) + (z + 1) g/(N T)] x, N = (1 + g) z + g, D = (1 + g) z + g - 1, g = w_c T/2.

    This follows by hand from sigma_hat = (1 - 1/z) x/T - u/z and C = g (z + 1)/D. For T -> 0 it is -(1 + w_c + w_c/s) x.
    """
    T, w_c = 0.01, 4.0
    g = w_c * T / 2
    found = realisation(flown(T, 1 / w_c).bind(integrator().known))
    num, den = ss2tf(found.A, found.B[:, :1], found.C, found.D[:, :1])
    N, D = np.array([1 + g, g]), np.array([1 + g, g - 1])
    w = np.exp(1j * np.array([0.01, 0.3, 1.5, 3.0]))
    PI = np.polyval(np.polymul([1, 0], D), w) / np.polyval(np.polymul([1, -1], N), w)
    PI = PI + np.polyval([g, g], w) / np.polyval(N * T, w)
    np.testing.assert_allclose(np.polyval(num[0], w) / np.polyval(den, w), -PI, rtol=1e-9)
    slow = flown(1e-5, 1 / w_c)
    found, s = realisation(slow.bind(integrator().known)), 2j
    z = np.exp(s * 1e-5)
    value = (found.C @ np.linalg.solve(z * np.eye(len(found.A)) - found.A, found.B) + found.D)[0, 0]
    assert value == pytest.approx(-(1 + w_c + w_c / s), rel=1e-4)


def test_the_integral_action_of_that_pi_takes_a_constant_disturbance_away():
    run, x, *_ = sampled_run(integrator(disturbance=Constant(0.7)), flown(0.01, 0.25), t_end=30.0)
    assert x[-1, 0] == pytest.approx(1.0, abs=1e-9)
    assert run.diverged_at is None


@pytest.mark.parametrize("T", [0.001, 0.004])
def test_noise_grows_in_the_estimate_and_not_in_u(T):
    """The deviation is s sqrt(2)/T in sigma_hat and s w_c/sqrt(2) in u, as the trapezoidal rule's mean of two samples divides by
    sqrt(2).

    The tolerance is 5 %: 1/sqrt(2 N) for N >= 5000 samples is 1 %, and the loop's response and w_c T are about 2 %. It is 15 % in
    u, because the baseline, with a gain of 1 compared with w_c = 10, adds its own part. The certificate has the exact value.
    """
    s, w_c = 0.01, 10.0
    problem = integrator(reference=Constant(0.0), sensor=Sensor(noise=Noise(std=s, sample_time=T, seed=2)))
    _, _, _, u, sigma_hat = sampled_run(problem, flown(T, 1 / w_c), t_end=40.0, steps=1)
    assert sigma_hat.std() == pytest.approx(s * np.sqrt(2) / T, rel=0.05)
    assert u.std() == pytest.approx(s * w_c / np.sqrt(2), rel=0.15)


def test_a_loop_that_runs_five_times_as_fast_as_told_has_five_times_its_baseline():
    """For x' = u = u_b/(1 - (1 - r) C) with a fast C, x tends to r as 1 - e^(-5 t), and with the baseline alone as 1 - e^(-t).

    The tolerance 0.01 is twice the effect of a sample and five times C's lag, 1 ms together, at the largest slope of 5/s.
    """
    T = 2e-4
    run, x, *_ = sampled_run(integrator(), flown(T, 0.0004, assumed=5 * T), t_end=0.5)
    t = T * np.arange(len(x))
    np.testing.assert_allclose(x[:, 0], -np.expm1(-5 * t), atol=0.01)
    assert run.diverged_at is None
    _, x, *_ = sampled_run(integrator(), flown(T, 0.0004), t_end=0.5)
    np.testing.assert_allclose(x[:, 0], -np.expm1(-t), atol=0.002)


@pytest.mark.parametrize(("ratio", "lost"), [(1.9, False), (2.1, True)])
def test_without_the_filter_it_is_lost_at_twice_the_assumed_sample_time(ratio, lost):
    """Without the filter, u[k] = u_b - (r - 1) u[k-1]. With the filter the loop tolerates the same ratio."""
    T = 1e-3
    run, *_ = sampled_run(integrator(), flown(T, None, assumed=T / ratio), t_end=5.0, steps=1)
    assert (run.diverged_at is not None or np.abs(run.u).max() > 1e3) == lost
    run, *_ = sampled_run(integrator(), flown(T, 0.05, assumed=T / ratio), t_end=5.0, steps=1)
    assert run.diverged_at is None and np.abs(run.e).max() < 1


def test_for_short_samples_section_v_has_the_tail_of_the_gradient_law_at_a_high_gain(section_v):
    """The difference is proportional to T, so two sample times give the limit. The tolerance is 1 %, of which the gradient law's
    own sample time causes 0.6 %.

    The sampled gradient law tolerates Gamma = 1e8. There is no known set, because its projection would act.
    """
    problem = Problem(plant=section_v.plant, reference_model=section_v.reference_model, reference=section_v.reference)
    C = input_filter(0.02)

    def tail(law, T):
        return np.array(simulate(problem, [law], Simulation(t_end=40.0, dt=T))[law.name].figures["tail_max_abs_e"])

    gradient = tail(Sampled(controller=L1Adaptive(gamma=1e8, filter=C), sample_time=1e-4), 1e-4)
    four, two, one = (tail(L1PiecewiseConstant(sample_time=T, filter=C), T) for T in (2e-3, 1e-3, 5e-4))
    np.testing.assert_allclose(2 * one - two, gradient, rtol=0.01)
    np.testing.assert_allclose((four - two) / (two - one), 2.0, rtol=0.15)  # the next order, T^2, is a tenth at 2 ms


def test_what_is_unmatched_leaves_the_output_alone_where_that_is_asked():
    """A constant disturbance along A_m's first row moves x_1. With compensation only the estimate's error remains, e^(A_m T) -
    I."""
    acts = (Disturbance(direction=[1.0, 0.0], signal=Constant(1.0)),)
    left = {}
    for output in (None, [1.0, 0.0]):
        controller = L1PiecewiseConstant(sample_time=0.002, filter=SECOND, output=output)
        run, *_ = sampled_run(second_order(reference=Constant(0.0), unmatched=acts), controller, t_end=20.0, steps=1)
        left[output is None] = abs(run.x[-1, 0])
    assert left[True] > 1.0
    assert left[False] < 0.01 * left[True]


def test_the_compensation_is_the_inverse_over_all_frequencies():
    """C H_m^-1 H_um is computed by transfer functions. The samples are so short that the trapezoidal rule agrees with C(s)."""
    problem, T = second_order(), 1e-5
    plant, c = problem.plant, np.array([1.0, 0.0])
    f = L1PiecewiseConstant(sample_time=T, filter=SECOND, output=c).bind(problem.known).filter
    B = input_directions(plant.b)
    for s in (0.3j, 2j, 11j, 60j):
        H = c @ np.linalg.solve(s * np.eye(2) - plant.A_m, B)
        z = np.exp(s * T)
        found = (f.C @ np.linalg.solve(np.eye(len(f.A)) - f.A / z, f.B) * (1 + 1 / z) + f.D)[0]
        C = complex(SECOND.at(np.array(s)))
        np.testing.assert_allclose(found, [C, -C * H[1] / H[0]], rtol=1e-3)


def test_a_saturated_command_into_the_predictor_keeps_the_estimate():
    """With sat(u) sigma_hat equals the disturbance, of size 1. Without it, the missing input appears as a disturbance, and u
    diverges."""
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[0.0], input=PlantInput(saturation=[-1.0, 1.0]))
    problem = Problem(plant=plant, disturbance=Constant(-2.0), reference=Constant(3.0))
    runs = [
        sampled_run(problem, L1PiecewiseConstant(sample_time=0.01, filter=input_filter(0.1), saturated_predictor=on), t_end=10.0)[
            0
        ]
        for on in (False, True)
    ]
    assert abs(runs[1].figures["sigma_hat_final"][0] + 2.0) < 0.05
    assert np.abs(runs[1].u).max() < 6
    assert np.abs(runs[0].u).max() > 50


def test_frozen_it_keeps_its_estimate_and_follows_at_once_afterwards():
    problem, controller = CASES["exact"]
    run = sampled_run(problem, controller)[0]
    computer = run.loop.computer
    acting = computer.act(computer.initial(problem.plant.x0), problem.plant.x0, np.array(1.0))
    acting = computer.act(acting, problem.plant.x0 + 0.1, np.array(1.0))
    assert acting.controller.sigma_hat.any()
    frozen = computer.act(acting, problem.plant.x0 + 5.0, np.array(1.0), np.array(1.0))
    assert frozen.controller.sigma_hat.tolist() == acting.controller.sigma_hat.tolist()
    free = computer.act(acting, problem.plant.x0 + 5.0, np.array(1.0), np.array(0.0))
    assert np.abs(free.controller.sigma_hat - acting.controller.sigma_hat).max() > 1


def test_the_first_sample_says_nothing_of_what_acts():
    """The predictor starts at the measured state, wherever that is, so there is no start-up transient."""
    _, _, _, u, sigma_hat = sampled_run(*CASES["exact"])
    assert not sigma_hat[0].any() and u[0] == 0


def test_estimates_have_a_key_of_their_own():
    run, *_ = sampled_run(*CASES["several"])
    assert run.figures["theta_hat_final"] == []
    assert len(run.figures["sigma_hat_final"]) == 3
    assert set(run.columns()) >= {"sigma_hat_1", "sigma_hat_2", "sigma_hat_3"}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"sample_time": 0.0}, "sample_time"),
        ({"filter": TransferFunction([2.0], [1.0, 1.0])}, "filter must have unit DC gain"),
        ({"output": [1.0, 0.0]}, "relative degree 2 or more"),
        ({"output": [1.0, 0.0, 0.0]}, "output"),
        ({"output": [1.0, -1.0]}, "minimum-phase"),
        ({"output": [0.0, 0.0]}, "output must respond to an input"),
        ({"as_flown": "yes"}, "as_flown"),
    ],
)
def test_what_is_refused(change, word):
    problem = second_order()
    settings = {"sample_time": 0.01, "filter": input_filter(0.1)} | change
    assert word in refusal(lambda: L1PiecewiseConstant(**settings).bind(problem.known))


def test_the_filter_must_serve_the_output_of_the_highest_relative_degree():
    """The first output is two integrations away from its input and the second output one. C(s) = 1/(kappa s + 1) is sufficient
    only for the second."""
    plant = Plant(
        A_m=[[0.0, 1.0, 0.0], [-1.0, -2.0, 0.0], [0.0, 0.0, -1.0]], b=[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], theta=np.zeros(6)
    )
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=(Sine(1.0, 0.7), Sine(0.5, 1.3)))
    law = L1PiecewiseConstant(sample_time=0.01, filter=input_filter(0.1), output=[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert "relative degree 2 or more" in refusal(lambda: law.bind(problem.known))


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"predictor_poles": 1.0}, "at most 0"),
        ({"assumed_sample_time": -1.0}, "assumed_sample_time"),
        ({"nominal": [1.0]}, "nominal"),
    ],
)
def test_what_is_refused_of_the_form_as_flown(given, word):
    problem = second_order()
    made = lambda: L1PiecewiseConstant(sample_time=0.01, filter=None, as_flown=AsFlown(**given)).bind(problem.known)  # noqa: E731
    assert word in refusal(made)


def test_it_is_sampled_by_nature():
    law = L1PiecewiseConstant(sample_time=0.01, filter=None)
    assert "is already sampled" in refusal(lambda: Sampled(controller=law, sample_time=0.01).bind(second_order().known))


@pytest.mark.parametrize("gap", [1, 2, 3, 10, 200])
def test_after_a_gap_the_estimate_has_answered_once_what_acted_in_it(gap) -> None:
    """In one dimension the weight of a gap is exact, so the response to a jump at its beginning is as without a gap.

    The response to the next sample is the same too, because the predictor does not depend on its past.
    """
    a, T, steps = -2.0, 0.02, np.exp(-2.0 * 0.02)
    plant = Plant(A_m=[[a]], b=[1.0], theta=[0.0], x0=[0.0])
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(1.0, 1.0))
    controller = L1PiecewiseConstant(sample_time=T, filter=None)
    equations = controller.bind(problem.known)
    gain, state, x, sigma = (1 - steps) / 2.0, equations.initial(), np.zeros(1), 3.0
    r, u, measured = np.zeros(()), np.zeros(()), np.zeros(1)

    def moved(state, x, measured, lost):
        x = steps * x + gain * sigma
        y = measured if lost else x
        law = equations.freezing(np.bool_(lost))
        return law.advance(state, Sample(measured, y, r), u, Sample(y, y, r)), x, y

    for _ in range(5):
        state, x, measured = moved(state, x, measured, lost=False)
    np.testing.assert_allclose(state.sigma_hat, steps * 3.0, rtol=1e-12)
    sigma = 5.0
    for k in range(gap):
        state, x, measured = moved(state, x, measured, lost=k < gap - 1)
    np.testing.assert_allclose(state.sigma_hat, steps * 5.0, rtol=1e-10)
    state, x, measured = moved(state, x, measured, lost=False)
    np.testing.assert_allclose(state.sigma_hat, steps * 5.0, rtol=1e-10)
    assert state.span == 1
