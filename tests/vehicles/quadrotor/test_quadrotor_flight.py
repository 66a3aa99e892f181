"""Whole flights of the quadrotor: repeated, through failures, with the package's own laws, and from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra flight is not installed: ./dev flight installs it")

from benchmarks.quadrotor import PAGE, cell
from scipy.signal import step

from barbalat import InputError, Mrac, Sampled
from barbalat.cli import main
from barbalat.flights import SimulatorFailed, fly
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.vehicles import flying
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.quadrotor import control
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, Axes
from barbalat.vehicles.quadrotor.body import Quadrotor
from barbalat.vehicles.quadrotor.failures import FAILURES
from barbalat.vehicles.quadrotor.hover import hovering
from barbalat.vehicles.quadrotor.schemes import SCHEMES, TUNED
from barbalat.vehicles.quadrotor.trajectory import TAKES_OFF
from barbalat.vehicles.schemes import available
from vehicles.nominal import QUADROTOR, on_axis, quadrotor_through, scheme_on

pytestmark = pytest.mark.full  # ./dev flight runs them; each takes seconds


@pytest.fixture(scope="module")
def axes():
    return Axes(hover=hovering(Quadrotor()))


SHORTER = Timing(duration=13.0, fails_at=10.0)
CHOSEN = {
    "geometric": ["slung-mass", "half-propeller"],
    "geometric-integral": ["none", "no-reset"],
    "l1-piecewise": ["none", "slung-mass", "half-propeller", "no-reset"],
}


@pytest.fixture(scope="module")
def flown(axes):
    found = {}
    for scheme, names in CHOSEN.items():
        several = quadrotor_through(axes, scheme_on(axes, scheme), [FAILURES[name] for name in names], SHORTER)
        found[scheme] = {one.failure.name: one for one in several}
    return found


def test_the_same_flight_twice_is_the_same_in_every_bit(axes, flown):
    """A flight does not depend on earlier flights or on the instant at which it continued alone."""
    (again,) = quadrotor_through(axes, scheme_on(axes, "l1-piecewise"), [FAILURES["slung-mass"]], SHORTER)
    np.testing.assert_array_equal(again.record, flown["l1-piecewise"]["slung-mass"].record)


def test_flights_before_the_failure_are_the_same_in_every_bit(flown):
    for several in (flown["geometric"], flown["l1-piecewise"]):
        first, *others = (one for name, one in several.items() if name != "no-reset")
        for other in others:
            np.testing.assert_array_equal(other.record[:1000], first.record[:1000])


def test_what_a_slung_mass_does_to_a_controller_without_memory_is_what_statics_say(axes, flown):
    """The vehicle sinks until k_R e of its height carries the mass. The missing acceleration is 250 g times g over 1 kg."""
    late = flown["geometric"]["slung-mass"].record[-150:]
    sunk = np.mean(late[:, 3] - late[:, 6])
    missing = 0.25 * 9.81  # m/s^2, for a controller that assumes 1 kg
    assert sunk == pytest.approx(missing / axes.position[2].gain[0], rel=0.1)  # the path's own motion, and tilt
    # what the filter does not compensate yet: s/(s + bandwidth) of it through the loop, from 1.5 to 3 s after the failure
    up = axes.position[2]
    left = [up.gain[0], 0.0], np.polymul([1.0, TUNED["forward"]["l1-piecewise"]["bandwidth"] / up.lag], [1.0, *up.gain[::-1]])
    t, response = step(left, T=np.linspace(0, 3, 301))
    found = np.mean(late[:, 3] - flown["l1-piecewise"]["slung-mass"].record[-150:, 6])
    assert found == pytest.approx(missing / up.gain[0] * response[t > 1.5].mean(), rel=0.1)


def test_who_is_lost_and_who_is_not(flown):
    lost = {(scheme, name) for scheme, several in flown.items() for name, one in several.items() if one.lost}
    assert lost == {("geometric", "half-propeller")}
    one = flown["geometric"]["half-propeller"]
    assert one.lost == "it tilted by more than 85 deg"
    assert set(one.figures.values()) == {None, one.lost_at}
    kept = flown["l1-piecewise"]["half-propeller"]
    after = kept.record[1000:]
    assert kept.figures["rms_e"] == pytest.approx(np.sqrt(np.mean(np.sum((after[:, 4:7] - after[:, 1:4]) ** 2, axis=1))))


def test_an_integral_that_ran_on_the_ground_throws_the_vehicle_off_its_path(flown):
    """For this reason laws are reset when they take over control. With a reset the integral is no worse than the others."""
    tried = ("geometric-integral", "l1-piecewise")
    largest, reset = ({name: np.max(flown[name][failure].error[200:600]) for name in tried} for failure in ("no-reset", "none"))
    assert largest["geometric-integral"] > 5 * reset["geometric-integral"]
    assert largest["l1-piecewise"] < 0.5 * largest["geometric-integral"]  # it decays sooner


@pytest.mark.parametrize("name", available(SCHEMES))
def test_what_flies_is_the_package_s_own_sampled_controller(name, axes, monkeypatch):
    """The scheme's equations in NumPy give the flown u for every sample of an axis."""
    seen = []
    asked = control._asked

    def recording(loops, errors):
        found = asked(loops, errors)
        axis, flies = loops[0]
        if axis.name == "roll":
            seen.append((errors[0].copy(), float(flies.state[flies.contents.u][0])))
        return found

    monkeypatch.setattr(control, "_asked", recording)
    short = Timing(duration=2.5, fails_at=2.5)
    quadrotor_through(axes, scheme_on(axes, name), [replace(FAILURES["none"], stale=True)], short)
    loop = ClosedLoop.of(*on_axis(name, axes.attitude[0]))
    acting = initial_acting(loop)
    assert len(seen) == 1000
    for x, u in seen:
        acting = loop.computer.act(acting, x, np.zeros(()))
        assert u == pytest.approx(float(np.reshape(acting.held.u, ())), rel=1e-9, abs=1e-9)  # sums in a different order


