"""The shell of an export that is engaged in flight, called at wrong times or given a corrupted memory, as happened in a user's
test harness."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, simulate
from barbalat.export.c99.files import made_of
from barbalat.export.in_the_loop import simulate_export
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import Dropout, Labels, LqiBaseline, PlantInput, Shell
from barbalat.signals import Constant, Sine
from export.targets import ISO, STRICT, needs_gcc, write

T, LONGEST, FADE = 0.005, 8, 20
OK, WRONG_TIME, LOST, STATE_REFUSED, COMMAND_LOST, FALLBACK = 0, 1, 2, 4, 16, 256
PROBLEM = Problem(
    Plant(A=[[0.0, 1.0], [2.0, -0.5]], b=[0.0, 8.0], A_m=[[0.0, 1.0], [-16.0, -6.4]], input=PlantInput(saturation=[-1.0, 1.0])),
    ReferenceModel(k_0=2.0),
    Sine(amplitude=0.25, frequency=1.2),
    uncertainty=ParameterBox(lower=[-0.5, -0.5], upper=[4.0, 2.0]),
    labels=Labels(names=["pitch", "q"]),
    shell=Shell(
        range={"pitch": [-1.0, 1.0], "q": [-6.0, 6.0], "command": [-0.5, 0.5]},
        rate={"pitch": 12.0, "q": 150.0, "command": 110.0},
        jitter=0.2,
        longest_outage=LONGEST * T,
        fallback="fade",
        fade=FADE * T,
    ),
)
ON_PLANT = Plant(
    A=[[0.0, 1.0], [2.0, -0.5]],
    b=[0.0, 8.0],
    baseline=LqiBaseline(Q=[4.0, 0.3, 60.0], R=1.0, output=[1.0, 0.0]),
    input=PlantInput(saturation=[-1.0, 1.0]),
)
ON_BASELINE = replace(
    PROBLEM,
    plant=ON_PLANT,
    reference_model=ReferenceModel(),
    uncertainty=ON_PLANT.baseline.around_nominal(ParameterBox(lower=[-0.5, -0.3], upper=[1.0, 0.5])),
    shell=replace(PROBLEM.shell, fallback="baseline"),
)
SCHEMES = {
    "MRAC": Sampled(Mrac(gamma=30.0), T),
    "L1": Sampled(L1Adaptive(gamma=3000.0, filter=input_filter(kappa=0.03)), T),
}
RUN = Simulation(t_end=1.0, dt=T / 5)
MAIN = """\
#include "controller.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

