"""The same operation lists in C, by gcc: both orders of operations, several widths, several sets of flags."""

from __future__ import annotations

import ctypes
import itertools
import shutil
import subprocess
from pathlib import Path

import numpy as np

from barbalat.lowering import c99
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import ENTRY
from benchmarks.kernel import WITH_FIGURES, Loop, advance
from benchmarks.loops import Case
from benchmarks.race import Contestant

PLAIN = ("", "-ffp-contract=off", "-ffast-math", "-ffast-math -mprefer-vector-width=512")
"""-ffast-math assumes that nothing is infinite or NaN. The loops hold an infinite constant in the projection, which gcc 12
happens to treat well, as the check shows; the figures start at infinity, so that there it must stay off."""

NO_TRAPS = ("-fno-trapping-math", "-fno-trapping-math -mprefer-vector-width=512")
"""What LLVM assumes by default: nobody looks at the floating-point flags. NaN and infinity keep their meaning."""

FIGURES = ("", *NO_TRAPS)

WIDTHS = (8, 16, 32, 64)


def missing() -> str | None:
    return None if shutil.which("gcc") else "gcc is not installed"


def compile_loop(source: str, flags: str, folder: Path, stem: str) -> Loop:
    """Build a shared library from the source in ``folder``; arrays in, as the kernel takes them."""
    text, library = folder / f"{stem}.c", folder / f"{stem}.so"
    text.write_text(source)
    command = f"gcc -O3 -march=native {flags} -shared -fPIC".split()
    subprocess.run([*command, str(text), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library))[ENTRY]
    function.argtypes = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 4
    function.restype = None

    def loop(blocks: int, steps: int, state: np.ndarray, parameters: np.ndarray, signals: np.ndarray, out: np.ndarray) -> None:
        function(blocks, steps, state.ctypes.data, parameters.ctypes.data, signals.ctypes.data, out.ctypes.data)

    return loop


def contestants(
    case: Case, steps: int, folder: Path, flag_sets: tuple[str, ...], *, figures: bool = False, quick: bool = False
) -> list[Contestant]:
    """Every variant; ``quick`` keeps the width that has come out on top so far."""
    ours = case.optimised(figures=figures)
    lists: dict[str, Program] = {"our order": ours.program, "CasADi's order": case.as_read(figures=figures)}
    widths = (1,) if case.members == 1 else (64,) if quick else WIDTHS
    resets = () if ours.accumulators is None else ours.accumulators.resets
    result = []
    for (order, program), lanes, flags in itertools.product(lists.items(), widths, flag_sets):
        source = c99.loop(program, ours.shape, resets, lanes)
        stem = f"{case.name}-{case.members}-{figures}-{order}-{lanes}-{flags}".replace(" ", "_").replace("'", "")
        loop = compile_loop(source, flags, folder, stem)
        name = f"{order}{WITH_FIGURES * figures}" + (f", {lanes} wide" if lanes > 1 else "") + (f", {flags}" if flags else "")
        result.append(Contestant(name, steps, advance(loop, ours.shape, case, lanes)))
    return result
