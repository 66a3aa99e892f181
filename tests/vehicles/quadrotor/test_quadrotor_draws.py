"""Random quadrotors: the effect of their numbers, compared with statics and closed formulas, and campaigns that resume."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra flight is not installed: ./dev flight installs it")

from benchmarks import flight_tuning, quadrotor_tuning
from benchmarks.flight_tuning import PAGES
from scipy.optimize import brentq

from barbalat.papers.jafari_2013.flight.flown import Flights
from barbalat.vehicles.dispersed import fly_dispersed
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, Axes, Electronics
from barbalat.vehicles.quadrotor.body import SLOPE, STANDING, STEP, Quadrotor
from barbalat.vehicles.quadrotor.control import Control
from barbalat.vehicles.quadrotor.dispersions import NOMINAL, Dispersion
from barbalat.vehicles.quadrotor.failures import FAILURES
from barbalat.vehicles.quadrotor.flying import GUSTS_SHARE, Air, Sensing, fly_all
from barbalat.vehicles.quadrotor.hover import hovering
from barbalat.vehicles.quadrotor.schemes import SCHEMES, TUNED
from barbalat.vehicles.quadrotor.simulator import Motion
from barbalat.vehicles.schemes import available
from vehicles.nominal import quadrotor_through, scheme_on

pytestmark = pytest.mark.full  # ./dev flight runs them
LEVEL = Motion(np.array([0.0, 0.0, 2.0]), np.eye(3), np.zeros(3), np.zeros(3))
NOMINAL_VEHICLE = Quadrotor()
WEIGHT = NOMINAL_VEHICLE.mass * 9.81


@pytest.fixture(scope="module")
def axes():
    return Axes(hover=hovering(NOMINAL_VEHICLE))


def accelerations(dispersion, thrusts=WEIGHT / 4):
    simulator = dispersion.simulator(NOMINAL_VEHICLE)
    simulator.put(LEVEL, np.broadcast_to(thrusts, 4).copy())
    return simulator.accelerations


def test_a_heavier_one_sinks_and_a_weaker_one_too():
    assert accelerations(Dispersion(mass=1.1))[2] == pytest.approx(9.81 / 1.1 - 9.81)
    assert accelerations(Dispersion(thrust=0.9))[2] == pytest.approx(-0.1 * 9.81)


def test_a_centre_of_gravity_to_the_left_rolls_it_that_way_as_a_lever_does():
    """The thrust lifts the part to the right of the centre, so the left side goes down, which is a negative rotation about the
    forward axis."""
    _, _, _, roll, pitch, yaw = accelerations(Dispersion(centre_left=0.005))
    assert roll == pytest.approx(-WEIGHT * 0.005 / NOMINAL_VEHICLE.inertia[0])
    assert (pitch, yaw) == pytest.approx((0, 0), abs=1e-9)
    assert accelerations(Dispersion(centre_forward=0.005))[4] == pytest.approx(WEIGHT * 0.005 / NOMINAL_VEHICLE.inertia[1])


def test_rotors_inertias_arms_and_drag_act_where_they_should():
    """With one strong rotor at the front left, its force, its moment and the moment of its drag are each divided by the mass or
    inertia."""
    one = Dispersion(rotor_1=1.05, roll_inertia=1.2, pitch_inertia=0.9, reach=1.02, drag_torque=1.3)
    vehicle, added = one.vehicle(NOMINAL_VEHICLE), 0.05 * WEIGHT / 4
    x, y, z = vehicle.inertia
    assert z / (x + y) == pytest.approx(0.9)  # a flat body's, as the nominal one's
    expected = np.array([added / vehicle.mass, added * vehicle.reach / x, -added * vehicle.reach / y, added * vehicle.torque / z])
    np.testing.assert_allclose(accelerations(one)[2:], expected, rtol=1e-6)


def test_it_stands_where_it_was_put():
    """At a distance of two metres on the slope it would sink or jump if it did not stand on the ground."""
    simulator = Dispersion(start_forward=0.2, start_left=-0.2, heading=10.0).simulator(NOMINAL_VEHICLE)
    height = STANDING - 0.2 * np.tan(np.deg2rad(SLOPE))
    np.testing.assert_allclose(simulator.motion.position, [0.2, -0.2, height])
    simulator.advance(np.zeros(4), round(2 / STEP))
    motion = simulator.motion
    np.testing.assert_allclose(motion.position, [0.2, -0.2, height], atol=2e-3)  # the feet yield by some tenths of a millimetre
    assert motion.attitude[2, 2] == pytest.approx(np.cos(np.deg2rad(SLOPE)), abs=1e-3)
    assert np.rad2deg(np.arctan2(motion.attitude[1, 0], motion.attitude[0, 0])) == pytest.approx(10.0, abs=0.2)


def test_rate_sensors_lag_by_their_exponential():
    quiet = Electronics(rate_lag=0.01, attitude_noise=0, rate_noise=0, position_noise=0, velocity_noise=0)
    sensing, turning = Sensing(quiet, 40, 0), LEVEL._replace(rates=np.array([1.0, 0.0, -2.0]))
    found = [sensing(turning, k).rates for k in range(40)]
    t = ATTITUDE_SAMPLE * np.arange(1, 41)
    np.testing.assert_allclose(found, -np.expm1(-t / 0.01)[:, None] * turning.rates, atol=1e-12)


def test_wind_comes_from_where_it_is_said_to_with_its_gusts():
    drawn = Dispersion(wind=4.0, wind_from=90.0)
    velocity = np.concatenate([Air.drawn(replace(drawn, number=i), 40_000).velocity for i in range(30)])
    np.testing.assert_allclose(velocity[:, [0, 2]], 0, atol=1e-12)
    assert velocity[:, 1].mean() == pytest.approx(-4.0, abs=0.1)  # wind from the left moves it to the right
    # 30 runs of 100 s of a process with a correlation time of 17 s have some 90 independent values
    assert velocity[:, 1].std() == pytest.approx(GUSTS_SHARE * 4.0, rel=0.3)


def test_gusts_along_the_wind_have_dryden_s_correlation():
    """R(s) = deviation^2 e^(-s speed/L). In 4000 s about 470 values are independent at a wind of 16 m/s."""
    gusts = Air.drawn(Dispersion(wind=16.0, wind_from=180.0, number=3), 1_600_000).velocity[:, 0] - 16.0
    for seconds in (0.0, 1.0, 4.0, 8.0):
        lag = round(seconds / ATTITUDE_SAMPLE)
        found = float(np.mean(gusts[: len(gusts) - lag] * gusts[lag:]))
        assert found == pytest.approx((GUSTS_SHARE * 16.0) ** 2 * np.exp(-seconds * 16.0 / 68.0), abs=0.2 * 1.6**2), seconds


def test_the_nominal_draw_is_the_nominal_flight_and_another_is_none(axes):
    short, scheme = Timing(duration=3.5, fails_at=3.0), scheme_on(axes, "l1-piecewise")
    (first,) = quadrotor_through(axes, scheme, [FAILURES["none"]], short)
    (second,) = fly_all(axes, Control(axes, scheme), [FAILURES["none"]], NOMINAL, short)
    np.testing.assert_array_equal(first.record, second.record)
    (late,) = fly_all(axes, Control(axes, scheme), [FAILURES["none"]], Dispersion(delay=0.005), short)
    assert np.abs(late.record - first.record).max() > 1e-6


def test_what_is_flown_once_for_all_failures_is_what_each_flies_by_itself(axes):
    short, scheme = Timing(duration=4.0, fails_at=3.0), scheme_on(axes, "adrc")
    drawn = Dispersion(wind=3.0, wind_from=200.0, rate_lag=0.003, mass=1.1, rotor_1=0.96, number=4)
    names = ("none", "half-propeller", "slung-mass", "no-reset", "wind", "delay-20", "motor-lag")
    together = fly_all(axes, Control(axes, scheme), [FAILURES[name] for name in names], drawn, short)
    for name, found in zip(names, together, strict=True):
        (alone,) = fly_all(axes, Control(axes, scheme), [FAILURES[name]], drawn, short)
        np.testing.assert_array_equal(found.record, alone.record)
    assert len({found.record[-1].tobytes() for found in together}) == len(names)


def test_a_store_goes_on_where_it_was_left(tmp_path):
    arguments = {"schemes": ["geometric", "adrc"], "failures": ["half-propeller"], "members": 2, "processes": 1}
    whole = fly_dispersed("quadrotor", store=tmp_path / "store", **arguments)
    assert whole.campaign.chunk == 25
    again = fly_dispersed("quadrotor", store=tmp_path / "store", **arguments)
    assert again.resumed == 2
    for name in whole.rows.names:
        np.testing.assert_array_equal(again.rows.column(name), whole.rows.column(name))


def test_the_stored_flights_of_the_ledger_are_flown_again():
    """The first draw is flown by three schemes and compared in the digits that agree between processors after thirteen
    seconds."""
    stored = Flights.stored("quadrotor").document
    assert stored["numbers"] == TUNED
    schemes = [name for name in ("geometric", "hinf", "l1") if name in available(SCHEMES)]
    found = fly_dispersed(
        "quadrotor", schemes=schemes, failures=["wind", "no-reset"], members=1, seed=stored["plan"]["seed"], processes=1
    )
    for column, value in found.rows.row(0).items():
        expected = stored["first_draw"][column]
        assert value == pytest.approx(float("nan") if expected is None else expected, rel=1e-6, nan_ok=True), column


def numbers_of(cells):
    """The numbers in a stored row of the guide's table, such as the two of "bandwidth 0.3, adaptation 30*"."""
    pairs = [] if cells[2] == "none" else [one.rstrip("*").rsplit(" ", 1) for one in cells[2].split(", ")]
    return {name: float(value) for name, value in pairs}


