"""Random aircraft: the effect of their numbers, and a store that resumes where it stopped."""

import json

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="the extra flight is not installed: ./dev flight installs it")

from benchmarks import flight_tuning
from benchmarks.flight_tuning import PAGES

from barbalat.cli import main
from barbalat.flights import FlightCondition
from barbalat.papers.jafari_2013.flight.flown import Flights
from barbalat.run.kernel.sampled_controller import SampledList, SampledStep
from barbalat.vehicles import dispersed
from barbalat.vehicles.dispersed import fly_dispersed
from barbalat.vehicles.f16.airframe import Airframe
from barbalat.vehicles.f16.axis import PITCH, Axis
from barbalat.vehicles.f16.dispersions import NOMINAL, Dispersion
from barbalat.vehicles.f16.failures import NONE
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.schemes import TUNED
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.vehicle import draws_of, vehicles
from vehicles.nominal import of_axis

pytestmark = pytest.mark.full  # ./dev flight runs them; each starts a simulator


@pytest.fixture(scope="module")
def axis():
    return Axis(trim=trimmed(FlightCondition()), followed=PITCH)


def rates(trim, changed, *, q=0.0):
    airframe = Airframe(trim.condition)
    changed(airframe)
    airframe.put(trim.motion._replace(q=q), trim.surfaces, trim.throttle)
    return airframe.rates


def test_twice_the_damping_is_twice_its_part_of_the_linear_model(axis):
    """M_q comes from Cmq, except for the moment of the lift due to q about the centre of gravity, which is a tenth of it."""

    def slope(factor):
        return (
            rates(axis.trim, lambda one: one.scale("pitch_damping", factor), q=0.01)[3]
            - rates(axis.trim, lambda one: one.scale("pitch_damping", factor), q=-0.01)[3]
        ) / 0.02

    without, whole, twice = slope(0.0), slope(1.0), slope(2.0)
    assert whole == pytest.approx(axis.trim.A[3, 3], rel=1e-6)
    assert twice - without == pytest.approx(2 * (whole - without), rel=1e-6)
    assert abs(without) < 0.15 * abs(whole)


def test_a_load_is_heavier_and_with_less_lift_it_sinks(axis):
    """With 100 lb added to W, n_z decreases by 100/W at the same lift."""
    before, after = Airframe(axis.trim.condition), Airframe(axis.trim.condition)
    after.load(100.0)
    for one in (before, after):
        one.put(axis.trim.motion, axis.trim.surfaces, axis.trim.throttle)
        one.fdm.run()
        one.fdm.run()
    heavier = after.fdm["inertia/weight-lbs"] - before.fdm["inertia/weight-lbs"]
    assert heavier == pytest.approx(100.0)
    lift = 1 - before.load_factor * before.fdm["inertia/weight-lbs"] / after.fdm["inertia/weight-lbs"]
    assert 1 - after.load_factor == pytest.approx(lift, rel=1e-2)  # two steps of 2.5 ms later the lift is slightly different
    less = rates(axis.trim, lambda one: one.scale("lift", 0.9))
    assert less[1] == pytest.approx(0.1 * 32.17 / axis.trim.speed, rel=0.15)  # alpha grows; the flaps' lift stays


@pytest.mark.parametrize("name", vehicles())
def test_draws_are_within_their_ranges_and_the_same_whoever_asks(name):
    drawing = vehicles()[name].drawing
    whole = list(draws_of(drawing.plan(50), 0, 50))
    assert list(draws_of(drawing.plan(50), 7, 3)) == whole[7:10]
    assert set(drawing.units) <= set(drawing.drawn)
    for quantity, spread in drawing.drawn.items():
        values = [draw[quantity] for _, draw in whole]
        assert spread.low <= min(values) < max(values) <= spread.high
    assert [number for number, _ in whole] == list(range(50))


def test_the_nominal_draw_is_the_nominal_flight(axis):
    step = SampledStep(SampledList.of(*of_axis(axis, "lqr")))
    first, second = fly_once(axis, step, NONE), fly_once(axis, step, NONE, NOMINAL)
    np.testing.assert_array_equal(first.record, second.record)
    late = fly_once(axis, step, NONE, Dispersion(delay=0.02)).record
    commands = (first.record[:, 7], late[:, 7])
    assert not np.array_equal(*commands)


