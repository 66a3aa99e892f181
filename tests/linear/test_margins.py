"""Margins, compared with python-control, with Pade approximations of the delay, and with closed forms."""

import math

import control
import numpy as np
import pytest

from barbalat import (  # fmt: skip
    InputError,
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    certify,
    input_filter,
)
from barbalat.cases.load import load_case
from barbalat.certificates.linear_loops.ideal import around_equilibrium, equilibrium, fast_adaptation, known_parameters
from barbalat.linear.margins import margins
from barbalat.linear.peaks import delayed_peaks
from barbalat.linear.systems import StateSpace, TransferFunction, series
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.signals import Constant  # fmt: skip


def random_loops(count: int) -> list[StateSpace]:
    """Random loops that are stable when closed."""
    rng = np.random.default_rng(5)
    found: list[StateSpace] = []
    while len(found) < count:
        n = int(rng.integers(1, 6))
        loop = StateSpace(rng.normal(size=(n, n)) * 10 ** rng.uniform(-1, 2), rng.normal(size=n), rng.normal(size=n), 0.0)
        if np.linalg.eigvals(loop.A - np.outer(loop.B, loop.C)).real.max() < 0:
            found.append(loop)
    return found


def pade_closed_loop(loop: StateSpace, delay: float, order: int = 12) -> float:
    """The largest real part of the closed-loop poles with a Pade approximation of the delay."""
    num, den = control.pade(delay, order)
    delayed = series(loop, TransferFunction(np.array(num), np.array(den)).realise())
    return float(np.linalg.eigvals(delayed.A - np.outer(delayed.B, delayed.C) / (1 + delayed.D)).real.max())


def test_a_crossing_that_lies_on_a_point_of_the_grid():
    """Second-order MRAC loops whose theta is rounded such that, near a zero, a value computed alone and the same value in an
    array have different signs."""
    b, found = np.array([0.0, 1.0]), 0
    for first in np.round(np.arange(0.35, 0.95, 0.0125), 4):
        theta = np.array([first, 2.0])
        loop = StateSpace(np.array([[0.0, 1.0], [-2.0, -2.0]]) + np.outer(b, theta), b, theta, 0.0)
        crossings = margins(loop).crossovers
        found += len(crossings)
        np.testing.assert_allclose(np.abs(loop.response(np.array(crossings))), 1.0, rtol=1e-9)
    assert found == 96  # two of each: |L| rises above 1 and falls again


@pytest.mark.parametrize("loop", random_loops(60))
def test_against_python_control(loop):
    found = margins(loop)
    gains, phases, _, _, crossovers, _ = control.stability_margins(
        control.ss(loop.A, loop.B[:, None], loop.C[None], 0), returnall=True
    )
    np.testing.assert_allclose(found.crossovers, np.sort(crossovers), rtol=1e-6)
    assert found.gain_up == pytest.approx(min((g for g in gains if g > 1), default=math.inf), rel=1e-6)
    assert found.gain_down == pytest.approx(max((g for g in gains if 0 < g < 1), default=0), rel=1e-6)
    if len(crossovers):
        assert found.phase == pytest.approx(np.deg2rad(np.abs(phases).min()), rel=1e-6)


def test_delay_margin_is_where_the_delayed_loop_loses_stability():
    checked = 0
    for loop in random_loops(60):
        delay = margins(loop).delay
        if not np.isfinite(delay) or delay * max(margins(loop).crossovers) > 6:
            continue  # a Pade approximation of order 12 follows the phase up to about two turns
        assert pade_closed_loop(loop, delay * 0.99) < 0
        assert pade_closed_loop(loop, delay * 1.01) > 0
        checked += 1
    assert checked >= 10


def test_all_crossovers_count():
    """With two resonances the higher crossover determines the delay margin, although the first one has the smaller phase
    margin."""
    slow = TransferFunction(np.array([0.02]), np.array([1.0, 0.02, 0.01])).realise()
    fast = TransferFunction(np.array([60.0]), np.array([1.0, 0.5, 10000.0])).realise()
    both = StateSpace(
        np.block([[slow.A, np.zeros((2, 2))], [np.zeros((2, 2)), fast.A]]),
        np.concatenate([slow.B, fast.B]),
        np.concatenate([slow.C, fast.C]),
        0.0,
    )
    found = margins(both)
    assert len(found.crossovers) >= 3
    first = min(found.crossovers)
    lag = np.angle(-both.response(np.array([first]))[0]) % (2 * np.pi)
    assert found.delay < lag / first / 10
    assert pade_closed_loop(both, found.delay * 1.05, 8) > 0 > pade_closed_loop(both, found.delay * 0.9, 8)


