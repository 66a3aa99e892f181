"""``--target ardupilot``: the backend is compiled with interfaces written from ArduPilot's published headers, and called.

This is not ArduPilot itself. One backend was flown in ArduPilot's simulator outside the tests (docs/guides/flight.md). The tests
show that the class overrides the required methods, engages without a bump, leaves the ground and other axes to the main
controller, and computes what the C computes.
"""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from barbalat import InputError, KnownParameters, Mrac, ParameterBox, Sampled
from barbalat.exports import export_controller
from barbalat.plants import Labels, Shell
from barbalat.signals import Sine
from export.examples import SIMULATION, STATE, T
from export.targets import ISO, needs_gxx
from export.test_bit_identical import EXAMPLES
from export.test_shell import surrounded

INTERFACES = Path(__file__).parent / "ardupilot"
VEHICLE = """\
int main()
{
    AC_CustomControl frontend;
    AP_AHRS_View view{{{0.1f, 0.2f, 0.3f}}, {0.01f, 0.02f, 0.03f}}, *ahrs = &view;
    AC_AttitudeControl attitude{{{0.0f, 0.25f, 0.0f}}, {0.0f, 0.0f, 0.0f}}, *control = &attitude;
    AP_MotorsMulticopter made{}, *motors = &made;
"""
"""The beginning of a program's main: a frontend, and the vehicle's objects for the backend."""
MAIN = (
    """\
#include "AC_CustomControl_Pitch.h"
#define CHECK(x) if (!(x)) { std::printf("%%s\\n", #x); return 1; }

struct Open : AC_CustomControl_Pitch {
    using AC_CustomControl_Pitch::AC_CustomControl_Pitch;
    void set(int axis, int fade, float scale) { _axis.value = int8_t(axis); _fade.value = int16_t(fade); _scale.value = scale; }
};

"""
    + VEHICLE
    + """\
    made.state = AP_Motors::SpoolState::GROUND_IDLE;
    made.roll = 0.5f; made.pitch = 0.125f; made.yaw = -0.5f;
    Open backend(frontend, ahrs, control, motors, PITCH_SAMPLE_TIME);
    backend.set(1, 100, 2.0f);
    Vector3f out = backend.update();
    CHECK(out.x == 0.5f && out.y == 0.125f && out.z == -0.5f)  /* the ground is the main controller's */
    made.state = AP_Motors::SpoolState::THROTTLE_UNLIMITED;
    out = backend.update();
    CHECK(out.x == 0.5f && std::fabs(out.y - 0.125f) < 1e-5f && out.z == -0.5f)  /* engaged without a bump, one axis alone */
    backend.set(1, 0, 2.0f);
    backend.reset();
    static pitch_controller c;
    pitch_input in;
    pitch_output expected;
    const float x[PITCH_MEASURED] = {0.25f - wrap_PI(0.25f - 0.2f)%s}, u_now[1] = {0.25f};
    pitch_init(&c);
    CHECK(pitch_start(&c, %su_now, 0, 0) == PITCH_OK)
    for (int k = 0; k < 50; ++k) {
        for (int i = 0; i < PITCH_MEASURED; ++i) { in.%s[i] = x[i]; }
        in.sample_time = PITCH_SAMPLE_TIME; in.r[0] = 0.25f; in.freeze = 0;
        CHECK(pitch_step(&c, &in, &expected) == PITCH_OK)
        out = backend.update();
        CHECK(out.y == expected.u_limited[0] / 2.0f)
    }
    CHECK(AP::logger().lines == 6 * (1 + INNER))
    backend.set(0, 100, 2.0f);
    backend.reset();
    out = backend.update();
    CHECK(std::fabs(out.x - 0.5f) < 1e-5f && out.y == 0.125f)  /* the axis may be another at the next engagement */
    made.state = AP_Motors::SpoolState::SHUT_DOWN;
    CHECK(backend.update().x == 0.5f)  /* landed while engaged */
    return 0;
}
"""
)


