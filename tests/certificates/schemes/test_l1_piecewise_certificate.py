"""The certificate of the piecewise-constant law, compared with simulations and independent computations."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from contradictions import at_stake, claims_where_nothing_holds, exceeded, judged
from mixtures import SIMULATION as MIXED
from mixtures import state_feedback
from scipy.linalg import expm

from barbalat import (
    L1PiecewiseConstant,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    simulate,
)
from barbalat.cases.load import load_case
from barbalat.controllers.l1_piecewise import input_directions
from barbalat.laws import AsFlown
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.problem.regressors import Polynomial
from barbalat.signals import Constant, Sine, Square
from independent import refusal

SIMULATION = Simulation(t_end=1.0, dt=1e-3)


def certified(problem, controller, *keys):
    return certify(problem, [controller], SIMULATION, keys=keys or None)[controller.name]


def without_limits():
    """The bundled quadrotor as a linear loop with one pulse of disturbance: motors, delay, both forms."""
    case = load_case("quadrotor-pitch")
    plant = replace(case.problem.plant, input=replace(case.problem.plant.input, saturation=None), x0=[0.1, 0.0])
    laws = [replace(law, saturated_predictor=False) for law in case.controllers if isinstance(law, L1PiecewiseConstant)]
    return replace(case.problem, plant=plant, disturbance=None, reference=Constant(0.0)), laws


def grows(problem, law, dt):
    """Whether the last quarter of 40 s is larger than the preceding one. See below for the factor by which a mode near the margin
    changes."""
    run = simulate(problem, [law], Simulation(t_end=40.0, dt=dt))[law.name]
    x = np.abs(run.envelope.e_max[:, 0])
    quarters = [part.max() for part in np.array_split(x, 4)]
    return quarters[3] > quarters[2]


@pytest.mark.parametrize("form", [0, 1])
def test_the_delay_margin_is_where_a_simulation_begins_to_grow(form):
    """Runs have delays 2 % below and above the margin, and the delay ends within a sample."""
    problem, laws = without_limits()
    entry = certified(problem, laws[form], "delay_margin").entry("delay_margin")
    assert entry.kind == "exact" and "in sampled-data form" in entry.of
    dt = laws[form].sample_time / 8
    for share, lost in ((0.98, False), (1.02, True)):
        delay = dt * round((problem.delay + share * entry.value) / dt)
        assert delay % laws[form].sample_time > dt / 2
        late = replace(problem, plant=replace(problem.plant, input=replace(problem.plant.input, delay=delay)))
        assert grows(late, laws[form], dt) == lost


@pytest.mark.parametrize(("reach", "lost"), [(0.3, False), (9.0, True)])
def test_margins_over_the_known_set_are_those_of_its_plants(reach, lost):
    """At the worst theta found, the certificate of that plant alone states the same delay margin, or an unstable loop."""
    problem = Problem(
        plant=Plant(A=[[0.0, 1.0], [0.0, -4.0]], b=[0.0, 60.0], A_m=[[0.0, 1.0], [-25.0, -8.0]], input=PlantInput(delay=0.008)),
        reference_model=ReferenceModel(k_0=25 / 60),
        reference=Constant(1.0),
    )
    own = problem.plant.theta
    over = replace(problem, uncertainty=ParameterBox(lower=own - reach * np.abs(own), upper=own + reach * np.abs(own)))
    law = L1PiecewiseConstant(sample_time=0.01, filter=input_filter(kappa=0.05))
    (loop,) = certified(over, law, "margins_over_known_set").values["margins_over_known_set"]
    assert ("unstable_at" in loop) == lost
    worst = loop["unstable_at"] if lost else loop["delay_margin"]["theta"]
    moved = Plant(A_m=problem.plant.A_m, b=problem.plant.b, theta=worst, input=problem.plant.input)
    found = certified(replace(problem, plant=moved), law, "spectral_radius", "delay_margin").values
    assert (found["spectral_radius"] >= 1) == lost
    assert lost or found["delay_margin"] == pytest.approx(loop["delay_margin"]["value"], rel=1e-9)


@pytest.mark.parametrize("form", [0, 1])
def test_the_gain_margins_are_where_a_simulation_begins_to_grow(form):
    problem, laws = without_limits()
    found = certified(problem, laws[form], "gain_margin").values
    for share, lost in ((0.97, False), (1.03, True)):
        stronger = replace(problem.plant.input, gain=share * found["gain_margin"])
        assert grows(replace(problem, plant=replace(problem.plant, input=stronger)), laws[form], 1.25e-3) == lost


def two_inputs(gains=(1.0, 1.0)):
    """A coupled plant of third order with one pulse of disturbance and with motors and a delay at both inputs."""
    plant = Plant(
        A_m=[[-1.0, 1.0, 0.0], [0.0, -2.0, 0.5], [0.2, 0.0, -1.0]], b=[[1.0, 0.2], [0.0, 1.0], [0.3, 0.4]],
        theta=[0.5, -0.8, 1.2, 0.4, 0.1, -0.2], x0=[0.3, -0.2, 0.1],
        input=[PlantInput(delay=0.03, actuator=TransferFunction([30.0], [1.0, 30.0]), gain=gain) for gain in gains],
    )  # fmt: skip
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=(Constant(0.0), Constant(0.0)))


OF_TWO = L1PiecewiseConstant(sample_time=0.05, filter=input_filter(0.1))


def grows_of_two(problem, law):
    """Whether the last quarter of 60 s is larger than the preceding one, over all states."""
    run = simulate(problem, [law], Simulation(t_end=60.0, dt=0.01))[law.name]
    quarters = [np.abs(part).max() for part in np.array_split(run.envelope.e_max, 4)]
    return run.diverged_at is not None or quarters[3] > quarters[2]


@pytest.mark.parametrize("which", ["both", "first", "second"])
@pytest.mark.short(kept=lambda which: which == "both")
def test_gain_margins_of_several_inputs_are_where_a_simulation_begins_to_grow(which):
    values = certified(two_inputs(), OF_TWO, "gain_margin", "gain_margin_each").values
    moved = {"both": (1, 1), "first": (1, 0), "second": (0, 1)}[which]
    margin = values["gain_margin"] if which == "both" else values["gain_margin_each"][which == "second"]
    for share, lost in ((0.97, False), (1.03, True)):
        gains = [1 + (share * margin - 1) * one for one in moved]
        assert grows_of_two(two_inputs(gains=gains), OF_TWO) == lost


class LateAtOneInput:
    """The law with one entry of u delayed by this many samples, as a class from outside the package."""

    name = "late"

    def __init__(self, law, late):
        self.law, self.late = law, late

    def bind(self, known):
        return LateEquations(self.law.bind(known), self.late)


class LateState(NamedTuple):
    theta_hat: object
    law: object
    earlier: object  # the values of the entry at the last samples


class LateEquations:
    def __init__(self, law, late):
        self.law, self.late, self.sample_time = law, late, law.sample_time

    def initial(self):
        return LateState(np.zeros(0), self.law.initial(), np.zeros(max(self.late)))

    def control(self, state, x, x_m, r):
        u, at = self.law.control(state.law, x, x_m, r), int(np.argmax(self.late))
        return np.concatenate([u[:at], state.earlier[-1:], u[at + 1 :]])

    def advance(self, state, before, u, now):
        asked, at = self.law.control(state.law, before.x, before.x_m, before.r), int(np.argmax(self.late))
        earlier = np.concatenate([asked[at].reshape(1), state.earlier[:-1]])
        return LateState(state.theta_hat, self.law.advance(state.law, before, asked, now), earlier)


@pytest.mark.parametrize("at", [0, 1])
@pytest.mark.short(kept=lambda at: at == 1)
def test_the_delay_margin_of_one_input_is_between_two_whole_numbers_of_samples(at):
    """The law assumes that the u that it commanded reaches the plant, as it does with a delay of the plant."""
    samples = certified(two_inputs(), OF_TWO, "delay_margin_each").values["delay_margin_each"][at] / OF_TWO.sample_time
    assert 1 < samples < 40
    for late, lost in ((int(samples), False), (int(samples) + 1, True)):
        assert grows_of_two(two_inputs(), LateAtOneInput(OF_TWO, late * np.eye(2, dtype=int)[at])) == lost


def test_the_sensitivity_peak_by_frequencies():
    """The loop of the exact form without actuator is written by hand from the identity of §10, with the peak over a dense
    grid."""
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 2.0], theta=[1.0, -0.5])
    T, kappa = 0.02, 0.1
    law = L1PiecewiseConstant(sample_time=T, filter=input_filter(kappa))
    values = certified(Problem(plant=plant), law).values
    E, B, b = expm(plant.A_m * T), input_directions(plant.b), plant.b
    Phi = np.linalg.solve(plant.A_m, E - np.eye(2))
    K = np.linalg.solve(Phi @ B, E)  # sigma_hat = K (x - E x/z - Phi b u/z)
    A = plant.A_m + np.outer(b, plant.theta)
    held = expm(T * np.block([[A, b[:, None]], [np.zeros((1, 3))]]))
    F, G = held[:2, :2], held[:2, 2]
    z = np.exp(1j * np.geomspace(1e-4, np.pi, 20_000))
    s = 2 / T * (z - 1) / (z + 1 + 1e-30)
    C = 1 / (kappa * s + 1)
    P = np.linalg.solve(z[:, None, None] * np.eye(2) - F, np.broadcast_to(G[:, None], (len(z), 2, 1)))[..., 0]
    L = C * (K[0] @ P.T - K[0] @ E @ P.T / z) / (1 - C * (K[0] @ Phi @ b) / z)
    assert values["sensitivity_peak"] == pytest.approx(np.abs(1 / (1 + L)).max(), rel=1e-5)
    assert values["complementary_sensitivity_peak"] == pytest.approx(np.abs(L / (1 + L)).max(), rel=1e-5)


@pytest.mark.parametrize("flown", [None, AsFlown(predictor_poles=-4.0, nominal=[0.5, 0.0])])
def test_noise_in_a_simulation_is_what_is_certified(flown):
    """The tolerance is 3 %. For some 10 000 independent values 1/sqrt(2 N) is 0.7 %, and the values of u are correlated over the
    filter's 10 samples."""
    T, s = 0.01, 0.02
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 2.0], theta=[1.0, -0.5])
    sensor = Sensor(noise=Noise(std=s, sample_time=T, seed=5))
    problem = Problem(plant=plant, reference=Constant(0.0), sensor=sensor)
    law = L1PiecewiseConstant(sample_time=T, filter=input_filter(0.1), as_flown=flown)
    values = certified(problem, law, "noise_in_sigma_hat", "noise_in_u").values
    run = simulate(problem, [law], Simulation(t_end=200.0, dt=T, record_points=20_000))[law.name]
    np.testing.assert_allclose(run.reported["sigma_hat"].std(axis=0), s * np.array(values["noise_in_sigma_hat"]), rtol=0.03)
    np.testing.assert_allclose(run.u.std(), s * np.array(values["noise_in_u"])[0], rtol=0.05)