def test_closed_forms():
    # k/(s(s + 1)): crossover from w^2 (w^2 + 1) = k^2, phase margin pi/2 - atan w, no finite gain margin
    k = 3.0
    w = math.sqrt((-1 + math.sqrt(1 + 4 * k * k)) / 2)
    found = margins(TransferFunction(np.array([k]), np.array([1.0, 1.0, 0.0])).realise())
    assert found.crossovers == pytest.approx([w], rel=1e-12)
    assert found.phase == pytest.approx(math.pi / 2 - math.atan(w), rel=1e-10)
    assert found.delay == pytest.approx((math.pi / 2 - math.atan(w)) / w, rel=1e-10)
    assert (found.gain_up, found.gain_down) == (math.inf, 0.0)
    # 2/(s + 1)^3: phase crossover at sqrt 3, where |L| = 2/8
    found = margins(TransferFunction(np.array([2.0]), np.poly([-1, -1, -1])).realise())
    assert found.gain_up == pytest.approx(4, rel=1e-9)


def test_unstable_and_ill_posed_loops_are_refused():
    with pytest.raises(InputError, match=r"largest eigenvalue has real part 1"):
        margins(TransferFunction(np.array([1.0]), np.array([1.0, -2.0])).realise())
    with pytest.raises(InputError, match="not well posed"):
        margins(StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros(0), -1.0))


def test_fast_adaptation_is_the_limit_of_the_adaptive_loop():
    """The loop linearised with its law tends to the LTI limit as 1/sqrt(Gamma), below the frequency of adaptation."""
    problem = load_case("paper").problem
    C = input_filter(0.1)
    limit = fast_adaptation(problem.plant, C.realise())
    w = np.array([0.3, 1.0, 5.0, 20.0])
    distances = []
    for gamma in (1e4, 1e6, 1e8):
        loop = around_equilibrium(problem, L1Adaptive(gamma=gamma, filter=C), 1.0)
        distances.append(np.abs(loop.response(w) / limit.response(w) - 1).max())
    assert distances[0] < 0.05
    assert distances[2] < distances[0] / 100
    # by hand: C/(1 - C) = 1/(0.1 s), and 1 + theta'G = a_m(s)/a(s)
    s = 1j * w
    a_m = s**2 + s + 0.3
    by_hand = a_m / (a_m - (4 - 3 * s)) / (0.1 * s)
    np.testing.assert_allclose(limit.response(w), by_hand, rtol=1e-10)


def test_mrac_around_a_constant_command_by_hand():
    """theta_hat'x* integrates Gamma |x*|^2 b'P e, so L = theta'G + (Gamma |x*|^2/s) b'P G."""
    problem = load_case("paper").problem
    plant, gamma, r = problem.plant, 2.0, 3.0
    controller = Mrac(gamma=gamma)
    loop = ClosedLoop.of(problem, controller)
    x = -np.linalg.solve(plant.A_m, plant.b * 4 * r)
    found = around_equilibrium(problem, controller, r)
    A = plant.A_m + np.outer(plant.b, plant.theta)
    for w in (0.5, 3.0, 40.0):
        G = np.linalg.solve(1j * w * np.eye(2) - A, plant.b)
        by_hand = plant.theta @ G + gamma * (x @ x) / (1j * w) * (plant.b @ problem.known.P @ G)
        assert found.response(np.array([w]))[0] == pytest.approx(by_hand, rel=1e-9)
    rest, _ = equilibrium(problem, loop, r)
    assert np.abs(loop.derivative(rest, np.array([r]))).max() < 1e-9


def test_known_parameters_with_and_without_filter():
    plant = load_case("paper").problem.plant
    w = np.array([0.1, 1.0, 10.0])
    G = np.array([np.linalg.solve(1j * s * np.eye(2) - plant.A_m - np.outer(plant.b, plant.theta), plant.b) for s in w])
    np.testing.assert_allclose(known_parameters(plant, plant.theta).response(w), G @ plant.theta, rtol=1e-12)
    filtered = known_parameters(plant, plant.theta, input_filter(0.5).realise())
    np.testing.assert_allclose(filtered.response(w), G @ plant.theta / (0.5j * w + 1), rtol=1e-12)


