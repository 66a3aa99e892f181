"""IR for a step that remembers: a ring of past values beside the loop, one for each delayed channel.

The ring's first TAPS_PER_CHANNEL - 1 rows stand once more behind its last, so that the taps of a step are neighbours: one
address for each member, however many taps and channels.
"""

from __future__ import annotations

from barbalat.lowering.shape import TAPS_PER_CHANNEL, LoopShape


def lag_loads(shape: LoopShape, lanes: int) -> list[str]:
    """Once, at the start: how far each member looks back."""
    if not shape.delayed:
        return []
    count = lanes if shape.lag_per_member else 1
    lines = []
    for j in range(count):
        lines += [f"  %lag{j}.at = getelementptr i64, ptr %lags, i64 {j}", f"  %lag{j} = load i64, ptr %lag{j}.at, align 8"]
    return lines


def past_loads(shape: LoopShape, lanes: int, vector: str) -> list[str]:
    """%d{channel * TAPS_PER_CHANNEL + tap}: what was remembered lag + tap steps ago."""
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
        "  %slot.twin = select i1 %is.first, i64 %slot.again, i64 %slot.now",  # elsewhere the same is stored twice
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
