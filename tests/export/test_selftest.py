"""An export's self-test passes for the correct controller and finds faults planted in it."""

from __future__ import annotations

import random
import re
import subprocess
from collections import namedtuple
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from barbalat import Sampled
from export.examples import FREE, SIMULATION, T, sampled_examples, schemes_covered
from export.made import files
from export.targets import ISO, STRICT, needs, needs_gcc, needs_gxx, run_selftest, write
from foreign import Plain, PlainEquations
from turns import once

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}


def one(beginning: str) -> str:
    return next(name for name in EXAMPLES if name.startswith(beginning))


NAMED = [
    one(beginning)
    for beginning in (
        "Mrac-state-midpoint", "Mrac-state-euler", "Mrac-gain-midpoint", "Mrac-several-midpoint", "L1Adaptive-ball-midpoint",
        "L1Adaptive-polynomial-midpoint", "L1Adaptive-terms-midpoint",
        "MracClosedLoop-state-euler", "NormalizedMrac-state-midpoint",
        "NormalizedMrac-ball-euler", "RobustMrac-free-midpoint", "RobustMrac-free-euler", "LinearFeedback-state-midpoint",
        "KnownParameters-state-euler", "MracOutput-output-midpoint", "MracOutput-output-euler",
        "MracOutput-third */ order-midpoint", "L1Output-output-midpoint",
        "LinearOutput-output-midpoint",
        "DirectMrac-state-euler", "MitRule-state-euler", "Adrc-state-midpoint", "RobustMrac-several-euler",
        "L1PiecewiseConstant-state", "L1OutputPiecewiseConstant-output", "NetworkMrac-state-euler",
    )
]  # fmt: skip
CHOSEN = NAMED + [
    one(f"{scheme.__name__}-")
    for scheme in sorted(schemes_covered(), key=lambda scheme: scheme.__name__)
    if not any(name.startswith(f"{scheme.__name__}-") for name in NAMED)
]
"""Examples of every scheme. If none is chosen, it is the first one."""


@pytest.fixture
def exported(shared) -> Callable[..., Path]:
    """Write the export of an example into a folder. pytest's processes write each export only once."""

    def written(name: str, folder: Path, *, float32: bool = False) -> Path:
        made = partial(files, *EXAMPLES[name], SIMULATION, float32=float32)
        return write(folder, once(shared, f"export-{list(EXAMPLES).index(name)}-{float32}", made))

    return written