int main(void)
{{
    static {n}_controller c;
    {n}_input in;
    {n}_output out;
    const double x[][2] = {{ {x} }}, r[] = {{ {r} }}, time[] = {{ {time} }};
    int k;
    {n}_init(&c);
    {first}
    for (k = 0; k < {count}; ++k) {{
        memset(&in, 0, sizeof in);
        in.sample_time = time[k] * {M}_SAMPLE_TIME;
        in.x[0] = x[k][0];
        in.x[1] = x[k][1];
        in.r[0] = r[k];
        {poked}
        (void){n}_step(&c, &in, &out);
        printf("%u %.17g %.17g\\n", out.status, out.u[0], out.u_limited[0]);
    }}
    return 0;
}}
"""
pytestmark = needs_gcc


def flown(folder, x, *, r=0.1, time=1.0, engaged=None, poked="", problem=PROBLEM, scheme="MRAC", parameters=False):
    """Status, u and u_limited of each sample. ``engaged`` is the control at a start from the pitch 0.1."""
    printed = Printed(made_of(problem, SCHEMES[scheme], RUN, DOUBLE, parameters=parameters))
    names, count = {"n": printed.name, "M": printed.macro}, len(x)
    first = (
        ""
        if engaged is None
        else f"{{ const double x0[] = {{ 0.1, 0.0 }}, u[] = {{ {engaged} }}; "
        + (f"if ({printed.name}_start(&c, x0, u, 40L, 0) != 0u) {{ return 1; }} }}")
    )
    rows = ", ".join(f"{{ {', '.join(_c(one) for one in row)} }}" for row in x)
    r, time = (np.broadcast_to(one, count) for one in (r, time))
    text = MAIN.format(
        **names, x=rows, r=", ".join(map(_c, r)), time=", ".join(map(_c, time)), count=count, first=first,
        poked=poked.format(**names),
    )  # fmt: skip
    write(folder, {"controller.h": header(printed), "controller.c": source(printed), "main.c": text})
    subprocess.run(["gcc", *ISO, *STRICT, "main.c", "controller.c", "-o", "main", "-lm"], cwd=folder, check=True, timeout=60)
    done = subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True, timeout=60)
    status, u, limited = zip(*(line.split() for line in done.stdout.splitlines()), strict=True)
    return np.array(status, dtype=int), np.array(u, dtype=float), np.array(limited, dtype=float)


def _c(value: float) -> str:
    if not np.isfinite(value):
        return "NAN" if np.isnan(value) else f"{'-' if value < 0 else ''}INFINITY"
    return repr(float(value))


def measured(count: int) -> np.ndarray:
    """A pitch that moves a little."""
    return np.column_stack([0.1 + 1e-4 * np.arange(count), 0.02 * np.ones(count)])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_sensor_that_is_lost_after_a_start_ends_in_the_fallback(scheme, tmp_path) -> None:
    x = measured(40)
    x[:35] = np.nan
    status, u, _ = flown(tmp_path, x, engaged=0.9, scheme=scheme)
    assert (status[:LONGEST] == LOST).all() and (u[:LONGEST] == 0.9).all()
    assert (status[LONGEST:35] == LOST | FALLBACK).all() and (status[35:] == OK).all()
    assert u[LONGEST] < 0.9 and (np.diff(u[LONGEST : LONGEST + FADE]) < 0).all() and u[34] == 0
    assert abs(u[35]) < 1e-12  # it returns from there


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_bad_command_at_a_start_does_not_hold_up_the_measurement(scheme, tmp_path) -> None:
    status, u, _ = flown(tmp_path, measured(60), r=0.6, engaged=0.9, scheme=scheme)
    told = (status == COMMAND_LOST).all()
    assert told and np.ptp(u) > 0.1
    _, zero, _ = flown(tmp_path, measured(60), r=0.0, engaged=0.9, scheme=scheme)
    assert np.array_equal(u, zero)  # the command that is held at the start


def test_wrong_times_after_a_start_end_in_the_fallback(tmp_path) -> None:
    status, u, _ = flown(tmp_path, measured(40), time=1.5, engaged=0.9)
    assert (status == WRONG_TIME | FALLBACK).all() and u[-1] == 0


def test_a_bad_state_without_a_measurement_ends_in_the_fallback(tmp_path) -> None:
    x = measured(60)
    x[20:50] = np.nan
    poked = "if (k == 20) { c.x_hat[0] = NAN; c.last_u[0] = 0.5; }".replace("{", "{{").replace("}", "}}")
    status, u, _ = flown(tmp_path, x, poked=poked)
    held = slice(20, 20 + LONGEST)
    assert (status[held] == STATE_REFUSED).all() and (u[held] == 0.5).all()
    assert (status[20 + LONGEST : 50] == STATE_REFUSED | FALLBACK).all() and u[49] == 0
    assert status[50] == STATE_REFUSED and (status[51:] == OK).all()


def test_at_wrong_times_the_baseline_has_the_present_measurement(tmp_path) -> None:
    """In the loop with the plant an unstable vehicle would be lost with a held measurement."""
    x = measured(60)
    x[:, 0] += np.where(np.arange(60) < 30, 0.0, 0.05)
    status, u, _ = flown(tmp_path, x, time=np.where(np.arange(60) < 5, 1.0, 1.5), problem=ON_BASELINE)
    assert (status[5:] == WRONG_TIME | FALLBACK).all()
    K = ON_BASELINE.fixed.K[0]
    assert u[58] - u[57] == pytest.approx(-K[0] * 1e-4)
    assert u[29:31] @ [-1, 1] == pytest.approx(-K[0] * (0.05 + 1e-4), rel=1e-6)


@pytest.mark.parametrize("problem", [replace(PROBLEM, shell=replace(PROBLEM.shell, fallback="hold")), PROBLEM, ON_BASELINE])
@pytest.mark.parametrize("every", [2, 3])
def test_wrong_times_again_and_again_do_not_hold_the_control_still(problem, every, tmp_path) -> None:
    """Every good call has the same result as without the wrong calls. No fade begins at a good call, because the next wrong time
    would restart the fade."""
    x, time = measured(60), np.ones(60)
    r, time[21::every] = 0.1 + 0.05 * np.sin(0.2 * np.arange(60)), 1.3
    status, u, _ = flown(tmp_path / "wrong", x, r=r, time=time, problem=problem)
    _, own, _ = flown(tmp_path / "right", x, r=r, problem=problem)
    wrong = time > 1
    assert (status[wrong] == WRONG_TIME | FALLBACK).all() and (status[~wrong] == OK).all()
    assert abs(u - own)[~wrong].max() < 0.3 * np.ptp(own[20:])  # a held control would differ by all of it


def test_wrong_times_do_not_end_the_fade_of_a_start(tmp_path) -> None:
    x, time = measured(60), np.ones(60)
    time[5:50:2] = 1.3
    for name, problem in (("fade", PROBLEM), ("baseline", ON_BASELINE)):
        _, u, _ = flown(tmp_path / name, x, time=time, engaged=0.9, problem=problem)
        good = u[time == 1]
        assert abs(np.diff(good)).max() < 0.1 and abs(good[-1] - good[0]) > 0.5, name


@pytest.mark.parametrize("time", [np.inf, 1e308, -np.inf, np.nan, 0.0])
def test_a_time_that_is_none_is_wrong(time, tmp_path) -> None:
    times = np.ones(30)
    times[20] = time
    status, _, _ = flown(tmp_path, measured(30), time=times)
    assert status[20] == WRONG_TIME | FALLBACK and (np.delete(status, 20) == OK).all()


def test_a_start_beyond_the_limits_begins_at_them(tmp_path) -> None:
    _, beyond, _ = flown(tmp_path / "beyond", measured(60), engaged=30.0)
    _, there, _ = flown(tmp_path / "there", measured(60), engaged=1.0)
    assert np.array_equal(beyond, there)


def test_a_bad_parameter_ends_in_the_fallback(tmp_path) -> None:
    poked = "if (k >= 20) {{{{ c.parameter[0] = NAN; }}}}"
    status, u, _ = flown(tmp_path, measured(60), poked=poked, parameters=True)
    assert (status[20 : 20 + LONGEST] == STATE_REFUSED).all() and (u[20 : 20 + LONGEST] == u[19]).all()
    assert (status[20 + LONGEST :] == STATE_REFUSED | FALLBACK).all() and u[-1] == 0


def test_a_wrong_time_does_not_open_the_rate(tmp_path) -> None:
    """The time is 1.5 T at the wrong call and T at the next ones. A value that changes by the rate of three samples is not
    accepted as a measurement, but the next values are."""
    x, time = measured(30), np.ones(30)
    time[20], x[21, 1] = 1.5, 0.02 + 3 * 150.0 * T
    status, _, _ = flown(tmp_path, x, time=time)
    assert status[20] == WRONG_TIME | FALLBACK and status[21] == LOST | FALLBACK and (status[22:] == OK).all()


def test_a_long_gap_between_two_calls_counts_for_the_rate_as_it_was(tmp_path) -> None:
    x, time = measured(30), np.ones(30)
    time[20], x[20:, 0] = 200.0, 0.9
    status, _, _ = flown(tmp_path, x, time=time)
    assert status[20] == WRONG_TIME | FALLBACK and (status[21:] == OK).all()


def test_the_start_is_the_last_good_measurement_of_the_first_sample(tmp_path) -> None:
    x = measured(30)
    x[0, 0] = -0.95
    status, _, _ = flown(tmp_path, x, engaged=0.2)
    assert status[0] == LOST and (status[1:] == OK).all()


@pytest.mark.parametrize("problem", [PROBLEM, ON_BASELINE], ids=["fade", "baseline"])
def test_a_fallback_begins_within_the_actuators_limits(problem, tmp_path) -> None:
    x = np.column_stack([np.full(40, -0.9), np.full(40, -5.0)])
    x[5:] = np.nan
    _, u, limited = flown(tmp_path, x, r=0.5, problem=problem)
    assert u[4] > 10 and limited[4] == 1
    acts = limited[5 + LONGEST : 5 + LONGEST + FADE]
    if problem is PROBLEM:
        assert acts == pytest.approx(1 - np.arange(1, FADE + 1) / FADE)
    else:  # its own control is beyond the limit by as much here, and the difference fades out
        assert u[5 + LONGEST] == pytest.approx(1.0) and u[5 + LONGEST + FADE] > 10


@pytest.mark.parametrize("poked", ["c.held_r[0] = 65536.0", "c.held_measured[0] = 65536.0"])
def test_a_corrupted_last_good_value_does_not_lock_out_the_good_ones(poked, tmp_path) -> None:
    status, _, _ = flown(tmp_path, measured(40), poked=f"if (k == 20) {{{{ {poked}; }}}}")
    assert (status[:20] == OK).all() and status[20] == STATE_REFUSED and (status[21:] == OK).all()


@pytest.mark.parametrize("fallback", ["fade", "baseline"])
def test_losses_before_the_first_sample_are_equal_in_the_loop(fallback, tmp_path) -> None:
    posed = PROBLEM if fallback == "fade" else ON_BASELINE
    lost = (Dropout(times=((0.0, 0.1),)), Dropout(channel="command", times=((0.0, 0.15),)))
    posed = replace(posed, faults=lost, reference=Constant(0.2))
    origin = simulate(posed, [SCHEMES["MRAC"]], RUN)["MRAC"]
    assert simulate_export(posed, SCHEMES["MRAC"], RUN).differs_from(origin) == ""
    assert not origin.u[origin.t < 0.09].any() and abs(origin.u[origin.t > 0.2]).max() > 0.1