def test_a_command_beyond_the_limit_is_fed_to_the_predictor_as_what_is_left_of_it(axes):
    """The roll has an error of 2 rad for a second. The estimate of the disturbance stays near zero if there is none."""
    for name in ("l1-piecewise", "l1-piecewise-flown"):
        axis = axes.attitude[0]
        loop = ClosedLoop.of(*on_axis(name, axis))
        acting, x, u = initial_acting(loop), np.array([2.0, 0.0]), 0.0
        for _ in range(200):
            acting = loop.computer.act(acting, x, np.zeros(()))
            u = axis.limited(float(np.reshape(acting.held.u, ())))
            T, acceleration = axis.sample_time, -float(axis.gain @ x) + u  # the nominal plant, unlimited feedback
            x = np.array([x[0] + T * x[1] + 0.5 * T**2 * acceleration, x[1] + T * acceleration])
        assert abs(acting.controller.sigma_hat[0]) < 0.05 * axis.limit


def test_the_delay_tolerated_is_found_to_a_sample(axes):
    scheme, early, none = scheme_on(axes, "geometric"), Timing(duration=7.0, fails_at=3.0), FAILURES["none"]
    tolerated = flying.tolerated_delay(QUADROTOR, axes, scheme, early)
    assert tolerated == pytest.approx(ATTITUDE_SAMPLE * round(tolerated / ATTITUDE_SAMPLE))
    more = [replace(none, delay=tolerated), replace(none, delay=tolerated + ATTITUDE_SAMPLE)]
    (kept, lost) = quadrotor_through(axes, scheme, more, early)
    assert (bool(kept.lost), bool(lost.lost)) == (False, True)
    roll = axes.attitude[0]
    crossover = 1.55 * roll.frequency
    margin = np.deg2rad(65.5) / crossover - roll.lag
    assert margin < tolerated < 3 * margin  # the limit of the linear loop for small signals; the motion grows slowly