@needs_gcc
@pytest.mark.parametrize(("name", "float32"), [(name, False) for name in CHOSEN] + [(name, True) for name in CHOSEN])
@pytest.mark.short(kept=lambda name, float32: name in (CHOSEN[7:14:6] if float32 else CHOSEN[1:14:8]))
def test_it_passes(name, float32, tmp_path, exported) -> None:
    """The export is compiled without warnings, including those on promotion to double. With float32 no number has double
    precision."""
    exported(name, tmp_path, float32=float32)
    done = run_selftest(tmp_path, "gcc", *ISO, "-O2", *STRICT)
    assert done.returncode == 0, done.stdout
    assert "1000 samples agree in every bit" in done.stdout
    if float32:
        subprocess.run(["gcc", *ISO, "-O0", "-c", "controller.c", "-o", "controller.o"], cwd=tmp_path, check=True)
        shown = subprocess.run(["objdump", "-d", "controller.o"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
        assert re.search(r"\b(mul|add|sub|div)ss\b", shown)
        assert not re.search(r"\b\w+sd\b|cvtss2sd", shown)


@needs_gcc
def test_a_scheme_from_outside_the_package(tmp_path) -> None:
    """A user's own class is exported like a built-in one: its model, its freeze, its names."""
    controller = Sampled(controller=Plain(gamma=2.0, name="my own"), sample_time=T, discretization="euler")
    write(tmp_path, files(FREE, controller, SIMULATION))
    done = run_selftest(tmp_path, "gcc", *ISO, "-O2", *STRICT)
    assert done.stdout == "my_own: 1000 samples agree in every bit\n"
    assert "held_x_m[2]" in (tmp_path / "controller.h").read_text()


ColdState = namedtuple("ColdState", "theta_hat fade last_u Γ Θ")
"""Fields with names that an export uses for its members, or with letters that C does not have."""


class ColdEquations(PlainEquations):
    def initial(self):
        return ColdState(np.zeros(self.n), *np.zeros((2, 1)), *np.zeros((2, 2)))

    def control(self, state, x, x_m, r):
        return super().control(state, x, x_m, r) + 0.01 * (state.fade[0] + state.last_u[0] + state.Γ[0] + state.Θ[1])

    def derivative(self, state, x, x_m, r, u):
        theta_hat = self.gamma * ((x - x_m) @ self.P_b) * x
        return ColdState(theta_hat, u - state.fade, u - 2 * state.last_u, x - state.Γ, 2 * x - state.Θ)


class Cold(Plain):
    def bind(self, known):
        return ColdEquations(self.gamma, known.P @ known.b, known.k_0, known.n)


@needs_gcc
def test_a_scheme_whose_names_are_the_exports_own(tmp_path) -> None:
    controller = Sampled(controller=Cold(gamma=2.0, name="while"), sample_time=T, discretization="euler")
    write(tmp_path, files(FREE, controller, SIMULATION))
    done = run_selftest(tmp_path, "gcc", *ISO, "-O2", *STRICT)
    assert done.stdout == "n_while: 1000 samples agree in every bit\n"


@needs_gxx
@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name: name == CHOSEN[1])
def test_it_passes_as_cpp(name, tmp_path, exported) -> None:
    exported(name, tmp_path)
    done = run_selftest(tmp_path, "g++", "-std=c++17", "-ffp-contract=off", "-O2", *STRICT, "-x", "c++")
    assert done.returncode == 0, done.stdout


@needs("clang")
@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name: name == CHOSEN[9])
def test_it_passes_with_clang(name, tmp_path, exported) -> None:
    exported(name, tmp_path)
    done = run_selftest(tmp_path, "clang", *ISO, "-O3", *STRICT)
    assert done.returncode == 0, done.stdout


def seen_when_fused(name: str) -> bool:
    """Known parameters are 1 and -0.5 here, as are a baseline's gains, so their products are exact, fused or not."""
    return not name.startswith(("KnownParameters", "BaselineAlone"))


EMULATED = {
    "aarch64": ("aarch64-linux-gnu-gcc", "qemu-aarch64"),
    "riscv64": ("riscv64-linux-gnu-gcc", "qemu-riscv64"),
}


@pytest.mark.parametrize("machine", [pytest.param(m, marks=needs(*programs)) for m, programs in EMULATED.items()])
@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name, machine: name == CHOSEN[9])
def test_it_passes_on_other_machines(name, machine, tmp_path, exported) -> None:
    """The bits are the same on aarch64 and riscv64. If the compiler fuses multiply-adds by itself, the self-test detects it."""
    compiler, emulator = EMULATED[machine]
    exported(name, tmp_path)
    done = run_selftest(tmp_path, compiler, *ISO, "-O2", "-static", *STRICT, emulator=(emulator,))
    assert done.returncode == 0, done.stdout
    fused = run_selftest(tmp_path, compiler, "-std=gnu99", "-ffp-contract=fast", "-O2", "-static", emulator=(emulator,))
    assert fused.returncode == seen_when_fused(name)


CORTEX_M4F = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
BOARD = Path(__file__).parents[2] / "examples" / "cortex-m"


