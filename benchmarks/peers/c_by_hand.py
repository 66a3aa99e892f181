"""Section V's L1 loop in C written by hand, ``section_v.c``, with the usual sets of flags; one trajectory."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from benchmarks.gcc import shared_library
from benchmarks.loops import STEP, Case, command_table
from benchmarks.peers.equations import WRITTEN
from benchmarks.race import Contestant

SOURCE = Path(__file__).with_name("section_v.c")
FLAGS = ("-O2", "-O3", "-O3 -ffast-math")


def contestants(case: Case, steps: int, folder: Path) -> list[Contestant]:
    """One contestant for each set of flags, and none for loops other than L1's."""
    if case.members > 1 or not case.name.startswith("L1"):
        return []
    return [_contestant(case, steps, folder, flags) for flags in FLAGS]


def _contestant(case: Case, steps: int, folder: Path, flags: str) -> Contestant:
    function = ctypes.CDLL(str(shared_library(SOURCE.read_text(), flags, folder))).trajectory
    function.argtypes = [ctypes.c_size_t, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p]
    function.restype = None

    def run(steps: int) -> np.ndarray:
        y, table = case.states[:, 0].copy(), command_table()
        function(steps, STEP, y.ctypes.data, table.ctypes.data)
        return y[: WRITTEN[case.name].compared, None]

    return Contestant(f"by hand, {flags}", steps, run)