def test_the_margin_of_short_samples_is_that_of_the_reference_system(section_v):
    problem = replace(section_v, uncertainty=None)
    away = []
    for T in (4e-3, 1e-3):
        values = certified(problem, L1PiecewiseConstant(sample_time=T, filter=input_filter(0.02))).values
        away.append(abs(values["delay_margin"] - values["delay_margin_reference"]))
    assert away[1] < 0.03 * values["delay_margin_reference"]
    assert away[1] < 0.35 * away[0]


def reference_at_samples(problem, law, r, parts=1):
    """x_ref under the held commands r (N,), by a single exponential, with one input and a filter of first order, by hand.

    The result (N parts, n) has ``parts`` instants in each sample.
    """
    plant, kappa, n = problem.plant, 1 / law.filter.den[-1], problem.plant.n
    theta, theta_0 = plant.theta, np.zeros(n) if law.as_flown is None else np.array(law.as_flown.nominal)
    A = np.zeros((n + 2, n + 2))  # x_ref, C's output, r
    k_0 = problem.reference_model.k_0
    A[:n, :n] = plant.A_m + np.outer(plant.b, theta - theta_0)
    A[:n, n] = plant.b
    A[n, :n], A[n, n] = -(theta - theta_0) / kappa, -1 / kappa
    if law.as_flown is None:
        A[n, n + 1] = k_0 / kappa
    else:
        A[:n, n + 1] = plant.b * k_0
    step, state, found = expm(A * law.sample_time / parts), np.concatenate([plant.x0, [0.0, 0.0]]), []
    for value in r:
        state[-1] = value
        for _ in range(parts):
            found.append(state[:n])
            state = step @ state
    return np.array(found)