def backend(beginning, folder, **given):
    found = next(name for name in EXAMPLES if name.startswith(beginning))
    return export_controller(*EXAMPLES[found], SIMULATION, out=folder, target="ardupilot", name="pitch", **given)


@needs_gxx
@pytest.mark.parametrize(
    ("beginning", "places"),
    [("Mrac-state-euler", (", 0.02f", "x, ", "x")), ("MracOutput-output-euler", ("", "", "y"))],
)
@pytest.mark.short(kept=lambda beginning, places: beginning.startswith("Mrac-"))
def test_the_backend_against_the_published_interfaces(beginning, places, tmp_path) -> None:
    backend(beginning, tmp_path)
    assert "`ATC_RAT_PIT_FF`" in (tmp_path / "ARDUPILOT.md").read_text()  # which ArduPilot would add to the returned value
    inner = (tmp_path / "AC_CustomControl_Pitch.cpp").read_text().count('Write("BBI')
    assert inner
    compile_and_run(MAIN.replace("INNER", str(inner)) % places, tmp_path)


@needs_gxx
def test_what_is_measured_has_the_units_of_the_cases_labels(tmp_path) -> None:
    problem, controller = EXAMPLES[next(name for name in EXAMPLES if name.startswith("Mrac-state-euler"))]
    labelled = replace(problem, labels=Labels(names=("pitch", "pitch rate"), units=("deg", "deg/s")))
    export_controller(labelled, controller, SIMULATION, out=tmp_path, target="ardupilot", name="pitch")
    inner = (tmp_path / "AC_CustomControl_Pitch.cpp").read_text().count('Write("BBI')
    text = MAIN.replace("INNER", str(inner)) % (", 0.02f * 57.2957795f", "x, ", "x")
    text = text.replace("{0.25f - wrap_PI(0.25f - 0.2f)", "{(0.25f - wrap_PI(0.25f - 0.2f)) * 57.2957795f")
    compile_and_run(text.replace("in.r[0] = 0.25f;", "in.r[0] = 0.25f * 57.2957795f;"), tmp_path)
    assert "in the case's units (deg and deg/s)" in (tmp_path / "ARDUPILOT.md").read_text()
    heights = replace(problem, labels=Labels(names=("altitude", "climb"), units=("m", "m/s")))
    with pytest.raises(InputError, match=r"passes rad or deg and then rad/s or deg/s: got labels.units = \['m', 'm/s'\]"):
        export_controller(heights, controller, SIMULATION, out=tmp_path / "no", target="ardupilot", name="pitch")


SOUTH = (
    """\
#include "AC_CustomControl_Pitch.h"
#define CHECK(x) if (!(x)) { std::printf("%s at sample %d\\n", #x, k); return 1; }

struct Open : AC_CustomControl_Pitch {
    using AC_CustomControl_Pitch::AC_CustomControl_Pitch;
    void set(int axis, int fade) { _axis.value = int8_t(axis); _fade.value = int16_t(fade); }
    const pitch_controller &inside() const { return _controller; }
};

"""
    + VEHICLE
    + """\
    made.state = AP_Motors::SpoolState::THROTTLE_UNLIMITED;
    Open backend(frontend, ahrs, control, motors, PITCH_SAMPLE_TIME);
    backend.set(2, 100);
    static pitch_controller c;
    pitch_input in;
    pitch_output expected;
    float command = 0.0f, before;
    int k = 0;
    for (; k < 7500; ++k) { /* nearly three turns to the right, and back; twice a sample without a number */
        const float rate = k < 4500 ? 0.4f : -0.6f, angle = command - 0.1f * rate;
        attitude.target.angles.z = k == 2000 ? NAN : wrap_PI(command);
        view.attitude.angles.z = k == 5000 ? NAN : wrap_PI(angle);
        view.gyro.z = rate;
        if (k == 0) {
            const float x[2] = {angle, rate}, u_now[1] = {0.0f};
            pitch_init(&c);
            CHECK(pitch_start(&c, x, u_now, 100, 0) == PITCH_OK)
        }
        in.x[0] = k == 2000 || k == 5000 ? NAN : angle;
        in.x[1] = rate;
        in.r[0] = k == 2000 ? NAN : command;
        in.sample_time = PITCH_SAMPLE_TIME;
        in.freeze = 0;
        pitch_step(&c, &in, &expected);
        CHECK(std::fabs(backend.update().z - expected.u_limited[0]) < 1e-3f)
        CHECK(std::fabs(backend.inside().last_u[0] - expected.u[0]) < 1e-3f)
        CHECK(std::fabs(backend.inside().theta_hat[0] - expected.theta_hat[0]) < 1e-3f)
        command += rate * PITCH_SAMPLE_TIME;
    }
    attitude.target.angles.z = 0.0f;
    view.gyro.z = 0.0f;
    for (int turned = 0; turned == 0; ++k) { /* the angle falls behind by half a turn, from where the other way is shorter */
        view.attitude.angles.z = wrap_PI(view.attitude.angles.z + 0.02f);
        before = backend.inside().held_measured[0];
        const float u = backend.inside().last_u[0], learnt = backend.inside().theta_hat[0];
        const float out = backend.update().z;
        if (std::fabs(backend.inside().held_measured[0] - before) > 1.0f) {
            turned = 1;
            CHECK(std::fabs(out - u) < 1e-4f && std::fabs(u) < 1.0f)
            CHECK(std::fabs(backend.inside().theta_hat[0] - learnt) < 1e-6f && std::fabs(learnt) > 0.01f)
            CHECK(backend.inside().held_measured[0] < -3.0f && backend.inside().x_hat[0] < -3.0f)
        }
    }
    return 0;
}
"""
)


