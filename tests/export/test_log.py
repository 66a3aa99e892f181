"""The struct that is logged: equal bit for bit to the columns of the simulation's results, with the case's names and units."""

from __future__ import annotations

import ctypes
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from barbalat import simulate
from barbalat.export.contents import Contents
from barbalat.export.log import logged
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import Labels
from barbalat.run.engine.simulate import recorded
from export.examples import SIMULATION, T, sampled_examples
from export.targets import ISO, STRICT, needs_gcc, same_bits, write

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}
KINDS = [
    next(name for name in EXAMPLES if name.startswith(beginning))
    for beginning in (
        "Mrac-state-midpoint", "DirectMrac-state", "L1Adaptive-several", "RobustMrac-free-midpoint", "MracOutput-third",
        "L1Output-output", "LinearOutput-output", "NetworkMrac", "L1PiecewiseConstant-several", "MracClosedLoop",
    )
]  # fmt: skip
SHORT = replace(SIMULATION, t_end=3.0)
OWN = re.compile(r"measured_|u_limited|x_m_|e_\d|[xy]_tilde")
"""The case, with the sensor's noise, the controller's own model and its limits."""
DRIVER = """\
#include "controller.h"
#include <string.h>

void drive(int samples, const double *measured, const double *commands, double *shown, double *own)
{{
    static {name}_controller c;
    {name}_init(&c);
    for (int k = 0; k < samples; ++k) {{
        {name}_input in = {{0}};
        {name}_output out;
        {name}_log log;
        in.sample_time = {macro}_SAMPLE_TIME;
        for (int i = 0; i < {macro}_MEASURED; ++i) in.{measured}[i] = measured[k * {macro}_MEASURED + i];
        for (int i = 0; i < {macro}_COMMANDS; ++i) in.r[i] = commands[k * {macro}_COMMANDS + i];
        (void){name}_step(&c, &in, &out);
        {name}_read_log(&c, &log);
        memcpy(shown + k * {macro}_LOG_SIZE, &log, sizeof log);
        memcpy(own + k * {macro}_INPUTS, out.u_limited, sizeof out.u_limited);
    }}
}}
"""


def driven(printed: Printed, folder, measured, commands) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The logged numbers after each sample by their names in C, and the output within the limits."""
    names = {"name": printed.name, "macro": printed.macro, "measured": printed.measured}
    write(folder, {"controller.h": header(printed), "controller.c": source(printed), "driver.c": DRIVER.format(**names)})
    command = ["gcc", *ISO, *STRICT, "-shared", "-fPIC", "controller.c", "driver.c", "-o", "driver.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    shown = np.zeros((len(measured), len(logged(printed))))
    limited = np.zeros((len(measured), printed.contents.sizes[2]))
    given = [np.ascontiguousarray(part, dtype=float) for part in (measured, commands)]
    arrays = (ctypes.c_void_p(array.ctypes.data) for array in (*given, shown, limited))
    ctypes.CDLL(str(folder / "driver.so")).drive(ctypes.c_int(len(measured)), *arrays)
    return {one.name: shown[:, i] for i, one in enumerate(logged(printed))}, limited


@needs_gcc
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.short(kept=lambda name: name in KINDS[:6:2])
def test_the_log_has_the_simulations_columns(name, tmp_path) -> None:
    """Every column of the controller's own state, the estimates and u are equal bit for bit. The values of a sample remain until
    the next one. At the sample's instant a result evaluates them again with fused products, so the last bits differ.
    """
    problem, controller = EXAMPLES[name]
    printed = Printed(Contents.of(problem, controller, SHORT, DOUBLE))
    run = recorded(problem, controller, SHORT, 250)
    found, limited = driven(printed, tmp_path, run.measured, run.commands)
    (result,) = simulate(problem, [controller], SHORT).values()
    columns, at = result.columns(), np.searchsorted(result.t, T * np.arange(250) + T / 4)
    compared = [name for name in found if not OWN.match(name)]
    assert {"u", "r"} <= set(compared) or {"u_1", "r_1"} <= set(compared)
    kept = {f"controller.{part.path}" for part in printed.contents.loop.parts} & {p.path for p in printed.contents.layout.parts}
    assert len(compared) >= 2 + len(kept)
    for one in compared:
        held = columns[one][at - 1] if one.startswith("r") else columns[one][at]  # the command continues between samples
        assert same_bits(found[one], held), one
    measured = np.stack([found[name] for name in found if name.startswith("measured_")], axis=1)
    assert same_bits(measured, run.measured)
    assert same_bits(np.stack([found[name] for name in found if name.startswith("u_limited")], axis=1), limited)


@needs_gcc
def test_errors_are_against_the_controllers_own_model_and_predictor(tmp_path) -> None:
    for name in ("DirectMrac-state", "Mrac-state-midpoint", "MracOutput-output"):
        problem, controller = EXAMPLES[next(one for one in EXAMPLES if one.startswith(name))]
        printed = Printed(Contents.of(problem, controller, SHORT, DOUBLE))
        run = recorded(problem, controller, SHORT, 100)
        found, _ = driven(printed, tmp_path / name, run.measured, run.commands)
        for error, of in (("e", "x_m"), ("x_tilde", "x_hat")):
            for i in range(run.measured.shape[1]):
                if f"{error}_{i + 1}" in found and problem.feedback == "state":
                    difference = run.measured[:, i] - found[f"{of}_{i + 1}"]
                    assert np.ptp(difference) > 0 and same_bits(found[f"{error}_{i + 1}"], difference)
                elif f"{of}_{i + 1}" in found:
                    assert f"{error}_{i + 1}" in found


def test_the_case_names_and_its_units_head_the_log() -> None:
    problem, controller = EXAMPLES[KINDS[0]]
    labels = Labels(names=("alpha", "q"), units=("rad", "rad/s"), input_units=("deg",))
    text = header(Printed(Contents.of(replace(problem, labels=labels), controller, SHORT, DOUBLE)))
    (labelled,) = re.findall(r"LOG_LABELS \{([^}]*)\}", text)
    wanted = ["alpha [rad]", "q [rad/s]", "r", "u [deg]", "u_limited [deg]", "x_tilde of alpha [rad]", "x_tilde of q [rad/s]"]
    assert re.findall(r'"([^"]*)"', labelled)[:7] == wanted
    assert "double measured_1; /* alpha [rad]: last good measurement" in text


@pytest.mark.parametrize("beginning", ["Mrac-state-midpoint", "L1Adaptive-several"])
def test_rows_between_two_samples_have_what_the_law_keeps(beginning) -> None:
    problem, controller = EXAMPLES[next(name for name in EXAMPLES if name.startswith(beginning))]
    run, kept = simulate(problem, [controller], SHORT)[controller.name], recorded(problem, controller, SHORT, 1000)
    own, places = kept.states.shape[1], kept.loop.unpack(np.arange(kept.loop.size))
    u = np.reshape(places.held.u, -1) - kept.loop.size + own
    (estimates,) = (part for part in kept.loop.parts if part.role.kind == "estimates")
    theta_hat = np.reshape(getattr(places.controller, estimates.path), -1) - kept.loop.size + own
    assert len(run.t) == 2 * len(kept.states) + 1  # two steps in each sample
    for column, rows in ((run.u.reshape(len(run.t), -1), u), (run.theta_hat, theta_hat)):
        assert same_bits(column[1::2], kept.states[:, rows])
