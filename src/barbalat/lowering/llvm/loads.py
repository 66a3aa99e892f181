"""IR that loads a step's inputs: the table of signals, which is the same for all members, and each member's noise and past.

The past is a ring buffer outside the loop, one for each delayed channel. The ring's first TAPS_PER_CHANNEL - 1 rows are repeated
after its last, so the taps of a step are adjacent: each member needs one address, for any number of taps and channels.
"""

from __future__ import annotations

from barbalat.lowering.shape import TAPS_PER_CHANNEL, LoopShape


def count(compiled: int | None, argument: str) -> str:
    """A number of steps: a compiled-in constant, or the kernel's argument."""
    return f"%{argument}" if compiled is None else str(compiled)


def noise_loads(shape: LoopShape, vector: str) -> list[str]:
    """%n{i}: the noise of this step."""
    if not shape.noise:
        return []
    lines = [
        f"  %noise.at = udiv i64 %now, {count(shape.noise_hold, 'noise.hold')}",
        "  %noise.row = sub i64 %noise.at, %noise.first",
        f"  %noise.base = mul i64 %noise.row, {shape.noise}",
    ]
    for i in range(shape.noise):
        lines += [
            f"  %n{i}.index = add i64 %noise.base, {i}",
            f"  %n{i}.at = getelementptr {vector}, ptr %noise, i64 %n{i}.index",
            f"  %n{i} = load {vector}, ptr %n{i}.at, align 8",
        ]
    return lines


def signal_loads(shape: LoopShape, lanes: int, vector: str) -> list[str]:
    """%s{i}: the signals of this step, for every lane; for a step in pieces the row also describes the piece."""
    if shape.signal_row is not None:
        return _signals_of_row(shape, lanes, vector)
    signals = shape.signals
    lines = [f"  %s.row = mul i64 {'%r' if shape.in_pieces else '%k'}, {signals}"]
    for i in range(signals):
        lines += [
            f"  %s{i}.index = add i64 %s.row, {i}",
            f"  %s{i}.at = getelementptr double, ptr %signals, i64 %s{i}.index",
        ]
        scalar = f"%s{i}" if lanes == 1 else f"%s{i}.one"
        lines.append(f"  {scalar} = load double, ptr %s{i}.at, align 8")
        if lanes > 1:
            lines += [
                f"  %s{i}.in = insertelement {vector} poison, double {scalar}, i64 0",
                f"  %s{i} = shufflevector {vector} %s{i}.in, {vector} poison, <{lanes} x i32> zeroinitializer",
            ]
    if shape.in_pieces:
        begins, ends = (f"%s{i}" if lanes == 1 else f"%s{i}.one" for i in (signals - 2, signals - 1))
        lines += [
            f"  %begins = fcmp une double {begins}, 0.0",
            f"  %is.end = fcmp une double {ends}, 0.0",
            "  %ends = zext i1 %is.end to i64",
            "  %r.next = add i64 %r, 1",
        ]
    return lines


def _signals_of_row(shape: LoopShape, lanes: int, vector: str) -> list[str]:
    """%s{i}: the signals of the row whose number is in a member's state."""
    assert shape.signal_row is not None
    lines = _whole_numbers(shape, "s.row", shape.signal_row, lanes, vector)
    for j in range(lanes):
        own = shape.rows_per_member and lanes > 1
        lines += [
            f"  %s.slot{j} = mul i64 %s.row{j}, {lanes if own else 1}",
            f"  %s.place{j} = add i64 %s.slot{j}, {j if own else 0}",
            f"  %s.first{j}.index = mul i64 %s.place{j}, {shape.signals}",
            f"  %s.first{j} = getelementptr double, ptr %signals, i64 %s.first{j}.index",
        ]
    return [*lines, *(line for i in range(shape.signals) for line in _gathered(f"s{i}", "s.first", i, lanes, vector))]


def _held(shape: LoopShape, row: int) -> str:
    """An entry of the state before a sampled part, if there is one."""
    return f"%x{row}" + (".held" if shape.sample_row is not None else "")


def _whole_numbers(shape: LoopShape, name: str, row: int, lanes: int, vector: str) -> list[str]:
    """%{name}{j}: the whole number that is each member's entry in this row of the state."""
    if lanes == 1:
        return [f"  %{name}0 = fptosi double {_held(shape, row)} to i64"]
    lines = [f"  %{name} = fptosi {vector} {_held(shape, row)} to <{lanes} x i64>"]
    return lines + [f"  %{name}{j} = extractelement <{lanes} x i64> %{name}, i64 {j}" for j in range(lanes)]


def _gathered(name: str, base: str, offset: int, lanes: int, vector: str) -> list[str]:
    """%{name}: the number at this offset from the address %{base}{j} of each member."""
    lines, previous = [], "poison"
    for j in range(lanes):
        one = f"%{name}" if lanes == 1 else f"%{name}.{j}"
        lines += [
            f"  %{name}.at{j} = getelementptr double, ptr %{base}{j}, i64 {offset}",
            f"  {one} = load double, ptr %{name}.at{j}, align 8",
        ]
        if lanes > 1:
            last = f"%{name}" if j == lanes - 1 else f"%{name}.in{j}"
            lines.append(f"  {last} = insertelement {vector} {previous}, double {one}, i64 {j}")
            previous = last
    return lines


def record_loads(shape: LoopShape, lanes: int, vector: str) -> list[str]:
    """%d{i}: the records of a member's earlier steps, starting with the record whose number is in its state."""
    if shape.recalled is None:
        return []
    lines = _records(shape, "d.first", shape.recalled.first, lanes, vector)
    count = shape.recalled.records * shape.recalled.width
    return [*lines, *(line for i in range(count) for line in _gathered(f"d{i}", "d.first", i, lanes, vector))]


