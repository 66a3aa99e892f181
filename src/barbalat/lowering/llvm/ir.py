"""Translates an operation list to LLVM IR text: one step with the time loop around it, for a vector of W members at once.

The step's outputs become its inputs again ("carry"). Part of the carry, the accumulators, is reset at the start of every block of
steps and written out at its end, so that metrics over all steps need no memory. The kernel has no other function.

A quantity may be monitored: every window of steps keeps its largest value, with the state and the step at which it occurred. It
is evaluated before every WATCH_EVERY-th step, counted from t = 0. Windows are independent of blocks. NaN is never the largest
value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barbalat.lowering.llvm.loads import (
    count,
    due,
    keep_record,
    lag_loads,
    noise_loads,
    past_loads,
    record_loads,
    remember,
    row_number,
    signal_loads,
)
from barbalat.lowering.llvm.printer import Printer, definitions
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import ENTRY, TAPS_PER_CHANNEL, WATCH_EVERY, LoopShape


@dataclass(frozen=True, slots=True)
class ExternalFunction:
    """``void function(double *numbers, int64_t step)`` at an address of this process, called at every sample.

    given  rows of the state as computed by the list at this sample; they come first in ``numbers``
    kept   rows whose old values follow, which the function replaces by the new values
    """

    address: int
    given: tuple[int, ...]
    kept: tuple[int, ...]

    @property
    def room(self) -> str:
        """Memory on the loop's stack, reserved once."""
        return f"  %outside = alloca [{len(self.given) + len(self.kept)} x double], align 8"

    def call(self, sampled: Sequence[str]) -> tuple[list[str], list[str]]:
        """Lines of LLVM IR, and the names of the state's values afterwards: ``sampled``, except for those that are kept."""
        numbers = [*(sampled[row] for row in self.given), *(f"%x{row}.held" for row in self.kept)]
        lines, after = [], list(sampled)
        for i, value in enumerate(numbers):
            lines.append(f"  %outside.{i} = getelementptr double, ptr %outside, i64 {i}")
            lines.append(f"  store double {value}, ptr %outside.{i}, align 8")
        lines.append(f"  call void inttoptr (i64 {self.address} to ptr)(ptr %outside, i64 %now)")
        for i, row in enumerate(self.kept, start=len(self.given)):
            lines.append(f"  %outside.new{i} = load double, ptr %outside.{i}, align 8")
            after[row] = f"%outside.new{i}"
        return lines, after


LAST_BLOCK = "kept"
"""The last basic block of a step that has a watch."""

LONGEST_INSIDE = 4000
"""Largest number of operations of a quantity that is compiled with the step. LLVM takes minutes for a block of some 30,000
operations."""


def called(lines: list[str], quantity: str, used: list[str]) -> tuple[list[str], list[str], list[str]]:
    """Return a separate function for a long quantity, its memory on the stack, and its call. LLVM does not optimise the function.
    ``used`` are the values of the loop that its ``lines`` read. The operations and their order stay the same, and so does every
    bit.
    """
    reads, passes = [], []
    for i, name in enumerate(used):
        place = f"getelementptr double, ptr %looked.at, i64 {i}"
        reads += [f"  {name}.at = {place}", f"  {name} = load double, ptr {name}.at, align 8"]
        passes += [f"  %looked.at{i} = {place}", f"  store double {name}, ptr %looked.at{i}, align 8"]
    function = [
        "define internal double @barbalat_look(ptr noalias %looked.at) noinline optnone {",
        "entry:", *reads, *lines, f"  ret double {quantity}", "}",
    ]  # fmt: skip
    room = [f"  %looked.at = alloca double, i64 {max(len(used), 1)}, align 8"]
    return function, room, [*passes, "  %looked = call double @barbalat_look(ptr %looked.at)"]


def keep_largest(states: int, lines: list[str], quantity: str, due: list[str]) -> list[str]:
    """``lines`` compute the quantity; ``due`` computes %watch.due from %watch.phase.

    New largest values are rare, so a branch is cheaper than a selection for every entry of the state.
    """
    stores = []
    for i in range(states):
        stores += [
            f"  %kept{i}.to = getelementptr double, ptr %watch.row, i64 {1 + i}",
            f"  store double %x{i}, ptr %kept{i}.to, align 8",
        ]
    return [
        f"  %watch.phase = urem i64 %now, {WATCH_EVERY}",
        *due,
        f"  br i1 %watch.due, label %watch, label %{LAST_BLOCK}",
        "watch:",
        "  %watch.since = sub i64 %now, %watch.first",
        "  %watch.at = udiv i64 %watch.since, %watch.window",
        f"  %watch.offset = mul i64 %watch.at, {states + 2}",
        "  %watch.row = getelementptr double, ptr %watched, i64 %watch.offset",
        "  %best = load double, ptr %watch.row, align 8",
        *lines,
        f"  %better = fcmp ogt double {quantity}, %best",
        f"  br i1 %better, label %keep, label %{LAST_BLOCK}",
        "keep:",
        f"  store double {quantity}, ptr %watch.row, align 8",
        *stores,
        "  %kept.step = sitofp i64 %now to double",
        f"  %kept.step.to = getelementptr double, ptr %watch.row, i64 {states + 1}",
        "  store double %kept.step, ptr %kept.step.to, align 8",
        f"  br label %{LAST_BLOCK}",
        f"{LAST_BLOCK}:",
    ]


