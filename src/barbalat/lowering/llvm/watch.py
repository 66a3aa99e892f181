"""IR for a quantity that is watched: every window of steps keeps its largest value, and the state and the step where it occurred.

It is looked at before every WATCH_EVERY-th step, counted from t = 0. Windows have nothing to do with blocks. What is no number
never is the largest. Of several members side by side the largest values alone are kept.
"""

from __future__ import annotations

from barbalat.lowering.shape import WATCH_EVERY

LAST_BLOCK = "kept"
"""The last basic block of a step that has a watch."""

LONGEST_INSIDE = 4000
"""Operations of a quantity that is compiled with the step. LLVM takes minutes for some 30,000 in one block."""


def called(lines: list[str], quantity: str, used: list[str]) -> tuple[list[str], list[str], list[str]]:
    """A long quantity as a function of its own, which LLVM translates as it stands; its room on the stack; its call.

    ``used`` are the values of the loop that its ``lines`` read. The operations and their order, so every bit, are the same.
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
    """``lines`` compute the quantity, ``due`` has %watch.due from %watch.phase.

    A new largest value is rare: a branch, not a selection for every entry of the state.
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
    """The same for members side by side, each of which keeps its own largest value."""
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
