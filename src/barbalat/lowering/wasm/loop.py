"""Operation list -> a WebAssembly module with the kernel's time loop, for one member; see ``llvm.ir.loop`` for what it does.

The exported function has that loop's arguments in that order: addresses in the module's memory are 32 bits, counts 64. What
is free of the memory begins at ``free``, which a module exports as a function without arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from barbalat.lowering.functions import FUNCTIONS
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import ENTRY, WATCH_EVERY, LoopShape
from barbalat.lowering.wasm.encode import DOUBLE_BYTES, Code, Do, Type, module
from barbalat.lowering.wasm.functions import called_by, coded, tables_of
from barbalat.lowering.wasm.past import Taps
from barbalat.lowering.wasm.printer import Printer

ARGUMENTS = {
    "blocks": Type.I64, "steps": Type.I64, "state": Type.I32, "parameters": Type.I32, "signals": Type.I32, "out": Type.I32,
    "start": Type.I64, "lags": Type.I32, "ring": Type.I32, "mask": Type.I64, "noise": Type.I32, "watched": Type.I32,
    "watch_first": Type.I64, "watch_window": Type.I64, "sample_every": Type.I64, "noise_hold": Type.I64,
}  # fmt: skip
ARGUMENT_PLACES = {name: i for i, name in enumerate(ARGUMENTS)}


def loop(
    step: Program,
    shape: LoopShape,
    resets: tuple[float, ...],
    sample: Program | None = None,
    watch: Program | None = None,
    *,
    exported: Iterable[str] = (),
) -> bytes:
    """A module whose function ``barbalat_loop`` advances one member; ``exported`` names elementary functions for the host too.

    Raises ValueError for a list with fused multiply-adds, of which WebAssembly has none.
    """
    if (sample is None) != (shape.sample_every == 0):
        raise ValueError("a loop has a sampled part exactly where its shape says how often it acts")
    if shape.in_pieces and shape.delayed:
        raise ValueError("a step that remembers its past is not made in pieces")
    if strange := sorted(set(exported) - FUNCTIONS):
        raise ValueError(f"exported must be among {', '.join(sorted(FUNCTIONS))}, got {', '.join(strange)}")
    programs = [program for program in (step, sample, watch) if program is not None]
    names = sorted({*called_by(programs), *exported})
    tables, data = tables_of(names)
    functions = [coded(name, tables) for name in names]
    called = {name: i for i, name in enumerate(names)}
    main = _Loop(shape, resets, Code(tuple(ARGUMENTS.values()))).printed(
        step, sample, watch, lambda program, code, inputs: Printer(program, code, inputs, called, tables)
    )
    free = Code((), Type.I32)
    free.i32(len(data))
    exports = [(ENTRY, len(functions)), ("free", len(functions) + 1), *((name, called[name]) for name in exported)]
    return module([*functions, main, free], exports, data)


Printing = Callable[[Program, Code, dict[tuple[int, int], int]], Printer]


@dataclass(eq=False)
class _Loop:
    """The loop's code, part by part in the order of execution. Local variables are numbers of the code."""

    shape: LoopShape
    resets: tuple[float, ...]
    code: Code
    x: list[int] = field(default_factory=list)
    a: list[int] = field(default_factory=list)
    s: list[int] = field(default_factory=list)
    n: list[int] = field(default_factory=list)

    def printed(self, step: Program, sample: Program | None, watch: Program | None, printing: Printing) -> Code:
        c, shape = self.code, self.shape
        self.x, self.a, self.s, self.n = (
            [c.local() for _ in range(size)] for size in (shape.states, shape.accumulators, shape.signals, shape.noise)
        )
        p = [c.local() for _ in range(shape.parameters)]
        past = Taps(shape, c, {name: ARGUMENT_PLACES[name] for name in ("lags", "ring", "mask")})
        parts = (self.x, self.a, p, self.s, past.values, self.n)
        inputs = {(k, i): place for k, part in enumerate(parts) for i, place in enumerate(part)}
        for places, base in ((self.x, "state"), (p, "parameters")):
            self._load(places, ARGUMENT_PLACES[base])
        past.before_the_loop()
        printers = [None if program is None else printing(program, c, inputs) for program in (step, sample, watch)]
        for printer in printers:
            if printer is not None:
                printer.before_the_loop()
        stepping, sampling, watching = printers
        assert stepping is not None
        self._blocks(stepping, sampling, watching, past)
        self._store(ARGUMENT_PLACES["state"], self.x)
        return c

    def _blocks(self, stepping: Printer, sampling: Printer | None, watching: Printer | None, past: Taps) -> None:
        c, shape, size = self.code, self.shape, self.shape.states + self.shape.accumulators
        now, left, first_noise = (c.local(Type.I64) for _ in range(3))
        c.get(ARGUMENT_PLACES["start"])
        c.set(now)
        if shape.noise:
            self._divided(ARGUMENT_PLACES["start"], shape.noise_hold, "noise_hold", Do.I64_DIV_U)
            c.set(first_noise)
        c.begin_loop()
        self._store(ARGUMENT_PLACES["out"], self.x)
        for place, reset in zip(self.a, self.resets, strict=True):
            c.f64(reset)
            c.set(place)
        c.get(ARGUMENT_PLACES["steps"])
        c.set(left)
        c.begin_loop()
        self._step(stepping, sampling, watching, past, now, first_noise)
        for place, change in ((now, Do.I64_ADD), (left, Do.I64_SUB)):
            c.get(place)
            self._steps_ended()
            c.do(change)
            c.set(place)
        c.get(left)
        c.do(Do.I64_EQZ, Do.I32_EQZ)
        c.again_if()
        c.end()
        self._store(ARGUMENT_PLACES["out"], self.a, first=shape.states)
        self._forward(ARGUMENT_PLACES["out"], size)
        c.get(ARGUMENT_PLACES["blocks"])
        c.i64(1)
        c.do(Do.I64_SUB)
        c.tee(ARGUMENT_PLACES["blocks"])
        c.do(Do.I64_EQZ, Do.I32_EQZ)
        c.again_if()
        c.end()

    def _step(
        self, stepping: Printer, sampling: Printer | None, watching: Printer | None, past: Taps, now: int, first_noise: int
    ) -> None:
        c, shape = self.code, self.shape
        self._load(self.s, ARGUMENT_PLACES["signals"])
        self._forward(ARGUMENT_PLACES["signals"], shape.signals)
        if shape.noise:
            row = c.local(Type.I32)
            c.get(ARGUMENT_PLACES["noise"])
            self._divided(now, shape.noise_hold, "noise_hold", Do.I64_DIV_U)
            c.get(first_noise)
            c.do(Do.I64_SUB)
            c.i64(shape.noise * DOUBLE_BYTES)
            c.do(Do.I64_MUL, Do.I32_WRAP_I64, Do.I32_ADD)
            c.set(row)
            self._load(self.n, row)
        if sampling is not None:
            self._divided(now, shape.sample_every, "sample_every", Do.I64_REM_U)
            self._if_due()
            sampling.run()
            self._replace(sampling, self.x)
            c.end()
        if watching is not None:
            c.get(now)
            c.i64(WATCH_EVERY)
            c.do(Do.I64_REM_U)
            self._if_due()
            self._keep_largest(watching, now)
            c.end()
        past.read(now)
        stepping.run()
        remembered = stepping.outputs[-1] if shape.delayed else ()
        past.remember(now, [self._in_local(stepping, i) for i in remembered])
        self._replace(stepping, [*self.x, *self.a])

    def _in_local(self, printer: Printer, i: int) -> int:
        place = self.code.local()
        printer.number(i)
        self.code.set(place)
        return place

    def _replace(self, printer: Printer, places: Sequence[int]) -> None:
        """All at once: new values first go onto the stack."""
        new = [i for row in printer.outputs for i in row][: len(places)]
        for i in new:
            printer.number(i)
        for place in reversed(places):
            self.code.set(place)

    def _keep_largest(self, watching: Printer, now: int) -> None:
        c, quantity, row = self.code, self.code.local(), self.code.local(Type.I32)
        watching.run()
        watching.number(watching.outputs[0][0])
        c.set(quantity)
        c.get(ARGUMENT_PLACES["watched"], now, ARGUMENT_PLACES["watch_first"])
        c.do(Do.I64_SUB)
        c.get(ARGUMENT_PLACES["watch_window"])
        c.do(Do.I64_DIV_U)
        c.i64((self.shape.states + 2) * DOUBLE_BYTES)
        c.do(Do.I64_MUL, Do.I32_WRAP_I64, Do.I32_ADD)
        c.set(row)
        c.get(quantity, row)
        c.load()
        c.do(Do.F64_GT)
        c.begin_if()
        self._store(row, [quantity, *self.x])
        c.get(row, now)
        c.do(Do.F64_CONVERT_I64_S)
        c.store(self.shape.states + 1)
        c.end()

    def _load(self, places: Sequence[int], address: int) -> None:
        for i, place in enumerate(places):
            self.code.get(address)
            self.code.load(i)
            self.code.set(place)

    def _store(self, address: int, places: Sequence[int], first: int = 0) -> None:
        for i, place in enumerate(places, start=first):
            self.code.get(address, place)
            self.code.store(i)

    def _forward(self, address: int, doubles: int) -> None:
        self.code.get(address)
        self.code.i32(doubles * DOUBLE_BYTES)
        self.code.do(Do.I32_ADD)
        self.code.set(address)

    def _divided(self, place: int, compiled: int | None, argument: str, by: Do) -> None:
        """A number of steps by a count that is compiled in, or an argument."""
        self.code.get(place)
        if compiled is None:
            self.code.get(ARGUMENT_PLACES[argument])
        else:
            self.code.i64(compiled)
        self.code.do(by)

    def _if_due(self) -> None:
        """Whether the phase on the stack is over, before a step and not between two of its pieces."""
        c = self.code
        c.do(Do.I64_EQZ)
        if self.shape.in_pieces:
            c.get(self.s[-2])
            c.f64(0.0)
            c.do(Do.F64_NE, Do.I32_AND)
        c.begin_if()

    def _steps_ended(self) -> None:
        """1, or 0 after a piece that does not end its step."""
        c = self.code
        if not self.shape.in_pieces:
            c.i64(1)
            return
        c.get(self.s[-1])
        c.f64(0.0)
        c.do(Do.F64_NE, Do.I64_EXTEND_I32_U)
