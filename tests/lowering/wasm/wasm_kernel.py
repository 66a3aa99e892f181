"""A WebAssembly module with the interface of a kernel. Its arrays are copied into the module's memory and back. It has one
lane."""

from __future__ import annotations

import numpy as np
import wasmtime

from barbalat.lowering.llvm.machine import Rings, Watch
from barbalat.lowering.shape import ENTRY
from barbalat.lowering.wasm.loop import loop
from barbalat.run.kernel.step import StepProgram

_PAGE_BYTES = 65_536
_ENGINE = wasmtime.Engine()


class WasmKernel:
    """The counterpart of the native ``Kernel`` for the same program."""

    lanes = 1

    def __init__(self, program: StepProgram) -> None:
        resets = () if program.accumulators is None else program.accumulators.resets
        self.shape = program.shape
        self.bytes = loop(program.program, program.shape, resets, program.sample, program.watch)
        self.store = wasmtime.Store(_ENGINE)
        self.exports = wasmtime.Instance(self.store, wasmtime.Module(_ENGINE, self.bytes), []).exports(self.store)
        self.own = self.exports["memory"].data_len(self.store)

    def __call__(
        self, blocks, steps, state, parameters, signals, out, past: Rings | None = None, noise=None, watch: Watch | None = None,
        *, start=0, sample_every=None, noise_hold=None,
    ) -> None:  # fmt: skip
        nothing = np.zeros(0)
        lags, ring, mask = (nothing, nothing, 0) if past is None else (past.lags, past.ring, past.mask)
        watched, first, window = (nothing, 0, 1) if watch is None else (watch.rows, watch.first, watch.window)
        given = [state, parameters, signals, out, lags, ring, nothing if noise is None else noise, watched]
        at = self.put(given)
        counts = (start, mask, first, window, sample_every or 0, noise_hold or 0)
        self.run(blocks, steps, at, counts)
        for array, address in zip(given, at, strict=True):
            array[...] = self.taken(array, address)

    def put(self, arrays: list[np.ndarray]) -> list[int]:
        """Copy the arrays one after another into the memory and return their addresses."""
        memory, at, end = self.exports["memory"], [], self.own
        for array in arrays:
            at.append(end)
            end += array.nbytes
        if (missing := end - memory.data_len(self.store)) > 0:
            memory.grow(self.store, -(-missing // _PAGE_BYTES))
        for array, address in zip(arrays, at, strict=True):
            memory.write(self.store, array.tobytes(), address)
        return at

    def run(self, blocks: int, steps: int, at: list[int], counts: tuple[int, ...]) -> None:
        start, mask, first, window, sample_every, noise_hold = counts
        state, parameters, signals, out, lags, ring, noise, watched = at
        self.exports[ENTRY](
            self.store, blocks, steps, state, parameters, signals, out, start, lags, ring, mask, noise, watched, first, window,
            sample_every, noise_hold,
        )  # fmt: skip

    def taken(self, like: np.ndarray, address: int) -> np.ndarray:
        text = self.exports["memory"].read(self.store, address, address + like.nbytes)
        return np.frombuffer(bytes(text), dtype=like.dtype).reshape(like.shape)