class Overflowing:
    """A law that adds zero and finally NaN."""

    name, overflows_at = "overflowing", 2.6

    def step(self):
        return Overflowing()

    def reset(self):
        self.k = 0

    def __call__(self, y, r):
        self.k += 1
        return np.array([np.nan if self.k * ATTITUDE_SAMPLE > self.overflows_at - TAKES_OFF else 0.0])

    def agreement(self):
        return None


def test_a_controller_that_overflows_loses_its_vehicle_and_says_so(axes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nominal = scheme_on(axes, "geometric")
    scheme = replace(nominal, loops=(Overflowing(), *nominal.loops[1:]))
    (one,) = quadrotor_through(axes, scheme, [FAILURES["none"]], Timing(duration=4.0, fails_at=3.0))
    assert one.lost == "its controller gave a command that is not a number"
    assert one.lost_at == pytest.approx(Overflowing.overflows_at, abs=0.011)
    assert np.isfinite(one.record).all()
    assert list(tmp_path.iterdir()) == []  # MuJoCo has no warning


def test_a_flight_of_a_controller_of_ones_own_that_breaks_is_lost_alone(monkeypatch):
    real = flying.isolated

    def breaking(seconds, function, *given):
        if function is flying.flown and any(failure.name == "wind" for failure in given[3]):
            raise SimulatorFailed("the simulator's process ended by signal 11")
        return real(seconds, function, *given)

    monkeypatch.setattr(flying, "isolated", breaking)
    own = Sampled(Mrac(gamma=1.0, name="Mine"), 1 / 400)
    found = fly("quadrotor", schemes=[], controllers=[own], failures=["motor-lag", "wind"])
    ((nominal, broken),) = found.flights
    assert not nominal.lost
    assert nominal.controller == "Mine"
    assert broken.lost == "the simulator's process ended by signal 11"
    assert broken.figures["rms_e"] is None


def test_a_controller_of_ones_own_says_why_it_does_not_fly():
    for wrong, sentence in (
        (Mrac(gamma=1.0), "MRAC is continuous"),
        (Sampled(Mrac(gamma=1.0), 0.01), "must have the sample time of this flight computer, 0.0025 s"),
    ):
        with pytest.raises(InputError, match=sentence):
            fly("quadrotor", schemes=[], controllers=[wrong], failures=["none"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--schemes", "lqr"], "--schemes must be one of geometric, "),
        (["--failures", "none,engine"], "--failure must be one of none, slung-mass, "),
        (["--mach", "0.5"], "apply only to the F-16: the quadrotor hovers near the ground"),
    ],
)
def test_bad_input_is_one_sentence(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "quadrotor", *arguments]) == 2
    out, said = capsys.readouterr()
    assert out == ""
    assert sentence in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_command_leaves_page_film_tables_and_json(tmp_path, capsys):
    arguments = ["fly", "quadrotor", "--schemes", "geometric,adrc", "--failures", "half-propeller"]
    assert main([*arguments, "--out", str(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    drawn = {"flight-half-propeller.png", "path-half-propeller.png", "flight.gif"}
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", "fly.json", "flight-half-propeller.csv", *drawn}
    assert document["failures"]["half-propeller"]["lost"] == ["Geometric"]
    assert document["failures"]["half-propeller"]["best"] == "ADRC"
    assert document["simulation"]["integrator"] == "RK4"
    for name, figures in document["controllers"].items():  # the guide's table, written by the same function
        row = next(line.split(" | ") for line in PAGE.read_text().splitlines() if line.startswith(f"| {name} |"))
        assert row[3] == cell(figures["half-propeller"])
    assert document["electronics"]["rate_noise"] == 0.02
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/gif") == 1
    assert "http" not in page.replace("http%3A//www.w3.org", "")
    assert len((tmp_path / "flight.gif").read_bytes()) < 2_000_000
