"""``--parameters``: numbers of the case that can be set while the exported C runs, within their bounds, without a bump."""

from __future__ import annotations

import ctypes
import re
import subprocess
from functools import partial

import numpy as np
import pytest

from barbalat.cli import main
from barbalat.export.acceptance import Order
from barbalat.export.c99.files import made_of
from barbalat.export.evaluation import evaluate
from barbalat.export.settable import parameter_names
from barbalat.export.settable_selftest import tried
from barbalat.export.source import header, source
from barbalat.export.target import Request, targets
from barbalat.export.texts import Printed
from barbalat.export.vectors import chosen
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import Shell
from export.examples import SIMULATION, sampled_examples
from export.made import files
from export.mutation import found_in_c
from export.proof import STATES, alarms
from export.targets import ISO, STRICT, needs, needs_gcc, run_selftest, same_bits, write
from export.test_baseline_fallback import RUN, SCHEMES
from export.test_baseline_fallback import problem as problem_with_baseline
from export.test_proof import MISRA
from export.test_selftest import one
from export.test_shell import SHELLS, Plain, surrounded
from export.translation import compiled, difference
from turns import once

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}
KINDS = [
    one(beginning)
    for beginning in (
        "L1Output-output", "Mrac-state-midpoint", "L1Adaptive-gain", "NormalizedMrac-ball", "MracOutput-third", "LinearFeedback",
        "RobustMrac-several", "L1PiecewiseConstant-state",
    )
]  # fmt: skip


def printed(name: str, real=DOUBLE) -> Printed:
    return Printed(made_of(*EXAMPLES[name], SIMULATION, real, parameters=True))


@needs_gcc
@pytest.mark.parametrize(("name", "float32"), [(name, i % 2 == 1) for i, name in enumerate(KINDS)])
@pytest.mark.short(kept=lambda name, float32: name in KINDS[::3])
def test_the_self_test_passes_and_looks_at_every_parameter(name, float32, tmp_path) -> None:
    write(tmp_path, files(*EXAMPLES[name], SIMULATION, float32=float32, parameters=True))
    done = run_selftest(tmp_path, "gcc", *ISO, "-O1", *STRICT)
    assert done.returncode == 0, done.stdout


FAULTS = {
    "a parameter that is none": ("if (which < 0 || which >= {M}_PARAMETERS) {", "if (which < 0 || which > {M}_PARAMETERS) {"),
    "beyond its bounds": ("    if (!parameters_are_usable(next)) {", "    if (0) {"),
    "no sign": ("        && parameter[0] > 0\n", ""),
    "0 is taken": ("        && parameter[0] > 0\n", "        && parameter[0] >= 0\n"),
    "below the set": ("        && parameter[3] <= parameter[1]\n", ""),
    "above the set": ("        && parameter[1] <= parameter[5]\n", ""),
    "of any size": ("if (!(values[i] >= -{M}_PARAMETER_RANGE && values[i] <= {M}_PARAMETER_RANGE)) {", "if (0) {"),
    "another one": ("    c->parameter[which] = value;\n", "    c->parameter[0] = value;\n"),
    "a bump": ("        c->bump[i] = u[i];\n", "        ;\n"),
    "no matching": ("    c->matching = 1;\n    c->change = 0L;\n}", "    c->change = 0L;\n}"),
    "the other fade ends at once": ("    fade(c);\n    for", "    for"),
    "the new numbers twice": ("                exchange(c);\n", "                ;\n"),
    "the old numbers for ever": ("    exchange(c);\n    for", "    for"),
    "half of a step twice": ("    copy(c, before);\n    exchange", "    exchange"),
    "a change for ever": ("    c->matching = 1;\n    c->change = 0L;\n}", "    c->matching = 1;\n}"),
    "the first of two is forgotten": ("i < {M}_PARAMETERS && c->change == 0L; ++i", "i < {M}_PARAMETERS; ++i"),
    "another length": ("    c->fade = c->change;\n", ""),
    "no length": ("    c->fade_left = c->change;\n", ""),
    "a refused result": ("        before.change = 0L;", "        "),
    "a corrupted previous number": (" && parameters_are_usable(c->previous)", ""),
    "a negative change": ("(c->change == 0L || (c->change > 0L &&", "(c->change <= 0L || (c->change > 0L &&"),
    "from a corrupted number": ("\n            && parameters_are_usable(c->parameter)", ""),
    "before the first sample": ("\n            && c->held_started[0] > 0", ""),
    "a fade for an initial estimate": ("\n            && which != {M}_SET_THETA_HAT0_0", ""),
    "a parameter that was hit": ("\n        && parameters_are_usable(c->parameter)", ""),
    "a limit of the case": ("out->u[0] < c->parameter[9]", "out->u[0] < -0x1.8p+1"),
}