@needs_gxx
@pytest.mark.dear
def test_a_heading_passes_south_without_a_jump(tmp_path) -> None:
    """The tolerance 1e-3 is for angles of up to 18 rad that are wrapped and unwrapped in 32 bits, with 2e-6 at each of 7500
    samples and a gain of 5."""
    slight = replace(STATE, uncertainty=ParameterBox(lower=[-0.1, -0.1], upper=[0.1, 0.1]))
    slight = replace(slight, plant=replace(STATE.plant, theta=[0.05, -0.05]))
    export_controller(
        slight, Sampled(controller=Mrac(gamma=5.0), sample_time=T), SIMULATION, out=tmp_path, target="ardupilot", name="pitch"
    )
    compile_and_run(SOUTH, tmp_path)


SET = (
    """\
#include "AC_CustomControl_Pitch.h"
#define CHECK(x) if (!(x)) { std::printf("%s\\n", #x); return 1; }

struct Open : AC_CustomControl_Pitch {
    using AC_CustomControl_Pitch::AC_CustomControl_Pitch;
    void set(int which, float value, int fade) { _parameter[which].value = value; _fade.value = int16_t(fade); }
    float kept(int which) const { return _controller.parameter[which]; }
};

"""
    + VEHICLE
    + """\
    made.state = AP_Motors::SpoolState::THROTTLE_UNLIMITED;
    made.pitch = 0.125f;
    Open backend(frontend, ahrs, control, motors, PITCH_SAMPLE_TIME);
    backend.set(PITCH_SET_GAMMA, 7.0f, 0);
    backend.update();
    CHECK(backend.kept(PITCH_SET_GAMMA) == 7.0f)  /* what was stored acts from the first update on */
    const float before = backend.update().y;
    backend.set(PITCH_SET_GAMMA, 9.0f, 1000);
    CHECK(std::fabs(backend.update().y - before) < 1e-5f && backend.kept(PITCH_SET_GAMMA) == 9.0f)  /* without a bump */
    backend.set(PITCH_SET_GAMMA, -5.0f, 0);
    for (int k = 0; k < 5; ++k) { backend.update(); }
    CHECK(backend.kept(PITCH_SET_GAMMA) == 9.0f)
    backend.set(PITCH_SET_GAMMA, NAN, 0);
    for (int k = 0; k < 5; ++k) { backend.update(); }
    CHECK(backend.kept(PITCH_SET_GAMMA) == 9.0f)
    const float low = backend.kept(PITCH_SET_UNCERTAINTY_LOWER_0), high = backend.kept(PITCH_SET_UNCERTAINTY_UPPER_0);
    backend.set(PITCH_SET_UNCERTAINTY_LOWER_0, high + 1.0f, 0);
    backend.update();
    CHECK(backend.kept(PITCH_SET_UNCERTAINTY_LOWER_0) == low)
    backend.set(PITCH_SET_UNCERTAINTY_UPPER_0, high + 2.0f, 0);
    backend.update(); backend.update();
    CHECK(backend.kept(PITCH_SET_UNCERTAINTY_LOWER_0) == low)  /* the initial estimate would be outside the set */
    backend.set(PITCH_SET_THETA_HAT0_0, high + 1.5f, 0);
    for (int k = 0; k < 3; ++k) { backend.update(); }
    CHECK(backend.kept(PITCH_SET_UNCERTAINTY_LOWER_0) == high + 1.0f)  /* tried again, beside the other two */
    return 0;
}
"""
)


