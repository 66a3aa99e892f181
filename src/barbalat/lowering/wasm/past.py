"""A step's memory of the past: the ring of ``llvm.past``, read and written by WebAssembly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from barbalat.lowering.shape import TAPS_PER_CHANNEL, LoopShape
from barbalat.lowering.wasm.encode import DOUBLE_BYTES, Code, Do, Type


class Taps:
    """``values`` are the local variables of what was remembered, the taps of the first channel first."""

    def __init__(self, shape: LoopShape, code: Code, at: Mapping[str, int]) -> None:
        self.channels, self.code, self.at = shape.delayed, code, at
        self.values = [code.local() for _ in range(shape.delayed * TAPS_PER_CHANNEL)]
        self.lag, self.slot, self.row = code.local(Type.I64), code.local(Type.I64), code.local(Type.I32)

    def before_the_loop(self) -> None:
        if self.channels:
            self.code.get(self.at["lags"])
            self.code.load_whole()
            self.code.set(self.lag)

    def read(self, now: int) -> None:
        """What was remembered lag + tap steps ago."""
        if not self.channels:
            return
        c = self.code
        c.get(now, self.lag)
        c.do(Do.I64_SUB)
        c.i64(TAPS_PER_CHANNEL - 1)
        c.do(Do.I64_SUB)
        c.get(self.at["mask"])
        c.do(Do.I64_AND)
        c.set(self.slot)
        self._address()
        for channel in range(self.channels):
            for tap in range(TAPS_PER_CHANNEL):
                c.get(self.row)
                c.load((TAPS_PER_CHANNEL - 1 - tap) * self.channels + channel)
                c.set(self.values[channel * TAPS_PER_CHANNEL + tap])

    def remember(self, now: int, values: Sequence[int]) -> None:
        """Store the channels' values at the step's start; the ring's first rows stand once more behind its last."""
        if not self.channels:
            return
        c = self.code
        c.get(now, self.at["mask"])
        c.do(Do.I64_AND)
        c.set(self.slot)
        self._store(values)
        c.get(self.slot)
        c.i64(TAPS_PER_CHANNEL - 1)
        c.do(Do.I64_LT_U)
        c.begin_if()
        c.get(self.slot, self.at["mask"])
        c.do(Do.I64_ADD)
        c.i64(1)
        c.do(Do.I64_ADD)
        c.set(self.slot)
        self._store(values)
        c.end()

    def _address(self) -> None:
        c = self.code
        c.get(self.at["ring"], self.slot)
        c.i64(self.channels * DOUBLE_BYTES)
        c.do(Do.I64_MUL, Do.I32_WRAP_I64, Do.I32_ADD)
        c.set(self.row)

    def _store(self, values: Sequence[int]) -> None:
        self._address()
        for channel, value in enumerate(values):
            self.code.get(self.row, value)
            self.code.store(channel)