def keep_record(shape: LoopShape, values: list[str], lanes: int, vector: str) -> list[str]:
    """Store the record of each step."""
    if shape.recalled is None:
        return []
    lines = _records(shape, "d.own", shape.recalled.last, lanes, vector)
    for i, value in enumerate(values):
        for j in range(lanes):
            one = value
            if lanes > 1:
                one = f"%own{i}.{j}"
                lines.append(f"  {one} = extractelement {vector} {value}, i64 {j}")
            lines += [
                f"  %own{i}.to{j} = getelementptr double, ptr %d.own{j}, i64 {i}",
                f"  store double {one}, ptr %own{i}.to{j}, align 8",
            ]
    return lines


def _records(shape: LoopShape, name: str, row: int, lanes: int, vector: str) -> list[str]:
    """%{name}{j}: the address of the record whose number is in this row of a member's state; %mask is the number of records for
    which each member has room."""
    assert shape.recalled is not None
    lines = _whole_numbers(shape, f"{name}.number", row, lanes, vector)
    for j in range(lanes):
        lines += [
            f"  %{name}.room{j} = mul i64 %mask, {j}",
            f"  %{name}.place{j} = add i64 %{name}.number{j}, %{name}.room{j}",
            f"  %{name}.index{j} = mul i64 %{name}.place{j}, {shape.recalled.width}",
            f"  %{name}{j} = getelementptr double, ptr %ring, i64 %{name}.index{j}",
        ]
    return lines


def row_number(shape: LoopShape, name: str, sources: str) -> list[str]:
    """The number of the row of signals, if it differs from the step's number."""
    return [f"  %{name} = phi i64 {sources}"] if shape.in_pieces else []


def due(shape: LoopShape, what: str, phase: str) -> list[str]:
    """IR of %{what}: whether the phase has ended, before a step and not between two of its pieces."""
    if not shape.in_pieces:
        return [f"  %{what} = icmp eq i64 {phase}, 0"]
    return [f"  %{what}.then = icmp eq i64 {phase}, 0", f"  %{what} = and i1 %{what}.then, %begins"]


def lag_loads(shape: LoopShape, lanes: int) -> list[str]:
    """The lag of each member, loaded once at the start."""
    if not shape.delayed:
        return []
    count = lanes if shape.lag_per_member else 1
    lines = []
    for j in range(count):
        lines += [f"  %lag{j}.at = getelementptr i64, ptr %lags, i64 {j}", f"  %lag{j} = load i64, ptr %lag{j}.at, align 8"]
    return lines


def past_loads(shape: LoopShape, lanes: int, vector: str) -> list[str]:
    """%d{channel * TAPS_PER_CHANNEL + tap}: the value stored lag + tap steps ago."""
    if not shape.delayed:
        return []
    lines = []
    width = lanes if shape.lag_per_member else 1
    for j in range(width):
        lines += [
            f"  %newest{j} = sub i64 %now, %lag{j}",
            f"  %oldest{j} = sub i64 %newest{j}, {TAPS_PER_CHANNEL - 1}",
            f"  %slot{j} = and i64 %oldest{j}, %mask",
            f"  %base{j} = mul i64 %slot{j}, {shape.delayed}",
        ]
    for channel in range(shape.delayed):
        for tap in range(TAPS_PER_CHANNEL):
            name = f"d{channel * TAPS_PER_CHANNEL + tap}"
            for j in range(width):
                lines.append(f"  %{name}.{j}.row = add i64 %base{j}, {(TAPS_PER_CHANNEL - 1 - tap) * shape.delayed + channel}")
            if not shape.lag_per_member or lanes == 1:
                lines += [
                    f"  %{name}.at = getelementptr {vector}, ptr %ring, i64 %{name}.0.row",
                    f"  %{name} = load {vector}, ptr %{name}.at, align 8",
                ]
                continue
            previous = "poison"
            for j in range(lanes):
                last = f"%{name}" if j == lanes - 1 else f"%{name}.in{j}"
                lines += [
                    f"  %{name}.{j}.one = mul i64 %{name}.{j}.row, {lanes}",
                    f"  %{name}.{j}.two = add i64 %{name}.{j}.one, {j}",
                    f"  %{name}.{j}.at = getelementptr double, ptr %ring, i64 %{name}.{j}.two",
                    f"  %{name}.{j}.value = load double, ptr %{name}.{j}.at, align 8",
                    f"  {last} = insertelement {vector} {previous}, double %{name}.{j}.value, i64 {j}",
                ]
                previous = last
    return lines


def remember(shape: LoopShape, vector: str, values: list[str]) -> list[str]:
    """Store the channels' values at the step's start, after the past was read."""
    if not shape.delayed:
        return []
    lines = [
        "  %slot.now = and i64 %now, %mask",
        f"  %is.first = icmp ult i64 %slot.now, {TAPS_PER_CHANNEL - 1}",
        "  %slot.behind = add i64 %slot.now, %mask",
        "  %slot.again = add i64 %slot.behind, 1",
        "  %slot.twin = select i1 %is.first, i64 %slot.again, i64 %slot.now",  # otherwise the value is stored twice
        f"  %base.now = mul i64 %slot.now, {shape.delayed}",
        f"  %base.twin = mul i64 %slot.twin, {shape.delayed}",
    ]
    for channel, value in enumerate(values):
        for where in ("now", "twin"):
            lines += [
                f"  %{where}{channel}.row = add i64 %base.{where}, {channel}",
                f"  %{where}{channel}.at = getelementptr {vector}, ptr %ring, i64 %{where}{channel}.row",
                f"  store {vector} {value}, ptr %{where}{channel}.at, align 8",
            ]
    return lines