@needs_gxx
@pytest.mark.dear
def test_parameters_of_the_case_are_the_autopilots(tmp_path) -> None:
    """Each has a distinct name within ArduPilot's limit on length, and each rejection is reported once."""
    backend("Mrac-state-midpoint", tmp_path, parameters=True)
    text = (tmp_path / "AC_CustomControl_Pitch.cpp").read_text()
    names = re.findall(r'AP_GROUPINFO\("(\w+)", (\d+), \w+, _parameter\[', text)
    assert len({name for name, _ in names}) == len(names) > 2
    assert all(len(f"CC3_{name}") <= 16 for name, _ in names) and [int(i) for _, i in names] == list(range(5, 5 + len(names)))
    assert all(f"| `CC3_{name}` |" in (tmp_path / "ARDUPILOT.md").read_text() for name, _ in names)
    lines = [one.splitlines() for one in compile_and_run(SET, tmp_path).split("pitch: ")]
    assert [one[0] for one in lines if one].count("parameter 1 is rejected") == 2  # below 0, and NaN


def test_lines_of_the_log_fit_into_what_the_logger_takes(tmp_path) -> None:
    backend("Mrac-state-midpoint", tmp_path)
    text = (tmp_path / "AC_CustomControl_Pitch.cpp").read_text()
    lines = re.findall(r'Write\("(BBI\w)", "([^"]+)", "(\w+)"((?:, [^;]+)?)', text.replace("\n", ""))
    assert lines
    for name, labels, kinds, given in lines:
        assert len(name) == 4 and len(labels) < 64 and len(kinds) <= 16
        assert len(kinds) == len(labels.split(",")) == 1 + given.count("double(")
    header = (tmp_path / "pitch_controller.h").read_text()
    members = re.findall(r"^ +float (\w+);", header[: header.index("} pitch_log")].rpartition("typedef struct")[2], re.MULTILINE)
    assert [one for _, labels, _, _ in lines for one in labels.split(",")[1:]] == members


TIMED = (
    """\
#include "AC_CustomControl_Pitch.h"
#define CHECK(x) if (!(x)) { std::printf("%s\\n", #x); return 1; }

"""
    + VEHICLE
    + """\
    made.state = AP_Motors::SpoolState::THROTTLE_UNLIMITED;
    made.pitch = 0.125f;
    AC_CustomControl_Pitch backend(frontend, ahrs, control, motors, PITCH_SAMPLE_TIME);
    const uint64_t period = uint64_t(PITCH_SAMPLE_TIME * 1e6f + 0.5f);
    for (int k = 0; k < 10; ++k) {
        CHECK(backend.update().y != 0.0f)
        AP_HAL::micros64() += period;
    }
    AP_HAL::micros64() += period / 2;
    CHECK(backend.update().y == 0.125f)  /* one and a half periods: the main controller takes over at once */
    for (int k = 0; k < 3; ++k) {
        AP_HAL::micros64() += period;
        CHECK(std::fabs(backend.update().y - 0.125f) < 0.01f)  /* and hands back without a bump */
    }
    made.pitch = -0.5f;
    attitude.target.angles.y = 1.0f; /* a command beyond the shell's range */
    backend.reset();
    CHECK(backend.update().y == -0.5f)
    AP_HAL::micros64() += period;
    made.pitch = -0.25f;
    CHECK(backend.update().y == -0.25f)  /* is no start: the main controller acts */
    AP_HAL::micros64() += period;
    attitude.target.angles.y = 0.25f;
    CHECK(std::fabs(backend.update().y + 0.25f) < 0.01f)
    backend.reset();
    AP_HAL::micros64() += 100 * period + period / 2;
    CHECK(backend.update().y != 0.0f)  /* what lies before a start is no time between two updates */
    return 0;
}
"""
)