def random_delayed_loops(count: int):
    """Random loops with a delay that is a fraction of the tolerated one or of one of their time constants."""
    rng = np.random.default_rng(9)
    for loop in random_loops(count):
        tolerated = margins(loop).delay
        longest = tolerated if np.isfinite(tolerated) else 1 / np.abs(np.linalg.eigvals(loop.A)).max()
        yield loop, float(longest * rng.uniform(0.05, 0.95))


def brute_force(loop: StateSpace, delay: float):
    """L e^(-j w d) on half a million frequencies, up to ten turns of the delay."""
    poles = np.linalg.eigvals(loop.A)
    wide = np.geomspace(1e-5 * np.abs(poles).min(), max(1e3 * np.abs(poles).max(), 60 / delay), 200_000)
    near = [abs(p.imag) + abs(p.real) * np.linspace(-50, 50, 4001) for p in poles if p.imag > 0]
    w = np.unique(np.concatenate([wide, np.linspace(1e-3, 60, 200_000) / delay, *near]))
    w = w[w > 0]
    return loop.response(w) * np.exp(-1j * w * delay)


def test_beside_a_delay_against_brute_force():
    """The tolerance 1e-4 is for the linear interpolation of the brute force."""
    for loop, delay in random_delayed_loops(15):
        found, peaks = margins(loop, delay), delayed_peaks(loop, delay)
        L = brute_force(loop, delay)
        k = np.flatnonzero((L.imag[:-1] * L.imag[1:] < 0) & (L.real[:-1] < 0) & (L.real[1:] < 0))
        t = L.imag[k] / (L.imag[k] - L.imag[k + 1])
        factors = [*(-1 / (L.real[k] + t * (L.real[k + 1] - L.real[k])))]
        start = float(loop.response(np.zeros(1))[0].real)
        factors += [-1 / start] if start < 0 else []
        assert found.gain_up == pytest.approx(min((f for f in factors if f > 1), default=math.inf), rel=1e-4)
        assert found.gain_down == pytest.approx(max((f for f in factors if f < 1), default=0), rel=1e-4, abs=1e-12)
        at = np.flatnonzero((np.abs(L[:-1]) - 1) * (np.abs(L[1:]) - 1) < 0)
        if len(at):
            assert found.phase == pytest.approx(np.abs(np.angle(-L[at])).min(), abs=1e-3)
        for peak, values in ((peaks.sensitivity, 1 / (1 + L)), (peaks.complementary, L / (1 + L))):
            highest = float(np.abs(values).max())
            assert highest <= peak * (1 + 1e-9)
            assert peak == pytest.approx(highest, rel=1e-3)  # an upper end to 1e-6; the points are next to a sharp peak


def test_beside_a_delay_the_factors_are_where_stability_is_lost():
    checked = 0
    for loop, delay in random_delayed_loops(25):
        found = margins(loop, delay)
        for factor, outward in ((found.gain_up, 1.001), (found.gain_down, 0.999)):
            if not 0 < factor < 1e3 or delay * max(np.abs(np.linalg.eigvals(loop.A))) > 3:
                continue  # a Pade approximation follows about two turns
            for scale, stable in ((outward, False), (1 / outward, True)):
                scaled = StateSpace(loop.A, loop.B * factor * scale, loop.C, 0.0)
                assert (pade_closed_loop(scaled, delay) < 0) == stable
            checked += 1
    assert checked >= 20


def test_the_delay_that_is_there_is_taken_off():
    loop = TransferFunction([3.0], [1.0, 1.0, 0.0]).realise()
    alone, beside = margins(loop), margins(loop, 0.1)
    assert beside.delay == pytest.approx(alone.delay - 0.1, rel=1e-9)
    assert beside.phase == pytest.approx(alone.phase - 0.1 * alone.crossovers[0], rel=1e-9)
    with pytest.raises(InputError, match=r"unstable: the loop tolerates a delay of 0\.\d+ s, but has a delay of 1 s"):
        margins(loop, 1.0)


def test_an_integrator_with_a_delay():
    """The phase of k/s e^(-s d) is -pi at w = pi/(2 d) + 2 pi m/d, at the first of which |L| = 2 k d/pi."""
    found = margins(TransferFunction([0.5], [1.0, 0.0]).realise(), 0.3)
    assert found.gain_up == pytest.approx(np.pi / (2 * 0.5 * 0.3), rel=1e-9)
    assert found.gain_down == 0
    # an open loop: nothing destabilises it
    nothing = margins(StateSpace(-np.eye(2), np.ones(2), np.zeros(2), 0.0), 0.3)
    assert (nothing.gain_up, nothing.gain_down, nothing.phase, nothing.delay) == (math.inf, 0.0, math.inf, math.inf)


