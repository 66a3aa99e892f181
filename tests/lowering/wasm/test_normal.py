"""Noise in WebAssembly equals NumPy's Philox and the native list bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.lowering.wasm.normal import ENTRY, normal_module
from barbalat.problem.measurement import LARGEST_SEED
from barbalat.run.kernel.portable import standard_normal
from lowering.test_c99 import same_bits

wasmtime = pytest.importorskip("wasmtime", reason="wasmtime is not installed")


def drawn(channels: int, seed: int, member: int, first: int, rows: int) -> np.ndarray:
    engine = wasmtime.Engine()
    store = wasmtime.Store(engine)
    exports = wasmtime.Instance(store, wasmtime.Module(engine, normal_module(channels)), []).exports(store)
    begin, size = exports["memory"].data_len(store), rows * channels * 8
    exports["memory"].grow(store, 1 + size // 65_536)
    exports[ENTRY](store, *(word - 2**64 if word >= 2**63 else word for word in (seed, member, first, rows)), begin)
    return np.frombuffer(bytes(exports["memory"].read(store, begin, begin + size))).reshape(rows, channels)


@pytest.mark.parametrize(("channels", "seed", "member", "first"), [
    (1, 0, 0, 0), (2, 7, 0, 12345), (4, LARGEST_SEED, 3, 1), (5, 2**63, LARGEST_SEED, 2**40), (9, 123456789, 1, 77),
])  # fmt: skip
def test_a_page_s_noise_is_a_run_s(channels, seed, member, first) -> None:
    rows = 3000
    assert same_bits(drawn(channels, seed, member, first, rows), standard_normal(seed, member, first, rows, channels))