def test_what_is_tuned_is_what_the_guide_s_table_says_and_it_meets_the_rule():
    rows = [line.strip("| \n").split(" | ") for line in (PAGES / "tuned-quadrotor.txt").read_text().splitlines()[2:]]
    assert {(axis, scheme.strip("`")) for axis, scheme, *_ in rows} == {(axis, one) for axis in TUNED for one in TUNED[axis]}
    for axis, scheme, *cells in rows:
        assert TUNED[axis][scheme.strip("`")] == numbers_of((axis, scheme, *cells))
        _, _, _, slack, up, down = (float(one) if i else 0.0 for i, one in enumerate(cells))
        assert (slack >= 1, min(up, down) >= quadrotor_tuning.GAIN_MARGIN) == (True, True)


def test_the_rule_asks_for_half_of_what_the_feedback_tolerates(axes):
    """The phase of L = (k_R + k_Omega s)/s^2 and of the lags at the crossover is computed by hand."""
    for axis in (axes.attitude[0], axes.attitude[2], axes.position[0]):
        path = quadrotor_tuning.lagging(axes, axis)

        def loop(w, axis=axis, path=path):
            s = 1j * w
            lag = np.polyval(path.actuator.num, s) / np.polyval(path.actuator.den, s)
            return axis.gain @ [1, s] / s**2 * lag * np.exp(-s * (path.delay + axis.sample_time / 2))

        crossover = brentq(lambda w, loop=loop: abs(loop(w)) - 1, 0.5 * axis.frequency, 4 * axis.frequency)
        by_hand = (np.angle(loop(crossover)) + np.pi) / crossover
        assert quadrotor_tuning.tolerated_alone(axes, axis) == pytest.approx(by_hand, rel=1e-5)  # A is by differences, to 1e-5
        assert quadrotor_tuning.rule_of(axes, axis, 288).delay_margin == pytest.approx(by_hand / 2, rel=0.05)


def test_the_rule_finds_the_numbers_that_fly_again(axes):
    """One scheme is tuned again and agrees in the three stored digits."""
    roll = axes.attitude[0]
    found = quadrotor_tuning.tuned(axes, roll, "adrc", quadrotor_tuning.rule_of(axes, roll, flight_tuning.RULE.trials))
    assert found.meets
    assert {knob: float(f"{value:.3g}") for knob, value in found.tuning.items()} == TUNED["roll"]["adrc"]
