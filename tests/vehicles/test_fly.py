"""Whole flights: compared with the linear loop, through failures, and from the command line."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("jsbsim", reason="the extra flight is not installed: ./dev flight installs it")

from barbalat import InputError, Mrac, Sampled
from barbalat.cli import main
from barbalat.designs import pi_feedback
from barbalat.flights import FlightCondition, SimulatorFailed, fly
from barbalat.run.kernel.sampled_controller import SampledList, SampledStep
from barbalat.vehicles import flying
from barbalat.vehicles.f16 import vehicle as f16
from barbalat.vehicles.f16.airframe import STEP
from barbalat.vehicles.f16.axis import PITCH, ROLL, SAMPLE_TIME, Axis
from barbalat.vehicles.f16.equipment import Actuator, Equipment, Sensors
from barbalat.vehicles.f16.failures import OF_PITCH, OF_ROLL
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.vehicle import vehicle_of
from vehicles.nominal import alone, of_axis, through_failures

FAILURES = {one.name: one for one in OF_PITCH}
pytestmark = pytest.mark.full  # ./dev flight runs them; each starts a simulator


@pytest.fixture(scope="module")
def flown():
    return fly("f16-pitch", schemes=["lqr", "linear", "l1-piecewise"], failures=["none", "aft-cg", "reversed"])


def test_a_small_flight_is_the_linear_loop():
    """The reference is the linear model of all four longitudinal states with the same equipment and u = k_0 r - K y, written
    here."""
    axis = Axis(
        trim=trimmed(FlightCondition()), followed=replace(PITCH, commanded=0.3)
    )  # the tables have corners within degrees of trim
    small = axis.followed.command
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = axis.trim.A[:4, :4], axis.trim.B[:4, 0]
    ahead = expm(whole * STEP)[:4]
    elevator, sensors = Actuator(Equipment(), STEP, 0.0), Sensors(Equipment(), STEP)
    x, q = np.zeros(4), []
    for k in range(1000):
        u = axis.k_0 * float(small(np.array(0.01 * k))) - axis.gain @ sensors.output
        q.append(np.rad2deg(x[3]))
        for _ in range(4):
            x = ahead @ np.append(x, np.deg2rad(elevator.advance(u)))
            sensors.advance(np.rad2deg(x[[1, 3]]))
    (found,) = through_failures(axis, SampledList.of(*of_axis(axis, "lqr")), [FAILURES["none"]])
    assert (
        np.abs(found.column("q")[:1000] - q).max() < 0.02 * 0.3
    )  # the remainder is of second order, plus the late step of the surfaces


def test_flights_before_the_failure_are_the_same_in_every_bit(flown):
    for several in flown.flights:
        first = several[0].record[:1000]
        for other in several[1:]:
            np.testing.assert_array_equal(other.record[:1000], first)


def test_who_loses_control_and_who_does_not(flown):
    assert flown.losses == {"LQR with PI": 1, "L1 piecewise": 1, "LQR": 2}
    reversed_ = flown.all_through(FAILURES["reversed"])
    assert all(one.lost and 10 < one.lost_at < 12 for one in reversed_)  # feedback with the wrong sign: a pole at +3 rad/s
    assert all(one.column("q_m").max() > 3 for one in flown.all_through(FAILURES["none"]))
    kept = [one for one in flown.through(FAILURES["aft-cg"]) if not one.lost]
    assert [one.rms_error for one in kept] == sorted(one.rms_error for one in kept)
    for one in kept:
        error = (one.column("q") - one.column("q_m"))[1000:]
        assert one.figures["rms_e"] == pytest.approx(math.sqrt(float(error @ error) / len(error)))


def test_the_delay_tolerated_is_about_the_linear_one():
    """For the linear aircraft without limits of the surface, the motion decays with 50 ms less and grows with 50 ms more."""
    axis = Axis(trim=trimmed(FlightCondition()))
    contents = SampledList.of(*of_axis(axis, "l1-piecewise"))
    tolerated = flying.tolerated_delay(vehicle_of(axis.like), axis, alone(contents))
    assert tolerated == pytest.approx(SAMPLE_TIME * round(tolerated / SAMPLE_TIME))
    assert linear_growth(axis, contents, tolerated - 0.05) < 0.5  # the remainder is the phugoid, which is not fed back
    assert linear_growth(axis, contents, tolerated + 0.05) > 10
    feedback = alone(SampledList.of(*of_axis(axis, "lqr")))
    assert flying.tolerated_delay(vehicle_of(axis.like), axis, feedback) > 2 * tolerated  # docs/guides/aircraft.md says so


def test_without_protection_against_windup_a_pi_loses_the_hard_over_that_it_else_survives():
    """docs/guides/aircraft.md states this."""
    axis = Axis(trim=trimmed(FlightCondition()))
    problem = axis.linear_problem
    pi = pi_feedback(problem.known, unmodelled_delay=axis.equipment.lag, nominal=axis.gain)
    for anti_windup, lost in ((None, True), (0.3, False)):
        contents = SampledList.of(problem, Sampled(replace(pi, anti_windup=anti_windup), 0.01))
        (found,) = through_failures(axis, contents, [FAILURES["hard-over"]])
        assert bool(found.lost) == lost


def test_a_small_roll_is_the_linear_loop():
    """The reference is the linear model of all four lateral states, as above. It neglects terms of second order."""
    axis = Axis(trim=trimmed(FlightCondition()), followed=replace(ROLL, commanded=1.0))
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = axis.trim.A[4:, 4:], axis.trim.B[4:, 1]
    ahead = expm(whole * STEP)[:4]
    actuator, sensors = Actuator(axis.equipment, STEP, 0.0), Sensors(axis.equipment, STEP, 3)
    x, p = np.zeros(4), []
    for k in range(1000):
        u = axis.k_0 * float(axis.followed.command(np.array(0.01 * k))) - axis.gain @ sensors.output
        p.append(np.rad2deg(x[2]))
        for _ in range(4):
            x = ahead @ np.append(x, np.deg2rad(actuator.advance(u)))
            sensors.advance(np.rad2deg(x[[0, 2, 3]]))
    (found,) = through_failures(axis, SampledList.of(*of_axis(axis, "lqr")), [OF_ROLL[0]])
    assert np.abs(found.column("p")[:1000] - p).max() < 0.02  # 2 % of the commanded rate, as in pitch


def test_an_observer_leaves_what_the_model_s_own_row_makes_of_sideslip_and_an_integral_does_not():
    """docs/laboratory/f16.md states this for lateral gusts. Here p' is integrated from A_m's row and the measurements."""
    axis = Axis(trim=trimmed(FlightCondition()), followed=ROLL)
    gusts, row = next(one for one in OF_ROLL if one.name == "gusts"), axis.A_m[1]
    assert (row[0], axis.model[0][1, 0]) == pytest.approx((-21, -27), abs=0.5)
    error, share = {}, {}
    for name in ("adrc", "linear"):
        (flight,) = through_failures(axis, SampledList.of(*of_axis(axis, name)), [gusts])
        made = [0.0]
        for beta in flight.column("beta")[:-1]:
            made.append(made[-1] + 0.01 * (row[1] * made[-1] + row[0] * beta))
        e, made = (one[1000:] for one in (flight.column("p") - flight.column("p_m"), np.array(made)))
        error[name], share[name] = flight.rms_error, float(np.corrcoef(e, made)[0, 1])
    assert share["adrc"] > 0.9
    assert share["linear"] < 0
    assert (error["linear"], error["adrc"]) == pytest.approx((1.8, 3.5), abs=0.05)


def test_a_rolling_aircraft_goes_where_its_lift_turns_it():
    """The path turns by g n_z sin(bank)/speed. The nose deviates from it by at most the sideslip and, in a bank, the angle of
    attack."""
    (found,) = fly("f16-roll", schemes=["linear"], failures=["none"]).flights
    record = found[0]
    bank, heading, speed, load = (record.column(name)[:-1] for name in ("bank", "heading", "speed", "n_z"))
    turning = np.cumsum(0.01 * 32.17 * load * np.sin(np.deg2rad(bank)) / speed)
    north, east, climb = (np.diff(record.column(name)) / 0.01 for name in ("north", "east", "altitude"))
    course = np.arctan2(east, north)
    assert np.abs(course - turning).max() < 0.04 * np.ptp(turning)
    assert np.abs(np.rad2deg(course) - heading).max() < 2.2 * np.sin(np.deg2rad(bank)).max() + 0.2 + 0.1
    assert np.hypot(north, east) == pytest.approx(np.sqrt(speed**2 - climb**2), rel=2e-3)


def linear_growth(axis, contents, delay):
    """The ratio of the linear pitch rate from 20 s to 25 s to that during a pulse and 3 s after it."""
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = axis.trim.A[:4, :4], axis.trim.B[:4, 0]
    ahead = expm(whole * STEP)[:4]
    unlimited = Equipment(transport_delay=0.02 + delay, rate_limit=1e9, limit=1e9)
    elevator, sensors, controller = Actuator(unlimited, STEP, 0.0), Sensors(unlimited, STEP), SampledStep(contents)
    x, q = np.zeros(4), []
    for k in range(2500):
        u = float(controller(sensors.output, 1e-3 if k < 200 else 0.0)[0])
        q.append(abs(x[3]))
        for _ in range(4):
            x = ahead @ np.append(x, np.deg2rad(elevator.advance(u)))
            sensors.advance(np.rad2deg(x[[1, 3]]))
    return max(q[2000:]) / max(q[:500])


def test_a_controller_that_overflows_loses_its_aircraft_and_says_so():
    axis = Axis(trim=trimmed(FlightCondition()))

    class Overflowing:
        name = "overflowing"

        def reset(self):
            self.k = 0

        def __call__(self, y, r):
            self.k += 1
            return np.array([np.nan if self.k > 200 else 0.0])

        def agreement(self):
            return None

    one = fly_once(axis, Overflowing(), OF_PITCH[0])
    assert (one.lost, one.lost_at) == ("its controller gave a command that is not a number", 2.0)


def test_a_flight_that_breaks_is_lost_alone(monkeypatch):
    """The process that runs all flights of a controller crashes. Of the processes that run single flights, only the one with a
    particular failure crashes."""
    real = flying.isolated

    def breaking(seconds, function, *given):
        if function is flying.flown and any(failure.name == "reversed" for failure in given[3]):
            raise SimulatorFailed("the simulator's process ended by signal 11")
        return real(seconds, function, *given)

    monkeypatch.setattr(flying, "isolated", breaking)
    ((nominal, broken),) = fly(schemes=["lqr"], failures=["none", "reversed"]).flights
    assert not nominal.lost
    assert len(nominal.record) == 3000
    assert broken.lost == "the simulator's process ended by signal 11"
    assert broken.figures["rms_e"] is None


def test_a_controller_of_ones_own_flies_and_says_why_not():
    own = Sampled(Mrac(gamma=0.01, name="Mine"), 0.01)
    found = fly(schemes=[], controllers=[own], failures=["none"])
    assert found.controllers == ("Mine",)
    for wrong, sentence in (
        (Mrac(gamma=0.01), "MRAC is continuous"),
        (Sampled(Mrac(gamma=0.01), 0.02), "must have the sample time of this flight computer, 0.01 s"),
        (Sampled(Mrac(gamma=[1.0, 1.0]), 0.01), "gamma"),
    ):
        with pytest.raises(InputError, match=sentence):
            fly(schemes=[], controllers=[wrong], failures=["none"])


OUTPUT_CONTROLLER = """
from barbalat import L1Output, Sampled, TransferFunction
CONTROLLERS = [Sampled(L1Output(m=3, gamma=10, filter=TransferFunction([30], [1, 30]), sigma_bound=1, lipschitz=1), 0.01)]
"""


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["f16"], "NAME must be one of f16-pitch, f16-roll, quadrotor, got 'f16'"),
        (["f16-pitch", "--schemes", "lqr,mrac-output"], "--schemes must be one of lqr, linear, hinf, "),
        (["f16-pitch", "--failure", "engine"], "--failure must be one of none, elevator-50, "),
        (["f16-pitch", "--mach", "0.1"], "can't be trimmed in level flight at 10013 ft, Mach 0.1"),
        (["f16-pitch", "--altitude", "-5"], "altitude must "),
        (["f16-pitch", "--controllers", "own.py"], "output"),
    ],
)
def test_bad_input_is_one_sentence(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OUTPUT_CONTROLLER)
    assert main(["fly", *arguments]) == 2
    out, said = capsys.readouterr()
    assert out == ""
    assert sentence in said
    assert said.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir() if file.name != "__pycache__"] == ["own.py"]


def test_a_simulator_that_breaks_before_any_flight_is_one_sentence(monkeypatch, capsys, tmp_path):
    def broken(seconds, function, *given):
        raise SimulatorFailed("the simulator's process ended by signal 6")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(f16, "isolated", broken)
    assert main(["fly", "f16-pitch"]) == 1
    assert capsys.readouterr().err == "barbalat: the simulator's process ended by signal 6\n"
    assert list(tmp_path.iterdir()) == []


def test_the_command_leaves_page_tables_and_json(tmp_path, capsys):
    arguments = ["fly", "f16-pitch", "--schemes", "lqr,l1-piecewise", "--failure", "none", "--failure", "aft-cg"]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    names = {file.name for file in (tmp_path / "out").iterdir()}
    pictures = {f"flight-{failure}.{kind}" for failure in ("none", "aft-cg") for kind in ("png", "csv")}
    assert names == {"report.html", "fly.json", "flight.gif", "path-none.png", "path-aft-cg.png", *pictures}
    assert json.loads((tmp_path / "out" / "fly.json").read_text()) == document
    assert document["failures"]["aft-cg"]["lost"] == ["LQR"]
    assert document["controllers"]["LQR"]["aft-cg"]["rms_e"] is None
    assert document["controllers"]["LQR"]["none"]["lost_at"] is None
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/svg+xml") == 8  # a wide and a narrow picture of each, over time and in space, within the page
    assert page.count("data:image/gif") == 1
    assert "http" not in page.replace("http%3A//www.w3.org", "")
    rows = (tmp_path / "out" / "flight-none.csv").read_text().splitlines()
    assert rows[0].startswith("controller,t [s],q_c [deg/s]")
    assert len(rows) == 1 + 2 * 301  # ten a second, and the last
