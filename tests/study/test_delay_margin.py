"""Simulated delay margins by both criteria, compared with exact margins of linear loops and with brute force."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from barbalat.cases.load import load_case, parse_case
from barbalat.certificates.certify import certify
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.controllers import KnownParameters, L1Adaptive, Mrac, Sampled
from barbalat.linear.margins import margins
from barbalat.linear.systems import input_filter
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.modelling_error import DelayError, GainError
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import ParameterBox, Problem
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins, delay_margins_ensemble, gains_scanned, margins_ensemble
from barbalat.study.ideal_benchmark import NOISE_SENTENCE, Ideals, JudgedRuns, Undelayed, with_error
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.study.simulated_margins import FILLED_SENTENCE, with_simulated_margins
from barbalat.study.verdicts import Lost, Verdicts
from independent import refusal


@pytest.mark.parametrize("kappa", [0.0, 0.05])
def test_linear_loop_against_the_exact_margin(section_v, kappa):
    """With known theta and no command, the state decays below the exact margin and grows above it, slowly near the margin.

    The tolerance is 3 % for the loss. It is 6 % for the start of oscillation, because a tenth of the motion after 300 s is
    already too much for this criterion.
    """
    problem = replace(section_v, reference=Constant(0.0))
    C = None if kappa == 0 else input_filter(kappa)
    controller = KnownParameters(theta=[4.0, -3.0]) if C is None else L1Adaptive(gamma=1e-60, filter=C, theta_hat0=[4.0, -3.0])
    exact = margins(known_parameters(problem.plant, problem.plant.theta, None if C is None else C.realise())).delay
    found = delay_margins_ensemble([(problem, controller)], Simulation(t_end=400.0, dt=2e-3), resolution=0.005)
    for bracket, least in ((found.onset, 0.94), (found.loss, 0.97)):
        assert bracket.tolerates[0] < bracket.loses[0] < bracket.tolerates[0] * 1.01
        assert least * exact < bracket.tolerates[0] <= exact * 1.001


@pytest.mark.parametrize("downwards", [False, True])
def test_gain_of_a_linear_loop_against_the_exact_margin(section_v, downwards):
    """theta is known and there is no command. The tolerance is 1 % because near the margin the state grows by less than the
    motion within the run."""
    problem, simulation = replace(section_v, reference=Constant(0.0)), Simulation(t_end=200.0, dt=1e-2)
    controller, error = KnownParameters(theta=[4.0, -3.0]), GainError(downwards)
    exact = error.limit(known_parameters(problem.plant, problem.plant.theta, None))
    found = margins_ensemble([(problem, controller)], simulation, gains_scanned(), Ideals(simulation, gains_scanned(), error))
    assert found.loss.tolerates[0] < found.loss.loses[0] < found.loss.tolerates[0] * 1.02
    assert (1 + found.loss.tolerates[0]) == pytest.approx(1 + exact, rel=0.01)
    k = 1 / (1 + exact) if downwards else 1 + exact
    A = problem.plant.A_m + np.outer(problem.plant.b, problem.plant.theta) * (1 - k)
    assert np.linalg.eigvals(A).real.max() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("reference", [Sine(amplitude=50.0, frequency=0.5), Constant(50.0)])
@pytest.mark.parametrize("kappa", [0.005, 0.02])
@pytest.mark.short(kept=lambda kappa, reference: (kappa == 0.02) == isinstance(reference, Sine))
def test_onset_of_fast_adaptation_against_its_linear_limit(section_v, kappa, reference):
    """As Gamma grows L1-AC tends to an LTI controller, whose exact margin is where the oscillation begins. The tolerance is 5 %
    for Gamma = 100."""
    exact = margins(fast_adaptation(section_v.plant, input_filter(kappa).realise())).delay
    member = (replace(section_v, reference=reference), L1Adaptive(gamma=100.0, filter=input_filter(kappa)))
    found = delay_margins_ensemble([member], Simulation(t_end=40.0, dt=2e-4), resolution=0.01)
    assert 0.95 * exact < found.onset.tolerates[0] < 1.05 * exact
    assert found.loss.tolerates[0] > 3 * exact  # that criterion tolerates an oscillation within the projection's bounds


def test_a_limit_cycle_that_projection_bounds_is_an_onset_and_no_loss(section_v):
    """With MRAC at a high gain, a delay of 2 ms makes the estimates sweep the whole known set, but e stays far below x_m."""
    simulation, controller = Simulation(t_end=60.0, dt=1e-3), Mrac(gamma=1.0)
    found = delay_margins_ensemble([(section_v, controller)], simulation)
    assert found.tracks[0]
    assert not found.oscillates[0]
    assert (found.onset.tolerates[0], found.onset.loses[0]) == (0.0, 2e-3)
    assert found.loss.tolerates[0] > 0.1
    delayed = simulate_ensemble([(with_error(section_v, DelayError(), 2e-3), controller)], simulation).metrics
    np.testing.assert_array_equal(delayed.theta_hat_tail_min[0], [-5.0, -5.0])
    np.testing.assert_array_equal(delayed.theta_hat_tail_max[0], [5.0, 5.0])
    assert delayed.theta_hat_variation_rate.min() > 100 * found.undelayed.theta_hat_variation_rate.max()
    assert delayed.tail_max_abs_e.max() < 0.1 * _motion(section_v, simulation)


def test_a_limit_cycle_that_saturation_bounds_is_an_onset_and_no_loss():
    """theta is known and constant, the plant stable and u bounded. Beyond the linear margin x oscillates with an amplitude below
    its motion."""
    plant = Plant(
        A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[-30.0, 0.0], x0=[3.0, 0.0], input=PlantInput(saturation=[-2.0, 2.0])
    )
    problem = Problem(plant=plant, reference=Constant(0.0), uncertainty=ParameterBox(lower=[-40.0, -1.0], upper=[0.0, 1.0]))
    exact = margins(known_parameters(plant, plant.theta)).delay
    found = delay_margins_ensemble(
        [(problem, KnownParameters(theta=[-30.0, 0.0]))], Simulation(t_end=100.0, dt=1e-3), resolution=0.01
    )
    assert 0.97 * exact < found.onset.tolerates[0] < 1.03 * exact
    assert np.isinf(found.loss.loses[0])


def test_the_lag_of_a_command_is_no_onset(section_v):
    """With a known theta a delay up to the linear margin only makes the plant lag, but the error exceeds the motion itself."""
    controller = KnownParameters(theta=[4.0, -3.0])
    found = delay_margins_ensemble([(section_v, controller)], Simulation(t_end=60.0, dt=1e-3))
    exact = margins(known_parameters(section_v.plant, section_v.plant.theta)).delay
    assert 0.97 * exact < found.onset.tolerates[0] < exact
    assert 0.1 < found.loss.loses[0] < 0.6 * exact


@pytest.mark.parametrize("gamma", [1e-12, 1e-9])
@pytest.mark.short(kept=lambda gamma: gamma == 1e-9)
def test_what_does_not_follow_its_model_tolerates_nothing(section_v, gamma):
    """The error of an unstable plant with hardly any control is far above the commanded motion."""
    simulation = Simulation(t_end=20.0, dt=1e-3)
    found = delay_margins_ensemble([(section_v, Mrac(gamma=gamma))], simulation)
    assert not found.tracks[0]
    assert found.onset.loses[0] == found.loss.loses[0] == found.loss.tolerates[0] == 0
    controllers = (Mrac(gamma=gamma),)
    certificates = with_simulated_margins(
        certify(section_v, controllers, simulation), section_v, controllers, simulation, lost=Lost(share=0.5)
    )
    assert not {"delay_onset_simulated", "delay_margin_simulated"} & certificates["MRAC"].values.keys()
    assert "does not track its model" in certificates["MRAC"].findings[-1]


def test_simulated_margins_in_a_certificate(section_v):
    """A loop that oscillates even without a delay is reported. The numbers equal the ones from ``delay_margins``."""
    simulation = Simulation(t_end=20.0, dt=1e-3)
    controllers = (L1Adaptive(gamma=1e4, filter=input_filter(0.02), name="beyond the step"), Mrac(gamma=1e-3))
    found = with_simulated_margins(certify(section_v, controllers, simulation), section_v, controllers, simulation)
    alone = delay_margins_ensemble([(section_v, controllers[1])], simulation)
    values = found["MRAC"].values
    assert (
        values["delay_onset_simulated"] == alone.onset.tolerates[0] < values["delay_margin_simulated"] == alone.loss.tolerates[0]
    )
    assert found["beyond the step"].values["delay_onset_simulated"] == 0
    assert any("already oscillates without a delay" in sentence for sentence in found["beyond the step"].assumptions)


def test_delay_of_the_plant_is_beside_the_added_one(section_v):
    problem = replace(section_v, reference=Constant(0.0))
    delayed = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.1)))
    controller = KnownParameters(theta=[4.0, -3.0])
    simulation = Simulation(t_end=100.0, dt=2e-3)
    alone, beside = (
        delay_margins_ensemble([(p, controller)], simulation, resolution=0.005).loss.tolerates[0] for p in (problem, delayed)
    )
    assert beside == pytest.approx(alone - 0.1, abs=0.01 * alone)


class ThenHeld:
    """50 sin(t/2) until t = 20, and afterwards its largest value in the last quarter, at t = 5 pi."""

    def __call__(self, t):
        return np.where(np.asarray(t) < 20.0, 50 * np.sin(0.5 * np.asarray(t)), 50.0)

    def before(self, t):
        return np.where(np.asarray(t) <= 20.0, 50 * np.sin(0.5 * np.asarray(t)), 50.0)


def test_brackets_against_brute_force(section_v):
    """The reported delays are really tolerated and lost, in runs that continue with a constant command and are evaluated by
    hand."""
    simulation = Simulation(t_end=20.0, dt=1e-3)
    members = [(section_v, Mrac(gamma=gamma, name="c")) for gamma in (1e-3, 1e-1)]
    found = delay_margins_ensemble(members, simulation, lost=Lost(share=0.3), threads=1)
    again = delay_margins_ensemble(members, simulation, lost=Lost(share=0.3), threads=2)
    np.testing.assert_array_equal(found.loss.tolerates, again.loss.tolerates)
    np.testing.assert_array_equal(found.onset.loses, again.onset.loses)
    assert (found.onset.tolerates <= found.loss.tolerates).all()
    motion = _motion(section_v, simulation)
    held = replace(section_v, reference=ThenHeld())
    for i, (problem, controller) in enumerate(members):
        delays = [getattr(found.loss, side)[i] for side in ("tolerates", "loses")]
        metrics = simulate_ensemble(
            [(with_error(problem, DelayError(), float(d)), controller) for d in delays], simulation
        ).metrics
        grown = metrics.tail_max_abs_e.max(axis=1) - found.undelayed.tail_max_abs_e[i].max()
        assert grown[0] <= 0.3 * motion < grown[1]
        assert _swings(held, controller, found.onset.loses[i])
        assert found.onset.tolerates[i] == 0 or not _swings(held, controller, 0.9 * found.onset.tolerates[i])


def _swings(problem, controller, delay):
    """Whether u still oscillates by 2.5 % of its range long after the command becomes constant, and whether the oscillation at
    the end is no smaller than before."""
    longer = Simulation(t_end=60.0, dt=1e-3, record_points=60_000)
    (run,) = simulate(with_error(problem, DelayError(), float(delay)), [controller], longer).values()
    u = np.ravel(run.u)
    before, last = (np.ptp(u[(run.t >= begin) & (run.t < begin + 10)]) for begin in (40.0, 50.0))
    return last > 0.025 * np.ptp(u[run.t <= 20.0]) and last > 0.8 * before


def _motion(problem, simulation):
    return float(np.abs(simulate(problem, [Mrac(gamma=1e-12)], replace(simulation, record_points=10**5))["MRAC"].x_m).max())


@pytest.mark.full
def test_a_margin_under_noise_does_not_depend_on_the_neighbours(section_v):
    """The noise is a fifth of the command. The margin is the same with a neighbour that is soon lost, with one that is not, and
    alone."""
    noisy = replace(section_v, sensor=Sensor(noise=Noise(std=10.0, sample_time=0.01, seed=4)))
    soon = replace(noisy, plant=replace(noisy.plant, theta=[60.0, 60.0]))
    simulation, controller = Simulation(t_end=20.0, dt=1e-3), Mrac(gamma=1.0)
    beside = [
        delay_margins_ensemble([(p, Mrac(gamma=0.01)), (noisy, controller)], simulation, resolution=0.005).loss.tolerates[1]
        for p in (soon, noisy)
    ]
    alone, other = (
        delay_margins_ensemble([(noisy, controller)], simulation, resolution=0.005, numbers=[number]) for number in (1, 7)
    )
    assert beside == [alone.loss.tolerates[0]] * 2
    assert (other.undelayed.rms_e != alone.undelayed.rms_e).all()  # a different noise, otherwise the seed would have no effect


NOISY = Problem(
    plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[0.6, -0.4]),
    reference_model=ReferenceModel(k_0=2.0),
    reference=Sine(amplitude=1.0, frequency=1.0),
    uncertainty=ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0]),
    sensor=Sensor(noise=Noise(std=[0.01, 0.02], sample_time=0.01)),
)
"""A case in which the noise moves the estimates of a fast law at about 4/s without any delay."""
GAMMA, HORIZON = 1e3, 20.0


def test_noise_does_not_hide_the_onset_of_oscillation():
    """The start of oscillation is found for the loop without noise. The loss is found for the unchanged case and is not
    earlier."""
    simulation, controller = Simulation(t_end=HORIZON, dt=1e-3), Mrac(gamma=GAMMA)
    still = replace(NOISY, sensor=None)
    with_noise, without = (delay_margins_ensemble([(p, controller)], simulation) for p in (NOISY, still))
    assert with_noise.noisy and not without.noisy
    assert with_noise.onset.tolerates == without.onset.tolerates > 0
    assert with_noise.onset.loses == without.onset.loses
    assert with_noise.loss.tolerates >= with_noise.onset.tolerates
    onset, noisy = float(with_noise.onset.tolerates[0]), float(with_noise.undelayed.theta_hat_variation_rate.max())
    assert noisy > max(oscillation_by_hand(onset))  # no criterion finds the oscillation in addition to the noise's own rate
    settled, cycling = (oscillation_by_hand(factor * onset, held_from=HORIZON) for factor in (0.9, 1.1))
    assert max(settled) < 0.1 * max(cycling)


def test_a_certificate_says_how_noise_enters_the_simulated_margins():
    simulation, controller = Simulation(t_end=5.0, dt=1e-3), Mrac(gamma=GAMMA)
    found = with_simulated_margins(certify(NOISY, controller, simulation), NOISY, [controller], simulation)["MRAC"]
    (loss,) = (text for text in found.assumptions if text.startswith("delay_margin_simulated"))
    assert NOISE_SENTENCE in found.assumptions
    assert (
        "grows by 1 times the largest |x_m|" in loss
        and "holds both with and without measurement noise" in loss
        and "{" not in loss
    )


def test_what_a_disturbance_drives_is_no_oscillation_of_the_loop():
    """A sinusoidal disturbance makes the estimates and the control oscillate without a delay. With a constant disturbance both
    become constant."""
    simulation, controller = Simulation(t_end=10.0, dt=1e-3), Mrac(gamma=GAMMA)
    driven = replace(NOISY, sensor=None, disturbance=Sine(amplitude=1.0, frequency=20.0))
    found = delay_margins_ensemble([(driven, controller)], simulation)
    assert found.undelayed.theta_hat_variation_rate.min() > 1.0
    assert not found.oscillates[0]
    assert found.onset.tolerates[0] > 0


def test_noise_does_not_buy_a_delay_margin():
    """With sampled MRAC at a gain of 1e4, the noise hid the oscillation for delays from 0.0106 s to 0.194 s."""
    simulation, controller = Simulation(t_end=HORIZON, dt=1e-3), Sampled(Mrac(gamma=1e4), 0.01)
    with_noise, without = (delay_margins_ensemble([(p, controller)], simulation) for p in (NOISY, replace(NOISY, sensor=None)))
    for found in (with_noise, without):
        assert found.onset.tolerates[0] == pytest.approx(0.0106, rel=0.02)
    assert with_noise.fills[0] and not without.fills[0]


def test_a_margin_is_that_of_the_case_with_its_limits():
    """The limits of the flexible joint cause a limit cycle at a tenth of the delay that the linear loop tolerates."""
    case = load_case(str(Path(__file__).parents[1] / "judge" / "flexible-joint.toml"))
    problem, controller, simulation = case.problem, case.controllers[0], case.simulation
    certificates = certify(problem, controller, simulation)
    found = with_simulated_margins(certificates, problem, [controller], simulation, judge=case.judge)["MRAC"]
    tolerates = found.values["delay_margin_measured"]
    assert tolerates < 0.1 * found.values["delay_margin_adapting"]
    assert any("less than half of " in text and " without limits: delay_margin, " in text for text in found.findings)
    still = replace(problem, sensor=None)
    for delay, cycles in ((0.9 * tolerates, False), (0.02, True)):
        (run,) = simulate(with_error(still, DelayError(), delay), [controller], simulation).values()
        assert (run.verdict.kind == "limit cycle") == cycles
    assert found.simulated.verdict["class"] == "off" and "the input's limits" in found.simulated.run
    assert found.values["gain_margin_measured"] == pytest.approx(1.23, abs=0.01)


class NothingCosts:
    def noise_costs(self, problems, numbers, sizes, judge):
        return np.zeros((len(problems), 1))


@pytest.mark.parametrize(("rms", "ends"), [(0.021, False), (0.029, True)])  # a third of the band beside 0.01 is 0.0267
def test_the_largest_errors_of_two_draws_end_no_margin_and_their_rms_does(rms, ends):
    def of(error: float, rms: float) -> Verdicts:
        no, one = np.zeros(1, dtype=bool), np.ones((1, 1))
        return Verdicts(metrics=None, lost=no, oscillates=no, error=error * one, rms=rms * one, band=0.05 * one, scale=one)

    runs = JudgedRuns([(None, None)], Simulation(1.0, 0.1), Undelayed(of(0.1, 0.01), of(0.1, 0.01)), np.zeros(1), NothingCosts())
    assert runs._costs_more(of(0.9, rms), of(0.1, 0.01), np.array([0]), np.array([0.01]))[0] == ends


def test_estimates_that_noise_drives_through_the_known_set_are_a_finding():
    """At ten times the gain they move from -1 to 1 and back in the tail without a delay, due to the noise alone."""
    simulation, controller = Simulation(t_end=HORIZON, dt=1e-3), Mrac(gamma=1e5)
    found = {}
    for name, problem in (("noise", NOISY), ("none", replace(NOISY, sensor=None))):
        (run,) = simulate(problem, [controller], simulation).values()
        span = run.metrics.theta_hat_tail_max[0] - run.metrics.theta_hat_tail_min[0]
        certificates = certify(problem, controller, simulation)
        certificate = with_simulated_margins(certificates, problem, [controller], simulation)[controller.name]
        said = any(FILLED_SENTENCE in text for text in certificate.findings)
        assert said == (span.max() >= 1.8)
        found[name] = said
    assert found == {"noise": True, "none": False}


def oscillation_by_hand(
    delay: float, gamma: float = GAMMA, steps_each: int = 2000, held_from: float = np.inf
) -> tuple[float, float]:
    """The variation of both estimates [1/s] in the last quarter, with a delay and without noise, by a separate Runge-Kutta
    method.

    From ``held_from`` [s] on the command is held at -1, its largest value in the last quarter before that, for three times as
    long.
    Nothing is shared with the kernel. The projection clips the estimates' rate at the box, and the delayed u is interpolated
    linearly between steps of 0.5 ms.
    """
    P = solve_continuous_lyapunov(np.array([[0.0, -2.0], [1.0, -2.0]]), -np.eye(2))
    p_1, p_2 = float(P[0, 1]), float(P[1, 1])
    horizon = HORIZON if held_from == np.inf else 4 * held_from
    h, steps = 1 / steps_each, round(horizon * steps_each)
    late = delay / h
    u = [0.0] * (steps + 2)  # before t = 0 there was none

    def reference(t):
        return math.sin(t) if t < held_from else -1.0

    def command(x, a, t):
        return 2.0 * reference(t) - a[0] * x[0] - a[1] * x[1]

    def held(k):
        """u at step k plus a fraction of a step, delayed by ``delay``."""
        k -= late
        if k < 0:
            return 0.0
        i = int(k)
        return u[i] + (k - i) * (u[i + 1] - u[i])

    def rate(s, t, acting):
        x_1, x_2, m_1, m_2, a_1, a_2 = s
        v = gamma * ((x_1 - m_1) * p_1 + (x_2 - m_2) * p_2)
        d_1, d_2 = v * x_1, v * x_2
        d_1 = 0.0 if (a_1 >= 1 and d_1 > 0) or (a_1 <= -1 and d_1 < 0) else d_1
        d_2 = 0.0 if (a_2 >= 1 and d_2 > 0) or (a_2 <= -1 and d_2 < 0) else d_2
        acting = command((x_1, x_2), (a_1, a_2), t) if acting is None else acting
        r = 2.0 * reference(t)
        return (x_2, -2 * x_1 - 2 * x_2 + 0.6 * x_1 - 0.4 * x_2 + acting, m_2, -2 * m_1 - 2 * m_2 + r, d_1, d_2)

    s, moved = (0.0,) * 6, [0.0, 0.0]
    for k in range(steps):
        t = k * h
        u[k] = command(s[:2], s[4:], t)
        u[k + 1] = u[k] if k == 0 else 2 * u[k] - u[k - 1]  # only delays shorter than a step use it
        now, half, then = (None,) * 3 if delay == 0 else (held(k), held(k + 0.5), held(k + 1))
        k_1 = rate(s, t, now)
        k_2 = rate([a + h / 2 * b for a, b in zip(s, k_1, strict=True)], t + h / 2, half)
        k_3 = rate([a + h / 2 * b for a, b in zip(s, k_2, strict=True)], t + h / 2, half)
        k_4 = rate([a + h * b for a, b in zip(s, k_3, strict=True)], t + h, then)
        after = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(s, k_1, k_2, k_3, k_4, strict=True)]
        after[4:] = [min(max(a, -1.0), 1.0) for a in after[4:]]
        if k >= 0.75 * steps:
            moved = [m + abs(after[4 + i] - s[4 + i]) for i, m in enumerate(moved)]
        s = tuple(after)
    return moved[0] / (horizon / 4), moved[1] / (horizon / 4)


def test_motion_of_a_model_in_its_steady_state():
    """With x_m' = -x_m + r and r = 2 sin t, the steady state is x_m = sqrt(2) sin(t - pi/4). The tolerance 1e-3 is for straight
    lines between instants."""
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[0.0], x0=[-1.0])
    motion = ReferenceMotion.of(
        Problem(plant=plant, reference=Sine(amplitude=2.0, frequency=1.0)), Simulation(t_end=20 * np.pi, dt=np.pi / 500)
    )
    assert motion.largest == pytest.approx(np.sqrt(2), rel=1e-3)
    assert motion.in_tail == pytest.approx(np.sqrt(2), rel=1e-3)
    assert motion.rms == pytest.approx(1.0, rel=1e-3)
    assert motion.crossings == pytest.approx(1 / np.pi, rel=1e-3)
    assert not motion.comes_to_rest
    settled = replace(plant, x0=[-10 / 26])  # 2/sqrt(26) sin(5t - arctan 5), which crosses its range 5/pi times a second
    faster = ReferenceMotion.of(
        Problem(plant=settled, reference=Sine(amplitude=2.0, frequency=5.0)), Simulation(t_end=20 * np.pi, dt=np.pi / 500)
    )
    assert faster.crossings == pytest.approx(5 / np.pi, rel=1e-2)


@pytest.mark.full
def test_a_command_that_comes_to_rest_is_said():
    """Wing rock's command ends at 35 of 60 s, so both criteria evaluate a loop at equilibrium."""
    case = load_case("wing-rock")
    assert ReferenceMotion.of(case.problem, case.simulation).comes_to_rest
    controllers = case.controllers[:1]
    certificates = certify(case.problem, controllers, case.simulation)
    found = with_simulated_margins(certificates, case.problem, controllers, case.simulation)[controllers[0].name]
    assert any("is not detected" in sentence for sentence in found.assumptions)


