"""Operation list -> LLVM IR text: the time loop around one step, for a vector of W members at once.

The step's outputs become its inputs again ("carry"). Part of the carry, the accumulators, is reset at the start of every
block of steps and written out at its end, so that figures over all steps cost no memory. The kernel knows nothing else.
"""

from __future__ import annotations

import struct

from barbalat.lowering.llvm.loads import count, due, noise_loads, row_number, signal_loads
from barbalat.lowering.llvm.past import lag_loads, past_loads, remember
from barbalat.lowering.llvm.watch import LAST_BLOCK, LONGEST_INSIDE, called, keep_largest
from barbalat.lowering.operations import COMPARISONS, Program
from barbalat.lowering.shape import ENTRY, TAPS, LoopShape

_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
_INTRINSICS = {
    "sqrt": 1, "fabs": 1, "floor": 1, "ceil": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "tanh": 1,
    "pow": 2, "copysign": 2,
}  # fmt: skip


def constant(value: float) -> str:
    """A double as LLVM writes it exactly: by its bits."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class _Printer:
    """Prints the operations of one step; ``values`` maps a position to the text of its value."""

    def __init__(self, program: Program, lanes: int, inputs: dict[tuple[int, int], str], prefix: str = "v") -> None:
        self.program = program
        self.prefix = prefix
        self.lanes = lanes
        self.inputs = inputs
        self.vector = "double" if lanes == 1 else f"<{lanes} x double>"
        self.mask = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.lines: list[str] = []
        self.intrinsics: set[str] = set()
        self.values: list[str] = []
        self.truth: list[bool] = []
        self.temporaries = 0

    def splat(self, value: float) -> str:
        text = constant(value)
        return text if self.lanes == 1 else "<" + ", ".join([f"double {text}"] * self.lanes) + ">"

    def assign(self, text: str) -> str:
        self.temporaries += 1
        name = f"%{self.prefix}{self.temporaries}"
        self.lines.append(f"  {name} = {text}")
        return name

    def number(self, i: int) -> str:
        """Value i as a number; a truth value becomes 0 or 1."""
        if not self.truth[i]:
            return self.values[i]
        return self.assign(
            f"select {self.mask} {self.values[i]}, {self.vector} {self.splat(1.0)}, {self.vector} {self.splat(0.0)}"
        )

    def condition(self, i: int) -> str:
        if self.truth[i]:
            return self.values[i]
        return self.assign(f"fcmp une {self.vector} {self.values[i]}, {self.splat(0.0)}")

    def intrinsic(self, name: str, *operands: str) -> str:
        types = ", ".join([self.vector] * len(operands))
        self.intrinsics.add(f"declare {self.vector} @llvm.{name}.{self.suffix}({types})")
        arguments = ", ".join(f"{self.vector} {x}" for x in operands)
        return self.assign(f"call {self.vector} @llvm.{name}.{self.suffix}({arguments})")

    def select(self, condition: str, a: str, b: str) -> str:
        return self.assign(f"select {self.mask} {condition}, {self.vector} {a}, {self.vector} {b}")

    def run(self) -> list[str]:
        """The outputs' values, argument by argument."""
        for op in self.program.operations:
            if op.name == "constant":
                value = self.splat(op.value)
            elif op.name == "input":
                value = self.inputs[op.source]
            else:
                value = self.operation(op.name, op.operands)
            self.values.append(value)
            self.truth.append(op.name in COMPARISONS)
        return [self.number(i) for row in self.program.outputs for i in row]

    def operation(self, name: str, operands: tuple[int, ...]) -> str:
        if name in ("not", "and", "or"):
            c = [self.condition(i) for i in operands]
            ones = "true" if self.lanes == 1 else "splat (i1 true)"
            return self.assign(f"xor {self.mask} {c[0]}, {ones}" if name == "not" else f"{name} {self.mask} {c[0]}, {c[1]}")
        if name in ("select", "if_else_zero"):
            other = self.number(operands[2]) if name == "select" else self.splat(0.0)
            return self.select(self.condition(operands[0]), self.number(operands[1]), other)
        x = [self.number(i) for i in operands]
        if name in _ARITHMETIC:
            return self.assign(f"{_ARITHMETIC[name]} {self.vector} {x[0]}, {x[1]}")
        if name in _COMPARE:
            return self.assign(f"fcmp {_COMPARE[name]} {self.vector} {x[0]}, {x[1]}")
        if name in ("fmin", "fmax"):
            return self.extremum(name, x)
        if name == "neg":
            return self.assign(f"fneg {self.vector} {x[0]}")
        if name == "fma":
            return self.intrinsic("fma", *x)
        if name == "fnma":
            return self.intrinsic("fma", self.assign(f"fneg {self.vector} {x[0]}"), x[1], x[2])
        if _INTRINSICS.get(name) == len(x):
            return self.intrinsic(name, *x)
        raise ValueError(f"the operation {name} has no LLVM translation")

    def extremum(self, name: str, x: list[str]) -> str:
        """Minimum or maximum that lets the first operand's NaN through instead of the bound: a blow-up must stay visible."""
        relation = "olt" if name == "fmax" else "ogt"
        return self.select(self.assign(f"fcmp {relation} {self.vector} {x[0]}, {x[1]}"), x[1], x[0])


