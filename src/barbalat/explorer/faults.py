"""Faults in a page: their numbers, and a module with the hash of ``problem.faults.uniform``, which draws them."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from barbalat.lowering.llvm.printer import constant
from barbalat.lowering.wasm.module import module
from barbalat.open_numbers.numbers import Number
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.problem.faults import (
    FACTORS,
    GOLDEN_GAMMA,
    GRID,
    SHIFTS,
    SIGNS,
    UNUSED_BITS,
    Fault,
    FaultSignal,
    Jitter,
    Latency,
    Spike,
)
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Signal

ENTRY = "barbalat_uniform"
DRAWN = ("share", "burst", "size", "times", "time", "seed")
"""Settings of a fault that determine its signal. The time of a jitter fault is also a number of the loop."""
SEEDS = 100
"""Number of seeds, from 0 on, that a slider offers."""
LARGEST_EXACT_SEED = 2**53
"""Largest whole number up to which the numbers of a page represent every integer."""


def fault_of(signal: Signal) -> dict[str, Any] | None:
    """Return the fault behind a signal for a page's JSON; None for any other signal. Seeds are written as digits, because
    numbers of a page have only 53 bits."""
    if not isinstance(signal, FaultSignal):
        return None
    fault = signal.fault
    kept = {name: getattr(fault, name, None) for name in DRAWN}
    return {"kind": fault.kind, "place": signal.place, **kept, "seed": str(fault.seed)}


def drawn_by(path: FieldPath, signals: Sequence[Signal]) -> tuple[int, list[Key]] | None:
    """Return the signal to which a number belongs, and the keys of the number in it; None if the number determines no fault."""
    first, *keys = path.keys
    if first != "faults" or keys[1] not in DRAWN:
        return None
    return next(i for i, one in enumerate(signals) if isinstance(one, FaultSignal) and one.place == keys[0]), keys[1:]


def seeds(faults: Sequence[Fault]) -> Iterator[Number]:
    """Yield the seeds of the faults with their slider values, except seeds that are too large for a page's numbers to represent
    exactly."""
    for i, fault in enumerate(faults):
        drawn = fault.share is not None or isinstance(fault, (Spike, Jitter))
        if drawn and fault.seed <= LARGEST_EXACT_SEED:
            values = np.union1d(np.arange(float(SEEDS)), float(fault.seed))
            yield Number(path=FieldPath(("faults", i, "seed")), value=fault.seed, values=values, whole=True, logarithmic=False)


def fixed(problem: TrackingProblem) -> str:
    """Return sentences on times of the faults and of the shell that a page cannot vary; empty if there are none."""
    found = ["The time of a latency"] if any(isinstance(one, Latency) for one in problem.faults) else []
    found += ["The time after which a sensor counts as stuck"] if problem.shell is not None and problem.shell.stuck else []
    counted = "it is a number of samples, which is fixed in the code of the simulation"
    return " ".join(f"{one} has no slider: {counted}." for one in found)


def rules(signals: Sequence[Signal]) -> dict[str, Any] | None:
    """Return what all faults of a page have in common; None if there are no faults."""
    if not any(isinstance(one, FaultSignal) for one in signals):
        return None
    return {"module": base64.b64encode(uniform_module()).decode(), "grid": GRID, "signs": SIGNS}


def uniform_module() -> bytes:
    """Return a module whose function ``barbalat_uniform(seed, place, count, slots, out)`` writes a double from 0 to 1 for each
    slot."""
    gamma = int(GOLDEN_GAMMA)
    lines = [
        f"define void @{ENTRY}(i64 %seed, i64 %place, i64 %count, ptr %slots, ptr %out) {{",
        "entry:",
        "  %place.1 = add i64 %place, 1",
        f"  %grown = mul i64 %place.1, {gamma}",
        "  %key.0 = add i64 %seed, %grown",
        *_mixed("key", "%key.0"),
        "  %some = icmp ugt i64 %count, 0",
        "  br i1 %some, label %one, label %exit",
        "one:",
        "  %i = phi i64 [ 0, %entry ], [ %i.next, %one ]",
        "  %from = getelementptr double, ptr %slots, i64 %i",
        "  %slot.double = load double, ptr %from, align 8",
        "  %slot = fptosi double %slot.double to i64",
        f"  %slot.grown = mul i64 %slot, {gamma}",
        "  %first.0 = add i64 %slot.grown, %key",
        *_mixed("first", "%first.0"),
        *_mixed("found", "%first"),
        f"  %bits = lshr i64 %found, {UNUSED_BITS}",
        "  %whole = sitofp i64 %bits to double",
        f"  %value = fmul double %whole, {constant(2.0 ** (UNUSED_BITS - 64))}",
        "  %to = getelementptr double, ptr %out, i64 %i",
        "  store double %value, ptr %to, align 8",
        "  %i.next = add i64 %i, 1",
        "  %again = icmp ult i64 %i.next, %count",
        "  br i1 %again, label %one, label %exit",
        "exit:",
        "  ret void",
        "}",
    ]
    return module("\n".join(lines), ENTRY)


def _mixed(name: str, given: str) -> list[str]:
    """Return the lines that compute the output function of SplitMix64 for a value, under the name ``name``."""
    (first, second, third), (one, two) = SHIFTS, FACTORS
    return [
        f"  %{name}.a = lshr i64 {given}, {first}",
        f"  %{name}.b = xor i64 {given}, %{name}.a",
        f"  %{name}.c = mul i64 %{name}.b, {one}",
        f"  %{name}.d = lshr i64 %{name}.c, {second}",
        f"  %{name}.e = xor i64 %{name}.c, %{name}.d",
        f"  %{name}.f = mul i64 %{name}.e, {two}",
        f"  %{name}.g = lshr i64 %{name}.f, {third}",
        f"  %{name} = xor i64 %{name}.f, %{name}.g",
    ]
