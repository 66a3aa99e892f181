"""Trim and linear model of the F-16, compared with JSBSim's own trim, its motion, and published figures."""

import numpy as np
import pytest
from scipy.linalg import expm

jsbsim = pytest.importorskip("jsbsim", reason="the extra flight is not installed: ./dev flight installs it")

import broken_aircraft  # noqa: E402

from barbalat import InputError  # noqa: E402
from barbalat.flights import FlightCondition, SimulatorFailed  # noqa: E402
from barbalat.vehicles.f16.airframe import STEP, Airframe, Surfaces  # noqa: E402
from barbalat.vehicles.f16.model import BALLAST_LB  # noqa: E402
from barbalat.vehicles.f16.trim import trimmed  # noqa: E402
from barbalat.vehicles.isolated import isolated  # noqa: E402

CONDITION = FlightCondition(altitude=10_013, mach=0.525)  # NASA/TM-2015-218675
SEA_LEVEL = FlightCondition(altitude=0, mach=502 / 1116.45)  # 502 ft/s: Stevens and Lewis


@pytest.fixture(scope="module")
def trim():
    return trimmed(CONDITION)


def as_installed():
    """JSBSim's F-16 without any change."""
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("f16")
    fdm["fcs/fbw-override"] = 1
    fdm["gear/gear-cmd-norm"] = fdm["gear/gear-pos-norm"] = 0
    fdm["ic/h-sl-ft"], fdm["ic/mach"] = CONDITION.altitude, CONDITION.mach
    fdm.run_ic()
    return fdm


def test_trim_is_that_of_jsbsim_on_the_unchanged_file(trim):
    fdm = as_installed()
    fdm["propulsion/set-running"] = -1
    fdm.do_trim(1)  # JSBSim's own simplex, which ends at 1e-3 ft/s^2, about 1e-4 deg
    assert np.rad2deg(trim.alpha) == pytest.approx(fdm["aero/alpha-deg"], abs=1e-3)
    assert trim.elevator == pytest.approx(fdm["fcs/elevator-pos-rad"], abs=1e-5)
    assert trim.throttle == pytest.approx(fdm["fcs/throttle-cmd-norm"], abs=1e-3)


def test_the_changed_aircraft_weighs_what_the_installed_one_does(trim):
    fdm, airframe = as_installed(), Airframe(CONDITION)
    airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
    for name in ("inertia/weight-lbs", "inertia/cg-x-in", "inertia/cg-z-in", "inertia/iyy-slugs_ft2"):
        assert airframe.fdm[name] == pytest.approx(fdm[name], rel=1e-12), name
    before = airframe.fdm["inertia/cg-x-in"]
    airframe.shift_ballast(70.0)
    airframe.fdm.run()
    shift = airframe.fdm["inertia/cg-x-in"] - before
    assert shift == pytest.approx(70 * BALLAST_LB / fdm["inertia/weight-lbs"])
    assert shift / 12 / 11.32 == pytest.approx(0.05, abs=1e-3)  # "5 % of the chord", which has 11.32 ft


def test_trim_is_near_the_published_one(trim):
    assert np.rad2deg(trim.alpha) == pytest.approx(2.64, abs=0.5)  # TM-2015-218675; another data set


def test_modes_have_the_published_shape():
    """Stevens and Lewis give the short period as -1.20 +- 1.49j, the Dutch roll as -0.44 +- 3.22j and roll as -3.60, for a
    different data set."""
    modes = trimmed(SEA_LEVEL).modes()
    for name, published in (("short period", -1.20 + 1.49j), ("Dutch roll", -0.44 + 3.22j), ("roll", -3.60)):
        first = modes[name][0]
        assert 0.5 < abs(first) / abs(published) < 2
        assert 0.5 < first.real / np.real(published) < 2
        assert (first.imag != 0) == (np.imag(published) != 0)
    phugoid = modes["phugoid"][0]
    assert phugoid.imag > 0 > phugoid.real
    assert 0.5 < abs(phugoid) / (np.sqrt(2) * 32.17 / 502) < 1  # Lanchester's is of an airframe that holds its angle of attack
    assert abs(modes["spiral"][0]) < 0.05