def test_no_run_is_farther_from_the_reference_system_than_is_guaranteed(sample):
    random, close, least = np.random.default_rng(11), 0.0, np.inf
    for i in range(sample(4, 60)):
        n = int(random.integers(1, 4))
        b = np.zeros(n)
        b[-1] = random.choice([1.0, -0.7])
        A_m = np.eye(n, k=1)
        A_m[-1] = -np.poly(-random.uniform(0.5, 2.5, n))[1:][::-1]
        plant = Plant(A_m=A_m, b=b, theta=random.uniform(-1.5, 1.5, n), x0=random.uniform(-1, 1, n))
        signal = (Sine(1.3, random.uniform(0.5, 8.0)), Square(1.3, random.uniform(0.5, 3.0)), Constant(-1.3))[i % 3]
        problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.5), reference=signal)
        flown = AsFlown(predictor_poles=-5.0, nominal=random.uniform(-1, 1, n)) if i % 2 else None
        law = L1PiecewiseConstant(sample_time=float(random.choice([0.01, 0.05])), filter=input_filter(0.1), as_flown=flown)
        found = certified(problem, law, "reference_distance", "reference_distance_between")
        entry = found.entry("reference_distance")
        if entry.value is None:
            assert "unstable" in entry.why
            continue
        assert entry.kind == "guaranteed"
        T = law.sample_time
        run = simulate(problem, [law], Simulation(t_end=20.0, dt=T / 2, record_points=round(40 / T)))[law.name]
        x, r = run.x[::2], run.r[::2]
        away = np.abs(x - reference_at_samples(problem, law, r)).max()
        assert away <= entry.value
        between = found.entry("reference_distance_between")
        assert between.kind == "guaranteed"
        least = min(least, between.value / entry.value)
        assert np.abs(run.x - reference_at_samples(problem, law, r, parts=2)[: len(run.x)]).max() <= between.value
        close = max(close, away / entry.value)
    assert least < 1.1  # if samples are short compared with the motion, little is added between them
    assert close > 0.3  # the bound is not far too large: one of the commands comes near it