def test_a_loop_that_does_not_fall_off_tolerates_no_more_than_its_end():
    """With the delay, L = 0.5 (s + 3)/(s + 1) rotates for ever at |L| -> 0.5, so stability is lost at the factor 2."""
    loop = TransferFunction([0.5, 1.5], [1.0, 1.0]).realise()
    assert margins(loop, 0.01).gain_up == pytest.approx(2, rel=1e-3)
    assert margins(loop, 0.01).gain_up <= 2
    with pytest.raises(InputError, match=r"strictly proper loop, but L\(infinity\) = 0\.5"):
        delayed_peaks(loop, 0.01)


def test_a_peak_that_is_flat_over_decades():
    """For an integrator |T| tends to 1 from below for w -> 0 and stays near 1 up to the crossover. |S| peaks beyond it."""
    loop = TransferFunction([307.0, 8401.0], [1.0, 43.6, 0.0]).realise()
    found = delayed_peaks(loop, 3.4e-5)
    w = np.geomspace(1e-4, 1e6, 400_000)
    L = loop.response(w) * np.exp(-1j * w * 3.4e-5)
    assert found.complementary == pytest.approx(np.abs(L / (1 + L)).max(), rel=2e-6)
    assert found.sensitivity == pytest.approx(np.abs(1 / (1 + L)).max(), rel=2e-6)


def test_a_plant_that_integrates_has_a_margin_with_its_law_inside():
    """For a motor's angle the eigenvalue of zero is computed as a rounding error. Frequencies below it are irrelevant."""
    plant = Plant(A=[[0, 1], [0, -0.7]], b=[0, 12.5], A_m=[[0, 1], [-25, -7]])
    given = Problem(plant, ReferenceModel(2.0), Constant(1.0), uncertainty=ParameterBox([-1, -1], [4, 4]))
    certificate = certify(given, L1Adaptive(1e4, input_filter(0.01)), Simulation(1.0, 1e-3))["L1"]
    assert 0 < certificate.values["delay_margin_adapting"] < certificate.values["delay_margin"]


@pytest.mark.parametrize("delay", [0.0, 0.01])
@pytest.mark.parametrize("share", [0.5, 2.0, 1e38])
def test_a_loop_that_is_as_good_as_open_has_no_gain_margin(share, delay):
    """K/(s + 1)^3 tolerates K = 8. With K = 8/(share 1e6) the factor is share 1e6, and a factor above 1e6 is not reported as a
    margin."""
    loop = TransferFunction([8.0 / (share * 1e6)], [1.0, 3.0, 3.0, 1.0]).realise()
    found = margins(loop, delay).gain_up
    assert found == (pytest.approx(share * 1e6, rel=0.05) if share < 1 else math.inf)  # the delay takes 1 or 2 %


def test_a_theta_as_good_as_zero_has_no_margin_of_1e44():
    problem = Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[-2.6e-45, 0.0]),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Constant(1.0),
    )
    (found,) = certify(problem, [Mrac(gamma=1.0)], Simulation(t_end=1.0, dt=1e-2)).values()
    assert "gain_margin" in found.values["unlimited"]
    assert "1e6" in found.entry("unlimited").meaning


@pytest.mark.parametrize("stiffness", [1e4, 1e8, 1e12])
def test_a_slow_integrator_beside_fast_poles_has_its_crossover(stiffness):
    # L = k / (s (s^2 + 2 s + k + 1)) is 1/s for large k: |L| = 1 at 1 rad/s, far below sqrt(k); Hurwitz: gain 2 (k + 1) / k.
    A, C = [[0, 1, 0], [0, 0, 1], [0, -(stiffness + 1), -2]], [stiffness, 0, 0]
    found = margins(StateSpace(np.array(A, float), np.array([0.0, 0.0, 1.0]), np.array(C), 0.0))
    assert found.gain_up == pytest.approx(2 * (stiffness + 1) / stiffness, rel=1e-9)
    assert found.crossovers == pytest.approx([1], rel=2 / stiffness)
    assert found.delay == pytest.approx(np.pi / 2, rel=3 / stiffness)
