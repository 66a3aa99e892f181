"""The kernel's operation lists in C, compiled by gcc with both orders of operations, several widths and several sets of flags."""

from __future__ import annotations

import ctypes
import itertools
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from barbalat.lowering import c99
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import ENTRY
from benchmarks.gcc import shared_library
from benchmarks.kernel import WITH_FIGURES, Loop, advance
from benchmarks.loops import Case
from benchmarks.race import Contestant

FAST_MATH = ("-ffast-math", "-ffast-math -mprefer-vector-width=512")
"""-ffast-math assumes that nothing is infinite or NaN. The loops have an infinite constant in the projection, which gcc 12
happens to treat correctly, as the check shows. The metrics start at infinity, so the flag must stay off there."""

NO_TRAPS = ("-fno-trapping-math", "-fno-trapping-math -mprefer-vector-width=512")
"""LLVM's default assumptions: nobody reads the floating-point flags, and NaN and infinity keep their meaning."""

PLAIN = ("", "-ffp-contract=off")

WIDTHS = (8, 16, 32)


class Family(NamedTuple):
    """Variants of one kind. Only the fastest is reported."""

    name: str
    flag_sets: tuple[str, ...]
    figures: bool


def families(case: Case, *, quick: bool) -> list[Family]:
    """The families of variants. In an ensemble they have only variants that gcc vectorises. With ``quick`` they have only the
    best flags found so far."""
    both = 1 if quick else 2
    plain = () if case.members > 1 else PLAIN
    return [
        Family("C", (*plain, *FAST_MATH[:both]), figures=False),
        Family("C, -fno-trapping-math", NO_TRAPS[:both], figures=False),
        Family(f"C{WITH_FIGURES}", NO_TRAPS[:both], figures=True),
    ]


def contestants(case: Case, steps: int, folder: Path, family: Family, *, quick: bool) -> list[Contestant]:
    """Every variant. With ``quick``, only the best order and width found so far."""
    ours = case.optimised(figures=family.figures)
    lists: dict[str, Program] = {"our order": ours.program}
    if not quick:
        lists["CasADi's order"] = case.as_read(figures=family.figures)
    widths = (1,) if case.members == 1 else (16,) if quick else WIDTHS
    resets = () if ours.accumulators is None else ours.accumulators.resets

    def build(variant: tuple[str, int, str]) -> Contestant:
        order, lanes, flags = variant
        library = shared_library(c99.loop(lists[order], ours.shape, resets, lanes), f"-O3 {flags}", folder)
        parts = [f"{order}{WITH_FIGURES * family.figures}", f"{lanes} wide" * (lanes > 1), flags]
        return Contestant(", ".join(filter(None, parts)), steps, advance(_loop(library), ours.shape, case, lanes))

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each thread waits for a gcc process
        return list(pool.map(build, itertools.product(lists, widths, family.flag_sets)))


def _loop(library: Path) -> Loop:
    """The compiled function as a loop that accepts the kernel's arrays."""
    function = ctypes.CDLL(str(library))[ENTRY]
    function.argtypes = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 4
    function.restype = None

    def loop(blocks: int, steps: int, state: np.ndarray, parameters: np.ndarray, signals: np.ndarray, out: np.ndarray) -> None:
        function(blocks, steps, state.ctypes.data, parameters.ctypes.data, signals.ctypes.data, out.ctypes.data)

    return loop
