"""The baseline as the fallback after an outage: it acts without a bump, and the C is bit-identical."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    BaselineAlone,
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    TransferFunction,
    simulate,
)
from barbalat.export.in_the_loop import simulate_export
from barbalat.plants import Dropout, LqiBaseline, PidBaseline, Shell, StateBaseline
from barbalat.signals import Sine
from export.made import files
from export.targets import ISO, STRICT, needs_gcc, run_selftest, write

T, OUT, FADE = 0.01, 0.03, 0.1
BASELINES = {
    "lqi": LqiBaseline(Q=[1.0, 0.0, 20.0], R=1.0, output=[1.0, 0.0]),
    "pid": PidBaseline(k_p=3.0, k_i=2.0, k_d=1.0, T_f=0.05, output=[1.0, 0.0]),
    "state": StateBaseline(K=[4.0, 0.0], output=[1.0, 0.0]),
}
SCHEMES = {
    "mrac": Sampled(Mrac(gamma=20.0), T),
    "l1": Sampled(L1Adaptive(gamma=500.0, filter=TransferFunction([20.0], [1.0, 20.0])), T),
    "alone": Sampled(BaselineAlone(), T),
}
RUN = Simulation(t_end=3.0, dt=T / 5)


def problem(kind: str, fade: float = FADE) -> Problem:
    plant = Plant(A=[[-1.0, 1.0], [0.5, -1.0]], b=[0.0, 2.0], baseline=BASELINES[kind])
    departure = ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0])
    assert plant.baseline is not None
    return Problem(
        plant,
        ReferenceModel(),
        Sine(amplitude=1.0, frequency=2.0),
        uncertainty=plant.baseline.around_nominal(departure),
        shell=Shell(longest_outage=OUT, fallback="baseline", fade=fade),
        faults=(Dropout(times=((1.0, 2.0),)),),
    )


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", BASELINES)
def test_the_baseline_alone_acts_after_the_longest_outage(kind, scheme) -> None:
    posed = problem(kind)
    run = simulate(posed, [SCHEMES[scheme]], RUN)[SCHEMES[scheme].name]
    t = np.arange(round(RUN.t_end / T)) * T
    u = np.interp(t + T / 2, run.t, run.u.reshape(-1))  # if the control is held from each sample on
    k = int(np.searchsorted(t, 1.0 - 1e-9))
    missed = round(OUT / T)
    assert np.ptp(u[k - 1 : k + missed]) == 0  # held up to the longest outage
    fixed = posed.fixed
    slope = 2.0 * 1.0 * abs(float(fixed.k_r[0, 0])) * T  # [u] largest change of the baseline in a sample due to the command alone
    step = abs(u[k + missed] - u[k + missed - 1])
    assert step <= 1e-12 + slope  # no bump when the baseline takes over
    alone = np.diff(u[k + missed + round(FADE / T) + 1 : k + 100])
    # what remains is k_r r(t) and a constant, so the differences are the differences of a sine
    r = np.sin(2.0 * t)
    expected = fixed.k_r[0, 0] * np.diff(r[k + missed + round(FADE / T) + 1 : k + 100])
    assert np.abs(alone - expected).max() < 1e-12
    back = np.searchsorted(t, 2.0 - 1e-9)
    assert abs(u[back] - u[back - 1]) <= 1e-12 + slope  # and no bump at the return


@needs_gcc
@pytest.mark.parametrize("kind", BASELINES)
@pytest.mark.short(kept=lambda kind: kind == "state")
def test_the_self_test_of_a_32_bit_export_passes(tmp_path, kind) -> None:
    write(tmp_path, files(replace(problem(kind), faults=()), SCHEMES["mrac"], RUN, float32=True))
    told = run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O2")
    assert told.returncode == 0, told.stdout


@needs_gcc
@pytest.mark.parametrize(("kind", "scheme", "fade"), [("lqi", "mrac", FADE), ("pid", "l1", 0.0), ("state", "alone", FADE)])
@pytest.mark.short(kept=lambda kind, scheme, fade: scheme != "mrac")
@pytest.mark.dear
def test_the_c_is_the_simulation_in_every_bit(tmp_path, kind, scheme, fade) -> None:
    posed, controller = problem(kind, fade), SCHEMES[scheme]
    origin = simulate(posed, [controller], RUN)[controller.name]
    assert simulate_export(posed, controller, RUN).differs_from(origin) == ""
    write(tmp_path, files(replace(posed, faults=()), controller, RUN))
    told = run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O2")
    assert told.returncode == 0, told.stdout


DELETED = (
    "        fall_back(&before, c);",
    "    c->held_baseline[0] = before->held_baseline[0];",
    "        left = {M}_FADE;",
    "            c->bump[i] = c->last_u[i] - alone[i];",
    "        c->held_u[i] = alone[i];",
    "            c->held_u[i] = alone[i] + c->bump[i] * ((double)left / (double)c->fade);",
    "    c->fade_left = left > 0L ? left - 1L : 0L;",
    "        c->bump[i] = c->last_u[i];",
    "    c->fade = {M}_FADE;",
    "    c->fade_left = {M}_FADE;",
    "    c->matching = 1;",
    "            before.held_baseline[i] = c->held_baseline[i]; /* the baseline's state may be the cause */",
)
"""Lines of the fallback and of the return, without which the self-test must fail."""


@needs_gcc
@pytest.mark.dear
def test_the_self_test_finds_each_line_of_the_fallback_that_is_missing(tmp_path) -> None:
    posed = replace(problem("lqi"), faults=())
    made = files(posed, SCHEMES["mrac"], RUN)
    source, survived = made["controller.c"], []
    at = source.index("static void come_back(")
    for line in (f"\n{one}\n".replace("{M}", "MRAC") for one in DELETED):
        assert line in source[at:]
        write(tmp_path, made | {"controller.c": source[:at] + source[at:].replace(line, "\n;\n", 1)})
        if run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode != 1:
            survived.append(line)
    assert survived == []


CORRUPTED = """\
#include "controller.h"
#include <stdio.h>
#include <string.h>

