"""The same operation lists in C, by gcc: both orders of operations, several widths, several sets of flags."""

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
"""-ffast-math assumes that nothing is infinite or NaN. The loops hold an infinite constant in the projection, which gcc 12
happens to treat well, as the check shows; the figures start at infinity, so that there it must stay off."""

NO_TRAPS = ("-fno-trapping-math", "-fno-trapping-math -mprefer-vector-width=512")
"""What LLVM assumes by default: nobody looks at the floating-point flags. NaN and infinity keep their meaning."""

PLAIN = ("", "-ffp-contract=off")

WIDTHS = (8, 16, 32)


class Family(NamedTuple):
    """Variants of one kind; the fastest counts."""

    name: str
    flag_sets: tuple[str, ...]
    figures: bool


def families(case: Case, *, quick: bool) -> list[Family]:
    """In an ensemble only variants that gcc vectorises; ``quick`` keeps the best flags so far."""
    both = 1 if quick else 2
    plain = () if case.members > 1 else PLAIN
    return [
        Family("C", (*plain, *FAST_MATH[:both]), figures=False),
        Family("C, -fno-trapping-math", NO_TRAPS[:both], figures=False),
        Family(f"C{WITH_FIGURES}", NO_TRAPS[:both], figures=True),
    ]


def contestants(case: Case, steps: int, folder: Path, family: Family, *, quick: bool) -> list[Contestant]:
    """Every variant; ``quick`` keeps the best order and width so far."""
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

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each waits for a gcc
        return list(pool.map(build, itertools.product(lists, widths, family.flag_sets)))


def _loop(library: Path) -> Loop:
    """Arrays in, as the kernel takes them."""
    function = ctypes.CDLL(str(library))[ENTRY]
    function.argtypes = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 4
    function.restype = None

    def loop(blocks: int, steps: int, state: np.ndarray, parameters: np.ndarray, signals: np.ndarray, out: np.ndarray) -> None:
        function(blocks, steps, state.ctypes.data, parameters.ctypes.data, signals.ctypes.data, out.ctypes.data)

    return loop
