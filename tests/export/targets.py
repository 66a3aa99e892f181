"""Exports compiled by this machine's compilers and called sample by sample."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

STRICT = ["-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
ISO = ["-std=c99", "-ffp-contract=off"]

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed: exports can't be compiled here")
needs_gxx = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed: exports can't be compiled as C++ here")


def needs(*programs: str) -> pytest.MarkDecorator:
    """Skip with the reason if one of the tools is not installed."""
    missing = [program for program in programs if shutil.which(program) is None]
    return pytest.mark.skipif(bool(missing), reason=f"{', '.join(missing)} not installed: this target is left out")


def write(folder: Path, files: dict[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def run_selftest(folder: Path, *command: str, emulator: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    """Compile with the command and with warnings as errors, and run for at most a minute."""
    made = folder / "selftest"
    subprocess.run([*command, "controller.c", "selftest.c", "-o", str(made), "-lm"], cwd=folder, check=True, timeout=60)
    return subprocess.run([*emulator, str(made)], capture_output=True, text=True, timeout=60, check=False)


_DRIVER = """\
#include "controller.h"

void drive(int samples, const {real} *measured, const {real} *commands, const int *freeze, const double *timer, {real} *u,
           {real} *limited, {real} *estimates, double *kept, unsigned *status)
{{
    static {name}_controller c;
    {name}_init(&c);
    for (int k = 0; k < samples; ++k) {{
        {name}_input in = {{0}};
        {name}_output out;
        in.sample_time = {macro}_SAMPLE_TIME * ({real})timer[k];
        in.freeze = freeze[k];
        for (int i = 0; i < {macro}_MEASURED; ++i) in.{measured}[i] = measured[k * {macro}_MEASURED + i];
        for (int i = 0; i < {macro}_COMMANDS; ++i) in.r[i] = commands[k * {macro}_COMMANDS + i];
        status[k] = {name}_step(&c, &in, &out);
        for (int i = 0; i < {macro}_INPUTS; ++i) u[k * {macro}_INPUTS + i] = out.u[i];
        for (int i = 0; i < {macro}_INPUTS; ++i) limited[k * {macro}_INPUTS + i] = out.u_limited[i];
        {take}
    }}
}}
"""


@dataclass
class Driven:
    """The results of a series of samples: (K, m) twice, (K, p), the whole state in the order of the layout, and (K,)."""

    u: np.ndarray
    limited: np.ndarray
    estimates: np.ndarray
    kept: np.ndarray
    status: np.ndarray


def drive(printed, folder: Path, measured, commands, freeze=None, compiler=("gcc", *ISO, "-O2"), timer=1.0) -> Driven:
    """The results of ``controller.c`` in the folder, called with these samples after an initialisation. ``timer`` has the times
    relative to the sample time."""
    y, q, m, p = printed.contents.sizes
    macro = printed.macro
    take = f"for (int i = 0; i < {macro}_ESTIMATES; ++i) estimates[k * {macro}_ESTIMATES + i] = out.theta_hat[i];"
    entries = list(printed.contents.layout.entries().values())
    stored = [f"kept[k * {len(entries)} + {i}] = {text.replace('c->', 'c.')};" for i, text in enumerate(entries)]
    take = "\n        ".join([take if p else "(void)estimates;", *stored])
    driver = _DRIVER.format(name=printed.name, macro=macro, real=printed.real, measured=printed.measured, take=take)
    made = folder / f"driver-{abs(hash((compiler, driver, (folder / 'controller.c').read_text())))}.so"
    if not made.exists():
        (folder / "driver.c").write_text(driver)
        command = [*compiler, *STRICT, "-shared", "-fPIC", "controller.c", "driver.c", "-o", str(made), "-lm"]
        subprocess.run(command, cwd=folder, check=True, timeout=60)
    numbers = printed.contents.real.numbers
    count = len(measured)
    given = [np.ascontiguousarray(part, dtype=numbers) for part in (measured, commands)]
    assert given[0].shape == (count, y) and given[1].shape == (count, q)
    freeze = np.zeros(count, dtype=np.int32) if freeze is None else np.asarray(freeze, dtype=np.int32)
    timer = np.ascontiguousarray(np.broadcast_to(timer, count), dtype=float)
    u, limited, estimates = (np.zeros((count, size), numbers) for size in (m, m, p))
    out = Driven(u, limited, estimates, np.zeros((count, len(entries))), np.zeros(count, np.uint32))
    arrays = (*given, freeze, timer, out.u, out.limited, out.estimates, out.kept, out.status)
    ctypes.CDLL(str(made)).drive(ctypes.c_int(count), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
    return out


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Check that the numbers are equal, including the sign of zero. No compared value may be NaN."""
    a, b = np.ascontiguousarray(a, dtype=float), np.ascontiguousarray(b, dtype=float)
    assert np.isfinite(a).all() and np.isfinite(b).all()
    return bool(np.array_equal(a.view(np.int64), b.view(np.int64)))