/* Good samples, and before the 101st a corrupted number of the state: the statuses from there on. */
int main(void)
{
    static {name}_controller c;
    {name}_input in;
    {name}_output out;
    int k;
    {name}_init(&c);
    memset(&in, 0, sizeof in);
    in.sample_time = {macro}_SAMPLE_TIME;
    for (k = 0; k < 200; ++k) {
        if (k == 100) { {poked}; }
        (void){name}_step(&c, &in, &out);
        if (k >= 100) { printf("%u\\n", out.status); }
    }
    return 0;
}
"""


def statuses(made: dict[str, str], poked: str, folder) -> list[int]:
    names = {"{name}": "mrac", "{macro}": "MRAC", "{poked}": poked}
    text = CORRUPTED
    for name, value in names.items():
        text = text.replace(name, value)
    write(folder, {**made, "main.c": text})
    command = ["gcc", *ISO, *STRICT, "main.c", "controller.c", "-o", "main", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return [
        int(line) for line in subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True).stdout.split()
    ]


@needs_gcc
@pytest.mark.parametrize("share", [0.3, 1.0, -1.0])
def test_a_corrupted_integrator_does_not_reject_every_result_for_ever(share, tmp_path) -> None:
    """K_i xi is out of range although xi is in range. The baseline's state is held during an outage, but not after ten rejected
    results, so the controller returns."""
    made = files(replace(problem("lqi"), faults=()), SCHEMES["mrac"], RUN)
    found = statuses(made, f"c.held_baseline[0] = {share} * MRAC_RANGE", tmp_path)
    refused = [one for one in found if one & 8]
    assert len(refused) == 10 and found[10:] == [0] * 90


@needs_gcc
def test_a_corrupted_last_command_outside_its_range_is_a_bad_state_even_without_a_rate(tmp_path) -> None:
    posed = replace(problem("state"), faults=(), shell=Shell(range={"command": [-1.5, 1.5]}, longest_outage=OUT))
    made = files(posed, SCHEMES["mrac"], RUN)
    assert statuses(made, "c.held_r[0] = 1.5", tmp_path)[0] == 0
    assert statuses(made, "c.held_r[0] = 1.6", tmp_path)[:2] == [4, 0]
    source, survived = made["controller.c"], []
    for test in re.findall(r"^        && c->held_r\[0\].*$", source, re.MULTILINE):
        write(tmp_path, made | {"controller.c": source.replace(f"{test}\n", "")})
        if run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode != 1:
            survived.append(test)
    assert survived == [] and source.count("        && c->held_r[0]") == 2