@needs_gxx
def test_a_shells_timer_is_given_the_time_between_two_updates(tmp_path) -> None:
    problem, controller = surrounded(
        "Mrac-state-euler", Shell(range={"command": [-0.5, 0.5]}, longest_outage=0.05, fallback="zero", jitter=0.1)
    )
    problem = replace(problem, reference=Sine(amplitude=0.4, frequency=0.7))
    export_controller(problem, controller, SIMULATION, out=tmp_path, target="ardupilot", name="pitch")
    told = compile_and_run(TIMED, tmp_path)
    assert told.count("the main controller acts") == 1
    assert "takes over, whatever `fallback`" in (tmp_path / "ARDUPILOT.md").read_text()


STUCK = (
    """\
#include "AC_CustomControl_Pitch.h"
#define CHECK(x) if (!(x)) { std::printf("%s at sample %d\\n", #x, k); return 1; }

struct Open : AC_CustomControl_Pitch {
    using AC_CustomControl_Pitch::AC_CustomControl_Pitch;
    void set(int fade) { _axis.value = 1; _fade.value = int16_t(fade); }
    const pitch_controller &inside() const { return _controller; }
};

"""
    + VEHICLE
    + """\
    made.state = AP_Motors::SpoolState::THROTTLE_UNLIMITED;
    Open backend(frontend, ahrs, control, motors, PITCH_SAMPLE_TIME);
    backend.set(100);
    static pitch_controller alone; /* the C without ArduPilot */
    pitch_input in;
    pitch_output result;
    const uint64_t period = uint64_t(PITCH_SAMPLE_TIME * 1e6f + 0.5f);
    int handed = 0;
    float learnt = 0.0f, before = 0.0f;
    for (int k = 0; k < 1000; ++k) {
        AP_HAL::micros64() += period;
        if (k < 100 || (k >= 400 && k < 700)) { /* else the sensor is stuck */
            view.attitude.angles.y = 0.2f + 0.05f * std::sin(0.1f * float(k));
            view.gyro.y = 0.3f * std::cos(0.1f * float(k));
        }
        made.pitch = 0.25f + 0.05f * std::sin(0.05f * float(k)); /* the main controller's */
        in.x[0] = 0.25f - wrap_PI(0.25f - view.attitude.angles.y);
        in.x[PITCH_MEASURED - 1] = PITCH_MEASURED == 2 ? view.gyro.y : in.x[0];
        in.sample_time = PITCH_SAMPLE_TIME; in.r[0] = 0.25f; in.freeze = 0;
        if (k == 0) {
            const float u_now[1] = {made.pitch};
            pitch_init(&alone);
            CHECK(pitch_start(&alone, START u_now, 100, 0) == PITCH_OK)
        }
        const unsigned status = pitch_step(&alone, &in, &result);
        const float out = backend.update().y;
        const bool acts = out == made.pitch;
        if (k < 400) { CHECK(acts == ((status & PITCH_FALLBACK) != 0u || k == 0)) }
        if (k >= 1 && acts) {
            ++handed;
            learnt = handed == 1 ? backend.inside().theta_hat[0] : learnt;
            CHECK(backend.inside().theta_hat[0] == learnt || k >= 700)
        }
        if (k == 400) { /* the value changes: the controller starts at this sample, from the main controller's output */
            CHECK(handed > 270 && std::fabs(out - made.pitch) < 1e-5f)
            CHECK(backend.inside().theta_hat[0] == learnt && learnt != 0.0f && backend.inside().fade_left == 99)
        }
        if (k > 400 && k < 700) { /* and acts without another start, until its fade ends */
            CHECK(!acts && std::fabs(out - before) < 0.02f && backend.inside().fade_left == (k < 500 ? 499 - k : 0))
        }
        if (k >= 730) { CHECK(acts) } /* stuck again */
        before = out;
    }
    return 0;
}
"""
)


