"""The elementary functions' lists in 32 bits: their C is compared with 64-bit functions, whose error is negligible here, and with
the same lists evaluated by NumPy operation by operation.
"""

from __future__ import annotations

import ctypes
import math
import subprocess

import numpy as np
import pytest
from scipy.special import ndtri

from barbalat.export.evaluation import evaluate
from barbalat.lowering import c99
from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.functions.formats import SINGLE
from barbalat.lowering.operations import Operation, Program
from lowering.test_c99 import needs_gcc

EXACT = {
    "pow": np.power, "atan": np.arctan, "ndtri": ndtri,
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "tanh")},
}  # fmt: skip
NORMAL = 7.0
"""Largest error of ndtri in units of the last place, as in 64 bits. Near 1/2 the difference from 1/2 is rounded, and noise need
not be exact."""
F32 = np.float32


def calling(name: str) -> Program:
    count = function(name).arguments
    operations = (*(Operation("input", source=(0, i)) for i in range(count)), Operation(name, tuple(range(count))))
    return Program(operations, ((count,),))


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """All functions as in an export, without 64-bit numbers, which the compiler would report."""
    folder = tmp_path_factory.mktemp("single")
    text = "#include <math.h>\n#include <stdint.h>\n#include <string.h>\n"
    text += c99.definitions([calling(name) for name in sorted(FUNCTIONS)], c99.FLOAT)
    for name in sorted(FUNCTIONS):
        call = ", ".join(f"x[{i} * count + k]" for i in range(function(name).arguments))
        text += f"void all_{name}(int count, const float *x, float *y)\n{{\n    int k;\n    for (k = 0; k < count; ++k) {{\n"
        text += f"        y[k] = barbalat_{name}({call});\n    }}\n}}\n"
    (folder / "single.c").write_text(text)
    strict = ["-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
    command = ["gcc", "-std=c99", "-ffp-contract=off", "-O2", *strict, "-shared", "-fPIC", "single.c", "-o", "single.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return ctypes.CDLL(str(folder / "single.so"))


def computed(library, name: str, *x: np.ndarray) -> np.ndarray:
    given, found = np.ascontiguousarray(x, dtype=F32), np.empty(len(x[0]), F32)
    library[f"all_{name}"](len(found), ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(found.ctypes.data))
    return found


def ulps(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Errors in units of the last place. A value that rounds to infinity has to be infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        nearest = exact.astype(F32)
        unit = np.maximum(np.exp2(np.floor(np.log2(np.maximum(np.abs(exact), 1e-300))) - 23), 2.0**-149)
        error = np.abs(found.astype(float) - exact) / unit
    both = (np.isnan(found) & np.isnan(exact)) | (found == nearest)
    return np.where(both, np.where(np.isfinite(error), error, 0.0), np.where(np.isfinite(error), error, np.inf))


def points(name: str, step: int) -> tuple[np.ndarray, ...]:
    """Every n-th of all floats. For two arguments, random floats of all sizes and near 1."""
    bits = np.arange(0, 2**32, step, dtype=np.uint32)
    every = bits.view(F32)
    if function(name).arguments == 1:
        return (every,)
    random = np.random.default_rng(3)
    size = len(bits)
    near = (1 + random.uniform(-0.1, 0.1, size) * 2.0 ** -random.integers(0, 20, size)).astype(F32)
    x = np.concatenate([np.abs(random.permutation(every)), near, random.uniform(1e-3, 1e3, size).astype(F32)])
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        fitting = (random.uniform(-150, 128, size) / np.log2(near.astype(float))).astype(F32)
    return x, np.concatenate([random.permutation(every), fitting, random.uniform(-12, 12, size).astype(F32)])


@needs_gcc
@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_the_error_is_below_a_unit_in_the_last_place(name, library, sample) -> None:
    x = points(name, sample(40009, 997))
    with np.errstate(all="ignore"):
        exact = EXACT[name](*(part.astype(float) for part in x))
    errors = ulps(computed(library, name, *x), exact)
    worst = int(np.argmax(errors))
    limit = NORMAL if name == "ndtri" else 1  # the error that fdlibm promises for its format
    assert errors[worst] < limit, [float(part[worst]) for part in x]


@needs_gcc
@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_c_and_numpy_compute_the_same_bits(name, library, sample) -> None:
    """The lists come from the test vectors of an export."""
    random = np.random.default_rng(7)
    x = [random.permutation(part)[: sample(30, 1000)] for part in points(name, 40009)]
    x = [np.concatenate([part, random.uniform(-5, 5, sample(30, 1000)).astype(F32)]) for part in x]
    program = calling(name)
    expected = evaluate(program, {(0, i): part for i, part in enumerate(x)}, c99.FLOAT)[0]
    found = computed(library, name, *x)
    assert np.array_equal(found.view(np.int32)[~np.isnan(found)], expected.view(np.int32)[~np.isnan(found)])
    assert np.isnan(expected[np.isnan(found)]).all()


@needs_gcc
def test_arguments_that_are_special_or_next_to_a_multiple_of_a_quarter_turn(library) -> None:
    """IEEE 754's values and, for every n up to 10^5, the floats nearest to n pi/2, where all except the last bits cancel."""
    inf, nan = math.inf, math.nan
    for name, x, y in (
        ("sin", (0.0, -0.0, inf, nan), (0.0, -0.0, nan, nan)),
        ("exp", (inf, -inf, nan, 0.0), (inf, 0.0, nan, 1.0)),
        ("log", (0.0, -1.0, inf, nan, 1.0), (-inf, nan, inf, nan, 0.0)),
        ("tanh", (inf, -inf, nan, -0.0), (1.0, -1.0, nan, -0.0)),
        ("atan", (inf, -inf, nan, -0.0), (math.pi / 2, -math.pi / 2, nan, -0.0)),
    ):
        found, expected = computed(library, name, np.array(x, F32)), np.array(y, F32)
        assert np.array_equal(found, expected, equal_nan=True), name
        assert np.array_equal(np.signbit(found[~np.isnan(found)]), np.signbit(expected[~np.isnan(expected)]))
    n = np.arange(1, 100_001) * (math.pi / 2)
    for x in (n.astype(F32), (n * 1e6).astype(F32)):
        for name in ("sin", "cos", "tan"):
            assert ulps(computed(library, name, x), EXACT[name](x.astype(float))).max() < 1


def test_the_constants_are_floats() -> None:
    """Rounding a part of a constant again would lose the digits of the next part."""
    for name in ("exp", "sin", "tan", "atan", "pow"):
        made = function(name, SINGLE)
        for part in filter(None, (made.usual, made.rare)):
            for op in part.operations:
                for value in op.table:
                    assert float(F32(value)) == value