def keep_largest_values(lanes: int, lines: list[str], quantity: str, due: list[str]) -> list[str]:
    """The IR that keeps the largest value for parallel members, each of which has a separate largest value."""
    vector, mask = f"<{lanes} x double>", f"<{lanes} x i1>"
    return [
        f"  %watch.phase = urem i64 %now, {WATCH_EVERY}",
        *due,
        f"  br i1 %watch.due, label %watch, label %{LAST_BLOCK}",
        "watch:",
        "  %watch.since = sub i64 %now, %watch.first",
        "  %watch.at = udiv i64 %watch.since, %watch.window",
        f"  %watch.row = getelementptr {vector}, ptr %watched, i64 %watch.at",
        f"  %best = load {vector}, ptr %watch.row, align 8",
        *lines,
        f"  %better = fcmp ogt {vector} {quantity}, %best",
        f"  %largest = select {mask} %better, {vector} {quantity}, {vector} %best",
        f"  store {vector} %largest, ptr %watch.row, align 8",
        f"  br label %{LAST_BLOCK}",
        f"{LAST_BLOCK}:",
    ]


HEAD = (
    f"define void @{ENTRY}(i64 %blocks, i64 %steps, ptr noalias %state, ptr noalias %parameters, "
    "ptr noalias %signals, ptr noalias %out, i64 %start, ptr noalias %lags, ptr noalias %ring, i64 %mask, "
    "ptr noalias %noise, ptr noalias %watched, i64 %watch.first, i64 %watch.window, "
    "i64 %sample.every, i64 %noise.hold) alignstack(64) {"
)
"""The stack is aligned for whole vectors; otherwise every value that does not fit into registers would cost unaligned
accesses."""


def loop(
    step: Program,
    shape: LoopShape,
    resets: tuple[float, ...],
    lanes: int,
    sample: Program | None = None,
    watch: Program | None = None,
    outside: ExternalFunction | None = None,
) -> str:
    """IR of ``void barbalat_loop(blocks, steps, state*, parameters*, signals*, out*, start, lags*, ring*, mask, noise*)``.

    state       [states][W], in and out
    parameters  [parameters][W]
    signals     [blocks * steps][signals], the same for all W members; a row for each piece if steps come in pieces. With
                ``signal_row`` [rows][signals], or [rows][W][signals] with ``rows_per_member``
    out         [blocks][states + accumulators][W]: the state at the start of a block, the accumulators at its end
    start       number of the first step since t = 0
    lags        [W]: the newest value returned was stored ``lag`` steps ago, at least 1
    ring        [mask + TAPS_PER_CHANNEL][delayed][W]: stored values of a power of two of steps, followed by a copy of the first
                ones; the initial content is the past. With ``recalled`` [W][mask][width]: each member's records, and
                room for ``mask`` of them
    noise       [rows][noise][W]: a row for each ``noise_hold`` steps since t = 0; the first row is that of ``start``

    watched     rows of ``watch``, see ``keep_largest``; followed by the first step of the first window and the number of steps of
                each
    at last     ``sample_every`` and ``noise_hold``, which are read if the shape leaves them open

    Before a step whose number is a multiple of ``sample_every``, ``sample`` replaces the state. ``watch`` is a quantity whose
    largest value in every window of steps is kept, for a single member with the state there. ``outside`` computes a part of the
    sampled part, also for a single member only.
    """
    _require_fitting(shape, lanes, sample, watch, outside)
    inputs = _inputs(shape)
    printer = Printer(step, lanes, inputs)
    new = printer.run()
    body = _Body(shape, printer.vector, [printer.splat(value) for value in resets], new)
    sampling = _sampling(sample, shape, lanes, inputs, outside)
    watching = _watching(watch, shape, lanes, inputs)
    last = watching.last or sampling.last or "step"  # without both, the step is a single block
    functions, declared = definitions(printer.functions | sampling.functions | watching.functions, lanes)
    lines = [
        HEAD,
        *body.entry((*sampling.room, *watching.room), lanes),
        *body.block(),
        *body.step(last, ".held" if sample is not None else ""),
        *signal_loads(shape, lanes, printer.vector),
        *noise_loads(shape, printer.vector),
        *record_loads(shape, lanes, printer.vector),
        *sampling.lines,
        *watching.lines,
        *past_loads(shape, lanes, printer.vector),
        *printer.lines,
        *remember(shape, printer.vector, new[shape.states + shape.accumulators :]),
        *keep_record(shape, new[shape.states + shape.accumulators :], lanes, printer.vector),
        *body.end(),
        *watching.apart,
        *functions,
        *sorted(declared | printer.intrinsics | sampling.intrinsics | watching.intrinsics),
    ]
    return "\n".join(lines)


