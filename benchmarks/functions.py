"""The elementary functions: the times of the package's lists relative to the C library's, and the largest errors found by the
tests.

``python -m benchmarks.functions`` prints a table for one number that waits for the previous one, for one number of many, and for
vectors.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.llvm.machine import Kernel, vector_width
from barbalat.lowering.operations import Operation, Program
from barbalat.lowering.shape import LoopShape
from benchmarks.gcc import shared_library
from benchmarks.race import best_seconds

COUNT = 20_000
REPEATS = 40
RANGES = {
    "sin": (-100, 100), "cos": (-100, 100), "tan": (-100, 100), "exp": (-50, 50), "log": (0.1, 50), "tanh": (-5, 5),
    "atan": (-9, 9), "pow": (0.1, 50),
}  # fmt: skip
POWER = 1.3

_C = """
#include <math.h>
void each(const double *x, double *y, long n) {{ for (long i = 0; i < n; ++i) y[i] = {call}; }}
void chain(const double *x, double *y, long n) {{ double z = 0; for (long i = 0; i < n; ++i) z = {waiting}; y[0] = z; }}
"""


def library(name: str, x: np.ndarray, folder: Path) -> tuple[float, float]:
    """Times of the C library [ns] for one number that waits for the previous one, and for one of many."""
    (folder / name).mkdir()
    further = f", {POWER}" if function(name).arguments == 2 else ""
    source = _C.format(call=f"{name}(x[i]{further})", waiting=f"{name}(x[i] + z * 1e-300{further})")
    loaded, y = ctypes.CDLL(str(shared_library(source, "-O2 -fno-builtin", folder / name))), np.empty(len(x))
    calls = [lambda f=loaded[part]: f(ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data), ctypes.c_long(len(x)))
             for part in ("chain", "each")]  # fmt: skip
    waiting, single = (best_seconds(call, REPEATS) / len(x) * 1e9 for call in calls)
    return waiting, single


def chained(name: str, x: np.ndarray) -> float:
    """Time of the package's list [ns] if every argument needs the previous value."""
    ops = [Operation("input", source=(0, 0)), Operation("input", source=(3, 0)), Operation("constant", (), 1e-300)]
    ops += [Operation("mul", (0, 2)), Operation("add", (1, 3)), Operation("constant", (), POWER)]
    ops += [Operation(name, (4, 5)[: function(name).arguments])]
    kernel = Kernel(Program(tuple(ops), ((6,), (), ())), LoopShape(1, 0, 0, 1), (), 1)
    return best_seconds(kernel.bound(1, len(x), np.zeros(1), np.empty(0), x, np.empty(1)), REPEATS) / len(x) * 1e9


def spread(name: str, x: np.ndarray, lanes: int) -> float:
    """Time of the package's list [ns] for one of many numbers, several of which are computed at once."""
    arguments = function(name).arguments
    ops = [Operation("input", source=(5, 0)), Operation("constant", (), POWER), Operation(name, (0, 1)[:arguments])]
    kernel = Kernel(Program(tuple(ops), ((), (2,), ())), LoopShape(0, 1, 0, 0, noise=1), (0.0,), lanes)
    nothing, rows = np.empty(0), len(x) // lanes
    return best_seconds(kernel.bound(rows, 1, nothing, nothing, nothing, np.empty(len(x)), None, x), REPEATS) / len(x) * 1e9


def main() -> None:
    lanes = 2 * vector_width()
    print(f"ns of our list, and in brackets of the C library; {lanes} lanes are two vectors")
    print(f"{'':6}{'one that waits':>20}{'one of many':>20}{f'{lanes} lanes':>20}")
    with TemporaryDirectory() as folder:
        for name in sorted(FUNCTIONS):
            x = np.random.default_rng(1).uniform(*RANGES[name], COUNT)
            waiting, single = library(name, x, Path(folder))
            ours = chained(name, x), spread(name, x, 1), spread(name, x, lanes)
            pairs = zip(ours, (waiting, single, single), strict=True)
            cells = (f"{mine:.1f} ({theirs:.1f}, {mine / theirs:.2f} x)" for mine, theirs in pairs)
            print(f"{name:6}" + "".join(f"{cell:>20}" for cell in cells))


if __name__ == "__main__":
    main()