@needs_gxx
@pytest.mark.parametrize(
    ("beginning", "jitter", "start"), [("Mrac-state-euler", 0.1, "in.x,"), ("MracOutput-output-euler", 0.0, "")]
)
@pytest.mark.short(kept=lambda beginning, jitter, start: jitter > 0)
def test_a_stuck_sensor_leaves_the_axis_to_the_main_controller_until_its_value_changes(
    beginning, jitter, start, tmp_path
) -> None:
    """A new start after each outage would accept the stuck value again."""
    shell = Shell(stuck={"x_1": 0.2}, range={"command": [-2.0, 2.0]}, longest_outage=0.05, fallback="hold", fade=1.0)
    problem, controller = surrounded(beginning, replace(shell, jitter=jitter) if jitter else shell)
    export_controller(problem, controller, SIMULATION, out=tmp_path, target="ardupilot", name="pitch")
    main = STUCK.replace("START", start)
    told = compile_and_run(main if start else main.replace("in.x[", "in.y["), tmp_path)
    assert told.count("the main controller acts") == 1


@pytest.mark.parametrize(
    ("name", "labels", "axis"),
    [
        ("roll", ("pitch", "pitch rate"), 0),
        ("inner_yaw", (), 2),
        ("l1", ("phi", "roll rate"), 0),
        ("l1", ("roll", "yaw"), 1),
        ("scroll", (), 1),
    ],
)
def test_the_axis_is_that_of_the_name_or_the_labels(name, labels, axis, tmp_path) -> None:
    known = Sampled(controller=KnownParameters(theta=[1.0, -0.5]), sample_time=T, discretization="euler")
    labelled = replace(STATE, labels=Labels(names=labels))
    out = export_controller(labelled, known, SIMULATION, out=tmp_path, target="ardupilot", name=name)
    (source,) = out.glob("AC_CustomControl_*.cpp")
    assert re.search(rf'AP_GROUPINFO\("AXIS", 1, \w+, _axis, {axis}\)', source.read_text())


def compile_and_run(main, tmp_path) -> str:
    (tmp_path / "main.cpp").write_text(main)
    for empty in ("AC_CustomControl_config.h", "AP_Logger/AP_Logger.h", "GCS_MAVLink/GCS.h"):
        (tmp_path / empty).parent.mkdir(exist_ok=True)
        (tmp_path / empty).write_text('#include "AC_CustomControl_Backend.h"\n')
    subprocess.run(["gcc", *ISO, "-O1", "-c", "pitch_controller.c"], cwd=tmp_path, check=True, timeout=60)
    strict = ["-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-Wno-array-bounds"]
    command = ["g++", "-std=gnu++17", "-O1", *strict, f"-I{INTERFACES}", "-I.", "AC_CustomControl_Pitch.cpp", "main.cpp"]
    subprocess.run([*command, "pitch_controller.o", "-o", "flown", "-lm"], cwd=tmp_path, check=True, timeout=60)
    done = subprocess.run([tmp_path / "flown"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.parametrize(
    ("beginning", "given", "message"),
    [
        ("Mrac-several-euler", {}, "needs a single-axis controller .* got 2 inputs, 2 commands and 2 measurements"),
        ("Mrac-state-euler", {"closed_loop": True}, "exports only the controller"),
    ],
)
def test_what_is_not_one_axis_is_refused(beginning, given, message, tmp_path) -> None:
    with pytest.raises(InputError, match=message):
        backend(beginning, tmp_path, **given)