def _require_fitting(
    shape: LoopShape, lanes: int, sample: Program | None, watch: Program | None, outside: ExternalFunction | None
) -> None:
    if (sample is None) != (shape.sample_every == 0):
        raise ValueError(
            "a loop with a sampled part needs a shape with sample_every, and a loop without one needs a shape without it"
        )
    if shape.in_pieces and shape.delayed:
        raise ValueError("a step that remembers its past cannot be divided into pieces")
    if shape.recalled is not None and shape.delayed:
        raise ValueError(f"records of steps are for members without a lag, got {shape.delayed} channels")
    if watch is not None and lanes > 1 and len(watch.operations) > LONGEST_INSIDE:
        raise ValueError(f"a quantity of {len(watch.operations)} operations needs exactly one member, got {lanes} lanes")
    if outside is not None and (sample is None or lanes > 1):
        raise ValueError(f"a user-defined function needs a sampled part and exactly one member, got {sample} and {lanes} lanes")


def _inputs(shape: LoopShape) -> dict[tuple[int, int], str]:
    """The names of the step's arguments."""
    counts = {
        "x": shape.states,
        "a": shape.accumulators,
        "p": shape.parameters,
        "s": shape.signals,
        "d": shape.delayed * TAPS_PER_CHANNEL if shape.recalled is None else shape.recalled.records * shape.recalled.width,
        "n": shape.noise,
    }
    return {(k, i): f"%{name}{i}" for k, (name, size) in enumerate(counts.items()) for i in range(size)}


@dataclass(frozen=True)
class _Part:
    """The part of a step that precedes its main operations.

    last        its last block; empty if the step has no such part
    apart       a function outside the loop, and its memory on the loop's stack
    intrinsics  declarations that it needs
    functions   elementary functions that it calls
    """

    lines: tuple[str, ...] = ()
    last: str = ""
    apart: tuple[str, ...] = ()
    room: tuple[str, ...] = ()
    intrinsics: frozenset[str] = frozenset()
    functions: frozenset[str] = frozenset()


def _sampling(
    sample: Program | None, shape: LoopShape, lanes: int, inputs: dict[tuple[int, int], str], outside: ExternalFunction | None
) -> _Part:
    """The code that replaces the state before a step whose number is a multiple of ``sample_every``."""
    if sample is None:
        return _Part()
    n = shape.states
    sampler = Printer(sample, lanes, inputs | {(0, i): f"%x{i}.held" for i in range(n)}, prefix="w")
    sampled = sampler.run()
    called, sampled = ([], sampled) if outside is None else outside.call(sampled)
    lines = (
        *_due(shape, sampler),
        "  br i1 %due, label %sample, label %go",
        "sample:",
        *sampler.lines,
        *called,
        "  br label %go",
        "go:",
        *(f"  %x{i} = phi {sampler.vector} [ %x{i}.held, %step ], [ {sampled[i]}, %sample ]" for i in range(n)),
    )
    room = () if outside is None else (outside.room,)
    return _Part(lines, last="go", room=room, intrinsics=frozenset(sampler.intrinsics), functions=frozenset(sampler.functions))


def _due(shape: LoopShape, sampler: Printer) -> list[str]:
    """%due: whether the sampled part is called before this step; with ``sample_row``, whether any member requests it."""
    if shape.sample_row is None:
        return [f"  %phase = urem i64 %now, {count(shape.sample_every, 'sample.every')}", *due(shape, "due", "%phase")]
    zero, own = sampler.splat(0.0), f"%x{shape.sample_row}.held"
    if sampler.lanes == 1:
        return [f"  %due = fcmp une double {own}, {zero}"]
    sampler.intrinsics.add(f"declare i1 @llvm.vector.reduce.or.v{sampler.lanes}i1({sampler.mask})")
    return [
        f"  %asked = fcmp une {sampler.vector} {own}, {zero}",
        f"  %due = call i1 @llvm.vector.reduce.or.v{sampler.lanes}i1({sampler.mask} %asked)",
    ]