@needs("arm-none-eabi-gcc", "qemu-system-arm")
@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name: name == CHOSEN[7])
def test_float32_on_a_cortex_m4f(name, tmp_path, exported) -> None:
    """The vectors are this machine's float32 bits, and the controller needs no support routine for double precision. With fused
    multiply-adds, which GNU mode uses, the self-test fails.
    """
    exported(name, tmp_path, float32=True)
    linked = ["--specs=rdimon.specs", "-T", str(BOARD / "memory.ld"), str(BOARD / "startup.c")]
    machine = "qemu-system-arm -M mps2-an386 -nographic -semihosting-config enable=on,target=native -kernel"
    command = ["arm-none-eabi-gcc", *CORTEX_M4F, "-O2"]
    done = run_selftest(tmp_path, *command, *ISO, *linked, emulator=tuple(machine.split()))
    assert done.returncode == 0, done.stdout
    subprocess.run([*command, *ISO, "-c", "controller.c", "-o", "controller.o"], cwd=tmp_path, check=True)
    needed = subprocess.run(["arm-none-eabi-nm", "-u", "controller.o"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert not re.search(r"__aeabi_.*d|__aeabi_d", needed.stdout.replace("__aeabi_memcpy", "")), needed.stdout
    fused = run_selftest(tmp_path, *command, "-std=gnu99", "-ffp-contract=fast", *linked, emulator=tuple(machine.split()))
    assert (fused.returncode != 0) == seen_when_fused(name)


BINARY = re.compile(r"(const double t\d+ = -?t\d+) ([-+*]) (t\d+;)")
CONSTANT = re.compile(r"(= )(-?0x1\.[0-9a-f]+p[-+]\d+)(;)")


def _other_sign(text: str, drawn: random.Random) -> str:
    found = drawn.choice([m for m in BINARY.finditer(text) if m[2] != "*"])
    return text[: found.start(2)] + ("-" if found[2] == "+" else "+") + text[found.end(2) :]


def _other_operand(text: str, drawn: random.Random) -> str:
    found = drawn.choice(list(BINARY.finditer(text)))
    number = int(re.findall(r"\d+", found[3])[0])
    earlier = [m[1] for m in re.finditer(r"const double (t\d+) = t\d+ [-+*]", text[: found.start()]) if m[1] != f"t{number}"]
    return text[: found.start(3)] + f"{earlier[-1]};" + text[found.end(3) :] if earlier else _other_sign(text, drawn)


def _last_bit(text: str, drawn: random.Random) -> str:
    """A mutant with a constant changed by one unit in its last place."""
    body = text[text.index("static void advance(") :]
    found = drawn.choice([m for m in CONSTANT.finditer(body) if not m[2].lstrip("-").startswith("0x1.0000000000000p")])
    mantissa, power = found[2].split("p")
    moved = f"{mantissa[:-1]}{int(mantissa[-1], 16) ^ 1:x}p{power}"
    return text.replace(body, body[: found.start(2)] + moved + body[found.end(2) :])


def _unsaved(text: str, drawn: random.Random) -> str:
    """A mutant in which one number of the state is not advanced."""
    found = drawn.choice(list(re.finditer(r"\n    c->\w+\[\d+\] = \(?\w*\)?t\d+;", text)))
    return text[: found.start()] + text[found.end() :]


FAULTS = [
    *[_other_sign] * 4, *[_other_operand] * 4, *[_last_bit] * 3, *[_unsaved] * 3,
    ("in->freeze != 0 ?", "in->freeze == 0 ?"),
    ("status |= {macro}_WRONG_SAMPLE_TIME", "status |= {macro}_OK"),
    ("if (!in_range(in->x, {macro}_MEASURED)) {", "if (0) {"),
    ("    if (!state_is_usable(c)) {", "    if (0) {"),
    ("    advance(c, in);", "    if (measured != 0) {\n        advance(c, in);\n    }"),
    ("\n    if (!result_is_usable(c) ||", "\n    if (0 ||"),
]  # fmt: skip


@needs_gcc
@pytest.mark.parametrize("name", [one("Mrac-state-euler"), one("RobustMrac-free-midpoint"), one("L1Adaptive-ball-midpoint")])
@pytest.mark.short(kept=lambda name: name.startswith("Mrac"))
def test_it_finds_planted_faults(name, tmp_path, exported, sample) -> None:
    """Twenty mutants (every third in the short command), of which at most two (one) are missed. Two thirds of them are in the
    arithmetic, down to one unit in the last place of a constant, and the rest are in the surrounding code. A mutant in a branch
    that no vector reaches may be missed.
    """
    exported(name, tmp_path)
    right = (tmp_path / "controller.c").read_text()
    macro = EXAMPLES[name][1].name.upper()
    found = []
    for number, fault in list(enumerate(FAULTS))[:: sample(3, 1)]:
        if isinstance(fault, tuple):
            wrong = right.replace(*(text.replace("{macro}", macro) for text in fault), 1)
        else:
            wrong = fault(right, random.Random(number))
        assert wrong != right
        (tmp_path / "controller.c").write_text(wrong)
        done = run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w")
        found.append(done.returncode != 0)
    assert found.count(False) <= sample(1, 2), [i for i, seen in enumerate(found) if not seen]


AROUND = {
    "half of u within the limits": ("out->u_limited[i] = out->u[i];", "out->u_limited[i] = 0.5 * out->u[i];"),
    "the lower limit for every u below -0.09": (
        "out->u_limited[i] = out->u[i];",
        "out->u_limited[i] = out->u[i] < -0.09 ? -3.0 : out->u[i];",
    ),
    "no lower limit": ("if (out->u[0] < -0x1.8", "if (out->u[0] < -0x1.8p9 && out->u[0] < -0x1.8"),
    "another upper limit": ("out->u_limited[0] = 0x1.8000000000000p+1", "out->u_limited[0] = 0x1.8000000000001p+1"),
    "the bump is u_now": ("            c->bump[i] = c->bump[i] - c->held_u[i];\n", ""),
    "the bump is taken anew": ("    }\n    c->matching = 0;\n", "    }\n"),
    "the bump stays": (
        "    c->matching = 0;\n    if (c->fade_left > 0L) {\n        --c->fade_left;",
        "    c->matching = 0;\n    if (0) {",
    ),
    "a fade goes on at a lost sample": (
        "        c->held_u[i] = c->last_u[i];\n    }\n",
        "        c->held_u[i] = c->last_u[i];\n    }\n    c->fade_left -= c->fade_left > 0L ? 1L : 0L;\n",
    ),
    "a lost sample moves u": ("        c->held_u[i] = c->last_u[i];\n", ""),
    "a lost sample is learnt from": ("    in->freeze = 1;\n", ""),
    "nothing goes on through a lost sample": (
        "    advance(c, in);",
        "    if (measured != 0) {\n        advance(c, in);\n    }",
    ),
    "a lost sample is taken for zero": ("in->x[i] = c->held_measured[i];", "in->x[i] = 0;"),
    "a lost command is taken for zero": ("in->r[i] = c->held_r[i];", "in->r[i] = 0;"),
    "a lost command opens the loop": (
        "        *status |= {macro}_COMMAND_LOST;\n        for",
        "        *status |= {macro}_COMMAND_LOST;\n        *measured = 0;\n        for",
    ),
    "a lost command is learnt from no more": (
        "        *status |= {macro}_COMMAND_LOST;\n        for",
        "        *status |= {macro}_COMMAND_LOST;\n        in->freeze = 1;\n        for",
    ),
    "a lost command is told as a lost measurement": ("*status |= {macro}_COMMAND_LOST;", "*status |= {macro}_MEASUREMENT_LOST;"),
    "a start anywhere": ("    if (!in_range(x, {macro}_MEASURED) || !in", "    if (!in"),
    "a start from any control": (" || !in_range(u_now, {macro}_INPUTS)) {", ") {"),
    "a reset goes on": ("    c->held_started[0] = 0x0.0p+0 /* 0.0 */;\n", ""),
    "a start goes on": (
        "c->held_r[0] = 0x0.0p+0 /* 0.0 */;\n    c->held_started[0] = 0x0.0p+0 /* 0.0 */;\n    if (keep",
        "c->held_r[0] = 0x0.0p+0 /* 0.0 */;\n    if (keep",
    ),
    "a refused result is put out": ("\n    if (!result_is_usable(c) ||", "    if (0 ||"),
    "a standstill is not told": ("        status |= {macro}_RESULT_REFUSED;\n", ""),
    "what was learnt is kept without being asked": ("    if (keep_estimates == 0) {", "    if (0) {"),
    "what was learnt is never kept": ("    if (keep_estimates == 0) {", "    if (1) {"),
    "a fade of a negative time": ("c->fade = samples > 0L ? samples : 0L;", "c->fade = samples;"),
    "10 ppm of a timer are another sample time": ("_SAMPLE_TIME + 0x1.4f8b588e368f1p-17", "_SAMPLE_TIME + 0x1.0p-30"),
}
"""The code around the arithmetic of a controller with limits of -3 and 3, and the planted replacements."""


@needs_gcc
@pytest.mark.parametrize("fault", AROUND)
@pytest.mark.short(kept=lambda fault: list(AROUND).index(fault) % 3 == 0)
def test_it_finds_every_fault_that_is_planted_around_the_arithmetic(fault, tmp_path, exported) -> None:
    name = one("Mrac-state-midpoint")
    exported(name, tmp_path)
    right = (tmp_path / "controller.c").read_text()
    original, planted = (text.replace("{macro}", EXAMPLES[name][1].name.upper()) for text in AROUND[fault])
    assert original in right
    (tmp_path / "controller.c").write_text(right.replace(original, planted, 1))
    assert run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode == 1


@needs_gcc
@pytest.mark.parametrize("beginning", ["L1Adaptive-state-midpoint", "L1PiecewiseConstant-state"])
def test_a_negative_fade_is_found_where_the_first_control_is_zero(beginning, tmp_path, exported) -> None:
    """The filter of such a law starts at zero, so a rejected step after the start outputs the same u as a good one."""
    exported(one(beginning), tmp_path)
    right = (tmp_path / "controller.c").read_text()
    original, planted = AROUND["a fade of a negative time"]
    assert original in right
    (tmp_path / "controller.c").write_text(right.replace(original, planted, 1))
    done = run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w")
    assert done.returncode == 1 and "negative number of samples" in done.stdout


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("name", [one("Mrac-state-midpoint"), one("L1Adaptive-state-midpoint"), one("L1PiecewiseConstant-state")])
def test_no_statement_around_the_arithmetic_can_be_left_out(name, tmp_path, exported) -> None:
    """Each statement except a return is deleted separately. The self-test fails or the code does not compile."""
    exported(name, tmp_path)
    right = (tmp_path / "controller.c").read_text()
    first, last = right.index("static void advance("), right.index("/* Bumpless start")
    statement = re.compile(r"^ +(?!int |const |unsigned |return )\S[^\n]*;$", re.MULTILINE)
    places = [found for found in statement.finditer(right) if not first <= found.start() < last]
    assert len(places) > 50
    subprocess.run(["gcc", *ISO, "-O1", "-c", "selftest.c"], cwd=tmp_path, check=True, timeout=60)
    unseen = []
    for found in places:
        (tmp_path / "controller.c").write_text(right[: found.start()] + ";" + right[found.end() :])
        command = ["gcc", *ISO, "-O1", "-w", "controller.c", "selftest.o", "-o", "selftest", "-lm"]
        compiled = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, timeout=60).returncode == 0
        if compiled and subprocess.run([tmp_path / "selftest"], capture_output=True, timeout=60, check=False).returncode == 0:
            unseen.append(found[0].strip())
    assert unseen == []