def test_a_store_goes_on_where_it_was_left_in_the_same_bits(tmp_path, monkeypatch):
    def fly(store=None, **changed):
        arguments = {"schemes": ["lqr", "l1-piecewise"], "failures": ["reversed"], "members": 6} | changed
        return fly_dispersed(store=store, **arguments)

    monkeypatch.setattr(dispersed, "MOST_DRAWS", 3)
    names = [f"{one}, reversed/{figure}" for one in ("LQR", "L1 piecewise") for figure in ("lost_at", "rms_e")]
    expected = fly(processes=1)
    assert len(fly(tmp_path / "store").rows.names) == len(expected.rows.names)
    (tmp_path / "store" / "members-000000000003.parquet").unlink()
    again = fly(tmp_path / "store")
    assert again.resumed == 3
    for name in names:
        np.testing.assert_array_equal(again.rows.column(name), expected.rows.column(name))
    assert again.evidence.lost == {"LQR": (6, 6), "L1 piecewise": (6, 6)}
    with pytest.raises(dispersed.validate.InputError, match=r"or different --schemes or --failures: choose a different folder"):
        fly(tmp_path / "store", schemes=["lqr"])
    with pytest.raises(dispersed.validate.InputError, match=r"with more --dispersions, or a different --seed: choose"):
        fly(tmp_path / "store", members=5)
    grown, whole = fly(tmp_path / "store", members=7), fly(members=7)
    assert grown.resumed == 6
    for name in names:
        np.testing.assert_array_equal(grown.rows.column(name), whole.rows.column(name))


@pytest.mark.parametrize(("name", "failure"), [("f16-pitch", "elevator-50"), ("f16-roll", "aileron-50")])
def test_the_stored_flights_of_the_ledger_are_flown_again(name, failure):
    """The first draw is flown by three schemes and compared in the digits that agree between processors after ten seconds."""
    stored = Flights.stored(name).document
    assert stored["numbers"] == TUNED[name]
    found = fly_dispersed(
        name, schemes=["linear", "adrc", "l1"], failures=[failure, "reversed"], members=1, seed=stored["plan"]["seed"]
    )
    for column, value in found.rows.row(0).items():
        expected = stored["first_draw"][column]
        assert value == pytest.approx(float("nan") if expected is None else expected, rel=1e-6, nan_ok=True), column


@pytest.mark.parametrize("name", TUNED)
def test_what_is_tuned_is_what_the_guide_s_table_says_and_it_meets_the_rule(name):
    rows = [line.strip("| \n").split(" | ") for line in (PAGES / f"tuned-{name}.txt").read_text().splitlines()[2:]]
    told = {}
    for scheme, numbers, _, _, slack, up, down in rows:
        pairs = [] if numbers == "none" else [one.rstrip("*").rsplit(" ", 1) for one in numbers.split(", ")]
        told[scheme.strip("`")] = {knob: float(value) for knob, value in pairs}
        assert (float(slack) >= 1, min(float(up), float(down)) >= flight_tuning.GAIN_MARGIN) == (True, True)
    assert told == TUNED[name]


def test_the_rule_finds_the_numbers_that_fly_again(axis):
    """Two schemes are tuned again and agree in the three stored digits. Each takes 8 s."""
    for scheme in ("linear", "l1-piecewise"):
        found = flight_tuning.tuned(axis, scheme)
        assert found.meets
        assert {knob: float(f"{value:.3g}") for knob, value in found.tuning.items()} == TUNED["f16-pitch"][scheme]


def test_the_command_says_losses_first_and_leaves_page_and_json(tmp_path, capsys):
    arguments = ["fly", "f16-pitch", "--dispersions", "2", "--schemes", "lqr,linear", "--failure", "reversed"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert shown.index("reversed: all lose every flight") < shown.index("the elevator acts with the opposite sign")
    document = json.loads((tmp_path / "out" / "fly.json").read_text())
    assert document["lost"] == {"LQR": {"count": 2, "flights": 2}, "LQR with PI": {"count": 2, "flights": 2}}
    assert document["failures"]["reversed"]["LQR"]["rms_e"]["median"] is None
    assert "lost to lost" not in shown  # two draws bound no median
    assert "comparisons that at least one draw decides" not in shown  # if both lose all flights there is nothing to compare
    assert "lose every flight" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--store", "somewhere"], "--store needs a campaign"),
        (["--dispersions", "4", "--mach", "0.5"], "--mach cannot be combined with --dispersions"),
        (["--dispersions", "0"], "--dispersions must be a whole number from 1"),
    ],
)
def test_bad_input_is_one_sentence(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "f16-pitch", *arguments]) == 2
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