def _watching(watch: Program | None, shape: LoopShape, lanes: int, inputs: dict[tuple[int, int], str]) -> _Part:
    """The code that keeps the largest value of a quantity."""
    if watch is None:
        return _Part()
    watcher = Printer(watch, lanes, inputs, prefix="g")
    (quantity,) = watcher.run()
    looked: list[str] = watcher.lines
    looking_due = due(shape, "watch.due", "%watch.phase")
    if lanes > 1:
        kept = keep_largest_values(lanes, looked, quantity, looking_due)
        return _Part(tuple(kept), LAST_BLOCK, intrinsics=frozenset(watcher.intrinsics), functions=frozenset(watcher.functions))
    apart: list[str] = []
    room: list[str] = []
    if len(looked) > LONGEST_INSIDE:
        used = [inputs[op.source] for op in watch.operations if op.name == "input"]
        apart, room, looked = called(looked, quantity, used)
        quantity = "%looked"
    lines = keep_largest(shape.states, looked, quantity, looking_due)
    return _Part(tuple(lines), LAST_BLOCK, tuple(apart), tuple(room), frozenset(watcher.intrinsics), frozenset(watcher.functions))


@dataclass(frozen=True)
class _Body:
    """The blocks around the operations of a step; ``new`` are its results and ``resets`` the initial values of accumulators in a
    block."""

    shape: LoopShape
    vector: str
    resets: list[str]
    new: list[str]

    def entry(self, room: tuple[str, ...], lanes: int) -> list[str]:
        """The loads before the loop, which are executed once."""
        return [
            "entry:",
            *room,
            *(line for i in range(self.shape.states) for line in self._load(f"x{i}.0", "%state", i)),
            *(line for i in range(self.shape.parameters) for line in self._load(f"p{i}", "%parameters", i)),
            *lag_loads(self.shape, lanes),
            f"  %noise.first = udiv i64 %start, {count(self.shape.noise_hold, 'noise.hold')}",
            "  br label %block",
        ]

    def block(self) -> list[str]:
        """The start of a block of steps, where the state is written out."""
        n, m = self.shape.states, self.shape.accumulators
        return [
            "block:",
            "  %b = phi i64 [ 0, %entry ], [ %b.next, %block.end ]",
            *row_number(self.shape, "r.b", "[ 0, %entry ], [ %r.next, %block.end ]"),
            *(f"  %x{i}.b = phi {self.vector} [ %x{i}.0, %entry ], [ {self.new[i]}, %block.end ]" for i in range(n)),
            f"  %offset = mul i64 %b, {n + m}",
            f"  %row = getelementptr {self.vector}, ptr %out, i64 %offset",
            *(line for i in range(n) for line in self._store(f"x{i}.b", f"%x{i}.b", "%row", i)),
            "  %first = mul i64 %b, %steps",
            "  %last = add i64 %first, %steps",
            "  br label %step",
        ]

    def step(self, last: str, held: str) -> list[str]:
        """The start of a step, whose end is the block ``last``; ``held`` is the suffix of its state before a sampled part."""
        n, m, vector = self.shape.states, self.shape.accumulators, self.vector
        carried = [f"[ {self.new[i]}, %{last} ]" for i in range(n + m)]
        return [
            "step:",
            f"  %k = phi i64 [ %first, %block ], [ %k.next, %{last} ]",
            *row_number(self.shape, "r", f"[ %r.b, %block ], [ %r.next, %{last} ]"),
            *(f"  %x{i}{held} = phi {vector} [ %x{i}.b, %block ], {carried[i]}" for i in range(n)),
            *(f"  %a{i} = phi {vector} [ {self.resets[i]}, %block ], {carried[n + i]}" for i in range(m)),
            "  %now = add i64 %k, %start",
        ]

    def end(self) -> list[str]:
        """The ends of a step, of a block, where the accumulators are written out, and of the loop."""
        n, m = self.shape.states, self.shape.accumulators
        return [
            f"  %k.next = add i64 %k, {'%ends' if self.shape.in_pieces else 1}",
            "  %more = icmp ult i64 %k.next, %last",
            "  br i1 %more, label %step, label %block.end",
            "block.end:",
            *(line for i in range(m) for line in self._store(f"a{i}", self.new[n + i], "%row", n + i)),
            "  %b.next = add i64 %b, 1",
            "  %again = icmp ult i64 %b.next, %blocks",
            "  br i1 %again, label %block, label %exit",
            "exit:",
            *(line for i in range(n) for line in self._store(f"x{i}.e", self.new[i], "%state", i)),
            "  ret void",
            "}",
        ]

    def _load(self, name: str, base: str, offset: int) -> list[str]:
        return [
            f"  %{name}.at = getelementptr {self.vector}, ptr {base}, i64 {offset}",
            f"  %{name} = load {self.vector}, ptr %{name}.at, align 8",
        ]

    def _store(self, name: str, value: str, base: str, offset: int) -> list[str]:
        return [
            f"  %{name}.to = getelementptr {self.vector}, ptr {base}, i64 {offset}",
            f"  store {self.vector} {value}, ptr %{name}.to, align 8",
        ]