@needs_gcc
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.short(kept=lambda fault: list(FAULTS).index(fault) % 4 == 1)
def test_the_self_test_finds_faults_in_what_sets_a_parameter(fault, tmp_path, shared) -> None:
    made = once(shared, "settable", partial(files, *EXAMPLES[KINDS[1]], SIMULATION, parameters=True))
    right, wrong = (text.replace("{M}", "C0") for text in FAULTS[fault])
    assert right in made["controller.c"]
    write(tmp_path, made | {"controller.c": made["controller.c"].replace(right, wrong)})
    assert run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode == 1


SAMPLE = """{name}_input in = {{0}};
        {name}_output out;
        in.sample_time = {macro}_SAMPLE_TIME;
        for (int i = 0; i < {macro}_MEASURED; ++i) in.{measured}[i] = measured[k * {macro}_MEASURED + i];
        for (int i = 0; i < {macro}_COMMANDS; ++i) in.r[i] = commands[k * {macro}_COMMANDS + i];"""


def loaded(folder, made: Printed, program: str, **more: str) -> ctypes.CDLL:
    """The C compiled with a program that calls it."""
    names = {"name": made.name, "macro": made.macro, "measured": made.measured}
    text = program.format(sample=SAMPLE.format(**names), **names, **more)
    write(folder, {"controller.h": header(made), "controller.c": source(made), "program.c": text})
    command = ["gcc", *ISO, "-O2", "-shared", "-fPIC", "controller.c", "program.c", "-o", "program.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return ctypes.CDLL(str(folder / "program.so"))


DRIVER = """\
#include "controller.h"

unsigned drive(int samples, int from, int which, double value, long fade, const double *measured, const double *commands,
               double *u, double *kept)
{{
    static {name}_controller c;
    unsigned status = 0u;
    {name}_init(&c);
    for (int k = 0; k < samples; ++k) {{
        {sample}
        if (k == from) status |= {name}_set(&c, which, value, fade);
        status |= {name}_step(&c, &in, &out);
        for (int i = 0; i < {macro}_INPUTS; ++i) u[k * {macro}_INPUTS + i] = out.u[i];
        {store}
    }}
    return status;
}}
"""


@needs_gcc
@pytest.mark.parametrize("name", KINDS[1:4])
@pytest.mark.short(kept=lambda name: name == KINDS[1])
def test_a_change_in_flight_is_the_list_with_the_other_number(name, tmp_path) -> None:
    """Each parameter is set at sample 40 without a fade. The state is identical to the list's."""
    made = printed(name)
    contents, entries = made.contents, made.contents.layout.entries()
    stored = [f"kept[k * {len(entries)} + {i}] = {text.replace('c->', 'c.')};" for i, text in enumerate(entries.values())]
    drive = loaded(tmp_path, made, DRIVER, store=" ".join(stored)).drive
    y, r = (np.ascontiguousarray(part[:80]) for part in (contents.vectors.measured, contents.vectors.commands))
    looked_at = 0
    for which, (parameter, value) in enumerate(zip(contents.parameters, tried(contents), strict=True)):
        u, kept = np.zeros((80, contents.sizes[2])), np.zeros((80, len(entries)))
        at = [ctypes.c_void_p(array.ctypes.data) for array in (y, r, u, kept)]
        assert drive(80, 40, which, ctypes.c_double(value), ctypes.c_long(0), *at) == 0
        values = [one.value for one in contents.parameters]
        state = contents.initial
        for k in range(80):
            values[which] = value if k >= 40 else parameter.value
            after = np.zeros_like(state)
            after[contents.layout.rows] = _evaluated(contents, state, y[k], r[k], values)
            state = after
            assert same_bits(kept[k], state[list(entries)]), (parameter.name, k)
        looked_at += not same_bits(kept, contents.vectors.states[:80, list(entries)])
    assert looked_at >= 1


def _evaluated(contents, state, y, r, values):
    return evaluate(contents.step, contents.inputs(state, y, r, False, values), contents.real)


CALLER = """\
#include "controller.h"

void called(int samples, const int *which, const double *value, const long *fade, const double *measured, const double *commands,
            unsigned *status, double *u)
{{
    static {name}_controller c;
    {name}_init(&c);
    for (int k = 0; k < samples; ++k) {{
        {sample}
        status[k] = which[k] < 0 ? 0u : {name}_set(&c, which[k], value[k], fade[k]);
        status[k] |= {name}_step(&c, &in, &out);
        for (int i = 0; i < {macro}_INPUTS; ++i) u[k * {macro}_INPUTS + i] = out.u[i];
    }}
}}
"""


class Opened:
    """The list with parameters in the form that ``Plain`` calls."""

    def __init__(self, contents) -> None:
        self.contents, self.state, self.u = contents, contents.initial.copy(), list(contents.layout.u.rows)
        self.values, self.step = [one.value for one in contents.parameters], self

    def __call__(self, y, r, freeze, held):
        after = np.zeros_like(self.state)
        given = self.contents.inputs(self.state, y, r, freeze, self.values)
        after[self.contents.layout.rows] = evaluate(self.contents.step, given, self.contents.real)
        if held is not None:
            after[self.u] = held
        self.state = after
        return after[self.u].copy(), after.copy()


class Settable(Plain):
    """The shell in plain Python with numbers that are set between two samples."""

    length, change = 0, 0

    def set(self, which, value, samples) -> None:
        if samples and self.begun:
            self.previous = self.previous if self.change else [*self.act.values]
            self.change = samples
        self.act.values[which] = value

    def good(self, y, r, freeze) -> None:
        begins, before, new = None, self.act.state.copy(), self.act.values
        if self.change:
            self.act.values = self.previous
            begins, fade = self.faded(self.act(y, r, freeze, None)[0]), self.change
            self.act.values, self.act.state = new, before
        if self.ends and self.missed > self.longest:
            begins, fade = np.clip(self.u, *self.limits), self.fade
        own, _ = self.act(y, r, freeze, None)
        if begins is not None:
            self.bump, self.length, self.left = begins - own, fade, fade
        self.u = self.faded(own)
        self.act.step.state[self.act.u] = self.u
        self.begun, self.y, self.r, self.missed, self.left, self.change = True, y, r, 0, max(self.left - 1, 0), 0

    def faded(self, own):
        return own + self.bump * (self.left / self.length) if self.left else own


@needs_gcc
@pytest.mark.parametrize(
    ("scheme", "shell"), [("Mrac-state-midpoint", "fade"), ("L1Adaptive-several-midpoint", "hold"), ("Mrac-state-euler", "zero")]
)
@pytest.mark.short(kept=lambda scheme, shell: shell == "fade")
def test_what_is_set_beside_a_shell_acts_as_in_plain_python(scheme, shell, tmp_path) -> None:
    """Every bit of u is equal if numbers are set at good samples, in short and long outages, in fallbacks, and during the fade of
    a return."""
    problem, controller = surrounded(scheme, SHELLS[shell])
    made = Printed(made_of(problem, controller, SIMULATION, DOUBLE, parameters=True))
    called = loaded(tmp_path, made, CALLER).called
    contents, random, K = made.contents, np.random.default_rng(4), 400
    y, r = (np.ascontiguousarray(part[:K]) for part in (contents.vectors.measured, contents.vectors.commands))
    y[np.repeat(random.random(K // 8) < 0.3, 8), 0] = np.nan  # outages beyond the longest one
    y[random.random(K) < 0.05, 0] = np.nan
    gains = [i for i in range(len(contents.parameters)) if Order(0.0, i, strict=True) in contents.conditions]
    which = np.where(random.random(K) < 0.2, random.choice(gains, K), -1).astype(np.int32)
    value = np.array([contents.parameters[max(i, 0)].value for i in which]) * random.uniform(0.5, 2.0, K)
    fade = random.choice([0, 3, 10], K).astype(np.int64)
    status, u = np.zeros(K, np.uint32), np.zeros((K, contents.sizes[2]))
    arrays = (which, value, fade, y, r, status, u)
    called(K, *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
    plain, seen = (
        Settable(Opened(contents), problem.shell, problem),
        {"outage": 0, "fallback": 0, "fade": 0},
    )
    for k in range(K):
        if which[k] >= 0:
            seen["outage"] += plain.missed > 0
            seen["fallback"] += plain.missed > plain.longest
            seen["fade"] += plain.left > 0
            plain.set(which[k], value[k], fade[k])
        told, expected = plain.sample(y[k], r[k], False, 1.0)
        assert status[k] == told and same_bits(u[k], expected), k
    assert min(seen.values()) > 2, seen


@needs_gcc
def test_a_number_that_is_set_while_the_baseline_acts_makes_no_bump(tmp_path) -> None:
    """While the baseline acts, u is unaffected, because none of its numbers can be set. A new change to the baseline starts
    afresh."""
    posed = problem_with_baseline("lqi")
    made = Printed(made_of(posed, SCHEMES["mrac"], RUN, DOUBLE, parameters=True))
    called = loaded(tmp_path, made, CALLER).called
    K, found = 80, []
    y, r = (np.ascontiguousarray(part[:K]) for part in (made.contents.vectors.measured, made.contents.vectors.commands))
    y[20:60, 0] = np.nan
    offered = [one.name for one in made.contents.parameters]
    assert not [one for one in offered if "baseline" in one or "uncertainty" in one]  # the case has different values
    gain = next(i for i, one in enumerate(offered) if one.endswith("gamma"))
    for at in (-1, 26, 45):  # never, while it changes to the baseline, and on the baseline alone
        which, value, fade = np.full(K, -1, np.int32), np.full(K, 40.0), np.full(K, 10, np.int64)
        which[at] = gain if at >= 0 else -1
        status, u = np.zeros(K, np.uint32), np.zeros((K, 1))
        arrays = (which, value, fade, y, r, status, u)
        called(K, *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        assert (status[25:60] & 256).all()
        found.append(u[:, 0])
    never, changing, alone = found
    assert same_bits(alone[:60], never[:60]) or np.abs(alone[:60] - never[:60]).max() < 1e-12 * np.abs(never).max()
    assert np.abs(np.diff(changing[20:60])).max() <= np.abs(np.diff(never[19:60])).max() * 1.5
    assert np.abs(changing[20:60] - never[20:60]).max() < 0.9 * np.abs(never[24] - never[40])


@needs_gcc
def test_a_gain_that_is_doubled_in_flight_makes_no_bump(tmp_path) -> None:
    """A linear controller's u follows its gain at once. With a fade u continues as without the change, without a fade it
    jumps."""
    made = printed(KINDS[5])
    drive = loaded(tmp_path, made, DRIVER, store="(void)kept;").drive
    which = next(i for i, one in enumerate(made.contents.parameters) if one.name.endswith("D"))
    y, r = np.zeros((80, 2)), np.ones((80, 1))
    found = []
    for factor, fade in ((1, 0), (2, 0), (2, 20)):
        u = np.zeros((80, 1))
        at = [ctypes.c_void_p(array.ctypes.data) for array in (y, r, u)]
        value = factor * made.contents.parameters[which].value
        assert drive(80, 40, which, ctypes.c_double(value), ctypes.c_long(fade), *at, ctypes.c_void_p(0)) == 0
        found.append(u[:, 0])
    never, at_once, fading = found
    jump = at_once[40] - at_once[39]
    assert abs(jump) > 5
    assert fading[40] == pytest.approx(never[40], rel=1e-12) and np.abs(np.diff(fading)).max() < abs(jump) / 5
    assert fading[60:] == pytest.approx(at_once[60:])


FLOWN = """\
#include "controller.h"

void flown(int samples, double h, const double *stiffness, double b, int which, const double *value, long fade,
           const double *commands, double *x, double *u)
{{
    static {name}_controller c;
    double now[2] = {{ 0.0, 0.0 }};
    {name}_init(&c);
    for (int k = 0; k < samples; ++k) {{
        {name}_input in = {{0}};
        {name}_output out;
        in.sample_time = {macro}_SAMPLE_TIME;
        in.{measured}[0] = now[0];
        in.{measured}[1] = now[1];
        in.r[0] = commands[k];
        if (which >= 0 && {name}_set(&c, which, value[k], fade) != {macro}_OK) return;
        if ({name}_step(&c, &in, &out) != {macro}_OK) return;
        u[k] = out.u[0];
        for (int i = 0; i < 20; ++i) {{
            const double rate = stiffness[0] * now[0] + stiffness[1] * now[1] + b * u[k];
            now[0] = now[0] + h * now[1];
            now[1] = now[1] + h * rate;
        }}
        x[2 * k] = now[0];
        x[2 * k + 1] = now[1];
    }}
}}
"""


@needs_gcc
@pytest.mark.parametrize(("scheme", "key"), [(KINDS[1], "gamma"), (KINDS[5], "D")])
def test_a_number_that_is_set_at_every_sample_leaves_the_loop_closed(scheme, key, tmp_path) -> None:
    """The C runs in a loop with a plant. With the same value at every sample, the flight equals that without setting up to
    rounding. With a gain schedule u continues with the law, equal to plain Python bit for bit, and the plant follows as with an
    immediate schedule."""
    problem, _ = EXAMPLES[scheme]
    made = printed(scheme)
    contents, K, fade = made.contents, 400, 40
    A, b = np.array(problem.plant.A, dtype=float), np.array(problem.plant.b, dtype=float).reshape(-1)
    assert A.shape == (2, 2) and (A[0] == [0, 1]).all() and b[0] == 0
    flown = loaded(tmp_path, made, FLOWN).flown
    which = next(i for i, one in enumerate(contents.parameters) if one.name.endswith(key))
    case, stiffness, h = contents.parameters[which].value, np.ascontiguousarray(A[1]), contents.sample_time / 20
    r = np.where(np.arange(K) // 100 % 2 == 0, 1.0, -1.0)

    def flight(which, value, fade):
        x, u = np.full((K, 2), np.nan), np.full(K, np.nan)
        at = [ctypes.c_void_p(array.ctypes.data) for array in (stiffness, value, r, x, u)]
        flown(K, ctypes.c_double(h), at[0], ctypes.c_double(b[1]), which, at[1], ctypes.c_long(fade), *at[2:])
        assert np.isfinite(x).all()
        return x, u

    same, schedule = np.full(K, case), case * (1 + 0.3 * np.sin(np.arange(K) / 20))
    without = flight(-1, same, 0)
    assert np.ptp(without[1]) > 0.5
    for found, expected in zip(flight(which, same, fade), without, strict=True):
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    at_once, (x, u) = flight(which, schedule, 0), flight(which, schedule, fade)
    plain, now = Settable(Opened(contents), Shell(), problem), [0.0, 0.0]
    for k in range(K):
        plain.set(which, schedule[k], fade)
        _, expected = plain.sample(np.array(now), r[k : k + 1], False, 1.0)
        assert same_bits(u[k : k + 1], expected), k
        for _ in range(20):
            rate = stiffness[0] * now[0] + stiffness[1] * now[1] + b[1] * float(expected[0])
            now = [now[0] + h * now[1], now[1] + h * rate]
        assert same_bits(x[k], np.array(now)), k
    assert np.unique(u).size > 0.95 * K
    assert not same_bits(u, at_once[1])
    assert np.abs(x[:, 0] - at_once[0][:, 0]).max() < 0.1 * np.ptp(without[0][:, 0])


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("name", [KINDS[0], KINDS[3]])
def test_the_mutants_that_read_a_parameter_are_killed(name, tmp_path) -> None:
    made = printed(name)
    found = found_in_c(made, tmp_path)
    assert found.contradictions == []
    assert found.score >= 0.97
    given = chosen(made.contents).parameters
    assert np.ptp(given, axis=1).max() > 0 and made.contents.takes(given).all()


PROVEN = [*KINDS[:2], KINDS[5], one("Mrac-state-euler"), one("L1Adaptive-state-midpoint")]


@needs("frama-c")
@pytest.mark.full
@pytest.mark.parametrize("name", PROVEN)
def test_no_step_with_parameters_can_go_wrong(name, tmp_path) -> None:
    """The step starts from every value of each parameter that ``..._set`` accepts, after a call with any value."""
    assert alarms(printed(name), tmp_path, 4 * STATES) == []  # parameters are twice as many entries


@needs("cppcheck")
@pytest.mark.full
def test_misra_of_what_sets_a_parameter(tmp_path) -> None:
    made = printed(KINDS[0])
    write(tmp_path, {"controller.h": header(made), "controller.c": source(made)})
    command = [
        "cppcheck",
        "--addon=misra",
        "--std=c99",
        "--enable=style",
        "--suppress=missingIncludeSystem",
        "-q",
        "controller.c",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True)
    found = set(re.findall(r"misra-c2012-([\d.]+)", done.stderr))
    others = set(re.findall(r"\[(\w+)\]$", done.stderr, re.MULTILINE)) - {"unusedStructMember", "incorrectLogicOperator"}
    assert found and found <= MISRA.keys() and not others, done.stderr


@needs("clang", "z3")
@pytest.mark.full
@pytest.mark.parametrize("name", KINDS[:2])
def test_the_step_with_parameters_is_the_list(name, tmp_path) -> None:
    made = printed(name)
    for level in ("-O0", "-O2"):
        assert difference(made, compiled(made, tmp_path, level)) == ""


@pytest.mark.dear
def test_what_is_refused_and_what_is_told(tmp_path, capsys) -> None:
    asked = ["export", "first-order", "--controller", "MRAC, sampled", "--parameters"]
    assert main([*asked, "--out", str(tmp_path / "a")]) == 0
    text = (tmp_path / "a" / "controller.h").read_text()
    macros = re.findall(r"#define (MRAC_SAMPLED_SET_\w+) (\d+) /\* (\S+) ", text)
    assert ("MRAC_SAMPLED_SET_GAMMA", "0") in [one[:2] for one in macros]
    assert all(f"`{macro}`" in (tmp_path / "a" / "README.md").read_text() for macro, _, _ in macros)

    assert main([*asked, "--target", "fmu3", "--sources-only", "--out", str(tmp_path / "b")]) == 2
    assert "always have them" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


def test_both_limits_of_the_control_are_not_0_together() -> None:
    """As in the case, [0, 0] is rejected, but one of them may be 0."""
    name = next(name for name in KINDS if EXAMPLES[name][0].plant.paths[0].saturation is not None)
    contents = printed(name).contents
    (low,), (high,) = ([i for i, made in enumerate(contents.parameters) if made.limit == (0, side)] for side in (0, 1))
    values = np.repeat(np.array([[made.value] for made in contents.parameters]), 4, axis=1)
    values[[low, high], :] = [[-1.0, 0.0, -1.0, 0.0], [1.0, 1.0, 0.0, 0.0]]
    assert contents.takes(values).tolist() == [True, True, True, False]


def test_names_of_parameters_differ() -> None:
    for name in KINDS[:4]:
        names = parameter_names(printed(name))
        assert len(set(names)) == len(names)


@pytest.mark.parametrize("target", ["c99", "rust"])
def test_the_files_name_parameters_by_the_paths_of_the_case(target) -> None:
    """The second controller of a case is controller[1] in its texts."""
    problem, controller = EXAMPLES[KINDS[1]]
    asked = Request(problem=problem, controller=controller, simulation=SIMULATION, parameters=True, place=1)
    text = targets()[target].files(asked)["README.md"]
    assert "controller[1].gamma" in text
    assert "controller[0]" not in text