@pytest.mark.full
@pytest.mark.parametrize("form", ["exact", "as flown", "T assumed apart"])
@pytest.mark.parametrize("seed", range(4))
def test_the_distance_of_several_inputs_is_kept(seed, form):
    """The reference system of two inputs is computed by one exponential, as above. One case assumes a T that is too short by a
    third."""
    random, n, m, T = np.random.default_rng(seed), 3, 2, 2.0**-6
    A_m = random.normal(size=(n, n))
    A_m -= (np.linalg.eigvals(A_m).real.max() + 0.8) * np.eye(n)
    b, theta, k_0, kappa = random.normal(size=(n, m)), random.uniform(-0.5, 0.5, (n, m)), random.normal(size=(m, 1)), 0.1
    plant = Plant(A_m=A_m, b=b, theta=theta, x0=random.normal(size=n))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=k_0), reference=[Square(1.3, random.uniform(0.5, 3.0))])
    theta_0 = np.zeros((n, m)) if form == "exact" else random.uniform(-0.3, 0.3, (n, m))
    assumed = 0.75 * T if form == "T assumed apart" else None
    flown = AsFlown(nominal=theta_0.reshape(-1), assumed_sample_time=assumed)
    law = L1PiecewiseConstant(sample_time=T, filter=input_filter(kappa), as_flown=None if form == "exact" else flown)
    found = certified(problem, law, "reference_distance", "reference_distance_between")
    assert {"reference_distance", "reference_distance_between"} <= found.guaranteed
    A = np.zeros((n + m + 1, n + m + 1))  # x_ref, C's outputs, r
    A[:n, :n], A[:n, n:-1] = A_m + b @ (theta - theta_0).T, b
    A[n:-1, :n], A[n:-1, n:-1] = -(theta - theta_0).T / kappa, -np.eye(m) / kappa
    A[(slice(n, -1) if form == "exact" else slice(n)), -1:] = k_0 / kappa if form == "exact" else b @ k_0
    run = simulate(problem, [law], Simulation(t_end=10.0, dt=T / 2, record_points=10_000))[law.name]
    step, state, away = expm(A * T / 2), np.concatenate([plant.x0, np.zeros(m + 1)]), []
    for k, r in enumerate(run.r.reshape(-1)):
        state[-1] = r if k % 2 == 0 else state[-1]
        away.append(np.abs(run.x[k] - state[:n]).max())
        state = step @ state
    assert max(away[::2]) <= found.values["reference_distance"]
    assert max(away) <= found.values["reference_distance_between"]
    assert max(away[::2]) > 0.01 * found.values["reference_distance"]


