"""IR that loads what drives a step: the table of signals, the same for all members, and each member's noise."""

from __future__ import annotations

from barbalat.lowering.shape import LoopShape


def count(compiled: int | None, argument: str) -> str:
    """A count of steps: compiled in, or the kernel's argument."""
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
    """%s{i}: the signals of this step, for every lane; of a step in pieces also what the piece's row says of it."""
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


def row_number(shape: LoopShape, name: str, sources: str) -> list[str]:
    """The number of the row of signals, where it is not that of the step."""
    return [f"  %{name} = phi i64 {sources}"] if shape.in_pieces else []


def due(shape: LoopShape, what: str, phase: str) -> list[str]:
    """%{what}: whether the phase is over, before a step and not between two of its pieces."""
    if not shape.in_pieces:
        return [f"  %{what} = icmp eq i64 {phase}, 0"]
    return [f"  %{what}.then = icmp eq i64 {phase}, 0", f"  %{what} = and i1 %{what}.then, %begins"]