def loop(
    step: Program,
    shape: LoopShape,
    resets: tuple[float, ...],
    lanes: int,
    sample: Program | None = None,
    watch: Program | None = None,
) -> str:
    """IR of ``void barbalat_loop(blocks, steps, state*, parameters*, signals*, out*, start, lags*, ring*, mask, noise*)``.

    state       [states][W], in and out
    parameters  [parameters][W]
    signals     [blocks * steps][signals], the same for all W members; a row for each piece where steps come in pieces
    out         [blocks][states + accumulators][W]: the state at a block's start, the accumulators at its end
    start       number of the first step since t = 0
    lags        [W]: the newest value handed back is that of ``lag`` steps ago, at least 1
    ring        [mask + TAPS][delayed][W]: remembered values, a power of two of steps and the first ones again; what stands there
                first is the past
    noise       [rows][noise][W]: a row for each ``noise_hold`` steps since t = 0, the first row that of ``start``

    watched     rows of ``watch``, see ``watch.keep_largest``; then the first step of the first and the steps of each
    at last     ``sample_every`` and ``noise_hold``, read where the shape leaves them open

    Before a step whose number is a multiple of ``sample_every``, ``sample`` replaces the state. ``watch`` is a quantity whose
    largest value in every window of steps is kept with the state there; it takes one member.
    """
    if (sample is None) != (shape.sample_every == 0):
        raise ValueError("a loop has a sampled part exactly where its shape says how often it acts")
    if shape.in_pieces and shape.delayed:
        raise ValueError("a step that remembers its past is not made in pieces")
    if watch is not None and lanes > 1:
        raise ValueError(f"a loop that watches runs one member, got {lanes} lanes")
    n, m = shape.states, shape.accumulators
    inputs = {(0, i): f"%x{i}" for i in range(n)}
    inputs |= {(1, i): f"%a{i}" for i in range(m)}
    inputs |= {(2, i): f"%p{i}" for i in range(shape.parameters)}
    inputs |= {(3, i): f"%s{i}" for i in range(shape.signals)}
    inputs |= {(4, i): f"%d{i}" for i in range(shape.delayed * TAPS)}
    inputs |= {(5, i): f"%n{i}" for i in range(shape.noise)}
    printer = _Printer(step, lanes, inputs)
    new = printer.run()
    vector, align = printer.vector, "align 8"
    sampling, held, last = [], "", "step"  # without a sampled part the step is one block
    apart: list[str] = []  # a function beside the loop
    room: list[str] = []  # on its stack
    if sample is not None:
        sampler = _Printer(sample, lanes, inputs | {(0, i): f"%x{i}.held" for i in range(n)}, prefix="w")
        sampled = sampler.run()
        printer.intrinsics |= sampler.intrinsics
        held, last = ".held", "go"
        sampling = [
            f"  %phase = urem i64 %now, {count(shape.sample_every, 'sample.every')}",
            *due(shape, "due", "%phase"),
            "  br i1 %due, label %sample, label %go",
            "sample:",
            *sampler.lines,
            "  br label %go",
            "go:",
            *(f"  %x{i} = phi {vector} [ %x{i}.held, %step ], [ {sampled[i]}, %sample ]" for i in range(n)),
        ]
    watching: list[str] = []
    if watch is not None:
        watcher = _Printer(watch, lanes, inputs, prefix="g")
        (quantity,) = watcher.run()
        printer.intrinsics |= watcher.intrinsics
        looked = watcher.lines
        if len(looked) > LONGEST_INSIDE:
            used = [inputs[op.source] for op in watch.operations if op.name == "input"]
            apart, room, looked = called(looked, quantity, used)
            quantity = "%looked"
        watching, last = keep_largest(n, looked, quantity, due(shape, "watch.due", "%watch.phase")), LAST_BLOCK

    def load(name: str, base: str, offset: str) -> list[str]:
        return [
            f"  %{name}.at = getelementptr {vector}, ptr {base}, i64 {offset}",
            f"  %{name} = load {vector}, ptr %{name}.at, {align}",
        ]

    def store(name: str, value: str, base: str, offset: int) -> list[str]:
        return [
            f"  %{name}.to = getelementptr {vector}, ptr {base}, i64 {offset}",
            f"  store {vector} {value}, ptr %{name}.to, {align}",
        ]

    # the stack is aligned for whole vectors: otherwise every value that does not fit into registers costs unaligned accesses
    lines = [
        f"define void @{ENTRY}(i64 %blocks, i64 %steps, ptr noalias %state, ptr noalias %parameters, "
        "ptr noalias %signals, ptr noalias %out, i64 %start, ptr noalias %lags, ptr noalias %ring, i64 %mask, "
        "ptr noalias %noise, ptr noalias %watched, i64 %watch.first, i64 %watch.window, "
        "i64 %sample.every, i64 %noise.hold) alignstack(64) {",
        "entry:",
        *room,
        *(line for i in range(n) for line in load(f"x{i}.0", "%state", str(i))),
        *(line for i in range(shape.parameters) for line in load(f"p{i}", "%parameters", str(i))),
        *lag_loads(shape, lanes),
        f"  %noise.first = udiv i64 %start, {count(shape.noise_hold, 'noise.hold')}",
        "  br label %block",
        "block:",
        "  %b = phi i64 [ 0, %entry ], [ %b.next, %block.end ]",
        *row_number(shape, "r.b", "[ 0, %entry ], [ %r.next, %block.end ]"),
        *(f"  %x{i}.b = phi {vector} [ %x{i}.0, %entry ], [ {new[i]}, %block.end ]" for i in range(n)),
        f"  %offset = mul i64 %b, {n + m}",
        f"  %row = getelementptr {vector}, ptr %out, i64 %offset",
        *(line for i in range(n) for line in store(f"x{i}.b", f"%x{i}.b", "%row", i)),
        "  %first = mul i64 %b, %steps",
        "  %last = add i64 %first, %steps",
        "  br label %step",
        "step:",
        f"  %k = phi i64 [ %first, %block ], [ %k.next, %{last} ]",
        *row_number(shape, "r", f"[ %r.b, %block ], [ %r.next, %{last} ]"),
        *(f"  %x{i}{held} = phi {vector} [ %x{i}.b, %block ], [ {new[i]}, %{last} ]" for i in range(n)),
        *(f"  %a{i} = phi {vector} [ {printer.splat(resets[i])}, %block ], [ {new[n + i]}, %{last} ]" for i in range(m)),
        "  %now = add i64 %k, %start",
        *signal_loads(shape, lanes, vector),
        *noise_loads(shape, vector),
        *sampling,
        *watching,
        *past_loads(shape, lanes, vector),
        *printer.lines,
        *remember(shape, vector, new[n + m :]),
        f"  %k.next = add i64 %k, {'%ends' if shape.in_pieces else 1}",
        "  %more = icmp ult i64 %k.next, %last",
        "  br i1 %more, label %step, label %block.end",
        "block.end:",
        *(line for i in range(m) for line in store(f"a{i}", new[n + i], "%row", n + i)),
        "  %b.next = add i64 %b, 1",
        "  %again = icmp ult i64 %b.next, %blocks",
        "  br i1 %again, label %block, label %exit",
        "exit:",
        *(line for i in range(n) for line in store(f"x{i}.e", new[i], "%state", i)),
        "  ret void",
        "}",
        *apart,
        *sorted(printer.intrinsics),
    ]
    return "\n".join(lines)