def test_the_entries_of_the_form_as_flown():
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0])
    law = L1PiecewiseConstant(
        sample_time=2e-4, filter=input_filter(0.01), as_flown=AsFlown(predictor_poles=-10.0, assumed_sample_time=1e-3)
    )
    values = certified(Problem(plant=plant), law).values
    assert values["sample_time_ratio"] == pytest.approx(0.2)
    assert values["baseline_gain"] == pytest.approx(5.0)
    assert values["disturbance_left"] == [pytest.approx(-np.expm1(-10.0 * 1e-3))]


def test_the_dc_gain_is_that_of_the_exact_form():
    plant = Plant(A_m=[[-2.0, 1.0], [0.3, -1.0]], b=[1.0, 0.4], theta=[0.0, 0.0])
    values = certified(Problem(plant=plant), L1PiecewiseConstant(sample_time=0.1, filter=input_filter(0.1))).values
    B = input_directions(plant.b)
    np.testing.assert_allclose(values["sigma_hat_at_dc"], np.linalg.solve(B, expm(0.1 * plant.A_m) @ B), atol=1e-12)


def test_what_it_does_not_know_is_said():
    """The certificate says so for nonlinear plants and unstable loops."""
    nonlinear = Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0, 0.5], regressor=Polynomial(degree=2))
    law = L1PiecewiseConstant(sample_time=0.01, filter=input_filter(0.1))
    found = certified(Problem(plant=nonlinear), law)
    assert found.guaranteed == frozenset() and "phi(x) = x" in found.entry("delay_margin").why
    unstable = Problem(plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[30.0], input=PlantInput(delay=0.2)))
    found = certified(unstable, law)
    assert "the sampled-data loop is unstable" in found.entry("delay_margin").why and found.values["spectral_radius"] > 1
    plant = Plant(A_m=-np.eye(2), b=np.eye(2), theta=[0.3, 0.0, 0.1, 0.2])
    several = Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=(Constant(1.0), Sine(1.0, 1.0)))
    found = certified(several, replace(law, filter=TransferFunction([9.0], [1.0, 4.2, 9.0])))
    assert "reference_distance" in found.guaranteed and "in all inputs" in found.notes[0]


def test_no_mixture_of_what_disturbs_does_what_is_denied(sample):
    """No run of the seeded problems with delays, limits, noise, nonlinear regressors and several inputs contradicts its
    certificate."""
    judged_ones = 0
    for seed in range(sample(4, 30)):
        random = np.random.default_rng([seed, 7])
        problem = state_feedback(random)
        flown = AsFlown(predictor_poles=-random.uniform(0, 9)) if seed % 2 else None
        law = L1PiecewiseConstant(sample_time=0.02, filter=input_filter(10 ** random.uniform(-1.5, -0.5)), as_flown=flown)
        if problem.input_gain is not None:
            assert "input gain" in refusal(lambda law=law, problem=problem: law.bind(problem.known))
            continue
        certificate, column = judged(problem, law)
        assert not claims_where_nothing_holds(certificate, column), seed
        if at_stake(certificate, column):
            judged_ones += 1
            (run,) = simulate(problem, [law], MIXED).values()
            assert not exceeded(certificate, column, run), seed
    assert judged_ones > 0


@pytest.mark.parametrize("T", [1e-3, 1e-2, 0.1, 0.2])
@pytest.mark.short(kept=lambda T: T > 1e-3)
def test_a_longer_sample_lets_less_noise_through(T):
    """White noise through s(1 - 1/z)/T and C by the trapezoidal rule has a closed form if the plant hardly moves within a sample.

    C = g (1 + 1/z)/(1 + g - (1 - g)/z) with g = omega_c T/2. Its response to (1 - 1/z)/T has the energy omega_c^2/(2 (1 + g)^2).
    The plant's time constant is 100 s, so the formula's relative error is about T/100 s plus 0.1 s/100 s, where 0.1 s is the time
    constant of C.
    """
    bandwidth = 10.0
    problem = Problem(
        plant=Plant(A_m=[[-0.01]], b=[1.0], theta=[0.0]),
        reference=Constant(0.0),
        sensor=Sensor(noise=Noise(std=1.0, sample_time=T)),
    )
    law = L1PiecewiseConstant(sample_time=T, filter=input_filter(1 / bandwidth))
    values = certify(problem, [law], Simulation(t_end=10 * T, dt=T), keys=("noise_in_sigma_hat",))[law.name].values
    assert values["noise_in_sigma_hat"][0] == pytest.approx(np.sqrt(2) / T, rel=0.005)
    assert values["noise_in_u"][0] == pytest.approx(bandwidth / (np.sqrt(2) * (1 + bandwidth * T / 2)), rel=0.005)