def test_a_run_that_is_lost_without_delay(section_v):
    found = delay_margins_ensemble([(section_v, Mrac(gamma=1.0, projection=False))], Simulation(t_end=10.0, dt=0.5))
    assert found.loss.tolerates[0] == found.loss.loses[0] == found.onset.loses[0] == 0
    assert not found.tracks[0]


def test_refusals(section_v):
    member = [(section_v, Mrac(gamma=1.0))]
    simulation = Simulation(t_end=1.0, dt=0.01)
    assert "longest" in refusal(lambda: delay_margins_ensemble(member, simulation, longest=0.01))
    assert "scan" in refusal(lambda: delay_margins_ensemble(member, simulation, scan=1))
    assert "share" in refusal(lambda: Lost(share=0.0))


def test_a_slow_plant_tolerates_in_its_own_time():
    # the same loop, a hundred times slower: every rate is divided by 100, so its margin is 100 times as long
    def loop(slow):
        plant = Plant(A_m=[[-1.0 / slow]], b=[1.0 / slow], theta=[0.5])
        known = ParameterBox(lower=[-2.0], upper=[2.0])
        problem = Problem(
            plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Sine(1.0, 1.0 / slow), uncertainty=known
        )
        return problem, Mrac(gamma=20.0 / slow), Simulation(t_end=20.0 * slow, dt=5e-3 * slow)

    (fast,) = delay_margins(*loop(1), longest=1.0).values()
    (slow,) = delay_margins(*loop(100)).values()
    assert 0 < fast.onset.tolerates[0] < fast.onset.loses[0] < 1
    assert slow.onset.tolerates[0] == pytest.approx(100 * fast.onset.tolerates[0], rel=0.05)


LIMITED = """
name = "limited"
plant = { A_m = [[-2.0]], b = [1.0], theta = [3.0], input = { saturation = [-4.0, 4.0] } }
reference_model = { k_0 = 2.0 }
reference = { kind = "square", amplitude = 1.0, frequency = 1.0 }
uncertainty = { lower = [0.0], upper = [4.0] }
simulation = { t_end = 10.0, dt = 0.01 }
controller = [{ scheme = "mrac", gamma = 5.0, sample_time = 0.05 }]
"""


@pytest.mark.parametrize("faults", ["", 'faults = [{ kind = "spike", size = 0.5, share = 0.02 }]\n'])
def test_a_gain_margin_with_faults_is_reported_with_them_beside_the_linear_one_without(faults):
    case = parse_case(faults + LIMITED)
    found = certify(case.problem, case.controllers, case.simulation)
    measured = with_simulated_margins(found, case.problem, case.controllers, case.simulation)["MRAC"]
    plain = parse_case(LIMITED)
    without = certify(plain.problem, plain.controllers, plain.simulation)["MRAC"]
    assert measured.values["gain_margin"] == without.values["gain_margin"]  # the linear loop's, which has no faults
    assert ("its faults" in measured.simulated.run) is bool(faults)