def test_alpha_s_row_is_that_of_stevens_and_lewis():
    """At 502 ft/s Stevens and Lewis give alpha' = -1.01887 alpha + 0.90506 q. The lift is the same, wherever the data come
    from."""
    found, rows = trimmed(SEA_LEVEL), [1, 3]  # alpha, q
    A, b = found.A[np.ix_(rows, rows)], found.B[rows, 0]
    np.testing.assert_allclose(A[0], [-1.01887, 0.90506], rtol=0.02)
    assert A[1, 1] == pytest.approx(-1.07741, rel=0.2)
    assert b[1] == pytest.approx(np.rad2deg(-0.17555), rel=0.2)  # theirs is for degrees of elevator


def test_the_linear_model_is_what_the_aircraft_does(trim):
    """With a tenth of a degree of elevator for a second, the motion is the linear one to a few per cent of its size."""
    airframe, turned = Airframe(CONDITION), np.deg2rad(0.1)
    airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
    airframe.move(Surfaces(trim.elevator + turned))
    for _ in range(round(1 / STEP)):
        airframe.fdm.run()
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = trim.A[:4, :4], trim.B[:4, 0] * turned
    expected = expm(whole)[:4, 4]
    found = (np.array(airframe.motion) - np.array(trim.motion))[:4]
    np.testing.assert_allclose(found[1:], expected[1:], rtol=0.02)


def test_half_the_step_moves_it_alike(trim):
    """The surfaces act one step late, so the difference is of first order and small."""
    ends = []
    for step in (STEP, STEP / 2):
        airframe = Airframe(CONDITION, step)
        airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
        airframe.move(Surfaces(trim.elevator - np.deg2rad(1)))
        for _ in range(round(1 / step)):
            airframe.fdm.run()
        ends.append(airframe.angles(["alpha", "q"]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=3e-3)


def test_no_part_of_the_file_s_control_system_moves_the_aircraft(trim):
    airframe = Airframe(CONDITION)
    airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
    for command in ("elevator", "rudder"):  # ailerons would move the flaps too, and stay at zero
        airframe.fdm[f"fcs/{command}-cmd-norm"] = 0.5
    before = airframe.rates
    airframe.fdm.run()
    airframe.fdm.run()
    assert np.abs(airframe.rates[[3, 6, 7]] - before[[3, 6, 7]]).max() < 1e-3  # half a surface is 2 rad/s^2 and more


@pytest.mark.parametrize(
    ("condition", "sentence"),
    [
        ({"mach": 0.1}, "at 10013 ft, Mach 0.1: it would take an angle of attack of 72.2 deg, but the tables end at 45 deg"),
        ({"altitude": 49_000, "mach": 0.4}, "a throttle of .*, but its range is 0 to 1"),
        ({"altitude": 20_000, "mach": 0.9}, "Newton's method leaves a residual of"),  # where the file's flaps jump
    ],
)
def test_what_cannot_be_trimmed_is_said(condition, sentence):
    with pytest.raises(InputError, match=sentence):
        trimmed(FlightCondition(**condition))


@pytest.mark.parametrize("given", [{"altitude": -1}, {"altitude": 60_000}, {"mach": 0}, {"mach": 3}, {"mach": "fast"}])
def test_a_condition_says_what_is_wrong_with_it(given):
    with pytest.raises(InputError, match=next(iter(given))):
        FlightCondition(**given)


def test_a_property_that_nobody_has_ends_a_process_and_not_this_one():
    with pytest.raises(SimulatorFailed, match=r"^the simulator's process ended ") as found:
        isolated(60, broken_aircraft.load)
    assert "elevatr" in str(found.value)
    assert "\n" not in str(found.value)


def test_a_gust_turns_the_angle_of_attack_alone(trim):
    """A downward gust w initially decreases the angle of attack by w/V and the lift by Z_alpha w/V."""
    airframe = Airframe(CONDITION)
    airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
    airframe.blow(5.0)
    for _ in range(3):  # JSBSim's load factor belongs to the previous step
        airframe.fdm.run()
    alpha, q = np.deg2rad(airframe.angles(["alpha", "q"]))
    assert alpha - trim.alpha == pytest.approx(-5 / trim.speed, rel=0.02)  # cos(alpha), and 7.5 ms of motion
    assert abs(q) < 1e-3
    lift = trim.A[1, 1] * trim.speed / 32.17 * -5 / trim.speed  # less lift: Z_alpha is negative
    assert airframe.load_factor - 1 == pytest.approx(-abs(lift), rel=0.1)
