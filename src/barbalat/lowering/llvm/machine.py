"""Translates LLVM IR to machine code for this computer, which Python calls without the interpreter's lock."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import ParamSpec

import llvmlite.binding as llvm
import numpy as np
from llvmlite.binding.newpassmanagers import NewPassManager

from barbalat.lowering.llvm import ir
from barbalat.lowering.llvm.ir import ExternalFunction
from barbalat.lowering.operations import Program
from barbalat.lowering.registers import few_waiting
from barbalat.lowering.shape import ENTRY, TAPS_PER_CHANNEL, WATCH_EVERY, LoopShape, require_count

Given = ParamSpec("Given")


@cache
def _target() -> llvm.Target:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple()


@cache
def vector_width() -> int:
    """Doubles in one vector register of this computer."""
    features = llvm.get_host_cpu_features()
    return 8 if features.get("avx512f") else 4 if features.get("avx") else 2


def many_registers() -> bool:
    """Whether this computer has 32 vector registers; x86 without AVX-512 has 16."""
    features = llvm.get_host_cpu_features()
    return bool(features.get("avx512f")) or "sse2" not in features


_SCHEDULER = threading.Lock()


@contextmanager
def _unscheduled() -> Iterator[None]:
    """Makes LLVM keep the list's order of operations. The switch applies to the whole process, so it is reset afterwards.

    LLVM's scheduler moves long chains forward, which is suitable for one member. With two vectors of members in 16 registers it
    costs one sixth of the speed, because values are spilled (docs/laboratory/kernel.md).
    """
    with _SCHEDULER:
        llvm.set_option("", "-enable-misched=false")
        try:
            yield
        finally:
            llvm.set_option("", "-enable-misched=true")


def remembered(lag: int) -> int:
    """Number of steps in a ring for this lag: a power of two, plus the repeated first rows."""
    return (1 << (lag + TAPS_PER_CHANNEL - 1).bit_length()) - 1 + TAPS_PER_CHANNEL


class Rings:
    """The memory of a group of members between calls.

    lags     (W,) int64, at least 1: the age, in steps, of the newest value that a member's step receives
    history  (channels, W): the value of every channel before t = 0
    """

    def __init__(self, lags: np.ndarray, history: np.ndarray) -> None:
        if lags.min() < 1:
            raise ValueError(f"lags must be at least 1, got {lags.min()}")
        self.lags = np.ascontiguousarray(lags, dtype=np.int64)
        self.history = history
        self.mask = remembered(int(lags.max())) - TAPS_PER_CHANNEL
        self.ring = np.tile(history, (self.mask + TAPS_PER_CHANNEL, 1, 1))


class Watch:
    """The record of a kernel with a monitored quantity: a row for each of ``windows`` windows of steps, from step ``first`` on.

    A row contains the largest value, and the state and the number of the step at which it occurred; minus infinity if there was
    no value. For members in several ``lanes``, a row contains only their largest values.
    """

    def __init__(self, states: int, first: int, stop: int, window: int, lanes: int = 1) -> None:
        self.first, self.stop, self.window, self.states, self.lanes = first, stop, window, states, lanes
        self.rows = np.full((-(-(stop - first) // window), states + 2 if lanes == 1 else lanes), -np.inf)

    def elsewhere(self, first: int, stop: int) -> Watch:
        """A watch of the same kind for different steps, as one window."""
        return Watch(self.states, first, stop, -(-(stop - first) // WATCH_EVERY) * WATCH_EVERY, self.lanes)


def _at_once(bound: Callable[Given, Callable[[], None]]) -> Callable[Given, None]:
    def call(*given: Given.args, **named: Given.kwargs) -> None:
        """Call the function that ``bound`` returns, once."""
        bound(*given, **named)()

    return call


def _engine(source: str, *, quickly: bool) -> llvm.ExecutionEngine:
    """The execution engine of a module, before the machine code is made."""
    target = _target()
    machine = target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=0 if quickly else 3
    )
    module = llvm.parse_assembly(source)
    module.triple = target.triple
    module.data_layout = str(machine.target_data)
    # The operations are already optimised: further passes would find nothing, and take longer than code generation.
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options())
    pipeline = llvm.create_new_module_pass_manager()
    pipeline.add_instruction_combine_pass()  # addresses: without this, a step of quickly compiled code takes a third longer
    pipeline.run(module, passes)
    NewPassManager._dispose(pipeline)  # frees 0.1 to 0.2 MB; in llvmlite 0.50 the base class frees nothing
    pipeline.detach()
    return llvm.create_mcjit_compiler(module, machine)


class Kernel:
    """A compiled loop; one call advances ``lanes`` members by ``blocks * steps`` steps.

    The call releases the interpreter's lock, writes only into the arrays it receives, and may run in many threads at once.
    """

    def __init__(
        self,
        step: Program,
        shape: LoopShape,
        resets: tuple[float, ...],
        lanes: int,
        sample: Program | None = None,
        watch: Program | None = None,
        *,
        outside: ExternalFunction | None = None,
        quickly: bool = False,
    ) -> None:
        """With ``quickly``, compilation takes one fifth of the time and the code is two to three times slower; the results are
        bit-identical."""
        if lanes < 1 or lanes & (lanes - 1):
            raise ValueError(f"lanes must be a power of two, got {lanes}")
        self.shape = shape
        self.lanes = lanes
        self.watches = watch is not None
        if lanes > 1:
            step = few_waiting(step, urgent_first=many_registers())
        self.ir = ir.loop(step, shape, resets, lanes, sample, watch, outside)
        self._engine = _engine(self.ir, quickly=quickly)
        with nullcontext() if lanes == 1 or many_registers() else _unscheduled():
            self._engine.finalize_object()
        i64, pointer = ctypes.c_int64, ctypes.c_void_p
        run, memory, windows = (i64, i64, *[pointer] * 4, i64), (pointer, pointer, i64, pointer), (pointer, i64, i64)
        prototype = ctypes.CFUNCTYPE(None, *run, *memory, *windows, i64, i64)
        self._call = prototype(self._engine.get_function_address(ENTRY))

    def bound(
        self,
        blocks: int,
        steps: int,
        state: np.ndarray,
        parameters: np.ndarray,
        signals: np.ndarray,
        out: np.ndarray,
        past: Rings | None = None,
        noise: np.ndarray | None = None,
        watch: Watch | None = None,
        *,
        records: np.ndarray | None = None,
        start: int = 0,
        sample_every: int | None = None,
        noise_hold: int | None = None,
    ) -> Callable[[], None]:
        """Return the call with these arrays, which are checked once, for repeated use; it keeps the arrays alive.

        For shapes, see ``llvm.ir.loop``; all arrays are C-contiguous float64.

        past   required for a step with delays
        noise  required for a step with noise
        watch  required for a kernel that monitors; its windows must cover all steps
        records  (W R, width), R for each member; required for a step that reads records of earlier steps, with room for those of
                 this call
        start  number of the first step since t = 0
        sample_every, noise_hold  if the shape does not fix them
        """
        w, s = self.lanes, self.shape
        every, hold = _count("sample_every", s.sample_every, sample_every), _count("noise_hold", s.noise_hold, noise_hold)
        expected = {
            "state": (state, s.states * w),
            "parameters": (parameters, s.parameters * w),
            "signals": (signals, s.signals if s.signal_row is not None else blocks * steps * s.signals),
            "out": (out, blocks * (s.states + s.accumulators) * w),
        }
        if noise is not None:
            rows = (start + blocks * steps - 1) // hold - start // hold + 1
            expected["noise"] = (noise, rows * s.noise * w)
        if s.recalled is not None and records is not None:
            latest = int(np.reshape(state, (-1, w))[s.recalled.last].max())
            rows = max(latest + blocks * steps + s.recalled.records, len(records) // w)
            expected["records"] = (records, w * rows * s.recalled.width)
        _require_sizes(expected)
        self._require_parts(start, start + blocks * steps, signals, past, noise, watch, records)
        arrays = (state.ctypes.data, parameters.ctypes.data, signals.ctypes.data, out.ctypes.data)
        lags, ring, mask = (
            (None, records, 0 if records is None else len(records) // w)
            if past is None
            else (past.lags.ctypes.data, past.ring, past.mask)
        )
        memory = lags, None if ring is None else ring.ctypes.data, mask
        windows = (None, 0, 1) if watch is None else (watch.rows.ctypes.data, watch.first, watch.window)
        arguments = (blocks, steps, *arrays, start, *memory, None if noise is None else noise.ctypes.data, *windows, every, hold)
        call, alive = self._call, (self, state, parameters, signals, out, past, noise, watch, records)

        def again() -> None:
            assert alive  # kept alive by this closure, because the call's arguments are plain addresses
            call(*arguments)

        return again

    def _require_parts(
        self,
        start: int,
        stop: int,
        signals: np.ndarray,
        past: Rings | None,
        noise: np.ndarray | None,
        watch: Watch | None,
        records: np.ndarray | None,
    ) -> None:
        """Raise ValueError if a call lacks an argument that this kernel needs, or has an argument that it does not use."""
        s = self.shape
        if s.in_pieces and (signals[:, -1].sum() != stop - start or signals[-1, -1] != 1):
            raise ValueError(f"the pieces of {stop - start} steps must end that many steps, got {signals[:, -1].sum():g}")
        recalled = 0 if s.recalled is None else s.recalled.width
        for what, given, count in (("a past", past, s.delayed), ("noise", noise, s.noise), ("records", records, recalled)):
            if (given is None) != (count == 0):
                raise ValueError(
                    f"a kernel with {count} channels that need {what} was called {'without' if given is None else 'with'} it"
                )
        if (watch is None) == self.watches:
            raise ValueError(f"a kernel that {'watches' if self.watches else 'does not watch'} was called {watch}")
        if watch is not None and watch.lanes != self.lanes:
            raise ValueError(f"a kernel of {self.lanes} lanes was called with a watch of {watch.lanes}")
        if watch is not None and not watch.first <= start <= stop <= watch.stop:
            raise ValueError(f"steps {start} to {stop} are outside the windows from {watch.first} to {watch.stop}")

    __call__ = _at_once(bound)


def _require_sizes(expected: Mapping[str, tuple[np.ndarray, int]]) -> None:
    """Raise ValueError, with the name and required size of an array, if the machine code would access it beyond its end."""
    for name, (array, size) in expected.items():
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.size < size:
            raise ValueError(f"{name} must be C-contiguous float64 with at least {size} entries, got {array.shape} {array.dtype}")


def _count(name: str, compiled: int | None, given: int | None) -> int:
    """The compiled-in number, or the call's argument."""
    if compiled is not None:
        if given not in (None, compiled):
            raise ValueError(f"{name} = {compiled} is compiled in, got {given}")
        return compiled
    if given is None:
        raise ValueError(f"this kernel needs {name} with every call")
    require_count(name, given, least=1)
    return given
